"""Run the plant node: ticks on an absolute schedule, callbacks in between."""

import gc
import sys
import time

from kane_dynamics.errors import KaneError
from kane_dynamics.ros.common.process import make_executor
from kane_dynamics.ros.plant.plant_node import PlantNode
from rclpy.exceptions import ParameterException
from rclpy.task import Future

MIN_TIMEOUT = 1e-5  # s; with a timeout of zero the EventsExecutor does not wait


def run(stop: Future) -> int:
    """Run the node until `stop`; return the exit code."""
    try:
        node = PlantNode()
    except (KaneError, ParameterException) as error:
        print(f'plant_node: {error}', file=sys.stderr)
        return 1
    executor = make_executor()
    executor.add_node(node)
    gc.collect()
    gc.freeze()  # exclude existing objects from garbage collections
    node.schedule.start(time.monotonic_ns())
    while not stop.done():
        try:
            executor.spin_until_future_complete(stop, max(node.poll(), MIN_TIMEOUT))
        except Exception as error:
            node.get_logger().fatal(f'callback failed: {type(error).__name__}: {error}')
    executor.shutdown()
    return 0
