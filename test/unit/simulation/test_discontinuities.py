"""Jumps of user-defined functions: a named error wherever; no false alarms."""

import functools

from kane_dynamics import (ConstraintError, DependentSpeeds, ModelBuilder, Motion,
                           point_mass, PointVelocity, Prescribed, Robot, rod, simulate,
                           Speeds)
from kane_dynamics.simulation.discontinuities import first_jump, JumpWatch, SHORT
import numpy as np
import pytest

AT = 0.03034  # s: between two steps


@functools.cache
def model():
    """Return an arm on a cart."""
    b = ModelBuilder('shaken')
    b.body('cart', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0))
    b.body('arm', 'cart', axis=(0, -1, 0), inertial=rod(1.0, (0, 0, 0), (0.5, 0, 0)))
    return b.model()


def shaken(position, duration=0.05, t0=0.0, **options):
    """Simulate the arm on a cart that moves as a function of time."""
    robot = Robot(model(), constraints=[Prescribed('cart', position, name='shaker')])
    q0 = robot.closed_configuration([0.0, -1.0], fixed=['arm'], t=t0)
    return simulate(robot, q0, [0.0], duration, step=1e-3, t0=t0, **options)


def watched(position, t0=0.0):
    """Look for jumps as `simulate` does in 50 steps, without the motion."""
    robot = Robot(model(), constraints=[Prescribed('cart', position, name='shaker')])
    JumpWatch(robot, np.zeros((1, robot.n_q)), t0, 1e-3, 50, True).look_ahead(0, 50)


VELOCITY = r'the velocity of position\(t\)'
POSITION = r'position\(t\)'
JUMPS = {
    'between steps': (lambda t: np.abs(t - AT), AT, VELOCITY, 2.0),
    'on a step': (lambda t: np.abs(t - 0.03), 0.03, VELOCITY, 2.0),
    'tiny': (lambda t: 1e-8 * np.abs(t - AT), AT, VELOCITY, 2e-8),
    'minimum': (lambda t: np.minimum(t, AT), AT, VELOCITY, -1.0),
    'where': (lambda t: np.where(t < AT, t * t, AT**2 + 5 * (t - AT)), AT, VELOCITY,
              5 - 2 * AT),
    'at the begin': (lambda t: np.where(t <= 0.0, 0.0, t), 0.0, VELOCITY, 1.0),
    'at the end': (lambda t: np.maximum(0.0 * t, t - 0.05), 0.05, VELOCITY, 1.0),
    'position on a step': (lambda t: np.where(t < 0.03, 0.0, 0.1), 0.03, POSITION, 0.1),
    'position, small': (lambda t: np.where(t < 0.03, 0.0, 1e-4), 0.03, POSITION, 1e-4),
    'position, tiny': (lambda t: np.where(t < AT, 0.0, 1e-8), AT, POSITION, 1e-8),
    'sawtooth': (lambda t: t % 0.03, 0.03, POSITION, -0.03),
    'there and back within a step': (lambda t: np.where((t > AT) & (t < AT + 1e-5), 1e-3,
                                                        0.0), AT, POSITION, 1e-3)}


@pytest.mark.parametrize('name', JUMPS)
def test_a_jump_of_a_prescribed_motion_is_an_error_that_names_function_time_and_size(
        name):
    position, t, what, size = JUMPS[name]
    with pytest.raises(ConstraintError,
                       match=(f"simulation, t = {t:.9g} s: constraint 'shaker': {what} "
                              f'jumps by {size:.3g} ')):
        (shaken if name == 'position on a step' else watched)(position)


SMOOTH = {
    'kink of the acceleration': lambda t: (t - AT) * np.abs(t - AT),
    'infinite third derivative': lambda t: np.abs(t - AT)**2.5,
    'tanh that the step resolves': lambda t: 1e-3 * np.tanh(1e2 * (t - AT)),
    'corner of 1e-6 s': lambda t: np.hypot(t - AT, 1e-6),
    'tanh in 1e-9 s': lambda t: 1e-13 * np.tanh(1e9 * (t - AT)),
    'fast oscillation': lambda t: 1e-7 * np.sin(1e5 * t), 'abs at the begin': np.abs,
    'table': (np.linspace(0.0, 0.04, 30),
              0.1 * np.sin(9.0 * np.linspace(0.0, 0.04, 30)))}


