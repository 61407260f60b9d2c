"""
Pause garbage collection while code compiles, and report compilations that take long.

A slow processor compiles many kernels for seconds each or together: lines say which one
is compiled and how many are ready.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
import gc
import os
from threading import get_ident, Timer
import time

from kane_dynamics._util.fork_safety import ForkSafeLock

SLOW = 2.0  # s, after which a line says what is compiled
LOGGER = 'kane_dynamics.compile'

_lock = ForkSafeLock()
_inside: list[int] = []  # threads inside `gc_paused`
_enabled = False  # state of the collector when the last of them has left


@contextmanager
def gc_paused() -> Iterator[None]:
    """
    Disable the garbage collector; restore its state when the last thread leaves.

    Tracing creates tens of thousands of objects without cycles, which reference counting
    frees. They would trigger full collections, which can take longer than the
    compilation.
    """
    global _enabled
    # The first thread remembers whether it was enabled, the last one restores that.
    with _lock.held():
        if not _inside:
            _enabled = gc.isenabled()
        _inside.append(get_ident())
        gc.disable()
    try:
        yield
    finally:
        with _lock.held():
            if len(_inside) == 1 and _enabled:
                gc.enable()
            _inside.remove(get_ident())


def collect_automatically(enabled: bool) -> None:
    """Enable or disable the garbage collector; during `gc_paused`, as soon as it ends."""
    global _enabled
    with _lock.held():
        _enabled = enabled
        if enabled and not _inside:
            gc.enable()
        else:
            gc.disable()


def _forked() -> None:
    """End the pauses of threads that this forked process does not have."""
    was_paused = bool(_inside)
    _inside[:] = [thread for thread in _inside if thread == get_ident()]
    _series.running = 0
    if was_paused and not _inside and _enabled:
        gc.enable()


os.register_at_fork(after_in_child=_forked)


@dataclass
class Series:
    """
    Kernels that compile one after the other, or at once, with pauses of less than `SLOW`.

    Attributes
    ----------
    running, ready : int
        Kernels that compile, and those that have been compiled.
    began, ended, reported : float
        Times of the first kernel, of the last one's end and of the last line, s.

    """

    running: int = 0
    ready: int = 0
    began: float = 0.0
    ended: float = -SLOW
    reported: float = 0.0

    @contextmanager
    def counted(self, name: str) -> Iterator[str]:
        """Count a kernel that a block compiles; yield a line, or '' if none is due."""
        with _lock.held():
            now = time.monotonic()
            # After a pause, kernels are counted from the beginning.
            if not self.running and now - self.ended > SLOW:
                self.ready = 0
                self.began = self.reported = now
            self.running += 1
            line = ''
            if now - self.reported > SLOW:
                self.reported = now
                line = (f'compiling {name}; kernels ready: {self.ready}, '
                        f'after {now - self.began:.0f} s')
        try:
            yield line
        finally:
            with _lock.held():
                self.running = max(self.running - 1, 0)  # a fork ends those of other threads
                self.ready += 1
                self.ended = time.monotonic()


_series = Series()


@contextmanager
def logged(name: str) -> Iterator[None]:
    """
    Report a line once the block has taken `SLOW` seconds, and one at its end.

    So that short kernels of a long series are seen, too, a line follows each `SLOW`
    seconds of a series. Lines are logged, level INFO, or go where `reported_to` says.

    Parameters
    ----------
    name : str
        What is compiled.

    """
    # The timer reports while the block still runs; short blocks say nothing.
    timer = Timer(SLOW, _report, (f'compiling {name}, more than {SLOW:g} s so far',))
    timer.daemon = True
    begin = time.monotonic()
    with _series.counted(name) as line:
        if line:
            _report(line)
        timer.start()
        try:
            yield
        finally:
            timer.cancel()
    took = time.monotonic() - begin
    if took > SLOW:
        _report(f'compiled {name} in {took:.1f} s')


def _log(text: str) -> None:
    import logging  # takes milliseconds, which few programs need
    logging.getLogger(LOGGER).info(text)


_destination: Callable[[str], object] = _log


def _report(text: str) -> None:
    _destination(text)


@contextmanager
def reported_to(destination: Callable[[str], object]) -> Iterator[None]:
    """Pass lines on compilations to a function, of programs whose users see no log."""
    global _destination
    before = _destination
    _destination = destination
    try:
        yield
    finally:
        _destination = before
