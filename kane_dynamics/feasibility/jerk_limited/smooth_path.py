"""
Paths with three derivatives along their parameter s, on a grid between two rests.

The jerk of a motion along q(s) contains q_sss, so the path must have a continuous q_ss.
Its pieces are quintics, which reproduce cubics and quintics of a motion. The parameter
is a smooth function of the motion's time: at both ends q(s) - q(end) begins with the
third power of s, so that a motion from rest with finite jerk has a positive, finite s'
there. q_sss jumps at points of the motion. These are vertices of the grid, unless they
are closer together than the grid is fine.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.path_geometry import FEWEST, Section, STILL
from kane_dynamics.motion.controller_points import ControllerPoints, Segments
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.rests import rests
import numpy as np

MESH, FINER = 400, 8  # intervals on which lengths are computed, and least per piece
AT_REST = 1e-9  # speed, relative to the mean one
NO_ACCELERATION = 1e-6  # relative to length / duration^2
JUMP = 1e-6  # of an acceleration or a jerk, relative to the largest one
DEVIATION = 1e-4  # of a smoothed path, relative to its length
DIVISIONS = 2  # of an interval of the grid, at which limits count
APART = 0.3  # intervals between two points of the motion that are vertices


class SmoothSection(NamedTuple):
    """
    A path from rest to rest on a grid.

    Derivatives are stored at P points. The first ones increase from s = 0 to 1 and
    divide each of the N intervals of the grid equally; the vertices at which q_sss jumps
    follow once more, with the values on their left side.

    Attributes
    ----------
    s : (N + 1,) array
        The parameter at the vertices, from 0 to 1.
    place : (P,) array
        The parameter at the points.
    vertex : (P,) array of int
        Of each point, its number or that of the point at the same place.
    section : Section
        The path and its derivatives q_s and q_ss at the points.
    third : (P, n) array
        q_sss.

    """

    s: Array
    place: Array
    vertex: Segments
    section: Section
    third: Array

    @property
    def size(self) -> int:
        """Return the number of points at different places."""
        return int(self.vertex.max()) + 1


def smooth_sections(motion: Motion, points: int) -> list[SmoothSection]:
    """
    Return the sections of a motion between rests, without dwells.

    Raises
    ------
    InputError
        If the motion does not move, or its acceleration jumps between rests by so much
        that a path without the jumps deviates from it.

    """
    parts = [_Part(motion, begin, end) for begin, end in pairwise(rests(motion))]
    total = sum(part.length for part in parts)
    if not total > 0.0:
        raise InputError(f'path: rests at {motion.positions[0].tolist()}; expected a '
                         'path that moves')
    # Each part gets its share of the points; a dwell has no length.
    smooth = []
    for part in parts:
        if part.length > 1e-12 * total:
            intervals = max(FEWEST, round(points * part.length / total))
            smooth.append(part.sampled(intervals))
    return smooth


class _Part:
    """The part of a motion between two rests."""

    def __init__(self, motion: Motion, begin: float, end: float) -> None:
        knots = motion.times
        inner = knots[(knots > begin) & (knots < end)]
        self.t = np.concatenate([[begin], inner, [end]])
        # States on both sides of the points; accelerations become continuous by their
        # means.
        q_right, u_right, udot_right = motion.sample(self.t[:-1])
        q_left, u_left, udot_left = motion.sample(np.nextafter(self.t[1:], -np.inf))
        q = np.concatenate([q_right[:1], q_left])
        u = np.concatenate([u_right[:1], u_left])
        udot = np.concatenate([udot_right[:1], udot_left])
        jump = udot_right[1:] - udot_left[:-1]
        udot[1:-1] += 0.5 * jump
        self.points = ControllerPoints(self.t, q, u, udot)
        self.coefficients = self.points.coefficients
        # Lengths, on a mesh.
        count = max(MESH, FINER * (len(self.t) - 1))
        self.mesh = np.linspace(begin, end, count + 1)
        q_middle, u_middle, _ = motion.sample(0.5 * (self.mesh[1:] + self.mesh[:-1]))
        pieces = np.linalg.norm(u_middle, axis=1) * np.diff(self.mesh)
        self.length = float(pieces.sum())
        self.arc = np.concatenate([[0.0], np.cumsum(pieces)])
        least = STILL * np.ptp(motion.positions, axis=0).max()
        self.still = (np.ptp(q, axis=0) <= least) & (np.ptp(q_middle, axis=0) <= least)
        if np.abs(jump).max(initial=0.0) > JUMP * np.abs(udot).max():
            self._check_deviation(motion, jump)

    def _check_deviation(self, motion: Motion, jump: Array) -> None:
        """Raise InputError if the path deviates to avoid jumps of acceleration."""
        # Three places within each piece.
        h = np.diff(self.t)
        t = np.concatenate([self.t[:-1] + x * h for x in (0.25, 0.5, 0.75)])
        pieces = np.tile(np.arange(len(h)), 3)
        q = self.derivatives(t, pieces)[0]
        if np.abs(q - motion.positions_at(t)).max() > DEVIATION * self.length:
            k, j = np.unravel_index(int(np.abs(jump).argmax()), jump.shape)
            raise InputError(
                f"path: acceleration of joint '{motion.joint_names[int(j)]}' jumps by "
                f'{abs(jump[k, j]):.4g} at {self.t[k + 1]:.6g} s of the motion; '
                'expected a continuous one with limits of jerk or torque rate, as that '
                'of waypoints, or rests where it jumps')

    def derivatives(self, t: Array, pieces: Segments
                    ) -> tuple[Array, Array, Array, Array]:
        """Return q and three derivatives along the time, (K, n), in some pieces."""
        h = np.diff(self.t)[pieces][:, None]
        x = (t - self.t[pieces])[:, None] / h
        table = self.coefficients[pieces]
        derivatives = []
        # Horner's scheme with the factors of the differentiated powers.
        for order in range(4):
            value = np.zeros_like(table[:, 0])
            for power in range(5, order - 1, -1):
                factor = np.prod(np.arange(power - order + 1, power + 1))
                value = value * x + factor * table[:, power]
            derivatives.append(value / h**order)
        return derivatives[0], derivatives[1], derivatives[2], derivatives[3]

    def _powers(self) -> list[int]:
        """Return the exponents p of s ~ t^p near both ends: 1, 2, or 3 from rest."""
        span = self.t[-1] - self.t[0]
        powers = []
        for end in (0, -1):
            # Relative to the mean speed and acceleration over the span: what is tiny
            # counts as rest.
            speed = np.abs(self.points.u[end]).max()
            acceleration = np.abs(self.points.udot[end]).max()
            if speed * span > AT_REST * self.length:
                powers.append(1)
            elif acceleration * span**2 > NO_ACCELERATION * self.length:
                powers.append(2)
            else:
                powers.append(3)
        return powers

    def sampled(self, intervals: int) -> SmoothSection:
        """Return the section on a grid of about so many intervals."""
        powers = self._powers()
        span = float(self.t[-1] - self.t[0])
        alpha, beta = 3.0 / powers[0], 3.0 / powers[1]
        share = (self.mesh - self.mesh[0]) / span
        # The share S of the time is s^alpha / (s^alpha + (1 - s)^beta).
        guess = _parameter(share, alpha, beta)
        measure = 0.5 * (guess + self.arc / self.length)
        s, knots = self._grid(max(8, intervals // DIVISIONS), guess, measure)
        place = _divided(s)
        fine = np.full(len(place), -1)  # the motion's point at each place, or -1
        fine[::DIVISIONS] = knots
        t = self.t[0] + span * _share(place, alpha, beta)
        exact = np.flatnonzero(fine >= 0)
        t[exact] = self.t[fine[exact]]
        pieces = np.searchsorted(self.t, t, side='right') - 1
        pieces = np.clip(pieces, 0, len(self.t) - 2)
        inner = self._jumps(t, exact[1:-1], fine)
        vertex = np.concatenate([np.arange(len(t)), inner])
        rows = self.derivatives(t[vertex], np.concatenate([pieces, fine[inner] - 1]))
        q, first, second, third = self._by_parameter(place[vertex], rows, powers, span)
        for derivative in (first, second, third):
            derivative[:, self.still] = 0.0
        q[:, self.still] = q[0, self.still]
        section = Section(q, first, second, q.min(axis=0), q.max(axis=0), span)
        return SmoothSection(s, place[vertex], vertex, section, third)

    def _jumps(self, t: Array, at: Segments, knots: Segments) -> Segments:
        """Return the points of the motion at which its jerk jumps."""
        if not at.size:
            return at
        sides = [self.derivatives(t[at], knots[at] - k)[3] for k in (0, 1)]
        jump = np.abs(sides[0] - sides[1]).max(axis=1)
        return np.asarray(at[jump > JUMP * np.abs(sides).max()])

    def _grid(self, intervals: int, guess: Array, measure: Array
              ) -> tuple[Array, Segments]:
        """Return the vertices, and the numbers of the motion's points at them or -1."""
        # Points of the motion that are far enough from each other become vertices.
        at = np.interp(self.t, self.mesh, measure)
        distant = [0]  # points of the motion that are vertices
        for k in range(1, len(at) - 1):
            if min(at[k] - at[distant[-1]], 1.0 - at[k]) * intervals > APART:
                distant.append(k)
        distant.append(len(at) - 1)
        # Between them, vertices at equal steps of the measure.
        values = [np.zeros(1)]
        numbers = [np.zeros(1, dtype=np.intp)]
        for first, last in pairwise(distant):
            rise = at[last] - at[first]
            count = max(1, int(np.ceil(rise * intervals - 1e-6)))
            values.append(at[first] + rise * np.arange(1, count + 1) / count)
            numbers.append(np.full(count, -1))
            numbers[-1][-1] = last
        s = np.interp(np.concatenate(values), measure, guess)
        s[0] = 0.0
        s[-1] = 1.0
        # The points of the motion are at vertices exactly.
        knots = np.concatenate(numbers)
        share = (self.t - self.t[0]) / (self.t[-1] - self.t[0])
        exact = np.flatnonzero(knots >= 0)[1:-1]
        powers = self._powers()
        alpha, beta = 3.0 / powers[0], 3.0 / powers[1]
        s[exact] = _parameter(share[knots[exact]], alpha, beta)
        return s, knots

    def _by_parameter(self, s: Array, rows: Sequence[Array], powers: Sequence[int],
                      span: float) -> tuple[Array, Array, Array, Array]:
        """Return q, q_s, q_ss and q_sss from derivatives with respect to time."""
        q, u, udot, jerk = rows
        first, second, third = np.zeros((3, *q.shape))
        inside = (s > 0.0) & (s < 1.0)
        # Derivatives of the time with respect to s, and the chain rule.
        slopes = _share_slopes(s[inside], 3.0 / powers[0], 3.0 / powers[1])
        one, two, three = (span * slope[:, None] for slope in slopes)
        u, udot, jerk = u[inside], udot[inside], jerk[inside]
        first[inside] = u * one
        second[inside] = udot * one**2 + u * two
        third[inside] = jerk * one**3 + 3.0 * udot * one * two + u * three
        # At rest only the third derivative remains.
        last = int(s.argmax())
        for place, power, sign in ((0, powers[0], 1.0), (last, powers[1], -1.0)):
            factor = 6.0 / np.prod(np.arange(1, power + 1)) * (sign * span)**power
            third[place] = sign * factor * rows[power][place]
        return q, first, second, third


