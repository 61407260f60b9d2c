"""Pause garbage collection while a kernel is compiled."""

from collections.abc import Iterator
from contextlib import contextmanager
import gc
from threading import Lock

_lock = Lock()
_active = 0  # threads inside `gc_paused`
_enabled = False  # state of the collector before the first of them


@contextmanager
def gc_paused() -> Iterator[None]:
    """
    Disable the garbage collector; restore its state when the last thread leaves.

    Tracing creates tens of thousands of objects without cycles, which reference counting frees.
    They would trigger full collections, which can take longer than the compilation.
    """
    global _active, _enabled
    with _lock:
        if not _active:
            _enabled = gc.isenabled()
            gc.disable()
        _active += 1
    try:
        yield
    finally:
        with _lock:
            _active -= 1
            if not _active and _enabled:
                gc.enable()
