"""Fastest timing with elastic joints against optimal control of two masses."""

from functools import cache
import math

from kane_dynamics import (Drive, Inertial, InputError, Limits, ModelBuilder, Motion,
                           Robot, rod, simulate, SmoothMotion, with_drives)
from kane_dynamics.feasibility import demand, fastest, time_optimal
import numpy as np
from numpy.testing import assert_allclose
import pytest
from scipy.linalg import expm
from scipy.optimize import linprog

INERTIA = 0.5
ROTOR = 0.3
STIFFNESS = 60.0
EFFORT = 10.0
WAYPOINTS = [[0.0, 0.0], [0.5, 0.2], [0.9, -0.3], [0.3, 0.3]]


@cache
def two_mass(velocity=math.inf, damping=0.0):
    """Return a disk on a vertical axis, with one elastic joint."""
    builder = ModelBuilder('disk')
    builder.body('disk', joint='joint', axis=(0, 0, 1),
                 inertial=Inertial(1.0, np.zeros(3), INERTIA * np.eye(3)))
    drive = Drive(STIFFNESS, damping=damping, rotor_inertia=ROTOR, motor_effort=EFFORT,
                  motor_velocity=velocity)
    return Robot(with_drives(builder.model(), {'joint': drive}))


@cache
def arm():
    builder = ModelBuilder('arm')
    builder.body('upper', joint='shoulder', axis=(0, -1, 0),
                 inertial=rod(4.0, (0, 0, 0), (0.5, 0, 0)))
    builder.body('lower', 'upper', joint='elbow', axis=(0, -1, 0), at=(0.5, 0, 0),
                 inertial=rod(2.0, (0, 0, 0), (0.4, 0, 0)))
    return Robot(with_drives(builder.model(), {
        'shoulder': Drive(900.0, rotor_inertia=0.8, friction={'damping': 2.0},
                          motor_effort=80.0, motor_velocity=4.0, gear_effort=70.0),
        'elbow': Drive(500.0, rotor_inertia=0.3, motor_effort=30.0,
                       motor_velocity=5.0)}))


@cache
def timing():
    return time_optimal(arm(), WAYPOINTS)


def least_time(distance, velocity, steps=240):
    """
    Return the least duration of a move from rest to rest of the two-mass joint.

    By bisection of the duration; torques held over steps are a linear program. No path
    parameter, no spline and no code of the library is in it.
    """
    A = np.zeros((4, 4))  # of q, theta, q', theta'
    A[:2, 2:] = np.eye(2)
    spring = np.array([-1.0, 1.0])
    A[2, :2] = STIFFNESS / INERTIA * spring
    A[3, :2] = -STIFFNESS / ROTOR * spring

    def feasible(duration):
        h = duration / steps
        block = np.zeros((5, 5))
        block[:4, :4] = A
        block[3, 4] = 1.0 / ROTOR
        step = expm(h * block)
        responses = [step[:4, 4]]
        for _ in range(steps - 1):
            responses.append(step[:4, :4] @ responses[-1])
        final = np.array(responses[::-1]).T
        rows = []
        bounds = []
        if np.isfinite(velocity):
            of_speed = np.array(responses)[:, 3]
            for k in range(1, steps):
                row = np.zeros(steps)
                row[:k] = of_speed[:k][::-1]
                rows += [row, -row]
                bounds += [velocity, velocity]
        result = linprog(np.zeros(steps), A_ub=rows or None, b_ub=bounds or None,
                         A_eq=final, b_eq=[distance, distance, 0.0, 0.0],
                         bounds=(-EFFORT, EFFORT))
        return result.status == 0
    low = 0.05
    high = 5.0
    while high - low > 1e-3 * low:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if feasible(middle) else (middle, high)
    return high


@pytest.mark.slow
@pytest.mark.parametrize(('velocity', 'damping'), [
    (math.inf, 0.0), (1.5, 0.0), (math.inf, 0.3)])
def test_the_timing_is_near_that_of_optimal_control(velocity, damping):
    least = least_time(0.8, velocity)
    result = time_optimal(two_mass(velocity, damping), [[0.0], [0.8]])
    # The torque of optimal control jumps between the limits; that of the timing does
    # not. With a little damping it is faster: the motor's deflection decays after the
    # end.
    assert result.duration < 1.02 * least
    if not damping:
        assert result.duration > 0.998 * least
    assert demand(two_mass(velocity, damping), result.motion, step=3e-5).fits


def test_the_timing_of_a_two_mass_joint_is_within_its_limits_and_near_the_least():
    result = time_optimal(two_mass(), [[0.0], [0.8]])
    assert result.duration == pytest.approx(0.532, rel=0.02)  # `least_time`
    dense = demand(two_mass(), result.motion, step=7e-5)
    assert dense.fits
    assert dense.uses['effort'].max() > 0.995


@pytest.mark.slow
def test_no_limit_is_exceeded_and_one_is_always_near():
    result = timing()
    dense = demand(arm(), result.motion, step=result.duration / 7000)
    assert dense.fits
    assert max(use.max() for use in dense.uses.values()) > 0.995
    # Almost everywhere a limit is used by more than 8 tenths.
    use = np.max([uses.max(axis=1) for uses in result.uses.values()], axis=0)
    assert np.quantile(use, 0.1) > 0.8
    assert {active.joint for active in result.active} >= {'shoulder_motor',
                                                          'elbow_motor'}


