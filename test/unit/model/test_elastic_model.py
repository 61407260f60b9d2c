"""Elastic joints of a model: drives, their sides of the gear, names, and errors."""

from dataclasses import replace
import pickle

from kane_dynamics import (Drive, Inertial, InputError, inverse_kinematics, Joint,
                           Limits, load_urdf, Model, ModelBuilder, ModelError, Robot,
                           rod, StiffnessCurve, UrdfError, with_drives, with_locked,
                           with_model, with_names, with_rigid_joints)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.mechanics.elastic_joints import (spring_deflection, spring_energy,
                                                    spring_slope, spring_torque)
from kane_dynamics.mechanics.friction import friction_torque
from kane_dynamics.model.model import Body
from mechanisms import with_joints
import numpy as np
from numpy.testing import assert_allclose
import pytest
from urdf_writer import chain, load

CURVE = StiffnessCurve([1e-3, 4e-3, 1e-2], [4.0, 30.0, 120.0])
LAW = {'damping': 0.4, 'fast_damping': 0.1, 'damping_speed': 0.5, 'friction': 1.5,
       'friction_backward': 1.2,
       'breakaway_friction': 2.0, 'stribeck_speed': 0.3, 'friction_speed': 0.02,
       'friction_offset': 0.2}


def arm(**drives):
    """Return the builder of an arm of two links, with drives."""
    b = ModelBuilder('arm')
    limits = Limits(-2.0, 2.0, 3.0, 90.0)
    b.body('upper', 'world', joint='a', axis=(0, 1, 0),
           inertial=rod(3, (0, 0, 0), (0, 0, 1)), limits=limits, armature=0.2,
           **({'drive': drives['a']} if 'a' in drives else {}))
    b.body('lower', 'upper', joint='b', axis=(0, 1, 0), at=(0, 0, 1),
           inertial=rod(2, (0, 0, 0), (0, 0.1, 0.8)), friction=0.3,
           **({'drive': drives['b']} if 'b' in drives else {}))
    return b


def random_states(model):
    """Return three states whose deflections are small."""
    states = np.random.default_rng(3).normal(size=(3, 3, model.n))
    for _, _, link, motor in model.drives:
        states[:, 0, motor] = states[:, 0, link] + 5e-3 * states[:, 0, motor]
    return states


def assert_same(model, other):
    """Check that two models have the same names and dynamics."""
    assert model.coordinate_names == other.coordinate_names
    for q, u, udot in random_states(model):
        expected = kane.inverse_dynamics(other, q, u, udot)
        assert_allclose(kane.inverse_dynamics(model, q, u, udot), expected,
                        rtol=1e-12, atol=1e-12 * np.abs(expected).max())


def test_motors_follow_the_links_in_q_and_are_named_after_their_joints():
    model = arm(a=Drive(1e4), b=Drive(5e3, rotor_inertia=0.1)).model()
    assert model.joint_names == ('a', 'b', 'a_motor', 'b_motor')
    assert [(e.name, e.link, e.motor) for e in model.drives] == [
        ('a', 0, 2), ('b', 1, 3)]
    # The armature becomes the rotor's inertia; the limits of speed and effort are
    # shared.
    joints = {body.joint.name: body.joint for body in model.bodies}
    assert (joints['a'].armature, joints['a_motor'].armature) == (0.0, 0.2)
    assert joints['a_motor'].limits == Limits(velocity=3.0, effort=90.0)
    assert model.drives[0].drive.rotor_inertia == 0.2


def test_the_equations_are_spongs():
    model = arm(a=Drive(1e4, damping=3.0, friction={'damping': 0.7})).model()
    rigid = replace_armature(arm().model())
    for q, u, udot in random_states(model):
        delta = q[2] - q[0]
        rate = u[2] - u[0]
        gear = 1e4 * delta + 3.0 * rate
        links = kane.inverse_dynamics(rigid, q[:2], u[:2], udot[:2]) - [gear, 0.0]
        motor = 0.2 * udot[2] + gear + 0.7 * u[2]
        assert_allclose(kane.inverse_dynamics(model, q, u, udot), [*links, motor],
                        rtol=1e-12)


def replace_armature(model):
    """Return a model without armature."""
    bodies = [replace(body, joint=replace(body.joint, armature=0.0))
              for body in model.bodies]
    return replace(model, bodies=tuple(bodies))


