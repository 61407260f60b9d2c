"""
The program `plant_node`: entry point, and ticks on an absolute schedule.

Signals are handled before the long imports begin, which is why functions import here.
"""

from collections.abc import Sequence
import sys
import time
from typing import Any

from kane_dynamics.ros.common.early_signals import exit_on_signal

MIN_TIMEOUT = 1e-5  # s; with a timeout of zero the EventsExecutor does not wait


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `plant_node`; return the exit code."""
    exit_on_signal()
    from kane_dynamics.ros.common.program_arguments import RosProgram, run_program
    program = RosProgram(
        'plant_node', 'plant_node', 'Simulate an arm with motors and sensors.',
        ('--ros-args -p urdf:=arm.urdf', '--ros-args --params-file plant.yaml',
         '--ros-args -p urdf:=arm.urdf -p publish_clock:=true'))
    return run_program(program, arguments, run_plant)


def run_plant(arguments: Sequence[str]) -> int:
    """Run the node with checked arguments; return the exit code."""
    from kane_dynamics.ros.common.process import run_until_signal
    # All imports are made while a signal still ends the process at once.
    import kane_dynamics.ros.plant.plant_node  # noqa: F401
    return run_until_signal(spin_plant, arguments)


def spin_plant(stop: Any) -> None:
    """
    Make the node and spin it until the future `stop`.

    Ticks come between callbacks.
    """
    # Imported late, so that a wrong argument is answered at once.
    from kane_dynamics.ros.common.process import make_executor, spin
    from kane_dynamics.ros.common.realtime import exclude_existing_objects
    from kane_dynamics.ros.plant.plant_node import PlantNode
    node = PlantNode()
    executor = make_executor(node)
    exclude_existing_objects()
    # Each turn of the executor ends when the next tick is due.
    node.schedule.start(time.monotonic_ns())
    spin(node, executor, stop, timeout=lambda: max(node.poll(), MIN_TIMEOUT))
    executor.shutdown()


if __name__ == '__main__':
    sys.exit(main())
