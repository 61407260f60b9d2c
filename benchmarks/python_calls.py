"""Calls from Python compared with Pinocchio's; compile times, batches and simulation."""

from functools import partial
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time
from timeit import Timer
from typing import Any
from unittest.mock import patch
import warnings

from interleaved_timing import interleaved, Timing
from kane_dynamics import load_urdf, Robot, simulate
from kane_dynamics._util.resources import resource_path
from kane_dynamics.cli.commands.inspect_command import pinocchio_model
from kane_dynamics.errors import InputError
import numpy as np
import pinocchio as pin

ARMS = ('ur10e.urdf', 'fr3.urdf')

# Least ratio of Pinocchio's time to ours, for the calls that have a gate.
GATES = {'inverse dynamics (rnea)': 6.0, 'forward dynamics (aba)': 8.0,
         'mass matrix (crba)': 5.0, 'the same, without attribute access': 12.0}
# States of batches of inverse dynamics; the peer is called in a loop of Python.
BATCHES = (8, 64, 256, 1000, 10_000)
KEPT = 256  # results that one statement keeps
# Seconds in a new process, imports and the start of LLVM apart: compiled, loaded from
# the cache.
STARTS = (START, ROBOT, ONE, LOOPS, ALL) = (
    'start of LLVM', 'Robot', 'inverse dynamics', 'what loops call', 'all kernels')
GATES_COMPILE = {ONE: (0.08, 0.005), LOOPS: (1.0, 0.05)}

START_UP = """
import json, sys, time, warnings
warnings.simplefilter('ignore')
from kane_dynamics import load_urdf, Robot
from kane_dynamics.native.python_call import entry
from kane_dynamics.native.runtime.loops import loops
from kane_dynamics.robot.kernel_set import IN_LOOPS
path = sys.argv[1]
names = load_urdf(path).joint_names
model = load_urdf(path, joints=[name for name in names if 'finger' not in name])
times = [time.perf_counter()]
entry.supported(), loops()
times.append(time.perf_counter())
robot = Robot(model)
times.append(time.perf_counter())
robot.inverse_dynamics
times.append(time.perf_counter())
robot.compile(*IN_LOOPS)
times.append(time.perf_counter())
robot.compile()
times.append(time.perf_counter())
print(json.dumps(times))
"""


# Statements that are timed: ours and Pinocchio's.
CALLS = {
    'inverse dynamics (rnea)': ('robot.inverse_dynamics(q, u, x)',
                                'pin.rnea(peer, data, q, u, x)'),
    'forward dynamics (aba)': ('robot.forward_dynamics(q, u, x)',
                               'pin.aba(peer, data, q, u, x)'),
    'mass matrix (crba)': ('robot.mass_matrix(q)', 'pin.crba(peer, data, q)'),
    'bound inverse dynamics (rnea)': ('bound.inverse_dynamics()',
                                      'pin.rnea(peer, data, q, u, x)'),
    'the same, without attribute access': ('bound_inverse_dynamics()',
                                           'rnea(peer, data, q, u, x)'),
    'derivatives of inverse dynamics': (
        'robot.inverse_dynamics_derivatives(q, u, x)',
        'pin.computeRNEADerivatives(peer, data, q, u, x)'),
    'derivatives of forward dynamics': (
        'robot.forward_dynamics_derivatives(q, u, x)',
        'pin.computeABADerivatives(peer, data, q, u, x)'),
    'Jacobian of a frame': ('robot.jacobian(frame, q)',
                            'pin.computeFrameJacobian(peer, data, q, number, axes)'),
    'pose of a frame': ('robot.frame_pose(frame, q)',
                        ('pin.forwardKinematics(peer, data, q); '
                         'pin.updateFramePlacement(peer, data, number)')),
    'operational-space inertia': (
        'robot.operational_space_inertia(frame, q)',
        ('J = pin.computeFrameJacobian(peer, data, q, number, axes); '
         'inverse(J @ pin.computeMinverse(peer, data, q) @ J.T)')),
    'inverse dynamics, results kept': (
        '[robot.inverse_dynamics(q, u, x) for _ in many]',
        '[pin.rnea(peer, data, q, u, x).copy() for _ in many]'),
}


