"""What looks on at the torque path: called after each command, in the path's thread."""

from typing import NamedTuple, Protocol

from kane_dynamics.motion.motion import Motion
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.torque_path.joint_state_reader import JointStateReader


class Cycle(NamedTuple):
    """
    One state and what came of it.

    Attributes
    ----------
    stamp : int
        Of the state, ns; that of its receipt where it has none.
    state : JointStateReader
        Its arrays are overwritten by the next state.
    motion : Motion or None
        The desired motion, if there is one.
    moment : float
        Time since the motion began, s.
    tau : (n,) array
        The command, N m or N.
    external : (n,) array or None
        What known wrenches do to the joints, N m or N.

    """

    stamp: int
    state: JointStateReader
    motion: Motion | None
    moment: float
    tau: Array
    external: Array | None


class CycleObserver(Protocol):
    """Looks on at the torque path; every call must be short."""

    def start(self) -> None:
        """Begin anew: the path starts to answer states."""

    def take(self, cycle: Cycle) -> None:
        """Look at a state that has been answered."""

    def refresh(self) -> None:
        """Take note that gravity or payload of the path's robot have changed."""

    def stop(self) -> None:
        """End: the path answers no more states."""
