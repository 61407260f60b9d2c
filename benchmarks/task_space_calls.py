"""
Time of a call of each law in task space: from Python, and of its machine code alone.

All are of the FR3, measured in turns in one run, so that the ratios to `mass_matrix` are those of
one state of the machine. The table in docs/task_space.md is from here.
"""

from collections.abc import Callable
import time

from kane_dynamics import (ArmCoupling, CartesianImpedance, HandGuiding, HybridForce,
                           JointImpedance, load_urdf, OperationalSpace, PartnerState, Robot)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.native.runtime.kernel import Kernel
import numpy as np

FRAME = 'fr3_link8'
CALLS = 200  # in a row
ROUNDS = 150
STIFFNESS = [2000.0] * 3 + [100.0] * 3


def machine_code(kernel: Kernel, q: np.ndarray, u: np.ndarray) -> Callable[[], None]:
    """Return a function that runs the machine code of a law on `CALLS` states."""
    given = {'q': q, 'u': u, 'pose': np.eye(4)}
    inputs = []
    for argument in kernel.arguments:
        inputs.append(given.get(argument.name, np.full(argument.shape, 0.1)))
    result = np.zeros((CALLS, *kernel.shape))
    return lambda: kernel.scan(inputs, result)


def main() -> None:
    """Print the table."""
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), tip=FRAME))
    q = np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.5, 0.785])
    u = np.full(7, 0.1)
    pose = robot.frame_pose(FRAME, q + 0.05)
    wrench = np.array([0.0, 0.0, -10.0, 0.0, 0.0, 0.0])
    measured = -wrench
    joints = JointImpedance(robot, stiffness=100.0, damping=5.0)
    impedance = CartesianImpedance(robot, FRAME, stiffness=STIFFNESS)
    hybrid = HybridForce(robot, FRAME, stiffness=STIFFNESS, force_directions=['z'])
    operational = OperationalSpace(robot, FRAME)
    guiding = HandGuiding(robot, frame=FRAME)
    coupling = ArmCoupling(robot, stiffness=100.0, damping=5.0)
    partner = PartnerState(0.0, q, u, u)
    coupling.engage(q, partner)

    calls: dict[str, Callable[[], object]] = {
        'mass_matrix': lambda: robot.mass_matrix(q),
        'inverse_dynamics': lambda: robot.inverse_dynamics(q, u, u),
        'JointImpedance': lambda: joints.torque(q, u, q, u),
        'HandGuiding': lambda: guiding.torque(q, u),
        'OperationalSpace': lambda: operational.torque(q, u, pose),
        'CartesianImpedance': lambda: impedance.torque(q, u, pose),
        'HybridForce': lambda: hybrid.torque(q, u, pose, wrench=wrench, measured=measured,
                                             elapsed=1e-3),
        'ArmCoupling': lambda: coupling.torque(0.0, q, u, partner)}
    for call in calls.values():  # laws compile at their first call
        call()
    natives = {}
    for (name, _), kernel in robot.kernels._made.items():
        natives[name] = machine_code(kernel, q, u)
    for name in ('mass_matrix', 'inverse_dynamics'):
        natives[name] = machine_code(robot.kernels.kernel(name), q, u)

    best = dict.fromkeys(calls, np.inf)
    native = dict.fromkeys(natives, np.inf)
    for _ in range(ROUNDS):
        for name, call in calls.items():
            begin = time.perf_counter()
            for _ in range(CALLS):
                call()
            best[name] = min(best[name], (time.perf_counter() - begin) / CALLS)
        for name, run in natives.items():
            begin = time.perf_counter()
            run()
            native[name] = min(native[name], (time.perf_counter() - begin) / CALLS)

    print('law                   call, ns  times mass_matrix   machine code, ns')
    for name, seconds in best.items():
        key = ''.join(f'_{c.lower()}' if c.isupper() else c for c in name).lstrip('_')
        alone = min(value for label, value in native.items() if label.startswith(key))
        print(f'{name:20} {1e9 * seconds:9.0f} {seconds / best["mass_matrix"]:12.1f}'
              f' {1e9 * alone:20.0f}')


if __name__ == '__main__':
    main()
