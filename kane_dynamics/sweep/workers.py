"""Who computes the chunks of a sweep: this process, processes of this machine, a Dask cluster."""

from collections.abc import Collection, Generator
from concurrent.futures import as_completed, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
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
MOST_DEATHS = 3  # of workers on end, without a chunk finished in between
PATIENCE = 10  # s for a cluster to answer


def here(work: bytes, chunks: Collection[int]) -> Done:
    """Compute in this process, whose batches use threads."""
    for chunk in chunks:
        yield chunk, compute(work, chunk)


def processes(work: bytes, chunks: Collection[int], count: int) -> Done:
    """
    Compute in `count` processes; yield chunks as they finish.

    What a process had in hand when it died is computed again.

    Raises
    ------
    SweepError
        Processes die without finishing anything.

    """
    waiting, deaths = set(chunks), 0
    context = multiprocessing.get_context('spawn')
    while waiting:
        pool = ProcessPoolExecutor(min(count, len(waiting)), context, _begin)
        try:
            futures = {pool.submit(compute, work, chunk): chunk for chunk in sorted(waiting)}
            finished = 0
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
            finished = 0  # while chunks were still handed out
        finally:
            pool.shutdown(cancel_futures=True)
        deaths = 0 if finished else deaths + 1
        if waiting and deaths == MOST_DEATHS:
            raise SweepError(f'{deaths} times a worker died before any chunk was finished; is '
                             'memory short, or does the script that starts the sweep lack '
                             "`if __name__ == '__main__':`?")


def cluster(work: bytes, chunks: Collection[int], address: str) -> Done:
    """
    Compute on the Dask cluster at an address; yield chunks as they finish.

    Dask gives what a dead worker had in hand to another one.

    Raises
    ------
    InputError
        There is no cluster.
    SweepError
        It went away, or its workers cannot run a chunk.

    """
    distributed = needed('distributed')
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler at '{address}': {error}") from None
    futures: dict[Any, int] = {}
    try:
        for chunk in chunks:
            futures[client.submit(compute, work, chunk, pure=False)] = chunk
        for future in distributed.as_completed(list(futures), loop=client.loop):
            chunk = futures.pop(future)
            try:
                rows = future.result()
            except (distributed.KilledWorker, distributed.client.FutureCancelledError,
                    ImportError, OSError, RuntimeError) as error:
                raise SweepError(f"chunk {chunk} on the Dask cluster at '{address}': {error}; "
                                 'the rows so far are kept') from error
            future.release()
            yield chunk, rows
    finally:
        client.cancel(list(futures))
        client.close()


def _begin() -> None:
    """Prepare a process of the pool."""
    os.environ[threads.VARIABLE] = '1'  # the other processes have the other processors
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends the pool
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End when the parent has: killed, it cannot say so, and the pool would wait for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
