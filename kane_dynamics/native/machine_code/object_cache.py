"""Machine code that was compiled before, kept on disk."""

from kane_dynamics._util import disk_cache
from kane_dynamics._util.disk_cache import fetch
from kane_dynamics.native.machine_code import llvm

__all__ = ['fetch', 'key']


def key(*parts: str) -> str:
    """Return the name under which code made from `parts`, on this processor, is kept."""
    return disk_cache.key('code', *parts, llvm.fingerprint())
