"""Collision detection by estimated external torques, and the wrench at a frame."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
import math
from typing import NamedTuple
import warnings

from kane_dynamics._util.checks import constant, names_of_joints, number, per_joint
from kane_dynamics._util.fixed_attributes import guarded_class
from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.errors import InputError, ModelWarning
from kane_dynamics.mechanics.algebra.choice import magnitude, select
import numpy as np
from numpy.typing import ArrayLike

DAMPING = 0.005  # m, of `frame_wrench`: a condition number near 200 for an arm of 1 m


@guarded_class
class CollisionDetector:
    """
    Detects a collision by thresholds on estimated external torques.

    The flag is set when one joint's torque has been beyond its threshold for `confirm`,
    and is cleared when all have been below `release` times theirs for `clear`. The
    hysteresis ignores single outliers and torques near the threshold.

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
        The joint that set the flag: of the confirmed ones, that with the largest ratio
        of torque to threshold.
    beyond : tuple of str
        All joints beyond their thresholds. An external force on a link loads only the
        joints between it and the base, so the link in contact is that of the outermost
        of these joints or a later one.

    Raises
    ------
    InputError
        Names the argument, the joint and the value.

    """

    def __init__(self, joint_names: tuple[str, ...], threshold: ArrayLike, *,
                 confirm: float = 0.005, release: float = 0.8,
                 clear: float = 0.2) -> None:
        self._names = names_of_joints(joint_names)
        self.reset()
        self.tune(threshold, confirm=confirm, release=release, clear=clear)

    def tune(self, threshold: ArrayLike, *, confirm: float, release: float,
             clear: float) -> None:
        """Change thresholds and times; the flag keeps its value."""
        # All are checked before the first is changed. An infinite threshold disables a
        # joint; zero would always be exceeded.
        thresholds = per_joint(threshold, 'threshold', self._names,
                               finite=False).tolist()
        for name, value in zip(self._names, thresholds):
            if value == 0.0:
                raise InputError(f"threshold of joint '{name}': 0; expected a positive "
                                 'number')
        times = []
        for what, time in (('confirm', confirm), ('clear', clear)):
            times.append(number(time, what, 'a nonnegative time in s', lambda x: x >= 0.0))
        release = number(release, 'release', 'a fraction above 0, at most 1',
                         lambda x: 0.0 < x <= 1.0)
        self._thresholds = thresholds
        self._release = release
        self._confirm, self._clear = times

    def reset(self) -> None:
        """Clear the flag and the timers."""
        self.collision = False
        self.joint: str | None = None
        self.beyond: tuple[str, ...] = ()
        # Of each joint, the time since when it is beyond its threshold; and the time
        # since when all are below their release.
        self._beyond_since: list[float | None] = [None] * len(self._names)
        self._calm_since: float | None = None

    def update(self, t: float, torque: Array) -> bool:
        """
        Update with the torques, (n,), at time t, s; return whether the flag has changed.

        A backward jump of the time restarts the timers.
        """
        # Each joint has its own clock, which starts when its torque passes the
        # threshold.
        ratios = [abs(x) / limit for x, limit in zip(torque.tolist(), self._thresholds)]
        beyond = []
        # The time since which each joint is beyond its threshold without a break.
        for k, ratio in enumerate(ratios):
            if ratio > 1.0:
                self._beyond_since[k] = _earlier(self._beyond_since[k], t)
                beyond.append(self._names[k])
            else:
                self._beyond_since[k] = None
        self.beyond = tuple(beyond)
        # A set flag clears below a lower threshold, so that it does not flicker.
        if self.collision:
            return self._clears(t, max(ratios))
        return self._sets(t, ratios)

    def _sets(self, t: float, ratios: list[float]) -> bool:
        """Set the flag if a joint is beyond its threshold for long; return whether."""
        largest = 0.0
        for name, ratio, since in zip(self._names, ratios, self._beyond_since):
            is_confirmed = since is not None and t - since >= self._confirm
            # Of equal ratios, the last name in the alphabet.
            if is_confirmed and (ratio, name) > (largest, self.joint or ''):
                largest = ratio
                self.joint = name
        self.collision = self.joint is not None
        self._calm_since = None
        return self.collision

    def _clears(self, t: float, largest: float) -> bool:
        """Clear the flag if all joints have been below their release; return whether."""
        if largest >= self._release:
            self._calm_since = None
            return False
        # Calm for long enough: from the first of these samples on.
        self._calm_since = _earlier(self._calm_since, t)
        if t - self._calm_since < self._clear:
            return False
        self.collision = False
        self.joint = None
        self._calm_since = None
        return True


def _earlier(since: float | None, t: float) -> float:
    """Return since when a condition holds: `since`, or t if it holds only from now on."""
    # A time after t is of a clock that has jumped back.
    if since is None or t < since:
        return t
    return since


def detector_step(names: Sequence[str], torque: Vector, threshold: Vector,
                  settings: Vector, memory: Vector, elapsed: Scalar) -> Vector:
    """
    Return the memory of a detector after a sample, (n + 3,), over any scalar.

    It is the rule of `CollisionDetector` without branches, for exported code; over
    Python's numbers it takes six times as long as the class. The memory is the flag,
    1 + the index of the joint that set it, the time for which all torques have been
    below their release, and of each joint the time for which it has been beyond its
    threshold, s; -1 where that does not hold. `settings` are confirm, release, clear. Of
    equal ratios of torque to threshold, the joint with the last name in the alphabet
    counts. An elapsed time of 0 or less, s, begins again without a collision.
    """
    confirm, release, clear = settings
    has_begun = elapsed > 0.0
    was_set = select(has_begun, memory[0], 0.0) > 0.5
    ratios = [magnitude(x) / limit for x, limit in zip(torque, threshold)]

    # How long each joint has been beyond its threshold.
    times = []
    for ratio, since in zip(ratios, memory[3:]):
        times.append(select(ratio > 1.0, _lasting(since, elapsed, has_begun), -1.0))

    # Of the joints that are confirmed, the one with the largest ratio.
    largest = 0.0
    joint = 0.0
    for k in sorted(range(len(names)), key=names.__getitem__):
        is_beyond = select(times[k] < 0.0, -1.0, ratios[k])
        confirmed_ratio = select(times[k] < confirm, -1.0, is_beyond)
        is_smaller = confirmed_ratio < largest
        largest = select(is_smaller, largest, confirmed_ratio)
        joint = select(is_smaller, joint, k + 1.0)

    # How long all joints have been below their release.
    is_calm = 1.0
    for ratio in ratios:
        is_calm = select(ratio < release, is_calm, 0.0)
    calm = select(is_calm > 0.5, _lasting(memory[2], elapsed, has_begun), -1.0)
    calm = select(was_set, calm, -1.0)

    # A set flag keeps its joint until it is cleared, and a cleared one is not set again
    # by the same sample.
    kept = select(calm < clear, memory[1], 0.0)
    joint = select(was_set, kept, joint)
    calm = select(joint > 0.5, calm, -1.0)
    flag = select(joint > 0.5, 1.0, 0.0)
    return np.array([flag, joint, calm, *times])


def _lasting(since: Scalar, elapsed: Scalar, has_begun: Scalar) -> Scalar:
    """Return for how long something holds that was true for `since`, or begins now."""
    lasting = select(since < 0.0, 0.0, since + elapsed)
    return select(has_begun, lasting, 0.0)


class FrameWrench(NamedTuple):
    """
    The wrench at a frame estimated from external torques; the result of `frame_wrench`.

    Attributes
    ----------
    wrench : (6,) array
        Force then moment, N and N m, world axes.
    seen : int
        Number of its six directions that the torques determine. Along the others it is
        zero, or reduced by damping.
    rest : (n,) array
        The residual of the least-squares fit, N m or N. It is large if the contact is
        elsewhere.

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