@pytest.mark.parametrize('name', SMOOTH)
def test_a_motion_with_a_continuous_velocity_is_no_jump_however_steep(name):
    watched(SMOOTH[name])


@pytest.mark.parametrize('rate', [1.0, 1e3, 1e6])
def test_rounding_of_a_late_time_is_no_jump(rate):
    watched(lambda t: np.sin(rate * t) * 1e-3 / rate, t0=1e4)


def test_a_motion_that_does_not_start_at_rest_is_an_error():
    motion = Motion.from_points([0.01, 0.02], [[0.0], [0.01]], velocities=[[0.5], [0.0]],
                                joint_names=['cart'])
    with pytest.raises(ConstraintError,
                       match=rf"0\.01 s: .*'shaker': {VELOCITY} jumps by 0\.5"):
        watched(motion)


def test_a_jump_is_found_with_a_torque_function_and_many_states():
    with pytest.raises(ConstraintError, match=f'{VELOCITY} jumps by 2'):
        shaken(lambda t: np.abs(t - AT), torque=lambda t, q, u: [0.0])
    robot = Robot(model(), constraints=[Prescribed('cart', lambda t: np.abs(t - AT))])
    q0 = robot.closed_configuration([0.0, -1.0], fixed=['arm'])
    with pytest.raises(ConstraintError, match=f'{VELOCITY} jumps by 2'):
        simulate(robot, [q0, q0], [[0.0], [1.0]], 0.05)


def test_jumps_of_other_functions_are_errors_too():
    def step(t):
        return np.where(t < AT, 0.0, 1.0)
    belt = PointVelocity('cart', (1, 0, 0), value=step, name='belt')
    drive = DependentSpeeds(('cart',), lambda q, t: np.array([[0.1]]),
                            lambda q, t: np.array([step(t)]), name='drive')
    cam = DependentSpeeds(('cart',),
                          lambda q, t: np.array([[np.where(q[1] < -1.01, 0.5, 0.6)]]),
                          name='cam')
    shifted = Speeds(lambda q, t: np.eye(2), lambda q, t: np.array([step(t), 0.0]))
    for robot, words in (
            (Robot(model(), constraints=[belt]),
             r"0\.03034 s: constraint 'belt': value\(t\)"),
            (Robot(model(), constraints=[drive]),
             r"constraint 'drive': B\(q, t\) jumps by 1;"),
            (Robot(model(), constraints=[cam]),
             r"constraint 'cam': A\(q, t\) jumps by -0\.1;"),
            (Robot(model(), speeds=shifted), r'speeds: Z\(q, t\) jumps by 1;')):
        with pytest.raises(ConstraintError, match=words):
            simulate(robot, [0.0, -1.0], [0.0] * robot.n, 0.2)


def test_a_derivative_that_is_not_finite_is_named_with_its_time():
    with pytest.raises(ConstraintError, match=(
            r"'shaker': the second derivative of position\(t\) is inf at t = 0\.0 s")):
        shaken(lambda t: t**1.5)
    with pytest.raises(ConstraintError,
                       match=rf'second derivative of {POSITION} is inf at t = '
                       rf'{AT}'):
        watched(lambda t: np.abs(t - AT)**1.5)
    with pytest.raises(ConstraintError,
                       match=rf'first derivative of {POSITION} is inf at t = 0'):
        watched(np.sqrt)
    robot = Robot(model(), constraints=[Prescribed('cart', lambda t: t**1.5)])
    for call in (robot.forward_dynamics, robot.inverse_dynamics):
        with pytest.raises(ConstraintError,
                           match=rf'second derivative of {POSITION} is inf at'):
            call([0.0, 0.0], [0.0], [0.0], t=0.0)
    assert np.isfinite(robot.inverse_dynamics([1.0, 0.0], [0.0], [0.0], t=1.0)).all()


def test_the_first_of_several_jumps_is_found():
    def screen(begin, end, place):
        of_end = np.sign(end - 0.31) + 2.0 * np.sign(end - 0.32)
        of_begin = np.sign(begin - 0.31) + 2.0 * np.sign(begin - 0.32)
        return 1e9 * np.abs(of_end - of_begin), (of_end - of_begin)[:, None]
    t, channel, size = first_jump(screen, np.array([0.0, 0.3, 0.4]), SHORT)
    assert (t, channel, size) == (pytest.approx(0.31, abs=1e-14), 0, 2.0)
