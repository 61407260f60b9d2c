"""Plot of torque, speed and power of a motion with their limits."""

from collections.abc import Collection
from typing import TYPE_CHECKING

from kane_dynamics.plot.style import BLUE, hide_rounding, NOISE, Path, RED, styled, time_axis, unit
from matplotlib.figure import Figure
import numpy as np

if TYPE_CHECKING:
    from kane_dynamics.feasibility import Demand


def plot_demand(asked: 'Demand', path: Path | None = None, *, prismatic: Collection[str] = (),
                title: str = 'Torque, speed and power against the limits') -> Figure:
    """
    Plot torque, speed and power of each joint, with its limits as dashed lines.

    Parameters
    ----------
    asked : Demand
        Result of `feasibility.demand`.
    path, prismatic, title
        See `kane_dynamics.plot`.

    """
    names = list(asked.joint_names)
    columns = (('Torque', asked.tau, asked.limits.effort),
               ('Speed', asked.u, asked.limits.velocity),
               ('Power', asked.power, asked.power_limit))
    with styled(12.0, 1.3 + 1.55 * len(names), title, path) as figure:
        panels = figure.subplots(len(names), 3, sharex=True, squeeze=False)
        for row, j in zip(panels, range(len(names)), strict=True):
            for axes, (what, values, bound) in zip(row, columns, strict=True):
                axes.plot(asked.t, values[:, j], color=BLUE)
                axes.set_ylabel(f'[{unit(what, names[j:j + 1], prismatic)}]')
                hide_rounding(axes, NOISE * float(np.abs(values).max(initial=1.0)), 1e-3)
                for sign in (-1.0, 1.0) if np.isfinite(bound[j]) else ():
                    axes.axhline(sign * bound[j], color=RED, linestyle='--', linewidth=1.0)
            row[0].set_ylabel(f'{names[j]}\n{row[0].get_ylabel()}')
        for axes, (what, _, _) in zip(panels[0], columns, strict=True):
            axes.set_title(what)
        time_axis(panels)
    return figure
