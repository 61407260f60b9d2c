"""Output that cannot be written: the reader has ended (`| head`), the disk is full."""

from collections.abc import Callable
import os
import signal
import sys
from typing import TextIO

BROKEN_PIPE = 128 + signal.SIGPIPE  # exit code of a program that a closed pipe ends
NOT_WRITTEN = 1


def without_broken_pipe(run: Callable[[], int]) -> int:
    """
    Run a program; return its exit code, or `BROKEN_PIPE` if its output has no reader.

    Output is flushed here, because an interpreter that flushes at its end prints a
    traceback.
    """
    # The buffer is written here, where its errors are not mistaken for those of the
    # program.
    try:
        try:
            return run()
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        _discard(sys.stdout, sys.stderr)
        return BROKEN_PIPE
    except OSError as error:
        _discard(sys.stdout)
        print(f'standard output: {str(error.strerror).lower()}; expected a file or '
              'terminal that takes all of it', file=sys.stderr)
        return NOT_WRITTEN


def _discard(*streams: TextIO) -> None:
    """Connect streams with the null device, to which the interpreter flushes."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in streams:
        os.dup2(nowhere, stream.fileno())
    os.close(nowhere)
