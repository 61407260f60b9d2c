"""Limits of joint speeds: brakes take energy out and leave slow joints alone."""

from dataclasses import replace
from functools import cache

from kane_dynamics import (CartesianImpedance, HandGuiding, InputError, load_urdf,
                           ModelBuilder, Prescribed, Robot, rod)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.task_space.joint_speed_limits import (checked_speeds, CREEPING, FREE,
                                                         HORIZON, slowdown, STOPPING)
from kane_dynamics.task_space.joint_walls import JointWalls
import numpy as np
import pytest
from stepping import stepped

K = np.array([2000.0, 2000.0, 2000.0, 100.0, 100.0, 100.0])
TIP = 'fr3_link8'
ORDINARY = np.array([0.2, -0.7, 0.1, -2.2, 0.1, 1.6, 0.7])
STRETCHED = np.array([0.3, 0.3, 0.0, -0.47, 0.0, 1.9, 0.8])


@cache
def fr3():
    """Return the FR3 without friction and effort limits."""
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), tip=TIP), friction=False)
    robot.limits = replace(robot.limits, effort=np.full(robot.n, np.inf))
    return robot


def law(**settings):
    """Return an impedance without walls."""
    return CartesianImpedance(fr3(), TIP,
                              **{'stiffness': K, 'limit_stiffness': 0.0, **settings})


def test_a_joint_that_would_exceed_its_limit_is_braked_as_its_definition_says():
    robot = fr3()
    limits = robot.limits.velocity
    u = np.array([0.88, -0.1, 0.2, 0.1, 0.3, -0.1, 0.2]) * limits
    pose = robot.frame_pose(TIP, ORDINARY + [0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    undamped = {'damping_ratio': 0.0, 'null_damping': 0.0}
    free = law(speed_limit=np.inf, **undamped)
    bounded = law(**undamped)
    assert free.state(ORDINARY, u, pose).braking == 0.0
    tau = free.torque(ORDINARY, u, pose)
    change = bounded.torque(ORDINARY, u, pose) - tau
    acceleration = robot.forward_dynamics(ORDINARY, u, tau)
    excess = acceleration - (FREE * limits - u) / HORIZON
    assert excess[0] > 0.0, 'the joint would exceed its limit'
    mobility = robot.inverse_mass_matrix(ORDINARY)[0, 0]
    np.testing.assert_allclose(change[0], -excess[0] / mobility, rtol=1e-9)
    np.testing.assert_allclose(change[1:], 0.0, atol=1e-9)
    assert bounded.state(ORDINARY, u, pose).braking == pytest.approx(-change[0])


def test_brakes_take_energy_out_and_do_not_act_on_slow_joints_far_from_stops():
    robot = fr3()
    rng = np.random.default_rng(0)
    bounded = law()
    free = law(speed_limit=np.inf)
    acted = left_alone = 0
    for _ in range(300):
        q = robot.random_configuration(rng)
        u = rng.uniform(-1.2, 1.2, 7) * robot.limits.velocity
        pose = robot.frame_pose(TIP, robot.random_configuration(rng))
        brake = bounded.torque(q, u, pose) - free.torque(q, u, pose)
        # Each joint by itself, up to the rounding of torques of thousands.
        assert (brake * u < 1e-6).all()
        acted += bool(np.abs(brake).max() > 1e-6)
        slow = 0.4 * u
        distance = np.minimum(q - robot.limits.lower, robot.limits.upper - q)
        if (distance < STOPPING * robot.limits.velocity).any():
            continue
        left_alone += 1
        difference = bounded.torque(q, slow, pose) - free.torque(q, slow, pose)
        assert np.abs(difference).max() < 1e-9 * np.abs(free.torque(q, slow, pose)).max()
    assert acted > 250
    assert left_alone > 30


def speeds_towards_stops(robot, q, rates, speeds):
    """Return the speed limits along the motion, by the robot's limits."""
    walls = JointWalls(robot)
    return walls.speeds_towards(q, rates, speeds, walls.settings(None, None))


def test_the_speed_towards_a_stop_is_what_is_left_of_the_way():
    robot = fr3()
    limits = robot.limits
    q = 0.5 * (limits.lower + limits.upper)
    q[0] = limits.upper[0] - 0.05
    q[1] = limits.lower[1] + 0.05
    q[2] = limits.upper[2] + 0.3  # beyond it
    rates = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0])
    expected = limits.velocity.copy()
    expected[:2] = 0.05 / STOPPING
    expected[2] *= CREEPING
    speeds = speeds_towards_stops(robot, q, rates, limits.velocity)
    np.testing.assert_allclose(speeds, expected)
    np.testing.assert_array_equal(
        speeds_towards_stops(robot, q, -rates, limits.velocity), limits.velocity)


