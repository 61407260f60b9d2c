"""
Each live parameter at the ends of its range and next to zero, while an arm moves.

The node refuses the value, or the arm moves no faster than without the change, and its
torques stay within effort limits and their default rate. The same holds after the old
value is set again.
"""

import json
import os
from pathlib import Path
import subprocess
import sys

import pytest

pytest.importorskip('rclpy')

from kane_dynamics._util.resources import resource_path  # noqa: E402, I100
from kane_dynamics.ros.parameters.parameter_table import SPECS  # noqa: E402

ROOT = Path(__file__).parents[3]
# Lists without a range, and the mode, whose changes have tests of their own.
WITHOUT_RANGE = {'mode', 'attached_objects.masses'}
ROUNDING = 1e-6


@pytest.fixture(scope='module')
def cases():
    """Return all cases, those without a change first."""
    program = ROOT / 'test' / 'helpers' / 'live_extremes.py'
    done = subprocess.run(
        [sys.executable, str(program), str(resource_path('urdf', 'two_link.urdf'))],
        capture_output=True, text=True, timeout=400, cwd=ROOT,
        env=os.environ | {'PYTHONPATH': os.pathsep.join([str(ROOT), *sys.path])})
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_every_live_parameter_is_set(cases):
    live = {spec.name for spec in SPECS if spec.live}
    assert {case['name'] for case in cases} == live - WITHOUT_RANGE | {''}


def test_no_value_of_a_live_parameter_throws_a_moving_arm(cases):
    usual = {case['mode']: case for case in cases if not case['name']}
    bad = []
    for case in cases:
        largest = 1.2 * usual[case['mode']]['speed'] + 0.1  # rad/s
        slow = case['speed'] <= largest
        within = max(case['over'], case['rate']) <= 1.0 + ROUNDING
        # The ranges of descriptors are judged by rclpy, in its words.
        reason = case['reason']
        refusal = (not reason or '; expected ' in reason
                   or f"Parameter {case['name']} out of range Min: " in reason)
        back = not case['back'] and not case['fault'] and case['commanding']
        if not (slow and within and refusal and back):
            bad.append(case)
    assert not bad
