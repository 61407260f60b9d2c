"""Pause garbage collection while code compiles, and log compilations that take long."""

from collections.abc import Iterator
from contextlib import contextmanager
import gc
import os
import sys
from threading import get_ident, Timer
import time

from kane_dynamics._util.fork_safety import ForkSafeLock

SLOW = 2.0  # s, after which a line says what is compiled
LOGGER = 'kane_dynamics.compile'
on_stderr = False  # of a command line, whose user sees no log

_lock = ForkSafeLock()
_inside: list[int] = []  # threads inside `gc_paused`
_enabled = False  # state of the collector before the first of them


@contextmanager
def gc_paused() -> Iterator[None]:
    """
    Disable the garbage collector; restore its state when the last thread leaves.

    Tracing creates tens of thousands of objects without cycles, which reference counting
    frees. They would trigger full collections, which can take longer than the
    compilation.
    """
    global _enabled
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


def _forked() -> None:
    """End the pauses of threads that this forked process does not have."""
    was_paused = bool(_inside)
    _inside[:] = [thread for thread in _inside if thread == get_ident()]
    if was_paused and not _inside and _enabled:
        gc.enable()


os.register_at_fork(after_in_child=_forked)


@contextmanager
def logged(name: str) -> Iterator[None]:
    """
    Log a line, level INFO, once the block has taken `SLOW` seconds, and one at its end.

    The command line writes them to stderr instead.

    Parameters
    ----------
    name : str
        What is compiled.

    """
    timer = Timer(SLOW, _log, (f'compiling {name}, more than {SLOW:g} s so far',))
    timer.daemon = True
    begin = time.monotonic()
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
    took = time.monotonic() - begin
    if took > SLOW:
        _log(f'compiled {name} in {took:.1f} s')


def _log(text: str) -> None:
    if on_stderr:
        print(f'kane-dynamics: {text}', file=sys.stderr)
        return
    import logging  # takes milliseconds, which few programs need
    logging.getLogger(LOGGER).info(text)
