"""Optimal torques of robots of every kind: derivatives, optimality, loops, limits, replays."""

from functools import cache

from kane_dynamics import (absolute_rates, box, Closure, InputError, load_urdf, ModelBuilder,
                           Robot, rod, simulate)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.ball_joints import coordinate_rates, difference, moved
from kane_dynamics.mechanics.integrators.mechanism_step import MechanismStep
from kane_dynamics.optimal_control import CostWeights, PredictiveController, TrajectoryOptimizer
from kinds_of_mechanism import case, KINDS
from linkages import four_bar_model, PIN, sleigh
import numpy as np
from palletizer import palletizer, positions
import pytest

H = 0.01
SEVERAL = [*((kind,) for kind in KINDS[1:]), ('chosen speeds', 'closed loop'),
           ('closed loop', 'free and ball joints'), ('closed loop', 'flexible')]
each_kind = pytest.mark.parametrize('kinds', SEVERAL, ids=' and '.join)


@cache
def short(kinds):
    """Return an optimizer with one interval, and torques of moderate size."""
    this = case(*kinds)
    problem = TrajectoryOptimizer(this.robot, nodes=1, interval=H, weights=CostWeights(
        excess_speed=2.0), speed_limits=0.5)
    problem.set_target(this.q, this.time)
    return problem, np.linspace(-2.0, 3.0, len(problem.actuator_names))


def ended(kinds, q, u, tau):
    """Return the state after one interval."""
    problem, _ = short(kinds)
    problem.start(tau)
    found = problem.solve(q, u, iterations=0)
    return found.q[1], found.u[1], found.cost


def step_of(kinds):
    """Return the step in numbers."""
    return short(kinds)[0]._arrays._horizon._step


def directions(kinds, q, t):
    """Return joint speeds per unit of each direction of the configuration, and its inverse."""
    step = step_of(kinds)
    return (np.array(step.tangent(q, t), dtype=float), np.array(step.along(q, t), dtype=float))


@each_kind
def test_directions_of_the_configuration_keep_what_constraints_hold(kinds):
    this = case(*kinds)
    tangent, along = directions(kinds, this.q, this.time)
    np.testing.assert_allclose(along @ tangent, np.eye(len(along)), atol=1e-12)
    step, eps = step_of(kinds), 1e-6
    if step.held:
        for column in tangent.T:
            open_by = [np.array(step.residual(moved(this.robot.model, this.q, s * eps * column),
                                              this.time), dtype=float) for s in (1.0, -1.0)]
            assert np.abs(open_by[0] - open_by[1]).max() / (2.0 * eps) < 1e-8


@each_kind
def test_a_step_follows_its_equation(kinds):
    this = case(*kinds)
    problem, tau = short(kinds)
    robot, model = this.robot, this.robot.model
    q, u, _ = ended(kinds, this.q, this.u, tau)
    smooth = Robot(model, **{**robot.options, 'friction': False})
    places = [robot.joint_names.index(name) for name in problem.actuator_names]
    still = np.array(step_of(kinds).equations.joint_speeds(this.q, 0.0 * u, this.time), float)
    v = this.T @ u + still
    resisting = np.array(step_of(kinds).equations.tree.friction_force(v), dtype=float)
    for beam in (body.beam for body in model.bodies if body.beam is not None):
        resisting[list(beam.coordinates)] += H * beam.stiffness @ v[list(beam.coordinates)]
    needed = (smooth.inverse_dynamics(this.q, this.u, (u - this.u) / H, **this.t)
              + this.T.T @ resisting)
    np.testing.assert_allclose(needed, this.T[places].T @ tau, atol=1e-6)
    went = this.q + H * coordinate_rates(model, this.q, v)
    assert np.abs(difference(model, moved(model, this.q, H * v), q)).max() < 1e-3
    if not step_of(kinds).held and not model.balls:
        np.testing.assert_allclose(q, went, atol=1e-12)


@each_kind
def test_derivatives_of_a_step_are_those_of_central_differences(kinds):
    this = case(*kinds)
    problem, tau = short(kinds)
    model, arrays, eps = this.robot.model, problem._arrays, 1e-5
    q1, _, _ = ended(kinds, this.q, this.u, tau)
    arrays.linearize()
    x, m = arrays.sizes.directions, arrays.sizes.torques
    F, by_x, by_tau, _, _ = np.split(arrays.slopes[0], arrays._horizon._slope_ends)
    tangent, _ = directions(kinds, this.q, this.time)
    _, along = directions(kinds, q1, this.time + H)
    ways = [*((column, 0.0 * this.u, 0.0 * tau) for column in tangent.T),
            *((np.zeros(model.n), unit, 0.0 * tau) for unit in np.eye(this.robot.n)),
            *((np.zeros(model.n), 0.0 * this.u, unit) for unit in np.eye(m))]
    numeric, slopes = [], []
    for move, change, push in ways:
        (qp, up, cp), (qm, um, cm) = (ended(
            kinds, moved(model, this.q, s * move), this.u + s * change, tau + s * push)
            for s in (eps, -eps))
        numeric.append(np.concatenate([along @ difference(model, qm, qp), up - um]) / (2 * eps))
        slopes.append((cp - cm) / (2 * eps))
    numeric, F = np.array(numeric).T, F.reshape(x, x + m)
    np.testing.assert_allclose(F, numeric, rtol=0.0, atol=2e-6 * max(1.0, np.abs(F).max()))
    whole = by_x @ F + np.concatenate([np.zeros(x), by_tau])
    np.testing.assert_allclose(whole, slopes, rtol=0.0, atol=1e-5 * np.abs(whole).max())


def stationary(problem, q, u, solution, share=2e-5):
    """Fail unless the gradient of the cost vanishes, or presses the torques on their limits."""
    def cost(tau):
        problem.start(tau)
        return problem.solve(q, u, iterations=0).cost
    first = np.tile(problem.holding_torques(q), (problem.nodes, 1))

    def gradient(tau):
        eps = 1e-4 * np.maximum(1.0, np.abs(tau).max())
        found = np.zeros(tau.size)
        for k in range(tau.size):
            unit = eps * np.eye(tau.size)[k].reshape(tau.shape)
            found[k] = (cost(tau + unit) - cost(tau - unit)) / (2.0 * eps)
        return found.reshape(tau.shape)
    limits = problem.torque_limits
    inner = np.clip(solution.tau, -limits * (1 - 1e-9), limits * (1 - 1e-9))
    problem.torque_limits  # the kernels clip beyond: one-sided differences have half the slope
    scale, slope = np.abs(gradient(0.9 * first)).max(), gradient(inner)
    held = np.abs(solution.tau) >= limits
    assert np.abs(slope[~held]).max(initial=0.0) < share * scale, (slope, scale)
    assert (slope[held] * np.sign(solution.tau[held]) < 0.0).all()
    return int(held.sum())