def peer_of(source: str | bytes, robot: Robot) -> Any:
    """
    Return Pinocchio's model of the same arm, with every other joint locked at 0.

    Raises
    ------
    InputError
        If Pinocchio is not installed, or its model has other coordinates or torques.

    """
    full = pinocchio_model(source, robot.model)
    names = robot.joint_names
    # Pinocchio has all joints of the URDF; those that the robot lacks are locked.
    locked = [full.getJointId(name) for name in full.names[1:] if name not in names]
    peer = pin.buildReducedModel(full, locked, pin.neutral(full)) if locked else full
    if tuple(peer.names[1:]) != names or peer.nq != robot.n:
        raise InputError(f'Pinocchio: coordinates {", ".join(peer.names[1:])}; expected '
                         f'{", ".join(names)}')
    # Times are compared only if both compute the same torque.
    q, u, udot = np.random.default_rng(0).uniform(-1.0, 1.0, (3, robot.n))
    ours = Robot(robot.model, friction=False).inverse_dynamics(q, u, udot)
    theirs = pin.rnea(peer, peer.createData(), q, u, udot)
    if np.abs(ours - theirs).max() > 1e-9 * max(np.abs(ours).max(), 1.0):
        raise InputError('Pinocchio: other torques; expected a model without armature, '
                         'springs and mimic joints, which Pinocchio does not read from '
                         'a URDF')
    return peer


def call_timings(robot: Robot, peer: Any = None) -> dict[str, Timing]:
    """Time `CALLS` on one arm in turns; the contenders are 'ours' and 'theirs'."""
    q, u, x = np.random.default_rng(0).uniform(-1.0, 1.0, (3, robot.n))
    bound: Any = robot.bind()
    bound.q[:] = q
    bound.u[:] = u
    bound.udot[:] = x
    # The statements are timed with these names as their globals.
    names: dict[str, Any] = {'robot': robot, 'bound': bound, 'q': q, 'u': u, 'x': x,
                             'bound_inverse_dynamics': bound.inverse_dynamics,
                             'frame': robot.frame_names[-1], 'many': range(KEPT),
                             'inverse': np.linalg.inv}
    if peer is not None:
        names |= {'number': peer.getFrameId(robot.frame_names[-1]),
                  'axes': pin.LOCAL_WORLD_ALIGNED}
        names |= {'pin': pin, 'rnea': pin.rnea, 'peer': peer,
                  'data': peer.createData()}
    # Some calls share a statement, which is timed once.
    statements = set()
    for ours, theirs in CALLS.values():
        statements.add(ours)
        if peer is not None:
            statements.add(theirs)
    timing = interleaved({statement: Timer(statement, globals=names)
                          for statement in sorted(statements)})
    timings = {}
    for what, (ours, theirs) in CALLS.items():
        calls = KEPT if 'many' in ours else 1
        seconds = {'ours': timing.seconds[ours] / calls}
        if peer is not None:
            seconds['theirs'] = timing.seconds[theirs] / calls
        timings[what] = Timing(seconds)
    return timings


def arm(path: Path) -> Robot:
    """Return the robot of a file without its gripper's joints."""
    names = load_urdf(path).joint_names
    return Robot(
        load_urdf(path, joints=[name for name in names if 'finger' not in name]))


def calls(path: Path) -> dict[str, Timing]:
    """Time `CALLS` on one arm, 'ours' and 'theirs'."""
    robot = arm(path)
    return call_timings(robot, peer_of(str(path), robot))


def batch(path: Path) -> dict[str, Timing]:
    """Time batches against a loop over Pinocchio, 'ours' and 'theirs'."""
    robot = arm(path)
    peer = peer_of(str(path), robot)
    data = peer.createData()
    timings = {}
    for count in BATCHES:
        states = np.random.default_rng(1).uniform(-1.0, 1.0, (3, count, robot.n))

        def peer_loop(states: np.ndarray = states) -> None:
            for a, b, c in zip(*states):
                pin.rnea(peer, data, a, b, c)

        def one_thread(states: np.ndarray = states) -> None:
            with patch.dict(os.environ, {'KANE_DYNAMICS_THREADS': '1'}):
                robot.inverse_dynamics(*states)
        contenders = {'ours': partial(robot.inverse_dynamics, *states),
                      'one thread': one_thread, 'theirs': peer_loop}
        seconds = interleaved(contenders, turns=25).seconds
        name = f'batch of {count} inverse dynamics, in lanes'
        if count < BATCHES[-1]:
            timings[name] = Timing({k: seconds[k] for k in ('ours', 'theirs')})
            continue
        timings[f'{name}, one thread'] = Timing({'ours': seconds['one thread'],
                                                 'theirs': seconds['theirs']})
        timings[f'{name}, all threads'] = Timing({k: seconds[k]
                                                  for k in ('ours', 'theirs')})
    return timings


