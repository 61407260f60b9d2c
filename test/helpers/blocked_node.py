"""A dynamics node whose main thread sleeps for a second at each message on ~/block."""

import sys
import time

from kane_dynamics.ros.dynamics_node import node
from kane_dynamics.ros.dynamics_node.main import main
from std_msgs.msg import Empty


class BlockedNode(node.DynamicsNode):
    """The dynamics node with one more topic."""

    def __init__(self):
        super().__init__()
        self.create_subscription(Empty, '~/block', lambda message: time.sleep(1.0), 1)


if __name__ == '__main__':
    node.DynamicsNode = BlockedNode
    sys.exit(main())
