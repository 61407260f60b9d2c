"""Ball and free joints: unit quaternions in q, angular velocities in u."""

from functools import cache

from kane_dynamics import (body_angular_velocity, box, Closure, ConstraintError, disc,
                           InputError, load_urdf, ModelBuilder, ModelError, Robot, rod,
                           simulate)
from kane_dynamics.mechanics.definition import kane, kinematics, nonholonomic
import numpy as np
import pytest

LEGS = tuple(f'leg{k}' for k in range(6))


def satellite(kind, gravity=(0.0, 0.0, 0.0)):
    """Return a free body with an arm of three joints."""
    b = ModelBuilder('satellite', gravity=gravity)
    b.body('base', kind=kind, inertial=box(60.0, (1.2, 1.0, 1.4), at=(0.03, 0.02, 0.03)))
    on = 'base'
    at = (0.6, 0.0, 0.0)
    for k, axis in enumerate(((0, 0, 1), (0, 1, 0), (1, 0, 0)), 1):
        b.body(f'joint{k}', on, axis=axis, at=at, inertial=box(8.0 - k, (0.4, 0.1, 0.1),
                                                               at=(0.2, 0, 0.02)))
        on = f'joint{k}'
        at = (0.4, 0.0, 0.0)
    return b.model()


@cache
def free():
    return Robot(satellite('free'))


@cache
def loaded():
    """Return a robot with two ball joints under gravity."""
    b = ModelBuilder('pendulum')
    b.body('upper', kind='ball',
           inertial=rod(1.5, (0, 0, 0), (0.1, 0, -0.5)) + disc(1.0, 0.1))
    b.body('turn', 'upper', at=(0.1, 0, -0.5), axis=(0, 1, 0),
           inertial=box(1, (0.3, 0.2, 0.1), at=(0.1, 0, 0)))
    b.body('lower', 'turn', 'ball', at=(0.2, 0, 0), rpy=(0.1, 0.2, 0.3),
           inertial=box(0.8, (0.1, 0.2, 0.3), at=(0.05, 0.02, -0.1)))
    b.joint('lower/wy', damping=0.1)
    b.frame('tool', 'lower', at=(0, 0, -0.2))
    return Robot(b.model())


def state(robot, seed=0):
    rng = np.random.default_rng(seed)
    return robot.random_configuration(rng), *rng.uniform(-1.0, 1.0, (2, robot.n))


def test_coordinates_and_speeds_have_names_of_their_own():
    robot = loaded()
    assert robot.coordinate_names == ('upper/qx', 'upper/qy', 'upper/qz', 'upper/qw',
                                      'turn',
                                      'lower/qx', 'lower/qy', 'lower/qz', 'lower/qw')
    assert robot.speed_names == robot.joint_names == (
        'upper/wx', 'upper/wy', 'upper/wz', 'turn', 'lower/wx', 'lower/wy', 'lower/wz')
    assert (robot.n, robot.n_q) == (7, 9)


def test_the_dynamics_are_those_of_three_angles_with_body_angular_velocities():
    ours = free()
    theirs = Robot(satellite('floating'), speeds=body_angular_velocity('base'))
    rng = np.random.default_rng(2)
    angles = rng.uniform(-1.0, 1.0, theirs.n_q)
    R = theirs.frame_pose('base', angles)[:3, :3]
    w = 0.5 * np.sqrt(1.0 + np.trace(R))
    v = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (4.0 * w)
    q = np.concatenate([angles[:3], v, [w], angles[6:]])
    u, udot = rng.uniform(-1.0, 1.0, (2, ours.n))
    for name, arguments in (('inverse_dynamics', (u, udot)), ('coriolis_matrix', (u,)),
                            ('body_torques', (u, udot)), ('joint_reactions', (u, udot))):
        by_quaternion, by_angles = (np.asarray(getattr(robot, name)(x, *arguments))
                                    for robot, x in ((ours, q), (theirs, angles)))
        # The bodies between have other names.
        if name in ('body_torques', 'joint_reactions'):
            by_quaternion = by_quaternion[5:]
            by_angles = by_angles[5:]
        np.testing.assert_allclose(by_quaternion, by_angles,
                                   rtol=0.0, atol=1e-11 * np.abs(by_angles).max())


def test_the_definition_and_the_kernels_agree():
    assert loaded().verify(3) < 1e-12


def test_a_quaternion_of_any_length_is_the_same_rotation():
    robot = loaded()
    q, u, udot = state(robot)
    longer = q.copy()
    longer[:4] *= -1.7
    np.testing.assert_allclose(robot.inverse_dynamics(longer, u, udot),
                               robot.inverse_dynamics(q, u, udot), rtol=0.0, atol=1e-13)
    longer[:4] = 0.0
    with pytest.raises(InputError):
        robot.inverse_dynamics(longer, u, udot)


