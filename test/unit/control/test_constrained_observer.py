"""The momentum observer under constraints and chosen speeds: a low-pass of the force."""

from functools import cache
from itertools import pairwise
import math

from examples.flexible_four_bar import flexible_four_bar
from kane_dynamics import (absolute_rates, CollisionDetector, ConstraintError,
                           InputError, MomentumObserver, Motion, Robot)
from kane_dynamics.mechanics.definition import kane, nonholonomic
from linkages import (ARM, five_bar, five_bar_at, five_bar_partial_rates, four_bar,
                      four_bar_model, PIN, sleigh)
from mechanisms import random_model
import numpy as np
import pytest

GAIN = 30.0
WRENCH = np.array([[3.0, -2.0, 4.0, 1.0, -0.5, 0.3]])  # N, N m


@cache
def four_bar_under_wrench():
    return Robot(four_bar_model(), constraints=[PIN], independent=['crank'],
                 friction=False, wrench_frames=('middle',))


@cache
def four_bar_case(t):
    """Return state, acceleration and projected wrench by the loop's vectors."""
    crank = 1.2 + 0.5 * math.sin(2.0 * t)
    rate = math.cos(2.0 * t)
    twice = -2.0 * math.sin(2.0 * t)
    q = four_bar('crank').closed_configuration((crank, 0.0, -1.5), fixed=['crank'])
    # Turning by q about -y moves x towards z: a bar of length l has the tip l (cos,
    # sin).
    absolute = np.cumsum(q)
    bars = np.array([0.3, 0.9, 0.7]) * np.array([-np.sin(absolute), np.cos(absolute)])
    J = np.cumsum(bars[:, ::-1], axis=1)[:, ::-1]  # of the loop's end
    T = np.array([1.0, *-np.linalg.solve(J[:, 1:], J[:, 0])])
    c = np.cos(absolute[1])
    s = np.sin(absolute[1])
    # By the coupler's angle.
    middle = np.array([-0.45 * s - 0.1 * c, 0.45 * c - 0.1 * s])
    velocity = (bars[:, 0] + middle) * T[0] + middle * T[1]
    force = WRENCH[0, [0, 2]]
    moment = -WRENCH[0, 4]
    return q, np.array([rate]), np.array([twice]), np.array(
        [force @ velocity + moment * (T[0] + T[1])])


def five_bar_case(t):
    """Return state, acceleration and projected wrench at the five-bar's left tip."""
    at = np.array([2.0 + 0.3 * math.sin(2.0 * t), 1.1 + 0.2 * math.cos(3.0 * t)])
    rate = np.array([0.6 * math.cos(2.0 * t), -0.6 * math.sin(3.0 * t)])
    twice = np.array([-1.2 * math.sin(2.0 * t), -1.8 * math.cos(3.0 * t)])
    q = five_bar_at(*at)
    T = five_bar_partial_rates(q)
    first = q[0]
    outer = q[0] + q[1]
    bar = ARM[1] * np.array([-np.sin(outer), np.cos(outer)])
    J = np.array([bar + ARM[0] * np.array([-np.sin(first), np.cos(first)]), bar]).T
    of_joints = J.T @ WRENCH[0, [0, 2]] - WRENCH[0, 4]
    return q, rate, twice, T[:2].T @ of_joints


def sleigh_case(t):
    """Return state, acceleration and projected wrench of a body on a runner."""
    turn = 0.4 * math.sin(2.0 * t)
    spin = 0.8 * math.cos(2.0 * t)
    x = 0.3 * t**2
    along = 0.6 * t
    faster = 0.6
    y = 0.0  # nothing depends on it
    T = np.array([[1.0, 0.0], [math.tan(turn), 0.0], [0.0, 1.0]])
    return (np.array([x, y, turn]), np.array([along, spin]),
            np.array([faster, -1.6 * math.sin(2.0 * t)]), T.T @ WRENCH[0, [0, 1, 5]])


@cache
def sleigh_under_wrench():
    names = sleigh().joint_names
    return Robot(sleigh().model, constraints=sleigh()._choices['constraints'],
                 independent=[names[0], names[2]], wrench_frames=('body',))


@cache
def chosen():
    model = random_model(5, 3)
    return Robot(model, speeds=absolute_rates(model), friction=False,
                 wrench_frames=('frame2',))


@cache
def chosen_motion():
    return (Motion.from_points([0.0, 1.0], [[0.1, -0.2, 0.3], [0.6, 0.4, -0.5]],
                               joint_names=chosen().joint_names),
            Robot(chosen().model, wrench_frames=('frame2',)))


