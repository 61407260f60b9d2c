"""The entry point of the plant node. It handles signals before the long imports begin."""

from collections.abc import Sequence
import sys

from kane_dynamics.ros.common.early_signals import exit_on_signal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `plant_node`; return the exit code."""
    exit_on_signal()
    from kane_dynamics.ros.common.program_arguments import Program, run_program
    program = Program(
        'plant_node', 'plant', 'Simulate an arm with motors and sensors.',
        ('--ros-args -p urdf:=arm.urdf', '--ros-args --params-file plant.yaml',
         '--ros-args -p urdf:=arm.urdf -p publish_clock:=true'))
    return run_program(program, arguments, run_plant)


def run_plant(arguments: Sequence[str]) -> int:
    """Run the node with checked arguments; return the exit code."""
    from kane_dynamics.ros.common.process import run_until_signal
    from kane_dynamics.ros.plant.plant_ticking import run
    return run_until_signal(run, arguments)


if __name__ == '__main__':
    sys.exit(main())
