"""Optimal torques over a horizon, by differential dynamic programming with torque limits."""

from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.attribute_hints import fixed
from kane_dynamics._util.checks import (constant, finite_row, instance, integer, number,
                                        per_joint, positive_time)
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.motion.motion import Motion
from kane_dynamics.optimal_control.horizon_kernels import HorizonKernels
from kane_dynamics.optimal_control.horizon_layout import NUMBERS
from kane_dynamics.optimal_control.mechanism_horizon import MechanismHorizon
from kane_dynamics.optimal_control.target import Target
from kane_dynamics.optimal_control.tree_horizon import TreeHorizon
from kane_dynamics.robot.methods.configuration_methods import warn_of_degrees
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

SUFFICIENT = 1e-4  # least decrease of the cost, as a fraction of the expected one
HALVINGS = 10  # of the step, in one iteration
ROUNDING = 1e-13  # of a cost, relative
RAISED = 10.0  # factor of the regularization
OVERFLOW = 1e20  # regularization at which derivatives that overflow are given up


@fixed
@dataclass(frozen=True)
class CostWeights:
    """
    Weights of the cost ``1/2 sum w (value - target)^2``, one number or one per joint.

    Positions and speeds are those of all n_j joints (`robot.joint_names`), dependent ones
    included, whatever the generalized speeds; torques are those of the m actuators. Of a ball
    joint, the distance from the target is the rotation vector on the axes of the body, with
    2 sin(angle / 2) for its angle.

    Attributes
    ----------
    position, speed : float or (n_j,) array_like
        Integrated over the horizon: per s and rad^2, (rad/s)^2 (m for prismatic joints).
    torque : float or (m,) array_like
        Integrated: per s and (N m)^2 (N for prismatic joints). Positive.
    end_position, end_speed : float or (n_j,) array_like
        At the end of the horizon, not integrated.
    excess_speed : float or (n_j,) array_like
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
    q, u : (N + 1, n_q), (N + 1, n) arrays
        At the ends of the intervals, the measured state first; rad or m, s.
    tau : (N, m) array
        Torques of the actuators in each interval, N m or N.
    gains : (N, m, n_x) array
        Feedback K of the last iteration: ``tau + K (measured (q, u) - planned (q, u))``; its rows
        are zero for torques at their limits. The difference of configurations is
        `robot.difference` from the planned one, if constraints are on positions; n_x is 2 n. Under
        constraints of velocities, it has an entry more for each of their rows.
    cost : float
        Without the state at the beginning, which no torque changes.
    iterations : int
        Passes over the horizon.
    converged : bool
        Whether the last decrease was at most the tolerance. False too where no step decreases the
        cost, as at a kink.
    feasible : bool
        False only from `PredictiveController`: no torques lead from the measured state to finite
        states, and this is its last plan, moved in time.

    """

    q: Array
    u: Array
    tau: Array
    gains: Array
    cost: float
    iterations: int
    converged: bool
    feasible: bool = True


