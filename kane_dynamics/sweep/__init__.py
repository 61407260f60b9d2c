"""
Many simulations of one robot, as a table; needs `pip install 'kane_dynamics[sweep]'`.

The columns of the table, one row a trial; rad or m, and s, N m or N:

====================  =============================================================================
index, seed           what settles the trial: ``SeedSequence(seed, spawn_key=(index,))``
q0.<joint> ...        the values of the trial, as `Sweep` takes them
ok, error             whether it ran to its end, and why not; what follows is null then
q.<joint>, u.<joint>  the state at the end
peak_torque.<joint>   the largest size of the controller's torque, at the beginnings of steps
rms_error.<joint>     root mean square over time of desired less actual position
energy_drift          J: what the energy gained beyond the work done on it; the integrator's error
energy_closes         whether the energy balance closed all the time within what the step explains
limit_events, limits  how many limits of joints were passed, and which: '<joint> lower; ...', also
                      upper, velocity, effort; nothing stops at a limit and no torque is clamped
====================  =============================================================================
"""

from kane_dynamics.sweep.description import Sweep
from kane_dynamics.sweep.running import run_sweep, Summary
from kane_dynamics.sweep.table import read_table

__all__ = ['Summary', 'Sweep', 'read_table', 'run_sweep']
