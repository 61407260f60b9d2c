"""The dynamics node's side of torque_guard: who commands, and whether it lives."""

from contextlib import ExitStack
import time

from kane_dynamics.ros.common.qos import LATCHED, RELIABLE
from kane_dynamics.ros.torque_path.cdr import float64_multi_array
from kane_dynamics.ros.torque_path.gravity_payload import GravityAndPayload
from kane_dynamics.ros.torque_path.guard_messages import (FIELDS, LOADS,
                                                          loads_to_numbers, LOST,
                                                          REQUEST, STATE, STOPPED)
from kane_dynamics.ros.torque_path.torque_path import TorquePath
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

# Of the lease, after which this node may no longer command without a request
SHARE = 0.75
PERIODS = 1.5     # the guard takes over after two periods of the states at the earliest
RELAX = 1.002     # growth of the estimated period for each state
REPEAT = 0.005    # s between two requests
ANSWER = 0.05     # s for the answer of a living guard
STALL = 0.02      # s: of a longer time between two requests, this part was a wait
# S after configure for the first heartbeat: Fast DDS may need one of its own
DISCOVERY = 3.5


class GuardLink:
    """
    Asks torque_guard for `commands` whenever it may have taken over.

    The guard takes over after guard.lease without a command, and after two states
    without one. Until a part of that time has passed, this node may command without
    asking; later, and after each activation, it sends a request and is silent until the
    guard answers that it is silent too. Without a living guard it commands after a short
    wait.

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

    """

    def __init__(self, node: Node, path: TorquePath, lease: float, opened: ExitStack,
                 count: int, digest: float) -> None:
        self._digest = digest
        self._guard = 0.0  # identity of the guard
        self._path = path
        self._log = node.get_logger()
        self._shortest = SHARE * lease
        self._seen = 0.0  # time of the last heartbeat; 0: none yet
        self._last = 0.0  # time of the last command, s
        # Last state; estimate of their period, s; 0: none
        self._arrived = 0.0
        self._period = 0.0
        self._asked = False  # whether a request has no answer yet
        # First and last time at which it was sent; 0: not yet
        self._sent = self._repeated = 0.0
        self._waited = 0.0  # s, without stalls of this process
        self._opened = time.perf_counter()
        self.new_parameters()
        self._number = self._configuration
        self._request = float64_multi_array(1)
        self._state = float64_multi_array(FIELDS + count)
        self._requests = node.create_publisher(Float64MultiArray, f'~/{REQUEST}',
                                               RELIABLE)
        opened.callback(node.destroy_publisher, self._requests)
        self._loads = node.create_publisher(Float64MultiArray, f'~/{LOADS}', LATCHED)
        opened.callback(node.destroy_publisher, self._loads)
        opened.callback(node.destroy_subscription, node.create_subscription(
            Float64MultiArray, f'~/{STATE}', self._on_state, RELIABLE, raw=True))

    def new_parameters(self) -> None:
        """Let the guard read the parameters of this node again, with the next loads."""
        # Exact in a double until 2255
        self._configuration = float(time.time_ns() // 1000)

    def publish_loads(self, loads: GravityAndPayload) -> None:
        """Publish gravity and payload for the guard; callable from any thread."""
        self._loads.publish(Float64MultiArray(data=loads_to_numbers(
            self._configuration, loads, self._digest)))

    @property
    def warning(self) -> str:
        """Return what is wrong with the guard, and what to do; empty if it lives."""
        silent = time.perf_counter() - self._seen if self._seen else None
        if silent is not None and silent < LOST:
            return ''
        return ('torque_guard ' + ('not found' if silent is None
                                   else f'silent for {silent:.1f} s')
                + ': the last torque would stay if this node died; start torque_guard, '
                'or read in its log why it does not guard')

    @property
    def overdue(self) -> bool:
        """Return whether a guard should have been found by now."""
        return bool(self._seen) or time.perf_counter() > self._opened + DISCOVERY

    @property
    def waiting(self) -> bool:
        """Return whether this node waits for an answer of the guard."""
        return self._asked

    def start(self) -> None:
        """Ask before the first command."""
        self._ask(time.perf_counter())

    def may_command(self, now: float) -> bool:
        """
        Return whether this node may command.

        Ask the guard if it may have taken over.
        """
        if self._arrived:
            gap = now - self._arrived
            self._period = min(gap, RELAX * self._period) if self._period else gap
        self._arrived = now
        if not self.may_stop(now):
            return False
        self._last = now
        return True

    def may_repeat(self, now: float) -> bool:
        """Return whether this node may command at a refused state."""
        return self.may_command(now)

    def may_stop(self, now: float) -> bool:
        """Return whether this node may command zeros; ask as before a command."""
        if self._asked:
            return self._answered(now)
        # The guard may command after its lease and after two states without a command. A
        # guard that was lost before the last command does not.
        gap = now - self._last
        lease_is_over = gap > self._shortest and gap > PERIODS * self._period
        if lease_is_over and self._last - self._seen < LOST:
            self._ask(now)
            return False
        return True

    def note_zeros(self) -> None:
        """Report to the guard that this node commanded zeros."""
        self._request.numbers[0] = STOPPED
        self._requests.publish(self._request.serialized())

    def confirm(self, now: float) -> bool:
        """Return whether computing the command was not interrupted for too long."""
        if now - self._last > self._shortest and self._last - self._seen < LOST:
            self._ask(now)
            return False
        return True

    def _answered(self, now: float) -> bool:
        """Return whether the wait for an answer is over; repeat the request."""
        # Discovery takes seconds; a guard that was heard answers at once.
        silent_for_long = self._waited > ANSWER
        not_discovered = now > self._opened + DISCOVERY
        if silent_for_long if self._seen else not_discovered:
            self._log.warning('torque_guard does not answer; commanding without it')
            self._asked = False
            self._last = now
            return True
        self._send(now)
        return False

    def _ask(self, now: float) -> None:
        self._asked = True
        self._number += 1.0
        self._sent = 0.0
        self._repeated = now - REPEAT
        self._waited = 0.0
        self._send(now)

    def _send(self, now: float) -> None:
        """Send the request, at most once every REPEAT, to a guard that can answer."""
        if not self._seen or now - self._repeated < REPEAT:
            return
        # A stall of this process is no silence of the guard.
        self._waited += min(now - self._repeated, STALL)
        self._sent = self._sent or now
        self._repeated = now
        self._request.numbers[0] = self._number
        self._requests.publish(self._request.serialized())

    def _on_state(self, data: bytes) -> None:
        """Note a heartbeat, or the answer to the last request."""
        now = time.perf_counter()
        if not self._state.read(data):
            return
        number, acting, commanded, guard, *_ = self._state.numbers.tolist()
        if guard > self._guard > 0.0 and now - self._seen < LOST:
            return  # of a second guard, which stops when it finds the first one
        self._guard = guard
        first = not self._seen
        self._seen = now
        if not self._asked:
            return
        if number != self._number:
            if first:  # only now an answer is sure to arrive
                self._ask(now)
            return
        # The answer: the topic is handed over.
        silent = now - self._last
        # The guard counts its lease from the request on.
        self._asked = False
        self._last = self._sent
        if commanded:
            # The last torques are the guard's; the limit of the rate counts from them.
            dropped = self._path.resume(self._state.numbers[FIELDS:].copy())
            if acting:
                self._report_return(silent, dropped)
        if not acting:
            # Answer the state for which this node asked, if no later one came.
            period = self._period
            self._path.retry()
            self._period = period  # no state arrived
        self._path.check_timeout()

    def _report_return(self, silent: float, dropped: bool) -> None:
        """Log that the guard held the arm, after a silence of this node, s."""
        text = 'torque_guard held the arm'
        if self._path.last_update > 0.0:
            text += f' while this node was silent for {silent:.3f} s'
        text += '; continuing from its torques'
        if dropped:
            text += ', desired motion dropped'
        self._log.warning(text)
