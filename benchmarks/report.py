"""
All benchmarks as one report, Markdown and JSON, in build/bench: `make bench`.

Every part runs in a process of its own (Pinocchio's Python module and its C++ loop must
not meet in one); within a part all contenders alternate, and ratios are those of
interleaved runs. Exits with 1 if a gate is missed.
"""

import argparse
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from datetime import datetime, UTC
from importlib import import_module, metadata
import json
import math
import os
from pathlib import Path
import platform
import subprocess
import sys
from typing import Any

from kane_dynamics._util.resources import package_version, resource_path
from kane_dynamics.native.machine_code import llvm

FOLDER = Path(__file__).resolve().parents[1] / 'build' / 'bench'
PARTS = ('python_calls', 'native_loop', 'batches', 'simulation_loop', 'constrained_loop',
         'machine_loop', 'machine_calls', 'sweep')
PYTHON = 'Pinocchio from Python'
CPP = 'Pinocchio C++'
MUJOCO = 'MuJoCo'
START = 'start'
UNCHECKED = 'simulate without the energy balance'
PLAIN = 'the plain arm'
CLOCK = 'the clock'
UNDER = ('absolute rates', 'momenta', 'a knife edge at the tip', 'the tip on a plane',
         'a coupling')
WATCHED = 'with the watch of constraints'
UNWATCHED = 'without it'
WATCHED_ROBOTS = ('four-bar', 'rolling disc', 'a knife edge at the tip',
                  'the tip on a plane', 'a coupling')
# 6 and 7, 32, 50 axes.
ARMS = ('ur10e', 'fr3')
LARGE = ('talos',)
LARGEST = ('two_hands',)
CHAINS = ('chain_50', 'chain_200')
BEAMS = ('planar flexible arm', 'spatial flexible arm')
FREE = ('free-flying fr3',)
LOOPS = ('four-bar', 'palletizer', 'delta robot', 'stewart platform')
PACKAGES = ('pin', 'mujoco', 'cmeel-eigen', 'numpy', 'llvmlite')


@dataclass(frozen=True)
class Gate:
    """The least ratio of a peer's time to ours, on each of some robots."""

    what: str
    peer: str
    least: float
    stretch: float
    robots: tuple[str, ...] = ARMS


