"""
Print when a processor stalled: when this process, before all others, woke late.

The argument is the number of the processor. A line is the start and the end of a stall,
system time in ns. Without the right to real-time scheduling nothing is printed, since
other programs might have delayed this one.
"""

import os
import sys
import time

# s; ns: two periods of the arm
PERIOD = 1e-3
LATE = 4_000_000
PRIORITY = 60  # above the arm, the guard and the node


def main():
    os.sched_setaffinity(0, {int(sys.argv[1])})
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except PermissionError:
        return 1
    start = time.time_ns()
    while True:
        time.sleep(PERIOD)
        now = time.time_ns()
        if now - start > LATE:
            print(start, now, flush=True)
        start = now


if __name__ == '__main__':
    sys.exit(main())
