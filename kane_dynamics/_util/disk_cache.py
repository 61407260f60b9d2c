"""
Cache of expensive results on disk: machine code, and models read from URDF.

The directory is ``$KANE_DYNAMICS_CACHE`` if set (``off`` disables the cache), else
``kane_dynamics`` under ``$XDG_CACHE_HOME`` or ``~/.cache``. It is private to its owner
(0700). Files are written atomically; a damaged file or one of another owner is computed
again. When the total size exceeds `MOST_BYTES` by some percent, the least recently used
files are removed.
"""

from collections.abc import Iterator
from contextlib import suppress
import hashlib
import os
from pathlib import Path
import re
import stat
import tempfile

MAGIC = b'kane_dynamics object 1\n'
MOST_BYTES = 256 * 2**20  # a kernel takes some 10 to 1000 kB, a model some 10 kB
# Of MOST_BYTES after a removal, so that not every new file removes some.
KEPT_SHARE = 0.75
# At all files while MOST_BYTES are written: each takes tenths of seconds if it is full.
LOOKS = 64
OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH


# Rooms whose code reaches an entry only if a part of its key names one of their modules.
# The second group imports the first; neither is imported by any other room.
APPLICATIONS = frozenset({
    'control', 'control_cycle', 'task_space', 'simulation', 'analysis', 'closed_forms',
    'feasibility', 'identification', 'optimal_control', 'sweep'})
PROGRAMS = frozenset({'plot', 'view', 'ros', 'cli', 'demo'})
MODULE_NAME = re.compile(r'\bkane_dynamics\.(\w+)')


def source_digest(folder: str | os.PathLike[str],
                  left_out: frozenset[str] = frozenset()) -> str:
    """Return a hash of all Python code in a folder, except in subfolders left out."""
    digest = hashlib.sha256()
    for name, path in sorted(_sources(os.fspath(folder), '')):
        if name.split('/')[0].removesuffix('.py') in left_out:
            continue
        content = Path(path).read_bytes()
        digest.update(f'{len(name)}:{name}{len(content)}:'.encode())
        digest.update(content)
    return digest.hexdigest()


def _sources(folder: str, prefix: str) -> Iterator[tuple[str, str]]:
    """Yield the name below the first folder, and the path, of every Python file."""
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir():
                if entry.name != '__pycache__':
                    yield from _sources(entry.path, f'{prefix}{entry.name}/')
            elif entry.name.endswith(('.py', '.pyc')) and entry.is_file():
                yield prefix + entry.name, entry.path


# Computed at import, because files edited later are not the code that runs. Each takes
# some milliseconds.
PACKAGE = Path(__file__).resolve().parent.parent
CORE_VERSION = source_digest(PACKAGE, APPLICATIONS | PROGRAMS)
APPLICATIONS_VERSION = source_digest(PACKAGE, PROGRAMS)
PACKAGE_VERSION = source_digest(PACKAGE)


def _version(parts: tuple[str, ...]) -> str:
    """Return the hash of the code that the entry with these parts may depend on."""
    rooms = set(MODULE_NAME.findall(' '.join(parts)))
    if rooms & PROGRAMS:
        return PACKAGE_VERSION
    if rooms & APPLICATIONS:
        return APPLICATIONS_VERSION
    return CORE_VERSION


def key(*parts: str) -> str:
    """
    Return the cache key of these parts and of the code that shapes the entry.

    The key of a traced function names the modules of the function (`origin`). An edit of
    a command or of a picture therefore compiles no kernel of a robot again.
    """
    digest = hashlib.sha256()
    for part in (*parts, _version(parts)):
        content = part.encode('utf-8', 'surrogatepass')
        digest.update(f'{len(content)}:'.encode())
        digest.update(content)
    return digest.hexdigest()


def directory() -> Path | None:
    """Return the cache directory, created if needed; None if disabled or unsafe."""
    # Our variable, then the standard one, then the usual place.
    setting = os.environ.get('KANE_DYNAMICS_CACHE', '')
    if setting.lower() == 'off':
        return None
    root = os.environ.get('XDG_CACHE_HOME') or os.path.join(os.path.expanduser('~'),
                                                            '.cache')
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
    # The checksum includes the name, so that a file with another's content is damaged.
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
    checksum = hashlib.sha256(name.encode() + body).digest()
    try:
        handle, temporary = tempfile.mkstemp(dir=path)
        try:
            with os.fdopen(handle, 'wb') as file:
                file.write(MAGIC + checksum + body)
            os.replace(temporary, path / name)
        except OSError:
            os.unlink(temporary)
            raise
        # The checksum is as good as a random number, but repeatable.
        chance = int.from_bytes(checksum[:4], 'big') / 2**32
        if chance * MOST_BYTES <= LOOKS * len(body):
            _prune(path)
    except OSError:
        return  # the next start computes it again


def _prune(path: Path) -> None:
    """Remove the least recently used files if the cache exceeds its size limit."""
    files = []
    with os.scandir(path) as entries:
        for entry in entries:
            status = entry.stat(follow_symlinks=False)
            if stat.S_ISREG(status.st_mode):
                files.append((status.st_mtime_ns, status.st_size, entry.path))
    files.sort()  # by the time of their last use
    total = sum(size for _, size, _ in files)
    if total <= MOST_BYTES:
        return
    for _, size, file in files:
        if total <= KEPT_SHARE * MOST_BYTES:
            return
        Path(file).unlink(missing_ok=True)  # another process may remove it too
        total -= size
