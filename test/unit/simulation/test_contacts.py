"""Contacts of named points: closed forms, balances of forces and momentum, and rest."""

from dataclasses import replace

from kane_dynamics import (ConstraintError, Contact, ContactMode, CylinderSurface,
                           Inertial, InputError, load_contacts, ModelBuilder,
                           PlaneSurface, point_mass, Robot, rod, simulate, SphereSurface,
                           Trajectory)
from linkages import at_angle, four_bar_model, PIN
import numpy as np
import pytest

G = 9.80665
OPEN, STICKING, SLIDING = ContactMode


def point(axes='xz'):
    """Return a point of 1 kg that moves along axes, with the frame 'tip'."""
    b = ModelBuilder('point', gravity=(0, 0, -G))
    on = 'world'
    for axis in axes:
        last = {'inertial': point_mass(1.0)} if axis == axes[-1] else {}
        b.body(axis, on, 'prismatic', axis=np.eye(3)['xyz'.index(axis)], **last)
        on = axis
    b.frame('tip', on)
    return Robot(b.model())


def free_body(inertia, corners=()):
    """Return a free body of 1 kg with frames at its center, 'tip', and at corners."""
    b = ModelBuilder('body', gravity=(0, 0, -G))
    b.body('body', kind='free', inertial=Inertial(1.0, np.zeros(3), np.diag(inertia)))
    b.frame('tip', 'body')
    for number, corner in enumerate(corners):
        b.frame(f'corner{number}', 'body', at=corner)
    return Robot(b.model())


def arm(friction=0.0):
    """Return an arm of two links in the vertical plane, with the frame 'tip'."""
    b = ModelBuilder('arm', gravity=(0, 0, -G))
    joint = {'axis': (0, 1, 0), 'damping': 0.1, 'friction': friction}
    b.body('upper', inertial=rod(2.0, (0, 0, 0), (0.5, 0, 0)), **joint)
    b.body('fore', 'upper', at=(0.5, 0, 0), inertial=rod(1.0, (0, 0, 0), (0.4, 0, 0)),
           **joint)
    b.frame('tip', 'fore', at=(0.4, 0, 0))
    return Robot(b.model())


TABLE = Contact('tip', PlaneSurface((0, 0, -0.1)), friction=0.4)


@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
def test_a_ball_bounces_at_the_times_and_heights_of_the_closed_form_and_ends_at_rest(
        integrator):
    e = 0.8
    run = simulate(point('z'), [1.0], [0.0], 6.0, sample=0.01, integrator=integrator,
                   contacts=[Contact('tip', PlaneSurface(), restitution=e)])
    speed = np.sqrt(2.0 * G)
    times, speeds = [speed / G], [speed]
    for _ in range(len(run.contact_events) - 1):
        speeds.append(e * speeds[-1])
        times.append(times[-1] + 2.0 * speeds[-1] / G)
    assert len(times) > 50
    events = np.array([[event.t, event.speed, event.impulse, event.rests]
                       for event in run.contact_events])
    # The bounces end at a finite time, and the last event says so.
    last = np.arange(len(times)) == len(times) - 1
    expected = [times, speeds, (1.0 + e * ~last) * speeds, last]
    np.testing.assert_allclose(events.T, expected, atol=1e-9)
    assert times[-1] == pytest.approx(speed / G * (1.0 + e) / (1.0 - e), abs=1e-5)
    assert abs(run.q[-1, 0]) < 1e-15 and abs(run.u[-1, 0]) < 1e-15
    np.testing.assert_allclose(run.contact_forces[-1, 0], [0.0, 0.0, G], atol=1e-12)
    assert (np.diff(run.energy.sum(axis=1)) < 1e-12).all() and not run.warnings


@pytest.mark.parametrize('slope', [0.05, 0.45, 0.47, 0.9])
def test_a_block_on_an_incline_sticks_up_to_the_friction_angle_and_slides_beyond(slope):
    mu = 0.5
    incline = PlaneSurface(normal=(np.sin(slope), 0, np.cos(slope)))
    run = simulate(point(), [0.0, 0.0], [0.0, 0.0], 1.0, sample=0.1,
                   contacts=[Contact('tip', incline, friction=mu)])
    acceleration = max(0.0, G * (np.sin(slope) - mu * np.cos(slope)))
    expected = 0.5 * acceleration * run.t**2
    np.testing.assert_allclose(run.q @ [np.cos(slope), -np.sin(slope)], expected,
                               atol=1e-12)
    np.testing.assert_allclose(run.q @ [np.sin(slope), np.cos(slope)], 0.0, atol=1e-14)
    assert (run.contact_modes == (SLIDING if acceleration else STICKING)).all()
    assert not run.warnings


