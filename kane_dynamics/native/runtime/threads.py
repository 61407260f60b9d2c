"""Threads for native code that runs without the GIL, and for compiling."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from operator import itemgetter
import os
from threading import get_ident, local, Thread
import time

from kane_dynamics.errors import InputError

VARIABLE = 'KANE_DYNAMICS_THREADS'
MAX_THREADS = 256
THREAD_WORK = 3e-4  # s; least work per thread, several times the cost of starting one
LONGEST = 0.1  # s; a batch looks for interrupts at least about this often
POLL = 1e-3  # s
KEPT = 4096  # paces
SHORTEST = 1e-12  # s for a quantum
_own = local()  # of each thread: what `in_calling_thread` asks for


def thread_count() -> int:
    """
    Return the number of threads: `KANE_DYNAMICS_THREADS`, else that of the processors.

    Raises
    ------
    InputError
        If ``KANE_DYNAMICS_THREADS`` is not an integer from 1 to 256.

    """
    setting = _checked_setting()
    if setting is None:
        available = (len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity')
                     else os.cpu_count() or 1)
        return min(available, MAX_THREADS)
    return setting


def _checked_setting() -> int | None:
    """Return `KANE_DYNAMICS_THREADS`, None without it; raise InputError if invalid."""
    setting = os.environ.get(VARIABLE)
    if setting is None:
        return None
    if not (setting.isdecimal() and 1 <= int(setting) <= MAX_THREADS):
        raise InputError(f'{VARIABLE}: {setting!r}; expected an integer from 1 to '
                         f'{MAX_THREADS}')
    return int(setting)


def run_in_threads(work: Callable[[int, int, int], int], count: int, quantum: int,
                   probe: int, paces: dict[object, float] | None = None,
                   key: object = None) -> int:
    """
    Run `work` on ranges that cover 0 <= i < count, in several threads if that is faster.

    Between calls of `work`, which last about `LONGEST`, a signal handler may raise.

    Parameters
    ----------
    work : callable
        ``work(begin, end, threads)`` runs a range in a number of threads, and returns
        flags when all have ended.
    count : int
        Size of the range.
    quantum : int
        Ranges begin at multiples of this.
    probe : int
        Quanta of the first range if the pace is not known: their time determines the
        number of threads. Fewer quanta show no pace.
    paces, key : dict and hashable, optional
        Seconds of a thread for a quantum by key, as last measured.

    Returns
    -------
    int
        Bitwise or of all flags.

    """
    _checked_setting()  # refused first
    paces = {} if paces is None else paces
    flags = 0
    begin = 0
    # At first less: threads that have no processor of their own take several times as long.
    longest = LONGEST / 8.0
    per_quantum = paces.get(key, 0.0)  # s
    while begin < count:
        quanta = -(-(count - begin) // quantum)
        threads = 1
        if per_quantum:
            # As many threads as the remaining work pays for, and as much as lasts about
            # `longest`.
            threads = min(int(per_quantum * quanta / THREAD_WORK) + 1, quanta)
            if threads > 1:
                threads = min(threads, thread_count())
            quanta = min(quanta, max(1, int(longest / per_quantum)) * threads)
            longest = LONGEST
        else:
            quanta = min(quanta, probe)
        end = min(count, begin + quanta * quantum)
        started = time.perf_counter()
        flags |= work(begin, end, threads)
        took = time.perf_counter() - started
        per_quantum = max(took * threads / quanta, SHORTEST)
        begin = end
        if quanta >= probe:  # else it is mostly that of the call
            if len(paces) >= KEPT:
                paces.clear()
            paces[key] = per_quantum
    return flags


def run_concurrently(jobs: Sequence[Callable[[], object]]) -> None:
    """
    Run jobs that compile, several at once; then raise the first one's error.

    While LLVM works on one, without the GIL, another is traced. An interrupt is raised
    when the running jobs have ended; the others do not start. Where no thread can start,
    as at the exit of the interpreter, the calling thread runs all jobs. So it does inside
    `in_calling_thread`.
    """
    before_each = getattr(_own, 'before_each', None)
    if before_each is not None:
        for job in jobs:
            before_each()
            job()
        return
    waiting = deque(enumerate(jobs))
    running: set[int] = set()  # threads
    errors: list[tuple[int, BaseException]] = []

    def work() -> None:
        running.add(get_ident())
        try:
            while waiting:
                place, job = waiting.popleft()
                try:
                    job()
                except BaseException as error:
                    errors.append((place, error))
                    if not isinstance(error, Exception):
                        waiting.clear()
        except IndexError:  # another thread was faster
            pass
        finally:
            running.discard(get_ident())

    def wait() -> None:
        waiting.clear()
        running.discard(get_ident())
        # An interrupted `Thread.join` may take a running thread for ended.
        while running:
            time.sleep(POLL)
    count = thread_count()
    try:
        with suppress(RuntimeError):  # no more threads: those that run suffice
            for _ in range(min(len(jobs), 2 * count) - 1 if count > 1 else 0):
                Thread(target=work, name='kane_dynamics_compile').start()
        work()
        uninterrupted(wait)
    except BaseException:
        with suppress(BaseException):  # an interrupt before `uninterrupted` has begun
            uninterrupted(wait)
        uninterrupted(wait)
        raise
    if errors:
        raise min(errors, key=itemgetter(0))[1]


@contextmanager
def in_calling_thread(before_each: Callable[[], object]) -> Iterator[None]:
    """
    Run the work of `run_concurrently` in the calling thread, inside the block.

    Work in the background then takes the interpreter from a control loop no more often
    than one thread does.

    Parameters
    ----------
    before_each : callable
        Called before each job; an exception that it raises ends the series.

    """
    _own.before_each = before_each
    try:
        yield
    finally:
        _own.before_each = None


def uninterrupted(wait: Callable[[], object]) -> None:
    """Call `wait` until it returns without an exception; then raise the last one."""
    # An interrupt must not leave the wait early: other threads still use the memory.
    interrupt = None
    while True:
        try:
            wait()
            break
        except BaseException as error:
            interrupt = error
    if interrupt is not None:
        raise interrupt