@pytest.mark.parametrize('ratio', [120.0, -80.0])
@pytest.mark.parametrize('full_coupling', [False, True])
@pytest.mark.parametrize('stiffness', [2.0, StiffnessCurve([0.1, 0.5], [0.02, 0.4])])
def test_motor_side_and_joint_side_supplements_mean_one_arm(
        ratio, full_coupling, stiffness):
    r = abs(ratio)
    curve = isinstance(stiffness, StiffnessCurve)
    motor = {'side': 'motor', 'ratio': ratio, 'damping': 1e-3, 'rotor_inertia': 1e-6,
             'friction': LAW, 'full_coupling': full_coupling,
             'stiffness': {'deflection': [0.1, 0.5], 'torque': [0.02, 0.4]} if curve
             else stiffness}
    forward, backward = (1.5, 1.2) if ratio > 0.0 else (1.2, 1.5)
    joint = {'side': 'joint', 'ratio': ratio, 'damping': 1e-3 * r**2,
             'rotor_inertia': 1e-6 * r**2, 'full_coupling': full_coupling,
             'friction': {'damping': 0.4 * r**2, 'fast_damping': 0.1 * r**2,
                          'damping_speed': 0.5 / r,
                          'friction': forward * r, 'friction_backward': backward * r,
                          'breakaway_friction': (forward + 0.5) * r,
                          'stribeck_speed': 0.3 / r, 'friction_speed': 0.02 / r,
                          'friction_offset': 0.2 * ratio},
             'stiffness': {'deflection': [0.1 / r, 0.5 / r],
                           'torque': [0.02 * r, 0.4 * r]} if curve else stiffness * r**2}
    urdf = chain(2)
    by_motor = load(urdf, supplement={'drives': {'j1': motor}})
    by_joint = load(urdf, supplement={'drives': {'j1': joint}})
    assert by_motor.n == 3
    assert_same(by_motor, by_joint)


def test_the_builder_and_with_drives_make_one_model():
    drives = {'a': Drive(1e4, friction=LAW), 'b': Drive(CURVE, rotor_inertia=0.1)}
    assert arm(**drives).model().digest() == with_drives(arm().model(), drives).digest()
    again = ModelBuilder.from_model(arm(**drives).model())
    again.body('tool', 'lower', axis=(1, 0, 0),
               inertial=Inertial(1.0, (0, 0.1, 0), np.eye(3)))
    assert again.model().joint_names == ('a', 'b', 'a_motor', 'b_motor', 'tool')
    assert [e.motor for e in again.model().drives] == [2, 3]


def test_full_coupling_adds_the_carriers_rotation_to_the_rotors():
    """Kinetic energy 1/2 J (s . omega + r theta')^2 in place of the rotor at rest."""
    reduced = arm(b=Drive(1e4, ratio=50.0, rotor_inertia=0.5)).model()
    full = arm(b=Drive(1e4, ratio=50.0, rotor_inertia=0.5, full_coupling=True)).model()
    J = 0.5 / 50.0**2
    q = np.array([0.3, -0.7, -0.69])
    M = kane.mass_matrix(reduced, q)
    M_full = kane.mass_matrix(full, q)
    expected = np.zeros((3, 3))
    expected[0, 2] = expected[2, 0] = J * 50.0  # a and the rotor of b turn about y
    assert_allclose(M_full - M, expected, atol=1e-12)


@pytest.mark.parametrize('law',
                         [{'friction': 1.5}, {'friction': 1.5, 'friction_speed': 0.2}])
def test_friction_of_the_motor_does_not_depend_on_the_coupling(law):
    drive = Drive(1e4, ratio=-50.0, rotor_inertia=0.5, friction=law)
    forces = []
    for full_coupling in (False, True):
        model = arm(b=replace(drive, full_coupling=full_coupling)).model()
        forces.append(Robot(model).friction_force([0.0, 0.0, 0.03]))
    assert_allclose(forces[0], forces[1], rtol=1e-12)
    assert_allclose(forces[0][2], 1.5 * np.tanh(0.03 / law.get('friction_speed', 0.05)),
                    rtol=1e-12)


def test_rigid_joints_move_motors_with_their_links():
    drives = {'a': Drive(1e4, friction={'damping': 0.4, 'friction': 1.0}),
              'b': Drive(CURVE, ratio=30.0, rotor_inertia=0.1, full_coupling=True)}
    elastic = arm(**drives).model()
    rigid = with_rigid_joints(elastic)
    assert rigid.joint_names == ('a', 'b') and not rigid.drives
    T = np.vstack([np.eye(2), np.eye(2)])
    for q, u, udot in random_states(rigid):
        expected = T.T @ kane.inverse_dynamics(elastic, T @ q, T @ u, T @ udot)
        assert_allclose(kane.inverse_dynamics(rigid, q, u, udot), expected, rtol=1e-12)


