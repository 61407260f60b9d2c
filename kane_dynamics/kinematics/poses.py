"""
Logarithm and exponential of rotations (SO(3)) and poses (SE(3)); errors of poses.

Every function takes one value or a batch of them along leading axes. A rotation is a (3,
3) matrix, a pose a (4, 4) one; twists are linear then angular, as the rows of
`Robot.jacobian`. Source: K. M. Lynch, F. C. Park, "Modern Robotics", 2017, sections 3.2
and 3.3.
"""

from __future__ import annotations

from typing import Any

from kane_dynamics._util.checks import real_numbers
from kane_dynamics._util.orientation import skew, stated_rotation
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
import numpy as np
from numpy.typing import ArrayLike

ORTHONORMAL = 1e-6  # largest difference of R R^T of a rotation from the identity
UPRIGHT = 1e-12  # cosine of the pitch at which roll and yaw are one rotation
LARGEST = 1e12  # rad, the limit of joint positions too


def pose_from(position: ArrayLike = (0.0, 0.0, 0.0), *, rpy: ArrayLike | None = None,
              quaternion: ArrayLike | None = None) -> Array:
    """
    Return the pose of a position and an orientation; by default it is not rotated.

    Parameters
    ----------
    position : (3,) or (..., 3) array_like
        Origin, m.
    rpy : (3,) or (..., 3) array_like, optional
        Roll, pitch and yaw about the fixed x, y and z axes, rad, as in URDF.
    quaternion : (4,) or (..., 4) array_like, optional
        x, y, z, w, as in ROS, instead of `rpy`; it is normalized.

    Returns
    -------
    (4, 4) or (..., 4, 4) array

    Warns
    -----
    ModelWarning
        An angle is beyond a full turn, as degrees are.

    Raises
    ------
    InputError
        Both orientations are given, a shape is wrong, a number is not finite, or the
        length of a quaternion is far from 1.

    """
    p = _numbers(position, (3,), 'position')
    angles: Array | None = None
    parts: Array | None = None
    if rpy is not None:
        angles = _numbers(rpy, (3,), 'rpy')
    if quaternion is not None:
        parts = _numbers(quaternion, (4,), 'quaternion')
    # One rotation from roll, pitch and yaw, or from a quaternion, of each row.
    R = stated_rotation(angles, parts, '', InputError, stacklevel=2)
    # One position and many orientations, or the other way round, are a batch.
    try:
        shape = np.broadcast_shapes(p.shape[:-1], R.shape[:-2])
    except ValueError:
        raise InputError(f'position: {p.shape[:-1]} positions, and {R.shape[:-2]} '
                         'orientations; expected as many, or one') from None
    return _homogeneous(np.broadcast_to(R, (*shape, 3, 3)),
                        np.broadcast_to(p, (*shape, 3)))


def rotation_rpy(rotation: ArrayLike) -> Array:
    """
    Return roll, pitch and yaw of a rotation about the fixed x, y and z axes, as in URDF.

    Where the pitch is a quarter turn, roll and yaw are about one axis, and yaw is 0.

    Parameters
    ----------
    rotation : (3, 3) or (..., 3, 3) array_like
        Its columns are the turned axes.

    Returns
    -------
    (3,) or (..., 3) array
        rad.

    Raises
    ------
    InputError
        It is not a rotation matrix.

    """
    R = _rotation(_numbers(rotation, (3, 3), 'rotation'), 'rotation')
    cosine = np.hypot(R[..., 0, 0], R[..., 1, 0])  # of the pitch
    pitch = np.arctan2(-R[..., 2, 0], cosine)
    # Where the pitch is a quarter turn, roll and yaw are one rotation, which roll takes.
    upright = cosine < UPRIGHT
    roll_alone = np.arctan2(-R[..., 1, 2], R[..., 1, 1])
    roll = np.where(upright, roll_alone, np.arctan2(R[..., 2, 1], R[..., 2, 2]))

    # Near a quarter turn, rounding decides the roll; the yaw is what it leaves. Without
    # the roll, the y axis is [-sin yaw, cos yaw, 0]. A sine of -0 counts as 0: half a turn
    # is +pi.
    c, s = np.cos(roll), np.sin(roll)
    sine = s * R[..., 0, 2] - c * R[..., 0, 1] + 0.0
    yaw = np.where(upright, 0.0, np.arctan2(sine, c * R[..., 1, 1] - s * R[..., 1, 2]))
    return np.stack([roll, pitch, yaw], axis=-1)


