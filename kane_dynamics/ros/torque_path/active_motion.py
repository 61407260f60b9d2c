"""The desired motion: the one that is followed, the one that comes after it, and their end."""

import threading
import time

from kane_dynamics.motion.motion import Motion, State
from kane_dynamics.ros.common.conversion import NANO

BegunMotion = tuple[Motion, int]  # a motion, and the node's time at which it begins, ns


class ActiveMotion:
    """
    What the torque path follows.

    Motions come from the services' thread, which reads and fits them; the torque path asks at
    every state, and forgets all when it must not be followed any more. A motion that was received
    before that, or whose reading had begun, is not followed either.

    Attributes
    ----------
    generation : int
        Raised whenever everything is forgotten.
    forgotten : int
        When that was, ns of the system's time.

    """

    def __init__(self) -> None:
        self._lock = threading.Lock()  # of those who write
        self._motions: tuple[BegunMotion | None, BegunMotion | None] = None, None
        self.generation, self.forgotten = 0, time.time_ns()

    def at(self, stamp: int) -> tuple[Motion | None, float]:
        """Return the motion in force at a time, ns, and the time since it began, s."""
        motion, upcoming = self._motions
        if upcoming is not None and stamp >= upcoming[1]:
            motion = upcoming
        return (None, 0.0) if motion is None else (motion[0], (stamp - motion[1]) / NANO)

    def desired(self, stamp: int) -> State | None:
        """Return q, u and udot that are desired at a time, ns; None if nothing is."""
        motion, moment = self.at(stamp)
        return None if motion is None else motion.sample(moment)

    def follow(self, motion: Motion, start: int, now: int, generation: int) -> bool:
        """
        Follow `motion` from `start` on, and until then the one that is in force now, ns.

        Returns
        -------
        bool
            False if all was forgotten since `generation`: the motion is then not followed.

        """
        with self._lock:
            if generation != self.generation:
                return False
            before, upcoming = self._motions
            if upcoming is not None and now >= upcoming[1]:
                before = upcoming
            self._motions = before, (motion, start)
            return True

    def forget(self) -> bool:
        """Follow nothing; return whether there was anything to follow."""
        with self._lock:
            before, self._motions = self._motions, (None, None)
            self.generation += 1
            self.forgotten = time.time_ns()
            return before != (None, None)
