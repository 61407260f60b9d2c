"""Threads for native code that runs without the GIL."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from itertools import pairwise
import os
import time

from kane_dynamics.errors import InputError

VARIABLE = 'KANE_DYNAMICS_THREADS'
MAX_THREADS = 256
THREAD_WORK = 3e-4  # s; least work per thread, several times the cost of waking one


def thread_count() -> int:
    """
    Return the number of threads for a batch: `KANE_DYNAMICS_THREADS`, else the processors.

    Raises
    ------
    InputError
        If ``KANE_DYNAMICS_THREADS`` is not an integer from 1 to 256.

    """
    setting = os.environ.get(VARIABLE)
    if setting is None:
        available = (len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity')
                     else os.cpu_count() or 1)
        return min(available, MAX_THREADS)
    if not (setting.isdecimal() and 1 <= int(setting) <= MAX_THREADS):
        raise InputError(f'{VARIABLE}: {setting!r}; expected an integer from 1 to {MAX_THREADS}')
    return int(setting)


@cache
def _pool() -> ThreadPoolExecutor:
    """Return the thread pool that all batches share; threads start on demand."""
    return ThreadPoolExecutor(MAX_THREADS, 'kane_dynamics')


if hasattr(os, 'register_at_fork'):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a forked child has no threads


def run_in_threads(work: Callable[[int, int], int], count: int, quantum: int, probe: int) -> int:
    """
    Run ``work(begin, end)`` for 0 <= i < count, in several threads if that is faster.

    Parameters
    ----------
    work : callable
        Takes a range and returns flags; ranges run in any order and concurrently.
    count : int
        Size of the range.
    quantum : int
        Subranges begin at multiples of this.
    probe : int
        Quanta that the calling thread runs first, to measure the time per quantum.

    Returns
    -------
    int
        Bitwise or of all flags.

    """
    threads = thread_count()
    first = min(count, probe * quantum) if threads > 1 else count
    started = time.perf_counter()
    flags = work(0, first)
    rest = count - first
    if not rest:
        return flags
    expected = (time.perf_counter() - started) / first * rest
    blocks = -(-rest // quantum)
    threads = min(threads, int(expected / THREAD_WORK) + 1, blocks)
    cuts = [first + quantum * (blocks * k // threads) for k in range(threads)] + [count]
    others = [_pool().submit(work, begin, end) for begin, end in pairwise(cuts[1:])]
    try:
        flags |= work(cuts[0], cuts[1])
    finally:
        wait(others)  # also when interrupted: they use the caller's memory
    for other in others:
        flags |= other.result()
    return flags


def run_concurrently(jobs: Sequence[Callable[[], object]]) -> None:
    """
    Run jobs that compile, several at once; raise the first one's error when all have ended.

    While LLVM works on one, without the GIL, another is traced.
    """
    threads = min(len(jobs), 2 * thread_count())
    if thread_count() == 1 or threads < 2:
        for job in jobs:
            job()
        return
    with ThreadPoolExecutor(threads, 'kane_dynamics_compile') as pool:
        started = [pool.submit(job) for job in jobs]
    for each in started:
        each.result()