def rotation_quaternion(rotation: ArrayLike) -> Array:
    """
    Return the unit quaternion x, y, z, w of a rotation, with w >= 0.

    Parameters
    ----------
    rotation : (3, 3) or (..., 3, 3) array_like
        Its columns are the turned axes.

    Returns
    -------
    (4,) or (..., 4) array

    Raises
    ------
    InputError
        It is not a rotation matrix.

    """
    q = _scalar_first(_rotation(_numbers(rotation, (3, 3), 'rotation'), 'rotation'))
    return np.concatenate([q[..., 1:], q[..., :1]], axis=-1)


def rotation_exp(vector: ArrayLike) -> Array:
    """
    Return the rotation matrix of a rotation vector (Rodrigues' formula).

    Parameters
    ----------
    vector : (3,) or (..., 3) array_like
        Rotation vector, rad.

    Returns
    -------
    (3, 3) or (..., 3, 3) array

    Raises
    ------
    InputError
        The vector does not have three finite numbers, or the angle is too large.

    """
    w = _numbers(vector, (3,), 'vector')
    angle = _angle(w, 'vector')
    W = skew(w)
    # (1 - cos) / angle^2 by the half angle, which does not cancel near 0.
    second = 0.5 * _sinc(0.5 * angle)**2
    return np.asarray(np.eye(3) + _sinc(angle) * W + second * (W @ W))


def rotation_log(rotation: ArrayLike) -> Array:
    """
    Return the rotation vector of a rotation, its length at most pi.

    By the quaternion, computed from the largest of its four products (S. W. Shepperd,
    "Quaternion from rotation matrix", 1978): accurate at every angle, those near 0 and
    pi included.

    Parameters
    ----------
    rotation : (3, 3) or (..., 3, 3) array_like
        Its columns are the turned axes.

    Returns
    -------
    (3,) or (..., 3) array
        rad.

    Raises
    ------
    InputError
        It is not a rotation matrix.

    """
    return _logarithm(_rotation(_numbers(rotation, (3, 3), 'rotation'), 'rotation'))


def pose_exp(twist: ArrayLike) -> Array:
    """
    Return the pose that a constant twist reaches in unit time.

    Parameters
    ----------
    twist : (6,) or (..., 6) array_like
        Linear then angular, in the axes of the moving frame, m and rad.

    Returns
    -------
    (4, 4) or (..., 4, 4) array

    Raises
    ------
    InputError
        The twist does not have six finite numbers, or the angle is too large.

    """
    xi = _numbers(twist, (6,), 'twist')
    v = xi[..., :3]
    w = xi[..., 3:]
    angle = _angle(w, 'twist')
    W = skew(w)
    # The integral V of the rotation, which moves the origin. Near 0 a series takes the
    # place of (angle - sin) / angle^3; its first omitted term is below 1e-15.
    small = angle < 1e-2
    safe = np.where(small, 1.0, angle)
    series = 1.0 / 6.0 - angle**2 / 120.0 + angle**4 / 5040.0
    third = np.where(small, series, (safe - np.sin(safe)) / safe**3)
    V = np.eye(3) + 0.5 * _sinc(0.5 * angle)**2 * W + third * (W @ W)
    return _homogeneous(rotation_exp(w), (V @ v[..., None])[..., 0])


def pose_log(pose: ArrayLike) -> Array:
    """
    Return the constant twist that reaches a pose in unit time: inverse of `pose_exp`.

    Parameters
    ----------
    pose : (4, 4) or (..., 4, 4) array_like
        Rotation and origin, m.

    Returns
    -------
    (6,) or (..., 6) array
        Linear then angular, in the axes of the moving frame, m and rad.

    Raises
    ------
    InputError
        It is not a pose.

    """
    T = checked_pose(pose, 'pose')
    w = _logarithm(T[..., :3, :3])
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    W = skew(w)
    # The inverse of V in `pose_exp`, with a series near 0.
    small = angle < 1e-2
    half = np.where(small, 1.0, 0.5 * angle)
    series = 1.0 / 12.0 + angle**2 / 720.0 + angle**4 / 30240.0
    closed_form = (1.0 - half * np.cos(half) / np.sin(half)) / (4.0 * half**2)
    second = np.where(small, series, closed_form)
    inverse_V = np.eye(3) - 0.5 * W + second * (W @ W)
    return np.concatenate([(inverse_V @ T[..., :3, 3:])[..., 0], w], axis=-1)


