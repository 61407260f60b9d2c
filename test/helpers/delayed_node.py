"""A dynamics node whose interpreter is delayed by each message on ~/delay."""

import ctypes
import gc
import sys
import threading
import time

from kane_dynamics.ros.dynamics_node import node
from kane_dynamics.ros.dynamics_node.main import main
from std_msgs.msg import String

GARBAGE = 3_000_000  # lists in cycles, which take the collector seconds


def hold_the_lock(seconds):
    """Sleep in C without releasing the interpreter's lock."""
    ctypes.PyDLL(None).usleep(round(seconds * 1e6))


def collect():
    """Let the collector free many objects at once."""
    gc.disable()
    for _ in range(GARBAGE):
        x = []
        x.append(x)
    gc.enable()
    gc.collect()


class DelayedNode(node.DynamicsNode):
    """The dynamics node with one more topic."""

    def __init__(self):
        super().__init__()
        self.create_subscription(String, '~/delay', self._on_delay, 1)

    def _on_delay(self, message):
        kind, seconds = message.data.split()
        self.get_logger().info(f'delayed: {kind}')
        if kind == 'lock':
            threading.Thread(
                target=hold_the_lock, args=(float(seconds),), daemon=True).start()
        elif kind == 'collect':
            threading.Thread(target=collect, daemon=True).start()
        elif kind == 'callback':
            time.sleep(float(seconds))
        elif kind == 'observer':
            self.arm.path.add_observer(Faulty(), need_effort=False)


class Faulty:
    """An observer that fails at each cycle."""

    def start(self):
        """Do nothing."""

    def stop(self):
        """Do nothing."""

    def on_loads_changed(self):
        """Do nothing."""

    def on_cycle(self, cycle):
        """Fail."""
        raise ValueError('this observer fails')


if __name__ == '__main__':
    node.DynamicsNode = DelayedNode
    sys.exit(main())
