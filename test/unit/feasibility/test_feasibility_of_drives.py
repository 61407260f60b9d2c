"""Limits of drives of elastic joints: motors, gears along motions of links."""

from dataclasses import replace
from functools import cache
import math

from kane_dynamics import (Drive, Inertial, InputError, Limits, load_urdf, ModelBuilder,
                           ModelError, Motion, Robot, rod, SmoothMotion, StiffnessCurve,
                           UrdfError, with_drives)
from kane_dynamics.feasibility import demand, fastest, largest_payload
from kane_dynamics.feasibility.torque_demand import DrivesAlong
from kane_dynamics.model.model import with_payload
import numpy as np
from numpy.testing import assert_allclose
import pytest

JOINTS = ('shoulder', 'elbow', 'wrist')
URDF = """<robot name="a"><link name="base"/><link name="l"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="l"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="200" velocity="6"/></joint></robot>"""


def arm(damping=0.0, curve=False, **limits):
    """Return an arm with two elastic joints and a rigid one, in a vertical plane."""
    builder = ModelBuilder('arm')
    parent = 'world'
    at = (0.0, 0.0, 0.0)
    for name, mass in zip(JOINTS, (4.0, 2.0, 0.5), strict=True):
        builder.body(name + '_link', parent, joint=name, axis=(0, -1, 0), at=at,
                     damping=0.5, inertial=rod(mass, (0, 0, 0), (0.4, 0, 0)))
        parent = name + '_link'
        at = (0.4, 0.0, 0.0)
    stiffness = StiffnessCurve([0.01, 0.1], [8.0, 120.0]) if curve else 900.0
    return with_drives(builder.model(), {
        'shoulder': Drive(stiffness, damping=damping, rotor_inertia=0.8,
                          friction={'damping': 2.0, 'friction': 1.0,
                                    'friction_speed': 0.5}, **limits),
        'elbow': Drive(500.0, rotor_inertia=0.3)})


@cache
def robot_of(**options):
    return Robot(arm(**options))


def move():
    return SmoothMotion.from_points([0.0, 0.4, 0.9],
                                    [[0, 0, 0], [0.5, 0.2, 0.3], [0.9, -0.3, 0.1]],
                                    joint_names=JOINTS)


@pytest.mark.parametrize('curve', [False, True])
def test_the_demand_satisfies_the_equations_of_links_and_motors(curve):
    robot = robot_of(curve=curve)
    needed = demand(robot, move(), speed=1.3)
    motors = [elastic.motor for elastic in robot.drives]
    links = [elastic.link for elastic in robot.drives]
    tau = robot.inverse_dynamics(needed.q, needed.u, needed.udot)
    size = np.abs(needed.tau).max()
    assert_allclose(tau[:, motors], needed.tau[:, motors], rtol=0, atol=1e-11 * size)
    # Nothing acts beside the gears.
    assert_allclose(tau[:, links], 0.0, atol=1e-11 * size)
    rigid = robot.joint_names.index('wrist')
    assert_allclose(tau[:, rigid], needed.tau[:, rigid], rtol=0, atol=1e-11 * size)
    # The torque of a gear is that of its spring.
    elbow = robot.drives[1]
    spring = 500.0 * (needed.q[:, elbow.motor] - needed.q[:, elbow.link])
    assert_allclose(needed.tau[:, elbow.link], spring, rtol=0, atol=1e-10 * size)


def test_the_motion_of_a_damped_drive_satisfies_the_equations():
    robot = robot_of(damping=6.0)
    needed = demand(robot, move(), step=5e-4)
    tau = robot.inverse_dynamics(needed.q, needed.u, needed.udot)
    shoulder = robot.drives[0]
    size = np.abs(needed.tau).max()
    assert_allclose(tau[:, shoulder.motor], needed.tau[:, shoulder.motor],
                    atol=1e-8 * size)
    assert_allclose(tau[:, shoulder.link], 0.0, atol=1e-8 * size)


