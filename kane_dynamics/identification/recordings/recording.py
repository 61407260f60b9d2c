"""Recordings of the motion of an arm: resampling and filtering."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from kane_dynamics._util.checks import increasing, instance, number
from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError
from kane_dynamics.identification.solvers import scientific
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.model.model import Model
import numpy as np

NAMES = ('q', 'u', 'udot', 'tau')
STANDSTILL = 0.02  # rad/s or m/s: a joint that is no faster is at rest
EVEN = 0.02  # relative deviation of time steps that are regarded as equal
LOWEST_CUTOFF = 1e-4  # of the sampling rate: filters below it are singular to rounding
MOST_RESAMPLING = 10  # rows for each recorded one
MOTION = 0.99  # share of the power of speeds that is motion
CUTOFF = 5.0  # times the highest frequency of the motion
ORDER = 4  # of the Butterworth filter, which is applied forward and backward


@dataclass(frozen=True, eq=False)
class Recording:
    """
    Joint states and torques over time.

    Attributes
    ----------
    t : (N,) array
        s, increasing.
    q, u, udot : (N, n) arrays
        Positions, speeds and accelerations; rad or m, s.
    tau : (N, n) array
        Measured torques, N m or N.
    derived : tuple of str
        Those of 'u' and 'udot' that are not measured, but differences of q or u.

    Raises
    ------
    InputError
        If shapes differ, values are not finite numbers, or the time does not increase.

    """

    t: Array
    q: Array
    u: Array
    udot: Array
    tau: Array
    derived: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check shapes, numbers and times."""
        for name in ('t', *NAMES):
            freeze(self, name, real(getattr(self, name), f'recording: {name}'))
        if self.t.ndim != 1 or self.tau.ndim != 2:
            raise InputError(f'recording: t and tau of shapes {self.t.shape} and '
                             f'{self.tau.shape}; expected (N,) and (N, n)')
        # As many rows as times, as many columns as torques.
        for name in NAMES:
            value = getattr(self, name)
            if value.shape != (len(self.t), self.tau.shape[1]):
                raise InputError(f'recording: {name}: shape {value.shape}; expected '
                                 f'({len(self.t)}, {self.tau.shape[1]})')
            # The message names the first row that is not finite.
            if not np.isfinite(value).all():
                row = int(np.argwhere(~np.isfinite(value))[0, 0])
                raise InputError(f'recording: {name}: not finite in row {row + 1}; '
                                 'expected finite numbers')
        increasing(self.t, len(self.t), 'recording: t')

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.t)

    def rows(self, chosen: slice | Flags) -> 'Recording':
        """Return some of the rows, of a slice or of a mask (N,)."""
        columns = {}
        for name in ('t', *NAMES):
            columns[name] = getattr(self, name)[chosen]
        return replace(self, **columns)

    def with_derived_speeds(self) -> 'Recording':
        """Return the recording with differences of q in place of measured u and udot."""
        u = np.gradient(self.q, self.t, axis=0)
        udot = np.gradient(u, self.t, axis=0)
        return replace(self, u=u, udot=udot, derived=('u', 'udot'))

    @property
    def uneven(self) -> bool:
        """Return whether the steps of time differ by more than 2 % from their mean."""
        step = np.diff(self.t)
        return bool(np.abs(step - step.mean()).max() > EVEN * step.mean())

    def resampled(self, rate: float | None = None) -> 'Recording':
        """
        Return evenly spaced rows, interpolated by cubic splines.

        Parameters
        ----------
        rate : float, optional
            Rows per second. Default: the mean rate.

        Raises
        ------
        InputError
            If the rate is not positive and finite, too small for 3 rows, or more than 10
            times the recorded one.

        """
        # Two rows at least, and no more than the duration has.
        duration = float(self.t[-1] - self.t[0])
        if rate is not None and not 2.0 / duration <= rate < np.inf:
            raise InputError(f'rate: {rate:g} Hz; expected a finite number, '
                             f'{2.0 / duration:g} or more for a recording of '
                             f'{duration:g} s')
        # More rows than that hold nothing more, and fill the memory.
        recorded_rate = (len(self) - 1) / duration
        if rate is not None and rate > MOST_RESAMPLING * recorded_rate:
            raise InputError(f'rate: {rate:g} Hz for rows at {recorded_rate:.4g} Hz; expected '
                             f'at most {MOST_RESAMPLING * recorded_rate:.4g} Hz')
        # As many rows as before, or as many as the rate has in the duration.
        if rate is None:
            t = np.linspace(self.t[0], self.t[-1], len(self))
        else:
            count = int(duration * rate + 1e-9) + 1
            t = self.t[0] + np.arange(count) / rate
        spline = scientific('scipy.interpolate').CubicSpline
        resampled = {name: spline(self.t, getattr(self, name))(t) for name in NAMES}
        return replace(self, t=t, **resampled)

    def filtered(self, cutoff: float) -> 'Recording':
        """
        Return the recording low-pass filtered without delay.

        A Butterworth filter of order 4 is applied forward and backward to q, tau and
        measured u. Speeds that are not measured are central differences of the filtered
        q, and udot those of u: one differentiation amplifies noise less than two. Uneven
        rows are resampled first.

        Parameters
        ----------
        cutoff : float
            Hz, below half the sampling rate and several times the highest frequency of
            the motion.

        Raises
        ------
        InputError
            If the cutoff is out of range, or there are too few rows.

        """
        if self.uneven:
            return self.resampled().filtered(cutoff)
        mean = float(np.diff(self.t).mean())
        lowest, highest = LOWEST_CUTOFF / mean, 0.5 / mean
        cutoff = number(cutoff, 'cutoff', f'above {lowest:g} Hz, and below half the '
                        f'sampling rate, {highest:g} Hz', lambda x: lowest < x < highest)
        if len(self) <= 6 * ORDER:
            raise InputError(f'recording: {len(self)} rows; expected more than '
                             f'{6 * ORDER}')

        # Forwards and backwards, so that nothing is delayed.
        q, u, tau = (low_pass(values, cutoff, mean) for values in (self.q, self.u, self.tau))
        # Derived columns are derived again, from what was filtered.
        if 'u' in self.derived:
            u = np.gradient(q, mean, axis=0)
        return replace(self, q=q, u=u, udot=np.gradient(u, mean, axis=0), tau=tau,
                       derived=tuple({*self.derived, 'udot'}))

    def proposed_cutoff(self) -> float:
        """
        Return a cutoff for `filtered`, Hz: five times the highest frequency of the motion.

        That is the frequency below which 99 % of the power of each joint's speed lies.
        """
        even = self.resampled() if self.uneven else self
        step = float(np.diff(even.t).mean())
        power = np.abs(np.fft.rfft(even.u - even.u.mean(axis=0), axis=0))**2
        frequency = np.fft.rfftfreq(len(even), step)
        share = np.cumsum(power, axis=0) / np.maximum(power.sum(axis=0), 1e-300)
        highest = max(float(frequency[np.argmax(of_joint >= MOTION)]) for of_joint in share.T)
        return min(CUTOFF * highest, 0.4 / step)

    def acceleration_noise(self) -> Array:
        """
        Return the noise of each joint's accelerations relative to their RMS, (n,), 0 to about 1.

        A smooth signal is near the least-squares parabola through five rows. The
        residual is noise; its variance is 18/35 of that of the noise. NaN for a joint
        without acceleration.
        """
        if len(self) < 5:
            return np.full(self.tau.shape[1], np.nan)
        # What the parabola leaves of the middle row: weights of the five rows.
        weights = np.array([3.0, -12.0, 18.0, -12.0, 3.0]) / 35.0
        left: Array = np.zeros((len(self) - 4, self.tau.shape[1]))
        for k, weight in enumerate(weights):
            left = left + weight * self.udot[k:len(self) - 4 + k]
        with np.errstate(invalid='ignore'):
            return np.asarray(np.sqrt(np.mean(left**2, axis=0) * 35.0 / 18.0
                                      / np.mean(self.udot**2, axis=0)))


