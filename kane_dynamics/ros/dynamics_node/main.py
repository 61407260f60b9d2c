"""The entry point of the dynamics node. It handles signals before the long imports begin."""

from collections.abc import Sequence
import sys

from kane_dynamics.ros.common.early_signals import exit_on_signal

# Longest time for which another thread holds the interpreter while the torque path waits, s.
SWITCH_INTERVAL = 5e-5


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `dynamics_node`; return the exit code."""
    exit_on_signal()
    from kane_dynamics.ros.common.program_arguments import Program, run_program
    program = Program(
        'dynamics_node', 'kane_dynamics',
        'Publish the torques of an arm for each of its joint states.',
        ('--ros-args -p urdf:=arm.urdf -p arm_compensates:=none',
         '--ros-args --params-file arm.yaml',
         '--ros-args --params-file arm.yaml -r commands:=/forward_effort_controller/commands'))
    return run_program(program, arguments, run_node)


def run_node(arguments: Sequence[str]) -> int:
    """Run the node with checked arguments; return the exit code."""
    from kane_dynamics.ros.common.process import run_until_signal
    from kane_dynamics.ros.dynamics_node.spinning import run
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_until_signal(run, arguments)


if __name__ == '__main__':
    sys.exit(main())
