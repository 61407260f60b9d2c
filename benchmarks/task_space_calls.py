"""
Time of a call of each law in task space: from Python, and of its machine code alone.

On an arm of seven axes and on a palletizer with closed loops, measured in turns in one
run, so that the ratios to `mass_matrix` are those of one state of the machine. The code
of each law is in memory `COPIES` times, since some places cost a fifth more; the best
one counts.
"""

from collections.abc import Callable
import sys
import time
import timeit
from typing import Any

from gates import exit_status
from kane_dynamics import (CartesianImpedance, HandGuiding, HybridForce,
                           JointImpedance, load_constraints, load_urdf, OperationalSpace,
                           Robot)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.native.runtime.kernel import Kernel
import numpy as np

CALLS = 200  # in a row
ROUNDS = 150
COPIES = 2
LIMIT = 1e-6  # s, of a call from Python
STIFFNESS = [2000.0] * 3 + [100.0] * 3


def fr3() -> tuple[Robot, str, np.ndarray]:
    """Return an arm of seven axes, a frame and a configuration."""
    frame = 'fr3_link8'
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), tip=frame))
    return robot, frame, np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.5, 0.785])


def palletizer() -> tuple[Robot, str, np.ndarray]:
    """Return an arm with three closed loops, a frame and a configuration."""
    options = load_constraints(resource_path('urdf', 'palletizer.constraints.yaml'))
    robot = Robot(load_urdf(resource_path('urdf', 'palletizer.urdf')), **options)
    near = np.zeros(robot.n_q)
    near[:4] = 0.1, 0.2, -0.3, 0.1
    return robot, 'tool', robot.closed_configuration(near)


def calls_of(robot: Robot, frame: str,
             q: np.ndarray) -> dict[str, tuple[str, dict[str, Any]]]:
    """Return the calls of a robot: a statement by what it calls, and its names."""
    u = np.full(robot.n, 0.1)
    followed = [robot.coordinate_names.index(name) for name in robot.speed_names]
    names = {
        'robot': robot, 'q': q, 'u': u, 'q_d': q[followed],
        'pose': robot.frame_pose(frame, q),
        'wrench': np.array([0.0, 0.0, -10.0, 0.0, 0.0, 0.0]),
        'CartesianImpedance': CartesianImpedance(robot, frame, stiffness=STIFFNESS),
        'HybridForce': HybridForce(robot, frame,
                                   stiffness=STIFFNESS, force_directions=['z']),
        'OperationalSpace': OperationalSpace(robot, frame),
        'HandGuiding': HandGuiding(robot, frame=frame)}
    leading = {} if robot.equations.in_joint_rates else {'followed': robot.speed_names}
    names['stated'] = JointImpedance(robot, stiffness=100.0, damping=5.0, **leading)
    names['by_ratio'] = JointImpedance(robot, stiffness=100.0, **leading)
    names['pose'][:3, 3] += 0.02
    names['measured'] = -0.8 * names['wrench']
    statements = {
        'mass_matrix': 'robot.mass_matrix(q)',
        'inverse_dynamics': 'robot.inverse_dynamics(q, u, u)',
        'JointImpedance_stated': 'stated.torque(q, u, q_d, u)',
        'JointImpedance_by_ratio': 'by_ratio.torque(q, u, q_d, u)',
        'HandGuiding': 'HandGuiding.torque(q, u)',
        'OperationalSpace': 'OperationalSpace.torque(q, u, pose)',
        'CartesianImpedance': 'CartesianImpedance.torque(q, u, pose)',
        'HybridForce': 'HybridForce.torque(q, u, pose, wrench=wrench, '
        'measured=measured, elapsed=1e-3)'}
    return {what: (statement, names) for what, statement in statements.items()}


def machine_code(kernel: Kernel, q: np.ndarray, u: np.ndarray) -> Callable[[], None]:
    """Return a function that runs the machine code of a law on `CALLS` states."""
    arguments = {'q': q, 'u': u, 'pose': np.eye(4)}
    inputs = []
    for argument in kernel.arguments:
        inputs.append(arguments.get(argument.name, np.full(argument.shape, 0.1)))
    result = np.zeros((CALLS, *kernel.shape))
    return lambda: kernel.scan(inputs, result)


def main() -> int:
    """Print the table; return 1 if a call takes longer than `LIMIT`."""
    timers: list[tuple[tuple[str, str], timeit.Timer]] = []
    natives: list[tuple[tuple[str, str], Callable[[], None]]] = []
    for arm in COPIES * (fr3, palletizer):
        robot, frame, q = arm()
        u = np.full(robot.n, 0.1)
        for what, (statement, names) in calls_of(robot, frame, q).items():
            timer = timeit.Timer(statement, globals=names)
            timer.timeit(2)  # laws compile at their first call
            timers.append(((arm.__name__, what), timer))
        kernels = {label: kernel for (label, _), kernel in robot.kernels._made.items()}
        for what in ('mass_matrix', 'inverse_dynamics'):
            kernels[what] = robot.kernels.kernel(what)
        for label, kernel in kernels.items():
            natives.append(((arm.__name__, label), machine_code(kernel, q, u)))

    best = {key: np.inf for key, _ in timers}
    native = {key: np.inf for key, _ in natives}
    for _ in range(ROUNDS):
        for key, timer in timers:
            best[key] = min(best[key], timer.timeit(CALLS) / CALLS)
        for key, run in natives:
            begin = time.perf_counter()
            run()
            native[key] = min(native[key], (time.perf_counter() - begin) / CALLS)

    good = True
    print('arm        law                   call, ns  times mass_matrix   machine '
          'code, ns')
    for (arm_name, name), seconds in best.items():
        words = ''.join(f'_{c.lower()}' if c.isupper() else c for c in name).lstrip('_')
        alone = min(value for (of_arm, label), value in native.items()
                    if of_arm == arm_name and label.startswith(words))
        ratio = seconds / best[arm_name, 'mass_matrix']
        print(f'{arm_name:10} {name:24} {1e9 * seconds:5.0f} {ratio:12.1f}'
              f' {1e9 * alone:20.0f}')
        if seconds > LIMIT:
            print(
                f'FAILED: {name} on {arm_name}: {1e6 * seconds:.2f} us; expected '
                f'at most {1e6 * LIMIT:g} us')
            good = False
    return exit_status(good)


if __name__ == '__main__':
    sys.exit(main())
