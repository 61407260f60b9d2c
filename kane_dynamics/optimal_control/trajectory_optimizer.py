"""Optimal torques over a horizon, by differential dynamic programming with torque limits."""

from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.attribute_hints import fixed
from kane_dynamics._util.checks import finite_row, integer, per_joint, positive_time
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.motion.motion import Motion
from kane_dynamics.optimal_control.horizon_kernels import HorizonKernels, NUMBERS
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

SUFFICIENT = 1e-4  # least decrease of the cost, as a fraction of the expected one
HALVINGS = 6  # of the step, in one iteration
ROUNDING = 1e-13  # of a cost, relative
RAISED, STALLED = 10.0, 1e8  # factor of the regularization, and the least that ends the search


@fixed
@dataclass(frozen=True)
class CostWeights:
    """
    Weights of the cost ``1/2 sum w (value - target)^2``, one number or one per joint.

    Attributes
    ----------
    position, speed, torque : float or (n,) array_like
        Integrated over the horizon: per s and rad^2, (rad/s)^2, (N m)^2 (m for prismatic joints).
        That of torque is positive.
    end_position, end_speed : float or (n,) array_like
        At the end of the horizon, not integrated.
    excess_speed : float or (n,) array_like
        Of speed beyond its limit, at the end of each interval.

    """

    position: Any = 100.0
    speed: Any = 1.0
    torque: Any = 1e-3
    end_position: Any = 100.0
    end_speed: Any = 1.0
    excess_speed: Any = 100.0


@fixed
@dataclass(frozen=True, eq=False)
class Solution:
    """
    Motion and torques over the horizon.

    Attributes
    ----------
    q, u : (N + 1, n) arrays
        At the ends of the intervals, the measured state first; rad or m, s.
    tau : (N, n) array
        Torque of each interval, N m or N.
    gains : (N, n, 2 n) array
        Feedback K of the last iteration: ``tau + K (measured (q, u) - planned (q, u))``; its rows
        are zero for torques at their limits.
    cost : float
        Without the state at the beginning, which no torque changes.
    iterations : int
        Passes over the horizon.
    converged : bool
        Whether the last decrease was at most the tolerance. False too where no step decreases the
        cost, as at a kink.

    """

    q: Array
    u: Array
    tau: Array
    gains: Array
    cost: float
    iterations: int
    converged: bool


