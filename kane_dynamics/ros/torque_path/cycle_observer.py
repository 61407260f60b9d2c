"""Interfaces that the torque path calls: observers of cycles, and torque_guard's side."""

from typing import Any, NamedTuple, Protocol

from kane_dynamics.control.torque_limiter import Command
from kane_dynamics.control_cycle.arbitration import Arbitration
from kane_dynamics.motion.motion import Motion
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.torque_path.joint_state_reader import JointStateReader


class ObservedCycle(NamedTuple):
    """
    One joint state and the command computed from it.

    Attributes
    ----------
    stamp : int
        Stamp of the state, ns; the time of its reception if it has no stamp.
    state : JointStateReader
        The state; the next state overwrites its arrays.
    motion : Motion or None
        The active motion, if there is one.
    moment : float
        Time since the start of the motion, s.
    tau : (n,) array
        The command, N m or N.
    external : (n,) array or None
        Joint torques of the known wrenches, N m or N.
    command : Command
        The command with its limits.

    """

    stamp: int
    state: JointStateReader
    motion: Motion | None
    moment: float
    tau: Array
    external: Array | None
    command: Command


class CycleObserver(Protocol):
    """Observes the torque path in its thread; every call must be short."""

    def start(self) -> None:
        """Reset, because the torque path starts."""

    def on_cycle(self, cycle: ObservedCycle) -> None:
        """Process one state and its command."""

    def on_loads_changed(self) -> None:
        """Use the new gravity and payload of the robot."""

    def stop(self) -> None:
        """Stop, because the torque path stops."""


class GuardSide(Protocol):
    """
    The side of torque_guard in the dynamics node.

    Attributes
    ----------
    requests : Publisher

    """

    requests: Any

    def beginning(self) -> Arbitration:
        """Return the state of a node that starts, and asks before its first command."""

    def send(self, number: float) -> None:
        """Send a request to torque_guard."""

    def report_silence(self) -> None:
        """Log that the guard does not answer."""

    def report_return(self, silent: float, dropped: bool) -> None:
        """Log that the guard held the arm, after a silence of this node, s."""
