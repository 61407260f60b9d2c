"""
The functions of one interval of a horizon: step, cost, derivatives, policy.

All run over any scalar. The cost of an interval is 1/2 the sum of weight (value -
target)^2 over its m torques and the n_j joints' positions and rates at its end, plus 1/2
`speed_weight` excess^2 of every joint. The excess of a speed beyond a limit by v
(negative within it) is the smooth (v + sqrt(v^2 + w^2)) / 2, with the width w `WIDTH`
times the limit; a kink there costs many iterations.
"""

from typing import Any, NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.linear_solve import solution
from kane_dynamics.mechanics.ball_joints import chord, coordinate_rates, joint_speeds
from kane_dynamics.mechanics.friction import refuse_load_friction
from kane_dynamics.mechanics.integrators.mechanism_step import MechanismStep, solved
from kane_dynamics.native.tracing.differentiation import forward, jacobian
from kane_dynamics.native.tracing.subroutine import Subroutines
from kane_dynamics.optimal_control.backward_step import (backward_step, expansion,
                                                         from_triangle, lower_triangle,
                                                         Policy, TorqueCost)
from kane_dynamics.robot.robot import Robot
import numpy as np

NUMBERS = 3  # that begin the constants: interval, scale of the step, regularization
CLOSED = 1e-9  # rad, or lengths of the mechanism: largest residual after a step
WIDTH = 0.05  # of the smooth excess of a speed, relative to its limit
LEAST_WIDTH = 1e-9  # rad/s or m/s: that of a limit of 0
NO_LIMIT = 1e9  # rad/s or m/s: a limit beyond is none


class HorizonSizes(NamedTuple):
    """
    Sizes of the arrays of a horizon.

    Attributes
    ----------
    state, directions : int
        Of a state, and of a change of it, n_x.
    torques, joints : int
        Torques, m, and joints, n_j, whose positions and rates have costs.
    multipliers : int
        What closes the loops in an interval.
    target, slopes : int
        Of a target, and of the derivatives of an interval.

    """

    state: int
    directions: int
    torques: int
    joints: int
    multipliers: int
    target: int
    slopes: int

    @property
    def row(self) -> int:
        """Return the length of a row of the path."""
        return self.state + self.torques + self.multipliers + 1

    @property
    def policy(self) -> int:
        """Return the length of a row of the policy."""
        x = self.directions
        return int(self.policy_parts[-1]) + x * (x + 1) // 2

    @property
    def policy_parts(self) -> Any:
        """Return where the parts of `backward_step.Policy` end, but the last."""
        x = self.directions
        m = self.torques
        return np.cumsum([m, m * x, 1, 1, x])

    @property
    def limits(self) -> int:
        """Return the number of entries of `HorizonLimits`."""
        return 2 * (self.torques + self.joints)


class HorizonLimits(NamedTuple):
    """Bounds of torques, (m,); limits of rates and weights of their excess, (n_j,)."""

    lowest_torque: Vector
    highest_torque: Vector
    speed: Vector
    speed_weight: Vector


class Constants(NamedTuple):
    """Numbers that are the same in all intervals."""

    h: Scalar
    scale: Scalar
    limits: HorizonLimits
    parameters: Vector
    regular: Scalar


def constants_of(block: Vector, sizes: HorizonSizes) -> Constants:
    """Return the parts of the array of constants."""
    m = sizes.torques
    n = sizes.joints
    *limits, parameters = np.split(block[NUMBERS:], np.cumsum([m, m, n, n]))
    return Constants(block[0], block[1], HorizonLimits(*limits), parameters, block[2])


# -------------------------------------------------------------------------------------
# The cost of an interval.

def speed_excess(rates: Vector, limits: HorizonLimits) -> tuple[Matrix, Matrix]:
    """Return the excess above the upper and below the lower limit, and its slope."""
    excess = []
    slope = []
    for side in (1.0, -1.0):
        for rate, limit in zip(rates, limits.speed):
            # A smooth max(v, 0): (v + sqrt(v^2 + width^2)) / 2, whose slope is defined
            # everywhere.
            v = side * rate - limit
            width = WIDTH * limit
            root = np.sqrt(v * v + width * width + LEAST_WIDTH**2)
            is_limited = limit < NO_LIMIT
            excess.append(select(is_limited, side * 0.5 * (v + root), 0.0))
            slope.append(select(is_limited, 0.5 * (1.0 + v / root), 0.0))
    return np.reshape(excess, (2, -1)), np.reshape(slope, (2, -1))


def stage_cost(error: Vector, rates: Vector, weight: Vector,
               limits: HorizonLimits) -> Scalar:
    """
    Return the cost of one interval.

    Parameters
    ----------
    error : (2 n + m,) array
        Positions and rates of the joints at the end, and torques, minus their targets.
    rates : (n,) array
        Of the joints at the end.
    weight : (2 n + m,) array
        Of `error`.
    limits : HorizonLimits
        Limits of torques and speeds.

    """
    above, below = speed_excess(rates, limits)[0]
    squares = above * above + below * below
    return 0.5 * (weight @ (error * error) + limits.speed_weight @ squares)


