"""Check and convert the arguments of `ModelBuilder`."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
import math
from typing import Any

from kane_dynamics._util.checks import constant, warn_of_turns
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
from kane_dynamics.model.inertial import Inertial, principal_moments
from kane_dynamics.model.placement import rotation_about, snapped
import numpy as np
from numpy.typing import ArrayLike

PROPERTIES = ('limits', 'damping', 'friction', 'friction_speed', 'friction_offset', 'armature',
              'stiffness', 'rest')
UNIT_LENGTH = 1e-3  # largest deviation of a quaternion's length from 1, as of rounded files


def further(bent: Any, joints: int) -> Any:
    """Return a beam or a deflection with its coordinate indices shifted by `joints`."""
    return bent and replace(bent, coordinates=tuple(joints + k for k in bent.coordinates))


def checked_turns(turns: str, count: int, what: str) -> str:
    """Return the first `count` rotation axes; raise ModelError if two in a row are equal."""
    turns = turns[:count] if count == 2 and isinstance(turns, str) else turns
    if (not isinstance(turns, str) or len(turns) != count or not set(turns) <= set('xyz')
            or any(a == b for a, b in pairwise(turns))):
        raise ModelError(f"{what}: turns '{turns}'; expected x, y or z for each rotation, "
                         'different from the previous one')
    return turns


def check_properties(joint: str, properties: dict[str, Any]) -> None:
    """Raise ModelError for an unknown joint property."""
    unknown = sorted(set(properties) - set(PROPERTIES))
    if unknown:
        raise ModelError(f"joint '{joint}': no property '{unknown[0]}'; expected one of "
                         f'{", ".join(PROPERTIES)}')


def check_ball_property(joint: str, properties: dict[str, Any]) -> None:
    """Raise ModelError for a property that a part of a ball joint, which has no angle, lacks."""
    limits = properties.get('limits')
    if limits is not None and (limits.lower, limits.upper) != (-math.inf, math.inf):
        raise ModelError(f"joint '{joint}': limits {limits.lower:g} to {limits.upper:g} of a part "
                         'of a ball joint, which has no angle; expected limits of velocity and '
                         'effort alone')
    for name in ('armature', 'stiffness', 'rest'):
        if properties.get(name, 0.0):
            raise ModelError(f"joint '{joint}': {name} {properties[name]:g} of a part of a ball "
                             'joint, which has no angle; expected damping, friction or limits '
                             'of velocity and effort')


def check_balls(bodies: Sequence[Any], balls: Sequence[int]) -> None:
    """Raise ModelError unless the three bodies of every ball joint are as `Model.balls` says."""
    for first in balls:
        parts = bodies[first:first + 3]
        joints = [body.joint for body in parts]
        start = joints[0].coordinate if joints else 0
        chain = [body.parent for body in parts[1:]] == [first, first + 1]
        still = all(np.array_equal(joint.rotation, np.eye(3)) and not joint.translation.any()
                    for joint in joints[1:])
        plain = all(joint.kind == 'revolute' and joint.coordinate == start + k
                    and np.array_equal(joint.axis, np.eye(3)[k]) and joint.multiplier == 1.0
                    and joint.offset == 0.0 and joint.deflection is None
                    for k, joint in enumerate(joints))
        if not (chain and still and plain and len(parts) == 3):
            raise ModelError(f'ball joint of bodies {[body.name for body in parts]}: expected '
                             'revolute joints about x, y and z, in series, with one origin, whose '
                             'coordinates follow each other in that order')
        for joint in joints:
            check_ball_property(joint.name, {name: getattr(joint, name) for name in (
                'limits', 'armature', 'stiffness', 'rest')})
    used = [body.joint.coordinate for body in bodies]
    for joint in (bodies[first + k].joint for first in balls for k in range(3)):
        if used.count(joint.coordinate) > 1:
            raise ModelError(f"joint '{joint.name}': a part of a ball joint that another joint "
                             'mimics; expected a joint of one degree of freedom')


def check_inertial(on: str, inertial: Inertial) -> None:
    """Raise ModelError for what is no Inertial."""
    if not isinstance(inertial, Inertial):
        raise ModelError(f"'{on}': inertial properties: a {type(inertial).__name__}; expected an "
                         'Inertial (inertial=), such as of rod, disc, ball, box, point_mass')


def check_moments(on: str, inertial: Inertial) -> None:
    """Raise ModelError for impossible principal moments of inertia."""
    found = principal_moments(inertial.inertia)
    if not found.possible:
        raise ModelError(f"'{on}': principal moments of inertia are {found}; expected none "
                         'negative or larger than the sum of the others')


def direction(axis: ArrayLike, what: str) -> Array:
    """Return a direction; raise ModelError for the zero vector."""
    vector = constant(axis, (3,), f'{what}: axis')
    if not vector.any():
        raise ModelError(f'{what}: axis {vector.tolist()}; expected a nonzero vector')
    return vector


def pose(at: ArrayLike, rpy: ArrayLike, what: str,
         quaternion: ArrayLike | None = None) -> tuple[Array, Array]:
    """
    Return the rotation and translation of a pose.

    Parameters
    ----------
    at : (3,) array
        m.
    rpy : (3,) array
        Roll, pitch, yaw about fixed axes, as in URDF, rad.
    what : str
        Whose pose it is, for messages.
    quaternion : (4,) array, optional
        x, y, z, w, instead of `rpy`.

    Warns
    -----
    ModelWarning
        An angle is beyond a full turn, as degrees are.

    Raises
    ------
    ModelError
        If a number is not finite, both orientations are given, or the quaternion is no unit one.

    """
    if quaternion is not None:
        if np.any(rpy):
            raise ModelError(f'{what}: rpy and quaternion; expected one of them')
        return _rotation_of(quaternion, what), constant(at, (3,), f'{what}: at')
    R: Array = np.eye(3)
    angles = constant(rpy, (3,), f'{what}: rpy')
    warn_of_turns(angles, f'{what}: rpy', stacklevel=4)
    for axis, angle in zip(np.eye(3), angles):
        R = rotation_about(axis, float(angle)) @ R
    return snapped(R), constant(at, (3,), f'{what}: at')


def _rotation_of(quaternion: ArrayLike, what: str) -> Array:
    """Return the rotation matrix of a quaternion x, y, z, w, (3, 3)."""
    parts = constant(quaternion, (4,), f'{what}: quaternion')
    length = float(np.linalg.norm(parts))
    if abs(length - 1.0) > UNIT_LENGTH:
        raise ModelError(f'{what}: quaternion of length {length:g}; expected a unit quaternion '
                         'x, y, z, w')
    sine = float(np.linalg.norm(parts[:3]))
    if sine == 0.0:
        return np.eye(3)
    angle = 2.0 * math.atan2(sine, float(parts[3]))
    return snapped(rotation_about(parts[:3] / sine, angle))
