"""
An iteration of predictive control compared with crocoddyl on Pinocchio, interleaved.

The FR3, 7 axes, 50 intervals of 10 ms, torque limits, a reach: crocoddyl's SolverBoxDDP
solves the same problem, in an environment of its own (`make bench` installs it: its
wheels need another Pinocchio than the one compared with elsewhere). Each does one
iteration from the same torques. Pinocchio has no friction: the problem of the gate is
without, and that with friction and speed limits stands beside it. Processor times, one
thread each, blocks of iterations alternate.
"""

import json
import os
from pathlib import Path
import statistics
import subprocess
import sys
import time
from typing import Any

from gates import exit_status
from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.optimal_control import CostWeights, TrajectoryOptimizer
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
PEER = ROOT / '.venv-crocoddyl' / 'bin' / 'python'
URDF = resource_path('urdf', 'fr3.urdf')
# alternating, blocks of iterations
NODES = 50
INTERVAL = 0.01
ROUNDS = 30
BLOCK = 10
# Ratio of crocoddyl's processor time to ours.
GATE = 3.0
STRETCH = 5.0
AGREEMENT = 1e-8  # of the optimal costs, relative
CYCLE = 2e-3  # s, of a controller at 500 Hz
START = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
TARGET = START + [1.0, 0.5, -0.5, 0.5, 0.5, 0.5, -0.8]
WEIGHTS = CostWeights(position=10.0, speed=0.1, torque=1e-3, end_position=1000.0,
                      end_speed=10.0)


def peer(robot: Robot) -> 'tuple[subprocess.Popen[str], dict[str, Any]] | None':
    """Start crocoddyl; return its process and results, or None without it."""
    interpreter = os.environ.get('CROCODDYL_PYTHON', str(PEER))
    if not Path(interpreter).exists():
        return None
    process = subprocess.Popen(
        [interpreter, str(Path(__file__).with_name('crocoddyl_peer.py'))],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env={key: value for key, value in os.environ.items() if key != 'PYTHONPATH'}
        | {'OMP_NUM_THREADS': '1'})
    assert process.stdin is not None and process.stdout is not None
    process.stdin.write(json.dumps({
        'urdf': str(URDF), 'nodes': NODES, 'interval': INTERVAL, 'start': START.tolist(),
        'target': TARGET.tolist(), 'torque': robot.gravity_force(TARGET).tolist(),
        'hold': robot.gravity_force(START).tolist(),
        'limits': robot.limits.effort.tolist(),
        'weights': [WEIGHTS.position, WEIGHTS.speed], 'torque_weight': WEIGHTS.torque,
        'end_weights': [WEIGHTS.end_position, WEIGHTS.end_speed]}) + '\n')
    process.stdin.flush()
    answer = process.stdout.readline()
    if not answer:
        process.wait()
        return None
    return process, json.loads(answer)


def main() -> int:
    """Print the comparison; return 1 if a gate does not hold."""
    os.environ['KANE_DYNAMICS_THREADS'] = '1'
    robot = Robot(load_urdf(URDF, tip='fr3_link7'), friction=False)
    rubbing = Robot(load_urdf(URDF, tip='fr3_link7',
                              supplement=ROOT / 'examples' / 'fr3_friction.yaml'))
    at_rest = np.zeros(robot.n)
    held = robot.gravity_force(START)
    smooth = TrajectoryOptimizer(robot, nodes=NODES, interval=INTERVAL, weights=WEIGHTS,
                                 speed_limits=np.inf)
    rough = TrajectoryOptimizer(rubbing, nodes=NODES, interval=INTERVAL)
    programs = {'kane_dynamics': smooth, 'with friction and speed limits': rough}
    near = {}
    for name, optimizer in programs.items():
        optimizer.set_target(TARGET)
        optimizer.start(held)
        near[name] = optimizer.solve(START, at_rest, iterations=200).tau
    optimizer.start(held)
    smooth.start(held)
    solution = smooth.solve(START, at_rest, iterations=200, tolerance=1e-13)
    peer_figures = peer(robot)
    if peer_figures is not None:
        process, theirs = peer_figures
        near['kane_dynamics'] = np.array(theirs['near'])
    times: dict[str, list[float]] = {name: [] for name in [
        *programs, *([] if peer_figures is None else ['crocoddyl'])]}
    for _ in range(ROUNDS):
        for name, optimizer in programs.items():
            total = 0.0
            for _ in range(BLOCK):
                optimizer.start(near[name])
                began = time.process_time()
                optimizer.solve(START, at_rest, iterations=1, tolerance=0.0)
                total += time.process_time() - began
            times[name].append(total / BLOCK)
        if peer_figures is not None:
            process.stdin.write(f'{BLOCK}\n')
            process.stdin.flush()
            times['crocoddyl'].append(float(process.stdout.readline()))
    print(f'An iteration of predictive control, FR3, {NODES} intervals, torque limits')
    for name, durations in times.items():
        print(f'  {name:32}{1e6 * statistics.median(durations):8.0f} us')
    good = True
    slowest = max(statistics.median(times[name]) for name in programs)
    if slowest > CYCLE:
        print(f'FAILED: {1e3 * slowest:.2f} ms; expected less than {1e3 * CYCLE:g} ms '
              '(500 Hz)')
        good = False
    if peer_figures is None:
        print(
            'LEFT OUT: crocoddyl: not installed in .venv-crocoddyl; its gate is '
            'not checked')
        return exit_status(good)
    process.stdin.close()
    process.wait()
    print(f'  optimal cost {solution.cost:.10f}; crocoddyl {theirs["version"]}: '
          f'{theirs["cost"]:.10f}; largest difference of torques '
          f'{np.abs(solution.tau - theirs["torques"]).max():.1e} N m')
    if not abs(solution.cost / theirs['cost'] - 1.0) < AGREEMENT:
        print(f'FAILED: optimal costs differ by more than {AGREEMENT:g}')
        good = False
    for name in programs:
        ratio = statistics.median(x / y for x, y in zip(times['crocoddyl'], times[name]))
        same = name == 'kane_dynamics'
        print(f'  {name}: {ratio:.1f} times as fast as crocoddyl'
              + (f'; gate {GATE:g}, stretch {STRETCH:g}' if same
                 else ', which has neither'))
        if same and ratio < GATE:
            print(f'FAILED: {ratio:.1f} times as fast as crocoddyl; expected {GATE:g}')
            good = False
    return exit_status(good)


if __name__ == '__main__':
    sys.exit(main())
