"""Plot of the deflection of an arm by forces, against a stiffness."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.plot.style import (above, BLUE, GREEN, INK, ORANGE, Path, styled,
                                      time_axis, zero_line)
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

AXES = (('x', BLUE), ('y', ORANGE), ('z', GREEN))


def plot_deflection(t: Array, deflection: Array, force: Array,
                    stiffness: Sequence[float], path: Path | None = None, *,
                    torques: Array, joint_names: Sequence[str], title: str) -> Figure:
    """
    Plot forces, the deflection beside force over stiffness, and the torques.

    Parameters
    ----------
    t : (K,) array
        s.
    deflection, force : (K, 3) arrays
        m and N, in world axes.
    stiffness : three float
        N/m, along the world axes.
    torques : (K, n) array
        Of the joints, N m; their change since the last moment before a force is drawn.
    joint_names : sequence of n str
        In the order of the columns of `torques`.
    path, title
        See `kane_dynamics.plot`.

    """
    with styled(10.0, 8.0, title, path) as figure:
        panels = figure.subplots(3, 1, sharex=True, height_ratios=(1.2, 3, 2))
        for k, (name, color) in enumerate(AXES):
            panels[0].plot(t, force[:, k], color=color, label=name)
        panels[0].set_ylabel('Force\n[N]')
        above(panels[0], 3)
        # Force over stiffness is the deflection that is expected.
        _plot_deflections(panels[1], t, deflection, force / np.asarray(stiffness))
        # The torques change from the moment at which the force begins.
        first = int(np.argmax(force.any(axis=1)))
        changes = torques - torques[max(first - 1, 0)]
        for k, name in enumerate(joint_names):
            panels[2].plot(t, changes[:, k], label=name, linewidth=1.2)
        panels[2].set_ylabel('Change of torque\n[N m]')
        panels[2].legend(loc='center left',
                         bbox_to_anchor=(1.0, 0.5))
        for axes in panels:
            zero_line(axes)
        time_axis(panels)
    return figure


def _plot_deflections(axes: Axes, t: Array, deflection: Array,
                      expected: Array) -> None:
    """Plot the deflection along each axis, mm, beside the expected one."""
    for k, (name, color) in enumerate(AXES):
        axes.plot(t, 1e3 * deflection[:, k], color=color, label=name)
    for k in range(3):
        label = 'force / stiffness' if k == 0 else None
        axes.plot(t, 1e3 * expected[:, k], color=INK, linestyle=(0, (4, 3)),
                  linewidth=1.0, label=label)
    axes.set_ylabel('Deflection\n[mm]')
    above(axes, 4)
