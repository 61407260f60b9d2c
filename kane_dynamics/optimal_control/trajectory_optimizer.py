"""
Optimal torques over a horizon, by differential dynamic programming with torque limits.

`TrajectoryOptimizer` holds the search; `Target` finds what the motion and the torques
are compared with. The arrays and their kernels are in `horizon_kernels`.
"""

from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.checks import (constant, finite_row, instance, integer, number,
                                        per_joint, positive_time)
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.loop_tracking.driven_mechanism import mechanism_motion
from kane_dynamics.mechanics.ball_joints import require_angles, require_unit
from kane_dynamics.model.elastic_model import require_rigid_joints
from kane_dynamics.motion.motion import Motion
from kane_dynamics.optimal_control.horizon import NUMBERS
from kane_dynamics.optimal_control.horizon_kernels import HorizonKernels
from kane_dynamics.robot.methods.configuration_methods import warn_of_degrees
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

SUFFICIENT = 1e-4  # least decrease of the cost, as a fraction of the expected one
HALVINGS = 10  # of the step, in one iteration
ROUNDING = 1e-13  # of a cost, relative
RAISED = 10.0  # factor of the regularization
OVERFLOW = 1e20  # regularization at which derivatives that overflow are given up


@dataclass(frozen=True)
class CostWeights:
    """
    Weights of the cost ``1/2 sum w (value - target)^2``, one number or one per joint.

    Positions and speeds are those of all n_j joints (`robot.joint_names`), dependent
    ones included, whatever the generalized speeds; torques are those of the m actuators.
    Of a ball joint, the distance from the target is the rotation vector on the axes of
    the body, with 2 sin(angle / 2) for its angle.

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


@dataclass(frozen=True, eq=False)
class OptimizedMotion:
    """
    Motion and torques over the horizon.

    Attributes
    ----------
    q, u : (N + 1, n_q), (N + 1, n) arrays
        At the ends of the intervals, the measured state first; rad or m, s.
    tau : (N, m) array
        Torques of the actuators in each interval, N m or N.
    gains : (N, m, n_x) array
        Feedback K of the last iteration: ``tau + K (measured (q, u) - planned (q, u))``;
        its rows are zero for torques at their limits. The difference of configurations
        is `robot.difference` from the planned one, if constraints are on positions; n_x
        is 2 n. Under constraints of velocities, it has an entry more for each of their
        rows.
    cost : float
        Without the state at the beginning, which no torque changes.
    iterations : int
        Passes over the horizon.
    converged : bool
        Whether the last decrease was at most the tolerance. False too where no step
        decreases the cost, as at a kink.
    feasible : bool
        False only from `PredictiveController`: no torques lead from the measured state
        to finite states, and this is its last plan, moved in time.

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

    Torques are constant in an interval and never beyond their limits. Speeds beyond
    theirs are penalised (`CostWeights.excess_speed`). The steps
    (`mechanics.integrators.implicit_friction`, `mechanism_step`) include friction. The
    method is iLQR: differential dynamic programming with Gauss-Newton Hessians, torque
    limits in the backward pass (see `backward_step`) and a search along the step, all in
    native code.

    Parameters
    ----------
    robot : Robot
        Of any kind. The torques are those of its m actuators (`actuator_names`). Gravity
        and payload (`robot.parameters`) are those at each call of `solve`. The
        independent speeds stay those of the robot: a motion that would need others is
        not found.
    nodes : int
        Number of intervals.
    interval : float
        Length of an interval, s.
    weights : CostWeights, optional
    torque_limits : float or (m,) array_like, optional
        0 for an actuator that is not there. Default: `robot.limits.effort`, and 0 for
        the joints of a floating base, which has no actuator unless the effort of its
        joints is limited or `Robot(actuated=)` names them.
    speed_limits : float or (n_j,) array_like, optional
        Of all joints. Default: `robot.limits.velocity`.

    Attributes
    ----------
    actuator_names : tuple of str
        `robot.actuated_names`, but no modes of beams.

    Raises
    ------
    InputError
        Names the argument; or the robot has no actuator.

    """

    def __init__(self, robot: Robot, *, nodes: int = 50, interval: float = 0.01,
                 weights: CostWeights | None = None,
                 torque_limits: ArrayLike | None = None,
                 speed_limits: ArrayLike | None = None) -> None:
        """Compile the kernels; only trees have a target, 0, before `set_target`."""
        instance(robot, Robot, 'robot')
        require_rigid_joints(robot.model)
        self.robot = robot
        names = robot.joint_names
        self.interval = positive_time(interval, 'interval')

        # Modes of beams have no actuators: they move with the joints.
        modes = {names[k] for k in robot.model.modal_coordinates}
        self.actuator_names = tuple(name for name in robot.actuated_names
                                    if name not in modes)
        actuators = list(map(names.index, self.actuator_names))

        # Limits and weights, of which defaults are the robot's.
        self._stated_limits = torque_limits, speed_limits
        self._set_limits()
        self.weights = CostWeights() if weights is None else weights
        instance(self.weights, CostWeights, 'weights')

        # What the native solver reads and writes, and the state between its calls.
        self._arrays = HorizonKernels(robot, actuators, integer(nodes, 'nodes', 1))
        self._target = Target(robot, actuators)
        self._set_weights()
        self._disturbance = np.zeros(len(actuators))
        self._regularization = 0.0
        self._stalled = False
        self._t = 0.0
        self._set: Array | Motion | None = None  # the target
        self._parameters_of_target = np.zeros(0)
        # q = 0 closes no loop and deflects no beam: of those the user states a target.
        if robot.equations.in_joint_rates and not robot.model.flexible:
            self.set_target(np.zeros(len(names)))

    def _set_limits(self) -> None:
        """Set the limits of torque and speed; InputError for invalid ones."""
        robot = self.robot
        self._limits = robot.limits
        torque_limits, speed_limits = self._stated_limits
        if torque_limits is None:
            torque_limits = _torque_limits(robot, self.actuator_names)
        self.torque_limits = per_joint(torque_limits, 'torque_limits',
                                       self.actuator_names, finite=False)
        if speed_limits is None:
            speed_limits = robot.limits.velocity
        self.speed_limits = per_joint(speed_limits, 'speed_limits', robot.joint_names,
                                      finite=False)

    def _set_weights(self) -> None:
        """Write weights and limits into the arrays; InputError for invalid ones."""
        arrays = self._arrays
        weights = {}
        for name in CostWeights.__dataclass_fields__:
            weighted = self.robot.joint_names
            if name == 'torque':
                weighted = self.actuator_names
            weights[name] = per_joint(getattr(self.weights, name), f'weights.{name}',
                                      weighted)
        if not weights['torque'].all():
            raise InputError(f'weights.torque: {self.weights.torque!r}; expected '
                             'positive numbers')
        arrays.weights[:] = self.interval * np.concatenate(
            [weights['position'], weights['speed'], weights['torque']])
        # The state at the end of the horizon has weights of its own, which are not
        # integrated.
        at_end = np.concatenate([weights['end_position'], weights['end_speed']])
        arrays.weights[-1, :len(at_end)] = at_end
        arrays.constants[0] = self.interval
        arrays.constants[NUMBERS:NUMBERS + arrays.sizes.limits] = np.concatenate(
            [-self.torque_limits, self.torque_limits, self.speed_limits,
             weights['excess_speed']])

    @property
    def nodes(self) -> int:
        """Return the number of intervals."""
        return self._arrays.nodes

    @property
    def directions(self) -> int:
        """Return the length of a change of the state, n_x of `OptimizedMotion.gains`."""
        return self._arrays.sizes.directions

    def set_target(self, target: ArrayLike | Motion, t: float = 0.0) -> None:
        """
        Set a configuration to rest at, or a motion whose time is t at the beginning.

        A configuration has n_q entries, and its loops are closed. A motion is one of all
        joints, or of as many driving joints as a mechanism has independent speeds. t, s,
        is also the time at the beginning for constraints and speeds that depend on it.
        The target of the torques is what the target needs: those of gravity, or of
        inverse dynamics, with the gravity and the payload of each `solve`. A
        configuration that looks like degrees is warned of.
        """
        time = float(constant(t, (), 't (s)', InputError))
        self._write_target(target, time)
        if not isinstance(target, Motion):
            target = np.array(target, dtype=float)  # callers may change their array
            warn_of_degrees(self.robot, target, 'target')
        self._t = time
        self._set = target

    def _write_target(self, target: ArrayLike | Motion, t: float) -> None:
        """Write the rows of a target, and the parameters with which they are computed."""
        times: Array = t + self.interval * np.arange(1.0, self.nodes + 1.0)
        self._arrays.targets[:] = self._target.rows(target, times)
        self._parameters_of_target = self.robot.parameters.block.copy()

    def holding_torques(self, q: ArrayLike) -> Array:
        """Return the torques of the actuators that hold gravity at q, (m,)."""
        return self._target.holding(self._target.configuration(q, 'q'), self._t)

    def set_disturbance(self, tau: ArrayLike) -> None:
        """
        Set constant unknown torques that act in addition to the actuators', (m,).

        The planned motion stays: the actuators give what the disturbance does not. A
        target at rest then needs the torques that hold it against gravity and the
        disturbance.
        """
        m = len(self.actuator_names)
        # The kernels know the sum of both torques, and bound that.
        torques = finite_row(tau, 'disturbance', self.actuator_names)
        self._disturbance = torques.copy()  # callers may change their array
        bounds = self._arrays.constants[NUMBERS:NUMBERS + 2 * m]
        bounds[:m] = self._disturbance - self.torque_limits
        bounds[m:] = self._disturbance + self.torque_limits

    def start(self, tau: ArrayLike) -> None:
        """Begin the next `solve` with torques: (m,) for every interval, or (N, m)."""
        given_rows = np.asarray(tau) if np.ndim(tau) == 2 else [tau]
        rows = [finite_row(row, 'tau', self.actuator_names) for row in given_rows]
        if len(rows) not in (1, self.nodes):
            raise InputError(f'tau: {len(rows)} rows; expected 1 or {self.nodes}')
        self._arrays.tau[:] = np.array(rows) + self._disturbance
        self._arrays.forget()
        self._regularization = 0.0

    def shift(self, elapsed: float) -> None:
        """
        Move the torques in time: the next `solve` begins `elapsed` s, >= 0, later.

        Parts of an interval interpolate, which keeps the limits; the last torque is
        repeated. The target stays.
        """
        time = number(elapsed, 'elapsed', 'a finite time >= 0, s',
                      lambda t: 0.0 <= t < np.inf)
        self._arrays.shift(time / self.interval)

    def solve(self, q: ArrayLike, u: ArrayLike, *, iterations: int = 100,
              tolerance: float = 1e-9) -> OptimizedMotion:
        """
        Improve the torques of the last call for a measured state.

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
            The state is not finite, or so are the states that the torques lead to; or a
            robot other than a tree has no target yet.
        ConstraintError
            The loops of the configuration do not close, or are singular.

        """
        result = self.try_solve(q, u, iterations=iterations, tolerance=tolerance)
        if result is None:
            raise InputError('torques: their motion is not finite, or passes a '
                             'singularity; expected torques near those that hold the '
                             'arm (see start), or shorter intervals')
        return result

    def try_solve(self, q: ArrayLike, u: ArrayLike, *, iterations: int = 100,
                  tolerance: float = 1e-9) -> OptimizedMotion | None:
        """
        Return the result of `solve`, or None where states are not finite.

        Raises
        ------
        InputError, ConstraintError
            As `solve`, but for what the torques lead to.

        """
        arrays = self._arrays
        integer(iterations, 'iterations', 0)
        number(tolerance, 'tolerance', 'a number >= 0', lambda x: x >= 0.0)
        if self._set is None:
            raise InputError('target: none; expected a call of set_target before')
        parameters = self.robot.parameters.block
        arrays.constants[NUMBERS + arrays.sizes.limits:] = parameters
        if self.robot.limits is not self._limits:
            self._set_limits()
            self._set_weights()
            self.set_disturbance(self._disturbance)
        # The torques of the target are those of the present gravity and payload.
        if not np.array_equal(parameters, self._parameters_of_target):
            self._write_target(self._set, self._t)
        cost = self._first_cost(self._first_state(q, u))
        if not np.isfinite(cost):
            return None
        arrays.swap()
        # A search that stalled at another state begins without regularization.
        if self._stalled:
            self._regularization = 0.0
            self._stalled = False
        passes = 0
        converged = False
        while passes < iterations and not converged and not self._stalled:
            passes += 1
            shortened = self._regularization > 0.0
            improved = self._iterate(cost)
            small = cost - improved <= tolerance * abs(improved)
            # A step that regularization shortens says nothing about convergence.
            converged = small and not shortened and self._regularization == 0.0
            cost = improved
        return self._result(cost, passes, converged)

    def _first_state(self, q: ArrayLike, u: ArrayLike) -> Array:
        """Return the state at the beginning; raise the errors of `solve`."""
        robot = self.robot
        speeds = finite_row(u, 'u', robot.speed_names)
        configuration = self._target.configuration(q, 'q')
        # Raises an error where loops are open or singular.
        robot.joint_rates(configuration, speeds, t=self._t)
        state = np.concatenate([configuration, speeds, [self._t]])
        return state[:self._arrays.sizes.state]

    def _first_cost(self, state: Array) -> float:
        """Return the cost of the torques of the last call from a state."""
        arrays = self._arrays
        arrays.begin(state)
        cost = self._simulated(0.0)
        if np.isfinite(cost):
            return cost
        # Feedback amplifies a large distance from the last plan: the torques without it.
        arrays.forget()
        arrays.begin(state)
        return self._simulated(0.0)

    def _simulated(self, scale: float) -> float:
        """Simulate with a scale of the policy's k; return the cost."""
        self._arrays.forward(scale)
        return float(self._arrays.trial[-1, -1])

    def _result(self, cost: float, passes: int, converged: bool) -> OptimizedMotion:
        """Return the motion of the path, with the torques of the actuators alone."""
        arrays = self._arrays
        n_q = self.robot.n_q
        # The torques of the path include the disturbance.
        states = arrays.path[:, :n_q + self.robot.n].copy()
        tau = np.clip(arrays.tau - self._disturbance, -self.torque_limits,
                      self.torque_limits)
        return OptimizedMotion(states[:, :n_q], states[:, n_q:], tau, arrays.gains, cost,
                               passes, converged)

    def _iterate(self, cost: float) -> float:
        """Improve the path, or regularize the next iteration; return the cost."""
        arrays = self._arrays
        # Derivatives along the path, then the policy from the end of the horizon to its
        # begin.
        arrays.linearize()
        arrays.backward(self._regularization)
        # A scale s of the policy is expected to change the cost by s first + s^2 second.
        first, second = arrays.expected()
        if not np.isfinite(first + second):
            # Derivatives overflow: the torques remain, without feedback.
            arrays.policy[:] = 0.0
            self._stalled = self._regularization >= OVERFLOW
            return self._regularized(cost)
        # Search along the policy: the first scale with a sufficient part of the
        # decrease.
        scale = 1.0
        for _ in range(HALVINGS):
            new_cost = self._simulated(scale)
            expected = -scale * (first + scale * second)
            if cost - new_cost >= SUFFICIENT * expected >= 0.0:
                arrays.swap()
                lowered = self._regularization / RAISED
                self._regularization = lowered if lowered >= 1.0 else 0.0
                return new_cost
            if -(first + second) <= ROUNDING * abs(cost):
                # Nothing to gain: an optimum, or a step that regularization has
                # shortened to rounding, which ends the search whatever the size of its
                # number.
                self._stalled = self._regularization > 0.0
                return cost
            scale *= 0.5
        return self._regularized(cost)

    def _regularized(self, cost: float) -> float:
        """Shorten the next step; return the cost, which stays."""
        self._regularization = max(1.0, RAISED * self._regularization)
        return cost


