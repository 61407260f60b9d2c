"""The measured states of a goal, recorded by the torque path for the services' thread."""

from collections import deque

from kane_dynamics.motion.motion import Motion
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.torque_path.cycle_observer import ObservedCycle
import numpy as np
from numpy.typing import NDArray

MOST_STATES = 20_000  # that wait, as if the services' thread were busy for seconds


class StateRecord:
    """
    An observer of the torque path that keeps the states of one motion.

    The torque path's thread appends, and the services' thread takes.

    Parameters
    ----------
    motion : Motion
        States are kept while the arm follows it.

    """

    def __init__(self, motion: Motion) -> None:
        self.motion = motion
        self._states: deque[tuple[int, Array, Array]] = deque(maxlen=MOST_STATES)

    def start(self) -> None:
        """Keep what was recorded: the motion ended before."""

    stop = on_loads_changed = start

    def on_cycle(self, cycle: ObservedCycle) -> None:
        """Keep a state of the motion."""
        if cycle.motion is self.motion:
            state = cycle.state
            self._states.append((cycle.stamp, state.q.copy(), state.u.copy()))

    def take(self) -> tuple[NDArray[np.int64], Array, Array] | None:
        """Return stamps (K,), ns, positions and speeds since the last call, if any."""
        states = []
        while self._states:
            states.append(self._states.popleft())
        if not states:
            return None
        stamps, q, u = zip(*states)
        return np.array(stamps, dtype=np.int64), np.array(q), np.array(u)
