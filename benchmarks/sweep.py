"""Ten thousand simulations of a second: sample, run, write the table, and its speed."""

from dataclasses import dataclass
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any

from interleaved_timing import Timing
from kane_dynamics.native.runtime.threads import thread_count
from kane_dynamics.sweep import read_table, run_sweep, Sweep
from native_loop import Race, shipped_arm
import numpy as np

COUNT = 10_000
TURNS = 3
POSE = (0.0, -0.5, 0.0, -2.0, 0.0, 1.5, 0.7)  # rad, of the Research 3, within its limits
WHAT = f'a second of each of {COUNT} simulations, written'
CLOCK = 'the clock'


@dataclass(frozen=True)
class Done:
    """Wall time of a sweep, s, and the number of workers."""

    seconds: float
    workers: int


def sweep(seed: int) -> Sweep:
    """Return the sweep: unknown payload, friction, initial state, gains."""
    model = shipped_arm('fr3')
    return Sweep(
        model, COUNT, seed, q0=[{'normal': [q, 0.1]} for q in POSE],
        u0={'each': {'uniform': [-0.5, 0.5]}}, friction={'uniform': [0.5, 2.0]},
        payload={'frame': 'fr3_hand_tcp', 'mass': {'uniform': [0.0, 3.0]},
                 'com': [0.0, 0.0, {'uniform': [0.0, 0.1]}], 'gyration': 0.05},
        controller={'kind': 'computed_torque', 'kp': {'loguniform': [50.0, 500.0]}})


def timed(seed: int, workers: int) -> Done:
    """Run a sweep into a new folder, with new processes."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'table'
        start = time.perf_counter()
        computed = run_sweep(sweep(seed), path, workers=workers).made
        took = time.perf_counter() - start
        rows = read_table(path)
    if computed != COUNT or not all(rows['ok'].to_pylist()):
        raise AssertionError(
            f'{computed} simulations made; expected {COUNT}, none failed')
    drift: Any = np.abs(rows['energy_drift'].to_numpy()).max()
    if not drift < 1e-3:
        raise AssertionError(
            f'energy and work differ by {drift:.2g} J: the physics is wrong')
    return Done(took, workers)


def races() -> list[Race]:
    """Return the sweep on all processors, compared with real time."""
    done = [timed(seed, thread_count()) for seed in range(TURNS)]
    timing = Timing(
        {'ours': np.array([x.seconds / COUNT for x in done]), CLOCK: np.ones(TURNS)})
    return [Race('fr3', len(POSE), WHAT, CLOCK, timing.undisturbed('ours'), 1.0,
                 timing.ratio(CLOCK, 'ours'))]


def main() -> int:
    """Print the time with one process and with all, and the comparison."""
    for workers in sorted({1, thread_count()}):
        print(f'{COUNT} simulations of 1 s, {workers} workers: '
              f'{timed(0, workers).seconds:.2f} s')
    print(*races(), sep='\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
