"""Plot of tracking errors."""

from collections.abc import Collection, Mapping, Sequence
from itertools import chain

from kane_dynamics._util.typing import Array
from kane_dynamics.plot.style import (beside, BLUE, GREEN, hide_rounding, INK, legend_below, NOISE,
                                      Path, PINK, RED, rms, styled, time_axis, unit, zero_line)
from kane_dynamics.plot.torque_plots import LABELS, stack
from matplotlib.figure import Figure
import numpy as np

_RUNS = (RED, BLUE, GREEN, PINK)
Run = tuple[Array, Array, Array]


def plot_tracking(runs: Mapping[str, Run], joint_names: Sequence[str],
                  path: Path | None = None, *,
                  sources: tuple[Array, Array] | None = None, prismatic: Collection[str] = (),
                  title: str = 'Tracking of the desired motion') -> Figure:
    """
    Plot desired and actual positions and tracking errors of one or more runs, for each joint.

    Parameters
    ----------
    runs : mapping of str to (t, desired, actual)
        By label, for example 'PD only' and 'PD + feedforward': (K,) s, (K, n) and (K, n) rad or m.
    joint_names : sequence of str
        Names, in the order of the columns.
    sources : (t, terms), optional
        Adds the torques by source as a third column: (K,) s and `Robot.torque_terms`, (K, 5, n).
    path, prismatic, title
        See `kane_dynamics.plot`.

    """
    names = list(joint_names)
    columns = 2 if sources is None else 3
    with styled(5.2 * columns, 1.3 + 1.55 * len(names), title, path) as figure:
        panels = figure.subplots(len(names), columns, sharex='col', squeeze=False)
        for i, name in enumerate(names):
            position, error = panels[i, :2]
            milli = 'mm' if name in prismatic else 'mrad'
            notes = [('RMS', INK)]
            for k, (label, (t, desired, actual)) in enumerate(runs.items()):
                color = _RUNS[k % len(_RUNS)]
                e = 1e3 * (np.asarray(actual)[:, i] - np.asarray(desired)[:, i])
                position.plot(t, np.asarray(actual)[:, i], color=color, label=label)
                error.plot(t, e, color=color)
                size = rms(e)
                notes.append((f'{size if size > 1e3 * NOISE else 0.0:.3g} {milli}', color))
            beside(error, *notes)
            t, desired, _ = next(iter(runs.values()))
            position.plot(t, np.asarray(desired)[:, i], color=INK, linestyle=(0, (4, 3)),
                          linewidth=1.2, label='desired')
            position.set_ylabel(f'{name}\n[{unit("Position", [name], prismatic)}]')
            hide_rounding(error, 1e3 * NOISE, 1e-3)
            hide_rounding(position, NOISE, 0.1)
            error.set_ylabel(f'[{milli}]')
            zero_line(error)
            if sources is not None:
                stack(panels[i, 2], sources[0], np.asarray(sources[1])[:, :, i])
                panels[i, 2].set_ylabel(f'[{unit("Torque", [name], prismatic)}]')
        for axes, text in zip(panels[0], ('Position', 'Error', 'Torque by source'),
                              strict=False):
            axes.set_title(text)
        legend_below(figure, chain(panels[0, :1], panels[:, 2] if columns == 3 else ()), LABELS)
        time_axis(panels)
    return figure