def test_the_speed_of_a_joint_without_a_speed_limit_ends_at_its_stop():
    robot = fr3().copy()
    limits = robot.limits
    robot.limits = replace(limits, velocity=np.full(7, np.inf))
    at_upper = limits.upper.copy()
    unstated = checked_speeds(robot, None)
    speeds = speeds_towards_stops(robot, at_upper, np.ones(7), unstated)
    np.testing.assert_allclose(speeds, CREEPING * (limits.upper - limits.lower))
    speeds = speeds_towards_stops(robot, at_upper - 0.2, np.ones(7), unstated)
    np.testing.assert_allclose(speeds, 0.2 / STOPPING)
    # Unless the user states that there is none.
    free = checked_speeds(robot, np.inf)
    assert (speeds_towards_stops(robot, at_upper, np.ones(7), free) > 1e99).all()

    # A joint with one limit, or none.
    one_sided = robot.copy()
    upper = limits.upper.copy()
    upper[:] = np.inf
    one_sided.limits = replace(limits, upper=upper)
    speeds = speeds_towards_stops(one_sided, limits.lower, -np.ones(7), unstated)
    np.testing.assert_allclose(speeds, CREEPING)
    speeds = speeds_towards_stops(one_sided, limits.lower, np.ones(7), unstated)
    np.testing.assert_array_equal(speeds, unstated)


@pytest.mark.parametrize('law', [HandGuiding, lambda robot: CartesianImpedance(
    robot, TIP, stiffness=1e-3 * K, damping_ratio=0.1, limit_stiffness=0.0)])
def test_laws_of_equal_robots_with_other_joint_limits_have_their_own_limits(law):
    """Their machine code is that of the model: the limits are among its numbers."""
    limited = fr3().copy()
    unlimited = fr3().copy()
    infinite = np.full(7, np.inf)
    unlimited.limits = replace(limited.limits, lower=-infinite, upper=infinite)
    q = 0.5 * (limited.limits.lower + limited.limits.upper)
    q[6] = limited.limits.upper[6] - 0.02
    u = np.zeros(7)
    u[6] = 2.0
    torques = []
    for robot in (unlimited, limited, unlimited):
        first_law = law(robot)
        if isinstance(first_law, HandGuiding):
            first_law.update(limit_stiffness=0.0)
            torques.append(first_law.torque(q, u)[6])
        else:
            torques.append(first_law.torque(q, u, robot.frame_pose(TIP, q))[6])
    assert torques[0] == torques[2]
    assert torques[1] < torques[0] - 0.2  # only a joint with a limit is braked


