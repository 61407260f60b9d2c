"""
The process of a node: signal handling, executor, and shutdown.

SIGINT and SIGTERM write to a pipe that a thread reads, so that no callback is interrupted.
"""

from collections.abc import Callable, Sequence
import os
import signal
import threading
from typing import Any

from kane_dynamics.ros.common.early_signals import SIGNALS
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future


def make_executor() -> Any:
    """Return an EventsExecutor if rclpy has one, else a SingleThreadedExecutor."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def stop_on_signal(stop: Future) -> None:
    """
    Complete the future `stop` on SIGINT or SIGTERM.

    The interpreter's C handler writes the signal number to a pipe immediately; the Python handlers
    do nothing. Blocking the signals and waiting for them does not work, because threads that
    libraries start at import do not inherit the mask.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)  # first, so that no signal is lost
    for number in SIGNALS:
        signal.signal(number, lambda number, frame: None)

    def wait() -> None:
        os.read(reading, 1)
        stop.set_result(True)

    threading.Thread(target=wait, name='signals', daemon=True).start()


def run_until_signal(run: Callable[[Future], int], arguments: Sequence[str] | None) -> int:
    """
    Initialize rclpy, call `run`, shut rclpy down, and return the exit code.

    Parameters
    ----------
    run : callable
        Receives a future that a signal completes; returns the exit code.
    arguments : sequence of str, optional
        Command-line arguments; default: those of this process.

    """
    stop = Future()
    stop_on_signal(stop)
    rclpy.init(args=None if arguments is None else list(arguments),
               signal_handler_options=SignalHandlerOptions.NO)
    try:
        return run(stop)
    finally:
        rclpy.try_shutdown()
