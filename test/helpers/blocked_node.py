"""A dynamics node whose main thread sleeps for a second at each SIGUSR1."""

import signal
import sys
import time

from kane_dynamics.ros.dynamics_node.main import main

if __name__ == '__main__':
    signal.signal(signal.SIGUSR1, lambda number, frame: time.sleep(1.0))
    sys.exit(main())
