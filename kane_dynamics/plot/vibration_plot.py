"""Plot of the vibration of an arm after a motion, for several kinds of feedforward."""

from collections.abc import Mapping, Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.plot.style import above, BLUE, GREEN, ORANGE, Path, styled, time_axis
from matplotlib.figure import Figure
import numpy as np

COLORS = (ORANGE, BLUE, GREEN)
LEAST = 3e-8  # m, the least distance on the logarithmic axis
SHOWN = 0.05  # s before the end of the motion


def plot_vibration(distances: Mapping[str, tuple[Array, Array]],
                   torques: Mapping[str, Array], joint_names: Sequence[str],
                   path: Path | None = None, *, duration: float, title: str) -> Figure:
    """
    Plot distances from rest after a motion, and the torques during it.

    Parameters
    ----------
    distances : mapping of str to (t, distance)
        By label: times after the end of the motion, s, and distances, m, (K,) each.
    torques : mapping of str to (K, n) array
        Of the motors at these times, N m; those of the joint whose torques differ most
        are drawn.
    joint_names : sequence of n str
        In the order of the columns of `torques`.
    duration : float
        Of the motion, s.
    path, title
        See `kane_dynamics.plot`.

    """
    with styled(10.0, 8.0, title, path) as figure:
        panels = figure.subplots(3, 1, height_ratios=(2, 2, 2))
        colors = dict(zip(distances, COLORS))
        for label, (t, distance) in distances.items():
            millimetres = 1e3 * np.maximum(distance, LEAST)
            panels[0].plot(t, millimetres, color=colors[label], label=label)
            panels[1].semilogy(t, millimetres, color=colors[label])
        after = [distance[t >= 0.0].max() for t, distance in distances.values()]
        largest = 1e3 * max(after)
        panels[0].set_ylim(0.0, 1.2 * largest)
        panels[1].set_ylim(1e3 * LEAST, 3.0 * largest)
        panels[0].set_ylabel('Distance\nfrom rest [mm]')
        panels[1].set_ylabel('Distance\nfrom rest [mm]')
        above(panels[0], len(distances))
        end = min(float(t[-1]) for t, _ in distances.values())
        for axes in panels[:2]:
            axes.set_xlim(-SHOWN, end)

        # The joint whose torques the elasticity changes most.
        spans = [np.ptp(columns, axis=0) for columns in torques.values()]
        joint = int(np.argmax(np.ptp(np.array(spans), axis=0)))
        for label, (t, _) in distances.items():
            panels[2].plot(t, torques[label][:, joint], color=colors[label])
        panels[2].set_xlim(-duration - SHOWN, 4.0 * SHOWN)
        panels[2].set_ylabel(f'Torque of\n{joint_names[joint]} [N m]')
        time_axis(panels)
        panels[2].set_xlabel('Time after the end of the motion [s]')
    return figure
