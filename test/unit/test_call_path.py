"""A first call passes few modules and functions: what a reader has to follow."""

from pathlib import Path
import subprocess
import sys

import pytest

PROGRAM = Path(__file__).resolve().parents[2] / 'benchmarks' / 'call_path.py'


@pytest.mark.slow
def test_first_calls_pass_no_more_modules_and_functions_than_recorded():
    # In a process of its own, where no earlier call has compiled or computed anything.
    counted = subprocess.run([sys.executable, str(PROGRAM)],
                             capture_output=True, text=True, timeout=300)
    assert counted.returncode == 0, counted.stdout + counted.stderr
