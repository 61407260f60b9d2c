"""Payloads of arms whose friction has bristles: deflections, masses, first rows."""

from dataclasses import replace
import math

from kane_dynamics import (absolute_rates, Inertial, InputError, ModelBuilder, Robot,
                           rod, simulate)
from kane_dynamics.identification import identify_payload, PayloadEstimator, Recording
from kane_dynamics.identification.payload.bristle_path import BristlePath
from kane_dynamics.identification.presliding import dahl_friction
from kane_dynamics.model.model import with_payload
from kinds_of_mechanism import case, KINDS
import numpy as np
import pytest

DAHL = {'friction': 3.0, 'presliding_stiffness': 60.0, 'damping': 0.2}
LUGRE = {**DAHL, 'breakaway_friction': 4.0, 'stribeck_speed': 0.2,
         'presliding_damping': 0.5}
LOADED = {**DAHL, 'load_friction': 0.1}
LOAD = Inertial(1.5, (0.1, 0.02, 0.05), 0.005 * np.eye(3))
STEP = 2e-3


def hinges(law):
    """Return two hinges in a vertical plane with bristle friction and a tool."""
    builder = ModelBuilder('hinges')
    builder.body('upper', axis=(0, -1, 0), inertial=rod(2.0, (0, 0, 0), (0.5, 0, 0)),
                 **law)
    builder.body('fore', 'upper', axis=(0, -1, 0), at=(0.5, 0, 0),
                 inertial=rod(1.0, (0, 0, 0), (0.4, 0, 0)), **law)
    builder.frame('tool', 'fore', at=(0.4, 0, 0))
    return builder.model()


def reversing(robot, duration=6.0):
    """Return a simulation of an arm with many reversals, while it holds its weight."""
    def torque(t, q, u):
        pull = np.array([9.0 * math.sin(5.0 * t), 7.0 * math.sin(8.0 * t)])
        held = robot.gravity_force(q) + robot.generalized_force(pull, q)
        return held + 20.0 * (robot.generalized_force(np.array([0.5, -0.5]) - q, q))
    return simulate(robot, np.array([0.3, -0.5]), np.zeros(2), duration,
                    torque=torque, step=STEP)


def without_memory(model):
    """Return the model with smooth friction in place of bristles."""
    bodies = []
    for body in model.bodies:
        joint = replace(body.joint, presliding_stiffness=0.0, presliding_damping=0.0)
        bodies.append(replace(body, joint=joint))
    return replace(model, bodies=tuple(bodies))


@pytest.mark.parametrize('law', [DAHL, LUGRE, LOADED])
@pytest.mark.parametrize('options', [{}, {'speeds': absolute_rates}])
def test_the_bristles_of_a_simulation_are_within_bounds_that_meet(law, options):
    robot = Robot(with_payload(hinges(law), 'tool', LOAD), **options)
    run = reversing(robot)
    path = BristlePath(Robot(hinges(law), **options))
    bounds = path.along(run.q, run.u, run.tau, run.t).bounds
    length = 4.0 / 60.0
    apart = bounds[:, 1] - bounds[:, 0]
    assert (apart[0] >= 2.0 * 3.0 / 60.0).all()
    assert apart[-1].max() < 1e-6 * length
    # The payload is in none of them: torques and motion determine the deflections.
    error = 0.02 * length
    assert (bounds[:, 0] < run.bristles + error).all()
    assert (run.bristles < bounds[:, 1] + error).all()
    assert np.abs(run.bristles).max() > 0.7 * 3.0 / 60.0


def test_deflections_by_dahls_law_are_its_closed_form_along_positions():
    model = hinges({**DAHL, 'damping': 0.0})
    robot = Robot(model)
    t = np.arange(0.0, 3.0, 0.004)
    q = np.column_stack([0.3 * np.sin(4.0 * t), 0.2 * np.sin(7.0 * t + 0.4)])
    u = np.gradient(q, t, axis=0)
    bristled = BristlePath(robot).along(q, u, np.zeros_like(q), t)
    expected = 3.0 * dahl_friction(q, [3.0 / 60.0])[:, 0]
    # Both begin in the middle.
    np.testing.assert_allclose(bristled.friction, expected, atol=1e-12)
    assert bristled.unknown[0] == pytest.approx([3.0, 3.0])


@pytest.mark.parametrize('law', [DAHL, LUGRE, LOADED])
@pytest.mark.parametrize('options', [{}, {'speeds': absolute_rates}])
def test_the_payload_is_found_through_reversals_of_presliding_friction(law, options):
    run = reversing(Robot(with_payload(hinges(law), 'tool', LOAD), **options))

    def estimate(model):
        estimator = PayloadEstimator(Robot(model, **options), 'tool', np.full(2, 0.05))
        for row in zip(run.q, run.u, run.udot, run.tau):
            estimator.update(*row)
        return estimator
    payload = estimate(hinges(law))
    error = abs(payload.mass - LOAD.mass)
    assert error < min(0.01, 4.0 * payload.mass_deviation)
    # Smooth friction is wrong after each reversal.
    assert error < 0.03 * abs(estimate(without_memory(hinges(law))).mass - LOAD.mass)


@pytest.mark.parametrize('law', [DAHL, LUGRE, LOADED])
def test_a_recording_with_presliding_friction_weighs_the_payload(law):
    run = reversing(Robot(with_payload(hinges(law), 'tool', LOAD)))
    recording = Recording(run.t, run.q, run.u, run.udot, run.tau)
    payload = identify_payload(hinges(law), recording, 'tool')
    smooth = identify_payload(without_memory(hinges(law)), recording, 'tool')
    assert abs(payload.inertial.mass - LOAD.mass) < 0.01
    assert (payload.held_out < 0.1 * smooth.held_out).all()


@pytest.mark.parametrize('kind', [kind for kind in KINDS if kind != 'flexible'])
def test_bristles_of_every_kind_leave_nothing_of_a_simulation(kind):
    smooth = case(kind)
    bodies = []
    for body in smooth.robot.model.bodies:
        bodies.append(replace(body, joint=replace(body.joint, friction=0.5,
                                                  presliding_stiffness=20.0)))
    robot = Robot(replace(smooth.robot.model, bodies=tuple(bodies)),
                  **smooth.robot.options)
    run = simulate(robot, smooth.q, smooth.u, 1.0, step=1e-3, t0=smooth.time)
    path = BristlePath(robot)
    state = None
    for k in range(len(run.t)):
        state = path.after(state, run.q[k], run.u[k], run.tau[k], run.t[k])
        middle = 0.5 * (state.bounds[0] + state.bounds[1])
        apart = 0.5 * (state.bounds[1] - state.bounds[0])
        assert (np.abs(run.bristles[k] - middle) <= apart + 1e-4).all()


def test_an_estimator_forgets_bristles_at_a_reset_and_keeps_them_at_a_false_sample():
    robot = Robot(hinges(DAHL))
    run = reversing(robot, 1.0)
    estimator = PayloadEstimator(robot, 'tool', np.full(2, 0.05))
    rows = list(zip(run.q, run.u, run.udot, run.tau))
    for row in rows:
        estimator.update(*row)
    bristles_before = estimator._bristled
    with pytest.raises(InputError):
        estimator.update(run.q[0], run.u[0], run.u[0], np.full(2, 1e300))
    assert estimator._bristled is bristles_before
    estimator.reset()
    assert estimator._bristled is None
    estimator.update(*rows[0])
    np.testing.assert_allclose(estimator._bristled.bounds,
                               [[-0.05, -0.05], [0.05, 0.05]])
