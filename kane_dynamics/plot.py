"""
Pictures of trajectories, tracking and torques, in one style.

Figures are made without pyplot: no window opens, no backend is chosen, and the style ends with
the call. Each function returns its figure and, given a path, saves it (png, pdf, svg, ...).
"""

from collections.abc import Collection, Mapping, Sequence
from itertools import chain, cycle
import os
from typing import Any, TYPE_CHECKING

from kane_dynamics.model import Array
import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

if TYPE_CHECKING:  # a trajectory draws itself with this module
    from kane_dynamics.feasibility import Demand
    from kane_dynamics.trajectory import Trajectory

# Okabe & Ito's palette, which all kinds of colour vision tell apart, without its pale yellow.
BLUE, ORANGE, GREEN, RED = '#0072B2', '#E69F00', '#009E73', '#D55E00'
PINK, SKY, GREY, INK = '#CC79A7', '#56B4E9', '#8A8F98', '#22262B'
_LINES = (BLUE, ORANGE, GREEN, RED, PINK, SKY, GREY)
_SOURCES = {'inertia': BLUE, 'Coriolis, centrifugal': ORANGE, 'gravity': '#B9BEC6',
            'friction': RED, 'springs': GREEN}
_RUNS = (RED, BLUE, GREEN, PINK)
_STYLE: Any = {
    'font.family': 'sans-serif', 'font.size': 10.0, 'text.color': INK, 'figure.dpi': 100.0,
    'figure.facecolor': 'white', 'savefig.dpi': 150.0, 'axes.edgecolor': '#C4C8CE',
    'axes.labelcolor': INK, 'axes.labelsize': 10.0, 'axes.titlesize': 11.0,
    'axes.titleweight': 'bold', 'axes.titlelocation': 'left', 'axes.titlecolor': INK,
    'axes.spines.top': False, 'axes.spines.right': False, 'axes.grid': True,
    'axes.axisbelow': True, 'axes.formatter.limits': (-3, 4), 'axes.xmargin': 0.0,
    'grid.color': '#E6E8EB', 'grid.linewidth': 0.8, 'xtick.color': '#5A6068',
    'ytick.color': '#5A6068', 'xtick.labelsize': 9.0, 'ytick.labelsize': 9.0,
    'lines.linewidth': 1.6, 'lines.solid_capstyle': 'round', 'legend.frameon': False,
    'legend.fontsize': 10.0, 'legend.handlelength': 1.6, 'path.simplify': True,
}

Path = str | os.PathLike[str]
Run = tuple[Array, Array, Array]


def plot_trajectory(trajectory: 'Trajectory', path: Path | None = None, *,
                    prismatic: Collection[str] = (), title: str = 'Simulated motion') -> Figure:
    """
    Draw positions, speeds, torques and energies of a simulation over time.

    Parameters
    ----------
    trajectory : Trajectory
        What to draw.
    path : str or Path, optional
        File to write; its suffix is the format.
    prismatic : collection of str
        Names of the joints that slide, whose units are m and N.
    title : str
        Above the picture.

    """
    joints, speeds = list(trajectory.joint_names), list(trajectory.speed_names)
    lines = dict(zip(dict.fromkeys([*joints, *speeds]), cycle(
        (color, dash) for dash in ('-', '--', ':') for color in _LINES)))
    shown: dict[str, Any] = {}
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(10.0, 9.0), layout='constrained')
        panels = figure.subplots(4, 1, sharex=True)
        for axes, rows, what, names in zip(
                panels, (trajectory.q, trajectory.u, trajectory.tau),
                ('Position', 'Speed', 'Torque'), (joints, speeds, speeds), strict=False):
            for name, row in zip(names, np.asarray(rows).T, strict=True):
                color, dash = lines[name]
                shown[name], = axes.plot(trajectory.t, row, color=color, linestyle=dash)
            axes.set_ylabel(f'{what}\n[{_unit(what, names, prismatic)}]')
        figure.legend(shown.values(), shown, loc='outside right upper', title='Joint',
                      alignment='left', ncols=1 + len(shown) // 32)
        kinetic, potential = np.asarray(trajectory.energy).T
        for label, energy, color, dash in (('kinetic', kinetic, ORANGE, '-'),
                                           ('potential', potential, SKY, '-'),
                                           ('total', kinetic + potential, INK, '--')):
            panels[3].plot(trajectory.t, energy, color=color, linestyle=dash, label=label)
        panels[3].set_ylabel('Energy\n[J]')
        panels[3].legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0,
                         ncols=3)
        return _finish(figure, panels, title, path)


