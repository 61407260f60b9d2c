"""
Pictures of motions, bending, tracking, torques, energies and reactions, in one style.

Figures are made without pyplot: no window opens, no backend is chosen, and the style ends with
the call. Each function returns its figure and, given a path, saves it (png, pdf, svg, ...).
"""

from kane_dynamics.plot.bending import plot_bending, plot_vibrations
from kane_dynamics.plot.demand import plot_demand
from kane_dynamics.plot.energy import plot_energy
from kane_dynamics.plot.motion import plot_phase, plot_trajectory
from kane_dynamics.plot.reactions import plot_reactions
from kane_dynamics.plot.style import check_path
from kane_dynamics.plot.torques import plot_replay, plot_torque_by_source
from kane_dynamics.plot.tracking import plot_tracking

__all__ = ['check_path', 'plot_bending', 'plot_demand', 'plot_energy', 'plot_phase',
           'plot_reactions', 'plot_replay', 'plot_torque_by_source', 'plot_tracking',
           'plot_trajectory', 'plot_vibrations']
