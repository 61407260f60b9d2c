"""
Forward dynamics of chains of 10 to 200 joints: time, code, and Pinocchio's time beside them.

Prints a table and draws build/bench/chain_growth.png. Exits with 1 if the time of long chains
does not grow linearly, or their code grows.
"""

from functools import partial
import sys
import warnings

from big_robots import chain
from gates import exit_status
from kane_dynamics import Robot
from kane_dynamics.cli.commands.interleaved_timing import interleaved
from kane_dynamics.native.backends.llvm_scalar import module_text
from kane_dynamics.native.machine_code import llvm
import matplotlib
import matplotlib.pyplot as plt
from native_loop import check, our_loop, random_states, STATES
from pinocchio_native import library, Pinocchio, Unavailable
from report import FOLDER

WHAT = 'forward_dynamics'
AXES = (10, 20, 30, 40, 50, 75, 100, 150, 200)
SHORT, LONG = 50, 200  # axes between which growth is judged
STEEPEST = 1.15  # growth of the time per joint
MOST_CODE = 1.1  # of the longer chain's code over that of the shorter one


def measured(axes: int, against: bool) -> dict[str, float]:
    """Return ns of one call, bytes of code, and Pinocchio's ns if it can be built."""
    robot = Robot(chain(axes), friction=False)
    states = random_states(robot, STATES)
    loops = {'ours': our_loop(robot, WHAT, states)}
    if against:
        peer = Pinocchio(robot)
        peer.keep(*states)
        check(robot, peer, WHAT, states)
        for rival in (WHAT, f'{WHAT}/world'):
            loops[rival] = partial(peer.run, rival)
    timing = interleaved(loops)
    rivals = [timing.median(name) for name in loops if name != 'ours']
    program = robot.kernels.program(WHAT, single=True)
    return {'ns': 1e9 * timing.median('ours') / STATES,
            'bytes': llvm.code_size(module_text(program, 'kernel')),
            'peer': 1e9 * min(rivals) / STATES if rivals else float('nan')}


def draw(rows: dict[int, dict[str, float]]) -> None:
    """Draw time and code over the number of joints."""
    matplotlib.use('Agg')
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(7.0, 6.0))
    axes = list(rows)
    above.plot(axes, [1e-3 * rows[n]['ns'] for n in axes], 'o-', label='kane_dynamics')
    above.plot(axes, [1e-3 * rows[n]['peer'] for n in axes], 's--', label='Pinocchio')
    above.set_ylabel('forward dynamics, us')
    above.legend()
    below.plot(axes, [1e-3 * rows[n]['bytes'] for n in axes], 'o-')
    below.set_ylabel('code, kB')
    below.set_xlabel('joints of the chain')
    below.set_ylim(bottom=0.0)
    FOLDER.mkdir(parents=True, exist_ok=True)
    figure.savefig(FOLDER / 'chain_growth.png', dpi=120)


def main() -> int:
    """Measure, print and draw; return 1 if time or code of long chains grow too fast."""
    warnings.simplefilter('ignore')
    against = True
    try:
        library()
    except Unavailable as error:
        print(f'Pinocchio left out: {error}')
        against = False
    rows = {}
    for axes in AXES:
        rows[axes] = row = measured(axes, against)
        print(f'{axes:4} joints: {row["ns"]:8.0f} ns, {row["bytes"]:7.0f} bytes, Pinocchio '
              f'{row["peer"]:8.0f} ns, {row["peer"] / row["ns"]:.1f}', flush=True)
    draw(rows)
    growth = rows[LONG]['ns'] / rows[SHORT]['ns'] / (LONG / SHORT)
    code = rows[LONG]['bytes'] / rows[SHORT]['bytes']
    met = growth <= STEEPEST and code <= MOST_CODE
    print(f'from {SHORT} to {LONG} joints: time per joint times {growth:.2f} (at most '
          f'{STEEPEST}), code times {code:.2f} (at most {MOST_CODE}): '
          f'{"met" if met else "NOT met"}')
    return exit_status(met)


if __name__ == '__main__':
    sys.exit(main())