def gates() -> list[Gate]:
    """Return the gates for this processor."""
    wide = llvm.features().get('avx512f', False)
    loop = 'native loop: '
    return [
        Gate('inverse dynamics (rnea)', PYTHON, 6.0, 10.0),
        Gate('forward dynamics (aba)', PYTHON, 8.0, 12.0),
        Gate('mass matrix (crba)', PYTHON, 5.0, 8.0),
        Gate('bound inverse dynamics (rnea)', PYTHON, 10.0, 14.0),
        Gate('derivatives of inverse dynamics', PYTHON, 7.0, 12.0),
        Gate('derivatives of forward dynamics', PYTHON, 7.0, 12.0),
        Gate('Jacobian of a frame', PYTHON, 6.0, 10.0),
        Gate('pose of a frame', PYTHON, 6.0, 10.0),
        Gate('inverse dynamics, results kept', PYTHON, 4.0, 6.0),
        Gate('batch of 8 inverse dynamics, in lanes', PYTHON, 20.0, 40.0),
        Gate(loop + 'inverse_dynamics', CPP, 8.0, 10.0),
        Gate(loop + 'forward_dynamics', CPP, 7.5, 10.0),
        Gate(loop + 'mass_matrix', CPP, 6.0, 10.0),
        Gate(loop + 'inverse_dynamics_derivatives', CPP, 6.0, 10.0),
        Gate(loop + 'inverse_mass_matrix', CPP, 8.0, 12.0),
        Gate(loop + 'regressor', CPP, 4.5, 6.0), *batch_gates(wide),
        Gate('RK4 simulation, a step', CPP, 5.0, 8.0),
        Gate('RK4 simulation, a step', MUJOCO, 10.0, 20.0),
        # The check of the energy balance costs at most two thirds of the steps' own
        # time.
        Gate('RK4 simulation, a step', UNCHECKED, 0.6, 0.85),
        Gate(loop + 'inverse_dynamics', CPP, 7.0, 10.0, LARGE),
        Gate(loop + 'forward_dynamics', CPP, 3.5, 5.5, LARGE),
        Gate(loop + 'forward_dynamics', CPP, 2.8, 4.0, CHAINS[:1]),
        Gate(loop + 'forward_dynamics', CPP, 1.8, 2.8, CHAINS[1:]),
        Gate(loop + 'mass_matrix', CPP, 1.4, 3.5, CHAINS[:1]),
        Gate(loop + 'inverse_mass_matrix', CPP, 1.1, 2.8, CHAINS[:1]),
        Gate(loop + 'forward_dynamics_derivatives', CPP, 6.0, 8.0, ('fr3',)),
        Gate(loop + 'inverse_dynamics', CPP, 5.5, 10.0, FREE),
        Gate(loop + 'forward_dynamics', CPP, 5.5, 10.0, FREE),
        # its constraintDynamics, with a proximal solver
        Gate(loop + 'constraint dynamics', CPP, 12.0, 25.0, LOOPS),
        Gate('constraint dynamics', PYTHON, 20.0, 40.0, LOOPS),
        *(Gate(loop + what, CPP, least, stretch, LARGE) for what, least, stretch in (
            ('inverse_mass_matrix', 3.5, 5.5), ('coriolis_matrix', 5.0, 6.0),
            ('inverse_dynamics_derivatives', 5.0, 7.0), ('regressor', 5.0, 7.0))),
        *(Gate(loop + what, CPP, least, stretch, LARGEST) for what, least, stretch in (
            ('inverse_mass_matrix', 2.8, 5.5), ('coriolis_matrix', 2.8, 5.5),
            ('inverse_dynamics_derivatives', 4.0, 5.5), ('regressor', 5.0, 7.0))),
        *(Gate(f'forward dynamics under {what}', PLAIN, 1.0 / 3.0, 0.5)
          for what in UNDER),
        *(Gate(f'{what} {WATCHED}', UNWATCHED, 1.0 / 1.05, 1.0,
               WATCHED_ROBOTS)  # costs 5 %
          for what in ('step', 'calls')),
        Gate('inverse dynamics from measured joints', 'its tree', 0.3, 0.5,
             ('palletizer',)),
        # in under 20 s all together
        Gate('a second of each of 10000 simulations, written', CLOCK, 500.0, 2000.0,
             ('fr3',)),
        Gate('a second simulated at 1 ms', CLOCK, 1000.0, 5000.0, ('four-bar',)),
        Gate('a second simulated at 0.1 ms', CLOCK, 120.0, 200.0, BEAMS),
        Gate('a second simulated at 1 ms, implicit', CLOCK, 1000.0, 2000.0, BEAMS)]


ONE_THREAD = 'one thread'
AS_ARITHMETIC = 'one thread over the gain of arithmetic'
# States of each quantity; of matrices fewer, since they take more memory. Jacobians are
# those of the last joint's frame: 100,000 of the FR3 are 34 MB, more than the last
# cache. Two threads then write no faster than one: 42 numbers a state without arithmetic
# take 9 ns in one thread, 8 in two, and the Jacobians 11 and 7; of 50,000 states the
# numbers take 7.4 and 5.3.
STATES = {'inverse_dynamics': 100_000, 'forward_dynamics': 100_000,
          'partial_velocities': 50_000, 'inverse_dynamics_derivatives': 10_000}
# Least ratio and stretch of batches on one thread, with AVX-512 and without.
# Of the 12.5 ns that inverse dynamics of the FR3 takes, 6.1 are the products, at two a
# cycle, the processor's peak, and 10.9 all of the code, which also waits for operands
# and spills values. Data from beyond the caches take 0.9, and up to 1 the call from
# Python, whose code they have replaced. Rows at one distance in place of pointers,
# operations of two blocks mixed, other orders of operations, prefetches from elsewhere
# and constants in one table gain at most 2 %, and some cost as much in other quantities.
BATCH_GATES = {'inverse_dynamics': ((35.0, 45.0), (17.0, 28.0)),
               'forward_dynamics': ((25.0, 40.0), (13.0, 20.0)),
               'partial_velocities': ((5.5, 8.0), (3.5, 5.5)),
               'inverse_dynamics_derivatives': ((5.0, 8.0), (3.5, 5.0))}


def batch_name(what: str, threads: str = ONE_THREAD) -> str:
    """Return the name of the race of a batch in the report."""
    return f'batch of {STATES[what]}: {what}, {threads}'


