"""Model predictive control: a horizon optimized again from every state."""

from dataclasses import replace

from kane_dynamics._util.checks import finite_row, instance, integer, number
from kane_dynamics._util.typing import Array
from kane_dynamics.control.momentum_observer import MomentumObserver
from kane_dynamics.motion.motion import Motion
from kane_dynamics.optimal_control.trajectory_optimizer import (OptimizedMotion,
                                                                TrajectoryOptimizer)
import numpy as np
from numpy.typing import ArrayLike

FIRST = 100  # iterations from the first state


class PredictiveController:
    """
    Predictive controller: one or a few iterations of an optimizer in every cycle.

    The first cycle begins with the torques of `start`, or else with those of gravity,
    and optimizes until it converges; compile and call it before the arm must move. Later
    ones continue from the torques of the last, moved in time (real-time iteration, Diehl
    et al., SIAM J. Control Optim. 43 (2005)).

    With a `disturbance_gain` the controller has no offset at rest, whatever mass,
    payload and friction the model lacks: a `MomentumObserver` estimates the missing
    torques, and the plan counts with them as constant over the horizon. They need the
    torques to be those that act.

    Parameters
    ----------
    optimizer : TrajectoryOptimizer
        Its target is that of the controller.
    iterations : int
        In each cycle but the first.
    disturbance_gain : float
        Gain of the observer, 1/s: it has seen 63 % of a constant disturbance after 1 /
        gain. 0 for no estimate.

    Attributes
    ----------
    solution : OptimizedMotion or None
        Of the last cycle; `feasible` says whether it is a plan from the measured state.
    disturbance : (m,) array
        Estimated torques that act beside those of the actuators, N m or N.

    """

    def __init__(self, optimizer: TrajectoryOptimizer, *, iterations: int = 1,
                 disturbance_gain: float = 0.0) -> None:
        """Store the optimizer; compile the observer."""
        instance(optimizer, TrajectoryOptimizer, 'optimizer')
        self.optimizer = optimizer
        self.iterations = integer(iterations, 'iterations', 1)
        gain = number(disturbance_gain, 'disturbance_gain', 'a finite number >= 0, 1/s',
                      lambda value: 0.0 <= value < np.inf)
        self.solution: OptimizedMotion | None = None
        self.disturbance = np.zeros(len(optimizer.actuator_names))
        # Another controller may have left one.
        optimizer.set_disturbance(self.disturbance)
        self._observer = None
        if gain:
            self._observer = MomentumObserver(optimizer.robot, gain=gain, max_gap=np.inf,
                                              held=True)
        names = optimizer.robot.joint_names
        self._actuators = list(map(names.index, optimizer.actuator_names))
        self._target: ArrayLike | Motion | None = None
        self._guess: Array | None = None
        self._t = 0.0  # of the target
        self._clock = 0.0  # of the observer

    def set_target(self, target: ArrayLike | Motion, t: float = 0.0) -> None:
        """Set the target: a configuration to rest at, or a motion, at time t in the next cycle."""
        self.optimizer.set_target(target, t)
        self._target = None
        if isinstance(target, Motion):
            self._target = target
        elif self.optimizer.robot.equations.timed:
            self._target = np.array(target)
        self._t = float(t)

    def start(self, tau: ArrayLike) -> None:
        """
        Begin the next cycle with these torques: (m,) for every interval, or (N, m).

        That cycle optimizes until it converges, as the first one does. Where the motion
        of the torques is not finite, it begins with those of gravity.
        """
        self.optimizer.start(tau)  # which checks them
        self._guess = np.array(tau, dtype=float)
        self.solution = None

    def torque(self, q: ArrayLike, u: ArrayLike, elapsed: float) -> Array:
        """
        Return the torques of the actuators, (m,), N m or N, never beyond their limits.

        Every finite state has a result. Where no torques that are tried lead from it to
        finite states (the last plan's, with its feedback or without, those of gravity,
        none), the result is that of the last plan, `solution.feasible` is False, and the
        estimate of the disturbance begins again. The next cycle tries again.

        Parameters
        ----------
        q, u : (n_q,), (n,) array_like
            The measured state.
        elapsed : float
            Time since the state of the last call, s; ignored in the first.

        Raises
        ------
        InputError
            The state or the time is not finite; names it.
        ConstraintError
            The loops of the measured configuration are open beyond `closure_tolerance`.

        """
        optimizer = self.optimizer
        last = self.solution
        # Checked before anything changes, so that the next call finds the controller as
        # it was.
        finite_row(q, 'q', optimizer.robot.coordinate_names)
        finite_row(u, 'u', optimizer.robot.speed_names)
        if last is None:
            solution = self._first_solution(q, u)
        else:
            solution = self._next_solution(q, u, elapsed)

        # Nothing leads to finite states: the last plan, or gravity, until the next
        # cycle.
        if solution is None:
            if last is None:
                solution = self._resting(q, u)
            else:
                solution = _moved(last, elapsed / optimizer.interval)
            optimizer.start(solution.tau)
            self._forget_disturbance()
        self.solution = solution
        tau: Array = solution.tau[0].copy()
        if self._observer is not None:
            self._observer.hold(self._generalized(tau, q))
        return tau

    def _first_solution(self, q: ArrayLike, u: ArrayLike) -> OptimizedMotion | None:
        """Return the solution from the torques of `start`, or from those of gravity."""
        self._estimate(q, u, 0.0)
        guess = self._guess
        if guess is None:
            guess = self.optimizer.holding_torques(q)
        self.optimizer.start(guess)
        self._guess = None
        return self._solved(q, u, FIRST)

    def _next_solution(self, q: ArrayLike, u: ArrayLike, elapsed: float
                       ) -> OptimizedMotion | None:
        """Return the solution from the torques of the last cycle, moved in time."""
        self.optimizer.shift(elapsed)
        self._t += elapsed
        if self._target is not None:
            self.optimizer.set_target(self._target, self._t)
        self._estimate(q, u, elapsed)
        return self._solved(q, u, self.iterations)

    def _solved(self, q: ArrayLike, u: ArrayLike, iterations: int
                ) -> OptimizedMotion | None:
        """Return the solution from the first torques that lead to finite states."""
        optimizer = self.optimizer
        solution = optimizer.try_solve(q, u, iterations=iterations)
        if solution is not None:
            return solution
        # Other first torques: those that hold gravity, then none.
        for tau in (optimizer.holding_torques(q), 0.0 * optimizer.torque_limits):
            optimizer.start(tau)
            solution = optimizer.try_solve(q, u, iterations=iterations)
            if solution is not None:
                return solution
        return None

    def _resting(self, q: ArrayLike, u: ArrayLike) -> OptimizedMotion:
        """Return a plan that holds gravity, within the limits, where none is found."""
        optimizer = self.optimizer
        N = optimizer.nodes
        limits = optimizer.torque_limits
        tau = np.clip(optimizer.holding_torques(q), -limits, limits)
        return OptimizedMotion(
            q=np.tile(q, (N + 1, 1)), u=np.tile(u, (N + 1, 1)), tau=np.tile(tau, (N, 1)),
            gains=np.zeros((N, len(tau), optimizer.directions)), cost=np.inf,
            iterations=0, converged=False, feasible=False)

    def _forget_disturbance(self) -> None:
        """Reset the estimated disturbance, after a state without a plan."""
        if self._observer is None:
            return
        self._observer.reset()
        self.disturbance = np.zeros(len(self._actuators))
        self.optimizer.set_disturbance(self.disturbance)

    def _estimate(self, q: ArrayLike, u: ArrayLike, elapsed: float) -> None:
        """Estimate the disturbance from the last command and the measured state."""
        observer = self._observer
        if observer is None:
            return
        robot = self.optimizer.robot
        self._clock += elapsed
        none = np.zeros(robot.n)  # of the first sample, of which `hold` sets another
        with np.errstate(over='ignore', invalid='ignore'):
            external = observer.update(self._clock, q, u, none)
        if not np.isfinite(external).all():  # speeds whose squares overflow
            observer.reset()
            external = none
        torques = robot.joint_torques(external, q, t=self._t)
        self.disturbance = torques[self._actuators]
        self.optimizer.set_disturbance(self.disturbance)

    def _generalized(self, tau: Array, q: ArrayLike) -> Array:
        """Return the generalized force of torques of the actuators, (n,)."""
        robot = self.optimizer.robot
        torques = np.zeros(len(robot.joint_names))
        torques[self._actuators] = tau
        return robot.generalized_force(torques, q, t=self._t)


def _moved(plan: OptimizedMotion, intervals: float) -> OptimizedMotion:
    """Return a plan moved in time; its end is repeated."""
    nodes = len(plan.tau)
    place = np.arange(nodes + 1) + intervals
    # States are those of the plan, not between two, as loops close only there.
    states = np.minimum(place, nodes).astype(int)
    torques = np.minimum(place[:-1], nodes - 1)
    first = torques.astype(int)
    part = (torques - first)[:, None]
    begin = plan.tau[first]
    end = plan.tau[np.minimum(first + 1, nodes - 1)]
    tau = begin + part * (end - begin)
    # Rounding may exceed a limit.
    tau = np.clip(tau, np.minimum(begin, end), np.maximum(begin, end))
    return replace(plan, q=plan.q[states], u=plan.u[states], tau=tau,
                   gains=0.0 * plan.gains, iterations=0, converged=False, feasible=False)
