"""Many simulations of one robot, as a table; needs `pip install 'kane_dynamics[sweep]'`."""

from kane_dynamics.sweep.description import Sweep
from kane_dynamics.sweep.running import run_sweep, Summary
from kane_dynamics.sweep.table import read_table

__all__ = ['Summary', 'Sweep', 'read_table', 'run_sweep']
