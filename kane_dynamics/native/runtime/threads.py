"""Threads for work that machine code does without the GIL."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from itertools import pairwise
import os
import time

from kane_dynamics.errors import InputError

VARIABLE = 'KANE_DYNAMICS_THREADS'
MOST_THREADS = 256
WORTH = 3e-4  # s of work that repays waking other threads, several times over


def thread_count() -> int:
    """
    Return how many threads may share a batch: the environment's word, else one a processor.

    Raises
    ------
    InputError
        ``KANE_DYNAMICS_THREADS`` is no whole number from 1 to 256.

    """
    setting = os.environ.get(VARIABLE)
    if setting is None:
        available = (len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity')
                     else os.cpu_count() or 1)
        return min(available, MOST_THREADS)
    if not (setting.isdecimal() and 1 <= int(setting) <= MOST_THREADS):
        raise InputError(f'{VARIABLE} is {setting!r}; expected a whole number from 1 to '
                         f'{MOST_THREADS}')
    return int(setting)


@cache
def _pool() -> ThreadPoolExecutor:
    """Return the threads that all batches share; each starts when it is first needed."""
    return ThreadPoolExecutor(MOST_THREADS, 'kane_dynamics')


if hasattr(os, 'register_at_fork'):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a child has none of these threads


def shared(work: Callable[[int, int], int], count: int, quantum: int, probe: int) -> int:
    """
    Do ``work(begin, end)`` for all of 0 <= i < count, by several threads where that pays.

    Parameters
    ----------
    work : callable
        Takes a range and returns flags; ranges may be worked in any order and at once.
    count : int
        Size of the whole range.
    quantum : int
        Ranges begin at multiples of this.
    probe : int
        Quanta that the caller works alone, to learn how long the rest will take.

    Returns
    -------
    int
        All flags together.

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
    threads = min(threads, int(expected / WORTH) + 1, blocks)
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
