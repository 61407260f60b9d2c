"""The dynamics node's side of torque_guard: who commands, and whether it lives."""

from collections.abc import Callable
from contextlib import ExitStack
import time

from kane_dynamics.control_cycle.arbitration import (Arbitration, arbitration_kernels,
                                                     begun, DISCOVERY, FIELDS, LOST,
                                                     NUMBER, PERMITTED, SENDS, SIZE,
                                                     STOPPED, UNANSWERED, UNGUARDED)
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


class GuardLink:
    """
    Asks torque_guard for `commands` whenever it may have taken over.

    The rules are those of `arbitration`. On the native torque path the thread follows
    them; this link then publishes the loads and hears whether the guard lives.

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
    digest : float
        Digest of the arm, which must be that of the guard.

    Attributes
    ----------
    requests : Publisher
        Of ~/guard_request.

    """

    def __init__(self, node: Node, path: TorquePath, lease: float, opened: ExitStack,
                 count: int, digest: float) -> None:
        self._digest = digest
        self._path = path
        self._log = node.get_logger()
        self._lease = round(lease * NANO)
        self.new_parameters()
        self._request = float64_multi_array(1)
        self._state = float64_multi_array(FIELDS + count)
        # The compiled rules read the state and the time, and write the next state.
        self._last = np.array(UNGUARDED._replace(opened=_now()))
        self._time = np.zeros(())
        self._next = np.zeros(SIZE)
        # Views are read and copied several times as fast as the arrays.
        self._to, self._from = memoryview(self._last), memoryview(self._next)
        self._clock = memoryview(self._time).cast('B').cast('d')
        self._unanswered = 0.0  # as reported
        rules = arbitration_kernels(path.controller.robot, count)
        inputs = [self._last, self._time]
        self._before_command = rules.before_command.bind(inputs, self._next, 'Decide.')
        self._before_zeros = rules.before_zeros.bind(inputs, self._next, 'Decide.')
        self._after_computing = rules.after_computing.bind(inputs, self._next, 'Decide.')
        self._heard = rules.heard.bind([*inputs, self._state.numbers], self._next, 'Hear.')
        self.requests = node.create_publisher(Float64MultiArray, f'~/{REQUEST}', RELIABLE)
        opened.callback(node.destroy_publisher, self.requests)
        self._loads = node.create_publisher(Float64MultiArray, f'~/{LOADS}', LATCHED)
        opened.callback(node.destroy_publisher, self._loads)
        opened.callback(node.destroy_subscription, node.create_subscription(
            Float64MultiArray, f'~/{STATE}', self._on_state, RELIABLE, raw=True))

    def new_parameters(self) -> None:
        """Ask the guard to read the parameters of this node again, with the next loads."""
        # Exact in a double until 2255
        self._configuration = float(time.time_ns() // 1000)

    def publish_loads(self, loads: GravityAndPayload) -> None:
        """Publish gravity and payload for the guard; callable from any thread."""
        self._loads.publish(Float64MultiArray(data=loads_to_numbers(
            self._configuration, loads, self._digest)))

    @property
    def arbitration(self) -> Arbitration:
        """Return the state of the guard as this node knows it."""
        return Arbitration(*self._last.tolist())

    @property
    def warning(self) -> str:
        """Return a warning of a guard that does not live, with the remedy; empty if it lives."""
        # After a pause of the interpreter, its heartbeats have not been read yet.
        seen = max(self.arbitration.seen, self._path.guard_seen)
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
        known = self.arbitration
        return bool(known.seen) or _now() > known.opened + DISCOVERY

    @property
    def waiting(self) -> bool:
        """Return whether this node waits for an answer of the guard."""
        known = self._path.arbitration or self.arbitration
        return bool(known.asked)

    def beginning(self) -> Arbitration:
        """Return the state of a node that starts, and asks before its first command."""
        number = float(time.time_ns() // 1000)  # greater than those of earlier requests
        return begun(self.arbitration, self._lease, _now(), number)

    def start(self) -> None:
        """Ask before the first command, unless the thread of the path does."""
        if self._path.arbitration is not None:
            return
        self._last[:] = self.beginning()
        self._unanswered = 0.0
        self._decide(self._before_zeros, _now())

    def may_command(self, now: float) -> bool:
        """
        Return whether this node may command.

        Ask the guard if it may have taken over.
        """
        return self._decide(self._before_command, round(now * NANO))

    def may_repeat(self, now: float) -> bool:
        """Return whether this node may command at a refused state."""
        return self.may_command(now)

    def may_stop(self, now: float) -> bool:
        """Return whether this node may command zeros; ask as before a command."""
        return self._decide(self._before_zeros, round(now * NANO))

    def confirm(self, now: float) -> bool:
        """Return whether computing the command was not interrupted for too long."""
        return self._decide(self._after_computing, round(now * NANO))

    def note_zeros(self) -> None:
        """Report to the guard that this node commanded zeros."""
        self._send(STOPPED)

    def _decide(self, rule: Callable[[], object], now: int) -> bool:
        """Return the permission by a rule; send the request that the rule asks for."""
        # The rule reads and writes one array, which the native path uses too.
        decided = self._from
        self._clock[0] = now
        rule()
        self._to[:] = decided
        if decided[SENDS]:
            self._send(decided[NUMBER])
        if decided[UNANSWERED] > self._unanswered:
            self._unanswered = decided[UNANSWERED]
            self.report_silence()
        return decided[PERMITTED] > 0.5

    def _send(self, number: float) -> None:
        """Send a request."""
        self._request.numbers[0] = number
        self.requests.publish(self._request.serialized())

    def _on_state(self, data: bytes) -> None:
        """Note a heartbeat, or the answer to the last request."""
        if not self._state.read(data) or not np.isfinite(self._state.numbers).all():
            return
        self._decide(self._heard, _now())
        noted = self.arbitration
        if not noted.answered:
            return
        if noted.resumes:
            # The last torques are the guard's; the limit of the rate counts from them.
            dropped = self._path.resume(self._state.numbers[FIELDS:].copy())
            if self._state.numbers[1]:
                self.report_return(noted.silent / NANO, dropped)
        if noted.retries:
            # Answer the state for which this node asked, if no later one came.
            self._path.retry()
        self._path.check_timeout()

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
