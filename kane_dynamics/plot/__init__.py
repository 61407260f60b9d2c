"""
Pictures of motions, bending, tracking, torques, energies and reactions, in one style.

Figures are created without pyplot: no window opens, no backend is selected, and the
style is restored after the call. Each function returns its figure and, given a path,
saves it. Parameters that several functions have:

robot, trajectory : Robot, Trajectory
    The robot, and a single motion of it; InputError if the trajectory holds several
    motions or other joints.
path : str or Path, optional
    File to write; its suffix is the format.
prismatic : collection of str
    Names of the prismatic joints (units m and N).
title : str, optional
    Title of the picture; by default, where there is a robot, with its name.
"""

from kane_dynamics.plot.bending_plots import plot_bending, plot_vibrations
from kane_dynamics.plot.demand_plot import plot_demand
from kane_dynamics.plot.energy_plots import plot_energy
from kane_dynamics.plot.reaction_plot import plot_reactions
from kane_dynamics.plot.style import check_path
from kane_dynamics.plot.sweep_plot import plot_sweep
from kane_dynamics.plot.timing_plot import plot_timing
from kane_dynamics.plot.torque_plots import plot_replay, plot_torque_by_source
from kane_dynamics.plot.tracking_plot import plot_tracking
from kane_dynamics.plot.trajectory_plots import plot_phase, plot_trajectory

__all__ = ['check_path', 'plot_bending', 'plot_demand', 'plot_energy', 'plot_phase',
           'plot_reactions',
           'plot_replay', 'plot_sweep', 'plot_timing', 'plot_torque_by_source',
           'plot_tracking', 'plot_trajectory', 'plot_vibrations']
