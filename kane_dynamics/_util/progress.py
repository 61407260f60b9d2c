"""Progress bar on the terminal: by rich if it is installed, else a plain one."""

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
import sys
import time

DELAY = 0.5  # s before the bar appears
_PERIOD = 0.1  # s between updates of the plain bar
_WIDTH = 40


@contextmanager
def progress_bar(text: str, total: float) -> Iterator[Callable[[float], bool]]:
    """
    Show how much of `total` is done, on stderr, while the block runs.

    Yields a function of the amount done that returns True, as `simulate` requires of
    `progress`. Nothing is shown if stderr is no terminal, or if the work takes less than
    `DELAY`.
    """
    if not sys.stderr.isatty():
        yield lambda done: True
        return
    # A bar that waits for amounts.
    bar = _rich(text, total) if find_spec('rich') else _plain(text, total)
    next(bar)
    start = time.monotonic()

    # Short work shows no bar.
    def report(done: float) -> bool:
        if time.monotonic() - start > DELAY:
            bar.send(done)
        return True

    try:
        yield report
    finally:
        bar.close()


def _rich(text: str, total: float) -> Generator[None, float, None]:
    """Draw the amounts received by send() with rich."""
    from rich.console import Console
    from rich.progress import Progress
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(text, total=total, visible=False)
        while True:
            progress.update(task, completed=(yield), visible=True)


def _plain(text: str, total: float) -> Generator[None, float, None]:
    """Draw the amounts received by send() as number signs on one line."""
    shown = ''
    last = 0.0
    try:
        while True:
            done = yield
            # Drawing takes longer than most steps.
            if time.monotonic() - last < _PERIOD:
                continue
            last = time.monotonic()
            share = min(max(done / total, 0.0), 1.0) if total > 0.0 else 1.0
            filled = round(_WIDTH * share)
            shown = f'{text} [{"#" * filled}{"." * (_WIDTH - filled)}] {share:4.0%}'
            print(f'\r{shown}', end='', file=sys.stderr, flush=True)
    finally:
        if shown:
            print(f'\r{" " * len(shown)}\r', end='', file=sys.stderr, flush=True)
