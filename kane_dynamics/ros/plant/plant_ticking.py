"""Run the plant node: ticks on an absolute schedule, callbacks in between."""

import time

from kane_dynamics.ros.common.process import spin, start
from kane_dynamics.ros.common.realtime import exclude_existing_objects
from kane_dynamics.ros.plant.plant_node import PlantNode
from rclpy.task import Future

MIN_TIMEOUT = 1e-5  # s; with a timeout of zero the EventsExecutor does not wait


def run(stop: Future) -> int:
    """Run the node until `stop`; return the exit code."""
    started = start(PlantNode, 'plant_node')
    if started is None:
        return 1
    node, executor = started
    exclude_existing_objects()
    node.schedule.start(time.monotonic_ns())
    spin(node, executor, stop, timeout=lambda: max(node.poll(), MIN_TIMEOUT))
    executor.shutdown()
    return 0
