"""Plot of a time-optimal timing: use of the limits, and the active limit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kane_dynamics.plot.style import BLUE, Path, RED, styled, time_axis
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from kane_dynamics.feasibility import TimeOptimal


def plot_timing(timing: TimeOptimal, path: Path | None = None, *,
                title: str = 'Use of the limits by the fastest timing') -> Figure:
    """
    Plot the use of each limit of each joint over time; red where it is the active limit.

    Parameters
    ----------
    timing : TimeOptimal
        Result of `feasibility.time_optimal`.
    path, title
        See `kane_dynamics.plot`.

    """
    t = timing.motion.times
    names = timing.joint_names
    limits = list(timing.uses)
    with styled(12.0, 1.3 + 1.55 * len(names), title, path) as figure:
        panels = figure.subplots(len(names), len(limits), sharex=True, sharey=True,
                                 squeeze=False)
        # A panel for each limit of each joint, in percent of the limit.
        for j, (name, row) in enumerate(zip(names, panels, strict=True)):
            for axes, limit in zip(row, limits, strict=True):
                use = 100.0 * timing.uses[limit][:, j]
                axes.plot(t, use, color=BLUE)
                # The stretches in which this limit determines the timing.
                for active in timing.active:
                    if (active.joint, active.limit) == (name, limit):
                        inside = (t >= active.start) & (t <= active.end)
                        axes.plot(t[inside], use[inside], color=RED, linewidth=2.0)
                axes.set_ylim(0.0, 110.0)
            row[0].set_ylabel(f'{name}\n[%]')
        for axes, limit in zip(panels[0], limits, strict=True):
            axes.set_title(f'{limit} limit')
        time_axis(panels)
    return figure
