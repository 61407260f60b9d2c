"""
Chains of 10 to 200 joints: time, code, and Pinocchio's time beside them.

Prints a table of forward dynamics, mass matrix and its inverse, and draws
build/bench/chain_growth.png; with `--record` the picture of the documentation. Exits
with 1 if the time of forward dynamics of long chains does not grow linearly, that of a
matrix faster than its entries, or their code grows.
"""

from collections.abc import Iterable
from functools import partial
from pathlib import Path
import sys
import time
import warnings

from big_robots import chain
from gates import exit_status
from interleaved_timing import interleaved
from kane_dynamics import Robot
from kane_dynamics.native.backends.llvm_scalar import module_text
from kane_dynamics.native.machine_code import llvm
import matplotlib
import matplotlib.pyplot as plt
from native_loop import check, our_loop, random_states, RIVALS, STATES
from pinocchio_native import builds, Pinocchio, Unavailable, versions
from report import FOLDER

PICTURE = FOLDER / 'chain_growth.png'
RECORDED = Path(__file__).resolve().parents[1] / 'docs' / 'pictures' / 'chain_growth.png'
QUANTITIES = ('forward_dynamics', 'mass_matrix', 'inverse_mass_matrix')
AXES = (10, 20, 30, 40, 50, 75, 100, 150, 200)
# Axes between which growth is judged.
SHORT = 50
LONG = 200
STEEPEST = 1.15  # growth of the time per joint, or per entry of a matrix
MOST_CODE = 1.1  # of the longer chain's code over that of the shorter one
Row = dict[str, float]


def measured(axes: int, against: bool) -> dict[str, Row]:
    """Return ns, bytes of code and, against Pinocchio, its ns, by quantity."""
    robot = Robot(chain(axes), friction=False)
    states = random_states(robot, STATES)
    peers = builds(robot) if against else {}
    for peer in peers.values():
        peer.keep(*states)
    return {what: measured_quantity(robot, what, states, peers) for what in QUANTITIES}


def measured_quantity(
        robot: Robot, what: str, states: Iterable, peers: dict[str, Pinocchio]) -> Row:
    """Return the figures of a quantity; without Pinocchio there is no 'peer'."""
    loops = {'ours': our_loop(robot, what, states)}
    for compiler, peer in peers.items():
        check(robot, peer, what, states)
        for rival in RIVALS[what]:
            loops[f'{compiler}: {rival}'] = partial(peer.run, rival)
    timing = interleaved(loops, clock=time.process_time)
    program = robot.kernels.program(what, single=True)
    row = {'ns': 1e9 * timing.median('ours') / STATES,
           'bytes': llvm.code_size(module_text(program, 'kernel'))}
    rivals = [timing.median(name) for name in loops if name != 'ours']
    if rivals:
        row['peer'] = 1e9 * min(rivals) / STATES
    return row


def line(axes: int, what: str, row: Row) -> str:
    """Return the figures as text."""
    peer = 'Pinocchio not measured'
    if 'peer' in row:
        peer = f'Pinocchio {row["peer"]:8.0f} ns, {row["peer"] / row["ns"]:.1f}'
    return (f'{axes:4} joints, {what:19}: {row["ns"]:8.0f} ns, {row["bytes"]:7.0f} '
            f'bytes, {peer}')


def draw(rows: dict[int, dict[str, Row]], path: Path) -> None:
    """Draw time and code over the number of joints, and print where."""
    matplotlib.use('Agg')
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(7.0, 7.0),
                                          layout='constrained')
    axes = list(rows)
    for color, what in enumerate(QUANTITIES):
        figures = [rows[n][what] for n in axes]
        label = what.replace('_', ' ')
        style = {'color': f'C{color}'}
        above.plot(axes, [1e-3 * row['ns'] for row in figures], 'o-',
                   label=label, **style)
        below.plot(axes, [1e-3 * row['bytes'] for row in figures], 'o-', **style)
        if all('peer' in row for row in figures):
            above.plot(axes, [1e-3 * row['peer'] for row in figures], 's--',
                       label=f'{label}, Pinocchio', **style)
    above.set_ylabel('time of a call, us')
    above.set_xscale('log')
    above.set_yscale('log')
    figure.legend(loc='outside upper center', ncols=2)  # of the axes it would hide times
    below.set_ylabel('code, kB')
    below.set_xlabel('joints of the chain')
    below.set_ylim(bottom=0.0)
    below.set_xticks(axes, [str(n) for n in axes])
    below.minorticks_off()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)
    print(f'picture: {path}')


def judged(rows: dict[int, dict[str, Row]]) -> bool:
    """Print how time and code grow from `SHORT` to `LONG`; return whether both may."""
    all_met = True
    for what in QUANTITIES:
        short = rows[SHORT][what]
        long = rows[LONG][what]
        power = 1 if what == 'forward_dynamics' else 2
        growth = long['ns'] / short['ns'] / (LONG / SHORT)**power
        code = long['bytes'] / short['bytes']
        met = growth <= STEEPEST and code <= MOST_CODE
        all_met = all_met and met
        unit = 'joint' if power == 1 else 'entry'
        print(
            f'{what} from {SHORT} to {LONG} joints: time per {unit} times {growth:.2f} '
            f'(at most {STEEPEST}), code times {code:.2f} (at most {MOST_CODE}): '
            f'{"met" if met else "NOT met"}')
    return all_met


def main(*arguments: str) -> int:
    """Measure, print and draw; return 1 if time or code of long chains grow too fast."""
    warnings.simplefilter('ignore')
    against = True
    try:
        versions()
    except Unavailable as error:
        print(f'Pinocchio left out: {error}')
        against = False
    rows = {}
    for axes in AXES:
        rows[axes] = measured(axes, against)
        for what, row in rows[axes].items():
            print(line(axes, what, row), flush=True)
    draw(rows, RECORDED if '--record' in arguments else PICTURE)
    return exit_status(judged(rows))


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))
