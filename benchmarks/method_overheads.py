"""
Every method of a robot with one kernel: its time from Python over that of the kernel.

A method takes at most twice the time of its kernel plus 60 ns for each array that it
returns. Kernel and method alternate in one process. Exits with 1 if a method takes
longer.
"""

from functools import partial
import sys
import warnings

from gates import exit_status
from interleaved_timing import interleaved
from kane_dynamics import Robot
from kane_dynamics.robot.kernel_set import ANALYTIC, FRAME_QUANTITIES
from native_loop import ARMS, kernel_loop, random_states, STATES

METHODS = {'partial_velocities': 'jacobian', 'partial_velocity_rates': 'jacobian_rate'}
CALL = 60e-9  # s, for each array that a call returns
TIMES = 2.0


def rows(robot: Robot) -> list[tuple[str, float, float, float]]:
    """Return name, seconds of a call and of its kernel, and the most for a call."""
    states = random_states(robot, STATES)
    inputs = dict(zip(('q', 'u', 'udot'), states)) | {'tau': states[2]}
    places = [(name, '') for name in robot.kernels.names]
    places += [(name, robot.frame_names[-1]) for name in FRAME_QUANTITIES]
    figures = []
    for name, frame in places:
        kernel = robot.kernels.kernel(name, frame)
        arguments = [inputs[argument.name][0] for argument in kernel.arguments]
        method = getattr(robot, METHODS.get(name, name))
        if frame:
            arguments.insert(0, frame)
        timing = interleaved({'call': partial(method, *arguments),
                              'kernel': kernel_loop(kernel, inputs)}, turns=50)
        took = timing.undisturbed('kernel') / STATES
        arrays = 3 if name in ANALYTIC else 1
        figures.append((METHODS.get(name, name), timing.undisturbed('call'), took,
                        TIMES * (took + arrays * CALL)))
    return figures


def main() -> int:
    """Print a line for each method; return 1 if one takes too long."""
    warnings.simplefilter('ignore')
    met = True
    for name, make in ARMS.items():
        for method, call, kernel, most in rows(Robot(make(), friction=False)):
            good = call <= most
            met = met and good
            times = f'{1e9 * call:6.0f} ns, kernel {1e9 * kernel:6.0f} ns'
            limit = f'at most {1e9 * most:6.0f}{"" if good else "  MISSED"}'
            print(f'{name:6} {method:30} {times}, {limit}', flush=True)
    return exit_status(met)


if __name__ == '__main__':
    sys.exit(main())
