"""Compare measured states with the motion of a goal, within its tolerances."""

from enum import IntEnum
from typing import NamedTuple

from kane_dynamics.motion.motion import Motion, State
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.joint_trajectory_action.goal_tolerances import (GoalTolerances,
                                                                       QUANTITIES,
                                                                       StateTolerance)
import numpy as np
from numpy.typing import NDArray

# s over which the error of the velocity is differentiated: joint states have no
# accelerations.
ACCELERATION_WINDOW = 0.02
UNITS = ('rad or m', 'rad/s or m/s', 'rad/s^2 or m/s^2')  # of the errors


class ResultCode(IntEnum):
    """The result codes of FollowJointTrajectory."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


class GoalOutcome(NamedTuple):
    """The end of a goal: the code of the action, and its reason in words."""

    code: ResultCode
    text: str


class Comparison(NamedTuple):
    """The last measured state beside the motion."""

    stamp: int
    moment: float
    desired: State
    q: Array
    u: Array


class GoalMonitor:
    """
    Judges every measured state of a goal, some of them at a time.

    A joint's acceleration error is the mean of `ACCELERATION_WINDOW`: the change of its
    velocity error over the time between two states.

    Parameters
    ----------
    motion : Motion
    start : int
        Its start, ns.
    tolerances : GoalTolerances

    Attributes
    ----------
    latest : Comparison or None
        The last judged state.

    """

    def __init__(self, motion: Motion, start: int, tolerances: GoalTolerances) -> None:
        self._motion = motion
        self._start = start
        self._tolerances = tolerances
        self.latest: Comparison | None = None
        # Times, s, and velocity errors of the last states, for the accelerations.
        self._past = np.zeros(0), np.zeros((0, motion.n))

    def judge(self, stamps: NDArray[np.int64], q: Array, u: Array) -> GoalOutcome | None:
        """
        Judge states in the order of their stamps; return the outcome, if they end the goal.

        Parameters
        ----------
        stamps : (K,) array
            ns, K >= 1.
        q, u : (K, n) arrays
            Measured positions and rates of the motion's joints, rad or m, and s.

        """
        moments = (stamps - self._start) / NANO
        desired_q, desired_u, desired_udot = self._motion.sample(moments)
        self.latest = Comparison(int(stamps[-1]), float(moments[-1]),
                                 (desired_q[-1], desired_u[-1], desired_udot[-1]),
                                 q[-1], u[-1])
        velocity_error = desired_u - u
        acceleration_error = self._acceleration_errors(moments, velocity_error)
        errors = np.array([desired_q - q, velocity_error, acceleration_error])
        # First the states during the motion, then those after its end.
        ended = moments >= self._motion.duration
        during = (moments >= 0.0) & ~ended
        outcome = self._path_violation(moments[during], errors[:, during])
        if outcome is None:
            outcome = self._arrival(moments[ended], errors[:, ended])
        return outcome

    def _path_violation(self, moments: Array, errors: Array) -> GoalOutcome | None:
        """Return the outcome at the first state outside the path tolerances, if any."""
        excess = _excess(errors, self._tolerances.path)
        for k, largest in enumerate(excess.max(axis=(0, 2))):
            if largest > 1.0:
                when = f'at {moments[k]:.3f} s of {self._motion.duration:.3f} s'
                text = self._worst(excess[:, k], errors[:, k], self._tolerances.path,
                                   when, 'path tolerance')
                return GoalOutcome(ResultCode.PATH_TOLERANCE_VIOLATED, text)
        return None

    def _arrival(self, moments: Array, errors: Array) -> GoalOutcome | None:
        """Return the outcome at the first state within the goal tolerances, or too late."""
        excess = _excess(errors, self._tolerances.goal)
        late = moments - self._motion.duration
        # State by state: reached first, or too late first.
        for k, largest in enumerate(excess.max(axis=(0, 2))):
            when = f'{late[k]:.3f} s after the end of the motion'
            if largest <= 1.0:
                return GoalOutcome(ResultCode.SUCCESSFUL, f'goal reached {when}')
            if late[k] >= self._tolerances.time:
                text = self._worst(excess[:, k], errors[:, k], self._tolerances.goal,
                                   when, 'goal tolerance')
                return GoalOutcome(ResultCode.GOAL_TOLERANCE_VIOLATED, text)
        return None

    def _worst(self, excess: Array, errors: Array, tolerance: StateTolerance, when: str,
               name: str) -> str:
        """Return the text of the error, of (3, n), that exceeds its tolerance most."""
        i, j = divmod(int(np.argmax(excess)), self._motion.n)
        quantity = QUANTITIES[i]
        limit = getattr(tolerance, quantity)[j]
        return (f"joint '{self._motion.joint_names[j]}': {quantity} error "
                f'{errors[i, j]:.4g} {UNITS[i]} {when}; expected at most {limit:.4g} '
                f'({name})')

    def _acceleration_errors(self, moments: Array, velocity_errors: Array) -> Array:
        """Return the mean acceleration errors before each state; zeros before the first."""
        before, errors_before = self._past
        times = np.concatenate([before, moments])
        errors = np.concatenate([errors_before, velocity_errors])
        # For each state the last one that is older by the window or more.
        first = np.searchsorted(times, moments - ACCELERATION_WINDOW, side='right') - 1
        known = first >= 0
        result = np.zeros_like(velocity_errors)
        change = velocity_errors[known] - errors[first[known]]
        result[known] = change / (moments[known] - times[first[known]])[:, None]
        # One state older than the window is kept, for the next ones.
        kept = max(int(first[-1]), 0)
        self._past = times[kept:], errors[kept:]
        return result


def _excess(errors: Array, tolerance: StateTolerance) -> Array:
    """Return errors over tolerances, (3, K, n); 0 where there is no tolerance."""
    limits = np.array([tolerance.position, tolerance.velocity, tolerance.acceleration])
    ratios: Array = np.abs(errors) / limits[:, None, :]
    return ratios
