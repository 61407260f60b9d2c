"""Plots of torques by source, and of measured and computed torques."""

from collections.abc import Collection, Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.plot.style import (beside, BLUE, GREEN, grid, hide_rounding, INK,
                                      legend_below, limit_lines, NOISE, ORANGE,
                                      panel_unit, Path, RED, rms, SKY, styled, THIN,
                                      time_axis, titled, zero_line)
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.trajectory import Trajectory
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

_SOURCES = {'inertia': BLUE, 'Coriolis, centrifugal': ORANGE, 'gravity': '#B9BEC6',
            'friction': RED, 'springs': GREEN}  # in the order of TORQUE_TERMS
LABELS = (*_SOURCES, 'sum', 'limit')


def plot_torque_by_source(robot: Robot, trajectory: Trajectory, path: Path | None = None,
                          *,
                          title: str | None = None) -> Figure:
    """
    Plot the terms of each joint's torque as stacked areas, their sum and limits.

    For the parameters see `kane_dynamics.plot`.
    """
    trajectory.require(robot, 'plot_torque_by_source')
    terms = robot.torque_terms(trajectory.q, trajectory.u, trajectory.udot,
                               t=trajectory.t)
    names = trajectory.speed_names
    # Two columns where many joints would make the picture long.
    columns = 1 if len(names) < 4 else 2
    rows = -(-len(names) // columns)
    title = titled(title, 'torque by source', robot.model.name)
    limits = effort_limits(robot, names)
    largest = float(np.abs(terms).max(initial=0.0))
    with styled(10.0, 1.3 + 2.0 * rows, title, path) as figure:
        panels = grid(figure, len(names), columns, share_x=True)
        for i, (name, axes) in enumerate(zip(names, panels, strict=True)):
            stack(axes, trajectory.t, _without_rounding(terms[:, :, i], largest))
            hide_rounding(axes, NOISE * largest, 0.01 * largest or 1.0)
            limit_lines(axes, terms[:, :, i].sum(axis=1), limits[i])
            axes.set_title(name)
            axes.set_ylabel(f'[{panel_unit("Torque", [name], robot.model.sliding)}]')
        legend_below(figure, panels, LABELS)
        time_axis(panels)
    return figure


def plot_replay(t: Array, measured: Array, computed: Array, joint_names: Sequence[str],
                path: Path | None = None, *, prismatic: Collection[str] = (),
                limits: Array | None = None, before: Array | None = None,
                border: float | None = None,
                title: str = 'Measured and computed torque') -> Figure:
    """
    Plot the measured and the computed torque of each joint, and their difference.

    Parameters
    ----------
    t : (K,) array
        s.
    measured, computed : (K, n) arrays
        N m or N.
    joint_names : sequence of str
        In the order of the columns.
    limits : (n,) array, optional
        Limits of the torques, N m or N; infinite for none.
    before : (K, n) array, optional
        Torques of another model, such as the one before a fit.
    border : float, optional
        Time at which the rows that judge a fit begin, s.
    path, prismatic, title
        See `kane_dynamics.plot`.

    """
    names = list(joint_names)
    largest = float(np.abs(measured).max(initial=0.0))
    with styled(10.0, 1.3 + 1.55 * len(names), title, path) as figure:
        panels = figure.subplots(len(names), 2, sharex=True, squeeze=False)
        for j, (name, row) in enumerate(zip(names, panels, strict=True)):
            # On the left both torques, with the limits that they come near.
            torque_panel, difference_panel = row
            unit = panel_unit('Torque', [name], prismatic)
            torque_panel.plot(t, measured[:, j], color=ORANGE, linewidth=THIN,
                              label='measured')
            torque_panel.plot(t, computed[:, j], color=INK, linewidth=1.0,
                              label='computed')
            if before is not None:
                torque_panel.plot(t, before[:, j], color=SKY, linewidth=THIN,
                                  label='before', zorder=0)
            if border is not None:
                for axes in row:
                    axes.axvline(border, color=INK, linewidth=THIN, linestyle=':')
            hide_rounding(torque_panel, NOISE * largest, 0.01 * largest or 1.0)
            if limits is not None:
                both = np.concatenate([measured[:, j], computed[:, j]])
                limit_lines(torque_panel, both, limits[j])
            torque_panel.set_ylabel(f'{name}\n[{unit}]')
            # On the right what the model leaves unexplained, on a scale of its own.
            difference = measured[:, j] - computed[:, j]
            difference_panel.plot(t, difference, color=SKY, linewidth=THIN)
            hide_rounding(difference_panel, NOISE * largest, 0.01 * largest or 1.0)
            difference_panel.set_ylabel(f'[{unit}]')
            zero_line(difference_panel)
            size = f'{rms(difference):.3g} {unit}'
            beside(difference_panel, ('RMS', INK), (size, INK))
        for axes, text in zip(panels[0], ('Torque',
                                          'Measured less computed'), strict=True):
            axes.set_title(text)
        legend_below(figure, panels[0, :1])
        time_axis(panels)
    return figure


def effort_limits(robot: Robot, speed_names: Sequence[str]) -> list[float]:
    """Return the effort limits of speeds that are joint rates; else infinity."""
    limits = dict(zip(robot.joint_names, robot.limits.effort.tolist()))
    return [limits.get(name, np.inf) for name in speed_names]


def _without_rounding(values: Array, largest: float) -> Array:
    """Return values with 0 for rounding errors, relative to the largest of all."""
    return np.where(np.abs(values) < 1e-12 * largest, 0.0, values)


def stack(axes: Axes, t: Array, terms: Array) -> None:
    """Plot (K, 5) terms as stacked areas: positive parts up, negative ones down."""
    # Twice, so that terms of opposite signs do not hide each other.
    for part_of in (np.maximum, np.minimum):  # the positive, then the negative part
        level = np.zeros(len(t))
        for (label, color), term in zip(_SOURCES.items(), terms.T, strict=True):
            next_level = level + part_of(term, 0.0)
            if term.any():
                axes.fill_between(t, level, next_level, color=color, alpha=0.85,
                                  linewidth=0.0, label=label)
            level = next_level
    axes.plot(t, terms.sum(axis=1), color=INK, linewidth=1.3, label='sum')
    axes.axhline(0.0, color=INK, linewidth=0.6)
