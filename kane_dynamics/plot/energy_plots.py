"""Plot of energies, powers and their balance."""

import copy

from kane_dynamics._util.typing import Array
from kane_dynamics.analysis.power_balance import power_balance, unaccounted_energy
from kane_dynamics.plot.style import (above, BLUE, GREEN, INK, ORANGE, Path, plot_lines,
                                      RED, show_at_least, SKY, styled, time_axis, titled,
                                      zero_line)
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.trajectory import Trajectory
from matplotlib.figure import Figure
import numpy as np


def plot_energy(robot: Robot, trajectory: Trajectory, path: Path | None = None, *,
                title: str | None = None) -> Figure:
    """
    Plot energies, powers of motors and friction, and the errors of both balances.

    The residual of power verifies the equations: it compares the power of the torques
    with the rate of the energies (`power_balance`). The unaccounted energy verifies the
    motion: it is the change of energy minus the integral of power, which is the error of
    integration and sampling (`unaccounted_energy`); it jumps where torques jump between
    two samples.

    Parameters
    ----------
    robot : Robot
        Its speeds are joint rates, and its constraints do not depend on time.
    trajectory, path, title
        See `kane_dynamics.plot`.

    Raises
    ------
    InputError
        Also if the robot is unsupported.

    """
    trajectory.require(robot, 'plot_energy')
    title = titled(title, 'energy and power', robot.model.name)
    t = trajectory.t
    # Strain energy is a part of the potential energy, shown by itself.
    kinetic = trajectory.energy[:, 0]
    total = trajectory.energy.sum(axis=1)
    strain = strain_energy(robot, trajectory.q)
    power = power_balance(robot, trajectory.q, trajectory.u, trajectory.udot, t=t)
    # Two checks: the power of each instant, and the energy over time.
    supplied = power.joints + power.constraints - power.friction
    unaccounted = unaccounted_energy(t, total, supplied)

    # Only what the robot has gets a line.
    energies = {'kinetic': (kinetic, ORANGE, '-'),
                'gravity': (trajectory.energy[:, 1] - strain, SKY, '-')}
    if strain.any():
        energies['springs'] = (strain, GREEN, '-')
    energies['total'] = (total, INK, '--')
    powers = {'motors': (power.joints, BLUE, '-'),
              'friction': (-power.friction, RED, '-'),
              'rate of energy': (power.energy_rate, INK, '--')}
    if np.any(power.constraints):
        powers['prescribed motion'] = (power.constraints, GREEN, '-')
    largest_residual = f'largest {np.abs(power.residual).max():.2g} W'
    largest_unaccounted = f'largest {np.abs(unaccounted).max():.2g} J'
    with styled(10.0, 9.0, title, path) as figure:
        panels = figure.subplots(4, 1, sharex=True, height_ratios=(3, 3, 1.4, 1.4))
        plot_lines(panels[0], t, energies)
        plot_lines(panels[1], t, powers)
        plot_lines(panels[2], t, {largest_residual: (power.residual, INK, '-')})
        plot_lines(panels[3], t, {largest_unaccounted: (unaccounted, INK, '-')})
        labels = ('Energy\n[J]', 'Power\n[W]', 'Residual\n[W]', 'Unaccounted\n[J]')
        for axes, text in zip(panels, labels, strict=True):
            axes.set_ylabel(text)
            above(axes, 4)
        for axes in panels[1:]:
            zero_line(axes)
        # Powers that are small beside the mean rate of kinetic energy are rounding.
        duration = max(np.ptp(t), np.finfo(float).tiny)
        show_at_least(panels[1], 1e-3 * np.ptp(kinetic) / duration)
        time_axis(panels)
    return figure


def strain_energy(robot: Robot, q: Array) -> Array:
    """Return the energy of springs and bent beams, (K,), J."""
    weightless = copy.copy(robot)  # copies the parameters
    weightless.parameters.gravity = np.zeros(3)
    energy: Array = weightless.potential_energy(q)
    return energy
