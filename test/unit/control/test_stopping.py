"""An arm whose state is not measured any more stops by its model, without feedback."""

from kane_dynamics import Controller, ModelBuilder, Robot, rod, simulate, Terms
from kinds_of_mechanism import case
import numpy as np
import pytest

# s
ELAPSED = 0.05
DURATION = 0.25


@pytest.mark.parametrize('kind',
                         ['tree', 'chosen speeds', 'closed loop', 'time-dependent'])
def test_the_stop_begins_where_a_simulation_is_and_ends_at_rest(kind):
    one = case(kind)
    robot = one.robot
    controller = Controller(robot)
    force = robot.inverse_dynamics(one.q, one.u, 0.3 * one.udot, **one.t) + 0.5
    tau = robot.joint_torques(force, one.q, **one.t)
    stop = controller.stopping_motion(one.q, one.u, tau, ELAPSED, DURATION, one.time)
    run = simulate(robot, one.q, one.u, ELAPSED,
                   t0=one.time, step=ELAPSED / 100, torque=force)
    places = [robot.coordinate_names.index(name) for name in stop.joint_names]
    change = np.abs(run.q[-1] - one.q)[places].max()
    assert change > 5e-3
    np.testing.assert_allclose(stop.positions[0], run.q[-1][places], atol=0.06 * change)
    time = {'t': one.time + ELAPSED} if one.t else {}
    rates = robot.joint_rates(run.q[-1], run.u[-1], **time)[places]
    _, speeds, udot = stop.sample(0.0)
    # Friction is of first order in the time.
    np.testing.assert_allclose(speeds, rates, atol=0.1 * max(np.abs(rates).max(), 1.0))
    assert not udot.any()
    q, u, udot = stop.sample(DURATION)
    assert not u.any() and not udot.any()
    np.testing.assert_allclose(q, stop.positions[0] + 0.5 * DURATION * speeds,
                               atol=1e-12)


@pytest.mark.parametrize('kind',
                         ['tree', 'chosen speeds', 'closed loop', 'time-dependent'])
def test_a_prediction_follows_a_simulation_under_changing_torques(kind):
    one = case(kind)
    robot = one.robot
    controller = Controller(robot, mode='computed_torque')
    q, u = true_q, true_u = one.q, one.u
    force = robot.inverse_dynamics(q, u, 0.3 * one.udot, **one.t)
    for k in range(20):
        t = one.time + 0.01 * k
        force = 0.95 * force + 0.1
        time = {'t': t} if one.t else {}
        tau = robot.joint_torques(force, q, **time)
        q, u = controller.predicted_state(q, u, tau, 0.01, t)
        run = simulate(
            robot, true_q, true_u, 0.01, t0=t, step=1e-3,
            torque=lambda t, q, u, tau=tau, time=time: robot.generalized_force(
                tau, q, **time))
        true_q = run.q[-1]
        true_u = run.u[-1]
    moved = np.abs(true_q - one.q).max()
    assert moved > 0.1
    # Friction is of first order in the step of the prediction.
    np.testing.assert_allclose(q, true_q, atol=0.01 * moved)
    np.testing.assert_allclose(u, true_u, atol=0.01 * np.abs(true_u).max())


def light_joint():
    """Return a robot with a wrist that friction would stop in a tenth of the time."""
    b = ModelBuilder('arm')
    b.body('upper', axis=(0, 1, 0), inertial=rod(4.0, (0, 0, 0), (0.5, 0, 0)),
           damping=0.1)
    b.body('wrist', 'upper', axis=(0, 0, 1), at=(0.5, 0, 0), friction=2.0,
           inertial=rod(0.1, (0, 0, 0), (0.1, 0, 0)))
    return Robot(b.model())


@pytest.mark.parametrize('speed', [0.0, 0.2, 0.6])
def test_friction_brings_a_light_joint_to_rest_and_does_not_turn_it_over(speed):
    robot = light_joint()
    controller = Controller(robot)
    q = np.array([0.3, 0.2])
    u = np.array([0.5, speed])
    without = robot.inverse_dynamics(q, np.array([0.5, 0.0]), np.zeros(2))
    stop = controller.stopping_motion(q, u, without, ELAPSED, DURATION)
    assert -1e-3 < stop.sample(0.0)[1][1] <= max(0.2 * speed, 1e-3)
    # Under the torque that overcomes friction it goes on at its speed.
    holding = robot.inverse_dynamics(q, u, np.zeros(2))
    stop = controller.stopping_motion(q, u, holding, ELAPSED, DURATION)
    assert stop.sample(0.0)[1][1] == pytest.approx(speed, abs=0.02)


@pytest.mark.parametrize('terms',
                         [Terms(gravity=False), Terms(gravity=False, friction=False)])
def test_the_arm_adds_what_commands_leave_out(terms):
    robot = light_joint()
    q = np.array([0.3, 0.2])
    u = np.array([0.5, 0.4])
    whole = robot.inverse_dynamics(q, u, np.array([1.0, 0.5]))
    rows = robot.torque_terms(q, u, np.zeros(2))
    stops = []
    for compensate, tau in ((Terms(), whole),
                            (terms, whole - (1.0 - terms.weights) @ rows)):
        stops.append(Controller(robot, compensate=compensate).stopping_motion(
            q, u, tau, 1e-3, DURATION))
    np.testing.assert_allclose(stops[1].positions[0], stops[0].positions[0], atol=2e-5)
    np.testing.assert_allclose(stops[1].sample(0.0)[1], stops[0].sample(0.0)[1],
                               atol=2e-2)
