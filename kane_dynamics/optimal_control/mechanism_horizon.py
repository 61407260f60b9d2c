"""The functions of a horizon for robots of every kind, over any scalar."""

from typing import Any

from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.linear_solve import solution
from kane_dynamics.mechanics.ball_joints import chord, coordinate_rates, joint_speeds
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.integrators.mechanism_step import MechanismStep, solved
from kane_dynamics.native.tracing.differentiation import forward, jacobian
from kane_dynamics.native.tracing.subroutine import Subroutines
from kane_dynamics.optimal_control.backward_step import (backward_step, expansion, Policy,
                                                         symmetric, TorqueCost)
from kane_dynamics.optimal_control.horizon_layout import Constants, Sizes
from kane_dynamics.optimal_control.stage_cost import cost_slopes, stage_cost
from kane_dynamics.robot.robot import Robot
import numpy as np

CLOSED = 1e-9  # rad, or lengths of the mechanism: a step that leaves more open is not accepted


class MechanismHorizon:
    """
    Step, derivatives and policy of a robot, in the interface of `HorizonKernels`.

    The state is q, u and the time. A change of it has the n_p directions of the configuration
    (`MechanismStep.tangent`), along independent speeds where loops close, and the n speeds. The
    slopes of an interval are dx+ = F (dx, dtau), by the equations that define the step (implicit
    differentiation), then gradient and Hessian of the cost by the state at the end, and by the
    torques. The targets are the configuration, the rates of the joints, and the torques.
    """

    linearization = 'state after target weight'
    policy = 'slopes tau later'

    def __init__(self, robot: Robot, actuators: list[int]) -> None:
        """Store the equations; `actuators` are the indices of the joints with actuators."""
        equations = robot.equations
        if not isinstance(equations, ConstrainedEquations):
            equations = ConstrainedEquations(equations, Mechanism(robot.model))
        self._equations, self._physical = equations, robot.parameters.physical
        self._step = MechanismStep(equations, actuators)
        n_q, n, n_j, m = robot.n_q, robot.n, robot.model.n, len(actuators)
        x = self._step.directions + n
        self._ends = np.cumsum([n_q, n])
        self._target_ends = np.cumsum([n_q, n_j])
        self._slope_ends = np.cumsum([x * (x + m), x, m, x * (x + 1) // 2])
        self.sizes = Sizes(
            state=n_q + n + 1, directions=x, torques=m, joints=n_j,
            multipliers=self._step.held, target=n_q + n_j + m,
            slopes=int(self._slope_ends[-1]) + m)

    def _parts(self, state: Any) -> tuple[Any, Any, Any]:
        """Return q, u and t."""
        q, u, t = np.split(state, self._ends)
        return q, u, t[0]

    def step(self, state: Any, tau: Any, target: Any, weight: Any,
             constants: Constants) -> tuple[Any, Any, Any]:
        """
        Return the state at the end of an interval, what closes the loops, and the cost.

        The cost is not a number where loops do not close or are singular.
        """
        (q, u, t), h, step = self._parts(state), constants.h, self._step
        parameters, limits = np.split(constants.parameters, [self._physical])
        q, u, found = step.step(q, u, tau, t, h, parameters)
        away, rates = self._away(q, u, tau, t + h, target)
        cost = stage_cost(away, rates, weight, constants.limits)
        if step.held:
            residual = step.residual(q, t + h) / step.residual_units
            cost = select(residual @ residual < CLOSED**2, cost, np.nan)
        if self._equations.watched:
            cost = select(self._equations.margin(q, t + h, limits) > 0.0, cost, np.nan)
        return np.concatenate([q, u, [t + h]]), found, cost

    def _away(self, q: Any, u: Any, tau: Any, t: Any, target: Any) -> tuple[Any, Any]:
        """Return positions, rates and torques minus their targets, and the rates."""
        rates = self._equations.joint_speeds(q, u, t)
        q_0, rates_0, tau_0 = np.split(target, self._target_ends)
        return np.concatenate([chord(self._equations.model, q_0, q), rates - rates_0,
                               tau - tau_0]), rates

    def change(self, state: Any, nominal: Any) -> Any:
        """Return the change of the state from another one, (n_x,)."""
        (q, u, _), (q_0, u_0, t) = self._parts(state), self._parts(nominal)
        along = self._step.along(q_0, t)
        return np.concatenate([along @ chord(self._equations.model, q_0, q), u - u_0])

    def slopes_of(self, state: Any, after: Any, target: Any, weight: Any,
                  constants: Constants) -> Any:
        """Return the derivatives of an interval and of its cost."""
        size, m = self.sizes.state, self.sizes.torques
        end, tau, found, _ = np.split(after, [size, size + m, len(after) - 1])
        F = self._derivatives(state, end, tau, found, constants)
        L, away, rates = self._cost_derivatives(end, tau, target)
        gradient, hessian = cost_slopes(away, rates, weight, constants.limits)
        n_y = len(L)
        H = L.T @ (hessian[:n_y, None] * L)
        x = range(self.sizes.directions)
        return np.concatenate([F.ravel(), gradient[:n_y] @ L, gradient[n_y:],
                               [H[a, b] for a in x for b in range(a + 1)], hessian[n_y:]])

    def _derivatives(self, state: Any, end: Any, tau: Any, found: Any,
                     constants: Constants) -> Any:
        """
        Return the derivatives of a step, (n_x, n_x + m).

        The step is `excess` = 0 for u+, and the residuals of `moved` = 0 for lambda.
        """
        (q, u, t), (q_1, w, t_1), h, step = (
            self._parts(state), self._parts(end), constants.h, self._step)
        n_q, n, n_p, model = len(q), len(u), self._step.directions, self._equations.model
        share, m, held = Subroutines(), len(tau), len(found)
        parameters = constants.parameters[:self._physical]
        G = self._directions(q, t)

        excess = step.excess(q, u, tau, w, t, h, parameters)
        by_q, by_u, by_w, by_tau = np.split(
            jacobian(excess, [*q, *u, *w, *tau], share), np.cumsum([n_q, n, n]), axis=1)
        dw = -solved(by_w, np.concatenate([by_q @ G.T, by_u, by_tau], axis=1))

        moved = step.moved(q, w, found, t, h)
        outputs = [*moved, *(step.residual(moved, t + h) if held else ())]
        tangents = np.zeros((n_p + n + held, n_q + n + held)).astype(object)
        tangents[:n_p, :n_q] = G
        tangents[n_p:, n_q:] = np.eye(n + held)
        columns = np.array([forward(outputs, [*q, *w, *found], row, share) for row in tangents],
                           dtype=object).T
        none = np.zeros((len(outputs), n + m))
        total = np.concatenate([columns[:, :n_p], none], axis=1) + columns[:, n_p:n_p + n] @ dw
        if held:
            by_found = columns[:, n_p + n:]
            total = total - by_found @ solution(by_found[n_q:], total[n_q:])
        speeds = joint_speeds(model, q_1, total[:n_q].T).T
        return np.concatenate([step.along(q_1, t_1) @ speeds, dw])

    def _cost_derivatives(self, end: Any, tau: Any, target: Any) -> tuple[Any, Any, Any]:
        """Return d(positions, rates)/dx, (2 n_j, n_x), and the results of `_away`."""
        q, u, t = self._parts(end)
        away, rates = self._away(q, u, tau, t, target)
        G, n = self._directions(q, t), len(u)
        tangents = np.zeros((len(G) + n, len(q) + n)).astype(object)
        tangents[:len(G), :len(q)] = G
        tangents[len(G):, len(q):] = np.eye(n)
        share = Subroutines()
        L = np.array([forward(away[:2 * len(rates)], [*q, *u], row, share) for row in tangents],
                     dtype=object).T
        return L, away, rates

    def _directions(self, q: Any, t: Any) -> Any:
        """Return q' in each direction of the configuration, (n_p, n_q)."""
        model = self._equations.model
        return np.array([coordinate_rates(model, q, column)
                         for column in self._step.tangent(q, t).T], dtype=object)

    def policy_of(self, slopes: Any, tau: Any, v: Any, V: Any, constants: Constants) -> Policy:
        """Return the policy of an interval; v and V are the cost-to-go at its end."""
        x, (F, by_x, by_tau, of_x, of_tau) = (self.sizes.directions,
                                              np.split(slopes, self._slope_ends))
        before = expansion(F.reshape(x, -1), v + by_x, symmetric(V + of_x, x))
        lowest, highest, *_ = constants.limits
        return backward_step(before, TorqueCost(tau, by_tau, of_tau, lowest, highest),
                             constants.regular * of_tau)
