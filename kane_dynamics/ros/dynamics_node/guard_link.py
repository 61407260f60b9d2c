"""The dynamics node's side of torque_guard: who commands, and whether it lives."""

from contextlib import ExitStack
import time

from kane_dynamics.control_cycle.arbitration import (Arbitration, begun, DISCOVERY,
                                                     FIELDS, heard, LOST, UNGUARDED)
from kane_dynamics.ros.common.cdr import float64_multi_array
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.common.qos import LATCHED, RELIABLE
from kane_dynamics.ros.guard.guard_messages import (LOADS, loads_to_numbers, REQUEST,
                                                    STATE)
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload
from kane_dynamics.ros.torque_path.torque_path import TorquePath
import numpy as np
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray


class LoadsTopic:
    """
    Publishes gravity and payload on ~/loads, for the guard and monitors.

    Parameters
    ----------
    node : Node
        The dynamics node.
    digest : float
        Digest of the arm, which must be that of the listeners.
    opened : ExitStack
        Closes the topic.

    """

    def __init__(self, node: Node, digest: float, opened: ExitStack) -> None:
        self._digest = digest
        self._publisher = node.create_publisher(Float64MultiArray, f'~/{LOADS}', LATCHED)
        opened.callback(node.destroy_publisher, self._publisher)
        self.new_parameters()

    def new_parameters(self) -> None:
        """Ask the guard to read the parameters of this node again, with the next loads."""
        # Exact in a double until 2255
        self._configuration = float(time.time_ns() // 1000)

    def publish(self, loads: GravityAndPayload) -> None:
        """Publish gravity and payload; callable from any thread."""
        self._publisher.publish(Float64MultiArray(data=loads_to_numbers(
            self._configuration, loads, self._digest)))


class GuardLink:
    """
    Asks torque_guard for `commands` whenever it may have taken over.

    The torque path follows the rules of `arbitration`. This link sends its requests and
    hears the guard.

    Parameters
    ----------
    node : Node
        The dynamics node, which owns the topics.
    path : TorquePath
    lease : float
        Parameter guard.lease, s.
    opened : ExitStack
        Closes the topics.
    count : int
        Number of joints.

    Attributes
    ----------
    requests : Publisher
        Of ~/guard_request.

    """

    def __init__(self, node: Node, path: TorquePath, lease: float, opened: ExitStack,
                 count: int) -> None:
        self._path = path
        self._log = node.get_logger()
        self._lease = round(lease * NANO)
        self._request = float64_multi_array(1)
        self._state = float64_multi_array(FIELDS + count)
        self._known = UNGUARDED._replace(opened=float(_now()))
        self.requests = node.create_publisher(Float64MultiArray, f'~/{REQUEST}', RELIABLE)
        opened.callback(node.destroy_publisher, self.requests)
        opened.callback(node.destroy_subscription, node.create_subscription(
            Float64MultiArray, f'~/{STATE}', self._on_state, RELIABLE, raw=True))

    @property
    def warning(self) -> str:
        """Return a warning of a guard that does not live, with the remedy; empty if it lives."""
        # After a pause of the interpreter, its heartbeats have not been read yet.
        seen = max(self._known.seen, self._path.guard_seen)
        silent = (_now() - seen) / NANO if seen else None
        if silent is not None and silent < LOST:
            return ''
        return ('torque_guard ' + ('not found' if silent is None
                                   else f'silent for {silent:.1f} s')
                + ': the last torque would stay if this node died; start torque_guard, '
                'or read in its log why it does not guard')

    @property
    def overdue(self) -> bool:
        """Return whether a guard should have been found by now."""
        return bool(self._known.seen) or _now() > self._known.opened + DISCOVERY

    @property
    def waiting(self) -> bool:
        """Return whether this node waits for an answer of the guard."""
        known = self._path.arbitration
        return known is not None and bool(known.asked)

    def beginning(self) -> Arbitration:
        """Return the state of a node that starts, and asks before its first command."""
        number = float(time.time_ns() // 1000)  # greater than those of earlier requests
        return begun(self._known, self._lease, _now(), number)

    def send(self, number: float) -> None:
        """Send a request to torque_guard."""
        self._request.numbers[0] = number
        self.requests.publish(self._request.serialized())

    def _on_state(self, data: bytes) -> None:
        """Note a heartbeat, or the answer to the last request."""
        if not self._state.read(data) or not np.isfinite(self._state.numbers).all():
            return
        numbers = self._state.numbers.copy()
        # Also without a running path: the next activation asks a guard that lives.
        self._known = heard(self._known, numbers, float(_now()))
        self._path.hear(numbers)

    def report_silence(self) -> None:
        """Log that the guard does not answer."""
        self._log.warning('torque_guard does not answer; commanding without it')

    def report_return(self, silent: float, dropped: bool) -> None:
        """Log that the guard held the arm, after a silence of this node, s."""
        text = 'torque_guard held the arm'
        if self._path.last_update > 0.0:
            text += f' while this node was silent for {silent:.3f} s'
        text += '; continuing from its torques'
        if dropped:
            text += ', desired motion dropped'
        self._log.warning(text)


def _now() -> int:
    """Return the steady time, ns."""
    return round(time.perf_counter() * NANO)