def test_rigid_joints_have_the_limits_of_the_motors():
    limits = {'motor_effort': 40.0, 'motor_velocity': 5.0}
    rigid = with_rigid_joints(arm(a=Drive(1e4, **limits)).model())
    # The joint itself is limited to 90 N m and 3 rad/s.
    assert rigid.bodies[0].joint.limits == Limits(-2.0, 2.0, 3.0, 40.0)
    slow = with_rigid_joints(arm(a=Drive(1e4, motor_velocity=1.0)).model())
    assert slow.bodies[0].joint.limits == Limits(-2.0, 2.0, 1.0, 90.0)


def test_locked_motors_and_links_leave_the_spring_at_the_other_side():
    model = arm(a=Drive(1e4, damping=2.0, friction=LAW),
                b=Drive(5e3, ratio=-40.0, damping=1.0, rotor_inertia=0.1, friction=LAW,
                        full_coupling=True)).model()
    for held in ({'a_motor': 0.1, 'b_motor': -0.2}, {'a': 0.1}, {'b': 0.4}):
        locked = with_locked(model, held)
        places = [model.joint_names.index(name) for name in held]
        free = [k for k in range(model.n) if k not in places]
        for state in random_states(model):
            state[:, places] = 0.0
            state[0, places] = list(held.values())
            expected = kane.inverse_dynamics(model, *state)[free]
            assert_allclose(kane.inverse_dynamics(locked, *state[:, free]), expected,
                            rtol=1e-11)
    with pytest.raises(InputError, match='stiffness curve'):
        with_locked(arm(a=Drive(CURVE)).model(), {'a_motor': 0.0})
    assert not with_locked(arm(a=Drive(CURVE)).model(), {'a_motor': 0.0,
                                                         'a': 0.1}).drives


def test_drives_survive_new_names_mounting_and_pickling():
    model = arm(a=Drive(1e4)).model()
    named = with_names(model, {'a': 'shoulder', 'a_motor': 'shoulder_drive'})
    assert named.drives[0].drive.motor == 'shoulder_drive'
    pair = with_model(model, model, 'lower', prefix='second_')
    assert [(e.name, e.link, e.motor) for e in pair.drives] == [
        ('a', 0, 2), ('second_a', 3, 5)]
    assert pickle.loads(pickle.dumps(model)).digest() == model.digest()


@pytest.mark.parametrize('curve', [CURVE, StiffnessCurve([2e-3, 5e-3], [0.0, 60.0]),
                                   StiffnessCurve([1.0, 2.0], [3.0, 4.0])])
def test_a_curve_is_odd_passes_its_points_and_agrees_with_its_energy(curve):
    drive = Drive(curve)
    h = 1e-5 * curve.rounding
    for x in np.linspace(-1.5, 1.5, 41) * curve.deflection[-1]:
        torque = spring_torque(drive, x)
        assert spring_torque(drive, -x) == pytest.approx(-torque, abs=1e-12)
        middle, ahead, behind = (spring_energy(drive, x + d) for d in (0.0, h, -h))
        scale = curve.torque[-1]
        assert (ahead - behind) / (2 * h) == pytest.approx(torque, abs=1e-6 * scale)
        slope = (spring_torque(drive, x + h) - spring_torque(drive, x - h)) / (2 * h)
        assert spring_slope(drive, x) == pytest.approx(slope, rel=1e-6, abs=1e-6)
        assert middle >= 0.0
        if not curve.dead_zone:
            assert spring_deflection(drive, torque) == pytest.approx(
                x, rel=1e-12, abs=1e-16)
    # At a point the curve is off by 35/256 of the rounding times the change of slope.
    bound = 35.0 / 256.0 * curve.rounding * np.abs(np.diff(curve.slopes)).sum()
    for corner, level in zip(curve.deflection, curve.torque):
        assert abs(spring_torque(drive, corner) - level) <= 1.01 * bound
    assert drive.stiffness_at_rest == pytest.approx(spring_slope(drive, 0.0))


def test_a_curve_is_straight_away_from_its_corners():
    backlash = Drive(StiffnessCurve([1e-3, 4e-3], [0.0, 40.0]))
    assert spring_torque(backlash, 0.7e-3) == 0.0
    assert spring_slope(backlash, 0.7e-3) == spring_energy(backlash, -0.7e-3) == 0.0
    assert backlash.stiffness_at_rest == 0.0
    points = np.array([0.5, 2.0, 3.5, 6.0, 7.0, 12.0]) * 1e-3
    stated = np.interp(points, [0.0, *CURVE.deflection, 2e-2],
                       [0.0, *CURVE.torque, 270.0])
    bent = [spring_torque(Drive(CURVE), x) for x in points]
    np.testing.assert_allclose(bent, stated, rtol=1e-12)