@pytest.mark.parametrize('integrator', ['rk4', 'implicit'])
def test_a_sphere_slips_and_then_rolls(integrator):
    radius, mu = 0.1, 0.2
    robot = free_body([0.4 * radius**2] * 3)
    run = simulate(robot, [0, 0, radius, 0, 0, 0, 1.0], [1.0, 0, 0, 0, 0, 0], 1.0,
                   sample=0.01, integrator=integrator,
                   contacts=[Contact('tip', PlaneSurface(), radius=radius, friction=mu)])
    # It slips until its center has 5/7 of its speed.
    end = 2.0 / (7.0 * mu * G)
    slips = run.t < end
    x = np.where(slips, run.t - 0.5 * mu * G * run.t**2,
                 end - 0.5 * mu * G * end**2 + 5.0 / 7.0 * (run.t - end))
    np.testing.assert_allclose(run.q[:, 0], x, atol=1e-12)
    np.testing.assert_allclose(run.u[-1], [5 / 7, 0, 0, 0, 50 / 7, 0], atol=1e-12)
    np.testing.assert_array_equal(run.contact_modes[:, 0],
                                  np.where(slips, SLIDING, STICKING))
    assert not run.warnings


@pytest.mark.parametrize(('surface', 'axes'), [
    (SphereSurface((0, 0, 0), 1.0), [0, 1, 2]),
    (CylinderSurface((0, 0, 0), (0, 1, 0), 1.0), [0, 2])])
def test_a_point_leaves_a_smooth_sphere_or_cylinder_where_its_force_ends(surface, axes):
    begin = 0.2
    run = simulate(point('xyz'), [np.sin(begin), 0, np.cos(begin)], [0, 0, 0], 1.2,
                   sample=1e-3, contacts=[Contact('tip', surface)])
    touches = run.contact_modes[:, 0] != OPEN
    distance = np.linalg.norm(run.q[:, axes], axis=1)
    assert np.abs(distance[touches] - 1.0).max() < 1e-9
    # At 2/3 of the height at which it began.
    leaves = int(np.argmin(touches))
    height = run.q[leaves - 1:leaves + 1, 2]
    assert height[0] > 2.0 / 3.0 * np.cos(begin) > height[1]
    assert np.ptp(run.energy.sum(axis=1)) < 1e-9 and not run.warnings


def test_a_box_that_falls_on_its_corners_comes_to_rest_and_never_gains_energy():
    corners = [(x, y, -0.05) for x in (-0.1, 0.1) for y in (-0.15, 0.15)]
    robot = free_body([0.01, 0.02, 0.025], corners)
    contacts = [Contact(f'corner{k}', PlaneSurface(), friction=0.5, restitution=0.2)
                for k in range(4)]
    run = simulate(robot, [0, 0, 0.2, 0, 0, 0, 1.0], [0.5, 0.2, 0, 1.0, 2.0, 0.5], 2.0,
                   sample=0.01, contacts=contacts)
    assert (run.contact_modes[-1] == STICKING).all()
    np.testing.assert_allclose(run.u[-1], 0.0, atol=1e-12)
    assert abs(run.q[-1, 2] - 0.05) < 1e-8
    np.testing.assert_allclose(run.contact_forces[-1].sum(axis=0), [0, 0, G], atol=1e-9)
    assert (run.contact_forces[-1, :, 2] > 0.0).all()
    assert (np.diff(run.energy.sum(axis=1)) < 1e-9).all() and not run.warnings