def low_pass(values: Array, cutoff: float, step: float) -> Array:
    """Return values, (N, ...), at even steps of time below a frequency, Hz, without delay."""
    signal = scientific('scipy.signal')
    sections = signal.butter(ORDER, cutoff, output='sos', fs=1.0 / step)
    return np.asarray(signal.sosfiltfilt(sections, values, axis=0))


def check_recording(model: Model, recording: Recording, least: int = 3,
                    joints: Sequence[str] | None = None) -> None:
    """Raise InputError unless a recording has all joints and enough rows."""
    instance(model, Model, 'model')
    instance(recording, Recording, 'recording')
    require_angles(model, 'recording')
    names = model.joint_names if joints is None else joints
    if recording.tau.shape[1] != len(names):
        raise InputError(f'recording: {recording.tau.shape[1]} joints; expected '
                         f'{len(names)}: '
                         f'{", ".join(names)}')
    if len(recording) < least:
        raise InputError(f'recording: {len(recording)} rows; expected at least {least}')


def require_rigid_links(model: Model) -> None:
    """Raise InputError for a model with beams, which has no regressor."""
    if model.flexible:
        raise InputError('model: with beams; expected rigid links, whose torque is linear '
                         'in their parameters')


def real(value: Any, what: str) -> Array:
    """Return real numbers as an array of float64; raise InputError for others."""
    try:
        array = np.asarray(value)
    except ValueError:
        raise InputError(f'{what}: not rectangular; expected an array of numbers') from None
    if array.dtype.kind not in 'fiu':
        raise InputError(f'{what}: dtype {array.dtype}; expected real numbers')
    return array.astype(np.float64, copy=False)
