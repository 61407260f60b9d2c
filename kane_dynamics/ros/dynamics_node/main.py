"""
The program `kane_dynamics`: entry point, executor, shutdown.

The node spins in the main thread on the EventsExecutor. The other executors take about
ten times as long for each message. Signals do not interrupt
callbacks, and the node commands zeros before it exits. They are handled before the long
imports begin, which is why functions import here.
"""

from collections.abc import Sequence
import gc
import sys
from typing import Any

from kane_dynamics.ros.common.early_signals import exit_on_signal

# Longest time for which another thread holds the interpreter while the torque path
# waits, s.
SWITCH_INTERVAL = 5e-5
SENDING = 0.05  # s, in which the results of goals and requests are sent at the end


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `kane_dynamics`; return the exit code."""
    exit_on_signal()
    # Imported late, so that signals are handled from the beginning.
    from kane_dynamics.ros.common.program_arguments import RosProgram, run_program
    to_controller = '-r commands:=/forward_effort_controller/commands'
    program = RosProgram(
        'kane_dynamics', 'kane_dynamics',
        'Publish the torques of an arm for each of its joint states.',
        ('--ros-args -p urdf:=arm.urdf -p arm_compensates:=none',
         '--ros-args --params-file arm.yaml',
         f'--ros-args --params-file arm.yaml {to_controller}'))
    return run_program(program, arguments, run_node)


def run_node(arguments: Sequence[str]) -> int:
    """Run the node with checked arguments; return the exit code."""
    from kane_dynamics.ros.common.process import run_until_signal
    # All imports are made while a signal still ends the process at once. What they make
    # is no garbage: no collection needs to look at it.
    gc.disable()
    import kane_dynamics.ros.dynamics_node.node  # noqa: F401
    gc.freeze()
    gc.enable()
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_until_signal(spin_node, arguments)


def spin_node(stop: Any) -> None:
    """Make the node and spin it until the future `stop`."""
    from kane_dynamics.ros.common.process import make_executor, spin
    from kane_dynamics.ros.dynamics_node.node import DynamicsNode
    from rclpy.task import Future
    node = DynamicsNode()
    executor = make_executor(node)
    try:
        node.autostart()
        spin(node, executor, stop, failed=node.on_failure)
    finally:
        # Zeros first, then goals and services end.
        node.halt()
        node.stop_compiling()
        node.end_requests()
        executor.spin_until_future_complete(Future(), SENDING)
        executor.shutdown()


if __name__ == '__main__':
    sys.exit(main())