@pytest.mark.parametrize('seed', range(8))
def test_a_box_that_is_thrown_in_any_orientation_comes_to_rest(seed):
    """It lands on a corner, an edge and a face, whose corners are redundant."""
    sizes = (0.2, 0.15, 0.1)
    corners = [np.multiply(sizes, signs) for signs in np.ndindex(2, 2, 2)]
    corners = [2.0 * corner - sizes for corner in corners]
    robot = free_body([0.01, 0.015, 0.02], corners)
    q = robot.random_configuration(seed, 1)[0]
    q[:3] = 0.0, 0.0, 0.6
    u = np.random.default_rng(seed).normal(size=6)
    contacts = [Contact(f'corner{k}', PlaneSurface(), friction=0.5, restitution=0.3)
                for k in range(8)]
    run = simulate(robot, q, u, 3.0, sample=0.02, contacts=contacts)
    np.testing.assert_allclose(run.u[-1], 0.0, atol=1e-12)
    np.testing.assert_allclose(run.contact_forces[-1].sum(axis=0), [0, 0, G], atol=1e-9)
    heights = [robot.frame_pose(name, run.q)[:, 2, 3] for name in run.contact_names]
    assert np.min(heights) > -1e-8
    assert (np.diff(run.energy.sum(axis=1)) < 1e-8).all() and not run.warnings


def test_points_of_contacts_are_below_the_centers_of_their_spheres():
    robot = arm()
    ball = Contact('tip', PlaneSurface((0, 0, -0.3)), radius=0.05)
    run = simulate(robot, [-0.5, 0.3], [0.0, 0.0], 1.0, sample=0.05, contacts=[ball])
    tips = robot.frame_pose('tip', run.q)[:, :3, 3]
    np.testing.assert_allclose(run.contact_points[:, 0], tips - [0, 0, 0.05], atol=1e-12)


def test_forces_of_contacts_are_those_of_the_accelerations_and_inside_their_cones():
    robot = arm()
    run = simulate(robot, [-0.5, 0.3], [0.0, 0.0], 3.0, sample=0.01, contacts=[TABLE])
    assert {*run.contact_modes[:, 0].tolist()} == {OPEN, STICKING, SLIDING}
    for q, u, udot, (force,), (mode,) in zip(run.q, run.u, run.udot, run.contact_forces,
                                             run.contact_modes):
        J = robot.jacobian('tip', q)[:3]
        balance = robot.inverse_dynamics(q, u, udot) - J.T @ force
        np.testing.assert_allclose(balance, 0.0, atol=1e-9)
        slip = (J @ u)[0]
        acceleration = robot.frame_acceleration('tip', q, u, udot)[:3]
        if mode == OPEN:
            assert not force.any()
            continue
        assert force[2] > 0.0 and abs(acceleration[2]) < 1e-7
        if mode == STICKING:
            assert abs(force[0]) <= 0.4 * force[2]
            assert abs(slip) < 1e-8 and abs(acceleration[0]) < 1e-7
        else:
            assert force[0] == pytest.approx(-0.4 * np.sign(slip) * force[2], rel=1e-9)
    assert not run.warnings


def test_the_momentum_of_every_impact_is_balanced():
    robot = arm()
    run = simulate(robot, [-0.5, 0.3], [0.0, 0.0], 0.3, step=1e-5, sample=1e-5,
                   contacts=[TABLE])
    event = run.contact_events[0]
    k = int(event.t / 1e-5)
    q = run.q[k]
    jump = robot.mass_matrix(q) @ (run.u[k + 1] - run.u[k])
    impulse = np.linalg.solve(robot.jacobian('tip', q)[[0, 2]].T, jump)
    # What gravity and Coriolis forces do within the step is left.
    assert impulse[1] == pytest.approx(event.impulse, abs=5e-3)
    assert abs(impulse[0]) <= 0.4 * impulse[1] + 5e-3
    lost = run.energy[k].sum() - run.energy[k + 1].sum()
    assert event.loss == pytest.approx(lost, abs=5e-3)


def test_joints_stop_and_stick_while_a_tool_slides_and_sticks():
    robot = arm(friction=0.5)
    run = simulate(robot, [-0.5, 0.3], [0.0, 0.0], 3.0, sample=0.01, sticking=True,
                   contacts=[TABLE])
    assert run.sticking[-1].all() and run.contact_modes[-1, 0] == STICKING
    np.testing.assert_allclose(run.u[-1], 0.0, atol=1e-12)
    assert (np.diff(run.energy.sum(axis=1)) < 1e-9).all() and not run.warnings


