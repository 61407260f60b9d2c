"""One thread that does long work in turn, so that the services' executor stays free."""

from collections.abc import Callable
import queue
import threading

from kane_dynamics.errors import KaneError
from rclpy.task import Future


class BusyError(KaneError):
    """The queue of waiting simulations is full."""


class Worker:
    """
    A thread with a bounded queue.

    Parameters
    ----------
    wake : callable
        Called in the worker's thread after a piece of work is done; wakes the executor whose
        coroutines wait for it.

    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self.stopping = False
        self._wake = wake
        self._queue: queue.SimpleQueue[tuple[Callable[[], None], Future] | None] = (
            queue.SimpleQueue())
        self._thread = threading.Thread(target=self._run, name='simulations', daemon=True)
        self._thread.start()

    def submit(self, work: Callable[[], None], max_waiting: int) -> Future:
        """
        Queue `work`; the future that is returned is done, or holds its exception, when it ends.

        Raises
        ------
        BusyError
            As many pieces of work are waiting as may wait.

        """
        if self._queue.qsize() >= max_waiting:
            raise BusyError(f'busy: {max_waiting} simulations are waiting (parameter '
                            'simulation.max_waiting); try again later')
        future = Future()
        self._queue.put((work, future))
        return future

    def stop(self, timeout: float) -> None:
        """Let the running work end early (it asks `stopping`) and end the thread."""
        self.stopping = True
        self._queue.put(None)
        self._thread.join(timeout)

    def _run(self) -> None:
        """Do the work, one piece after another, until told to stop."""
        while (item := self._queue.get()) is not None and not self.stopping:
            work, future = item
            try:
                work()
            except BaseException as error:
                future.set_exception(error)
            else:
                future.set_result(None)
            self._wake()
