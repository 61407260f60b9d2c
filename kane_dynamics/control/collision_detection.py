"""Collision detection by estimated external torques, and the wrench at a frame."""

from __future__ import annotations

from typing import NamedTuple
import warnings

from kane_dynamics._util.attribute_hints import guarded
from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, ModelWarning
import numpy as np
from numpy.typing import ArrayLike

DAMPING = 0.005  # m, of `frame_wrench`: a condition number near 200 for an arm of 1 m


@guarded
class CollisionDetector:
    """
    Detects a collision by thresholds on estimated external torques.

    The flag is set when one joint's torque has been beyond its threshold for `confirm`, and is
    cleared when all have been below `release` times theirs for `clear`. The hysteresis ignores
    single outliers and torques near the threshold.

    Parameters
    ----------
    joint_names : sequence of str
    threshold : float or (n,) array_like
        N m or N. It must exceed the model error, above all that of friction.
    confirm, clear : float
        s; zero: at once.
    release : float
        Share of the threshold, 0 to 1.

    Attributes
    ----------
    collision : bool
        The flag.
    joint : str or None
        The joint that set the flag: of the confirmed ones, that with the largest ratio of torque
        to threshold.
    beyond : tuple of str
        All joints beyond their thresholds. An external force on a link loads only the joints
        between it and the base, so the link in contact is that of the outermost of these joints or
        a later one.

    Raises
    ------
    InputError
        Names the argument, the joint and the value.

    """

    def __init__(self, joint_names: tuple[str, ...], threshold: ArrayLike, *,
                 confirm: float = 0.005, release: float = 0.8, clear: float = 0.2) -> None:
        self._names = tuple(joint_names)
        self.reset()
        self.tune(threshold, confirm=confirm, release=release, clear=clear)

    def tune(self, threshold: ArrayLike, *, confirm: float, release: float,
             clear: float) -> None:
        """Change thresholds and times; the flag keeps its value."""
        thresholds = per_joint(threshold, 'threshold', self._names, finite=False).tolist()
        for name, value in zip(self._names, thresholds):
            if value == 0.0:
                raise InputError(f"threshold of joint '{name}': 0; expected a positive number")
        for what, time in (('confirm', confirm), ('clear', clear)):
            if not time >= 0.0:
                raise InputError(f'{what}: {time}; expected a nonnegative time in s')
        if not 0.0 < release <= 1.0:
            raise InputError(f'release: {release}; expected a fraction above 0, at most 1')
        self._thresholds, self._release = thresholds, release
        self._confirm, self._clear = confirm, clear

    def reset(self) -> None:
        """Clear the flag and the timers."""
        self.collision = False
        self.joint: str | None = None
        self.beyond: tuple[str, ...] = ()
        self._since: list[float | None] = [None] * len(self._names)  # beyond the threshold
        self._calm: float | None = None  # since when all are below their release

    def update(self, t: float, torque: Array) -> bool:
        """
        Update with the torques, (n,), at time t, s; return whether the flag has changed.

        A backward jump of the time restarts the timers.
        """
        shares = [abs(x) / limit for x, limit in zip(torque.tolist(), self._thresholds)]
        self._since = [None if not share > 1.0 else t if since is None or t < since else since
                       for share, since in zip(shares, self._since)]
        self.beyond = tuple(name for name, since in zip(self._names, self._since)
                            if since is not None)
        if not self.collision:
            confirmed = [(share, name) for share, since, name in zip(
                shares, self._since, self._names)
                if since is not None and t - since >= self._confirm]
            if confirmed:
                self.collision, self.joint, self._calm = True, max(confirmed)[1], None
            return self.collision
        if max(shares) >= self._release:
            self._calm = None
            return False
        self._calm = t if self._calm is None or t < self._calm else self._calm
        if t - self._calm >= self._clear:
            self.collision, self.joint, self._calm = False, None, None
        return not self.collision


class FrameWrench(NamedTuple):
    """
    The wrench at a frame estimated from external torques; the result of `frame_wrench`.

    Attributes
    ----------
    wrench : (6,) array
        Force then moment, N and N m, world axes.
    seen : int
        Number of its six directions that the torques determine. Along the others it is zero, or
        reduced by damping.
    rest : (n,) array
        The residual of the least-squares fit, N m or N. It is large if the contact is elsewhere.

    """

    wrench: Array
    seen: int
    rest: Array

    @property
    def damped(self) -> int:
        """Return the number of directions reduced by damping."""
        return min(6, len(self.rest)) - self.seen

    @property
    def residual(self) -> Array:
        """Return `rest`, (n,), N m or N: the residual of the least-squares fit."""
        return self.rest


def frame_wrench(partial_velocities: Array, torque: Array, *, length: float = 0.3,
                 damping: float | None = None) -> FrameWrench:
    """
    Return the least-squares wrench at a frame: ``J^T w`` fits the external torques.

    In a singular configuration, or with fewer than six joints, some wrenches cause no joint
    torque. Near such configurations 1/s, s a singular value of J^T, is damped to
    ``s / damping^2`` for s below the damping: the wrench is too small there instead of unbounded.
    Elsewhere it is exact.

    Parameters
    ----------
    partial_velocities : (6, n) array
        `Robot.jacobian` of the frame, linear then angular, world axes.
    torque : (n,) array
        The estimate of `MomentumObserver`, N m or N.
    length : float
        m; weights a moment of 1 N m like a force of 1 N / length.
    damping : float, optional
        Smallest singular value without damping, m (N m per N). By default 5 mm, with a warning if
        it acts; use more with noisy torques, because their noise is divided by it.

    Warns
    -----
    ModelWarning
        Damping acts and was not given; names the number of directions.

    Raises
    ------
    InputError
        The damping is not positive.

    """
    least = DAMPING if damping is None else damping
    if not least > 0.0:
        raise InputError(f'damping: {least}; expected a positive number, m')
    scale = np.array([1.0, 1.0, 1.0, length, length, length])
    columns = partial_velocities.T * scale  # (n, 6): torques of scaled directions
    left, s, right = np.linalg.svd(columns, full_matrices=False)
    inverse = np.where(s >= least, 1.0 / np.maximum(s, least), s / least**2)
    scaled = right.T @ (inverse * (left.T @ torque))
    found = FrameWrench(scaled * scale, int((s >= least).sum()), torque - columns @ scaled)
    if damping is None and found.damped:
        warnings.warn(f'frame_wrench: {found.damped} of {len(s)} directions damped (smallest '
                      f'singular value {s[-1]:.2g} m, damping {least:g} m): the wrench is too '
                      'small along them; expected a configuration away from singular ones, or '
                      'damping=', ModelWarning, stacklevel=2)
    return found
