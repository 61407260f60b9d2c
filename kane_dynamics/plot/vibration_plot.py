"""Plot of the vibration of an arm after a motion, for several kinds of feedforward."""

from collections.abc import Sequence
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.plot.style import above, BLUE, GREEN, ORANGE, Path, styled, time_axis
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

COLORS = (ORANGE, BLUE, GREEN)
LEAST = 3e-8  # m, the least distance on the logarithmic axis
SHOWN = 0.05  # s before the end of the motion


class VibrationRecord(NamedTuple):
    """
    Vibration with one kind of feedforward.

    Attributes
    ----------
    label : str
        Of the curves.
    t : (K,) array
        Time after the end of the motion, s.
    distance : (K,) array
        From rest, m.
    torques : (K, n) array
        Of the motors, N m.

    """

    label: str
    t: Array
    distance: Array
    torques: Array


def plot_vibration(records: Sequence[VibrationRecord], joint_names: Sequence[str],
                   path: Path | None = None, *, duration: float, title: str) -> Figure:
    """
    Plot distances from rest after a motion, and the torques during it.

    Parameters
    ----------
    records : sequence of VibrationRecord
        At most three; the torques are those of the joint where they differ most.
    joint_names : sequence of n str
        In the order of the columns of torques.
    duration : float
        Of the motion, s.
    path, title
        See `kane_dynamics.plot`.

    """
    with styled(10.0, 8.0, title, path) as figure:
        linear, logarithmic, of_torques = figure.subplots(3, 1)
        _plot_distances(linear, logarithmic, records)
        above(linear, len(records))

        # The joint whose torque shows the difference best.
        joint = _most_changed_joint(records)
        for record, color in zip(records, COLORS):
            of_torques.plot(record.t, record.torques[:, joint], color=color)
        of_torques.set_xlim(-duration - SHOWN, 4.0 * SHOWN)
        of_torques.set_ylabel(f'Torque of\n{joint_names[joint]} [N m]')
        time_axis([linear, logarithmic, of_torques])
        of_torques.set_xlabel('Time after the end of the motion [s]')
    return figure


def _plot_distances(linear: Axes, logarithmic: Axes,
                    records: Sequence[VibrationRecord]) -> None:
    """Plot the distances from rest on two axes, scaled to those after the motion."""
    # The motion itself moves much farther than the vibration after it.
    largest, end = 0.0, np.inf
    for record, color in zip(records, COLORS):
        millimetres = 1e3 * np.maximum(record.distance, LEAST)
        linear.plot(record.t, millimetres, color=color, label=record.label)
        logarithmic.semilogy(record.t, millimetres, color=color)
        largest = max(largest, millimetres[record.t >= 0.0].max())
        end = min(end, record.t[-1])
    linear.set_ylim(0.0, 1.2 * largest)
    logarithmic.set_ylim(1e3 * LEAST, 3.0 * largest)
    for axes in (linear, logarithmic):
        axes.set_xlim(-SHOWN, end)
        axes.set_ylabel('Distance\nfrom rest [mm]')


def _most_changed_joint(records: Sequence[VibrationRecord]) -> int:
    """Return the joint whose ranges of torques differ most between the records."""
    ranges = [np.ptp(record.torques, axis=0) for record in records]
    return int(np.argmax(np.ptp(ranges, axis=0)))