def test_the_chain_rule_with_the_rates_of_q_gives_the_derivative_along_the_joints():
    robot = loaded()
    h = 1e-5
    q, u, udot = state(robot)
    along = robot.derivative('joint_rates', q, u, by='u')
    torques = robot.derivative('inverse_dynamics', q, u, udot, by='q') @ along
    expected = np.array([(robot.inverse_dynamics(robot.integrate(q, e, h), u, udot)
                          - robot.inverse_dynamics(robot.integrate(q, e, -h), u, udot))
                         / (2.0 * h) for e in np.eye(robot.n)]).T
    np.testing.assert_allclose(torques, expected,
                               rtol=0.0, atol=1e-8 * np.abs(expected).max())


def test_difference_is_the_inverse_of_integrate():
    robot = loaded()
    q0 = robot.random_configuration(0, 20)
    q1 = robot.random_configuration(1, 20)
    step = robot.difference(q0, q1)
    assert step.shape == (20, robot.n)
    assert np.linalg.norm(step[:, :3], axis=1).max() <= np.pi
    there = robot.integrate(q0, step)
    near = np.abs(robot.difference(there, q1)).max()
    assert near < 1e-14 * 20
    one = robot.difference(q0[3], q1[3])
    np.testing.assert_allclose(one, step[3], rtol=0.0, atol=1e-15)
    u = 0.4 * np.ones(robot.n)
    np.testing.assert_allclose(
        robot.difference(q0, robot.integrate(q0, np.tile(u, (20, 1)), 0.5)),
        np.tile(0.5 * u, (20, 1)), rtol=0.0, atol=1e-14)
    same = robot.difference(q0, q0)
    assert np.abs(same).max() < 1e-15


def test_the_difference_of_one_configuration_and_several_is_that_of_each():
    robot = loaded()
    one = state(robot)[0]
    several = robot.random_configuration(2, 3)
    for first, last in ((one, several), (several, one)):
        pairs = zip(*np.broadcast_arrays(first, last))
        np.testing.assert_array_equal(robot.difference(first, last),
                                      [robot.difference(*pair) for pair in pairs])


def test_a_configuration_by_joint_leaves_other_ball_joints_unrotated():
    model = loaded().model
    names = ('lower/qx', 'lower/qy', 'lower/qz', 'lower/qw')
    turned = dict(zip(names, (0.6, 0.0, 0.0, 0.8)), turn=0.3)
    np.testing.assert_array_equal(Robot(model, configuration=turned).configuration,
                                  [0.0, 0.0, 0.0, 1.0, 0.3, 0.6, 0.0, 0.0, 0.8])
    with pytest.raises(ConstraintError,
                       match=f'in part; expected all of {", ".join(names)}'):
        Robot(model, configuration={'lower/qw': 1.0})


def test_integrate_moves_along_the_rates_of_q():
    robot = loaded()
    h = 1e-4
    q, u, _ = state(robot)
    slope = (robot.integrate(q, u, h) - robot.integrate(q, u, -h)) / (2.0 * h)
    np.testing.assert_allclose(slope, robot.joint_rates(q, u), rtol=0.0, atol=1e-8)


def test_neutral_is_unrotated_and_random_rotations_are_uniform():
    robot = loaded()
    assert robot.neutral().tolist() == [0, 0, 0, 1, 0, 0, 0, 0, 1]
    q = robot.random_configuration(0, 4000)
    np.testing.assert_allclose(np.linalg.norm(q[:, :4], axis=1), 1.0,
                               rtol=0.0, atol=1e-15)
    # Of uniform rotations the four squares have mean 1/4, and half the angle exceeds 120
    # degrees with probability 1 - (theta - sin theta) / pi.
    np.testing.assert_allclose((q[:, :4]**2).mean(axis=0), 0.25, atol=0.015)
    theta = 2.0 * np.pi / 3.0
    angles = 2.0 * np.arccos(np.abs(q[:, 3]))
    assert abs((angles > theta).mean() - (1.0 - (theta - np.sin(theta)) / np.pi)) < 0.03


def test_simulation_is_of_fourth_order_and_keeps_the_quaternions_unit():
    robot = loaded()
    q, u, _ = state(robot)
    runs = [simulate(robot, q, u, 0.4, step=h) for h in (0.02, 0.01, 0.0025)]
    for run in runs:
        assert np.abs(np.linalg.norm(run.q[:, :4], axis=1) - 1.0).max() < 1e-15
    errors = [np.abs(run.q[-1] - runs[-1].q[-1]).max() for run in runs[:2]]
    assert 12.0 < errors[0] / errors[1] < 22.0
    assert runs[0].coordinate_names == robot.coordinate_names