def lands_between_stops(limits, contact, **joint):
    """Return an arm of two links with stops, and its motion, 1.5 s long."""
    b = ModelBuilder('arm', gravity=(0, 0, -G))
    joint['axis'] = (0, 1, 0)
    b.body('upper', inertial=rod(2.0, (0, 0, 0), (0.5, 0, 0)), **joint)
    b.body('fore', 'upper', at=(0.5, 0, 0), inertial=rod(1.0, (0, 0, 0), (0.4, 0, 0)),
           **joint)
    b.frame('tip', 'fore', at=(0.4, 0, 0))
    robot = Robot(b.model())
    robot.limits = replace(robot.limits, lower=-np.array(limits), upper=np.array(limits))
    run = simulate(robot, [-0.5, 0.2], [1.0, -2.0], 1.5, sample=0.01, stops=True,
                   sticking=True, contacts=[contact])
    return robot, run


@pytest.mark.parametrize('restitution', [0.0, 0.3])
def test_a_stop_friction_and_a_contact_share_what_fewer_of_them_could_hold(restitution):
    floor = Contact('tip', PlaneSurface((0, 0, -0.55)), friction=0.3,
                    restitution=restitution)
    robot, run = lands_between_stops([0.9, 0.7], floor, friction=0.5, damping=0.1)
    assert run.sticking[-1].all() and run.contact_modes[-1, 0] == STICKING
    assert run.q[-1, 0] == 0.9 and run.stop_forces[-1, 0] < -1.0
    np.testing.assert_array_equal(run.u[-1], 0.0)
    # No bound is exceeded, and the forces are in balance.
    along, normal = run.contact_forces[-1, 0, [0, 2]]
    assert abs(along) <= 0.3 * normal
    forces = robot.jacobian('tip', run.q[-1])[:3].T @ run.contact_forces[-1, 0]
    friction = forces + run.stop_forces[-1] - robot.gravity_force(run.q[-1])
    assert (np.abs(friction) <= 0.5 + 1e-9).all()
    assert (np.diff(run.energy.sum(axis=1)) < 1e-8).all() and not run.warnings


def test_a_contact_slides_while_friction_holds_the_joint_that_would_lift_it():
    floor = Contact('tip', PlaneSurface((0, 0, -0.55)), friction=0.3, restitution=0.3)
    _, run = lands_between_stops([np.inf, np.inf], floor, friction=0.5)
    assert run.contact_events and not run.warnings
    assert (np.diff(run.energy.sum(axis=1)) < 1e-8).all()
    along, normal = run.contact_forces[:, 0, [0, 2]].T
    assert (normal >= 0.0).all() and (np.abs(along) <= 0.3 * normal + 1e-9).all()


@pytest.mark.parametrize('seed', [0, 9, 19, 40, 87, 93])
def test_random_arms_land_on_a_floor_between_their_stops(seed):
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 4))
    friction = float(random.choice([0.0, 0.5, 2.0]))
    b = ModelBuilder('arm', gravity=(0, 0, -G))
    on, at = 'world', (0, 0, 0)
    for i in range(n):
        length = random.uniform(0.2, 0.6)
        axis = np.eye(3)[[1, 1, 0][random.integers(3)]] if n > 2 else (0, 1, 0)
        joint = {'friction': friction * random.uniform(0.2, 1.0)} if friction else {}
        b.body(f'link{i}', on, axis=axis, at=at,
               inertial=rod(random.uniform(0.5, 2.0), (0, 0, 0), (length, 0, 0.02)),
               damping=random.choice([0.0, 0.1]), **joint)
        on, at = f'link{i}', (length, 0, 0)
    b.frame('tip', on, at=at)
    b.frame('elbow', on)
    robot = Robot(b.model())
    height = -random.uniform(0.2, 0.6)
    mu = float(random.choice([0.0, 0.2, 0.4]))
    restitution = float(random.choice([0.0, 0.5]))
    lower = -random.uniform(0.3, 1.5, n)
    upper = random.uniform(0.3, 1.5, n)
    robot.limits = replace(robot.limits, lower=lower, upper=upper)
    floor = PlaneSurface((0, 0, height))
    contacts = [Contact('tip', floor, friction=mu, restitution=restitution)]
    if random.random() < 0.4:
        contacts.append(Contact('elbow', floor, friction=mu))
    run = simulate(robot, np.zeros(n), 2.0 * random.normal(size=n), 1.5, sample=0.01,
                   stops=True, sticking=True, contacts=contacts)
    assert (np.diff(run.energy.sum(axis=1)) < 1e-6).all() and not run.warnings
    assert (run.q >= lower).all() and (run.q <= upper).all()
    assert (run.stop_forces * np.sign(run.q - 0.5 * (lower + upper)) <= 1e-9).all()
    for k, contact in enumerate(contacts):
        assert (robot.frame_pose(contact.frame, run.q)[:, 2, 3] > height - 1e-8).all()
        along = np.linalg.norm(run.contact_forces[:, k, :2], axis=1)
        normal = run.contact_forces[:, k, 2]
        assert (normal >= 0.0).all() and (along <= mu * normal + 1e-6).all()