def pose_error(actual: ArrayLike, desired: ArrayLike) -> Array:
    """
    Return the displacement from one pose to another, linear then angular, in world axes.

    Linear is ``p_d - p``, angular the rotation vector of ``R_d R^T``: to first order
    what ``robot.jacobian(frame, q) @ dq`` must be to go there.

    Parameters
    ----------
    actual, desired : (4, 4) or (..., 4, 4) array_like
        In the world, m.

    Returns
    -------
    (6,) or (..., 6) array
        m and rad.

    Raises
    ------
    InputError
        One of them is not a pose.

    """
    A = checked_pose(actual, 'actual')
    D = checked_pose(desired, 'desired')
    turn = D[..., :3, :3] @ np.swapaxes(A[..., :3, :3], -1, -2)
    return np.concatenate([D[..., :3, 3] - A[..., :3, 3], _logarithm(turn)], axis=-1)


def checked_pose(pose: ArrayLike, what: str) -> Array:
    """Return a pose, or a batch of poses, as an array; InputError for anything else."""
    T = _numbers(pose, (4, 4), what)
    _rotation(T[..., :3, :3], what)
    if (T[..., 3, :] != [0.0, 0.0, 0.0, 1.0]).any():
        raise InputError(f'{what}: the last row is '
                         f'{T.reshape(-1, 4, 4)[0, 3].tolist()}; expected [0, 0, 0, 1]')
    return T


def _angle(w: Array, what: str) -> Array:
    """Return the angles of rotation vectors, (..., 1, 1); InputError for large ones."""
    largest = float(np.abs(w).max(initial=0.0))
    if largest > LARGEST:
        raise InputError(f'{what}: rotation of {largest:g} rad; expected at most '
                         f'{LARGEST:g} rad')
    return np.asarray(np.linalg.norm(w, axis=-1)[..., None, None])


def _scalar_first(R: Array) -> Array:
    """Return the unit quaternions w, x, y, z of checked rotations, with w >= 0."""
    # The matrix 4 q q^T of the quaternion q = (w, x, y, z) is linear in R.
    trace = np.trace(R, axis1=-2, axis2=-1)
    products = np.empty((*R.shape[:-2], 4, 4))
    products[..., 0, 0] = 1.0 + trace
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        products[..., 1 + i, 1 + i] = 1.0 + 2.0 * R[..., i, i] - trace
        mixed = R[..., i, j] + R[..., j, i]
        products[..., 1 + i, 1 + j] = mixed
        products[..., 1 + j, 1 + i] = mixed
        with_w = R[..., k, j] - R[..., j, k]
        products[..., 0, 1 + i] = with_w
        products[..., 1 + i, 0] = with_w
    # Its row with the largest diagonal entry is q times the largest of q's entries.
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.asarray(np.where(q[..., :1] < 0.0, -q, q))


def _logarithm(R: Array) -> Array:
    """Return the rotation vectors of checked rotations."""
    q = _scalar_first(R)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)  # of half the angle
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    turns = sine > 0.0
    factor = np.where(turns, angle / np.where(turns, sine, 1.0), 2.0)
    return np.asarray(q[..., 1:] * factor)


def _rotation(R: Array, what: str) -> Array:
    """Return checked rotations; InputError names the first invalid one."""
    # Huge entries may overflow; they are refused.
    with np.errstate(over='ignore', invalid='ignore'):
        deviation = np.abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)).max(axis=(-1, -2))
        invalid = ~(deviation <= ORTHONORMAL) | (np.linalg.det(R) < 0.0)
    if invalid.any():
        first = R.reshape(-1, 3, 3)[int(np.argmax(np.ravel(invalid)))]
        raise InputError(f'{what}: {np.round(first, 6).tolist()}; expected a rotation '
                         'matrix (orthonormal, determinant 1)')
    return R


def _numbers(value: ArrayLike, shape: tuple[int, ...], what: str) -> Array:
    """Return finite numbers whose last axes have a shape, or raise InputError."""
    try:
        array = real_numbers(value)
    except (TypeError, ValueError):
        raise InputError(f'{what}: {value!r}; expected numbers of shape {shape}'
                         ) from None
    # One pose, or an array of several.
    if array.shape[-len(shape):] != shape:
        raise InputError(f'{what}: shape {array.shape}; expected {shape} or (N, '
                         f'{", ".join(map(str, shape))})')
    if not np.isfinite(array).all():
        raise InputError(f'{what}: not finite; expected finite numbers')
    return array


def _sinc(x: Any) -> Any:
    """Return sin(x) / x, 1 at 0."""
    return np.sinc(x / np.pi)


def _homogeneous(R: Array, p: Array) -> Array:
    """Return (..., 4, 4) poses."""
    T = np.zeros((*p.shape[:-1], 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = p
    T[..., 3, 3] = 1.0
    return T