LIMITS = ({'motor_effort': 60.0}, {'motor_velocity': 2.0}, {'gear_effort': 55.0})


@pytest.mark.parametrize(('limits', 'damping'), [
    (LIMITS[0], 6.0),
    *[pytest.param(limits, damping, marks=pytest.mark.slow)
      for limits, damping in zip(LIMITS + LIMITS[1:], (0.0, 0.0, 0.0, 6.0, 6.0))]])
def test_the_fastest_speed_reaches_a_limit_of_the_drive(limits, damping):
    robot = Robot(arm(damping=damping, **limits))
    step = 4e-3
    scale = fastest(robot, move(), step=step)
    name = next(iter(limits))
    expected = {'motor_effort': ('shoulder_motor', 'effort'),
                'motor_velocity': ('shoulder_motor', 'velocity'),
                'gear_effort': ('shoulder', 'gear')}[name]
    assert (scale.joint, scale.limit) == expected
    at_limit = demand(robot, move(), speed=scale.speed, step=step)
    assert at_limit.fits
    assert max(uses.max() for uses in at_limit.uses.values()) == pytest.approx(
        1.0, rel=1e-8)
    # The limit itself, on samples that the library did not choose.
    dense = demand(robot, move(), speed=scale.speed, step=3.3e-4)
    drive = robot.drives[0]
    value = {'motor_effort': dense.tau[:, drive.motor],
             'motor_velocity': dense.u[:, drive.motor],
             'gear_effort': dense.tau[:, drive.link]}[name]
    assert np.abs(value).max() == pytest.approx(limits[name], rel=1e-5)
    # No faster speed is feasible.
    for factor in np.geomspace(1.0005, 20.0, 12):
        assert not demand(robot, move(), speed=factor * scale.speed, step=step).fits


def test_no_limit_bounds_no_speed_and_a_limit_that_gravity_exceeds_all():
    assert fastest(robot_of(), move()).speed == math.inf
    assert fastest(robot_of(gear_effort=5.0), move(), step=0.05) is None
    assert fastest(robot_of(), move(), most=1.5).speed == 1.5


@pytest.mark.parametrize('limits', [
    {'gear_effort': 5.0}, {'motor_effort': 5.0}, {'motor_effort': 60.0},
    {'gear_effort': 25.5}, {'motor_velocity': 2.0}, {'motor_velocity': 1e-4}])
def test_the_fastest_speed_is_found_by_few_demands(limits, monkeypatch):
    # With steps of a hundredth they were 1,450.
    count = 0
    of_states = DrivesAlong.demand_at

    def counted(self, *args, **options):
        nonlocal count
        count += 1
        return of_states(self, *args, **options)
    monkeypatch.setattr(DrivesAlong, 'demand_at', counted)
    fastest(robot_of(**limits), move(), step=0.05)
    assert count < 150


def test_limits_of_the_joint_are_those_of_its_motor_unless_the_drive_states_others():
    for drive, expected in ((Drive(9e3, rotor_inertia=0.5), (200.0, 6.0)),
                            (Drive(9e3, rotor_inertia=0.5, motor_effort=70.0,
                                   motor_velocity=math.inf), (70.0, math.inf))):
        robot = Robot(with_drives(load_urdf(URDF), {'j': drive}))
        assert (robot.limits.effort[1], robot.limits.velocity[1]) == expected
        assert robot.limits.effort[0] == 200.0


def test_limits_of_both_sides_mean_the_same_arm():
    joint = {'stiffness': 9e3, 'ratio': -100, 'rotor_inertia': 0.8, 'motor_effort': 80.0,
             'motor_velocity': 3.0, 'gear_effort': 120.0}
    motor = {'side': 'motor', 'stiffness': 0.9, 'ratio': -100, 'rotor_inertia': 8e-5,
             'motor_effort': 0.8, 'motor_velocity': 300.0, 'gear_effort': 1.2}
    sides = []
    for entry in (joint, motor):
        robot = Robot(load_urdf(URDF, supplement={'drives': {'j': entry}}))
        sides.append([robot.limits.effort[1], robot.limits.velocity[1],
                      robot.drives[0].drive.gear_effort])
    assert_allclose(sides[0], [80.0, 3.0, 120.0])
    assert_allclose(sides[1], sides[0], rtol=1e-14)


