"""Child processes of the demo: log, shutdown, and a watch for progress."""

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
import signal
import subprocess
import sys
from threading import Thread
import time

from kane_dynamics.errors import KaneError

PATIENCE = 30.0  # s without progress of any child before an error
MOST = 300.0  # s, longest duration of a stage
SAY = 10.0  # s between two progress lines
LEAST = 0.05  # s of processor time that are progress
SHOWN = 20  # last lines of a child in an error


class DemoError(KaneError):
    """A process of the demo did not start or answer."""


class Child:
    """
    Process whose output is printed on the terminal, each line after its name.

    Parameters
    ----------
    name : str
    command : sequence of str

    """

    def __init__(self, name: str, command: Sequence[str]) -> None:
        self.name = name
        self.lines = 0
        self.last: deque[str] = deque(maxlen=SHOWN)
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE,
                                        stderr=subprocess.STDOUT, text=True,
                                        errors='replace')
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.last.append(line.rstrip())
            self.lines += 1
            print(f'  {self.name}: {line.rstrip()}', file=sys.stderr, flush=True)

    @property
    def processor_time(self) -> float:
        """
        Return the processor time used so far, s.

        It is zero if the system does not provide it.
        """
        try:
            fields = Path(f'/proc/{self.process.pid}/stat').read_text(
                encoding='utf-8').rpartition(')')[2].split()
        except (OSError, ProcessLookupError):
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')

    def end(self) -> None:
        """Wait for the process to end after SIGINT; kill it after 5 s."""
        try:
            self.process.wait(timeout=5.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join(timeout=5.0)
        assert self.process.stdout is not None
        self.process.stdout.close()


class Waiting:
    """
    Checks that the child processes make progress.

    Parameters
    ----------
    what : str
        Name of the stage, for messages.
    children : sequence of Child

    """

    def __init__(self, what: str, children: Sequence[Child]) -> None:
        self._what = what
        self._children = children
        self._began = self._moved = self._said = time.monotonic()
        self._seen = self._state()

    def _state(self) -> list[tuple[int, float]]:
        return [(child.lines, child.processor_time) for child in self._children]

    def check(self) -> None:
        """
        Raise DemoError if the stage has failed.

        It has failed if a child has ended, if no child has written a line or used the
        processor for `PATIENCE`, or if it takes longer than `MOST`.
        """
        for child in self._children:
            if (code := child.process.poll()) is not None:
                raise DemoError(f'{self._what}: {child.name} ended with exit code {code}'
                                + self._last_lines(child))
        # Progress is new output or processor time: a stage without either is stuck.
        now = time.monotonic()
        state = self._state()
        if self._has_progress(state):
            self._seen = state
            self._moved = now
        if now - self._said > SAY:
            self._said = now
            times = []
            for child, (_, seconds) in zip(self._children, state, strict=True):
                times.append(f'{child.name} {seconds:.0f} s')
            print(f'  waiting for {now - self._began:.0f} s: {self._what}; processor '
                  f'time: {", ".join(times)}', file=sys.stderr, flush=True)
        if now - self._moved > PATIENCE or now - self._began > MOST:
            raise DemoError(f'{self._what}: no progress for {now - self._began:.0f} s'
                            + ''.join(map(self._last_lines, self._children)))

    def _has_progress(self, state: list[tuple[int, float]]) -> bool:
        """Return whether a child has written a line or used the processor."""
        for (lines, used), (old_lines, old_used) in zip(state, self._seen, strict=True):
            if lines > old_lines or used > old_used + LEAST:
                return True
        return False

    @staticmethod
    def _last_lines(child: Child) -> str:
        return ''.join(f'\n  {child.name}: {line}' for line in child.last)


@contextmanager
def children(commands: dict[str, Sequence[str]]) -> Iterator[list[Child]]:
    """Run commands by name while the block runs."""
    running: list[Child] = []
    try:
        running += [Child(name, command) for name, command in commands.items()]
        yield running
    finally:
        for child in reversed(running):
            child.process.send_signal(signal.SIGINT)
        for child in running:
            child.end()


@contextmanager
def stage(text: str) -> Iterator[None]:
    """Print a stage, and then its duration."""
    start = time.monotonic()
    print(f'{text} ...', flush=True)
    yield
    print(f'{text}: {time.monotonic() - start:.1f} s', flush=True)
