"""
Callers may reuse arrays that they pass, and change those that they get.

Each scenario runs twice. In the second run, all arrays of a call, arguments and
results, are overwritten before the next call. Each `yield` ends a call.
"""

from degenerate_input import arm, pose, Q, TAU, U, UDOT
from kane_dynamics import (CartesianImpedance, ComputedTorque, Controller,
                           FrictionError, HandGuiding, HybridForce, JointImpedance,
                           MomentumObserver, Motion,
                           OperationalSpace, PoseFilter,
                           Robot, simulate)
from kane_dynamics.identification import PayloadEstimator
from kane_dynamics.optimal_control import PredictiveController, TrajectoryOptimizer
from kinds_of_mechanism import case
import numpy as np
import pytest

CYCLES = 4
STEP = 0.01  # s


class Caller:
    """Keeps the arrays of a call, and overwrites them after it."""

    def __init__(self):
        self.arrays = []

    def give(self, values):
        """Return an array of numbers that does not stay."""
        array = np.array(values, dtype=float)
        self.arrays.append(array)
        return array

    def overwrite(self, result):
        """Overwrite all arrays of the last call."""
        if isinstance(result, np.ndarray) and result.flags.writeable:
            self.arrays.append(result)
        for array in self.arrays:
            array[...] = np.nan
        self.arrays = []


def results_of(scenario, overwritten):
    """Return the results of the calls of a scenario."""
    caller = Caller()
    results = []
    for result in scenario(caller.give):
        if result is not None:
            results.append(np.array(result))
        if overwritten:
            caller.overwrite(result)
    return np.concatenate([np.ravel(x) for x in results])


def observer(give):
    """Observe with a friction error that is learned, and with held torques."""
    error = FrictionError(arm().joint_names, coulomb=give([0.1, 0.2]),
                          damping=give([0.1, 0.3]), offset=give([0.2, -0.1]), memory=1.0)
    yield
    law = MomentumObserver(arm(), gain=give([20.0, 30.0]), held=True,
                           friction_error=error)
    yield
    for k in range(CYCLES):
        yield law.update(k * STEP, give(Q + k * STEP * U), give(U), give(TAU))
        yield law.hold(give(TAU + k))
        yield law.torque


def controller(give):
    """Command along a motion, with limits."""
    motion = Motion.from_points(give([0.0, 1.0]), give([[0.0, 0.1], [0.4, -0.3]]),
                                joint_names=arm().joint_names)
    yield
    law = Controller(arm(), mode='computed_torque', kp=give([20.0, 30.0]),
                     kd=give([3.0, 4.0]), rate_limit=give([100.0, 200.0]))
    yield
    for k in range(CYCLES):
        yield law.command(k * STEP, give(Q), give(U), motion, external=give(TAU)).tau


def joint_impedance(give):
    """Command joints as springs."""
    law = JointImpedance(arm(), stiffness=give([10.0, 20.0]), damping=give([1.0, 2.0]))
    yield
    yield law.torque(give(Q), give(U), give(Q + 0.1))
    yield law.torque(give(Q), give(U), give(Q + 0.2))


def impedance_of_frame(give):
    """Command a frame as a spring."""
    law = CartesianImpedance(arm(), 'tip', stiffness=give([100.0] * 6),
                             posture=give(Q), posture_stiffness=give([1.0, 2.0]))
    yield
    yield law.torque(give(Q), give(U), give(pose()), give(np.ones(6)))
    yield law.torque(give(Q + 0.1), give(U), give(pose()))


def operational_space(give):
    """Command the acceleration of a frame."""
    law = OperationalSpace(arm(), 'tip', directions=('x', 'y'),
                           kp=give(np.arange(1.0, 7.0)))
    yield
    yield law.torque(give(Q), give(U), give(pose()))
    yield law.torque(give(Q + 0.1), give(U), give(pose()))


def hybrid_force(give):
    """Command a force, whose error is integrated."""
    law = HybridForce(arm(), 'tip', force_directions=('x',), stiffness=give([100.0] * 6))
    yield
    for k in range(CYCLES):
        yield law.torque(give(Q), give(U), give(pose()), wrench=give(np.ones(6)),
                         measured=give(np.full(6, 0.1 * k)), elapsed=STEP)


def hand_guiding(give):
    """Guide an arm by hand before a wall."""
    law = HandGuiding(arm(), frame='tip', damping=give([1.0, 2.0]),
                      planes=give([[0.0, 1.0, 0.0, -0.2]]))
    yield
    yield law.torque(give(Q), give(U))
    yield law.torque(give(Q + 0.1), give(U))


def pose_filter(give):
    """Filter poses."""
    law = PoseFilter(linear_speed=1.0, angular_speed=1.0, linear_acceleration=2.0,
                     angular_acceleration=2.0)
    yield law.reset(give(pose()))
    for _ in range(CYCLES):
        yield law.step(give(pose(0.5)), STEP).pose


def predictive_control(give):
    """Control with an estimated disturbance, and optimize with a stated one."""
    problem = TrajectoryOptimizer(arm(), nodes=4, interval=0.05,
                                  torque_limits=give([50.0, 40.0]))
    yield problem.set_target(give([0.2, 0.1]))
    yield problem.set_disturbance(give([0.5, 0.2]))
    yield problem.start(give([1.0, 2.0]))
    yield problem.solve(give(Q), give(U)).tau
    yield problem.solve(give(Q), give(U)).tau
    law = PredictiveController(problem, disturbance_gain=0.5)
    yield law.set_target(give([0.3, 0.1]))
    for k in range(CYCLES):
        yield law.torque(give(Q + k * STEP), give(U), STEP)


def payload(give):
    """Estimate a payload."""
    law = PayloadEstimator(arm(), 'tip', give([0.1, 0.2]))
    yield
    for k in range(20):
        yield law.update(give(Q + 0.1 * k), give(U), give(UDOT), give(TAU + k))
    yield law.covariance
    yield law.update(give(Q), give(U), give(UDOT), give(TAU))
    yield np.array([law.mass])


def simulation(give):
    """Simulate with torques of a function and of a law."""
    yield simulate(arm(), give(Q), give(U), STEP, torque=give([1.0, 2.0])).q
    yield simulate(arm(), give(Q), give(U), STEP,
                   torque=lambda t, q, u: give([1.0, t])).q
    motion = Motion.from_points([0.0, 1.0], [Q, Q + 0.1], joint_names=arm().joint_names)
    law = ComputedTorque(arm(), motion, give([10.0, 20.0]), give([1.0, 2.0]))
    yield
    yield simulate(arm(), give(Q), give(U), STEP, torque=law).q


SCENARIOS = (observer, controller, joint_impedance, impedance_of_frame,
             operational_space, hybrid_force, hand_guiding, pose_filter,
             predictive_control, payload, simulation)


@pytest.mark.parametrize('scenario', SCENARIOS, ids=lambda scenario: scenario.__name__)
def test_later_results_do_not_depend_on_arrays_of_earlier_calls(scenario):
    expected = results_of(scenario, overwritten=False)
    assert np.isfinite(expected).all()
    np.testing.assert_array_equal(results_of(scenario, overwritten=True), expected)


def test_the_configuration_of_a_robot_stays():
    one = case('closed loop')
    q = one.q.copy()
    robot = Robot(one.robot.model, **one.robot.options | {'configuration': q})
    q[:] = 0.0
    np.testing.assert_array_equal(robot.configuration, one.q)
    assert not robot.configuration.flags.writeable
