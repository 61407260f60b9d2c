"""Motions along paths of poses, within limits of speed, acceleration and jerk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from kane_dynamics._util.checks import instance, number, real_numbers
from kane_dynamics._util.fixed_attributes import fixed
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.pose_path import PosePath, RADIUS
from kane_dynamics.motion.speed_profile import fastest_profile, SpeedProfile
import numpy as np
from numpy.typing import ArrayLike

ORDERS = ('speed', 'acceleration', 'jerk')
# Of a motion in a stated duration, whose shape has the least jerk: none but that of jerk.
BRIEFEST = 1e-6  # s, of a motion
SHAPE = np.array([np.inf, np.inf, 1.0])


@dataclass(frozen=True)
class PoseLimits:
    """
    Limits on the motion of a frame: (speed, acceleration, jerk), norms of three numbers.

    Attributes
    ----------
    linear : (3,) sequence of float
        Of the origin, m/s, m/s^2 and m/s^3; positive and finite.
    angular : (3,) sequence of float, optional
        Of the orientation, rad/s, rad/s^2 and rad/s^3; required where it changes.

    """

    linear: Sequence[float]
    angular: Sequence[float] | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        for name in ('linear', 'angular'):
            values = getattr(self, name)
            # Without angular limits only paths that do not turn are timed.
            if values is None and name == 'angular':
                continue
            # Three limits: of speed, acceleration and jerk.
            try:
                stated = tuple(real_numbers(values).tolist())
            except (TypeError, ValueError):
                stated = ()
            valid = len(stated) == 3 and all(0.0 < value < np.inf for value in stated)
            if not valid:
                raise InputError(f'{name}: {values!r}; expected {", ".join(ORDERS)}, three '
                                 'positive, finite numbers')
            object.__setattr__(self, name, stated)


class PoseStates(NamedTuple):
    """
    The desired motion of a frame at N times, in world axes, as `Robot.frame_velocity`.

    `pose`, (N, 4, 4), m; `twist`, (N, 6), m/s and rad/s, linear then angular;
    `acceleration`, (N, 6), m/s^2 and rad/s^2.
    """

    pose: Array
    twist: Array
    acceleration: Array


@fixed
class PoseMotion:
    """
    A motion along a `PosePath` from rest to rest, in continuous acceleration.

    The acceleration along the path is zero where a piece of it meets a blend, along
    which the parameter of the path grows steadily.

    Parameters
    ----------
    path : PosePath
    limits : PoseLimits, optional
        The motion is as fast as they allow with these phases. On arcs some of the
        acceleration and jerk is reserved for the direction across, so that the limits
        hold for their norms.
    duration : float, optional
        Instead of limits, s. The jerk is limited alone, so that it is small.

    Attributes
    ----------
    path : PosePath
    duration : float
        s.
    times : (K,) array
        Of jumps of the jerk, and of both ends, s.

    Raises
    ------
    InputError
        An argument is invalid, or the path turns without a limit of turning.

    """

    def __init__(self, path: PosePath, limits: PoseLimits | None = None, *,
                 duration: float | None = None) -> None:
        instance(path, PosePath, 'path')
        if (limits is None) == (duration is None):
            both = 'neither is given' if limits is None else 'both are given'
            raise InputError(f'limits and duration: {both}; expected exactly one of '
                             'them')
        if limits is not None:
            instance(limits, PoseLimits, 'limits')
            if limits.angular is None and path.oriented and path.turns:
                raise InputError('limits: no angular ones for a path that turns; '
                                 'expected speed, acceleration and jerk of the turn')
            linear = np.array(limits.linear)
            angular = np.array(limits.angular or (np.inf, np.inf, np.inf))

        # For a duration the shape of the motion counts alone, since the time is scaled
        # to it.
        else:
            duration = number(duration, 'duration', f'a finite time of at least {BRIEFEST:g} '
                              's', lambda x: BRIEFEST <= x < np.inf)
            linear, angular = SHAPE, SHAPE / RADIUS
        # The motion rests where the path stops: at its ends, and at corners without a
        # blend.
        profile = fastest_profile(path.section_limits(linear, angular), path.stops)
        if duration is not None:
            profile = profile.scaled(duration)
        self.path = path
        self._profile: SpeedProfile = profile
        self.duration = profile.duration
        self.times = profile.times

    def __repr__(self) -> str:
        """Return path and duration."""
        return f'<PoseMotion in {self.duration:g} s along {self.path!r}>'

    def sample(self, t: ArrayLike) -> PoseStates:
        """
        Return poses, twists and accelerations; before and after the motion it rests.

        Parameters
        ----------
        t : float or (N,) array_like
            s from the start of the motion, finite.

        Returns
        -------
        PoseStates
            Without the leading axis for a single time.

        """
        try:
            stated = np.asarray(t, dtype=np.float64)
        except (TypeError, ValueError):
            stated = np.array(np.nan)
        if stated.ndim > 1 or not np.isfinite(stated).all():
            raise InputError(f't: {t!r}; expected a finite time or (N,) times, s')
        times = np.atleast_1d(stated)
        # At rest outside the motion: speeds are zero there, the pose is that of the end.
        inside = ((times > 0.0) & (times < self.duration)).astype(float)
        progress = self._profile.sample(np.clip(times, 0.0, self.duration))
        speed = (inside * progress.speed)[:, None]
        acceleration = (inside * progress.acceleration)[:, None]
        # The chain rule: p'' of time is p_s s'' + p_ss s'^2.
        first, second, _ = self.path.derivatives(progress.place)
        states = PoseStates(self.path.poses(progress.place), first * speed,
                            first * acceleration + second * speed**2)
        if stated.ndim:
            return states
        return PoseStates(*(part[0] for part in states))
