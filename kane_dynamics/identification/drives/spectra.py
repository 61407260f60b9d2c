"""
Spectra of recordings that do not repeat, and of the derivatives of their signals.

A window w that vanishes at both ends moves derivatives from a signal to the window:

    <w e, x'>  = j omega <w e, x> - <w' e, x>,                         e = exp(-j omega t)
    <w e, x''> = -omega^2 <w e, x> - 2 j omega <w' e, x> + <w'' e, x>

so that equations of motion hold for the spectra as they hold in time, without a
difference and without leakage. White noise of a signal stays white in its spectrum.
"""

from dataclasses import dataclass
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.identification.solvers import scientific
import numpy as np

TAPER = 0.05  # of the rows, at either end
RISE = 0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0  # from 0 to 1, three derivatives 0
QUIET = 0.6  # of the Nyquist frequency: above it signals are noise
AUDIBLE = 4.0  # power over that of the noise
WIDEST = 0.4  # of the Nyquist frequency, of the band
LEAST_BINS = 40
FILTER_ORDER = 8  # of the Butterworth filter, forward and backward
BEYOND_BAND = 2.0  # its cutoff over the end of the band: the band passes unchanged
PERIODS = 3.0  # of the cutoff, after which a filter has settled
SPEED_NOISE = 0.0075  # rad/s or m/s, that speeds may have: of friction's smooth reversal


@dataclass(frozen=True, eq=False)
class Spectra:
    """
    A window over a number of rows, and a band of frequencies.

    Attributes
    ----------
    step : float
        Between rows, s.
    window, slope, bend : (N,) arrays
        w and its derivatives over time.
    omega : (F,) array
        rad/s, from 0.
    size : int
        Number of rows with the zeros after them, a product of small primes: other numbers
        take the Fourier transform many times as long.

    """

    step: float
    window: Array
    slope: Array
    bend: Array
    omega: Array
    size: int

    def of(self, signal: Array) -> Array:
        """Return the spectrum of a signal, (F,)."""
        return self._transformed(self.window, signal)

    def rate_of(self, signal: Array) -> Array:
        """Return the spectrum of the time derivative of a signal, (F,)."""
        return np.asarray(1j * self.omega * self.of(signal)
                          - self._transformed(self.slope, signal))

    def acceleration_of(self, signal: Array) -> Array:
        """Return the spectrum of the second time derivative of a signal, (F,)."""
        return np.asarray(-self.omega**2 * self.of(signal)
                          - 2j * self.omega * self._transformed(self.slope, signal)
                          + self._transformed(self.bend, signal))

    def of_means(self, means: Array) -> Array:
        """Return the spectrum of a signal from its means over the steps about the rows, (F,)."""
        return np.asarray(self.of(means) / np.sinc(self.omega * self.step / (2.0 * np.pi)))

    def delayed(self, signal: Array) -> 'DelayedSpectrum':
        """Return the spectra of a signal that is late by any small time."""
        parts = [self._transformed(window, signal)
                 for window in (self.window, self.slope, self.bend)]
        return DelayedSpectrum(self.omega, *parts)

    @property
    def gain(self) -> float:
        """Return the variance of a spectrum of white noise of variance 1."""
        return float(self.window @ self.window)

    def _transformed(self, window: Array, signal: Array) -> Array:
        """Return the Fourier transform of a windowed signal in the band."""
        return np.asarray(np.fft.rfft(window * signal, self.size)[:len(self.omega)])


class DelayedSpectrum(NamedTuple):
    """
    Spectrum of a signal that is late by d: <w e, x(t - d)> = exp(-j omega d) <w(t + d) e, x>.

    The window moves by its Taylor series, since a delay is short beside its rise.
    """

    omega: Array
    windowed: Array
    sloped: Array
    bent: Array

    def by(self, delay: float, held: float = 0.0) -> Array:
        """
        Return the spectrum of the signal late by a time, s, (F,).

        A signal whose values are each held for a time, s, about the delay, has less of
        high frequencies.
        """
        moved = self.windowed + delay * (self.sloped + 0.5 * delay * self.bent)
        flattened = np.sinc(self.omega * held / (2.0 * np.pi))
        return np.asarray(flattened * np.exp(-1j * self.omega * delay) * moved)