def _divided(s: Array) -> Array:
    """Return the vertices and equal divisions of the intervals between them."""
    inner = s[:-1, None] + np.diff(s)[:, None] * np.arange(DIVISIONS) / DIVISIONS
    return np.append(inner.ravel(), 1.0)


def _share(s: Array, alpha: float, beta: float) -> Array:
    left, right = s**alpha, (1.0 - s)**beta
    return np.asarray(left / (left + right))


def _share_slopes(s: Array, alpha: float, beta: float) -> tuple[Array, Array, Array]:
    """Return three derivatives of the share, which is a logistic function of g(s)."""
    share = _share(s, alpha, beta)
    g1 = alpha / s + beta / (1.0 - s)
    g2 = beta / (1.0 - s)**2 - alpha / s**2
    g3 = 2.0 * (alpha / s**3 + beta / (1.0 - s)**3)
    both = share * (1.0 - share)
    odd = 1.0 - 2.0 * share
    return (both * g1, both * (odd * g1**2 + g2),
            both * ((1.0 - 6.0 * both) * g1**3 + 3.0 * odd * g1 * g2 + g3))


def _parameter(share: Array, alpha: float, beta: float) -> Array:
    """Return the path parameter s, 0 to 1, at fractions of the duration, by bisection."""
    low, high = np.zeros_like(share), np.ones_like(share)
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = _share(middle, alpha, beta) < share
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)