def test_a_load_that_friction_holds_between_finger_and_wall_does_not_creep_in_an_hour():
    b = ModelBuilder('grip', gravity=(0, 0, -G))
    b.body('finger', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(0.5))
    b.body('across', kind='prismatic', axis=(1, 0, 0))
    b.body('load', 'across', 'prismatic', axis=(0, 0, 1), inertial=point_mass(1.0))
    b.frame('fingertip', 'finger')
    b.frame('front', 'load')
    b.frame('back', 'load', at=(0.1, 0, 0))
    pads = [Contact('back', PlaneSurface((0.1, 0, 0), (-1, 0, 0)), friction=0.5),
            Contact('fingertip', PlaneSurface(normal=(-1, 0, 0), frame='front'),
                    friction=0.5)]
    run = simulate(Robot(b.model()), np.zeros(3), np.zeros(3), 3600.0, step=0.02,
                   sample=36.0, torque=[15.0, 0.0, 0.0], contacts=pads)
    assert np.abs(run.q).max() < 1e-15
    assert (run.contact_modes == STICKING).all() and not run.warnings
    np.testing.assert_allclose(run.contact_forces[-1],
                               [[-15.0, 0, G / 2], [-15.0, 0, -G / 2]], atol=1e-9)


def test_the_coupler_of_a_closed_loop_lands_on_a_plane():
    robot = Robot(four_bar_model(), constraints=[PIN])
    q0 = at_angle(1.2)
    height = robot.frame_pose('middle', q0)[2, 3]
    floor = Contact('middle', PlaneSurface((0, 0, height - 0.1)), friction=0.3)
    run = simulate(robot, q0, [0.0], 3.0, sample=0.01, contacts=[floor])
    assert run.contact_events and run.contact_modes[-1, 0] != OPEN
    heights = robot.frame_pose('middle', run.q)[:, 2, 3] - (height - 0.1)
    assert heights.min() > -1e-9
    assert (np.diff(run.energy.sum(axis=1)) < 1e-8).all() and not run.warnings
    assert run.drift < 1e-7


def test_many_simulations_are_those_of_each_state_and_survive_a_file(tmp_path):
    robot = arm()
    starts = np.array([[-0.5, 0.3], [-0.4, 0.2]])
    runs = simulate(robot, starts, 0.0 * starts, 0.5, sample=0.01, contacts=[TABLE])
    for k, start in enumerate(starts):
        run = simulate(robot, start, [0.0, 0.0], 0.5, sample=0.01, contacts=[TABLE])
        np.testing.assert_array_equal(runs.q[k], run.q)
        np.testing.assert_array_equal(runs.contact_forces[k], run.contact_forces)
        assert tuple(runs.state(k).contact_events) == run.contact_events
    runs.save_npz(tmp_path / 'runs.npz')
    read = Trajectory.load_npz(tmp_path / 'runs.npz')
    np.testing.assert_array_equal(read.contact_forces, runs.contact_forces)
    assert tuple(read.contact_events) == runs.contact_events
    assert read.contact_names == ('tip',)


def test_friction_that_presses_a_sliding_rod_on_is_refused_with_its_reason():
    b = ModelBuilder('rod', gravity=(0, 0, -G))
    b.body('x', kind='prismatic', axis=(1, 0, 0))
    b.body('z', 'x', 'prismatic', axis=(0, 0, 1))
    b.body('rod', 'z', axis=(0, 1, 0), inertial=rod(1.0, (-0.5, 0, 0), (0.5, 0, 0)))
    b.frame('tip', 'rod', at=(0.5, 0, 0))
    robot = Robot(b.model())
    q0 = [0.0, 0.5 * np.sin(1.0), 1.0]
    contacts = [Contact('tip', PlaneSurface(), friction=2.5)]
    with pytest.raises(ConstraintError, match=r"contact 'tip': .*Painleve's paradox"):
        simulate(robot, q0, [3.0, 0.0, 0.0], 0.1, contacts=contacts)


