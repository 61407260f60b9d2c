"""
Print when a processor stalled: when this process woke late, though it comes before all others.

The argument is the number of the processor. A line is the start and the end of a stall, system
time in ns. Without the right to real-time scheduling nothing is printed, since other programs
might have delayed this one.
"""

import os
import sys
import time

PERIOD, LATE = 1e-3, 4_000_000  # s; ns: two periods of the arm
PRIORITY = 60  # above the arm, the guard and the node


def main():
    os.sched_setaffinity(0, {int(sys.argv[1])})
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        return 1
    before = time.time_ns()
    while True:
        time.sleep(PERIOD)
        now = time.time_ns()
        if now - before > LATE:
            print(before, now, flush=True)
        before = now


if __name__ == '__main__':
    sys.exit(main())
