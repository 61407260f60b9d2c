"""
What the processes of all nodes have in common: signals, the executor, an orderly end.

SIGINT and SIGTERM only write to a pipe, which a thread reads, so that no callback is cut short.
"""

from collections.abc import Callable, Sequence
import os
import signal
import threading
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

SIGNALS = (signal.SIGINT, signal.SIGTERM)


def make_executor() -> Any:
    """Return the fastest executor that this rclpy has."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def stop_on_signal(stop: Future) -> None:
    """
    Let SIGINT and SIGTERM complete `stop`, and nothing else.

    The interpreter's C handler writes each signal's number to the pipe at once, whatever the main
    thread is doing; the Python handlers have nothing left to do. (Blocking the signals and waiting
    for them would not do: threads that libraries made at import do not inherit the mask.)
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    for number in SIGNALS:
        signal.signal(number, lambda number, frame: None)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)

    def wait() -> None:
        os.read(reading, 1)
        stop.set_result(True)

    threading.Thread(target=wait, name='signals', daemon=True).start()


def run_until_signal(run: Callable[[Future], int], arguments: Sequence[str] | None) -> int:
    """
    Call `run` between the beginning and the end of ROS; return the exit code.

    Parameters
    ----------
    run : callable
        Takes a future that a signal completes; returns the exit code.
    arguments : sequence of str, optional
        Of the command line; default: those of this process.

    """
    stop = Future()
    stop_on_signal(stop)
    rclpy.init(args=None if arguments is None else list(arguments),
               signal_handler_options=SignalHandlerOptions.NO)
    try:
        return run(stop)
    finally:
        rclpy.try_shutdown()
