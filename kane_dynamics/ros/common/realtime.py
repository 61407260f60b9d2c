"""
Real-time settings of the process, from the parameters realtime.*.

They apply to the threads that process a joint state: the main thread and the threads of
Fast DDS, whose names begin with dds. Services and simulations keep ordinary scheduling,
so that a request cannot preempt the torque path.
"""

from collections.abc import Callable, Mapping, Sequence
import ctypes
import gc
import os
from pathlib import Path
import resource
from typing import Any


TASKS = Path('/proc/self/task')
LATENCY = '/dev/cpu_dma_latency'  # while open, processors wake within the written us
CAP_IPC_LOCK = 14  # capability number: lock memory without limit
MCL_CURRENT, MCL_FUTURE = 1, 2


def named_threads(beginning: str) -> list[int]:
    """Return the ids of the threads of this process whose names begin with a text."""
    threads = []
    for task in TASKS.iterdir():
        try:
            name = (task / 'comm').read_text()
        except OSError:  # the thread has ended
            continue
        if name.startswith(beginning):
            threads.append(int(task.name))
    return threads


def path_threads() -> list[int]:
    """Return the ids of the threads that process a joint state."""
    return [os.getpid(), *named_threads('dds.')]


def schedule(priority: int) -> None:
    """
    Schedule the torque path with SCHED_FIFO.

    Threads that it starts later do not inherit it.

    Raise OSError if the process lacks the rights, or the system has no SCHED_FIFO.
    """
    for thread in path_threads():
        os.sched_setscheduler(thread, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK,
                              os.sched_param(priority))


def pin(cpus: Sequence[int]) -> None:
    """
    Pin the torque path to processors.

    Raise OSError if this process may not use them.
    """
    for thread in path_threads():
        os.sched_setaffinity(thread, cpus)


def lock_memory() -> None:
    """
    Lock all present and future memory of the process.

    Raises
    ------
    OSError
        The process lacks the rights. A finite limit is not used: an allocation beyond it
        would fail later, at an arbitrary place.

    """
    bound = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if bound != resource.RLIM_INFINITY and not _capable(CAP_IPC_LOCK):
        raise PermissionError(f'RLIMIT_MEMLOCK: {bound} bytes; expected no limit')
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(MCL_CURRENT | MCL_FUTURE):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


class Awake:
    """A request that idle processors stay awake, as a sleeping one wakes late."""

    def __init__(self) -> None:
        """Request nothing yet."""
        self._file: int | None = None

    def hold(self) -> None:
        """
        Keep idle processors awake until `release`, or until the process ends.

        Raise OSError if the process lacks the rights.
        """
        self.release()
        file = os.open(LATENCY, os.O_WRONLY | os.O_CLOEXEC)
        try:
            os.write(file, bytes(4))  # int32
        except OSError:
            os.close(file)
            raise
        self._file = file

    def release(self) -> None:
        """
        Close the device, so that processors may sleep again.

        It may be closed already.
        """
        file = self._file
        self._file = None
        if file is not None:
            os.close(file)


AWAKE = Awake()  # of this process


def _capable(number: int) -> bool:
    """Return whether the process has a capability."""
    for line in Path('/proc/self/status').read_text().splitlines():
        if line.startswith('CapEff:'):
            return bool(int(line.split()[1], 16) >> number & 1)
    return False


def exclude_existing_objects() -> None:
    """Exclude the objects that live until cleanup from garbage collections."""
    gc.collect()
    gc.freeze()


def release() -> None:
    """Let processors sleep and collect all garbage again."""
    AWAKE.release()
    gc.unfreeze()


def apply_realtime_settings(values: Mapping[str, Any],
                            warn: Callable[[str], object]) -> None:
    """
    Apply the parameters realtime.*; warn of each setting that the system refuses.

    Parameters
    ----------
    values : mapping
        The node's parameters.
    warn : callable
        Receives one line for each refused setting: the setting, the reason, the remedy.

    """
    priority = values['realtime.priority']
    cpus = values['realtime.cpus']

    # A refused setting is a warning: the node works without it.
    def attempt(what: str, setting: Callable[[], None], remedy: str) -> None:
        try:
            setting()
        except (OSError, OverflowError) as error:
            reason = getattr(error, 'strerror', None) or error
            warn(f'{what}: refused ({reason}), the node runs without it; {remedy}')

    # Settings of an earlier configuration do not stay.
    AWAKE.release()
    # Priority, processors, memory, and idle states.
    if priority > 0:
        attempt(f'realtime.priority {priority}', lambda: schedule(priority),
                'grant the user rtprio in /etc/security/limits.conf, or CAP_SYS_NICE')
    if cpus:
        attempt(f'realtime.cpus {list(cpus)}', lambda: pin(cpus),
                f'expected processors of {sorted(os.sched_getaffinity(0))}')
    if values['realtime.lock_memory']:
        attempt('realtime.lock_memory', lock_memory,
                'grant the user memlock unlimited in /etc/security/limits.conf, or '
                'CAP_IPC_LOCK')
    if values['realtime.keep_awake']:
        attempt('realtime.keep_awake', AWAKE.hold,
                f'grant the user write access to {LATENCY}, or disable idle states with '
                'cpupower')