def simulation(path: Path, duration: float = 10.0) -> float:
    """Return the seconds that simulating `duration` at 1 ms takes."""
    robot = arm(path)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, robot.n)
    zeros = np.zeros(robot.n)
    simulate(robot, q, zeros, duration)
    start = time.perf_counter()
    simulate(robot, q, zeros, duration)
    return time.perf_counter() - start


def start_up(path: Path, processes: int = 5) -> dict[str, tuple[float, float]]:
    """Return median seconds in new processes, compiled, and loaded from the cache."""
    with tempfile.TemporaryDirectory() as cache:
        def measured(setting: str) -> list[float]:
            environment = {**os.environ, 'KANE_DYNAMICS_CACHE': setting}
            printed = subprocess.run(
                [sys.executable, '-c', START_UP, str(path)], check=True,
                env=environment, text=True, capture_output=True).stdout
            start, ready, imported, one, loops, every = json.loads(printed)
            return [ready - start, imported - ready, one - imported, loops - imported,
                    every - imported]
        measured(cache)
        turns = [(measured('off'), measured(cache)) for _ in range(processes)]
    compiled, loaded = np.median(turns, axis=0)
    return {what: (float(a), float(b))
            for what, a, b in zip(STARTS, compiled, loaded)}


def missed(figures: dict[str, Any]) -> list[str]:
    """Return the gates that the figures of `measure` do not meet."""
    slow = []
    for name, timings in figures['calls'].items():
        for what, timing in timings.items():
            if (gate := GATES.get(what)) and timing.ratio('theirs', 'ours')[0] < gate:
                slow.append(
                    f'{name}, {what}: {timing.ratio("theirs", "ours")[0]:.1f} of {gate}')
    late = [f'{what}: {1e3 * took:.1f} of {1e3 * gate:.0f} ms'
            for what, gates in GATES_COMPILE.items()
            for took, gate in zip(figures['start_up'][what], gates) if took > gate]
    return slow + late


def measure() -> dict[str, Any]:
    """Return all figures: by arm the calls, batch and simulation, and start times."""
    paths = {Path(name).stem: resource_path('urdf', name) for name in ARMS}
    return {'calls': {name: calls(path) for name, path in paths.items()},
            'batch': {name: batch(path) for name, path in paths.items()},
            'simulation': {name: simulation(path) for name, path in paths.items()},
            'start_up': start_up(paths['fr3'])}


def row(what: str, timing: Timing) -> str:
    """Return one line of the table."""
    middle, low, high = timing.ratio('theirs', 'ours')
    return (f'| {what} | {1e9 * timing.undisturbed("ours"):.0f} | '
            f'{1e9 * timing.undisturbed("theirs"):.0f} '
            f'| {middle:.1f} ({low:.1f} to {high:.1f}) |')


def main() -> int:
    """Print the report; return 1 if a gate is not met."""
    warnings.simplefilter('ignore')
    print(
        f'Pinocchio {pin.__version__}, Python {sys.version.split()[0]}, '
        f'{os.cpu_count()} processors. Times are those of the '
        'least disturbed tenth of the turns (in brackets the 10th to 90th percentile of '
        'ratios).')
    figures = measure()
    for name, timings in figures['calls'].items():
        print(f'\n### {name}\n\n| call from Python | ours, ns | Pinocchio, ns '
              '| Pinocchio / ours |\n|---|---|---|---|')
        for what, timing in {**timings, **figures['batch'][name]}.items():
            print(row(what, timing))
        took = figures['simulation'][name]
        print(f'\nRunge-Kutta at 1 ms: 10 s simulated in {1e3 * took:.1f} ms '
              f'({10.0 / took:.0f} times real time).')
    print('\n### Start of a process, fr3\n\n| | compiled, ms | from the cache, ms |\n'
          '|---|---|---|')
    for what, (compiled, loaded) in figures['start_up'].items():
        print(f'| {what} | {1e3 * compiled:.1f} | {1e3 * loaded:.1f} |')
    failures = missed(figures)
    print('\nGates: ' + ('met.' if not failures else 'NOT met: ' + '; '.join(failures)))
    return 1 if failures else 0


if __name__ == '__main__':
    sys.exit(main())
