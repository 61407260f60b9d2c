"""Cache of compiled machine code on disk."""

from kane_dynamics._util import disk_cache
from kane_dynamics._util.disk_cache import fetch
from kane_dynamics.native.machine_code import llvm

__all__ = ['fetch', 'key']


def key(*parts: str) -> str:
    """Return the cache key of machine code made from these parts on this processor."""
    return disk_cache.key('code', *parts, llvm.fingerprint())
