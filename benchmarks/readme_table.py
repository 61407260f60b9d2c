"""
The table of speeds in the README, from the report of `make bench`: recorded.json.

`benchmarks/readme_table.py --record` keeps the figures of build/bench/report.json and
prints the table for the README; a test compares the two.
"""

import json
from pathlib import Path
import sys
from typing import Any

RECORDED = Path(__file__).with_name('recorded.json')
REPORT = Path(__file__).resolve().parents[1] / 'build' / 'bench' / 'report.json'
PYTHON = 'Pinocchio from Python'
CPP = 'Pinocchio C++'
ROBOT = 'fr3'
LOOP = 'native loop: '
# Rows of the table: what it is called there, and the race of the report.
ROWS = {
    'inverse dynamics, called from Python': ('inverse dynamics (rnea)', PYTHON),
    'the same, results kept': ('inverse dynamics, results kept', PYTHON),
    'forward dynamics, called from Python': ('forward dynamics (aba)', PYTHON),
    'mass matrix, called from Python': ('mass matrix (crba)', PYTHON),
    'derivatives of inverse dynamics, called from Python': (
        'derivatives of inverse dynamics', PYTHON),
    'Jacobian of a frame, called from Python': ('Jacobian of a frame', PYTHON),
    'batch of 64 inverse dynamics, against a loop of Python': (
        'batch of 64 inverse dynamics, in lanes', PYTHON),
    'inverse dynamics in a loop of C++': (f'{LOOP}inverse_dynamics', CPP),
    'forward dynamics in a loop of C++': (f'{LOOP}forward_dynamics', CPP),
    'derivatives of inverse dynamics in a loop of C++': (
        f'{LOOP}inverse_dynamics_derivatives', CPP),
}


def recorded(report: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of the table from a report."""
    races = {(race['what'], race['peer']): race for race in report['races']
             if race['robot'] == ROBOT}
    rows = {}
    for name, place in ROWS.items():
        race = races[place]
        rows[name] = [race['ours'], race['theirs']]
    return {'compilers': report['machine']['compilers of peers'], 'rows': rows}


def table(figures: dict[str, Any]) -> str:
    """Return the table of the README."""
    compilers = figures['compilers']
    lines = [(f"| Pinocchio's C++ by the faster of {compilers} | kane_dynamics, ns "
              '| Pinocchio, ns | ratio |'), '|---|---|---|---|']
    for name, (ours, theirs) in figures['rows'].items():
        lines.append(f'| {name} | {1e9 * ours:.0f} | {1e9 * theirs:.0f} '
                     f'| {theirs / ours:.1f} |')
    return '\n'.join(lines)


def main() -> int:
    """Print the table; with `--record`, of the last report."""
    if '--record' in sys.argv[1:]:
        report = json.loads(REPORT.read_text(encoding='utf-8'))
        text = json.dumps(recorded(report), indent=1)
        RECORDED.write_text(f'{text}\n', encoding='utf-8')
    print(table(json.loads(RECORDED.read_text(encoding='utf-8'))))
    return 0


if __name__ == '__main__':
    sys.exit(main())
