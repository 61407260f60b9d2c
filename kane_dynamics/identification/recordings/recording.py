"""Recordings of an arm in motion, and their filter."""

from dataclasses import dataclass, replace
from typing import Any

from kane_dynamics._util.checks import increasing
from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.solvers import scientific
import numpy as np

NAMES = ('q', 'u', 'udot', 'tau')
ORDER = 4  # of the Butterworth filter, before it runs both ways


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

    Raises
    ------
    InputError
        The shapes differ, something is no number or not finite, or the time does not increase.

    """

    t: Array
    q: Array
    u: Array
    udot: Array
    tau: Array

    def __post_init__(self) -> None:
        """Check that the parts fit together."""
        for name in ('t', *NAMES):
            freeze(self, name, real(getattr(self, name), f'recording: {name}'))
        if self.t.ndim != 1 or self.tau.ndim != 2:
            raise InputError(f'recording: t and tau have shapes {self.t.shape} and '
                             f'{self.tau.shape}; expected (N,) and (N, n)')
        for name in NAMES:
            value = getattr(self, name)
            if value.shape != (len(self.t), self.tau.shape[1]):
                raise InputError(f'recording: {name} has shape {value.shape}; expected '
                                 f'({len(self.t)}, {self.tau.shape[1]})')
            if not np.isfinite(value).all():
                row = int(np.argwhere(~np.isfinite(value))[0, 0])
                raise InputError(f'recording: {name} is not finite in row {row + 1}')
        increasing(self.t, len(self.t), 'recording: t')

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.t)

    def rows(self, chosen: slice) -> 'Recording':
        """Return some of the rows."""
        return Recording(*(getattr(self, name)[chosen] for name in ('t', *NAMES)))

    def filtered(self, cutoff: float) -> 'Recording':
        """
        Return positions and torques low-passed without delay, with the rates of the former.

        A Butterworth filter of order 4 runs forth and back over q and tau; u and udot become
        central differences of the filtered q. Rows must be evenly spaced.

        Parameters
        ----------
        cutoff : float
            Hz, below half the sampling rate: several times the fastest motion.

        Raises
        ------
        InputError
            The cutoff is out of range, the rows are too few or their times uneven.

        """
        step = np.diff(self.t)
        mean = float(step.mean())
        if np.abs(step - mean).max() > 0.02 * mean:
            raise InputError(f'recording: steps of time lie between {step.min():g} and '
                             f'{step.max():g} s; a filter needs them even within 2 %')
        if not 0.0 < cutoff < 0.5 / mean:
            raise InputError(f'cutoff is {cutoff:g} Hz; valid: above 0, below half the sampling '
                             f'rate, {0.5 / mean:g} Hz')
        signal = scientific('scipy.signal')
        sections = signal.butter(ORDER, cutoff, output='sos', fs=1.0 / mean)
        if len(self) <= 6 * ORDER:
            raise InputError(f'recording: {len(self)} rows; a filter needs more than {6 * ORDER}')
        q, tau = (signal.sosfiltfilt(sections, x, axis=0) for x in (self.q, self.tau))
        u = np.gradient(q, mean, axis=0)
        return replace(self, q=q, u=u, udot=np.gradient(u, mean, axis=0), tau=tau)


def real(value: Any, what: str) -> Array:
    """Return real numbers as an array of float64; InputError names what is none."""
    try:
        array = np.asarray(value)
    except ValueError:
        raise InputError(f'{what} is not a rectangular array') from None
    if array.dtype.kind not in 'fiu':
        raise InputError(f'{what} has dtype {array.dtype}; expected real numbers')
    return array.astype(np.float64, copy=False)