def test_an_excess_names_the_gear():
    needed = demand(robot_of(gear_effort=5.0), move())
    assert not needed.fits
    assert str(needed.excesses[0]).startswith("joint 'shoulder': torque of the gear ")
    assert needed.uses['gear'][0] > 1.0 > needed.uses['effort'].max()
    assert needed.gears == ('shoulder', 'elbow')


def test_power_limits_the_motor():
    robot = robot_of()
    needed = demand(robot, move(), power=40.0)
    motor = robot.drives[0].motor
    assert needed.uses['power'][motor] == np.abs(needed.power[:, motor]).max() / 40.0
    assert needed.uses['power'][robot.drives[0].link] == 0.0


def test_a_rigid_motor_is_the_limit_of_a_stiff_one():
    stiff = arm()
    drives = {e.name: replace(e.drive, stiffness=1e9, motor='') for e in stiff.drives}
    links = [body for body in stiff.bodies if not body.joint.name.endswith('_motor')]
    bodies = tuple(replace(body, joint=replace(body.joint, drive=None))
                   for body in links)
    model = replace(stiff, bodies=bodies, coordinate_names=JOINTS)
    elastic = demand(Robot(with_drives(model, drives)), move())
    for name in ('shoulder', 'elbow'):
        index = [body.joint.name for body in bodies].index(name)
        drive = drives[name]
        rigid_joint = replace(bodies[index].joint, armature=drive.rotor_inertia,
                              damping=0.5 + drive.friction.get('damping', 0.0),
                              friction=drive.friction.get('friction', 0.0),
                              friction_speed=0.5)
        bodies = (*bodies[:index], replace(bodies[index], joint=rigid_joint),
                  *bodies[index + 1:])
    rigid = Robot(replace(model, bodies=bodies))
    state = move().sample(elastic.t)
    expected = rigid.inverse_dynamics(*state[:3])
    tau = elastic.tau[1:-1, [3, 4, 2]]  # without the samples of rest at both ends
    assert_allclose(tau, expected[1:-1], rtol=0, atol=1e-5 * np.abs(tau).max())


def carrier(**options):
    """Return the arm with limits, which may carry a payload at its wrist."""
    limits = {'gear_effort': 80.0, 'motor_effort': 95.0, 'motor_velocity': 6.0}
    return Robot(arm(**options, **limits), payload_frame='wrist_link')


@pytest.mark.parametrize('options', [
    {}, pytest.param({'curve': True}, marks=pytest.mark.slow),
    pytest.param({'damping': 2.0}, marks=pytest.mark.slow)], ids=str)
def test_the_largest_payload_of_an_elastic_arm_fits_and_any_more_does_not(options):
    robot = carrier(**options)
    com = (0.1, 0.0, 0.02)
    bound = largest_payload(robot, move(), com=com, speed=0.8)
    assert 0.1 < bound.mass < 100.0
    assert robot.parameters.payload is None
    for share, fits in ((1.0 - 1e-6, True), (1.0 + 1e-6, False)):
        load = Inertial(share * bound.mass, com, np.zeros((3, 3)))
        loaded = Robot(with_payload(robot.model, 'wrist_link', load))
        needed = demand(loaded, move(), speed=0.8)
        assert needed.fits is fits
        if not fits:
            excess, = needed.excesses
            assert (excess.joint, excess.limit) == (bound.joint, bound.limit)
            assert excess.t == pytest.approx(bound.t, abs=1e-3)


