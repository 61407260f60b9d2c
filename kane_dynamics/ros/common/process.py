"""
The process of a node: signal handling, executor, and shutdown.

SIGINT and SIGTERM write to a pipe that a thread reads, so that no callback is
interrupted.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
import os
import signal
import threading
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.early_signals import SIGNALS
import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

SPIN_TIMEOUT = 1e6  # s; the EventsExecutor's spin needs a finite timeout to wait


def events_executor() -> type | None:
    """
    Return the class EventsExecutor of the installed rclpy, or None.

    Jazzy has it from rclpy 7.1.4 on, Kilted and Lyrical always, as experimental; a later
    release may keep it beside the other executors.
    """
    for module in ('rclpy.experimental', 'rclpy.executors'):
        with suppress(ImportError, AttributeError):
            executor: type = import_module(module).EventsExecutor
            return executor
    return None


def make_executor(node: Node) -> Any:
    """Return an executor of a node: an EventsExecutor if rclpy has one."""
    # The events executor wakes for a message without looking at all others.
    kind = events_executor()
    if kind is None:
        kind = SingleThreadedExecutor
        node.get_logger().warning(
            'rclpy: without EventsExecutor; expected 7.1.4 or newer. The '
            'SingleThreadedExecutor is used instead: torques come later, and more joint '
            'states are lost at high rates')
    executor = kind()
    executor.add_node(node)
    return executor


def spin(node: Node, executor: Any, stop: Future,
         timeout: Callable[[], float] = lambda: SPIN_TIMEOUT,
         failed: Callable[[str], None] = lambda reason: None) -> None:
    """
    Spin until `stop`, each time for `timeout` s.

    Report a failed callback and call `failed` with the reason.
    """
    # A callback that fails must not end a node that commands torques.
    while not stop.done():
        try:
            executor.spin_until_future_complete(stop, timeout())
        except Exception as error:
            reason = f'callback failed: {type(error).__name__}: {error}'
            node.get_logger().fatal(reason)
            failed(reason)


def stop_on_signal(stop: Future) -> None:
    """
    Complete the future `stop` on SIGINT or SIGTERM.

    The interpreter's C handler writes the signal number to a pipe immediately; the
    Python handlers do nothing. Blocking the signals and waiting for them does not work,
    because threads that libraries start at import do not inherit the mask.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    # First, so that no signal is lost
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    for number in SIGNALS:
        signal.signal(number, lambda number, frame: None)

    def wait() -> None:
        os.read(reading, 1)
        stop.set_result(True)

    threading.Thread(target=wait, name='signals', daemon=True).start()


def run_until_signal(run: Callable[[Future], None], arguments: Sequence[str]) -> int:
    """
    Initialize rclpy, call `run`, shut rclpy down, and return the exit code 0.

    Parameters
    ----------
    run : callable
        Receives a future that a signal completes.
    arguments : sequence of str
        The program and its arguments.

    Raises
    ------
    InputError
        An argument for ROS is invalid, or a parameter is of a type that it cannot have.

    """
    stop = Future()
    stop_on_signal(stop)
    try:
        rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # several classes of rclpy
        reason = str(error).partition(', at /')[0]
        raise InputError(f'arguments: {reason}; expected arguments of ROS 2 after '
                         '--ros-args') from None
    try:
        run(stop)
    except ParameterException as error:
        raise InputError(str(error)) from None
    finally:
        rclpy.try_shutdown()
    return 0