@pytest.mark.parametrize(('contact', 'message'), [
    ({'friction': -1.0}, "contact 'tip': friction: -1; expected at least 0"),
    ({'restitution': 1.5}, "contact 'tip': restitution: 1.5; expected 0 to 1"),
    ({'frame': 'nose'}, "no frame 'nose'; expected one of"),
    ({'on': 'floor'}, "contact 'tip': on 'floor'; expected a PlaneSurface"),
    ({'on': PlaneSurface(normal=(0, 0, 0))}, 'normal or axis of length 0; expected'),
    ({'on': PlaneSurface(frame='tip')}, 'point and surface on one link; expected two'),
    ({'on': SphereSurface((9, 0, 0), 0.0)}, 'radius of the surface: 0; expected'),
    ({'on': PlaneSurface((0, 0, 9.0))}, "q0: contact 'tip' is .* inside its surface")])
def test_contacts_that_are_not_valid_are_named(contact, message):
    stated = {'frame': 'tip', 'on': PlaneSurface((0, 0, -9.0))} | contact
    with pytest.raises(InputError, match=message):
        simulate(arm(), [-0.5, 0.3], [0.0, 0.0], 0.01, contacts=[Contact(**stated)])


def test_contacts_of_a_file_are_those_that_it_states(tmp_path):
    file = tmp_path / 'contacts.yaml'
    file.write_text("""
contacts:
  tool: {frame: tip, radius: 0.01, friction: 0.3, plane: {point: [0, 0, 0.1]}}
  ball: {frame: elbow, restitution: 0.5, sphere: {center: [1, 0, 0], radius: 0.2}}
  pipe:
    frame: tip
    cylinder: {point: [0, 0, 0], axis: [1, 0, 0], radius: 0.1, frame: base}
""")
    expected = (
        Contact('left_tip', PlaneSurface([0, 0, 0.1]), 0.01, 0.3, name='tool'),
        Contact('left_elbow', SphereSurface([1, 0, 0], 0.2), restitution=0.5,
                name='ball'),
        Contact('left_tip', CylinderSurface([0, 0, 0], [1, 0, 0], 0.1, 'left_base'),
                name='pipe'))
    assert load_contacts(file, prefix='left_') == expected


@pytest.mark.parametrize(('entry', 'message'), [
    ({'frame': 'tip'}, "contact 'tip': 0 surfaces; expected one of plane, sphere"),
    ({'plane': {}}, "contact 'tip': no key 'frame'; expected its value"),
    ({'frame': 'tip', 'sphere': {'radius': 0.1}}, "'tip': sphere: no key 'center'"),
    ({'frame': 'tip', 'plane': {'radius': 0.1}}, "plane: unknown key 'radius'"),
    ({'frame': 'tip', 'mu': 0.1, 'plane': {}}, "contact 'tip': unknown key 'mu'")])
def test_a_file_of_contacts_that_is_not_valid_names_the_key(entry, message):
    with pytest.raises(InputError, match=message):
        load_contacts({'contacts': {'tip': entry}})


def test_a_self_locking_drive_holds_a_load_above_a_surface_and_lifts_it_off():
    # 1 kg, held without its motor, and lifted by more than 1.5 times its weight.
    b = ModelBuilder('slide', gravity=(0, 0, -G))
    b.body('slide', kind='prismatic', axis=(0, 0, 1), inertial=point_mass(1.0),
           load_friction=0.5, load_friction_backdriven=1.2)
    b.frame('tip', 'slide')
    robot = Robot(b.model())
    floor = [Contact('tip', PlaneSurface())]
    held = simulate(robot, [0.1], [0.0], 0.5, sticking=True, contacts=floor)
    assert held.sticking.all() and (held.q == 0.1).all()
    torque = np.repeat([0.0, 1.5 * G + 3.0], 100)[:, None]
    lifted = simulate(robot, [0.0], [0.0], 0.2, sticking=True, contacts=floor,
                      torque=torque)
    # Driven, the motor overcomes half of the load that it lifts in addition.
    expected = 0.5 * (3.0 / 1.5) * 0.1**2
    assert lifted.q[-1, 0] == pytest.approx(expected, rel=1e-9)
