"""Workers that compute chunks: this process, or a process pool."""

from collections.abc import Collection, Generator
from concurrent.futures import as_completed, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
import multiprocessing
import os
import signal
from threading import Thread

from kane_dynamics.errors import SweepError
from kane_dynamics.native.runtime import threads
from kane_dynamics.sweep.simulator import Columns, compute

Done = Generator[tuple[int, Columns], None, None]
MOST_DEATHS = 3  # worker deaths in a row without a finished chunk


def here(work: bytes, chunks: Collection[int]) -> Done:
    """Compute chunks in this process, with threads."""
    for chunk in chunks:
        yield chunk, compute(work, chunk)


def processes(work: bytes, chunks: Collection[int], count: int) -> Done:
    """
    Compute chunks in `count` processes; yield them as they finish.

    The chunks of a process that died are computed again.

    Raises
    ------
    SweepError
        If processes die repeatedly without finishing a chunk.

    """
    waiting, deaths = set(chunks), 0
    context = multiprocessing.get_context('spawn')
    while waiting:
        pool = ProcessPoolExecutor(min(count, len(waiting)), context, _begin)
        finished = 0
        try:
            futures = {pool.submit(compute, work,
                                   chunk): chunk for chunk in sorted(waiting)}
            # A worker that dies breaks its pool; what it had finished counts, the others
            # go to a new pool.
            for future in as_completed(futures):
                chunk = futures.pop(future)
                try:
                    rows = future.result()
                except BrokenProcessPool:
                    continue
                waiting.discard(chunk)
                finished += 1
                yield chunk, rows
        except BrokenProcessPool:
            pass  # broken during submission
        finally:
            workers = [*(pool._processes or {}).values()]
            threads.uninterrupted(partial(pool.shutdown, cancel_futures=True))
            for worker in workers:
                threads.uninterrupted(worker.join)
        # Only deaths without progress count, or a large sweep would end by chance.
        deaths = 0 if finished else deaths + 1
        if waiting and deaths == MOST_DEATHS:
            raise SweepError(f'workers: {deaths} died before finishing a chunk; '
                             "expected enough memory, and `if __name__ == '__main__':` "
                             'in the script that starts the sweep')


def _begin() -> None:
    """Initialize a process of the pool."""
    os.environ[threads.VARIABLE] = '1'  # one processor per process
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops the pool
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Exit when the parent has exited; a killed parent cannot stop the pool."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
