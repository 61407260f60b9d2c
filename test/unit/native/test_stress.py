"""
Threads, dropped robots, exceptions, pickles, interrupts, forks, exits of processes.

The allocator writes over all that is freed. KANE_DYNAMICS_STRESS_SECONDS is the time of
the long test, an hour by default.
"""

import os
from pathlib import Path
import subprocess
import sys
import time

import pytest

PROGRAM = Path(__file__).resolve().parents[2] / 'helpers' / 'native_stress.py'
LONG = float(os.environ.get('KANE_DYNAMICS_STRESS_SECONDS', '3600'))
ROUND = 60.0  # s, of one process of the long test


def stress(seconds):
    done = subprocess.run([sys.executable, PROGRAM, str(seconds)],
                          capture_output=True, text=True, timeout=seconds + 100.0, env={
                              **os.environ, 'PYTHONPATH': os.pathsep.join(sys.path),
                              'PYTHONMALLOC': 'debug', 'MALLOC_PERTURB_': '2'})
    assert done.returncode == 0, done.stderr


@pytest.mark.timeout(300)
def test_nothing_crashes_and_all_numbers_are_right_under_stress():
    stress(4.0)


@pytest.mark.slow
@pytest.mark.timeout(LONG + 1000.0)
def test_nothing_crashes_and_all_numbers_are_right_under_long_stress():
    end = time.monotonic() + LONG
    while (left := end - time.monotonic()) > 0.0:
        stress(min(left, ROUND))