def _torque_limits(robot: Robot, actuators: tuple[str, ...]) -> Array:
    """
    Return the effort limits of actuators; 0 for an unactuated base.

    Raise InputError if no actuator is left.
    """
    limits = dict(zip(robot.joint_names, robot.limits.effort.tolist()))
    # The base of a floating robot has no actuator, unless its limits are stated.
    equations = robot.equations
    base = robot.model.floating_base
    if equations.actuated is not None:
        base = ()
    undriven = [name for name in base if name in actuators and np.isinf(limits[name])]
    if undriven and len(undriven) == len(actuators):
        raise InputError(f'robot: no actuator but {", ".join(undriven)}, of a floating '
                         'base; expected actuated joints, or torque_limits of the base')
    return np.array([0.0 if name in undriven else limits[name] for name in actuators])


class Target:
    """
    Rows of targets: configuration, rates of the joints and torques, at each time.

    Parameters
    ----------
    robot : Robot
    actuators : list of m int
        Indices of the joints with actuators.

    """

    def __init__(self, robot: Robot, actuators: list[int]) -> None:
        """Store the robot."""
        self._robot = robot
        self._actuators = actuators

    def rows(self, target: ArrayLike | Motion, t: Array) -> Array:
        """
        Return q, joint rates and torques at times t, (N, n_q + n_j + m), or one row.

        Raises
        ------
        InputError
            The motion is not one of this robot, or the configuration is invalid; names
            it.
        ConstraintError
            The loops of the configuration do not close, or are singular.

        """
        if isinstance(target, Motion):
            return self._of_motion(target, t)
        robot = self._robot
        q = self.configuration(target, 'target')
        # Constraints that depend on time are closed at every time.
        if robot.equations.timed:
            q = np.array([robot.closed_configuration(q, t=float(time)) for time in t])
        at_rest = np.zeros((*q.shape[:-1], len(robot.joint_names)))
        return np.concatenate([q, at_rest, self.holding(q, t)], axis=-1)

    def _of_motion(self, motion: Motion, t: Array) -> Array:
        """Return the rows of a motion."""
        robot = self._robot
        require_angles(robot.model, 'target')
        # Driving joints move all others; rates are those of the joints, whatever the
        # speeds.
        q, u, udot = mechanism_motion(robot, motion.joint_names, t, *motion.sample(t))
        rates = robot.joint_rates(q, u, t=t)
        tau = robot.inverse_dynamics(q, u, udot, t=t)
        return np.concatenate([q, rates, self._of_actuators(tau, q, t)], axis=-1)

    def configuration(self, q: ArrayLike, what: str) -> Array:
        """Return a checked configuration, (n_q,)."""
        robot = self._robot
        return require_unit(robot.model, finite_row(q, what, robot.coordinate_names),
                            what)

    def holding(self, q: Array, t: Any) -> Array:
        """Return the torques of the actuators that hold gravity, (m,) or (N, m)."""
        force = self._robot.gravity_force(q, t=t)
        return self._of_actuators(force, q, t)

    def _of_actuators(self, tau: Array, q: Array, t: Any) -> Array:
        """Return the torques of the actuators for a generalized force."""
        torques: Array = self._robot.joint_torques(tau, q, t=t)
        return torques[..., self._actuators]
