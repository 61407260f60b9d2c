"""Plot of torque, speed and power of a motion with their limits."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from kane_dynamics.plot.style import (BLUE, hide_rounding, NOISE, panel_unit, Path, RED,
                                      styled, time_axis)
from matplotlib.figure import Figure
import numpy as np

if TYPE_CHECKING:
    from kane_dynamics.feasibility import Demand


def plot_demand(demand: Demand, path: Path | None = None, *,
                prismatic: Collection[str] = (),
                title: str = 'Torque, speed and power against the limits') -> Figure:
    """
    Plot torque, speed and power of each joint, with its limits as dashed lines.

    Parameters
    ----------
    demand : Demand
        Result of `feasibility.demand`.
    path, prismatic, title
        See `kane_dynamics.plot`.

    """
    names = list(demand.joint_names)
    columns = (('Torque', demand.tau, demand.limits.effort),
               ('Speed', demand.u, demand.limits.velocity),
               ('Power', demand.power, demand.power_limit))
    with styled(12.0, 1.3 + 1.55 * len(names), title, path) as figure:
        panels = figure.subplots(len(names), 3, sharex=True, squeeze=False)
        # A row for each joint, a column for each quantity.
        for j, (name, row) in enumerate(zip(names, panels, strict=True)):
            for axes, (what, values, bounds) in zip(row, columns, strict=True):
                axes.plot(demand.t, values[:, j], color=BLUE)
                axes.set_ylabel(f'[{panel_unit(what, [name], prismatic)}]')
                # Values at the level of rounding look like zero.
                hide_rounding(axes, NOISE * float(np.abs(values).max(initial=1.0)), 1e-3)
                if np.isfinite(bounds[j]):
                    for bound in (-bounds[j], bounds[j]):
                        axes.axhline(bound, color=RED, linestyle='--', linewidth=1.0)
            row[0].set_ylabel(f'{name}\n{row[0].get_ylabel()}')
        for axes, (what, _, _) in zip(panels[0], columns, strict=True):
            axes.set_title(what)
        time_axis(panels)
    return figure
