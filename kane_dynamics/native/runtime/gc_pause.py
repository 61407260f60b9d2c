"""Pause garbage collection while a kernel is compiled."""

from collections.abc import Iterator
from contextlib import contextmanager
import gc
import os
from threading import get_ident

from kane_dynamics._util.fork_safety import ForkSafeLock

_lock = ForkSafeLock()
_inside: list[int] = []  # threads inside `gc_paused`
_enabled = False  # state of the collector before the first of them


@contextmanager
def gc_paused() -> Iterator[None]:
    """
    Disable the garbage collector; restore its state when the last thread leaves.

    Tracing creates tens of thousands of objects without cycles, which reference counting frees.
    They would trigger full collections, which can take longer than the compilation.
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
    paused, _inside[:] = bool(_inside), [thread for thread in _inside if thread == get_ident()]
    if paused and not _inside and _enabled:
        gc.enable()


os.register_at_fork(after_in_child=_forked)