@pytest.mark.parametrize('ratio', [1e-5, 1e-2, 1e2, 1e5])
def test_a_curve_of_very_different_slopes_is_inverted_in_its_corners(ratio):
    drive = Drive(StiffnessCurve([1e-3, 2e-3], [1.0, 1.0 + ratio]))
    for x in np.linspace(0.5e-3, 1.5e-3, 101):
        assert spring_deflection(drive, spring_torque(drive, x)) == pytest.approx(
            x, abs=1e-12)


def test_a_curve_whose_slopes_differ_too_much_is_not_inverted():
    drive = Drive(StiffnessCurve([1e-3, 2e-3], [1.0, 1.0 + 2e5]))
    with pytest.raises(InputError, match=r'slopes from 1000 to 2e[+]08'):
        spring_deflection(drive, 1.0)


def test_configurations_that_are_searched_do_not_deflect_the_springs():
    model = load_urdf(resource_path('urdf', 'fr3.urdf'), tip='fr3_link7')
    drives = dict.fromkeys(model.joint_names, Drive(1e4, rotor_inertia=0.5))
    robot = Robot(with_drives(model, drives))
    n = model.n
    start = robot.feasible_configuration()
    assert start[3] < -1.0, 'an elbow whose limits do not admit zero'
    goal = Robot(model).random_configuration(3)
    solution = inverse_kinematics(robot, 'fr3_link7',
                                  robot.frame_pose('fr3_link7', [*goal] * 2))
    assert solution.converged
    for q in (start, solution.q, *robot.random_configuration(1, 5)):
        np.testing.assert_array_equal(q[:n], q[n:])


@pytest.mark.parametrize('link_side', [{}, {'friction': 0.8, 'damping': 0.3}])
def test_load_friction_of_a_drive_stays_where_the_joint_becomes_rigid(link_side):
    law = {'friction': 1.5, 'damping': 0.2, 'load_friction': 0.2,
           'load_friction_backdriven': 0.3}
    model = with_joints(arm().model(), **link_side)
    stiff = Robot(with_drives(model, {'a': Drive(1e9, rotor_inertia=0.4, friction=law)}))
    rigid = Robot(with_rigid_joints(stiff.model))
    q, u, udot = np.random.default_rng(2).normal(size=(3, rigid.n))
    tau = rigid.inverse_dynamics(q, u, udot)
    np.testing.assert_allclose(rigid.forward_dynamics(q, u, tau), udot, atol=1e-10)

    # The motor of a stiff gear has the link's motion, and its spring the link's torque.
    link = rigid.joint_names.index('a')
    plain = Robot(with_rigid_joints(stiff.model), friction=False)
    load = plain.inverse_dynamics(q, u, udot)[link]
    motor_side, link_side = [Joint('joint', 'revolute', (0, 0, 1), **side)
                             for side in (law, link_side)]
    expected = (load + friction_torque(motor_side, u[link], load)
                + friction_torque(link_side, u[link]))
    assert tau[link] == pytest.approx(expected, rel=1e-12)
    if not link_side.friction:
        gear = plain.inverse_dynamics(q, u, udot)[link] - 0.4 * udot[link]
        place = stiff.joint_names.index('a_motor')
        full = [np.append(x, x[link]) for x in (q, u, udot)]
        full[0][place] += gear / 1e9
        motor = stiff.inverse_dynamics(*full)
        assert motor[place] == pytest.approx(tau[link], rel=1e-6)


def test_a_dead_zone_has_no_inverse():
    with pytest.raises(InputError, match='a dead zone'):
        spring_deflection(Drive(StiffnessCurve([2e-3, 5e-3], [0.0, 60.0])), 1.0)


def with_load_friction(model):
    """Return a model with load friction in all joints."""
    return with_joints(model, load_friction=0.1)


