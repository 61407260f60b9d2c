"""
Paths of poses: lines, circles and what joins them, as functions of a parameter s.

Orientations turn about fixed axes, which is along geodesics of SO(3). At a corner the
path rests, or two pieces overlap: the one before ends while the one after begins, both
by a smooth polynomial. With first, second and third derivatives by s, of the origin and
of the orientation (angular velocity, its derivatives), limits on speed, acceleration and
jerk become limits on s(t).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from kane_dynamics._util.checks import constant, finite_row, number, real_numbers
from kane_dynamics._util.fixed_attributes import fixed
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.poses import checked_pose, pose_error, rotation_exp
from kane_dynamics.motion.speed_profile import SectionLimits
import numpy as np
from numpy.typing import ArrayLike, NDArray

RADIUS = 0.3  # m/rad: a turn of 1 rad counts as much as this distance in s
FARTHEST = 1e12  # m
MOST_TURNS = 1e6  # rad, of an arc
SHORTEST = 1e-9  # of a piece, m or RADIUS rad
JOINED = 1e-9  # m or rad between the end of a piece and the start of the next
SMOOTH = 1e-9  # relative difference of derivatives at a joint that needs no blend
HALF_TURN = 1e-6  # rad from half a turn, whose axis is not determined
STRAIGHT = 1e-9  # of three points, relative: they determine no circle
SAMPLES = 129  # of a blend, for its deviation and its largest derivatives
HALVINGS = 50  # of the length of a blend
MARGIN = 1e-3  # of the limits of a blend, for its derivatives between samples


class Corner(NamedTuple):
    """
    A joint of two pieces of a `PosePath`.

    `place` is its fraction of the path. Where the path rests, `rests`, it goes through
    the corner; else it passes within `distance`, m, and `angle`, rad, of the pieces
    without the blend, which are the largest on the whole blend.
    """

    place: float
    distance: float
    angle: float
    rests: bool


class Derivatives(NamedTuple):
    """Derivatives by s at N places, (N, 6) each: linear, then those of the orientation."""

    first: Array
    second: Array
    third: Array


@dataclass(frozen=True, eq=False)
class _Piece:
    """
    A line or an arc with a turn about a fixed axis, at unit rate of s.

    The origin moves with `velocity`, or turns about `center` with `circling`, a rotation
    vector per unit of s; `turning` is that of the orientation.
    """

    length: float
    origin: Array
    rotation: Array
    turning: Array
    velocity: Array
    center: Array
    circling: Array

    def positions(self, s: Array) -> Array:
        """Return the origin at places, (N, 3)."""
        if not self.circling.any():
            return np.asarray(self.origin + s[:, None] * self.velocity)
        turned = rotation_exp(s[:, None] * self.circling)
        return np.asarray(self.center + turned @ (self.origin - self.center))

    def rotations(self, s: Array) -> Array:
        """Return the orientations at places, (N, 3, 3)."""
        return np.asarray(rotation_exp(s[:, None] * self.turning) @ self.rotation)

    def linear(self, s: Array) -> tuple[Array, Array, Array]:
        """Return the derivatives of the origin at places, (N, 3) each."""
        zeros = np.zeros((len(s), 3))
        if not self.circling.any():
            return zeros + self.velocity, zeros, zeros
        radius = self.positions(s) - self.center
        first = np.cross(self.circling, radius)
        second = np.cross(self.circling, first)
        return first, second, np.cross(self.circling, second)

    def derivatives(self, s: Array) -> Derivatives:
        """Return the derivatives at places."""
        first, second, third = self.linear(s)
        zeros = np.zeros((len(s), 3))
        return Derivatives(np.hstack([first, zeros + self.turning]),
                           np.hstack([second, zeros]), np.hstack([third, zeros]))

    def limits(self, length: float, linear: Array, angular: Array) -> SectionLimits:
        """Return the limits of the rate of s on a part of the piece."""
        l1, l2, l3 = (float(np.linalg.norm(part[0]))
                      for part in self.linear(np.zeros(1)))
        turn = float(np.linalg.norm(self.turning))
        speed, acceleration, jerk = _least(_over(linear, l1), _over(angular, turn))
        if not l2:
            return SectionLimits(length, speed, acceleration, jerk)
        # On a circle the squares of the tangential and the normal acceleration add up:
        # half for each. The jerk is l1 s''' - l3 s'^3 along it and 3 l2 s' s'' across:
        # a third for each part along it, what is left of the square across.
        share = np.sqrt(0.5)
        speed = min(speed, np.sqrt(share * linear[1] / l2), np.cbrt(linear[2] / 3 / l3))
        across = np.sqrt(1.0 - 4.0 / 9.0) * linear[2] / (3.0 * l2 * speed)
        acceleration = min(acceleration, share * linear[1] / l1, across)
        return SectionLimits(length, float(speed), float(acceleration),
                             min(jerk, float(linear[2]) / 3.0 / l1))


@dataclass(frozen=True, eq=False)
class _Blend:
    """
    Two pieces that overlap around their joint, x from -half to half at unit rate.

    The piece before is at a(x) = -g(-x) from its end, the one after at b(x) = g(x): g is
    0 until -half and x from half on. So the rates of a and b add up to 1.
    """

    before: _Piece
    after: _Piece
    half: float

    def overlap(self, x: Array) -> tuple[list[Array], list[Array]]:
        """Return a and b and their three derivatives at x, (N, 1) each."""
        half = self.half
        z = x[:, None] / half
        # The second derivative is a bump 15/16 (1 - z^2)^2 / half, whose integral is 1.
        g2 = 15.0 / 16.0 * (1.0 - z**2)**2 / half
        g3 = -15.0 / 4.0 * z * (1.0 - z**2) / half**2
        g1 = 0.5 + (15.0 * z - 10.0 * z**3 + 3.0 * z**5) / 16.0
        g = half * (5.0 + 16.0 * z + 15.0 * z**2 - 5.0 * z**4 + z**6) / 32.0
        return [x[:, None] - g, 1.0 - g1, -g2, -g3], [g, g1, g2, g3]

    def positions(self, x: Array) -> Array:
        """Return the origin, (N, 3)."""
        a, b = self.overlap(x)
        before = self.before.positions(self.before.length + a[0][:, 0])
        return before + self.after.positions(b[0][:, 0]) - self.after.origin

    def rotations(self, x: Array) -> Array:
        """Return the orientations, (N, 3, 3)."""
        a, b = self.overlap(x)
        before = self.before.rotations(self.before.length + a[0][:, 0])
        return np.asarray(rotation_exp(b[0] * self.after.turning) @ before)

    def derivatives(self, x: Array) -> Derivatives:
        """Return the derivatives at x."""
        a, b = self.overlap(x)
        # The chain rule for both pieces, whose displacements add up.
        linear = np.zeros((3, len(x), 3))
        places = (self.before.length + a[0][:, 0], b[0][:, 0])
        for piece, s, (_, s1, s2, s3) in zip((self.before, self.after), places, (a, b)):
            p1, p2, p3 = piece.linear(s)
            linear[0] += p1 * s1
            linear[1] += p2 * s1**2 + p1 * s2
            linear[2] += p3 * s1**3 + 3.0 * p2 * s1 * s2 + p1 * s3
        # The turn after carries the axis of the turn before with it.
        after = np.broadcast_to(self.after.turning, (len(x), 3))
        axis = rotation_exp(b[0] * after) @ self.before.turning
        axis1 = b[1] * np.cross(after, axis)
        axis2 = b[2] * np.cross(after, axis) + b[1] * np.cross(after, axis1)
        first = after * b[1] + axis * a[1]
        second = after * b[2] + axis * a[2] + axis1 * a[1]
        third = after * b[3] + axis * a[3] + 2.0 * axis1 * a[2] + axis2 * a[1]
        return Derivatives(np.hstack([linear[0], first]), np.hstack([linear[1], second]),
                           np.hstack([linear[2], third]))

    def deviation(self) -> tuple[float, float]:
        """Return the largest distance and angle from the pieces without the blend."""
        # The sharp corner: the end of the piece before, then the beginning of the one
        # after.
        x = np.linspace(-self.half, self.half, SAMPLES)
        sharp = np.zeros((SAMPLES, 4, 4))
        for piece, s, rows in ((self.before, self.before.length + x, x < 0.0),
                               (self.after, x, x >= 0.0)):
            sharp[rows] = _homogeneous(piece, s[rows])
        error = pose_error(sharp, _homogeneous(self, x))
        return (float(np.linalg.norm(error[:, :3], axis=1).max()),
                float(np.linalg.norm(error[:, 3:], axis=1).max()))

    def limits(self, length: float, linear: Array, angular: Array) -> SectionLimits:
        """Return the largest constant rate of s."""
        # A derivative of order m grows with rate^m, so that each bound limits the rate
        # by its m-th root.
        x = np.linspace(-self.half, self.half, SAMPLES)
        speed = np.inf
        for k, derivative in enumerate(self.derivatives(x)):
            for bound, part in ((linear, derivative[:, :3]), (angular, derivative[:, 3:])):
                largest = float(np.linalg.norm(part, axis=1).max())
                if largest > 0.0:
                    speed = min(speed, float(bound[k] / largest)**(1.0 / (k + 1)))
        return SectionLimits(length, (1.0 - MARGIN) * speed, np.inf, np.inf, steady=True)


class _Joint(NamedTuple):
    """The blend of two pieces: half its length, 0 for none, and whether the motion rests."""

    half: float
    rests: bool


class _Section(NamedTuple):
    """A part of a path: the curve, and the place on the curve at which it begins."""

    curve: _Piece | _Blend
    begin: float
    length: float


@fixed
class PosePath:
    """
    A path of poses, or of positions: pieces with corners that are blended or rest.

    Create one with `PosePath.through`, `PosePath.arc` or `PosePath.circle`, and join
    several with `PosePath.joined`. The parameter s runs from 0 to `length`, in m, where
    a turn of 1 rad counts at least as much as 0.3 m.

    Attributes
    ----------
    length : float
    oriented : bool
        False for a path of positions, along which the orientation is free.
    corners : tuple of Corner
        The joints of the pieces, with the deviations of their blends.

    """

    def __init__(self, pieces: Sequence[_Piece], oriented: bool, blend: float,
                 blend_angle: float) -> None:
        """Store pieces, the next of which begins where the last one ends."""
        self.oriented = oriented
        self._pieces = tuple(pieces)
        joints = []
        for piece, following in pairwise(pieces):
            joints.append(_joint(piece, following, blend, blend_angle))
        joints.append(_Joint(0.0, False))  # the end of the path

        # Of each piece, what the blends at its ends leave; then the blend with the next.
        sections: list[_Section] = []
        stops: list[bool] = []
        corners: list[Corner] = []
        total = sum(piece.length for piece in pieces)
        passed = 0.0
        begin = 0.0  # of what the last blend has left of the piece
        for k, piece in enumerate(pieces):
            joint = joints[k]
            straight = piece.length - begin - joint.half
            if straight > SHORTEST * piece.length:
                sections.append(_Section(piece, begin, straight))
                stops.append(joint.rests)
            begin = joint.half
            passed += piece.length
            if k == len(pieces) - 1:
                break
            distance = angle = 0.0
            if joint.half:
                curve = _Blend(piece, pieces[k + 1], joint.half)
                distance, angle = curve.deviation()
                sections.append(_Section(curve, -joint.half, 2.0 * joint.half))
                stops.append(False)
            corners.append(Corner(passed / total, distance, angle, joint.rests))
        self._sections = tuple(sections)
        lengths = [section.length for section in sections]
        self._starts = np.concatenate([[0.0], np.cumsum(lengths)])
        self.length = float(self._starts[-1])
        self.corners = tuple(corners)
        self.stops = tuple(stops[:-1])  # between two sections

    def __repr__(self) -> str:
        """Return the number of pieces and the ends."""
        what = 'poses' if self.oriented else 'positions'
        ends = self.poses(np.array([0.0, self.length]))[:, :3, 3].round(4).tolist()
        return (f'<PosePath of {what} in {len(self._pieces)} pieces from {ends[0]} to '
                f'{ends[1]}>')

    @classmethod
    def through(cls, poses: ArrayLike, *, blend: float = 0.0,
                blend_angle: float = 0.05) -> PosePath:
        """
        Return the path along straight lines through poses, or through positions.

        Between two poses the orientation turns about a fixed axis, the shorter way.

        Parameters
        ----------
        poses : (K, 4, 4) or (K, 3) array_like
            In the world, m; K at least 2.
        blend : float
            Largest distance between the lines and the path where it rounds a corner, m;
            0 rests at every corner.
        blend_angle : float
            Largest angle between both orientations there, rad.

        Raises
        ------
        InputError
            An argument is invalid, or two poses in a row are equal or half a turn apart.

        """
        stated, oriented = _stated(poses)
        if len(stated) < 2:
            raise InputError('poses: one; expected two or more')
        pieces = []
        # A line in space, and one rotation about a fixed axis, at constant rates.
        for k, (start, end) in enumerate(pairwise(stated)):
            error = pose_error(start, end)
            names = f'poses {k} and {k + 1}'
            _require_turn(error[3:], names)
            length = _parameter(float(np.linalg.norm(error[:3])), error[3:], names)
            pieces.append(_line(start, length, error[:3], error[3:]))
        return cls(pieces, oriented, *_checked_blend(blend, blend_angle))

    @classmethod
    def arc(cls, start: ArrayLike, via: ArrayLike, end: ArrayLike) -> PosePath:
        """
        Return the circular arc from a pose through a position to another pose.

        The orientation turns about a fixed axis from that of the start to that of the
        end.

        Parameters
        ----------
        start, end : (4, 4) or (3,) array_like
            Two poses, or two positions, in the world, m.
        via : (3,) array_like
            A position on the arc, m.

        Raises
        ------
        InputError
            An argument is invalid, the three positions are on a line, or the
            orientations are half a turn apart.

        """
        ends, oriented = _stated([start, end])
        middle = _point(via, 'via')
        first, last = ends[0, :3, 3], ends[1, :3, 3]
        # The center of the circle is in the plane of both chords.
        to_via, to_end = middle - first, last - first
        # Circumcenter from the start: (t^2 (e x n) - e^2 (t x n)) / (2 n^2), with the
        # chords t, e and n = t x e.
        normal = np.cross(to_via, to_end)
        size = float(np.linalg.norm(to_via) * np.linalg.norm(to_end))
        if not np.linalg.norm(normal) > STRAIGHT * size:
            raise InputError(f'via: {middle.tolist()} on a line with start and end; '
                             'expected three positions that determine a circle')
        square = float(normal @ normal)
        radius = (np.cross(np.cross(to_via, to_end),
                           to_via) * float(to_end @ to_end)
                  + np.cross(to_end, normal) * float(to_via @ to_via)) / (2.0 * square)
        axis = normal / np.sqrt(square)
        center = first + radius
        # The angle of the end, counted along the direction in which `via` comes first.
        sine = float(np.cross(first - center, last - center) @ axis)
        angle = float(np.arctan2(sine, (first - center) @ (last - center)))
        if angle < 0.0:
            angle += 2.0 * np.pi
        turn = pose_error(ends[0], ends[1])[3:]
        _require_turn(turn, 'start and end')
        piece = _arc(ends[0], center, angle * axis, turn)
        return cls([piece], oriented, 0.0, 0.0)

    @classmethod
    def circle(cls, start: ArrayLike, center: ArrayLike, axis: ArrayLike,
               angle: float = 2.0 * np.pi, *, turning: bool = False) -> PosePath:
        """
        Return a circle about an axis, from a pose or a position.

        Parameters
        ----------
        start : (4, 4) or (3,) array_like
            Pose or position at the start, in the world, m.
        center : (3,) array_like
            A point on the axis, m.
        axis : (3,) array_like
            Direction of the axis; positive angles turn about it by the right-hand rule.
        angle : float
            rad; more than a full turn repeats the circle.
        turning : bool
            Whether the orientation turns with the circle; else it stays.

        Raises
        ------
        InputError
            An argument is invalid, or the start is on the axis.

        """
        poses, oriented = _stated([start])
        point = _point(center, 'center')
        direction = _point(axis, 'axis')
        size = float(np.linalg.norm(direction))
        if not size > 0.0:
            raise InputError(f'axis: {direction.tolist()}; expected a direction')
        direction = direction / size
        angle = number(angle, 'angle', f'other than 0, at most {MOST_TURNS:g} rad',
                       lambda x: 0.0 < abs(x) <= MOST_TURNS)

        # The center moves along the axis into the plane of the circle.
        offset = poses[0, :3, 3] - point
        point = point + (offset @ direction) * direction
        # The orientation turns with the circle, or stays.
        turn = angle * direction if turning and oriented else np.zeros(3)
        piece = _arc(poses[0], point, angle * direction, turn)
        return cls([piece], oriented, 0.0, 0.0)

    @classmethod
    def joined(cls, paths: Sequence[PosePath], *, blend: float = 0.0,
               blend_angle: float = 0.05) -> PosePath:
        """
        Return the path along several paths; all corners are blended as stated here.

        Parameters
        ----------
        paths : sequence of PosePath
            Each begins where the one before ends, to 1e-9 m and rad.
        blend, blend_angle : float
            As in `PosePath.through`.

        Raises
        ------
        InputError
            An argument is invalid, or two paths do not join.

        """
        paths = list(paths) if isinstance(paths, Iterable) else []
        if not paths or not all(isinstance(path, PosePath) for path in paths):
            raise InputError(f'paths: {paths!r}; expected one or more of PosePath')
        if len({path.oriented for path in paths}) > 1:
            raise InputError('paths: of poses and of positions; expected either')
        # Neighboring paths must meet; then their pieces make one path.
        for k in range(1, len(paths)):
            _require_joined(paths[k - 1], paths[k], k)
        pieces: list[_Piece] = []
        for path in paths:
            pieces += path._pieces
        return cls(pieces, paths[0].oriented, *_checked_blend(blend, blend_angle))

    def poses(self, s: ArrayLike) -> Array:
        """
        Return the poses at parameters.

        Parameters
        ----------
        s : (N,) array_like
            From 0 to `length`; clipped to that.

        Returns
        -------
        (N, 4, 4) array
            In the world, m; for a path of positions without rotation.

        """
        # Each parameter belongs to one section; those of a section are computed at
        # once.
        places, sections = self._placed(s)
        T = np.zeros((len(places), 4, 4))
        for k, section in enumerate(self._sections):
            rows = sections == k
            if rows.any():
                T[rows] = _homogeneous(section.curve, section.begin + places[rows])
        return T

    def derivatives(self, s: ArrayLike) -> Derivatives:
        """Return the first three derivatives at parameters s, (N, 6) each."""
        # As in `poses`, a section at a time.
        places, sections = self._placed(s)
        result = np.zeros((3, len(places), 6))
        for k, section in enumerate(self._sections):
            rows = sections == k
            if rows.any():
                parts = section.curve.derivatives(section.begin + places[rows])
                for derivative, part in zip(result, parts):
                    derivative[rows] = part
        return Derivatives(*result)

    def section_limits(self, linear: Array, angular: Array) -> list[SectionLimits]:
        """Return the limits of s for limits of speed, acceleration and jerk, (3,) each."""
        limits = []
        for section in self._sections:
            limits.append(section.curve.limits(section.length, linear, angular))
        return limits

    @property
    def turns(self) -> bool:
        """Return whether the orientation changes."""
        return any(piece.turning.any() for piece in self._pieces)

    def _placed(self, s: ArrayLike) -> tuple[Array, NDArray[np.intp]]:
        """Return places within their sections, and the sections, (N,) each."""
        try:
            stated: Array = np.atleast_1d(np.asarray(s, dtype=np.float64))
        except (TypeError, ValueError):
            stated = np.array([np.nan])
        if stated.ndim > 1 or not np.isfinite(stated).all():
            raise InputError(f's: {s!r}; expected (N,) finite parameters')
        parameters: Array = np.clip(stated, 0.0, self.length)
        # The section in which each parameter lies; the end of the path belongs to the
        # last one.
        sections = np.searchsorted(self._starts, parameters, side='right') - 1
        last = len(self._sections) - 1
        inside: NDArray[np.intp] = np.minimum(sections, last)
        return parameters - self._starts[inside], inside


def _point(value: ArrayLike, what: str) -> Array:
    """Return three numbers; raise InputError unless they are finite and not too large."""
    numbers = finite_row(value, what, ('x', 'y', 'z'), part='coordinate')
    if (np.abs(numbers) > FARTHEST).any():
        raise InputError(f'{what}: {numbers.tolist()}; expected at most {FARTHEST:g}')
    return numbers


def _stated(poses: ArrayLike | Sequence[ArrayLike]) -> tuple[Array, bool]:
    """Return (K, 4, 4) poses, and whether they are poses; positions have no rotation."""
    try:
        numbers = real_numbers(np.asarray(poses))
    except (TypeError, ValueError):
        raise InputError('poses: of several shapes, or not of numbers; expected poses '
                         '(4, 4), or positions (3,)') from None
    # NaN is named by the later checks; here only finite numbers count.
    if not (np.abs(numbers[np.isfinite(numbers)]) <= FARTHEST).all():
        raise InputError(f'poses: {np.abs(numbers).max():g} m; expected at most '
                         f'{FARTHEST:g} m')

    # Positions become poses of the world's axes, which the path ignores.
    if numbers.ndim == 2 and numbers.shape[1] == 3 and len(numbers):
        for k, row in enumerate(numbers):
            constant(row, (3,), f'position {k}', InputError)
        T = np.tile(np.eye(4), (len(numbers), 1, 1))
        T[:, :3, 3] = numbers
        return T, False
    if numbers.ndim != 3 or not len(numbers):
        raise InputError(f'poses: shape {numbers.shape}; expected (K, 4, 4), poses, or '
                         '(K, 3), positions')
    return checked_pose(numbers, 'poses'), True


def _require_joined(path: PosePath, following: PosePath, k: int) -> None:
    """Raise InputError unless the following path, the k-th, begins where a path ends."""
    # Where one path ends, the next must begin, in position and orientation.
    end = path.poses([path.length])[0]
    start = following.poses([0.0])[0]
    error = pose_error(end, start)
    distance = float(np.abs(error[:3]).max())
    angle = float(np.abs(error[3:]).max())
    if max(distance, angle) > JOINED:
        raise InputError(f'paths: path {k} begins {distance:.4g} m and {angle:.4g} rad '
                         f'from the end of path {k - 1}; expected at most {JOINED:g}')


def _checked_blend(blend: float, blend_angle: float) -> tuple[float, float]:
    """Return the checked deviations of blends."""
    return (number(blend, 'blend', 'a distance, m, at least 0',
                   lambda x: 0.0 <= x < np.inf),
            number(blend_angle, 'blend_angle', 'an angle, rad, at least 0',
                   lambda x: 0.0 <= x < np.inf))


def _require_turn(turn: Array, names: str) -> None:
    """Raise InputError for half a turn, whose direction is not determined."""
    angle = float(np.linalg.norm(turn))
    if angle > np.pi - HALF_TURN:
        raise InputError(f'{names}: half a turn apart; expected a pose between them, '
                         'which determines the direction of the turn')


def _parameter(distance: float, turn: Array, names: str) -> float:
    """Return the length in s of a piece."""
    length = max(distance, RADIUS * float(np.linalg.norm(turn)))
    if not length > SHORTEST:
        raise InputError(f'{names}: equal; expected different ones')
    return length


def _line(start: Array, length: float, displacement: Array, turn: Array) -> _Piece:
    """Return a straight piece."""
    return _Piece(length, start[:3, 3], start[:3, :3], turn / length,
                  displacement / length, np.zeros(3), np.zeros(3))


def _arc(start: Array, center: Array, circling: Array, turn: Array) -> _Piece:
    """Return a circular piece; `circling` is the rotation vector about its center."""
    # The parameter counts the longer one of arc and turn.
    radius = float(np.linalg.norm(start[:3, 3] - center))
    angle = float(np.linalg.norm(circling))
    if not radius > SHORTEST:
        raise InputError(f'start: {start[:3, 3].tolist()} on the axis of the circle; '
                         'expected a position beside it')
    length = _parameter(radius * angle, turn, 'start and end')
    return _Piece(length, start[:3, 3], start[:3, :3], turn / length, np.zeros(3),
                  center, circling / length)


def _joint(before: _Piece, after: _Piece, blend: float, blend_angle: float) -> _Joint:
    """Return the largest blend of two pieces within a distance and an angle."""
    # A joint is smooth where both derivatives continue, relative to their size.
    end = before.derivatives(np.array([before.length]))
    start = after.derivatives(np.zeros(1))
    jump = scale = 0.0
    for last, first in ((end.first, start.first), (end.second, start.second)):
        jump += float(np.abs(last - first).max())
        scale += float(np.abs(last).max())
    if jump <= SMOOTH * scale:
        return _Joint(0.0, False)
    # Without tolerances for a blend the motion stops there.
    if not blend or not blend_angle:
        return _Joint(0.0, True)

    def fits(half: float) -> bool:
        distance, angle = _Blend(before, after, half).deviation()
        return distance <= blend and angle <= blend_angle

    # Half of each piece belongs to each of its ends. The deviation grows with the blend.
    low, high = 0.0, 0.5 * min(before.length, after.length)
    if fits(high):
        return _Joint(high, False)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if fits(middle):
            low = middle
        else:
            high = middle
    return _Joint(low, not low)


def _homogeneous(curve: _Piece | _Blend, s: Array) -> Array:
    """Return the poses of a curve, (N, 4, 4)."""
    T = np.zeros((len(s), 4, 4))
    T[:, :3, :3] = curve.rotations(s)
    T[:, :3, 3] = curve.positions(s)
    T[:, 3, 3] = 1.0
    return T


def _over(bounds: Array, size: float) -> Array:
    """Return limits of s for a derivative of constant size; infinite where it is 0."""
    if not size:
        return np.full(3, np.inf)
    return np.asarray(bounds / size)


def _least(linear: Array, angular: Array) -> tuple[float, float, float]:
    """Return the smaller ones of two limits of speed, acceleration and jerk."""
    speed, acceleration, jerk = np.minimum(linear, angular).tolist()
    return speed, acceleration, jerk
