"""
Ball joints of a model: three bodies in series whose joints share a quaternion in q.

The three joints have the angular velocity on the third body's axes as their entries in
u, so u has three entries where q has four. `Model.balls` holds the first body of each.
"""

from collections.abc import Sequence
import math
from typing import Any

from kane_dynamics.errors import ModelError
import numpy as np


def is_ball_part(index: int, balls: Sequence[int]) -> bool:
    """Return whether a body (or a degree of freedom) is a part of a ball joint."""
    return any(first <= index < first + 3 for first in balls)


def places(n: int, balls: Sequence[int]) -> tuple[int | None, ...]:
    """
    Return the index in q of each of n degrees of freedom; None for those of ball joints.

    `balls` are the first degrees of freedom of the ball joints, whose entries in q are
    one more.
    """
    indices: list[int | None] = []
    for freedom in range(n):
        if is_ball_part(freedom, balls):
            indices.append(None)
        else:
            # Each ball before it has an entry more in q than in u.
            preceding_balls = sum(first < freedom for first in balls)
            indices.append(freedom + preceding_balls)
    return tuple(indices)


def quaternion_names(names: Sequence[str], bodies: Sequence[Any],
                     balls: Sequence[int]) -> tuple[str, ...]:
    """Return the names of q from those of u: /qx to /qw of a ball for /wx to /wz."""
    # Entries of u that begin a ball joint; the next two are its other parts.
    first_freedoms = [bodies[first].joint.coordinate for first in balls]
    names_of_q: list[str] = []
    for freedom, name in enumerate(names):
        if freedom in first_freedoms:
            joint = name.removesuffix('/wx')
            names_of_q += [f'{joint}/q{part}' for part in 'xyzw']
        elif not is_ball_part(freedom, first_freedoms):
            names_of_q.append(name)
    return tuple(names_of_q)


def check_ball_property(joint: str, properties: dict[str, Any]) -> None:
    """Raise ModelError for a property that needs an angle, which a ball joint lacks."""
    limits = properties.get('limits')
    # Limits of velocity and effort need no angle.
    if limits is not None and (limits.lower, limits.upper) != (-math.inf, math.inf):
        raise ModelError(f"joint '{joint}': limits {limits.lower:g} to {limits.upper:g} "
                         'of a part of a ball joint, which has no angle; expected '
                         'limits of velocity and effort alone')
    for name in ('armature', 'stiffness', 'rest', 'load_friction',
                 'load_friction_backdriven'):
        if properties.get(name):
            raise ModelError(f"joint '{joint}': {name} {properties[name]:g} of a part "
                             'of a ball joint, which has no angle; expected damping, '
                             'friction or limits of velocity and effort')


def check_balls(bodies: Sequence[Any], balls: Sequence[int]) -> None:
    """Raise ModelError unless the bodies of ball joints are as `Model.balls` says."""
    # Bodies that use each coordinate: two uses are a joint and its mimic.
    uses = [body.joint.coordinate for body in bodies]
    for first in balls:
        parts = bodies[first:first + 3]
        if not _form_a_ball(parts, first):
            raise ModelError(f'ball joint of bodies {[body.name for body in parts]}: '
                             'expected revolute joints about x, y and z, in series, '
                             'with one origin, whose coordinates follow each other in '
                             'that order')
        for body in parts:
            joint = body.joint
            check_ball_property(joint.name, {
                'limits': joint.limits, 'armature': joint.armature,
                'stiffness': joint.stiffness, 'rest': joint.rest})
            # Another use of a coordinate is a mimic joint.
            if uses.count(joint.coordinate) > 1:
                raise ModelError(f"joint '{joint.name}': a part of a ball joint that "
                                 'another joint mimics; expected a joint of one degree '
                                 'of freedom')


def _form_a_ball(parts: Sequence[Any], first: int) -> bool:
    """Return whether bodies from index `first` on are the three of a ball joint."""
    if len(parts) != 3:
        return False
    start = parts[0].joint.coordinate
    # Three plain revolute joints about x, y and z, whose coordinates follow each other.
    for k, body in enumerate(parts):
        joint = body.joint
        plain = (joint.kind == 'revolute' and joint.multiplier == 1.0
                 and joint.offset == 0.0 and joint.deflection is None)
        about_its_axis = np.array_equal(joint.axis, np.eye(3)[k])
        if not (plain and about_its_axis and joint.coordinate == start + k):
            return False
        # The second and third joint sit at the origin of the one before.
        if k > 0:
            follows = body.parent == first + k - 1
            at_the_origin = not joint.translation.any()
            unturned = np.array_equal(joint.rotation, np.eye(3))
            if not (follows and at_the_origin and unturned):
                return False
    return True
