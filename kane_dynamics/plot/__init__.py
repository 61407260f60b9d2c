"""
Pictures of motions, bending, tracking, torques, energies and reactions, in one style.

Figures are created without pyplot: no window opens, no backend is selected, and the style is
restored after the call. Each function returns its figure and, given a path, saves it.
"""

from kane_dynamics.plot.bending_plots import plot_bending, plot_vibrations
from kane_dynamics.plot.demand_plot import plot_demand
from kane_dynamics.plot.energy_plots import plot_energy
from kane_dynamics.plot.reaction_plot import plot_reactions
from kane_dynamics.plot.style import check_path
from kane_dynamics.plot.torque_plots import plot_replay, plot_torque_by_source
from kane_dynamics.plot.tracking_plot import plot_tracking
from kane_dynamics.plot.trajectory_plots import plot_phase, plot_trajectory

__all__ = ['check_path', 'plot_bending', 'plot_demand', 'plot_energy', 'plot_phase',
           'plot_reactions', 'plot_replay', 'plot_torque_by_source', 'plot_tracking',
           'plot_trajectory', 'plot_vibrations']
