"""Executors of the message loop: a thread that waits with rcl, and callbacks of rclpy."""

from collections.abc import Callable, Sequence
import ctypes
import time
from typing import Any

from kane_dynamics.ros.common.cdr import float64_multi_array
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.common.qos import THREAD_STATES
from kane_dynamics.ros.common.rcl_functions import handle_address, RclLoop
from kane_dynamics.ros.torque_path.native_loop import function_address, NativeLoop, REFUSED
from sensor_msgs.msg import JointState

CLOCK = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int64))
STEADY = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.POINTER(ctypes.c_int64))
PUBLISH = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p,
                            ctypes.c_void_p)
TORQUES, REQUESTS = 1, 2  # stand for the handles of publishers in Python


class CallbackExecutor:
    """
    Runs the loop in callbacks of rclpy and publishes in Python.

    Parameters
    ----------
    loop : NativeLoop
    now : callable
        Returns the clock, ns.
    send : callable
        Publishes the torques of the loop's memory.

    """

    hears_time = False

    def __init__(self, loop: NativeLoop, now: Callable[[], int],
                 send: Callable[[], None]) -> None:
        self._loop = loop
        self._heard = float64_multi_array(len(loop.heard))
        self._requests: Any = None

        def read_clock(handle: int, nanoseconds: Any) -> int:
            nanoseconds[0] = now()
            return 0

        def read_steady(kind: int, seconds: Any) -> int:
            seconds[0], seconds[1] = divmod(round(time.perf_counter() * NANO), NANO)
            return 0

        def publish(publisher: int, message: int, heap: int) -> int:
            try:
                if publisher == TORQUES:
                    send()
                else:
                    self._requests.publish(loop.request.serialized())
            except Exception as error:  # which ends the path, as in a thread
                loop.fail(error)
                return REFUSED
            return 0
        # Alive as long as the loop
        self._functions = CLOCK(read_clock), STEADY(read_steady), PUBLISH(publish)
        clock, steady, publish_function = map(function_address, self._functions)
        loop.set_fields(clock=clock, steady=steady, publish=publish_function)
        loop.publish_to(0, TORQUES)

    def ask(self, requests: Any) -> None:
        """Publish requests to torque_guard by a publisher."""
        self._requests = requests
        self._loop.ask(REQUESTS)

    def waiting_states(self) -> list[bytes]:
        """Return no states: rclpy passes those that waited to the callback."""
        return []

    def start(self) -> str:
        """Do nothing, and return no warning: the loop runs in callbacks."""
        return ''

    def stop(self) -> None:
        """Do nothing: no state is answered while the path does not run."""

    def close(self) -> None:
        """Do nothing: the publishers are those of the node."""

    def on_state(self, data: bytes) -> None:
        """Answer a serialized JointState."""
        self._loop.call('cycle', data)

    def hear(self, numbers: Array) -> None:
        """Note a message of torque_guard."""
        self._heard.numbers[:] = numbers
        self._loop.call('hear', self._heard.serialized())

    def look_at_clock(self) -> None:
        """Apply what is due without a state."""
        self._loop.call('look_at_time')


class ThreadExecutor:
    """
    Runs the loop in a thread that waits with rcl, takes messages and publishes itself.

    Parameters
    ----------
    loop : NativeLoop
    node : Node
        Its clock and its context are used.
    states, guard, clock : Subscription
        Of joint states, ~/guard_state and /clock, which no executor of rclpy reads; None
        without torque_guard or simulated time.
    wake : GuardCondition
        Wakes the thread.
    publishers : sequence of Publisher
        Of commands, torques and, if there are any, stamped commands.

    Raises
    ------
    UnsupportedError
        This rclpy or rcl is another one than expected.

    """

    def __init__(self, loop: NativeLoop, node: Any, states: Any, guard: Any, clock: Any,
                 wake: Any, publishers: Sequence[Any]) -> None:
        # States, then what else the configuration has; the places tell the native loop
        # which is which.
        subscriptions = [states]
        places: list[int | None] = []
        for subscription in (guard, clock):
            places.append(None if subscription is None else len(subscriptions))
            if subscription is not None:
                subscriptions.append(subscription)
        self._rcl = RclLoop(node.context, node.get_clock(), subscriptions, wake)
        self._loop = loop
        self._states = states
        self._time_source = node.get_clock() if clock is not None else None
        addresses = [handle_address(publisher) for publisher in publishers]
        loop.connect(self._rcl, *places)
        loop.publish_to(*addresses)

    @property
    def hears_time(self) -> bool:
        """Return whether the thread has its time from /clock."""
        source = self._time_source
        return source is not None and bool(source.ros_time_is_active)

    def ask(self, requests: Any) -> None:
        """Publish requests to torque_guard by a publisher."""
        self._loop.ask(handle_address(requests))

    def waiting_states(self) -> list[bytes]:
        """Return the states that came while no thread read them."""
        states: list[bytes] = []
        waiting = self._states.handle
        with waiting:
            for _ in range(THREAD_STATES.depth):
                taken = waiting.take_message(JointState, True)
                if taken is None:
                    break
                states.append(taken[0])
        return states

    def start(self) -> str:
        """
        Start the thread with the scheduling of the main one; return a warning or ''.

        Raises
        ------
        OSError
            The system starts no thread.

        """
        self._loop.start_thread()
        try:
            self._loop.scheduled_as_main()
        except OSError as error:
            return (f'scheduling refused ({error.strerror}); it runs with ordinary '
                    'scheduling')
        return ''

    def stop(self) -> None:
        """Stop the thread and wait for its end."""
        self._loop.stop_thread()

    def close(self) -> None:
        """Stop the thread and free what rcl allocated."""
        self._loop.stop_thread()
        self._rcl.close()

    def on_state(self, data: bytes) -> None:
        """Do nothing: the thread takes states itself, and what the plan replays."""

    def hear(self, numbers: Array) -> None:
        """Do nothing: the thread hears torque_guard itself."""

    def look_at_clock(self) -> None:
        """Do nothing: the thread looks at the clock, with the plan of now."""
