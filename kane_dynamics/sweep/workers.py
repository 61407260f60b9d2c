"""Workers that compute chunks: this process, a process pool, or a Dask cluster."""

from collections.abc import Collection, Generator
from concurrent.futures import as_completed, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
import multiprocessing
import os
import signal
from threading import Thread
from typing import Any

from kane_dynamics.errors import InputError, SweepError
from kane_dynamics.native.runtime import threads
from kane_dynamics.sweep.simulator import Columns, compute
from kane_dynamics.sweep.table import needed

Done = Generator[tuple[int, Columns], None, None]
MOST_DEATHS = 3  # worker deaths in a row without a finished chunk
CONNECT_TIMEOUT = 10  # s


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


def cluster(work: bytes, chunks: Collection[int], address: str) -> Done:
    """
    Compute chunks on the Dask cluster at an address; yield them as they finish.

    Dask reassigns the chunks of a worker that died.

    Raises
    ------
    InputError
        If there is no cluster.
    SweepError
        If the connection is lost, or a worker cannot run a chunk.

    """
    distributed = needed('distributed')
    try:
        client = distributed.Client(address, timeout=CONNECT_TIMEOUT,
                                    set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(f"dask: '{address}': {error}; expected the address of a Dask "
                         'scheduler') from None
    # Futures by chunk, so that an error names the chunk and the rest is cancelled.
    futures: dict[Any, int] = {}
    try:
        for chunk in chunks:
            futures[client.submit(compute, work, chunk, pure=False)] = chunk
        # Chunks are independent, so that they may finish in any order.
        for future in distributed.as_completed(list(futures), loop=client.loop):
            chunk = futures.pop(future)
            try:
                rows = future.result()
            except (distributed.KilledWorker, distributed.client.FutureCancelledError,
                    ImportError, OSError, RuntimeError) as error:
                raise SweepError(f"chunk {chunk} on the Dask cluster at '{address}': "
                                 f'{error}; finished rows are kept') from error
            future.release()
            yield chunk, rows
    finally:
        client.cancel(list(futures))
        client.close()


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