@pytest.mark.parametrize('speeds', ['stated', 'unstated', 'none'])
def test_a_joint_that_a_spring_throws_at_its_stop_comes_there_slowly(speeds):
    # The elbow, bent to 0.5 rad before its stop, is pulled by a target beyond it.
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), tip=TIP), friction=False)
    velocity = robot.limits.velocity
    creeping = CREEPING * velocity[3]
    if speeds == 'unstated':
        robot.limits = replace(robot.limits, velocity=np.full(7, np.inf))
        creeping = CREEPING * (robot.limits.upper[3] - robot.limits.lower[3])
    start = ORDINARY.copy()
    start[3] = robot.limits.lower[3] + 0.5
    beyond = start.copy()
    beyond[3] -= 1.0
    impedance = CartesianImpedance(robot, TIP, stiffness=K, limit_stiffness=0.0,
                                   speed_limit=np.inf if speeds == 'none' else None)
    q = start
    u = np.zeros(7)
    target = robot.frame_pose(TIP, beyond)
    arrival = 0.0
    for _ in range(600):
        q, u = stepped(robot, lambda q, u: impedance.torque(q, u, target), q, u, 0.001)
        if q[3] < robot.limits.lower[3]:
            arrival = -u[3]
            break
    assert (arrival < 1.5 * creeping) == (speeds != 'none')


def test_no_joint_exceeds_its_limit_while_the_spring_pulls_through_a_singularity():
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), tip=TIP), friction=False)
    target = robot.frame_pose(TIP, ORDINARY)
    fastest = {}
    for name, limit in (('bounded', None), ('free', np.inf)):
        impedance = CartesianImpedance(robot, TIP, stiffness=K, speed_limit=limit)
        q = STRETCHED
        u = np.zeros(7)
        speeds = []
        for _ in range(300):
            q, u = stepped(robot, lambda q, u, i=impedance: i.torque(q, u, target), q, u,
                           0.001)
            speeds.append(np.abs(u) / robot.limits.velocity)
        fastest[name] = np.max(speeds)
    assert fastest['free'] > 1.5
    assert fastest['bounded'] < 1.0


def test_the_reference_motion_is_slowed_down_by_one_factor():
    assert slowdown(np.array([0.5, -1.0]), np.array([1.0, 2.0])) == 1.0
    assert slowdown(np.array([2.0, -1.0]), np.array([1.0, 2.0])) == pytest.approx(
        FREE / 2.0)
    assert slowdown(np.zeros(2), np.array([1.0, np.inf])) == 1.0
    robot = fr3()
    near = STRETCHED - [0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0]
    pose = robot.frame_pose(TIP, near)
    lost = np.linalg.svd(robot.jacobian(TIP, near))[0][:, 5]
    twist = 0.5 * lost / np.linalg.norm(lost[:3])
    state = law().state(near, np.zeros(7), pose, twist)
    assert 0.0 < state.speed_scale < 1.0
    assert law(speed_limit=np.inf).state(
        near, np.zeros(7), pose, twist).speed_scale == 1.0


@pytest.mark.parametrize(('stated', 'message'), [
    (-1.0, r"speed_limit of joint 'fr3_joint1': -1.0; expected a number >= 0"),
    (0.0, r'speed_limit: .*; expected positive numbers'),
    ([1.0, 2.0], r'speed_limit: .*; expected one number, or 7'),
    ('fast', 'speed_limit: ')])
def test_a_wrong_limit_is_named(stated, message):
    with pytest.raises(InputError, match=message):
        law(speed_limit=stated)


def test_a_joint_whose_motion_is_prescribed_is_not_braked():
    builder = ModelBuilder('arm on a turning table')
    beam = rod(1.0, (0, 0, 0), (0.3, 0, 0))
    builder.body('table', axis=(0, 0, 1), inertial=beam)
    builder.body('arm', 'table', axis=(0, 1, 0), at=(0.3, 0, 0), inertial=beam)
    robot = Robot(builder.model(),
                  constraints=[Prescribed('table', lambda t: 0.1 * np.sin(t))])
    q = np.array([0.0, 0.2])
    at_rest = np.zeros(1)
    impedance = CartesianImpedance(robot, 'arm',
                                   stiffness=np.ones(6), speed_limit=[0.05, 9.0])
    assert impedance.state(q, at_rest, robot.frame_pose('arm', q)).braking == 0.0
