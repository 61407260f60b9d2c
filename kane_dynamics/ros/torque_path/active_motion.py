"""The desired motion that the torque path follows, and the one scheduled after it."""

from collections.abc import Callable
import time

from kane_dynamics.motion.motion import Motion, State
from kane_dynamics.ros.common.conversion import NANO

ScheduledMotion = tuple[Motion, int]  # a motion and its start on the node's clock, ns


class ActiveMotion:
    """
    The active motion and its successor.

    Requests set motions. The torque path samples the active motion at each state and
    clears both motions when it stops, times out, or changes clock or mode. A motion that
    was received, or whose reading began, before `clear` is rejected.

    Parameters
    ----------
    changed : callable, optional
        Called after each change of the motions.

    Attributes
    ----------
    generation : int
        Number of calls of `clear`.
    cleared_at : int
        System time of the last `clear`, ns.
    reason : str
        Why motions were dropped then.

    """

    def __init__(self, changed: Callable[[], object] = bool) -> None:
        self._changed = changed
        self._motions: tuple[ScheduledMotion | None, ScheduledMotion | None] = None, None
        self.generation = 0
        self.cleared_at = time.time_ns()
        self.reason = ''

    @property
    def scheduled(self) -> tuple[ScheduledMotion | None, ScheduledMotion | None]:
        """Return the active motion and its successor, with their starts."""
        return self._motions

    def at(self, stamp: int) -> tuple[Motion | None, float]:
        """Return the active motion at a time, ns, and the time since its start, s."""
        motion, upcoming = self._motions
        if upcoming is not None and stamp >= upcoming[1]:
            motion = upcoming
        if motion is None:
            return None, 0.0
        return motion[0], (stamp - motion[1]) / NANO

    def holds(self, motion: Motion, stamp: int) -> bool:
        """Return whether a motion is active at a time, ns, or scheduled after it."""
        _, upcoming = self._motions
        if upcoming is not None and upcoming[0] is motion:
            return True
        return self.at(stamp)[0] is motion

    def desired(self, stamp: int) -> State | None:
        """
        Return the desired q, u and udot at a time, ns.

        The result is None without an active motion.
        """
        motion, moment = self.at(stamp)
        return None if motion is None else motion.sample(moment)

    def follow(self, motion: Motion, start: int, now: int, generation: int) -> bool:
        """
        Schedule `motion` at time `start`, ns.

        Until then the current motion stays active.

        Returns
        -------
        bool
            False if `clear` was called since `generation`; the motion is then rejected.

        """
        # The motion was computed for a state of the path that is gone.
        if generation != self.generation:
            return False
        current, upcoming = self._motions
        # The scheduled motion has begun meanwhile: it is the present one now.
        if upcoming is not None and now >= upcoming[1]:
            current = upcoming
        self._motions = current, (motion, start)
        self._changed()
        return True

    def clear(self, reason: str) -> bool:
        """Drop both motions for a reason; return whether there was one."""
        return self._drop(reason, None)

    def replace(self, motion: Motion, start: int, reason: str) -> None:
        """Drop both motions for a reason, as `clear`, and follow another one at once."""
        self._drop(reason, (motion, start))

    def _drop(self, reason: str, successor: ScheduledMotion | None) -> bool:
        """Drop both motions in favor of another one; return whether there was one."""
        self.reason = reason
        dropped = self._motions
        self._motions = successor, None
        # A computation of a motion notices by the generation that it comes too late.
        self.generation += 1
        self.cleared_at = time.time_ns()
        self._changed()
        return dropped != (None, None)