def simd() -> str:
    """Return the widest SIMD extension that our code uses."""
    features = llvm.features()
    for name, feature in llvm.SIMD.items():
        if features.get(feature):
            return name
    return 'none of x86'


def batch_gates(wide: bool) -> list[Gate]:
    """
    Return the gates of batches, with AVX-512 or without.

    Two threads: 1.9 times as fast as one where two processors do twice the arithmetic of
    one, that is 0.95 of their own gain, which `batches` measures in the same run.
    """
    gates = []
    for what, (of_wide, of_narrow) in BATCH_GATES.items():
        least, stretch = of_wide if wide else of_narrow
        gates.append(Gate(batch_name(what), CPP, least, stretch))
        gates.append(Gate(batch_name(what, 'two threads'), AS_ARITHMETIC, 0.95, 0.975))
    return gates


# Seconds: compiled, and from the cache.
START_GATES = {'inverse dynamics': ((0.08, 0.04), (0.005, 0.002))}


def python_calls() -> dict[str, Any]:
    """Return the calls from Python and the start times, from that benchmark."""
    module = import_module('python_calls')
    figures = module.measure()
    races = []
    for kind in ('calls', 'batch'):
        for name, timings in figures[kind].items():
            axes = module.arm(resource_path('urdf', f'{name}.urdf')).n
            races += [{'robot': name, 'axes': axes, 'what': what, 'peer': PYTHON,
                       'ours': timing.undisturbed('ours'),
                       'theirs': timing.undisturbed('theirs'),
                       'ratio': timing.ratio('theirs', 'ours')}
                      for what, timing in timings.items()]
    return {'races': races, START: figures['start_up']}


def races_of(part: str) -> dict[str, Any]:
    """Return the results of a benchmark, or the reason why there are none."""
    if part == 'python_calls':
        return python_calls()
    module = import_module(part)
    try:
        return {'races': [asdict(race) for race in module.races()]}
    except import_module('pinocchio_native').Unavailable as error:
        return {'races': [], 'left_out': f'{part}: {error}'}


def measured(part: str) -> dict[str, Any]:
    """Run a part in a process of its own and return its results."""
    print(f'{part} ...', flush=True)
    path = FOLDER / f'{part}.json'
    path.unlink(missing_ok=True)
    subprocess.run([sys.executable, __file__, '--part', part, '--out', str(path)],
                   check=True)
    record: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
    path.unlink()
    return record


def machine() -> dict[str, Any]:
    """Return the hardware and software that the numbers depend on."""
    names = []
    for line in _lines('/proc/cpuinfo'):
        if line.startswith('model name'):
            names.append(line.partition(':')[2].strip())
    compilers = import_module('compilers')
    versions = {}
    for package in PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = 'not installed'
    return {'processor': names[0] if names else platform.processor(),
            'cores': os.cpu_count(),
            'widest registers': simd(), 'system': platform.platform(),
            'target': llvm.fingerprint().split('|')[1],
            'LLVM': llvm.fingerprint().split('|')[-1],
            'Python': platform.python_version(),
            'compilers of peers': ' and '.join(
                f'{each.name} ({compilers.target(each)})'
                for each in compilers.compilers()),
            'kane_dynamics': package_version(), 'load': os.getloadavg()[0], **versions}


def _lines(path: str) -> list[str]:
    try:
        return Path(path).read_text(encoding='utf-8').splitlines()
    except OSError:
        return []  # not Linux


def judged(
        races: Iterable[dict[str, Any]], start: dict[str, Any]) -> list[dict[str, Any]]:
    """Return every gate with its measured ratio; without a measurement it is not met."""
    ratios = {(race['robot'], race['what'], race['peer']): race['ratio']
              for race in races}
    rows = []
    for gate in gates():
        for robot in gate.robots:
            ratio = ratios.get((robot, gate.what, gate.peer), [math.nan] * 3)
            rows.append({'gate': f'{robot}: {gate.what} / {gate.peer}',
                         'measured': ratio, 'least': gate.least, 'stretch': gate.stretch,
                         'met': ratio[0] >= gate.least})
    for what, limits in START_GATES.items():
        times = start.get(what, (math.nan, math.nan))
        for how, took, (limit, stretch) in zip(('compiled', 'from the cache'), times,
                                               limits):
            rows.append(
                {'gate': f'fr3: {what} {how}, ms at most', 'measured': [1e3 * took],
                 'least': 1e3 * limit, 'stretch': 1e3 * stretch, 'met': took <= limit})
    return rows