def plot_tracking(runs: Mapping[str, Run], joint_names: Sequence[str],
                  path: Path | None = None, *,
                  sources: tuple[Array, Array] | None = None, prismatic: Collection[str] = (),
                  title: str = 'Tracking of the desired motion') -> Figure:
    """
    Draw desired against actual positions and the errors of one or more runs, joint by joint.

    Parameters
    ----------
    runs : mapping of str to (t, desired, actual)
        By label, for example 'PD only' and 'PD + feedforward': (K,) s, (K, n) and (K, n) rad or m.
    joint_names : sequence of str
        In the order of the columns.
    path : str or Path, optional
        File to write; its suffix is the format.
    sources : (t, terms), optional
        Adds the torques by source as a third column: see `plot_torque_sources`.
    prismatic : collection of str
        Names of the joints that slide, whose units are m and N.
    title : str
        Above the picture.

    """
    names = list(joint_names)
    columns = 2 if sources is None else 3
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(5.2 * columns, 1.3 + 1.55 * len(names)), layout='constrained')
        panels = figure.subplots(len(names), columns, sharex='col', squeeze=False)
        for i, name in enumerate(names):
            position, error = panels[i, :2]
            milli = 'mm' if name in prismatic else 'mrad'
            error.text(1.02, 0.98, 'RMS', transform=error.transAxes, va='top', fontsize=9.0)
            for k, (label, (t, desired, actual)) in enumerate(runs.items()):
                color = _RUNS[k % len(_RUNS)]
                e = 1e3 * (np.asarray(actual)[:, i] - np.asarray(desired)[:, i])
                position.plot(t, np.asarray(actual)[:, i], color=color, label=label)
                error.plot(t, e, color=color)
                error.text(1.02, 0.80 - 0.18 * k, f'{np.sqrt(np.mean(e * e)):.3g} {milli}',
                           transform=error.transAxes, va='top', fontsize=9.0, color=color,
                           fontweight='bold')
            t, desired, _ = next(iter(runs.values()))
            position.plot(t, np.asarray(desired)[:, i], color=INK, linestyle=(0, (4, 3)),
                          linewidth=1.2, label='desired')
            position.set_ylabel(f'{name}\n[{_unit("Position", [name], prismatic)}]')
            error.set_ylabel(f'[{milli}]')
            error.axhline(0.0, color=GREY, linewidth=0.8, zorder=0.5)
            if sources is not None:
                _stack(panels[i, 2], sources[0], np.asarray(sources[1])[:, :, i])
                panels[i, 2].set_ylabel(f'[{_unit("Torque", [name], prismatic)}]')
        for axes, text in zip(panels[0], ('Position', 'Error', 'Torque by source'),
                              strict=False):
            axes.set_title(text)
        _legend(figure, chain(panels[0, :1], panels[:, 2] if columns == 3 else ()))
        return _finish(figure, panels, title, path)


def plot_torque_sources(t: Array, terms: Array, joint_names: Sequence[str],
                        path: Path | None = None, *, prismatic: Collection[str] = (),
                        title: str = 'Torque by source') -> Figure:
    """
    Draw what each joint's torque is made of as areas stacked away from zero, and their sum.

    Parameters
    ----------
    t : (K,) array
        s.
    terms : (K, 5, n) array
        `Robot.torque_terms` at each time, N m or N.
    joint_names : sequence of str
        In the order of the columns.
    path : str or Path, optional
        File to write; its suffix is the format.
    prismatic : collection of str
        Names of the joints that slide, whose unit is N.
    title : str
        Above the picture.

    """
    names = list(joint_names)
    columns = 1 if len(names) < 4 else 2
    rows = -(-len(names) // columns)
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(10.0, 1.3 + 2.0 * rows), layout='constrained')
        panels = figure.subplots(rows, columns, sharex=True, squeeze=False)
        for i, (name, axes) in enumerate(zip(names, panels.T.flat, strict=False)):
            _stack(axes, t, np.asarray(terms)[:, :, i])
            axes.set_title(name)
            axes.set_ylabel(f'[{_unit("Torque", [name], prismatic)}]')
        if len(names) < panels.size:
            panels[-1, -1].remove()
            panels[-2, -1].tick_params(labelbottom=True)
        _legend(figure, panels.flat)
        return _finish(figure, panels, title, path)


