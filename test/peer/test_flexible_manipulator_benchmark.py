"""
The four-mass manipulator of a published benchmark of control, as an arm with a drive.

S. Moberg, J. Oehr, S. Gunnarsson, A Benchmark Problem for Robust Feedback Control of a
Flexible Manipulator, IEEE Trans. Control Systems Technology 17 (2009): one axis of an
industrial arm, its motor and three masses in a row, joined by a gear and by two springs
that stand for flexible links. Every number is on the motor's side of a gear of 1 : 220,
and every mass has viscous friction against the ground. The stiffness of the gear lies
between 16.7 and 100 N m/rad. The parameters are those that published solutions of the
benchmark list.
"""

from kane_dynamics import (Drive, Inertial, ModelBuilder, natural_vibration, Robot,
                           with_drives)
import numpy as np
import pytest

RATIO = 220.0
# Kg m^2.
MOTOR = 5e-3
MASSES = (2e-3, 0.02, 0.02)
GEAR = (16.7, 100.0)  # N m/rad
SPRINGS = (110.0, 80.0)  # N m/rad
DAMPING = (0.08, 0.06, 0.08)  # N m s/rad, of the gear and of the springs
FRICTION = (6e-3, 1e-3, 1e-3, 1e-3)  # N m s/rad, of the motor and of the masses


def published(stiffness):
    """Return the matrix A of the published equations of state, (8, 8)."""
    inertia = np.diag([MOTOR, *MASSES])
    K, D = np.zeros((2, 4, 4))
    for k, (spring, damper) in enumerate(
            zip((stiffness, *SPRINGS), DAMPING, strict=True)):
        pair = np.ix_([k, k + 1], [k, k + 1])
        K[pair] += spring * np.array([[1.0, -1.0], [-1.0, 1.0]])
        D[pair] += damper * np.array([[1.0, -1.0], [-1.0, 1.0]])
    D += np.diag(FRICTION)
    return np.block([[np.zeros((4, 4)), np.eye(4)],
                     [-np.linalg.solve(inertia, K), -np.linalg.solve(inertia, D)]])


def arm(stiffness):
    """Return the benchmark's robot: three links in an axis, the first driven."""
    builder = ModelBuilder('benchmark', gravity=(0.0, 0.0, 0.0))
    parent = 'world'
    squared = RATIO**2
    for k, inertia in enumerate(MASSES):
        spring = {}
        if k:
            spring = {'stiffness': squared * SPRINGS[k - 1],
                      'damping': squared * DAMPING[k]}
        builder.body(f'arm_{k + 1}', parent, joint=f'joint_{k + 1}', axis=(0, 0, 1),
                     inertial=Inertial(1.0, np.zeros(3), squared * inertia * np.eye(3)),
                     **spring)
        parent = f'arm_{k + 1}'
    drive = Drive.from_motor_side(
        ratio=RATIO, stiffness=stiffness, damping=DAMPING[0], rotor_inertia=MOTOR,
        friction={'damping': FRICTION[0]})
    return Robot(with_drives(builder.model(), {'joint_1': drive}))


def state_matrix(robot):
    """Return d(u, udot) / d(q, u) at rest, with friction against the ground."""
    at_rest = np.zeros(robot.n)
    by_q, by_u, by_tau = robot.forward_dynamics_derivatives(at_rest, at_rest, at_rest)
    # Rates of the three arms are sums of joint rates.
    sums = np.zeros((3, robot.n))
    sums[:, :3] = np.tril(np.ones((3, 3)))
    ground = RATIO**2 * sums.T @ np.diag(FRICTION[1:]) @ sums
    n = robot.n
    return np.block([[np.zeros((n, n)), np.eye(n)], [by_q, by_u - by_tau @ ground]])


def sorted_values(A):
    values = np.linalg.eigvals(A)
    return values[np.lexsort((values.imag, values.real.round(6)))]


@pytest.mark.parametrize('stiffness', GEAR)
def test_the_poles_are_those_of_the_published_equations(stiffness):
    robot = arm(stiffness)
    expected = sorted_values(published(stiffness))
    np.testing.assert_allclose(sorted_values(state_matrix(robot)), expected,
                               atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize('stiffness', GEAR)
def test_the_frequency_response_of_the_motor_is_the_published_one(stiffness):
    """From the torque to the acceleration of the motor, on its own side of the gear."""
    robot = arm(stiffness)
    A = state_matrix(robot)
    motor = robot.drives[0].motor
    B = np.zeros(2 * robot.n)
    B[robot.n:] = robot.forward_dynamics_derivatives(
        *np.zeros((3, robot.n)))[2][:, motor]
    A_published = published(stiffness)
    B_published = np.zeros(8)
    B_published[4] = 1.0 / MOTOR
    for frequency in (1.0, 8.0, 20.0, 45.0, 120.0):
        s = 2j * np.pi * frequency
        ours = s * np.linalg.solve(s * np.eye(2 * robot.n) - A, B)[robot.n + motor]
        theirs = s * np.linalg.solve(s * np.eye(8) - A_published, B_published)[4]
        # The motor turns RATIO times as far under a torque RATIO times as small.
        assert RATIO**2 * ours == pytest.approx(theirs, rel=1e-9)


def test_natural_frequencies_are_those_of_masses_and_springs():
    robot = arm(GEAR[1])
    A = published(GEAR[1])
    squares = np.sort(np.linalg.eigvals(-A[4:, :4]).real)
    frequencies = natural_vibration(robot, np.zeros(robot.n)).frequencies
    # Free motors and links have one motion without a spring.
    np.testing.assert_allclose(frequencies[-3:], np.sqrt(squares[1:]), rtol=1e-9)