def markdown(report: dict[str, Any]) -> str:
    """Return the report as Markdown."""
    lines = [
        '# Benchmarks', '', f'{report["date"]}. ' + ', '.join(
            f'{key} {value}' for key, value in report['machine'].items()) + '.', '',
        'Times are those of the least disturbed tenth of the turns. Ratios are theirs /',
        'ours, from one run in which all contenders alternate in shuffled order (in',
        'brackets the 10th to 90th percentile of all turns). Reproduce with',
        '`make bench`; `benchmarks/` says how each is measured.', '',
        ('Figures depend on the widest SIMD registers (AVX-512: 8 doubles, AVX2: '
         '4), most those of'), ('batches, and on fused operations. '
                                '`KANE_DYNAMICS_SIMD=avx2 make bench` measures ours'),
        ('without AVX-512; '
         'Pinocchio is compiled for the processor as it is. Gates of batches are'),
        'those of the registers.', '',
        ('Two threads are judged by what two '
         'processors gain in pure arithmetic, started in the'),
        ('same way in the '
         'same run: 0.95 of that, 1.9 times one thread where arithmetic gains 2.'),
        '', '## Gates', '', '| | measured | gate | stretch | |', '|---|---|---|---|---|']
    lines += [f'| {row["gate"]} | {_ratio(row["measured"])} | {row["least"]:g} '
              f'| {row["stretch"]:g} | {"met" if row["met"] else "MISSED"} |'
              for row in report['gates']]
    lines += ['', '## All figures', '',
              '| robot | axes | | ours, ns | theirs, ns | peer | ratio |',
              '|---|---|---|---|---|---|---|']
    lines += [f'| {r["robot"]} | {r["axes"]} | {r["what"]} | {1e9 * r["ours"]:.0f} '
              f'| {1e9 * r["theirs"]:.0f} | {r["peer"]} | {_ratio(r["ratio"])} |'
              for r in report['races']]
    lines += ['', '## Start of a process, fr3', '',
              '| | compiled, ms | from the cache, ms |', '|---|---|---|']
    lines += [f'| {what} | {1e3 * compiled:.1f} | {1e3 * loaded:.1f} |'
              for what, (compiled, loaded) in report[START].items()]
    lines += [f'\nLeft out: {reason}.' for reason in report['left_out']]
    return '\n'.join([*lines, ''])


def _ratio(values: list[float]) -> str:
    middle, *spread = values
    if math.isnan(middle):
        return 'not measured'
    digits = 1 if middle >= 1.5 else 2
    return f'{middle:.{digits}f}' + (
        f' ({spread[0]:.{digits}f} to {spread[1]:.{digits}f})' if spread else '')


def finite(value: Any) -> Any:
    """Return a value with null in place of NaN, which JSON lacks."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def main() -> int:
    """Measure everything, write the report, and check the gates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--no-gates', action='store_true',
                        help='exit with 0 in any case')
    parser.add_argument('--part', choices=PARTS, help=argparse.SUPPRESS)
    parser.add_argument('--out', type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        options.out.write_text(json.dumps(races_of(options.part)), encoding='utf-8')
        return 0
    FOLDER.mkdir(parents=True, exist_ok=True)
    parts = {part: measured(part) for part in PARTS}
    races = []
    for part in parts.values():
        races += part['races']
    start = parts['python_calls'][START]
    report = {'date': datetime.now(UTC).isoformat(timespec='seconds'),
              'machine': machine(), 'gates': judged(races, start), 'races': races,
              START: start,
              'left_out': [p['left_out'] for p in parts.values() if 'left_out' in p]}
    text = markdown(report)
    limited = os.environ.get(llvm.SIMD_VARIABLE)
    name = f'report_{limited}' if limited else 'report'
    written = [FOLDER / f'{name}.md', FOLDER / f'{name}.json']
    written[0].write_text(text, encoding='utf-8')
    written[1].write_text(json.dumps(finite(report), indent=1) + '\n', encoding='utf-8')
    print(f'{text}\nwritten to {written[0]} and {written[1]}')
    missed_gates = [row['gate'] for row in report['gates'] if not row['met']]
    print(f'{len(missed_gates)} of {len(report["gates"])} gates missed' if missed_gates
          else 'all gates met')
    return 1 if missed_gates and not options.no_gates else 0


if __name__ == '__main__':
    sys.exit(main())