def test_a_motion_through_every_angle_has_no_singularity():
    """A symmetric top spins freely about its axis: 2.5 turns with the exact angle."""
    b = ModelBuilder('top', gravity=(0, 0, 0))
    b.body('top', kind='ball', inertial=disc(2.0, 0.3, axis=(0, 1, 0)))
    robot = Robot(b.model())
    run = simulate(robot, robot.neutral(), [0.0, 5.0, 0.0], np.pi, step=np.pi / 2000)
    half = 2.5 * run.t
    np.testing.assert_allclose(run.q,
                               np.stack([0 * half, np.sin(half), 0 * half, np.cos(half)],
                                        axis=1), rtol=0.0, atol=1e-10)


def momenta(model, q, v):
    """Return momentum and angular momentum about the origin, by definition."""
    P, H = np.zeros((2, 3))
    for body, placed in zip(model.bodies, kinematics.configurations(model, q)):
        p = body.inertial.mass * (v @ placed.partial_velocity)
        P += p
        H += np.cross(placed.p_com, p) + kane.central_inertia(body, placed) @ (
            v @ placed.partial_angular_velocity)
    return np.concatenate([P, H])


def test_a_free_flying_arm_keeps_momentum_and_angular_momentum_to_1e_12_over_60_s():
    robot = free()
    q = robot.neutral()
    q[7:] = 0.3, -0.5, 0.8
    u = np.array([0.01, -0.02, 0.005, 0.02, -0.03, 0.01, 0.05, 0.08, -0.06])
    run = simulate(robot, q, u, 60.0, step=0.002, sample=3.0)
    momenta_of_rows = np.array([momenta(robot.model, *x) for x in zip(run.q, run.u)])
    for part in (momenta_of_rows[:, :3], momenta_of_rows[:, 3:]):
        assert np.abs(part - part[0]).max() < 1e-12 * np.linalg.norm(part[0])
    assert np.abs(run.u[-1] - u).max() > 0.01  # it moved