@pytest.mark.slow
def test_the_motion_follows_the_waypoints_and_rests_at_its_ends():
    motion = timing().motion
    assert isinstance(motion, SmoothMotion)
    assert motion.joint_names == ('shoulder', 'elbow')
    q = motion.sample(np.linspace(0.0, motion.duration, 20_000)).q
    for point in WAYPOINTS:
        assert np.linalg.norm(q - point, axis=1).min() < 1e-4
    ends = motion.sample([0.0, motion.duration])
    inside = motion.sample(np.linspace(0.0, motion.duration, 99))
    for at_end, derivative in zip(ends[1:], inside[1:], strict=True):
        assert np.abs(at_end).max() < 1e-4 * np.abs(derivative).max()


@pytest.mark.slow
def test_the_motor_torques_move_the_links_along_the_path():
    robot = arm()
    result = timing()
    times = result.points.t
    motors = [elastic.motor for elastic in robot.drives]

    def torque(t, q, u):
        tau = np.zeros(robot.n)
        for motor in motors:
            tau[motor] = np.interp(t, times, result.tau[:, motor])
        return tau
    run = simulate(robot, result.points.q[0], np.zeros(robot.n), result.duration,
                   step=result.duration / 4000, torque=torque)
    expected = result.motion.sample(run.t).q
    assert_allclose(run.q[:, :2], expected, rtol=0, atol=2e-3)


@pytest.mark.slow
def test_a_smooth_motion_is_a_path_and_its_timing_is_ignored():
    straight = time_optimal(two_mass(), [[0.0], [0.8]]).duration
    for times in ([0.0, 1.0, 2.0], [0.0, 1.2, 2.5]):
        path = SmoothMotion.from_points(times, [[0.0], [0.4], [0.8]],
                                        joint_names=['joint'])
        assert time_optimal(two_mass(), path).duration == pytest.approx(
            straight, rel=2e-3)
    reversing = SmoothMotion.from_points([0.0, 1.0, 2.0], [[0.0], [0.8], [0.4]],
                                         joint_names=['joint'])
    with pytest.raises(InputError, match='path: a corner near'):
        time_optimal(two_mass(), reversing)


@pytest.mark.slow
def test_limits_of_acceleration_and_power_hold():
    result = time_optimal(two_mass(), [[0.0], [0.8]], acceleration=8.0, power=6.0)
    needed = demand(two_mass(), result.motion, power=6.0)
    assert needed.fits
    assert needed.uses['power'][1] > 0.99
    assert np.abs(needed.udot).max() <= 8.0 * (1.0 + 1e-6)


@pytest.mark.parametrize('share', [0.8, 0.92, 0.99, 0.995])
def test_an_arm_whose_motor_holds_it_near_its_limit_has_a_timing(share):
    # The arm is level at its start, where its weight is held by a share of the limit.
    weight = 4.0 * 9.81 * 0.25
    robot = Robot(with_drives(arm_of_limits(), {'shoulder': Drive(
        9e2, rotor_inertia=1.0, motor_effort=weight / share)}))
    timing = time_optimal(robot, [[0.0], [0.8]])
    needed = demand(robot, timing.motion)
    assert needed.fits
    motor = robot.joint_names.index('shoulder_motor')
    assert needed.uses['effort'][motor] > 0.99
    # Faster is not possible.
    assert fastest(robot, timing.motion).speed < 1.02


def test_an_arm_whose_motor_cannot_hold_it_is_refused_at_once():
    weight = 4.0 * 9.81 * 0.25
    robot = Robot(with_drives(arm_of_limits(), {'shoulder': Drive(
        9e2, rotor_inertia=1.0, motor_effort=weight / 1.001)}))
    with pytest.raises(InputError, match=r"'shoulder_motor': 1\.001 times its effort"):
        time_optimal(robot, [[0.0], [0.8]])


CORNER = Motion.from_points([0, 1, 2], [[0, 0], [1, 0], [1, 1]],
                            joint_names=['shoulder', 'elbow'])


@pytest.mark.parametrize(('call', 'words'), [
    (lambda: time_optimal(arm(), CORNER), 'path: a corner near'),
    (lambda: time_optimal(arm(), WAYPOINTS, jerk=3.0),
     'elastic joints with a limit of jerk'),
    (lambda: time_optimal(arm(), WAYPOINTS, end_speed=1.0), 'speeds at the ends'),
    (lambda: time_optimal(arm(), [[0.0, 0.0, 0.0, 0.0], [1.0] * 4]), 'shoulder, elbow'),
    (lambda: time_optimal(arm(), [[0.0, 0.0]]), 'expected at least 2'),
    (lambda: time_optimal(Robot(with_drives(
        arm_of_limits(lower=-0.1), {'shoulder': Drive(9e2, rotor_inertia=1.0)})),
                          [[0.0], [-0.5]]), 'within its lower limit -0.1'),
    (lambda: time_optimal(Robot(with_drives(arm_of_limits(), {
        'shoulder': Drive(9e2, rotor_inertia=1.0, gear_effort=2.0)})), [[0.0], [0.5]]),
     "path: joint 'shoulder': .* times its gear limit at rest"),
    (lambda: time_optimal(Robot(with_drives(arm_of_limits(), {
        'shoulder': Drive(9e2, rotor_inertia=1.0)})), [[0.0], [0.5]]),
     'path: no limit of motors'),
])
def test_a_path_without_a_timing_is_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()


def arm_of_limits(**limits):
    builder = ModelBuilder('arm')
    builder.body('upper', joint='shoulder', axis=(0, -1, 0), limits=Limits(**limits),
                 inertial=rod(4.0, (0, 0, 0), (0.5, 0, 0)))
    return builder.model()
