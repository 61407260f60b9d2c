"""
Fastest motion along a line that has limits of speed, acceleration and jerk in sections.

Within a section the speed rises, stays and falls with limited acceleration and jerk (a
"double S"); the acceleration is zero at both ends of every section. Source: L.
Biagiotti, C. Melchiorri, "Trajectory Planning for Automatic Machines and Robots", 2008,
section 3.4.
"""

from collections.abc import Callable, Sequence
import math
from typing import NamedTuple

from kane_dynamics._util.typing import Array
import numpy as np

HALVINGS = 200  # of an interval of speeds, until it is empty to rounding


class SectionLimits(NamedTuple):
    """
    A section of a line: its length, and the largest speed, acceleration and jerk on it.

    On a `steady` section the speed does not change.
    """

    length: float
    speed: float
    acceleration: float
    jerk: float
    steady: bool = False


class Progress(NamedTuple):
    """Place on the line, its speed and its acceleration at N times, (N,) each."""

    place: Array
    speed: Array
    acceleration: Array


class SpeedProfile:
    """
    A motion along a line in phases of constant jerk, from rest to rest.

    Attributes
    ----------
    times : (K + 1,) array
        Ends of the phases, s, from 0.
    duration : float
        s.

    """

    def __init__(self, times: Array, states: Array, jerks: Array) -> None:
        """Store place, speed and acceleration at the start of each phase, (K, 3)."""
        self.times = times
        self.duration = float(times[-1])
        self._states = states
        self._jerks = jerks

    def scaled(self, duration: float) -> 'SpeedProfile':
        """Return the same motion in another duration, s."""
        rate = self.duration / duration
        return SpeedProfile(self.times / rate, self._states * rate**np.arange(3.0),
                            self._jerks * rate**3)

    def sample(self, t: Array) -> Progress:
        """Return the state at times from 0 to the duration, (N,), s."""
        # Times beyond the ends belong to the first and the last phase.
        phase = np.searchsorted(self.times, t, side='right') - 1
        phase = np.clip(phase, 0, len(self._jerks) - 1)
        place, speed, acceleration = self._states[phase].T
        jerk = self._jerks[phase]
        dt = t - self.times[phase]
        return Progress(
            place + dt * (speed + dt * (acceleration / 2.0 + dt * jerk / 6.0)),
            speed + dt * (acceleration + dt * jerk / 2.0),
            acceleration + dt * jerk)


def fastest_profile(sections: Sequence[SectionLimits], stops: Sequence[bool]
                    ) -> SpeedProfile:
    """
    Return the fastest motion whose acceleration is zero at the ends of all sections.

    Parameters
    ----------
    sections : sequence of K SectionLimits
        Of positive length, with positive limits; a steady section is next to no stop.
    stops : sequence of K - 1 bool
        Whether the motion rests between two sections.

    """
    speeds = _speeds_between(sections, stops)
    durations: list[float] = []
    states: list[tuple[float, float, float]] = []
    jerks: list[float] = []
    end = 0.0

    # Phases of constant jerk, each integrated exactly: cubic place, quadratic speed.
    for section, first, last in zip(sections, speeds, speeds[1:]):
        place = end
        speed, acceleration = first, 0.0
        for duration, jerk in _phases(section, first, last):
            durations.append(duration)
            states.append((place, speed, acceleration))
            jerks.append(jerk)
            place += duration * (speed + duration * (acceleration / 2.0
                                                     + duration * jerk / 6.0))
            speed += duration * (acceleration + duration * jerk / 2.0)
            acceleration += duration * jerk
        # Sections begin at their exact place, whatever rounding the phases have.
        end += section.length
    times = np.concatenate([[0.0], np.cumsum(durations)])
    return SpeedProfile(times, np.array(states), np.array(jerks))


def _speeds_between(sections: Sequence[SectionLimits], stops: Sequence[bool]
                    ) -> list[float]:
    """Return the largest speeds at the ends of the sections, (K + 1)."""
    # At a corner where the motion stops, 0; elsewhere the slower section decides.
    speeds = [0.0]
    for before, after, stop in zip(sections, sections[1:], stops):
        speeds.append(0.0 if stop else min(before.speed, after.speed))
    speeds.append(0.0)
    # What the sections let the speed rise from the start, then from the end backwards.
    for k, section in enumerate(sections):
        speeds[k + 1] = min(speeds[k + 1], _reached(section, speeds[k]))
    for k in range(len(sections) - 1, -1, -1):
        speeds[k] = min(speeds[k], _reached(sections[k], speeds[k + 1]))
    return speeds


def _reached(section: SectionLimits, speed: float) -> float:
    """Return the largest speed at the end of a section that begins with a speed."""
    if section.steady:
        return speed
    return _largest(section, speed, lambda top: _distance(section, speed, top))


def _phases(section: SectionLimits, first: float, last: float
            ) -> list[tuple[float, float]]:
    """Return durations and jerks of the phases of a section."""
    # A blend is passed at constant speed.
    if section.steady:
        return [(section.length / first, 0.0)]

    def distance(top: float) -> float:
        return _distance(section, first, top) + _distance(section, top, last)

    # The fastest speed in between whose rise and fall fit into the section.
    top = _largest(section, max(first, last), distance)
    remaining = max(section.length - distance(top), 0.0)
    phases = _change(section, first, top)
    phases.append((remaining / top, 0.0))
    phases += _change(section, top, last)
    return [(duration, jerk) for duration, jerk in phases if duration > 0.0]


def _largest(section: SectionLimits, low: float, distance: Callable[[float], float]
             ) -> float:
    """Return the largest speed from `low` on whose distance fits into a section."""
    # A bound from above: the stated speed, or one found by doubling.
    high = section.speed
    if math.isinf(high):
        high = max(low, 1e-300)
        while distance(high) <= section.length:
            high *= 2.0
    elif distance(high) <= section.length:
        return high
    # The distance grows with the speed.
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if distance(middle) <= section.length:
            low = middle
        else:
            high = middle
    return low


def _distance(section: SectionLimits, first: float, last: float) -> float:
    """Return the distance in which a speed changes: the mean speed, by the symmetry."""
    ramp, steady = _durations(section, abs(last - first))
    return 0.5 * (first + last) * (2.0 * ramp + steady)


def _durations(section: SectionLimits, change: float) -> tuple[float, float]:
    """Return the durations of a ramp of the acceleration, and of its largest value."""
    full_ramp = section.acceleration / section.jerk
    if change > section.acceleration * full_ramp:
        return full_ramp, change / section.acceleration - full_ramp
    return math.sqrt(change / section.jerk), 0.0


def _change(section: SectionLimits, first: float, last: float
            ) -> list[tuple[float, float]]:
    """Return the phases in which a speed changes."""
    change = abs(last - first)
    ramp, steady = _durations(section, change)
    if not ramp:
        return []
    # A short ramp has less than the largest jerk by its rounding.
    jerk = math.copysign(change / (ramp * (ramp + steady)), last - first)
    return [(ramp, jerk), (steady, 0.0), (ramp, -jerk)]