def plot_replay(t: Array, measured: Array, computed: Array, joint_names: Sequence[str],
                path: Path | None = None, *, prismatic: Collection[str] = (),
                title: str = 'Measured and computed torque') -> Figure:
    """
    Draw each joint's measured torque, the one computed for the same motion, and the difference.

    Parameters
    ----------
    t : (K,) array
        s.
    measured, computed : (K, n) arrays
        N m or N.
    joint_names : sequence of str
        In the order of the columns.
    path : str or Path, optional
        File to write; its suffix is the format.
    prismatic : collection of str
        Names of the joints that slide, whose unit is N.
    title : str
        Above the picture.

    """
    names = list(joint_names)
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(10.0, 1.3 + 1.55 * len(names)), layout='constrained')
        panels = figure.subplots(len(names), 2, sharex=True, squeeze=False)
        for name, (whole, rest), a, b in zip(names, panels, measured.T, computed.T, strict=True):
            whole.plot(t, a, color=ORANGE, linewidth=0.8, label='measured')
            whole.plot(t, b, color=INK, linewidth=1.0, label='computed')
            whole.set_ylabel(f'{name}\n[{_unit("Torque", [name], prismatic)}]')
            rest.plot(t, a - b, color=SKY, linewidth=0.8)
            rest.axhline(0.0, color=GREY, linewidth=0.8, zorder=0.5)
            rest.text(1.02, 0.8, f'RMS {np.sqrt(np.mean((a - b) ** 2)):.3g}',
                      transform=rest.transAxes, va='top', fontsize=9.0)
        for axes, text in zip(panels[0], ('Torque', 'Measured less computed'), strict=True):
            axes.set_title(text)
        _legend(figure, panels[0, :1])
        return _finish(figure, panels, title, path)


def plot_demand(asked: 'Demand', path: Path | None = None, *, prismatic: Collection[str] = (),
                title: str = 'Torque, speed and power against the limits') -> Figure:
    """
    Draw what a motion asks of each joint's motor, its limits as dashed lines.

    Parameters
    ----------
    asked : Demand
        What to draw.
    path : str or Path, optional
        File to write; its suffix is the format.
    prismatic : collection of str
        Names of the joints that slide, whose units are m and N.
    title : str
        Above the picture.

    """
    names = list(asked.joint_names)
    columns = (('Torque', asked.tau, asked.limits.effort),
               ('Speed', asked.u, asked.limits.velocity),
               ('Power', asked.power, asked.power_limit))
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(12.0, 1.3 + 1.55 * len(names)), layout='constrained')
        panels = figure.subplots(len(names), 3, sharex=True, squeeze=False)
        for row, j in zip(panels, range(len(names)), strict=True):
            for axes, (what, values, bound) in zip(row, columns, strict=True):
                axes.plot(asked.t, values[:, j], color=BLUE)
                axes.set_ylabel(f'[{_unit(what, names[j:j + 1], prismatic)}]')
                for sign in (-1.0, 1.0) if np.isfinite(bound[j]) else ():
                    axes.axhline(sign * bound[j], color=RED, linestyle='--', linewidth=1.0)
            row[0].set_ylabel(f'{names[j]}\n{row[0].get_ylabel()}')
        for axes, (what, _, _) in zip(panels[0], columns, strict=True):
            axes.set_title(what)
        return _finish(figure, panels, title, path)


def _stack(axes: Axes, t: Array, terms: Array) -> None:
    """Draw (K, 5) terms: the positive parts stacked up from zero, the negative ones down."""
    for sign in (np.maximum, np.minimum):
        level = np.zeros(len(t))
        for (label, color), row in zip(_SOURCES.items(), terms.T, strict=True):
            top = level + sign(row, 0.0)
            if row.any():
                axes.fill_between(t, level, top, color=color, alpha=0.85, linewidth=0.0,
                                  label=label)
            level = top
    axes.plot(t, terms.sum(axis=1), color=INK, linewidth=1.3, label='sum')
    axes.axhline(0.0, color=INK, linewidth=0.6)


def _legend(figure: Figure, panels: Any) -> None:
    """Put one legend of everything that the panels show below them."""
    shown: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            shown.setdefault(label, handle)
    last = [*_SOURCES, 'sum']  # after whatever else there is, in this order
    order = sorted(shown, key=lambda label: last.index(label) if label in last else -1)
    figure.legend([shown[label] for label in order], order, loc='outside lower center',
                  ncols=min(len(order), 5 if figure.get_figwidth() < 12.0 else 9),
                  columnspacing=1.6)


def _unit(what: str, names: Sequence[str], prismatic: Collection[str]) -> str:
    """Return the unit of a panel, of both kinds of joint if it shows both."""
    turning, sliding = {'Position': ('rad', 'm'), 'Speed': ('rad/s', 'm/s'),
                        'Torque': ('N m', 'N'), 'Power': ('W', 'W')}[what]
    slides = [name in prismatic for name in names]
    return sliding if all(slides) else f'{turning}, {sliding}' if any(slides) else turning


def _finish(figure: Figure, panels: Any, title: str, path: Path | None) -> Figure:
    """Label the time axes, title the figure, and save it if there is a path."""
    for column in np.asarray(panels).reshape(len(panels), -1).T:
        [axes for axes in column if axes.figure is not None][-1].set_xlabel('Time [s]')
    figure.suptitle(title, x=0.01, ha='left', fontsize=14.0, fontweight='bold')
    figure.align_ylabels()
    if path is not None:
        figure.savefig(path)
    return figure
