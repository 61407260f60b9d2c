"""Plot of tracking errors."""

from collections.abc import Collection, Mapping, Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.plot.style import (beside, BLUE, GREEN, hide_rounding, INK,
                                      legend_below, NOISE, panel_unit, Path, PINK, RED,
                                      rms, styled, time_axis, zero_line)
from kane_dynamics.plot.torque_plots import LABELS, stack
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

_RUNS = (RED, BLUE, GREEN, PINK)
Run = tuple[Array, Array, Array]


def plot_tracking(runs: Mapping[str, Run], joint_names: Sequence[str],
                  path: Path | None = None, *,
                  sources: tuple[Array, Array] | None = None,
                  prismatic: Collection[str] = (),
                  title: str = 'Tracking of the desired motion') -> Figure:
    """
    Plot desired and actual positions and tracking errors of some runs, by joint.

    Parameters
    ----------
    runs : mapping of str to (t, desired, actual)
        By label, for example 'PD only' and 'PD + feedforward': (K,) s, (K, n) and (K, n)
        rad or m.
    joint_names : sequence of str
        Names, in the order of the columns.
    sources : (t, terms), optional
        Adds the torques by source as a third column: (K,) s and `Robot.torque_terms`,
        (K, 5, n).
    path, prismatic, title
        See `kane_dynamics.plot`.

    """
    names = list(joint_names)
    # A column more if the torques by source are known.
    headings = ['Position', 'Error']
    if sources is not None:
        headings.append('Torque by source')
    columns = len(headings)
    with styled(5.2 * columns, 1.3 + 1.55 * len(names), title, path) as figure:
        panels = figure.subplots(len(names), columns, sharex='col', squeeze=False)
        # A row of panels for each joint.
        for i, (name, row) in enumerate(zip(names, panels, strict=True)):
            _plot_positions(row[0], runs, i)
            row[0].set_ylabel(f'{name}\n[{panel_unit("Position", [name], prismatic)}]')
            unit = 'mm' if name in prismatic else 'mrad'
            _plot_errors(row[1], runs, i, unit)
            row[1].set_ylabel(f'[{unit}]')
            if sources is not None:
                t, terms = sources
                stack(row[2], t, np.asarray(terms)[:, :, i])
                row[2].set_ylabel(f'[{panel_unit("Torque", [name], prismatic)}]')
        for axes, text in zip(panels[0], headings, strict=True):
            axes.set_title(text)
        described = [panels[0, 0]]
        if sources is not None:
            described += list(panels[:, 2])
        legend_below(figure, described, LABELS)
        time_axis(panels)
    return figure


def _plot_positions(axes: Axes, runs: Mapping[str, Run], i: int) -> None:
    """Plot the positions of joint i in all runs, and the desired one."""
    for k, (label, (t, _, actual)) in enumerate(runs.items()):
        axes.plot(t, np.asarray(actual)[:, i], color=_RUNS[k % len(_RUNS)], label=label)
    t, desired, _ = next(iter(runs.values()))
    axes.plot(t, np.asarray(desired)[:, i], color=INK, linestyle=(0, (4, 3)),
              linewidth=1.2, label='desired')
    hide_rounding(axes, NOISE, 0.1)


def _plot_errors(axes: Axes, runs: Mapping[str, Run], i: int, unit: str) -> None:
    """Plot the tracking errors of joint i in thousandths, with their RMS."""
    notes = [('RMS', INK)]
    for k, (t, desired, actual) in enumerate(runs.values()):
        color = _RUNS[k % len(_RUNS)]
        error = 1e3 * (np.asarray(actual)[:, i] - np.asarray(desired)[:, i])
        axes.plot(t, error, color=color)
        size = rms(error)
        if size <= 1e3 * NOISE:
            size = 0.0
        notes.append((f'{size:.3g} {unit}', color))
    beside(axes, *notes)
    hide_rounding(axes, 1e3 * NOISE, 1e-3)
    zero_line(axes)
