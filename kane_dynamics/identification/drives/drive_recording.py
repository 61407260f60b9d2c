"""Recordings of both sides of elastic joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import os

from kane_dynamics._util.checks import increasing
from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.recordings.reader import recorded_columns
from kane_dynamics.identification.recordings.recording import EVEN, real
from kane_dynamics.identification.solvers import scientific
import numpy as np
from numpy.typing import ArrayLike

SIGNALS = ('theta', 'q', 'motor_torque', 'gear_torque')
LEAST_ROWS = 200


@dataclass(frozen=True, eq=False)
class DriveRecording:
    """
    Positions and torques of motors and links of elastic joints over time.

    All numbers are joint-side: a motor's angle divided by the gear ratio, its torque times
    the ratio. `from_motor_side` converts.

    Attributes
    ----------
    t : (N,) array
        s, increasing.
    theta : (N, n) array
        Motor positions, rad or m.
    q : (N, n) array, optional
        Positions of the links, by encoders behind the gears, rad or m.
    motor_torque : (N, n) array, optional
        N m or N.
    gear_torque : (N, n) array, optional
        Of torque sensors between gears and links, N m or N.

    Raises
    ------
    InputError
        Shapes differ, values are not finite, times do not increase, there are less than
        200 rows, or beside the motor positions nothing was measured.

    """

    t: Array
    theta: Array
    q: Array | None = None
    motor_torque: Array | None = None
    gear_torque: Array | None = None

    def __post_init__(self) -> None:
        """Check shapes, numbers and times."""
        for name in ('t', *self.signals):
            freeze(self, name, real(getattr(self, name), f'drive recording: {name}'))
        if self.t.ndim != 1 or self.theta.ndim != 2 or not self.theta.shape[1]:
            raise InputError(f'drive recording: t and theta of shapes {self.t.shape} and '
                             f'{self.theta.shape}; expected (N,) and (N, n)')
        # All signals have a row for each time and a column for each joint.
        expected = len(self.t), self.theta.shape[1]
        for name in self.signals:
            value = getattr(self, name)
            if value.shape != expected:
                raise InputError(f'drive recording: {name}: shape {value.shape}; expected '
                                 f'{expected}')
            if not np.isfinite(value).all():
                row = int(np.argwhere(~np.isfinite(value))[0, 0])
                raise InputError(f'drive recording: {name}: not finite in row {row + 1}; '
                                 'expected finite numbers')
        if len(self.signals) == 1:
            raise InputError('drive recording: motor positions alone; expected also '
                             'positions of the links, motor torques or gear torques')
        if len(self.t) < LEAST_ROWS:
            raise InputError(f'drive recording: {len(self.t)} rows; expected at least '
                             f'{LEAST_ROWS}')
        # Numerical differentiation needs times that increase.
        increasing(self.t, len(self.t), 'drive recording: t')

    @classmethod
    def from_motor_side(cls, t: ArrayLike, theta: ArrayLike, ratio: ArrayLike, *,
                        q: ArrayLike | None = None, motor_torque: ArrayLike | None = None,
                        gear_torque: ArrayLike | None = None) -> DriveRecording:
        """
        Return the recording of motor angles and torques as the motors have them.

        Parameters
        ----------
        t : (N,) array_like
            s.
        theta : (N, n) array_like
            Angles of the motors, rad.
        ratio : float or (n,) array_like
            Motor revolutions per joint revolution; negative if they turn against each
            other.
        q, gear_torque : (N, n) array_like, optional
            Of the links, joint-side.
        motor_torque : (N, n) array_like, optional
            Torques of the motors, N m.

        """
        of_joints = real(ratio, 'ratio')
        if not (np.isfinite(of_joints) & (of_joints != 0.0)).all():
            raise InputError(f'ratio: {ratio!r}; expected finite numbers other than 0')
        angles = real(theta, 'drive recording: theta')
        if of_joints.ndim > 1 or of_joints.shape not in ((), angles.shape[1:]):
            raise InputError(f'ratio: shape {of_joints.shape}; expected a number, or one '
                             f'for each of {angles.shape[1:]} joints')
        # A motor's torque acts on the joint ratio times, its angle ratio times less.
        of_motors = None
        if motor_torque is not None:
            of_motors = real(motor_torque, 'drive recording: motor_torque') * of_joints
        return cls(real(t, 'drive recording: t'), angles / of_joints, _optional(q, 'q'),
                   of_motors, _optional(gear_torque, 'gear_torque'))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.t)

    @property
    def signals(self) -> tuple[str, ...]:
        """Return the names of what was measured."""
        return tuple(name for name in SIGNALS if getattr(self, name) is not None)

    def resampled(self) -> DriveRecording:
        """Return evenly spaced rows, by cubic splines if the times are uneven."""
        step = np.diff(self.t)
        if np.abs(step - step.mean()).max() <= EVEN * step.mean():
            return self
        t = np.linspace(self.t[0], self.t[-1], len(self))
        spline = scientific('scipy.interpolate').CubicSpline
        even = {}
        for name in self.signals:
            through_rows = spline(self.t, getattr(self, name))
            even[name] = through_rows(t)
        return replace(self, t=t, **even)


def read_drive_recording(path: str | os.PathLike[str], joint_names: Sequence[str],
                         ratio: ArrayLike = 1.0) -> DriveRecording:
    """
    Return the recording of both sides of elastic joints in a CSV or npz file.

    Columns (in npz: arrays) are `t`, and for each joint `theta` of the motor and, as far as
    they are measured, `q`, `motor_torque` and `gear_torque`, named or numbered as those of
    `read_recording`.

    Parameters
    ----------
    path : path
        Path of the file.
    joint_names : sequence of str
        Joints, in the order of the result.
    ratio : float or (n,) array_like
        Motor revolutions per joint revolution, where `theta` and `motor_torque` are those
        of the motors; 1 if they are joint-side.

    Raises
    ------
    InputError
        As `read_recording` and `DriveRecording`.

    """
    columns = recorded_columns(path, joint_names, SIGNALS)
    t = columns.pop('t')
    theta = columns.pop('theta')
    if t is None or theta is None:
        raise InputError(f"{path}: no 'theta' of the motors; expected "
                         f"'theta.{joint_names[0]}' or 'theta1', and so on")
    # Columns of a file have the motors' numbers; other files have a ratio of 1.
    try:
        return DriveRecording.from_motor_side(t, theta, ratio, **columns)
    except InputError as error:
        raise InputError(f'{path}: {error}') from None


def _optional(values: ArrayLike | None, what: str) -> Array | None:
    """Return values as an array, None without any."""
    return None if values is None else real(values, f'drive recording: {what}')


def require_joint_count(recording: DriveRecording, names: Sequence[str]) -> None:
    """Raise InputError unless a recording has as many joints as names."""
    count = recording.theta.shape[1]
    if count != len(names):
        raise InputError(f'drive recording: {count} joints; expected {len(names)}: '
                         f'{", ".join(names)}')
