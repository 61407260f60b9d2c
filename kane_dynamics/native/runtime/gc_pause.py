"""Garbage collection put off while a kernel is made."""

from collections.abc import Iterator
from contextlib import contextmanager
import gc
from threading import Lock

_lock = Lock()
_makers = 0  # threads that are at it
_enabled = False  # whether the first of them found it so


@contextmanager
def gc_paused() -> Iterator[None]:
    """
    Keep the collector from running; it is as it was when the last thread has left.

    A trace is tens of thousands of objects without cycles, which count frees. They make the
    collector look through everything that the process holds: that can take longer than compiling.
    """
    global _makers, _enabled
    with _lock:
        if not _makers:
            _enabled = gc.isenabled()
            gc.disable()
        _makers += 1
    try:
        yield
    finally:
        with _lock:
            _makers -= 1
            if not _makers and _enabled:
                gc.enable()
