"""Plots of motions over time and in the phase plane."""

from collections.abc import Collection, Mapping, Sequence
from itertools import cycle
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.plot.style import (above, BLUE, draw, GREY, grid, hide_rounding, INK,
                                      legend_below, LINES, MARGIN, NEAR, NOISE, ORANGE, Path, RED,
                                      SKY, styled, THIN, time_axis, titled, unit)
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.trajectory import Trajectory
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
import numpy as np

MOST = 9  # joints in one panel
MANIFOLD = 10.0  # from here on, a share of a limit is a multiple
WIDE, SLIM = 3.4, 1.0  # line widths, from the first joint to the last


def plot_trajectory(trajectory: Trajectory, path: Path | None = None, *,
                    prismatic: Collection[str] = (), limits: JointLimits | None = None,
                    title: str = 'Simulated motion') -> Figure:
    """
    Plot positions, speeds, torques and energies of a simulation over time.

    Line widths decrease from joint to joint, so that coinciding lines are all visible. More than
    `MOST` joints have panels side by side, with the same scales.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    limits : JointLimits, optional
        `Robot.limits`; speed and torque limits are drawn in the colors of the joints, if they are
        near the values.
    path, prismatic, title
        See `kane_dynamics.plot`.

    """
    joints, speeds = list(trajectory.joint_names), list(trajectory.speed_names)
    if np.shape(trajectory.q)[1] > len(joints):  # quaternions
        joints = list(trajectory.coordinate_names)
    if max(len(joints), len(speeds)) > MOST:
        return _side_by_side(trajectory, path, joints, speeds, prismatic, limits, title)
    lines = dict(zip(dict.fromkeys([*joints, *speeds]), cycle(
        (color, dash) for dash in ('-', '--', ':') for color in LINES)))
    shown: dict[str, Any] = {}
    with styled(10.0, 9.0, title, path) as figure:
        panels = figure.subplots(4, 1, sharex=True)
        for axes, rows, what, names in zip(
                panels, (trajectory.q, trajectory.u, trajectory.tau),
                ('Position', 'Speed', 'Torque'), (joints, speeds, speeds), strict=False):
            for k, (name, row) in enumerate(zip(names, np.asarray(rows).T, strict=True)):
                color, dash = lines[name]
                shown[name], = axes.plot(trajectory.t, row, color=color, linestyle=dash,
                                         linewidth=WIDE - (WIDE - SLIM) * k / max(len(names), 2))
            hide_rounding(axes, NOISE * float(np.abs(rows).max(initial=1.0)), 0.1)
            if limits is not None and what != 'Position':
                bounds = (limits.velocity if what == 'Speed' else limits.effort).tolist()
                _limits(axes, dict(zip(names, np.asarray(rows).T)),
                        dict(zip(trajectory.joint_names, bounds)),
                        {name: color for name, (color, _) in lines.items()})
            axes.set_ylabel(f'{what}\n[{unit(what, names, prismatic)}]')
        if any(line.get_label() == 'limit' for axes in panels for line in axes.lines):
            shown['limit'] = Line2D([], [], color=INK, linestyle='--', linewidth=THIN)
        figure.legend(shown.values(), shown, loc='outside right upper', title='Joint',
                      alignment='left', ncols=1 + len(shown) // 32)
        _energies(panels[3], trajectory)
        time_axis(panels)
    return figure


def _side_by_side(trajectory: Trajectory, path: Path | None, joints: Sequence[str],
                  speeds: Sequence[str], prismatic: Collection[str],
                  limits: JointLimits | None, title: str) -> Figure:
    """Plot many joints in columns of `len(LINES)`, each with its own legend."""
    each = len(LINES)
    columns = -(-max(len(joints), len(speeds)) // each)
    bounds = {} if limits is None else {
        'Speed': dict(zip(trajectory.joint_names, limits.velocity.tolist())),
        'Torque': dict(zip(trajectory.joint_names, limits.effort.tolist()))}
    with styled(1.0 + 3.6 * columns, 11.0, title, path) as figure:
        panels = figure.subplots(4, columns, sharex=True, sharey='row', squeeze=False)
        shown = []
        for of, values, what, names in zip(
                panels, (trajectory.q, trajectory.u, trajectory.tau),
                ('Position', 'Speed', 'Torque'), (joints, speeds, speeds), strict=False):
            hide_rounding_of = NOISE * float(np.abs(values).max(initial=1.0))
            for c, axes in enumerate(of):
                part = slice(c * each, (c + 1) * each)
                rows = dict(zip(names[part], np.asarray(values).T[part], strict=True))
                colors = dict(zip(rows, LINES))
                for name, row in rows.items():
                    axes.plot(trajectory.t, row, color=colors[name], label=name)
                if rows and (what == 'Position' or (what == 'Speed' and speeds != joints)):
                    axes.legend(loc='lower left', bbox_to_anchor=(0.0, 1.02), fontsize=8.0,
                                borderaxespad=0.0, ncols=2, handlelength=1.2)
                if what in bounds:
                    _limits(axes, rows, bounds[what], colors)
                shown.append(axes)
            hide_rounding(of[0], hide_rounding_of, 0.1)
            of[0].set_ylabel(f'{what}\n[{unit(what, names, prismatic)}]')
        for axes in panels[3, 1:]:
            axes.remove()
        _energies(panels[3, 0], trajectory)
        for axes in panels[2, 1:]:
            axes.tick_params(labelbottom=True)
        time_axis([*shown, panels[3, 0]])
    return figure


def _energies(axes: Axes, trajectory: Trajectory) -> None:
    """Plot kinetic, potential and total energy."""
    kinetic, potential = np.asarray(trajectory.energy).T
    draw(axes, trajectory.t, {
        'kinetic': (kinetic, ORANGE, '-'), 'potential': (potential, SKY, '-'),
        'total': (kinetic + potential, INK, '--')})
    axes.set_ylabel('Energy\n[J]')
    above(axes, 3)


def plot_phase(robot: Robot, trajectory: Trajectory, path: Path | None = None, *,
               title: str | None = None) -> Figure:
    """
    Plot the speed of each joint over its position, with the limits of both.

    For the parameters see `kane_dynamics.plot`.
    """
    require_angles(robot.model, 'plot_phase')
    trajectory.require(robot, 'plot_phase')
    title = titled(title, 'phase portrait', robot.model.name)
    rates = trajectory.u if robot.speed_names == robot.joint_names else robot.joint_rates(
        trajectory.q, trajectory.u, t=trajectory.t)
    names, limits = robot.joint_names, robot.limits
    columns = min(len(names), 1 if len(names) == 1 else 2 if len(names) < 5 else 4)
    with styled(max(3.0 * columns, 6.0), 1.3 + 2.7 * -(-len(names) // columns), title, path
                ) as figure:
        panels = grid(figure, len(names), columns, share_x=False)
        for i, (name, axes) in enumerate(zip(names, panels, strict=True)):
            q, u = trajectory.q[:, i], rates[:, i]
            axes.plot(q, u, color=BLUE, label='motion')
            axes.plot(q[:1], u[:1], 'o', color=BLUE, markersize=6.0, label='start')
            axes.plot(q[-1:], u[-1:], 's', color=ORANGE, markersize=6.0, label='end')
            _bounded(axes, 'x', q, limits.lower[i], limits.upper[i])
            _bounded(axes, 'y', u, -limits.velocity[i], limits.velocity[i])
            axes.set_title(name)
            axes.set_xlabel(f'Position [{unit("Position", [name], robot.model.sliding)}]')
            axes.set_ylabel(f'Speed [{unit("Speed", [name], robot.model.sliding)}]')
        legend_below(figure, panels)
    return figure


def _limits(axes: Axes, rows: Mapping[str, Array], bounds: Mapping[str, float],
            colors: Mapping[str, str]) -> None:
    """Plot the limits near the values, and write the largest fraction of a limit."""
    shares = {name: float(np.abs(row).max(initial=0.0)) / bounds[name]
              for name, row in rows.items() if np.isfinite(bounds.get(name, np.inf))}
    low, high = axes.get_ylim()
    reach = [low, high]
    for name, share in shares.items():
        for sign in (-1.0, 1.0):
            if share > 1.0 / NEAR and bounds[name] < NEAR * float((sign * rows[name]).max()):
                axes.axhline(sign * bounds[name], color=colors[name], linestyle='--',
                             linewidth=THIN, label='limit')
                reach.append(sign * (1.0 + MARGIN) * bounds[name])
    axes.set_ylim(min(reach), max(reach))
    if shares:
        most = max(shares, key=lambda name: shares[name])
        share = shares[most]
        reached = f'{100.0 * share:.3g} %' if share < MANIFOLD else f'{share:.3g} times'
        of = 'of a limit' if share < MANIFOLD else 'a limit'
        axes.set_title(f'at most {reached} {of} ({most})', loc='right',
                       fontsize=8.0, fontweight='normal', color=colors[most])


def _bounded(axes: Axes, along: str, values: Any, lower: float, upper: float) -> None:
    """Set the range of 'x' or 'y' to the values and finite limits; shade beyond limits."""
    bounds = [bound for bound in (lower, upper) if np.isfinite(bound)]
    reach = [*bounds, values.min(), values.max()]
    span = max(reach) - min(reach)
    margin = MARGIN * span if span > 1e-9 else 1.0  # ignore rounding errors
    ends = (min(reach) - margin, max(reach) + margin)
    (axes.set_xlim if along == 'x' else axes.set_ylim)(*ends)
    line, span = (axes.axvline, axes.axvspan) if along == 'x' else (axes.axhline, axes.axhspan)
    for bound in bounds:
        line(bound, color=RED, linewidth=THIN, linestyle='--', label='limit')
        span(bound, ends[0] if bound == lower else ends[1], color=GREY, alpha=0.18, linewidth=0.0)
