"""The report of the demo: tracking errors, latencies, and plots."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.demo.demo_settings import DURATION, JOINTS, STATE_TIMEOUT, URDF
from kane_dynamics.motion.motion import Motion
from kane_dynamics.plot import plot_tracking
from kane_dynamics.robot.robot import Robot
from kane_dynamics.urdf import load_urdf
import numpy as np

MIN_RATIO = 10.0  # smallest accepted ratio of tracking errors without and with feedforward
MIN_ANSWERED = 0.95  # smallest share of states with torques in a run in real time


@dataclass(frozen=True, eq=False)
class TrackingLog:
    """
    A record of the arm: states, torques and latencies.

    Attributes
    ----------
    t : (K,) array
        Time since the start of the motion, s.
    q, u, command, servo : (K, n) arrays
        States of the joints, and torques of the node and of the servo.
    late : (K,) array
        Time from each state's stamp to its publication, s.
    latency : (L, 2) array
        Time of each state whose torques were received, and the latency, s.

    """

    t: Array
    q: Array
    u: Array
    command: Array
    servo: Array
    late: Array
    latency: Array

    @classmethod
    def load(cls, path: Path) -> 'TrackingLog':
        """Load the record that the plant saved."""
        with np.load(path) as file:
            return cls(**{name: file[name] for name in cls.__dataclass_fields__})

    def within(self, start: float, end: float) -> 'TrackingLog':
        """Return the part of the record between two times."""
        def kept(table: Array, times: Array) -> Array:
            return table[(times >= start) & (times <= end)]
        rows = {name: kept(getattr(self, name), self.t) for name in ('t', 'q', 'u', 'command',
                                                                     'servo', 'late')}
        return TrackingLog(**rows, latency=kept(self.latency, self.latency[:, 0]))


def tracking_errors(motion: Motion, run: TrackingLog) -> Array:
    """Return the RMS tracking error of every joint during the motion, (n,), rad."""
    run = run.within(0.0, DURATION)
    error: Array = run.q - motion.sample(run.t)[0]
    return np.asarray(np.sqrt(np.mean(error * error, axis=0)))


def improvement(motion: Motion, alone: TrackingLog, helped: TrackingLog) -> float:
    """Return the ratio of the tracking errors of two runs, over all joints."""
    before, after = (tracking_errors(motion, run) for run in (alone, helped))
    return float(np.sqrt(np.mean(before**2) / np.mean(after**2)))


def lateness(run: TrackingLog) -> str | None:
    """Describe what was late in a run with feedforward; return None if it ran in real time."""
    run = run.within(0.0, DURATION)
    longest = float(run.late.max(initial=0.0))
    if longest < STATE_TIMEOUT and len(run.latency) >= MIN_ANSWERED * len(run.t):
        return None
    return (f'{len(run.latency)} of {len(run.t)} states were answered, expected '
            f'{MIN_ANSWERED:.0%}; the latest state was published {1e3 * longest:.0f} ms late, '
            f'expected less than {1e3 * STATE_TIMEOUT:.0f} ms')


def repeated_if_late(motion: Motion, alone: TrackingLog,
                     perform: Callable[[], TrackingLog]) -> TrackingLog:
    """
    Perform the motion with feedforward; repeat it once if it falls short and states were late.

    Late states only increase the error with feedforward, since the servo is computed with the
    arm. A sufficient ratio is therefore valid in any case.
    """
    helped = perform()
    late = lateness(helped)
    if late is None or improvement(motion, alone, helped) >= MIN_RATIO:
        return helped
    print(f'  the machine is too busy: {late}; the motion is repeated once', flush=True)
    return perform()


def report(motion: Motion, alone: TrackingLog, helped: TrackingLog, prediction: Any,
           fall: TrackingLog, folder: Path) -> int:
    """Print the results, save the plot, and return 0 if feedforward is effective, else 1."""
    alone, helped = alone.within(0.0, DURATION), helped.within(0.0, DURATION)
    before, after = (tracking_errors(motion, run) for run in (alone, helped))
    print('\nTracking error, RMS in mrad\n'
          f'{"joint":14}{"servo alone":>14}{"+ feedforward":>16}{"ratio":>9}')
    for name, x, y in zip(JOINTS, 1e3 * before, 1e3 * after):
        print(f'{name:14}{x:14.2f}{y:16.3f}{x / y:9.1f}')
    ratio = improvement(motion, alone, helped)
    print(f'{"all joints":14}{1e3 * np.sqrt(np.mean(before**2)):14.2f}'
          f'{1e3 * np.sqrt(np.mean(after**2)):16.3f}{ratio:9.1f}')
    _print_latency(helped)
    _print_fall(prediction, fall)
    _draw(motion, alone, helped, folder)
    return verdict(ratio, lateness(helped))


def verdict(ratio: float, late: str | None) -> int:
    """Print whether the result is valid; return 0 if feedforward is effective, else 1."""
    if late is not None:
        print(f'\nThe machine was too busy for real time: {late}.')
    if ratio >= MIN_RATIO:
        return 0
    print(f'\nRatio of tracking errors: {ratio:.1f}; expected at least {MIN_RATIO:g}.'
          + ('' if late is None else ' The ratio is not valid: run the demo again on an idle '
             'machine.'))
    return 1


def _print_latency(run: TrackingLog) -> None:
    """Print the latency from joint states to torques."""
    if not len(run.latency):
        print('\nNo torques received.')
        return
    p50, p90, p99 = (1e6 * np.percentile(run.latency[:, 1], p) for p in (50, 90, 99))
    print(f'\nLatency from joint state to torque, over DDS: p50 {p50:.0f} us, p90 {p90:.0f} us, '
          f'p99 {p99:.0f} us ({len(run.latency)} torques for {len(run.t)} states)')


def _print_fall(prediction: Any, fall: TrackingLog) -> None:
    """Print the prediction error of the fall of the arm."""
    points = prediction.trajectory.points
    t = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points])
    q = np.array([p.positions for p in points])
    actual = fall.q[:len(t)]
    q = q[:len(actual)]
    moved = np.abs(actual - actual[0]).max(axis=0)
    error = np.abs(q - actual).max(axis=0)
    worst = int(np.argmax(error))
    print(f'Free fall for {t[-1]:.2g} s: simulate (in {1e3 * prediction.wall_time:.1f} ms) '
          f'predicted its fall of up to {np.degrees(moved.max()):.0f} deg to within '
          f'{np.degrees(error[worst]):.2f} deg ({JOINTS[worst]})')


def _draw(motion: Motion, alone: TrackingLog, helped: TrackingLog, folder: Path) -> None:
    """Plot tracking and torques by source."""
    robot = Robot(load_urdf(URDF, joints=JOINTS))
    t = np.linspace(0.0, DURATION, 801)
    terms = robot.torque_terms(*motion.sample(t))
    runs = {label: (run.t, motion.sample(run.t)[0], run.q)
            for label, run in (('servo alone', alone), ('servo + feedforward', helped))}
    picture = folder / 'demo.png'
    plot_tracking(runs, JOINTS, picture, sources=(t, terms),
                  title='A seven-axis arm in MuJoCo, with and without feedforward torques')
    print(f'\nPicture: {picture}')