def spectra(count: int, step: float, highest: float) -> Spectra:
    """Return the spectra of a number of rows up to a frequency, Hz."""
    length = max(int(TAPER * count), 8)
    # Filters of the motion start and end within this margin, where the window is 0.
    margin = min(int(PERIODS / (BEYOND_BAND * highest * step)), count // 8)
    inner = count - 2 * margin
    window = np.ones(inner)
    slope = np.zeros(inner)
    bend = np.zeros(inner)
    # Up to the third derivative, the window is continuous: sums over rows are integrals.
    rise = np.polynomial.Polynomial(RISE)
    x = np.arange(length) / length
    span = length * step
    rising = rise(x)
    climbing = rise.deriv()(x) / span
    bending = rise.deriv(2)(x) / span**2
    # The same rise backwards at the end, where its slope has the other sign.
    window[:length] = rising
    window[inner - length:] = rising[::-1]
    slope[:length] = climbing
    slope[inner - length:] = -climbing[::-1]
    bend[:length] = bending
    bend[inner - length:] = bending[::-1]
    window, slope, bend = (np.pad(part, margin) for part in (window, slope, bend))
    size = int(scientific('scipy.fft').next_fast_len(count, real=True))
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(size, step), dtype=np.float64)
    inside = omega <= 2.0 * np.pi * highest
    return Spectra(step, window, slope, bend, omega[inside], size)


def white_noise(signals: Array, step: float) -> Array:
    """
    Return the standard deviation of the white noise of signals (N, n), (n,).

    It is that of the highest frequencies, at which no arm moves. The median of the power
    there ignores single lines, as of a switching converter.
    """
    power, frequency = _power(signals, step)
    high = power[frequency > QUIET * 0.5 / step]
    return np.asarray(np.sqrt(np.median(high, axis=0) / np.log(2.0)))


def audible_band(signals: Array, noise: Array, step: float) -> float:
    """Return the frequency up to which signals (N, n) stand above their noise, Hz."""
    power, frequency = _power(signals, step)
    # Means over neighboring frequencies vary less than single ones.
    width = max(len(power) // 200, 5)
    kernel = np.ones(width) / width
    highest = LEAST_BINS / (step * len(signals))
    for of_signal, deviation in zip(power.T, noise, strict=True):
        mean = np.convolve(of_signal, kernel, mode='same')
        above = frequency[mean > AUDIBLE * max(deviation**2, 1e-30)]
        if len(above):
            highest = max(highest, float(above[-1]))
    return min(highest, WIDEST * 0.5 / step)


def _power(signals: Array, step: float) -> tuple[Array, Array]:
    """Return the power of signals, (F, n), 1 for white noise of 1, and the frequencies, Hz."""
    window = np.hanning(len(signals))[:, None]
    middle = signals - signals.mean(axis=0)
    power = np.abs(np.fft.rfft(window * middle, axis=0))**2 / float(np.sum(window**2))
    frequency = np.asarray(np.fft.rfftfreq(len(signals), step), dtype=np.float64)
    return power, frequency


class SmoothSpeed(NamedTuple):
    """
    Speed of one joint, filtered as little as its noise allows.

    Attributes
    ----------
    values : (N,) array
        rad/s or m/s.
    noise : float
        Standard deviation.
    density : float
        Variance of its spectrum in the band, over that of white noise of 1.

    """

    values: Array
    noise: float
    density: float


def smooth_speeds(positions: Array, noise: Array, step: float, band: float
                  ) -> list[SmoothSpeed]:
    """
    Return the speeds of positions (N, n) with noise (n,), for the reversals of friction.

    Friction reverses faster than the band; the filter leaves what the noise allows.
    """
    nyquist = 0.5 / step
    speeds = []
    for position, deviation in zip(positions.T, noise, strict=True):
        # Noise of the speed below a cutoff: the integral of (2 pi f deviation)^2 / nyquist.
        ratio = SPEED_NOISE / (2.0 * np.pi * max(deviation, 1e-15))
        cutoff = float(np.cbrt(3.0 * nyquist * ratio**2))
        # At least beyond the band of the equations, at most below the Nyquist
        # frequency.
        cutoff = min(max(cutoff, BEYOND_BAND * band), 0.8 * nyquist)
        values = smooth_motion(position[:, None], step, cutoff)[1][:, 0]
        variance = (2.0 * np.pi * deviation)**2 * cutoff**3 / (3.0 * nyquist)
        speeds.append(SmoothSpeed(values, float(np.sqrt(variance)),
                                  float(variance * nyquist / cutoff)))
    return speeds


def smooth_motion(q: Array, step: float, cutoff: float) -> tuple[Array, Array, Array]:
    """Return positions below a frequency, Hz, with speeds and accelerations, (N, n) each."""
    signal = scientific('scipy.signal')
    sections = signal.butter(FILTER_ORDER, cutoff, output='sos', fs=1.0 / step)
    smooth = signal.sosfiltfilt(sections, q, axis=0)
    t = step * np.arange(len(q))
    spline = scientific('scipy.interpolate').make_interp_spline(t, smooth, k=5)
    return smooth, spline(t, nu=1), spline(t, nu=2)
