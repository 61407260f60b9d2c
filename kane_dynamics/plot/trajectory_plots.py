"""Plots of motions over time and in the phase plane."""

from collections.abc import Collection, Mapping, Sequence
from itertools import chain, cycle, product
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.plot.style import (above, BLUE, GREY, grid, hide_rounding, INK,
                                      legend_below, LINES, MARGIN, NEAR, NOISE, ORANGE,
                                      panel_unit, Path, plot_lines, RED, SKY, styled,
                                      THIN, time_axis, titled)
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.trajectory import Trajectory
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
import numpy as np

MOST = 9  # joints in one panel
MANIFOLD = 10.0  # from here on, a share of a limit is a multiple
WIDE = 3.4  # line width of the first joint
SLIM = 1.0  # of the last


def plot_trajectory(trajectory: Trajectory, path: Path | None = None, *,
                    prismatic: Collection[str] = (), limits: JointLimits | None = None,
                    title: str = 'Simulated motion') -> Figure:
    """
    Plot positions, speeds, torques and energies of a simulation over time.

    Line widths decrease from joint to joint, so that coinciding lines are all visible.
    More than `MOST` joints have panels side by side, with the same scales.

    Parameters
    ----------
    trajectory : Trajectory
        The motion.
    limits : JointLimits, optional
        `Robot.limits`; speed and torque limits are drawn in the colors of the joints, if
        they are near the values.
    path, prismatic, title
        See `kane_dynamics.plot`.

    """
    quantities = _quantities(trajectory, prismatic)
    most_names = max(len(quantity.names) for quantity in quantities)
    if most_names > MOST:
        return _side_by_side(trajectory, path, quantities, limits, title)

    # Each joint has one color and dash in all panels.
    names: dict[str, None] = {}  # an ordered set
    for quantity in quantities:
        names |= dict.fromkeys(quantity.names)
    looks = cycle(product(('-', '--', ':'), LINES))
    look_of = dict(zip(names, looks))
    color_of = {name: color for name, (_, color) in look_of.items()}
    shown: dict[str, Any] = {}
    with styled(10.0, 9.0, title, path) as figure:
        panels = figure.subplots(4, 1, sharex=True)
        # A panel for each quantity; later lines are slimmer, so that none is hidden.
        for axes, quantity in zip(panels, quantities, strict=False):
            for k, (name, values) in enumerate(quantity.columns.items()):
                dash, color = look_of[name]
                width = WIDE - (WIDE - SLIM) * k / max(len(quantity.names), 2)
                line, = axes.plot(trajectory.t, values, color=color, linestyle=dash,
                                  linewidth=width)
                shown[name] = line
            hide_rounding(axes, quantity.noise, 0.1)
            bounds = quantity.bounds(limits, trajectory.joint_names)
            if bounds is not None:
                _limits(axes, quantity.columns, bounds, color_of)
            axes.set_ylabel(quantity.label)
        # One legend of all panels, with the limits once.
        drawn_lines = chain.from_iterable(axes.lines for axes in panels)
        if any(line.get_label() == 'limit' for line in drawn_lines):
            shown['limit'] = Line2D([], [], color=INK, linestyle='--', linewidth=THIN)
        figure.legend(shown.values(), shown, loc='outside right upper', title='Joint',
                      alignment='left', ncols=1 + len(shown) // 32)
        _energies(panels[3], trajectory)
        time_axis(panels)
    return figure


class _Panel(NamedTuple):
    """A quantity of a motion over time: what it is, values by name, label."""

    what: str
    columns: dict[str, Array]
    label: str

    @property
    def names(self) -> list[str]:
        return list(self.columns)

    @property
    def noise(self) -> float:
        """Return the size of rounding errors beside the largest value, or 1."""
        table = np.array(list(self.columns.values()))
        return NOISE * float(np.abs(table).max(initial=1.0))

    def bounds(self, limits: JointLimits | None,
               joint_names: Sequence[str]) -> dict[str, float] | None:
        """Return the limits by joint, or None; positions have none here."""
        if limits is None or self.what == 'Position':
            return None
        values = limits.velocity if self.what == 'Speed' else limits.effort
        return dict(zip(joint_names, values.tolist()))


def _quantities(trajectory: Trajectory, prismatic: Collection[str]) -> list[_Panel]:
    """Return positions, speeds and torques of a motion."""
    joints = list(trajectory.joint_names)
    speeds = list(trajectory.speed_names)
    if np.shape(trajectory.q)[1] > len(joints):  # quaternions
        joints = list(trajectory.coordinate_names)
    quantities = []
    for what, table, names in (('Position', trajectory.q, joints),
                               ('Speed', trajectory.u, speeds),
                               ('Torque', trajectory.tau, speeds)):
        columns = dict(zip(names, np.asarray(table).T, strict=True))
        label = f'{what}\n[{panel_unit(what, names, prismatic)}]'
        quantities.append(_Panel(what, columns, label))
    return quantities


def _side_by_side(trajectory: Trajectory, path: Path | None,
                  quantities: Sequence[_Panel],
                  limits: JointLimits | None, title: str) -> Figure:
    """Plot many joints in columns of `len(LINES)`, each with its own legend."""
    # As many lines a panel as have colors that differ.
    per_panel = len(LINES)
    columns = -(-max(len(quantity.names) for quantity in quantities) // per_panel)
    with styled(1.0 + 3.6 * columns, 11.0, title, path) as figure:
        panels = figure.subplots(4, columns, sharex=True, sharey='row', squeeze=False)
        legends = []  # the names that panels above have in their legends
        for row, quantity in zip(panels, quantities, strict=False):
            for c, axes in enumerate(row):
                names = quantity.names[c * per_panel:(c + 1) * per_panel]
                values = {name: quantity.columns[name] for name in names}
                colors = dict(zip(names, LINES))
                for name in names:
                    axes.plot(trajectory.t, values[name], color=colors[name], label=name)
                # A legend serves all panels below with the same names.
                if names and names not in legends:
                    legends.append(names)
                    axes.legend(loc='lower left', bbox_to_anchor=(0.0, 1.02),
                                fontsize=8.0, borderaxespad=0.0, ncols=2,
                                handlelength=1.2)
                bounds = quantity.bounds(limits, trajectory.joint_names)
                if bounds is not None:
                    _limits(axes, values, bounds, colors)
            hide_rounding(row[0], quantity.noise, 0.1)
            row[0].set_ylabel(quantity.label)
        for axes in panels[3, 1:]:
            axes.remove()
        _energies(panels[3, 0], trajectory)
        for axes in panels[2, 1:]:
            axes.tick_params(labelbottom=True)
        time_axis([*panels[:3].flat, panels[3, 0]])
    return figure


def _energies(axes: Axes, trajectory: Trajectory) -> None:
    """Plot kinetic, potential and total energy."""
    kinetic, potential = np.asarray(trajectory.energy).T
    plot_lines(axes, trajectory.t, {
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
    # The portrait is of joint rates, whatever the speeds.
    rates = trajectory.u
    if robot.speed_names != robot.joint_names:
        rates = robot.joint_rates(trajectory.q, trajectory.u, t=trajectory.t)
    names = robot.joint_names
    limits = robot.limits
    columns = _phase_columns(len(names))
    rows = -(-len(names) // columns)
    with styled(max(3.0 * columns, 6.0), 1.3 + 2.7 * rows, title, path) as figure:
        panels = grid(figure, len(names), columns, share_x=False)
        for i, (name, axes) in enumerate(zip(names, panels, strict=True)):
            q = trajectory.q[:, i]
            rate = rates[:, i]
            axes.plot(q, rate, color=BLUE, label='motion')
            axes.plot(q[:1], rate[:1], 'o', color=BLUE, markersize=6.0, label='start')
            axes.plot(q[-1:], rate[-1:], 's', color=ORANGE, markersize=6.0, label='end')
            _bounded(axes, 'x', q, limits.lower[i], limits.upper[i])
            _bounded(axes, 'y', rate, -limits.velocity[i], limits.velocity[i])
            axes.set_title(name)
            axes.set_xlabel('Position '
                            f'[{panel_unit("Position", [name], robot.model.sliding)}]')
            axes.set_ylabel('Speed '
                            f'[{panel_unit("Speed", [name], robot.model.sliding)}]')
        legend_below(figure, panels)
    return figure


def _phase_columns(joints: int) -> int:
    """Return the number of columns of panels."""
    if joints == 1:
        return 1
    return 2 if joints < 5 else 4


def _limits(axes: Axes, values: Mapping[str, Array], bounds: Mapping[str, float],
            colors: Mapping[str, str]) -> None:
    """Plot the limits near the values, and write the largest fraction of a limit."""
    # The largest fraction of each finite limit.
    shares = {}
    for name, row in values.items():
        if np.isfinite(bounds.get(name, np.inf)):
            shares[name] = float(np.abs(row).max(initial=0.0)) / bounds[name]
    low, high = axes.get_ylim()
    # A limit is drawn only where the motion comes near it.
    for name, share in shares.items():
        if share <= 1.0 / NEAR:
            continue
        for sign in (-1.0, 1.0):
            if bounds[name] < NEAR * float((sign * values[name]).max()):
                axes.axhline(sign * bounds[name], color=colors[name], linestyle='--',
                             linewidth=THIN, label='limit')
                reach = sign * (1.0 + MARGIN) * bounds[name]
                low = min(low, reach)
                high = max(high, reach)
    axes.set_ylim(low, high)
    # The largest share is written above the panel.
    if shares:
        name = max(shares, key=lambda name: shares[name])
        axes.set_title(f'at most {_share_text(shares[name])} ({name})', loc='right',
                       fontsize=8.0, fontweight='normal', color=colors[name])


def _share_text(share: float) -> str:
    """Return a fraction of a limit as a text."""
    if share < MANIFOLD:
        return f'{100.0 * share:.3g} % of a limit'
    return f'{share:.3g} times a limit'


def _bounded(axes: Axes, along: str, values: Any, lower: float, upper: float) -> None:
    """Set the range of 'x' or 'y' to values and finite limits; shade beyond limits."""
    reach = [bound for bound in (lower, upper) if np.isfinite(bound)]
    reach += [values.min(), values.max()]
    size = max(reach) - min(reach)
    margin = MARGIN * size if size > 1e-9 else 1.0  # ignore rounding errors
    begin = min(reach) - margin
    end = max(reach) + margin
    if along == 'x':
        axes.set_xlim(begin, end)
        draw_line: Any = axes.axvline
        shade: Any = axes.axvspan
    else:
        axes.set_ylim(begin, end)
        draw_line = axes.axhline
        shade = axes.axhspan
    # What lies beyond a limit is shaded, up to the edge of the panel.
    for bound, beyond in ((lower, begin), (upper, end)):
        if np.isfinite(bound):
            draw_line(bound, color=RED, linewidth=THIN, linestyle='--', label='limit')
            shade(bound, beyond, color=GREY, alpha=0.18, linewidth=0.0)
