"""
A dynamics node that fails on purpose.

Its main thread sleeps for 1 s on ~/block, a callback fails on ~/fail, and on ~/fail_path
the interpreter's torque path fails at the next state.
"""

import sys
import time

from kane_dynamics.ros.dynamics_node import node
from kane_dynamics.ros.dynamics_node.main import main
from std_msgs.msg import Empty


def fail(message):
    raise RuntimeError('on purpose')


class BlockedNode(node.DynamicsNode):
    """The dynamics node with three more topics."""

    def __init__(self):
        super().__init__()
        self.create_subscription(Empty, '~/block', lambda message: time.sleep(1.0), 1)
        self.create_subscription(Empty, '~/fail', fail, 1)
        self.create_subscription(Empty, '~/fail_path', self.fail_path, 1)

    def fail_path(self, message):
        self.arm.path.on_state = fail


if __name__ == '__main__':
    node.DynamicsNode = BlockedNode
    sys.exit(main())
