"""Log lines about compiling that takes long."""

from collections.abc import Iterator
from contextlib import contextmanager
import sys
from threading import Timer
import time

SLOW = 2.0  # s, after which a line says what is compiled
LOGGER = 'kane_dynamics.compile'
on_stderr = False  # of a command line, whose user sees no log


@contextmanager
def logged(name: str) -> Iterator[None]:
    """
    Log a line, level INFO, once the block has taken `SLOW` seconds, and one at its end.

    The command line writes them to stderr instead.

    Parameters
    ----------
    name : str
        What is compiled.

    """
    timer = Timer(SLOW, _log, (f'compiling {name}, more than {SLOW:g} s so far',))
    timer.daemon = True
    begin = time.monotonic()
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
    took = time.monotonic() - begin
    if took > SLOW:
        _log(f'compiled {name} in {took:.1f} s')


def _log(text: str) -> None:
    if on_stderr:
        print(f'kane-dynamics: {text}', file=sys.stderr)
        return
    import logging  # takes milliseconds, which few programs need
    logging.getLogger(LOGGER).info(text)
