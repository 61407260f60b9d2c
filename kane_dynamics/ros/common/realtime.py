"""
Real-time settings of the process: each is asked for by a parameter and may be refused.

They concern the threads that a joint state passes through: the main thread and those of Fast DDS,
which it names dds.*. The services and simulations stay ordinary threads, so that no request can
keep the torque path from a processor.
"""

from collections.abc import Callable, Mapping, Sequence
import ctypes
import gc
import os
from pathlib import Path
import resource
from typing import Any

TASKS = Path('/proc/self/task')
CAP_IPC_LOCK = 14  # number of the capability to lock memory without bound
MCL_CURRENT, MCL_FUTURE = 1, 2


def path_threads() -> list[int]:
    """Return the threads that a joint state passes through."""
    threads = [os.getpid()]
    for task in TASKS.iterdir():
        try:
            name = (task / 'comm').read_text()
        except OSError:  # it has ended
            continue
        if name.startswith('dds.'):
            threads.append(int(task.name))
    return threads


def schedule(priority: int) -> None:
    """
    Run the torque path under SCHED_FIFO; threads that are started from it later do not inherit.

    Raises
    ------
    OSError
        The rights are missing, or the system knows no SCHED_FIFO.

    """
    for thread in path_threads():
        os.sched_setscheduler(thread, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK,
                              os.sched_param(priority))


def pin(cpus: Sequence[int]) -> None:
    """
    Keep the torque path on some processors.

    Raises
    ------
    OSError
        There are no such processors for this process.

    """
    for thread in path_threads():
        os.sched_setaffinity(thread, cpus)


def lock_memory() -> None:
    """
    Keep all of the process in memory, now and later.

    Raises
    ------
    OSError
        The rights are missing. A bounded right is not used: memory asked for beyond the bound
        would be refused later, in the middle of something.

    """
    bound = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if bound != resource.RLIM_INFINITY and not _capable(CAP_IPC_LOCK):
        raise PermissionError(f'only {bound} bytes may be locked')
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(MCL_CURRENT | MCL_FUTURE):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def _capable(number: int) -> bool:
    """Tell whether the process has a capability."""
    for line in Path('/proc/self/status').read_text().splitlines():
        if line.startswith('CapEff:'):
            return bool(int(line.split()[1], 16) >> number & 1)
    return False


def collect_when_asked(on: bool) -> None:
    """Leave garbage collection to calls of `collect`, or to the interpreter again."""
    if on:
        gc.disable()
    else:
        gc.enable()


def collect() -> None:
    """Collect garbage if the interpreter does not: quick, because what lives long is frozen."""
    if not gc.isenabled():
        gc.collect()


def apply(values: Mapping[str, Any], warn: Callable[[str], object]) -> None:
    """
    Make the settings that the parameters realtime.* ask for.

    Parameters
    ----------
    values : mapping
        The node's parameters.
    warn : callable
        Takes one line for each setting that was refused: what, why, what would help.

    """
    priority, cpus = values['realtime.priority'], values['realtime.cpus']
    wanted: list[tuple[str, bool, Callable[[], None], str]] = [
        (f'realtime.priority {priority}', priority > 0, lambda: schedule(priority),
         'grant the user rtprio in /etc/security/limits.conf, or CAP_SYS_NICE'),
        (f'realtime.cpus {list(cpus)}', bool(cpus), lambda: pin(cpus),
         f'valid: of {sorted(os.sched_getaffinity(0))}'),
        ('realtime.lock_memory', values['realtime.lock_memory'], lock_memory,
         'grant the user memlock unlimited in /etc/security/limits.conf, or CAP_IPC_LOCK')]
    for what, asked, setting, remedy in wanted:
        if not asked:
            continue
        try:
            setting()
        except (OSError, OverflowError) as error:
            reason = getattr(error, 'strerror', None) or error
            warn(f'{what} is refused ({reason}), the node goes on without it: {remedy}')
    collect_when_asked(values['realtime.collect_rarely'])
