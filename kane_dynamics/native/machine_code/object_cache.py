"""
Cache of compiled machine code on disk.

The directory is ``$KANE_DYNAMICS_CACHE`` if set (``off`` disables the cache), else
``kane_dynamics`` under ``$XDG_CACHE_HOME`` or ``~/.cache``. It is private to its owner (0700).
Files are written atomically; a damaged file or one of another owner is rebuilt. When the total
size exceeds `MAX_BYTES`, the least recently used files are removed.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import cache
import hashlib
import os
from pathlib import Path
import stat
import tempfile

from kane_dynamics.native.machine_code import llvm

MAGIC = b'kane_dynamics object 1\n'
MAX_BYTES = 256 * 2**20  # a kernel takes some 10 to 1000 kB
# Packages whose code affects the compiled programs.
SOURCES = ('model', 'mechanics', 'native', 'robot', 'control', 'simulation', 'sweep')
KEPT_SHARE = 0.75  # of MAX_BYTES after a removal, so that not every new kernel removes files
OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH


def directory() -> Path | None:
    """Return the cache directory, created if needed; None if disabled or unsafe to use."""
    setting = os.environ.get('KANE_DYNAMICS_CACHE', '')
    if setting.lower() == 'off':
        return None
    root = os.environ.get('XDG_CACHE_HOME') or os.path.join(os.path.expanduser('~'), '.cache')
    path = Path(setting) if setting else Path(root) / 'kane_dynamics'
    try:
        if not path.exists():
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = path.stat()
    except OSError:
        return None
    if status.st_uid != os.getuid() or status.st_mode & OTHERS_MAY_WRITE:
        return None  # never run code from a directory that other users can write
    return path


@cache
def _source_stamp() -> str:
    """Return a stamp of the package's source files, which changes with every edit."""
    package = Path(__file__).resolve().parents[2]
    files = sorted(path for part in SOURCES for path in (package / part).rglob('*.py'))
    status = [(str(path.relative_to(package)), path.stat()) for path in files]
    return repr([(name, s.st_size, s.st_mtime_ns) for name, s in status])


def key(*parts: str) -> str:
    """Return the cache key of these parts, the package's version and this processor."""
    digest = hashlib.sha256()
    for part in (*parts, _source_stamp(), llvm.fingerprint()):
        digest.update(f'{len(part)}:{part}'.encode())
    return digest.hexdigest()


def load(name: str) -> bytes | None:
    """Return the content of a cache entry, or None if it is missing or damaged."""
    path = directory()
    if path is None:
        return None
    try:
        with open(path / name, 'rb') as file:
            status = os.fstat(file.fileno())
            if status.st_uid != os.getuid() or status.st_mode & OTHERS_MAY_WRITE:
                return None
            content = file.read()
            with suppress(OSError):  # a read-only disk needs no usage order
                os.utime(file.fileno())  # mark as recently used
    except OSError:
        return None
    head, checksum, body = (content[:len(MAGIC)], content[len(MAGIC):len(MAGIC) + 32],
                            content[len(MAGIC) + 32:])
    if head != MAGIC or hashlib.sha256(name.encode() + body).digest() != checksum:
        return None
    return body


def store(name: str, body: bytes) -> None:
    """Write a cache entry atomically; ignore a full or read-only disk."""
    path = directory()
    if path is None:
        return
    try:
        handle, temporary = tempfile.mkstemp(dir=path)
        try:
            with os.fdopen(handle, 'wb') as file:
                file.write(MAGIC + hashlib.sha256(name.encode() + body).digest() + body)
            os.replace(temporary, path / name)
        except OSError:
            os.unlink(temporary)
            raise
        _prune(path)
    except OSError:
        return  # the next start compiles again


def _prune(path: Path) -> None:
    """Remove the least recently used files if the cache exceeds its size limit."""
    with os.scandir(path) as entries:
        files = sorted((status.st_mtime_ns, status.st_size, entry.path) for entry in entries
                       if stat.S_ISREG((status := entry.stat(follow_symlinks=False)).st_mode))
    total = sum(size for _, size, _ in files)
    if total <= MAX_BYTES:
        return
    for _, size, file in files:
        if total <= KEPT_SHARE * MAX_BYTES:
            return
        Path(file).unlink(missing_ok=True)  # another process may remove it too
        total -= size


def fetch(name: str, make: Callable[[], bytes]) -> bytes:
    """Return a cache entry; create and store it if it does not exist."""
    body = load(name)
    if body is None:
        body = make()
        store(name, body)
    return body
