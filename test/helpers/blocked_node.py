"""A dynamics node whose main thread sleeps for 1 s on ~/block, and fails on ~/fail."""

import sys
import time

from kane_dynamics.ros.dynamics_node import node
from kane_dynamics.ros.dynamics_node.main import main
from std_msgs.msg import Empty


def fail(message):
    raise RuntimeError('on purpose')


class BlockedNode(node.DynamicsNode):
    """The dynamics node with two more topics."""

    def __init__(self):
        super().__init__()
        self.create_subscription(Empty, '~/block', lambda message: time.sleep(1.0), 1)
        self.create_subscription(Empty, '~/fail', fail, 1)


if __name__ == '__main__':
    node.DynamicsNode = BlockedNode
    sys.exit(main())
