"""
Parameter sweeps: many simulations of one robot; needs `pip install 'kane_dynamics[sweep]'`.

The result is a table with one row per trial, in rad or m, s, and N m or N:

====================  =================================================================
index, seed           determine the trial: ``SeedSequence(seed, spawn_key=(index,))``
q0.<joint> ...        values of the trial, named as the parameters of `Sweep`
ok, error             whether the trial completed, and why not; the rest is null then
q.<joint>, u.<joint>  final state; with chosen speeds or constraints u.<independent
                      speed>
peak_torque.<joint>   largest absolute torque of the controller, at the beginnings of
                      steps; of independent speeds the generalized force
rms_error.<joint>     root mean square of the tracking error over time, of the joints
                      that follow
energy_drift          J: change of energy minus the work done; the error of the
                      integrator
energy_closes         whether the energy balance closed throughout within the error of
                      the step
limit_events, limits  number of exceeded joint limits, and which: '<joint> lower; ...',
                      also upper, velocity, effort; limits do not stop joints or clamp
                      torques
====================  =================================================================
"""

from kane_dynamics.sweep.description import Sweep
from kane_dynamics.sweep.running import run_sweep, Summary
from kane_dynamics.sweep.table import read_table

__all__ = ['Summary', 'Sweep', 'read_table', 'run_sweep']
