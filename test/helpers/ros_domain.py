"""A ROS domain that no other run of tests on this machine uses."""

import fcntl
import os
from pathlib import Path
import random
import tempfile

DOMAINS = range(1, 101)


def own_domain():
    """
    Return a domain that is locked until this process ends, as text.

    Two runs at once, in one domain, hear each other's nodes: of one name, with other
    arms.
    """
    for number in random.SystemRandom().sample(DOMAINS, len(DOMAINS)):
        path = Path(tempfile.gettempdir()) / f'kane_dynamics_domain_{number}.lock'
        try:
            lock = os.open(path, os.O_CREAT | os.O_RDWR, 0o666)
        except PermissionError:  # of another user
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(lock)
        else:
            return str(number)  # the lock stays open
    raise RuntimeError('ROS domains: 1 to 100 are locked; expected a free one')
