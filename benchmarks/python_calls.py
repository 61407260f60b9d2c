"""Calls from Python against Pinocchio's, compile times, batches and simulation, as ratios."""

import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time
import warnings

from interleaved import interleaved, Timing
from kane_dynamics import load_urdf, Robot, simulate
from kane_dynamics.resources import resource_path
import numpy as np
import pinocchio as pin

ARMS = ('ur10e.urdf', 'fr3.urdf')
GATE_INVERSE_DYNAMICS = 4.0
GATE_COMPILE, GATE_LOAD = 1.0, 0.05  # s

COMPILE = """
import sys, time, warnings
warnings.simplefilter('ignore')
from kane_dynamics import load_urdf, Robot
from kane_dynamics.native import entry
model = load_urdf(sys.argv[1])
entry.supported()
start = time.perf_counter()
Robot(model).compile()
print(time.perf_counter() - start)
"""


def pinocchio_model(path: Path, joints: tuple[str, ...]) -> tuple[pin.Model, pin.Data]:
    """Return Pinocchio's model of the same arm, other joints locked at 0."""
    full = pin.buildModelFromUrdf(str(path))
    other = [full.getJointId(name) for name in full.names[1:] if name not in joints]
    model = pin.buildReducedModel(full, other, pin.neutral(full)) if other else full
    return model, model.createData()


def row(what: str, timing: Timing, ours: str, theirs: str) -> str:
    """Return one line of the table."""
    middle, low, high = timing.ratio(theirs, ours)
    return (f'| {what} | {1e9 * timing.median(ours):.0f} | {1e9 * timing.median(theirs):.0f} '
            f'| {middle:.1f} ({low:.1f} to {high:.1f}) |')


def calls(path: Path) -> bool:
    """Print one arm's table; return whether the gate holds."""
    model = load_urdf(path)
    model = load_urdf(path, joints=[n for n in model.joint_names if 'finger' not in n])
    robot = Robot(model)
    plain = Robot(model, friction=False)
    peer, data = pinocchio_model(path, robot.joint_names)
    q, u, x = np.random.default_rng(0).uniform(-1.0, 1.0, (3, robot.n))
    np.testing.assert_allclose(plain.inverse_dynamics(q, u, x), pin.rnea(peer, data, q, u, x),
                               rtol=1e-9, atol=1e-9)
    timing = interleaved({
        'id': lambda: robot.inverse_dynamics(q, u, x),
        'rnea': lambda: pin.rnea(peer, data, q, u, x),
        'fd': lambda: robot.forward_dynamics(q, u, x),
        'aba': lambda: pin.aba(peer, data, q, u, x),
        'm': lambda: robot.mass_matrix(q),
        'crba': lambda: pin.crba(peer, data, q)})
    states = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 10_000, robot.n))

    def peer_loop() -> None:
        for a, b, c in zip(*states):
            pin.rnea(peer, data, a, b, c)
    batch = interleaved({'batch': lambda: robot.inverse_dynamics(*states), 'loop': peer_loop},
                        turns=9)
    print(f'\n### {path.stem}, {robot.n} joints\n')
    print('| call from Python | ours, ns | Pinocchio, ns | Pinocchio / ours |')
    print('|---|---|---|---|')
    print(row('inverse dynamics (rnea)', timing, 'id', 'rnea'))
    print(row('forward dynamics (aba)', timing, 'fd', 'aba'))
    print(row('mass matrix (crba)', timing, 'm', 'crba'))
    print(row('10000 inverse dynamics, a batch against a loop', batch, 'batch', 'loop'))
    zeros = np.zeros(robot.n)
    simulate(robot, q, zeros, 10.0)
    start = time.perf_counter()
    simulate(robot, q, zeros, 10.0)
    took = time.perf_counter() - start
    print(f'\nRunge-Kutta at 1 ms: 10 s simulated in {1e3 * took:.1f} ms '
          f'({10.0 / took:.0f} times real time).')
    return timing.ratio('rnea', 'id')[0] >= GATE_INVERSE_DYNAMICS


def compile_times(path: Path) -> bool:
    """Print how long the full kernel set takes, fresh and from the cache."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, 'KANE_DYNAMICS_CACHE': cache}
        command = [sys.executable, '-c', COMPILE, str(path)]

        def measured() -> float:
            return float(subprocess.run(command, env=environment, check=True, text=True,
                                        capture_output=True).stdout)
        fresh = measured()
        cached = float(np.median([measured() for _ in range(3)]))
    print(f'\n{path.stem}: all kernels compiled in {fresh:.2f} s, loaded from the cache in '
          f'{1e3 * cached:.0f} ms.')
    return fresh < GATE_COMPILE and cached < GATE_LOAD


def main() -> int:
    """Print the report; return 1 if a gate is not met."""
    warnings.simplefilter('ignore')
    print(f'Pinocchio {pin.__version__}, Python {sys.version.split()[0]}, '
          f'{os.cpu_count()} processors. Times are medians; ratios are formed turn by turn '
          '(in brackets the 10th to 90th percentile).')
    met = [calls(resource_path('urdf', name)) for name in ARMS]
    met.append(compile_times(resource_path('urdf', ARMS[-1])))
    print('\nGates (inverse dynamics at least 4 times rnea; kernels under 1 s, cached under '
          f'50 ms): {"met" if all(met) else "NOT met"}.')
    return 0 if all(met) else 1


if __name__ == '__main__':
    sys.exit(main())