def test_the_largest_payload_of_very_stiff_drives_is_that_of_rigid_joints():
    builder = ModelBuilder('pendulum')
    builder.body('bar', joint='pivot', axis=(0, -1, 0), damping=0.3, armature=0.1,
                 limits=Limits(effort=30.0), inertial=rod(2.0, (0, 0, 0), (0.5, 0, 0)))
    rigid = builder.model()
    swing = SmoothMotion.from_points([0.0, 1.0], [[0.0], [1.0]], joint_names=('pivot',))
    dense = np.linspace(0.0, 1.0, 401)
    sampled = swing.sample(dense)
    same = Motion.from_points(dense, *sampled[:3], joint_names=('pivot',))
    expected = largest_payload(Robot(rigid, payload_frame='bar'), same, com=(0.4, 0, 0))
    elastic = with_drives(rigid, {'pivot': Drive(1e8, motor_effort=30.0)})
    bound = largest_payload(Robot(elastic, payload_frame='bar'), swing, com=(0.4, 0, 0))
    assert bound.mass == pytest.approx(expected.mass, rel=1e-4)
    assert (bound.joint, bound.limit) == ('pivot_motor', 'effort')
    nothing = with_drives(replace_limits(rigid), {'pivot': Drive(1e8)})
    assert largest_payload(Robot(nothing, payload_frame='bar'), swing).mass == math.inf


def replace_limits(model):
    """Return a model without limits."""
    body, = model.bodies
    joint = replace(body.joint, limits=Limits())
    return replace(model, bodies=(replace(body, joint=joint),))


BAD = [
    (lambda: Drive(1.0, motor_effort=0.0), ModelError, 'motor_effort: 0.0; expected'),
    (lambda: Drive(1.0, motor_velocity=-1.0), ModelError, 'motor_velocity: -1'),
    (lambda: Drive(1.0, gear_effort=math.nan), ModelError, 'gear_effort: nan'),
    (lambda: Drive(1.0, gear_effort=True), ModelError, 'gear_effort: True'),
    (lambda: Drive(1.0, gear_effort='much'), ModelError, "gear_effort: 'much'"),
    (lambda: Drive.from_motor_side(ratio=2.0, stiffness=1.0, motor_effort=None,
                                   gear_effort=-3.0), ModelError, 'gear_effort: -3'),
    (lambda: load_urdf(URDF, supplement={'drives': {'j': {
        'stiffness': 1, 'motor_effort': 0}}}), UrdfError, 'motor_effort: 0'),
    (lambda: demand(robot_of(), Motion.from_points(
        [0.0, 0.5, 1.0], np.outer([0.0, 0.3, 1.0], np.ones(3)), joint_names=JOINTS)),
     InputError, "acceleration of joint 'shoulder' jumps"),
    (lambda: demand(robot_of(), SmoothMotion.from_points(
        [0, 1], [[0] * 5, [1] * 5], joint_names=robot_of().joint_names)),
     InputError, 'as many as independent speeds of the links'),
    (lambda: demand(robot_of(), 3), InputError, 'motion: a int; expected a Motion'),
    (lambda: demand(robot_of(), move(), speed=0.0), InputError, 'speed: 0'),
    (lambda: fastest(robot_of(), move(), bending=1), InputError, 'bending: given'),
    (lambda: demand(robot_of(), move(), power=-1.0), InputError, 'power'),
    (lambda: largest_payload(
        Robot(arm(), payload_frame='wrist_link'), Motion.from_points(
            [0.0, 1.0], np.zeros((2, 5)), joint_names=robot_of().joint_names)),
     InputError, 'as many as independent speeds of the links'),
    (lambda: largest_payload(carrier(), move(), bending=1), InputError,
     'bending: given'),
    (lambda: largest_payload(carrier(), move(), speed=50.0), InputError,
     'motion without a payload: joint'),
]


@pytest.mark.parametrize(('call', 'error', 'words'), BAD)
def test_invalid_limits_and_motions_are_refused(call, error, words):
    with pytest.raises(error, match=words):
        call()
