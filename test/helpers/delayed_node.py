"""A dynamics node whose interpreter is delayed by each message on ~/delay."""

import ctypes
import gc
import sys
import threading
import time

from kane_dynamics.ros.dynamics_node import node
from kane_dynamics.ros.dynamics_node.main import main
from kane_dynamics.ros.torque_path.native_loop import function_address
from std_msgs.msg import String

PUBLISH = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 3)
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
        elif kind == 'refuse':
            refuse_commands(self.arm.path)


def refuse_commands(path):
    """Refuse the next command of a torque path, as the middleware can."""
    path.refuses = PUBLISH(lambda publisher, message, allocation: 1)
    path.native.set_fields(publish=function_address(path.refuses))


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