def stewart():
    """Return a Stewart platform, six legs with ball and universal joints, a guess."""
    b = ModelBuilder('stewart')
    b.body('platform', kind='free', inertial=disc(20.0, 0.4, thickness=0.05))
    closures = []
    for k, leg in enumerate(LEGS):
        side = np.pi / 3.0 * (k // 2 * 2)
        odd = 1.0 if k % 2 else -1.0
        top, foot = (r * np.array([np.cos(side + odd * a), np.sin(side + odd * a), 0.0])
                     for r, a in ((0.4, 0.25), (0.7, 0.8)))
        b.frame(f'foot{k}', 'world', at=foot)
        b.body(f'rod{k}', 'platform', 'ball',
               at=top, inertial=rod(1.0, (0, 0, 0), (0, 0, -0.4)))
        b.body(leg, f'rod{k}', 'prismatic', axis=(0, 0, -1),
               inertial=rod(2, (0, 0, 0), (0, 0, 0.4)))
        closures.append(Closure(leg, f'foot{k}', 'universal', axis=(1, 0, 0),
                                second_axis=(0, 1, 0), name=f'close{k}'))
    model = b.model()
    # A guess: the platform 0.8 m up, legs of this length, no rotation.
    q = np.zeros(len(model.coordinate_names))
    for k, name in enumerate(model.coordinate_names):
        if name == 'platform/z' or name.startswith('leg'):
            q[k] = 0.8
        elif name.endswith('/qw'):
            q[k] = 1.0
    closed = Robot(model, constraints=closures).closed_configuration(q)
    return Robot(model, constraints=closures, independent=LEGS, actuated=LEGS,
                 configuration=closed), closed


def test_a_stewart_platform_with_ball_joints_closes():
    robot, start = stewart()
    assert (robot.n, robot.model.n, robot.n_q) == (6, 30, 37)
    rng = np.random.default_rng(0)
    for _ in range(5):
        shaken = start + 0.1 * rng.uniform(-1.0, 1.0, len(start))
        q = robot.closed_configuration(shaken)
        assert np.abs(robot.constraint_residual(q)).max() < 1e-11
        assert np.abs(np.linalg.norm(q[3:7]) - 1.0) < 1e-15
    longer = start.copy()
    longer[legs := [robot.coordinate_names.index(leg) for leg in LEGS]] = 0.86
    moved = robot.closed_configuration(longer, fixed=LEGS)
    np.testing.assert_array_equal(moved[legs], 0.86)
    assert np.abs(robot.constraint_residual(moved)).max() < 1e-11


@pytest.mark.slow
def test_a_stewart_platform_moves_with_closed_loops():
    # 30 joints and 24 rows: compiling takes half a minute, once.
    robot, start = stewart()
    q = robot.closed_configuration(start)
    at_rest = np.zeros(6)
    rng = np.random.default_rng(0)
    u, udot = rng.uniform(-0.3, 0.3, (2, 6))
    tau = robot.inverse_dynamics(q, u, udot)
    expected = nonholonomic.inverse_dynamics(robot.mechanism, q, u, udot)
    np.testing.assert_allclose(tau, expected,
                               rtol=0.0, atol=1e-9 * np.abs(expected).max())
    tau = robot.inverse_dynamics(q, at_rest, at_rest)
    run = simulate(robot, q, at_rest, 0.2, step=1e-3, torque=1.05 * tau)
    assert run.drift < 1e-10
    assert np.abs(run.u[-1]).max() > 0.01
    assert not run.warnings


def test_an_initial_quaternion_that_is_not_unit_is_refused_by_name():
    robot = loaded()
    q, u, _ = state(robot)
    q[5:] *= 1.0 + 1e-5
    with pytest.raises(InputError,
                       match=r"quaternion of 'lower' has the length 1\.00001"):
        simulate(robot, q, u, 0.1)
    q[5:] /= 1.0 + 9.9e-6
    assert np.isfinite(simulate(robot, q, u, 0.001).q).all()


def test_a_part_of_a_ball_joint_has_no_angle():
    b = ModelBuilder()
    b.body('wrist', kind='ball', inertial=disc(1.0, 0.1))
    for wrong in ({'stiffness': 3.0}, {'armature': 0.1}):
        with pytest.raises(ModelError, match='no angle'):
            b.joint('wrist/wx', **wrong)
    with pytest.raises(ModelError, match='mimic'):
        b.body('other', mimic='wrist/wx', inertial=disc(1.0, 0.1))


def test_constraints_and_fixed_coordinates_cannot_name_a_part_of_a_ball_joint():
    from kane_dynamics import ConstraintError, Prescribed
    with pytest.raises(ConstraintError, match="no coordinate 'upper/wx'"):
        Robot(loaded().model, constraints=[Prescribed('upper/wx', lambda t: 0.1 * t)])


def test_a_trajectory_is_saved_with_the_names_of_its_coordinates(tmp_path):
    robot = loaded()
    q, u, _ = state(robot)
    run = simulate(robot, q, u, 0.01)
    run.save_csv(tmp_path / 'run.csv')
    header = (tmp_path / 'run.csv').read_text(encoding='utf-8').splitlines()[0].split(
        ',')
    assert header[1:10] == [f'q.{name}' for name in robot.coordinate_names]
    assert header[10] == 'u.upper/wx'
    run.save_npz(tmp_path / 'run.npz')
    assert type(run).load_npz(
        tmp_path / 'run.npz').coordinate_names == robot.coordinate_names


URDF = """<robot name="free"><link name="world"/>
<link name="body"><inertial><origin xyz="0.1 0.05 0"/><mass value="2"/>
<inertia ixx="0.3" iyy="0.4" izz="0.5" ixy="0.01" ixz="0" iyz="0.02"/></inertial></link>
<joint name="root" type="floating"><origin xyz="0.1 0.2 0.3" rpy="0.1 0.2 0.3"/>
<parent link="world"/><child link="body"/></joint></robot>"""


def test_a_floating_joint_of_a_urdf_is_three_angles_or_a_quaternion():
    angles = load_urdf(URDF)
    quaternion = load_urdf(URDF, floating='quaternion')
    assert angles.coordinate_names[3:] == ('root/rx', 'root/ry', 'root/rz')
    assert quaternion.coordinate_names[3:] == ('root/qx', 'root/qy', 'root/qz',
                                               'root/qw')
    # The second load is from the cache.
    assert load_urdf(URDF, floating='quaternion').balls == quaternion.balls
    robot = Robot(quaternion)
    assert robot.verify(2) < 1e-12
    np.testing.assert_allclose(robot.frame_pose('body', robot.neutral()),
                               Robot(angles).frame_pose('body', np.zeros(6)), atol=1e-15)
    with pytest.raises(InputError, match='floating'):
        load_urdf(URDF, floating='euler')
    with pytest.raises(InputError, match='move together'):
        load_urdf(URDF, floating='quaternion', joints=['root/x', 'root/wx'])
