"""The report of mode elastic: vibration after a fast motion, and a plot."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from kane_dynamics._util.typing import Array
from kane_dynamics.demo.demo_settings import DemoRobot, FAST
from kane_dynamics.demo.recorded_arm import SavedRecord
from kane_dynamics.plot.vibration_plot import plot_vibration, VibrationRecord
import numpy as np

MIN_RATIO = 20.0  # smallest accepted ratio of the vibrations, rigid to elastic
SETTLED = 0.2  # s at the end, over which the place at rest is averaged
MIN_TRAVEL = 0.1  # m that the tip moves


@dataclass(frozen=True, eq=False)
class VibrationLog(SavedRecord):
    """
    A record of the arm with elastic joints.

    Attributes
    ----------
    t : (K,) array
        Since `started`, s.
    started : () array
        Simulated time, s.
    command : (K, n) array
        Torques of the motors, N m.
    place : (K, 3) array
        Origin of the robot's frame, m, world axes.

    """

    t: Array
    started: Array
    command: Array
    place: Array

    def since(self, time: float) -> Self:
        """Return the record with times since a simulated time, s."""
        moved = self.started - time
        return replace(self, t=self.t + moved, started=np.array(time))

    def distances(self) -> Array:
        """Return the distances from where the arm rests at last, (K,), m."""
        at_rest = self.place[self.t >= self.t[-1] - SETTLED].mean(axis=0)
        distances: Array = np.linalg.norm(self.place - at_rest, axis=1)
        return distances

    @property
    def vibration(self) -> float:
        """Return the largest distance from rest after the motion, at 0 s, m."""
        return float(self.distances()[self.t >= 0.0].max())

    @property
    def travel(self) -> float:
        """Return the largest distance from the place at rest, m, also in the motion."""
        return float(self.distances().max())


def report_vibration(robot: DemoRobot, runs: dict[str, VibrationLog], folder: Path) -> int:
    """Print the results, and return 0 if the elastic feedforward is effective, else 1."""
    rigid, elastic = runs.values()
    ratio = rigid.vibration / elastic.vibration
    print(f'\nResidual vibration of {robot.frame} after a motion of {FAST:g} s\n'
          f'{"":24}{"largest distance":>18}')
    for label, run in runs.items():
        print(f'{label:24}{1e3 * run.vibration:15.4f} mm')
    print(f'{"ratio":24}{ratio:15.1f}')

    picture = folder / 'demo_elastic.png'
    _plot_runs(robot, runs, picture)
    print(f'\nPicture: {picture}')

    # An arm that did not move does not vibrate either.
    travel = min(rigid.travel, elastic.travel)
    if ratio >= MIN_RATIO and travel > MIN_TRAVEL:
        return 0
    print(f'\nRatio {ratio:.1f} after a travel of {travel:.3f} m; expected at least '
          f'{MIN_RATIO:g} after {MIN_TRAVEL:g} m.')
    return 1


def _plot_runs(robot: DemoRobot, runs: dict[str, VibrationLog], picture: Path) -> None:
    """Plot the vibration and the torques of the runs."""
    records = []
    for label, run in runs.items():
        records.append(VibrationRecord(label, run.t, run.distances(), run.command))
    plot_vibration(records, robot.joints, picture, duration=FAST,
                   title=f'{robot.title} with elastic joints, after a fast motion')
