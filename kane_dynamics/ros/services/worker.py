"""A thread that runs simulations one after another."""

from collections.abc import Callable
import queue
import threading

from kane_dynamics.errors import KaneError
from rclpy.task import Future


class BusyError(KaneError):
    """The queue of waiting simulations is full."""


class Worker:
    """A thread with a bounded work queue."""

    def __init__(self) -> None:
        self.stopping = False
        self._queue: queue.SimpleQueue[tuple[Callable[[], object], Future] | None] = (
            queue.SimpleQueue())
        self._thread = threading.Thread(target=self._run, name='simulations',
                                        daemon=True)
        self._thread.start()

    def submit(self, work: Callable[[], object], max_waiting: int) -> Future:
        """
        Queue `work`.

        Return a future that gets its result, or its exception, when it ends.

        Raises
        ------
        BusyError
            The queue is full.

        """
        if self._queue.qsize() >= max_waiting:
            raise BusyError(f'busy: {max_waiting} simulations queued; expected fewer; try '
                            'again later')
        future = Future()
        self._queue.put((work, future))
        return future

    def stop(self, timeout: float) -> None:
        """Set `stopping`, which running work polls, and end the thread."""
        self.stopping = True
        self._queue.put(None)
        self._thread.join(timeout)

    def _run(self) -> None:
        """Run queued work until `stop`."""
        # None wakes the thread at the end.
        while (item := self._queue.get()) is not None and not self.stopping:
            work, future = item
            try:
                result = work()
            except BaseException as error:
                future.set_exception(error)
            else:
                future.set_result(result)