@pytest.mark.parametrize('make, message', [
    (lambda: Drive(0.0), 'stiffness 0.0; expected a positive number'),
    (lambda: Drive(float('nan')), 'stiffness: nan'),
    (lambda: Drive('soft'), "stiffness: 'soft'"),
    (lambda: Drive(1.0, damping=-1.0), 'damping -1.0'),
    (lambda: Drive(1.0, ratio=0.0), 'ratio 0'),
    (lambda: Drive.from_motor_side(ratio=0.0, stiffness=1.0), 'ratio 0'),
    (lambda: Drive(1.0, rotor_inertia=0.0), 'rotor_inertia 0.0'),
    (lambda: Drive(1.0, friction={'viscous': 1.0}), "no parameter 'viscous'"),
    (lambda: Drive(1.0, friction=2.0), 'friction: 2.0; expected a mapping'),
    (lambda: Drive(1.0, torque_sensor='yes'), "torque_sensor 'yes'"),
    (lambda: StiffnessCurve([1.0], [1.0]), 'at least 2'),
    (lambda: StiffnessCurve([1.0, 1.0], [1.0, 2.0]), 'expected positive, increasing'),
    (lambda: StiffnessCurve([1.0, 2.0], [1.0, 1.0]), 'expected increasing numbers'),
    (lambda: StiffnessCurve([1.0, 2.0], [-1.0, 1.0]), 'expected increasing numbers'),
    (lambda: StiffnessCurve([1.0, 2.0], [1.0, 3.0], 0.0), 'rounding 0.0'),
    (lambda: with_drives(arm().model(), [Drive(1.0)]),
     'expected a mapping of joint names'),
    (lambda: with_drives(arm().model(), {'c': Drive(1.0)}),
     "'c' is no joint of one degree"),
    (lambda: with_drives(arm().model(), {'a': 1e4}), 'expected a Drive'),
    (lambda: with_drives(arm().model(), {'b': Drive(1.0)}), 'without rotor_inertia'),
    (lambda: with_drives(arm(a=Drive(1.0)).model(), {'a': Drive(1.0)}),
     "'a' has a drive"),
    (lambda: with_drives(arm(a=Drive(1.0)).model(), {'a_motor': Drive(1.0)}),
     "'a_motor' is no joint"),
    (lambda: with_drives(arm().model(), {'b': Drive(1.0, ratio=1.0, rotor_inertia=5.0,
                                                    full_coupling=True)}),
     "in link 'upper'"),
    (lambda: with_drives(arm().model(), {'b': Drive(
        1.0, ratio=100.0, rotor_inertia=0.1, full_coupling=True,
        friction={'load_friction': 0.1})}),
     'full_coupling with load friction of the motor'),
    (lambda: with_drives(with_load_friction(arm().model()), {'b': Drive(
        1.0, rotor_inertia=0.1)}),
     "'b': load friction of the link's side; expected it in"),
    (lambda: arm(a=Drive(1.0, friction={'damping': -1.0})).model(), 'damping -1.0'),
    (lambda: arm(a=7.0).model(), 'expected a Drive'),
    (lambda: Model('m',
                   (Body('l', -1, Joint('j', 'revolute', (0, 0, 1), drive=Drive(1.0)),
                         Inertial(1.0, inertia=np.eye(3))),), ('j',)),
     "motor joint '', which the model lacks"),
])
def test_bad_drives_are_named(make, message):
    with pytest.raises(ModelError, match=message):
        make()


def test_a_joint_that_mimics_has_no_drive():
    b = arm()
    b.body('finger', 'lower', 'prismatic', axis=(1, 0, 0), mimic='b', multiplier=0.1,
           inertial=Inertial(0.1))
    with pytest.raises(ModelError, match="'finger' is no joint of one degree"):
        with_drives(b.model(), {'finger': Drive(1.0, rotor_inertia=1.0)})


@pytest.mark.parametrize('drive, message', [
    ({}, "no 'stiffness'"),
    ({'stiffness': -1}, 'stiffness: -1; expected a positive number'),
    ({'stiffness': 1, 'side': 'gear'}, "side 'gear'; expected joint or motor"),
    ({'stiffness': 1, 'side': 'motor'}, "side motor without 'ratio'"),
    ({'stiffness': 1, 'ratio': 0, 'rotor_inertia': 1}, 'ratio 0'),
    ({'stiffness': 1, 'inertia': 1}, 'inertia'),
    ({'stiffness': {'deflection': [1, 2]}}, "no 'torque'"),
    ({'stiffness': {'deflection': [1, 2], 'torque': [2, 1]}}, 'expected increasing'),
    ({'stiffness': 1, 'friction': {'viscous': 1}}, 'viscous'),
    ({'stiffness': 1, 'torque_sensor': 'yes'}, "torque_sensor 'yes'"),
])
def test_bad_drives_of_a_supplement_are_named(drive, message):
    with pytest.raises(UrdfError, match=message):
        load(chain(2), supplement={'drives': {'j1': drive}})


def test_a_supplement_names_a_joint_that_can_move():
    with pytest.raises(UrdfError, match="drives: 'nowhere' is no joint that can move"):
        load(chain(2), supplement={'drives': {'nowhere': {'stiffness': 1}}})