class TrajectoryOptimizer:
    """
    Torques that minimise a cost over a horizon of equal intervals, within their limits.

    Torques are constant in an interval and never beyond their limits. Speeds beyond theirs are
    penalised (`CostWeights.excess_speed`). The steps (`mechanics.integrators.implicit_friction`,
    `mechanism_step`) include friction. The method is iLQR: differential dynamic programming with
    Gauss-Newton Hessians, torque limits in the backward pass (see `backward_step`) and a search
    along the step, all in native code.

    Parameters
    ----------
    robot : Robot
        Of any kind. The torques are those of its m actuators (`actuator_names`). Gravity and
        payload (`robot.parameters`) are those at each call of `solve`. The independent speeds stay
        those of the robot: a motion that would need others is not found.
    nodes : int
        Number of intervals.
    interval : float
        Length of an interval, s.
    weights : CostWeights, optional
    torque_limits : float or (m,) array_like, optional
        0 for an actuator that is not there, as of a floating base. Default: `robot.limits.effort`,
        which no URDF states for a floating base.
    speed_limits : float or (n_j,) array_like, optional
        Of all joints. Default: `robot.limits.velocity`.

    Attributes
    ----------
    actuator_names : tuple of str
        `robot.actuated_names`, but no modes of beams.

    Raises
    ------
    InputError
        Names the argument.

    """

    def __init__(self, robot: Robot, *, nodes: int = 50, interval: float = 0.01,
                 weights: CostWeights | None = None, torque_limits: ArrayLike | None = None,
                 speed_limits: ArrayLike | None = None) -> None:
        """Compile the kernels; the target of a tree is 0 until `set_target`, others have none."""
        instance(robot, Robot, 'robot')
        model, names = robot.model, robot.joint_names
        self.robot = robot
        self.interval = positive_time(interval, 'interval')
        modes = {names[k] for k in model.modal_coordinates}
        self.actuator_names = tuple(name for name in robot.actuated_names if name not in modes)
        actuators = [names.index(name) for name in self.actuator_names]
        self.torque_limits = per_joint(
            robot.limits.effort[actuators] if torque_limits is None else torque_limits,
            'torque_limits', self.actuator_names, finite=False)
        self.speed_limits = per_joint(
            robot.limits.velocity if speed_limits is None else speed_limits, 'speed_limits',
            names, finite=False)
        self.weights = CostWeights() if weights is None else weights
        instance(self.weights, CostWeights, 'weights')
        by_joint = dict.fromkeys(CostWeights.__dataclass_fields__, names)
        position, speed, torque, end_position, end_speed, excess = (
            per_joint(getattr(self.weights, name), f'weights.{name}', of)
            for name, of in (by_joint | {'torque': self.actuator_names}).items())
        if not torque.all():
            raise InputError(f'weights.torque: {self.weights.torque!r}; expected positive numbers')
        plain = type(robot.equations) is TreeEquations and not model.flexible
        self._arrays = HorizonKernels(
            robot, TreeHorizon(robot) if plain else MechanismHorizon(robot, actuators),
            integer(nodes, 'nodes', 1))
        self._target = Target(robot, actuators)
        arrays, n = self._arrays, len(names)
        arrays.weights[:] = self.interval * np.concatenate([position, speed, torque])
        arrays.weights[-1, :2 * n] = np.concatenate([end_position, end_speed])
        arrays.constants[NUMBERS:NUMBERS + arrays.sizes.limits] = np.concatenate(
            [-self.torque_limits, self.torque_limits, self.speed_limits, excess])
        arrays.constants[0] = self.interval
        self._disturbance = np.zeros(len(actuators))
        self._regularization, self._stalled = 0.0, False
        self._t, self._aimed = 0.0, False
        if plain:
            self.set_target(np.zeros(n))

    @property
    def nodes(self) -> int:
        """Return the number of intervals."""
        return self._arrays.nodes

    @property
    def directions(self) -> int:
        """Return the number of entries of a change of the state, n_x of `Solution.gains`."""
        return self._arrays.sizes.directions

    def set_target(self, target: ArrayLike | Motion, t: float = 0.0) -> None:
        """
        Set the target: a configuration to rest at, or a motion whose time is t at the beginning.

        A configuration has n_q entries, and its loops are closed. A motion is one of all joints,
        or of as many driving joints as a mechanism has independent speeds. t, s, is also the time
        at the beginning for constraints and speeds that depend on it. The target of the torques is
        what the target needs: those of gravity, or of inverse dynamics, with the present payload.
        A configuration that looks like degrees is warned of.
        """
        moments = constant(t, (), 't (s)', InputError) + self.interval * np.arange(
            1, self.nodes + 1)
        self._arrays.targets[:] = self._target.rows(target, moments)
        if not isinstance(target, Motion):
            warn_of_degrees(self.robot, np.asarray(target, dtype=float), 'target')
        self._t, self._aimed = float(t), True

    def holding_torques(self, q: ArrayLike) -> Array:
        """Return the torques of the actuators that hold gravity at a configuration, (m,)."""
        return self._target.holding(self._target.configuration(q, 'q'), self._t)

    def set_disturbance(self, tau: ArrayLike) -> None:
        """
        Set unknown torques that act beside those of the actuators, (m,), constant in the horizon.

        The planned motion stays: the actuators give what the disturbance does not. A target at
        rest then needs the torques that hold it against gravity and the disturbance.
        """
        m = len(self.actuator_names)
        # The kernels know the sum of both torques, and bound that.
        self._disturbance = finite_row(tau, 'disturbance', self.actuator_names)
        bounds = self._arrays.constants[NUMBERS:NUMBERS + 2 * m]
        bounds[:m] = self._disturbance - self.torque_limits
        bounds[m:] = self._disturbance + self.torque_limits

    def start(self, tau: ArrayLike) -> None:
        """Begin the next `solve` with these torques: (m,) for every interval, or (N, m)."""
        rows = [finite_row(row, 'tau', self.actuator_names)
                for row in (np.asarray(tau) if np.ndim(tau) == 2 else [tau])]
        if len(rows) not in (1, self.nodes):
            raise InputError(f'tau: {len(rows)} rows; expected 1 or {self.nodes}')
        self._arrays.tau[:] = np.array(rows) + self._disturbance
        self._arrays.forget()
        self._regularization = 0.0

    def shift(self, elapsed: float) -> None:
        """
        Move the torques in time, so that the next `solve` begins `elapsed` s later, at least 0.

        Parts of an interval interpolate, which keeps the limits; the last torque is repeated. The
        target stays.
        """
        time = number(elapsed, 'elapsed', 'a finite time >= 0, s', lambda t: 0.0 <= t < np.inf)
        self._arrays.shift(time / self.interval)

    def solve(self, q: ArrayLike, u: ArrayLike, *, iterations: int = 100,
              tolerance: float = 1e-9) -> Solution:
        """
        Improve the torques for a measured state, from those of the last call.

        Parameters
        ----------
        q, u : (n_q,), (n,) array_like
            The state at the beginning.
        iterations : int
            The most to do; 0 to simulate only.
        tolerance : float
            Decrease of the cost, relative to it, at which to stop.

        Raises
        ------
        InputError
            The state is not finite, or so are the states that the torques lead to; or a robot
            other than a tree has no target yet.
        ConstraintError
            The loops of the configuration do not close, or are singular.

        """
        solution = self.try_solve(q, u, iterations=iterations, tolerance=tolerance)
        if solution is None:
            raise InputError('torques: their motion is not finite, or passes a singularity; '
                             'expected torques near those that hold the arm (see start), or '
                             'shorter intervals')
        return solution

    def try_solve(self, q: ArrayLike, u: ArrayLike, *, iterations: int = 100,
                  tolerance: float = 1e-9) -> Solution | None:
        """
        Return the result of `solve`, or None where the torques lead to states that are not finite.

        Raises
        ------
        InputError, ConstraintError
            As `solve`, but for what the torques lead to.

        """
        arrays, robot = self._arrays, self.robot
        integer(iterations, 'iterations', 0)
        number(tolerance, 'tolerance', 'a number >= 0', lambda x: x >= 0.0)
        if not self._aimed:
            raise InputError('target: none; expected a call of set_target before')
        arrays.constants[NUMBERS + arrays.sizes.limits:] = robot.parameters.block
        start, n_q, n = self._start(q, u), robot.n_q, robot.n
        arrays.begin(start)
        cost = self._followed(0.0)
        if not np.isfinite(cost):
            # Feedback amplifies a large distance from the last plan: the torques without it.
            arrays.forget()
            arrays.begin(start)
            cost = self._followed(0.0)
        if not np.isfinite(cost):
            return None
        arrays.swap()
        if self._stalled:
            self._regularization, self._stalled = 0.0, False
        done, converged = 0, False
        while done < iterations and not converged and not self._stalled:
            done += 1
            before, shortened = cost, self._regularization > 0.0
            cost = self._iterate(cost)
            converged = (before - cost <= tolerance * abs(cost)
                         and not shortened and self._regularization == 0.0)
        q_u = arrays.path[:, :n_q + n].copy()
        tau = np.clip(arrays.tau - self._disturbance, -self.torque_limits, self.torque_limits)
        return Solution(q_u[:, :n_q], q_u[:, n_q:], tau, arrays.gains, cost, done, converged)

    def _start(self, q: ArrayLike, u: ArrayLike) -> Array:
        """Return the state at the beginning; raise the errors of `solve`."""
        robot, speeds = self.robot, finite_row(u, 'u', self.robot.speed_names)
        here = self._target.configuration(q, 'q')
        if isinstance(robot.equations, ConstrainedEquations):  # closed, and not singular
            robot.joint_rates(here, speeds, **self._target.at(self._t))
        return np.concatenate([here, speeds, [self._t]])[:self._arrays.sizes.state]

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
        known, scale = np.isfinite(first + second), 1.0
        if not known:  # derivatives overflow: the torques remain, without feedback
            arrays.policy[:] = 0.0
            self._stalled = self._regularization >= OVERFLOW
        for _ in range(HALVINGS if known else 0):
            found = self._followed(scale)
            if cost - found >= -SUFFICIENT * scale * (first + scale * second) >= 0.0:
                arrays.swap()
                lower = self._regularization / RAISED
                self._regularization = lower if lower >= 1.0 else 0.0
                return found
            if -(first + second) <= ROUNDING * abs(cost):
                # Nothing to gain: an optimum, or a step that regularization has shortened to
                # rounding, which ends the search whatever the size of its number.
                self._stalled = self._regularization > 0.0
                return cost
            scale *= 0.5
        self._regularization = max(1.0, RAISED * self._regularization)
        return cost
