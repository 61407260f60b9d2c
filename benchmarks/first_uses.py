"""
Processor time of first uses and of large inputs, as ratios of times of one run.

Each line compares two programs that run in turn: the larger of two inputs with the
smaller one, a known URDF with a new one, a start with the imports that it needs. The
exit status is 1 if a ratio is above its gate.
"""

import os
from pathlib import Path
import subprocess
import sys
import tempfile

from gates import exit_status

ROOT = Path(__file__).resolve().parents[1]
REPEATS = 3  # of which the fastest counts

CHAIN = """
sys.path.insert(0, 'test/helpers')
from kane_dynamics import load_urdf
from urdf_writer import chain
begin = time.process_time()
load_urdf(chain({size}, 'revolute'))
"""
BEAM = """
from kane_dynamics import FlexibleLink, ModelBuilder
begin = time.process_time()
b = ModelBuilder('beam')
b.beam('beam', 'world', FlexibleLink(1.0, 2.0, 50.0, modes=({size}, 0)))
b.model()
"""
DEEP = """
from kane_dynamics import load_urdf
begin = time.process_time()
load_urdf('<robot name="r"><link name="a"><visual>' + '<y>' * {size} + '</y>' * {size}
          + '</visual></link></robot>')
"""
ROWS = """
sys.path.insert(0, 'test/helpers')
from kane_dynamics import load_urdf
from kane_dynamics.identification import identify
from recordings import simulated
arm = load_urdf('urdf/ur10e.urdf')
recorded = simulated(arm, 0, 0.5, duration=21.0, rate={size})
begin = time.process_time()
identify(arm, recorded)
"""
KERNELS = """
from kane_dynamics import load_urdf, Robot
from kane_dynamics.simulation.simulate import compile_simulation
begin = time.process_time()
compile_simulation(Robot(load_urdf('urdf/fr3.urdf')), 'rk4', 'external_force')
"""
LOAD = """
from kane_dynamics import load_urdf
begin = time.process_time()
load_urdf('urdf/fr3.urdf')
"""
TORQUE = """
sys.argv = ['kane-dynamics', 'torque', 'urdf/fr3.urdf']
from kane_dynamics.cli import main
main()
"""
IMPORTS = 'import numpy, llvmlite.binding, argparse, json, csv, inspect'


def seconds(program, cache):
    """Return the processor time of a program from its line `begin` on, or of all, s."""
    source = '\n'.join(['import sys, time, warnings', 'warnings.simplefilter("ignore")',
                        'begin = time.process_time()', program,
                        'print(time.process_time() - begin)'])
    environment = {**os.environ, 'KANE_DYNAMICS_CACHE': cache, 'PYTHONPATH': str(ROOT)}
    done = subprocess.run([sys.executable, '-c', source], check=True, text=True,
                          cwd=ROOT, capture_output=True, env=environment)
    return float(done.stdout.split()[-1])


def ratio(program, reference, cold=False):
    """Return the least time of a program, with or without a cache, over another's."""
    times = [[], []]
    for _ in range(REPEATS):
        with tempfile.TemporaryDirectory() as place:
            times[1].append(seconds(reference, place))
            if not cold:
                seconds(program, place)  # fills the cache
            times[0].append(seconds(program, 'off' if cold else place))
    return min(times[0]) / min(times[1])


def sized(program, larger, smaller):
    """Return the ratio of two sizes of an input."""
    return ratio(program.format(size=larger), program.format(size=smaller), cold=True)


def main():
    """Print all ratios; return whether all gates are met."""
    ratios = {
        'chain of 4000 links over 1000': (sized(CHAIN, 4000, 1000), 6.0),
        'beam of 16 modes over 4': (sized(BEAM, 16, 4), 10.0),
        'XML 100,000 deep over 25,000': (sized(DEEP, 100_000, 25_000), 6.0),
        'identification of 10,500 rows over 2,625': (sized(ROWS, 500.0, 125.0), 6.0),
        'kernels of a known FR3 over those of a new one': (ratio(KERNELS, KERNELS), 0.2),
        'a known URDF over a new one': (ratio(LOAD, LOAD), 0.4),
        'import of kane_dynamics over that of numpy': (
            ratio('import kane_dynamics', 'import numpy', cold=True), 0.5),
        'torque of a known URDF over its imports': (ratio(TORQUE, IMPORTS), 3.5)}
    for name, (value, gate) in ratios.items():
        print(f'{name}: {value:.2f} (at most {gate:g})')
    return all(value <= gate for value, gate in ratios.values())


if __name__ == '__main__':
    sys.exit(exit_status(main()))