def frame_wrench(jacobian: Array, torque: Array, *, length: float = 0.3,
                 damping: float | None = None) -> FrameWrench:
    """
    Return the least-squares wrench at a frame: ``J^T w`` fits the external torques.

    In a singular configuration, or with fewer than six joints, some wrenches cause no
    joint torque. Near such configurations 1/s, s a singular value of J^T, is damped to
    ``s / damping^2`` for s below the damping: the wrench is too small there instead of
    unbounded. Elsewhere it is exact.

    Parameters
    ----------
    jacobian : (6, n) array
        `Robot.jacobian` of the frame, linear then angular, world axes.
    torque : (n,) array
        The estimate of `MomentumObserver`, N m or N.
    length : float
        m; weights a moment of 1 N m like a force of 1 N / length.
    damping : float, optional
        Smallest singular value without damping, m (N m per N). By default 5 mm, with a
        warning if it acts; use more with noisy torques, because their noise is divided
        by it.

    Warns
    -----
    ModelWarning
        Damping acts and was not given; names the number of directions.

    Raises
    ------
    InputError
        The damping is not positive.

    """
    smallest = DAMPING if damping is None else damping
    smallest = number(smallest, 'damping', 'a positive number, m', lambda x: x > 0.0)
    length = number(length, 'length', 'a positive, finite number, m',
                    lambda x: 0.0 < x < math.inf)
    shape: tuple[int, ...] = ()
    with suppress(ValueError):  # rows of several lengths, which are refused below
        shape = np.shape(jacobian)
    columns_of_joints = shape[1] if len(shape) == 2 else 0
    jacobian = constant(jacobian, (6, columns_of_joints), 'jacobian', InputError)
    torque = constant(torque, (columns_of_joints,), 'torque', InputError)
    # (n, 6): torques of unit forces and of moments of 1 N times the length.
    scale = np.array([1.0, 1.0, 1.0, length, length, length])
    columns = jacobian.T * scale
    # The damped pseudoinverse: exact for singular values that are large enough.
    left, s, right = np.linalg.svd(columns, full_matrices=False)
    undamped = s >= smallest
    inverse = np.where(undamped, 1.0 / np.maximum(s, smallest), s / smallest**2)
    scaled = right.T @ (inverse * (left.T @ torque))
    result = FrameWrench(scaled * scale, int(undamped.sum()), torque - columns @ scaled)
    if damping is None and result.damped:
        warnings.warn(f'frame_wrench: {result.damped} of {len(s)} directions damped '
                      f'(smallest singular value {s[-1]:.2g} m, damping {smallest:g} '
                      'm): the wrench is too small along them; expected a configuration '
                      'away from singular ones, or damping=', ModelWarning, stacklevel=2)
    return result
