"""
A lock and a lazy property that do not block a forked child.

A forked child has one thread. What another thread of its parent had locked stays locked
in it.
"""

from collections.abc import Iterator
from contextlib import contextmanager
import functools
import os
from threading import RLock
from typing import Any, TYPE_CHECKING


class ForkSafeLock:
    """A reentrant lock that is free in a forked child."""

    def __init__(self) -> None:
        self._locks: dict[int, Any] = {}  # by process

    @contextmanager
    def held(self) -> Iterator[None]:
        """Hold the lock in a `with` block."""
        with self._locks.setdefault(os.getpid(), RLock()):
            yield


if TYPE_CHECKING:
    lazy_property = functools.cached_property
else:
    class lazy_property(functools.cached_property):  # noqa: N801
        """`functools.cached_property` without the lock of Python before 3.12."""

        def __get__(self, instance, owner=None):
            """Return the value; compute it at the first use."""
            if instance is None:
                return self
            values, name = instance.__dict__, self.attrname
            if name not in values:
                values[name] = self.func(instance)
            return values[name]
