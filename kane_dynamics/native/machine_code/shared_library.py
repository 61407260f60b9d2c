"""Shared libraries from object files, by the linker of the platform."""

from collections.abc import Sequence
from pathlib import Path
import shutil
import subprocess
import tempfile

from kane_dynamics.errors import CompileError

# Compilers call the linker with what their platform needs; they compile nothing here.
LINKERS = ('ld', 'ld.lld', 'lld', 'cc', 'gcc', 'clang')


def linker() -> str | None:
    """Return the path of a linker on the PATH; None without one."""
    return next((path for name in LINKERS if (path := shutil.which(name))), None)


def linked(program: str, objects: Sequence[bytes]) -> bytes:
    """
    Return the shared library of object files.

    Raises
    ------
    CompileError
        The linker fails; its message is included.

    """
    # The linker reads and writes files; the folder goes with them.
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder, f'{k}.o') for k in range(len(objects))]
        for file, content in zip(files, objects):
            file.write_bytes(content)
        result = Path(folder, 'linked.so')
        done = subprocess.run([program, '-shared', '-o', result, *files],
                              capture_output=True,
                              text=True, errors='replace', check=False)
        if done.returncode or not result.exists():
            raise CompileError(f"linker '{program}': "
                               f'{done.stderr.strip() or done.returncode}; expected a '
                               'shared library')
        return result.read_bytes()