class TrajectoryOptimizer:
    """
    Torques that minimise a cost over a horizon of equal intervals, within their limits.

    Torques are constant in an interval and never beyond their limits. Speeds beyond their limits
    are penalised (`CostWeights.excess_speed`). The dynamics include friction
    (`mechanics.integrators.implicit_friction`). The method is iLQR, that is
    differential dynamic programming with Gauss-Newton Hessians, with torque limits in the backward
    pass (see `backward_step`) and a search along the step; all passes run in native code.

    Parameters
    ----------
    robot : Robot
        A tree of rigid bodies whose speeds are the joint rates. Gravity and payload
        (`robot.parameters`) are those at each call of `solve`.
    nodes : int
        Number of intervals.
    interval : float
        Length of an interval, s.
    weights : CostWeights, optional
    torque_limits, speed_limits : float or (n,) array_like, optional
        Default: `robot.limits`.

    Raises
    ------
    InputError
        Names the argument, or the property of the robot that is not supported.

    """

    def __init__(self, robot: Robot, *, nodes: int = 50, interval: float = 0.01,
                 weights: CostWeights | None = None, torque_limits: ArrayLike | None = None,
                 speed_limits: ArrayLike | None = None) -> None:
        """Compile the kernels; the target is the configuration zero until `set_target`."""
        if not isinstance(robot.equations, TreeEquations) or robot.model.flexible:
            raise InputError(f"robot '{robot.model.name}': has chosen speeds, constraints, ball "
                             'joints or beams; expected a tree of rigid bodies with joint rates')
        names = robot.joint_names
        self.robot = robot
        self.interval = positive_time(interval, 'interval')
        self.torque_limits = per_joint(
            robot.limits.effort if torque_limits is None else torque_limits, 'torque_limits',
            names, finite=False)
        self.speed_limits = per_joint(
            robot.limits.velocity if speed_limits is None else speed_limits, 'speed_limits',
            names, finite=False)
        self._arrays = HorizonKernels(robot, integer(nodes, 'nodes', 1))
        self.weights = weights or CostWeights()
        position, speed, torque, end_position, end_speed, excess = (
            per_joint(getattr(self.weights, name), f'weights.{name}', names)
            for name in CostWeights.__dataclass_fields__)
        if not torque.all():
            raise InputError(f'weights.torque: {self.weights.torque!r}; expected positive numbers')
        self._arrays.weights[:] = self.interval * np.concatenate([position, speed, torque])
        self._arrays.weights[-1, :2 * robot.n] = np.concatenate([end_position, end_speed])
        self._arrays.constants[NUMBERS:NUMBERS + 3 * robot.n] = np.concatenate(
            [self.torque_limits, self.speed_limits, excess])
        self._arrays.constants[0] = self.interval
        self._regularization = 0.0
        self.set_target(np.zeros(robot.n))

    @property
    def nodes(self) -> int:
        """Return the number of intervals."""
        return self._arrays.nodes

    def set_target(self, target: ArrayLike | Motion, t: float = 0.0) -> None:
        """
        Set the target: a configuration to rest at, or a motion whose time is t at the beginning.

        The target of the torque is what the target needs: that of gravity, or inverse dynamics.
        """
        n, targets = self.robot.n, self._arrays.targets
        if isinstance(target, Motion):
            if target.joint_names != self.robot.joint_names:
                raise InputError(f'target: a motion of {", ".join(target.joint_names)}; expected '
                                 f'{", ".join(self.robot.joint_names)}')
            q, u, udot = target.sample(t + self.interval * np.arange(1, self.nodes + 1))
            targets[:, :n], targets[:, n:2 * n] = q, u
            targets[:, 2 * n:] = self.robot.inverse_dynamics(q, u, udot)
        else:
            q = finite_row(target, 'target', self.robot.joint_names)
            targets[:] = np.concatenate([q, np.zeros(n), self.robot.gravity_force(q)])

    def start(self, tau: ArrayLike) -> None:
        """Begin the next `solve` with these torques: (n,) for every interval, or (N, n)."""
        n, names = self.robot.n, self.robot.joint_names
        rows = [finite_row(row, 'tau', names) for row in np.reshape(tau, (-1, np.shape(tau)[-1]))]
        if len(rows) not in (1, self.nodes):
            raise InputError(f'tau: {len(rows)} rows; expected 1 or {self.nodes}')
        self._arrays.path[1:, 2 * n:3 * n] = rows
        self._arrays.policy[:] = 0.0
        self._regularization = 0.0

    def shift(self, elapsed: float) -> None:
        """
        Move the torques in time, so that the next `solve` begins `elapsed` s later, at least 0.

        Parts of an interval interpolate, which keeps the limits; the last torque is repeated.
        """
        if not 0.0 <= elapsed < np.inf:
            raise InputError(f'elapsed: {elapsed!r}; expected a finite time >= 0, s')
        self._arrays.shift(elapsed / self.interval)

    def solve(self, q: ArrayLike, u: ArrayLike, *, iterations: int = 100,
              tolerance: float = 1e-9) -> Solution:
        """
        Improve the torques for a measured state, from those of the last call.

        Parameters
        ----------
        q, u : (n,) array_like
            The state at the beginning.
        iterations : int
            The most to do. None: only simulate.
        tolerance : float
            Decrease of the cost, relative to it, at which to stop.

        Raises
        ------
        InputError
            The state is not finite, or so are the states that the torques lead to.

        """
        arrays, names = self._arrays, self.robot.joint_names
        integer(iterations, 'iterations', 0)
        n = self.robot.n
        arrays.constants[NUMBERS + 3 * n:] = self.robot.parameters.block
        row = np.concatenate([finite_row(q, 'q', names), finite_row(u, 'u', names)])
        for path in (arrays.path, arrays.trial):
            path[0, :2 * n] = row
        cost = self._followed(0.0)
        if not np.isfinite(cost):
            raise InputError('torques: their motion is not finite; expected torques near those '
                             'that hold the arm (see start), or shorter intervals')
        arrays.swap()
        self._regularization = min(self._regularization, STALLED / RAISED**2)
        done, converged = 0, False
        while done < iterations and not converged and self._regularization < STALLED:
            done += 1
            before, shortened = cost, self._regularization > 0.0
            cost = self._iterate(cost)
            converged = (before - cost <= tolerance * abs(cost)
                         and not shortened and self._regularization == 0.0)
        q_u, tau = arrays.path[:, :2 * n], arrays.path[1:, 2 * n:3 * n]
        gains = arrays.policy[:-1, n:n + 2 * n * n].reshape(-1, n, 2 * n)
        return Solution(q_u[:, :n].copy(), q_u[:, n:].copy(), tau.copy(), gains.copy(), cost,
                        done, converged)

    def _followed(self, scale: float) -> float:
        """Simulate with a scale of the policy's k; return the cost."""
        self._arrays.forward(scale)
        return float(self._arrays.trial[-1, -1])

    def _iterate(self, cost: float) -> float:
        """Improve the path, or regularize the next iteration; return the cost."""
        arrays = self._arrays
        arrays.linearize()
        arrays.backward(self._regularization)
        first, second = arrays.expected()
        scale = 1.0
        for _ in range(HALVINGS):
            found = self._followed(scale)
            if cost - found >= -SUFFICIENT * scale * (first + scale * second) >= 0.0:
                arrays.swap()
                lower = self._regularization / RAISED
                self._regularization = lower if lower >= 1.0 else 0.0
                return found
            if -(first + second) <= ROUNDING * abs(cost):
                return cost  # nothing to gain
            scale *= 0.5
        self._regularization = max(1.0, RAISED * self._regularization)
        return cost