def cost_slopes(error: Vector, rates: Vector, weight: Vector, limits: HorizonLimits
                ) -> tuple[Vector, Vector]:
    """
    Return the gradient of `stage_cost`, (2 n + m,), and the diagonal of its Hessian.

    They are by the positions and rates of the joints, and the torques. The Hessian is
    that of Gauss and Newton, never negative.
    """
    n = len(rates)
    excess, slope = speed_excess(rates, limits)
    by_rates = limits.speed_weight * (excess * slope).sum(axis=0)
    bend = limits.speed_weight * (slope * slope).sum(axis=0)
    # Positions and torques have no limits here.
    positions = np.zeros(n)
    torques = np.zeros(len(error) - 2 * n)
    gradient = weight * error + np.concatenate([positions, by_rates, torques])
    return gradient, weight + np.concatenate([positions, bend, torques])


# -------------------------------------------------------------------------------------
# Step, derivatives and policy of an interval.

class Horizon:
    """
    Step, derivatives and policy of a robot, in the interface of `HorizonKernels`.

    The state is q, u and the time. A change of it has the n_p directions of the
    configuration (`MechanismStep.tangent`), along independent speeds where loops close,
    and the n speeds. The slopes of an interval are dx+ = F (dx, dtau), by the equations
    that define the step (implicit differentiation), then gradient and Hessian of the
    cost by the state at the end, and by the torques. The targets are the configuration,
    the rates of the joints, and the torques.
    """

    def __init__(self, robot: Robot, actuators: list[int]) -> None:
        """Store the equations; `actuators` are indices of joints."""
        equations = robot.equations
        if robot.friction:
            refuse_load_friction(robot.model, 'optimal control')
        self._equations = equations
        self._physical = robot.parameters.physical
        self._step = MechanismStep(equations, actuators)

        # Sizes: coordinates, speeds, joints, torques, and directions of the state.
        n_q = robot.n_q
        n = robot.n
        n_j = robot.model.n
        m = len(actuators)
        x = self._step.directions + n
        # Where the parts of a state, of a target and of the slopes end in their rows.
        self._ends = np.cumsum([n_q, n])
        self._target_ends = np.cumsum([n_q, n_j])
        self._slope_ends = np.cumsum([x * (x + m), x, m, x * (x + 1) // 2])
        self.sizes = HorizonSizes(
            state=n_q + n + 1, directions=x, torques=m, joints=n_j,
            multipliers=self._step.held, target=n_q + n_j + m,
            slopes=int(self._slope_ends[-1]) + m)

    def _parts(self, state: Vector) -> tuple[Vector, Vector, Scalar]:
        """Return q, u and t."""
        q, u, t = np.split(state, self._ends)
        return q, u, t[0]

    def step(self, state: Vector, tau: Vector, target: Vector, weight: Vector,
             constants: Constants) -> tuple[Vector, Vector, Scalar]:
        """
        Return the state at the end of an interval, the loop multipliers, and the cost.

        The multipliers (lambda) are those of the corrections that close the loops. The cost
        is NaN where loops do not close or are singular.
        """
        q, u, t = self._parts(state)
        end_time = t + constants.h
        parameters, limits = np.split(constants.parameters, [self._physical])
        # The step, its cost, and what makes it invalid: open or singular loops.
        q, u, multipliers = self._step.step(q, u, tau, t, constants.h, parameters)
        error, rates = self._error(q, u, tau, end_time, target)
        # An invalid state has NaN as its cost, which the line search rejects.
        cost = stage_cost(error, rates, weight, constants.limits)
        if self._step.held:
            residual = self._step.residual(q, end_time) / self._step.residual_units
            cost = select(residual @ residual < CLOSED**2, cost, np.nan)
        if self._equations.watched:
            cost = select(self._equations.margin(q, end_time, limits) > 0.0, cost,
                          np.nan)
        return np.concatenate([q, u, [end_time]]), multipliers, cost

    def _error(self, q: Vector, u: Vector, tau: Vector, t: Scalar, target: Vector
               ) -> tuple[Vector, Vector]:
        """Return positions, rates and torques minus their targets, and the rates."""
        rates = self._equations.joint_speeds(q, u, t)
        q_target, rates_target, tau_target = np.split(target, self._target_ends)
        distance = chord(self._equations.model, q_target, q)
        return np.concatenate([distance, rates - rates_target, tau - tau_target]), rates

    def change(self, state: Vector, nominal: Vector) -> Vector:
        """Return the change of the state from another one, (n_x,)."""
        q, u, _ = self._parts(state)
        q_nominal, u_nominal, t = self._parts(nominal)
        along = self._step.along(q_nominal, t)
        distance = chord(self._equations.model, q_nominal, q)
        return np.concatenate([along @ distance, u - u_nominal])

    def slopes_of(self, state: Vector, after: Vector, target: Vector, weight: Vector,
                  constants: Constants) -> Vector:
        """Return the derivatives of an interval and of its cost."""
        size = self.sizes.state
        m = self.sizes.torques
        end, tau, multipliers, _ = np.split(after, [size, size + m, len(after) - 1])
        F = self._derivatives(state, end, tau, multipliers, constants)
        L, error, rates = self._cost_derivatives(end, tau, target)
        gradient, hessian = cost_slopes(error, rates, weight, constants.limits)
        # By the state through L, and by the torques.
        n_y = len(L)
        H = L.T @ (hessian[:n_y, None] * L)
        triangle = [H[a, b] for a, b in lower_triangle(self.sizes.directions)]
        return np.concatenate([F.ravel(), gradient[:n_y] @ L, gradient[n_y:], triangle,
                               hessian[n_y:]])

    def _derivatives(self, state: Vector, end: Vector, tau: Vector, multipliers: Vector,
                     constants: Constants) -> Matrix:
        """
        Return the derivatives of a step, (n_x, n_x + m).

        The step is `excess` = 0 for w = u+, and the residuals of `moved` = 0 for the
        multipliers that close the loops.
        """
        step = self._step
        model = self._equations.model
        share = Subroutines()
        q, u, t = self._parts(state)
        q_end, w, t_end = self._parts(end)
        h = constants.h
        n_q = len(q)
        n = len(u)
        n_p = step.directions
        m = len(tau)
        held = len(multipliers)
        parameters = constants.parameters[:self._physical]
        G = self._directions(q, t)

        # dw by the directions of the configuration, the speeds and the torques.
        excess = step.excess(q, u, tau, w, t, h, parameters)
        by_all = jacobian(excess, [*q, *u, *w, *tau], share)
        by_q, by_u, by_w, by_tau = np.split(by_all, np.cumsum([n_q, n, n]), axis=1)
        dw = -solved(by_w, np.concatenate([by_q @ G.T, by_u, by_tau], axis=1))

        # The configuration at the end by the directions, w and the multipliers.
        moved = step.moved(q, w, multipliers, t, h)
        outputs = [*moved]
        if held:
            outputs += [*step.residual(moved, t + h)]
        tangents = np.zeros((n_p + n + held, n_q + n + held)).astype(object)
        tangents[:n_p, :n_q] = G
        tangents[n_p:, n_q:] = np.eye(n + held)
        columns = _forward_columns(outputs, [*q, *w, *multipliers], tangents, share)
        by_directions = columns[:, :n_p]
        by_speeds = columns[:, n_p:n_p + n]
        by_multipliers = columns[:, n_p + n:]
        none = np.zeros((len(outputs), n + m))
        total = np.concatenate([by_directions, none], axis=1) + by_speeds @ dw
        if held:  # the multipliers change so that the residuals stay 0
            change = solution(by_multipliers[n_q:], total[n_q:])
            total = total - by_multipliers @ change
        speeds = joint_speeds(model, q_end, total[:n_q].T).T
        return np.concatenate([step.along(q_end, t_end) @ speeds, dw])

    def _cost_derivatives(self, end: Vector, tau: Vector, target: Vector
                          ) -> tuple[Matrix, Vector, Vector]:
        """Return d(positions, rates)/dx, (2 n_j, n_x), and the results of `_error`."""
        q, u, t = self._parts(end)
        error, rates = self._error(q, u, tau, t, target)
        # Positions change along the directions of the configuration, rates by
        # themselves.
        G = self._directions(q, t)
        n_p = len(G)
        n_q = len(q)
        n = len(u)
        tangents = np.zeros((n_p + n, n_q + n)).astype(object)
        tangents[:n_p, :n_q] = G
        tangents[n_p:, n_q:] = np.eye(n)
        outputs = error[:2 * len(rates)]
        # Forward mode: a column of derivatives for each direction.
        L = _forward_columns(outputs, [*q, *u], tangents, Subroutines())
        return L, error, rates

    def _directions(self, q: Vector, t: Scalar) -> Matrix:
        """Return q' in each direction of the configuration, (n_p, n_q)."""
        model = self._equations.model
        tangent = self._step.tangent(q, t)
        rates = [coordinate_rates(model, q, column) for column in tangent.T]
        return np.array(rates, dtype=object)

    def policy_of(self, slopes: Vector, tau: Vector, v: Vector, V: Vector,
                  constants: Constants) -> Policy:
        """Return the policy of an interval; v and V are the cost-to-go at its end."""
        x = self.sizes.directions
        F, by_x, by_tau, hessian_x, hessian_tau = np.split(slopes, self._slope_ends)
        cost_to_go = expansion(F.reshape(x, -1), v + by_x,
                               from_triangle(V + hessian_x, x))
        torques = TorqueCost(tau, by_tau, hessian_tau, constants.limits.lowest_torque,
                             constants.limits.highest_torque)
        return backward_step(cost_to_go, torques, constants.regular * hessian_tau)


def _forward_columns(outputs: Any, inputs: list[Scalar], tangents: Matrix,
                     share: Subroutines) -> Matrix:
    """Return the derivatives of outputs along tangents of the inputs, as columns."""
    columns = [forward(outputs, inputs, tangent, share) for tangent in tangents]
    return np.array(columns, dtype=object).T