@cache
def chosen_case(t):
    """Return state, acceleration and wrench of a tree in chosen speeds, by its rates."""
    robot = chosen()
    motion, tree = chosen_motion()

    def speeds(t):
        q, qdot, _ = motion.sample(t)
        Y = robot.mechanism.state(q).speed_rows(robot.speed_names)[0]
        return np.array(Y, dtype=float) @ qdot
    q = motion.sample(t)[0]
    h = 1e-4
    Y = np.array(robot.mechanism.state(q).speed_rows(robot.speed_names)[0], dtype=float)
    rate = (8.0 * (speeds(t + h) - speeds(t - h)) - speeds(t + 2 * h)
            + speeds(t - 2 * h))
    return q, speeds(t), rate / (12.0 * h), np.linalg.solve(
        Y.T, tree.external_force(q, wrench=WRENCH))


@cache
def flexible_under_wrench():
    linkage = flexible_four_bar()
    return Robot(linkage.model, constraints=linkage.mechanism.constraints,
                 independent=linkage.speed_names, wrench_frames=('coupler/tip',))


@cache
def flexible_case(t):
    """Return state, acceleration and the wrench on a bending coupler, by definition."""
    robot = flexible_under_wrench()
    size = np.array([0.5, 0.02, -0.01])
    rate = np.array([2.0, 5.0, 4.0])
    crank, *modes = np.array([1.2, 0.0, 0.0]) + size * np.sin(rate * t)
    q = robot.closed_configuration((crank, 0.0, *modes, -1.5), fixed=robot.speed_names)
    parts = nonholonomic.reduction(robot.mechanism, q, 0.0)
    T = parts.W[:, robot.mechanism.free] + parts.W[
        :, nonholonomic.dependent_places(robot.mechanism)] @ parts.A
    partials = kane.partial_velocities(robot.model, q, 'coupler/tip') @ T
    return (q, size * rate * np.cos(rate * t), -size * rate**2 * np.sin(rate * t),
            partials.T @ WRENCH[0])


CASES = {'flexible four-bar': (flexible_under_wrench, flexible_case),
         'four-bar': (four_bar_under_wrench, four_bar_case),
         'five-bar': (lambda: five_bar(wrench_frames=('left_tip',)), five_bar_case),
         'body on a runner': (sleigh_under_wrench, sleigh_case),
         'chosen speeds': (chosen, chosen_case)}


def estimate(robot, case, times):
    """Return the estimates at times along a motion under the wrench."""
    observer = MomentumObserver(robot, gain=GAIN)
    estimates = []
    for t in times:
        q, u, udot, _ = case(t)
        tau = robot.inverse_dynamics(q, u, udot, wrench=WRENCH)
        estimates.append(observer.update(t, q, u, tau))
    return np.array(estimates)


def filtered(case, times, n):
    """Return the projected wrench behind the low-pass, on a grid four times finer."""
    r = np.zeros(n)
    out = [np.zeros(n)]
    for start, end in pairwise(times):
        for a, b in pairwise(np.linspace(start, end, 5)):
            keep = math.exp(-GAIN * (b - a))
            r = keep * r + (1.0 - keep) * case(0.5 * (a + b))[3]
        out.append(r)
    return np.array(out)


@pytest.mark.parametrize('which', CASES)
def test_the_estimate_is_the_low_passed_projected_force_to_second_order(which):
    build, case = CASES[which]
    robot = build()
    coarse = 0.1 + 0.008 * np.arange(16)
    fine = 0.1 + 0.004 * np.arange(31)
    expected = filtered(case, coarse, robot.n)
    errors = [np.abs(estimated_torque - expected).max() for estimated_torque in (
        estimate(robot, case, coarse), estimate(robot, case, fine)[::2])]
    assert errors[0] < 0.01 * np.abs(expected).max()
    assert 3.0 < errors[0] / errors[1] < 5.5


def test_a_constant_wrench_at_rest_is_found_and_flags_a_collision():
    robot = four_bar_under_wrench()
    q, _, _, force = four_bar_case(0.3)
    observer = MomentumObserver(robot, gain=GAIN)
    detector = CollisionDetector(robot.speed_names, 0.5 * np.abs(force), confirm=0.01)
    none = np.zeros(1)
    for k in range(101):
        estimate = observer.update(0.004 * k, q, none, robot.inverse_dynamics(
            q, none, none, wrench=WRENCH))
        detector.update(0.004 * k, estimate)
    np.testing.assert_allclose(estimate, force * -math.expm1(-GAIN * 0.4), rtol=1e-9)
    assert detector.collision
    assert detector.joint == 'crank'


def test_a_state_that_violates_the_constraints_is_refused_and_restarts():
    robot = four_bar_under_wrench()
    observer = MomentumObserver(robot, gain=GAIN)
    q, u, _, _ = four_bar_case(0.3)
    for t in (0.0, 0.01):
        assert observer.update(t, q, u, [1.0]) is not None
    assert observer.torque.any()
    with pytest.raises(ConstraintError, match='residual'):
        observer.update(0.02, q + 0.1, u, [1.0])
    assert not observer.torque.any()
    with pytest.raises(InputError, match=r'q: shape \(1,\); expected \(3,\)'):
        observer.update(0.03, [0.0], u, [1.0])
    with pytest.raises(InputError, match="gain of joint 'crank': 0"):
        MomentumObserver(robot, gain=0.0)
