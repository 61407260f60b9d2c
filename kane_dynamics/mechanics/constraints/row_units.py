"""Units for the comparison of constraint rows and coordinates."""

from collections.abc import Sequence
import math

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.constraints import (Closure, Constraint, Coupling,
                                                 PointVelocity, Prescribed)
from kane_dynamics.mechanics.friction import breakaway_levels
from kane_dynamics.model.model import Inertial, Joint, Model, WORLD
import numpy as np

# Of the mechanism: points of a loop that are nearer coincide. Files round lengths, and axes
# that meet in a point are then some 1e-7 m apart.
ROUNDING = 1e-6


def length_of(model: Model, constraints: Sequence[Constraint] = ()) -> float:
    """
    Return the characteristic length, m.

    It scales moments to forces and angles to distances. It is the longest distance
    between neighbouring joints, or from a body to one of its frames; where there is
    none, the longest one that a constraint states, such as the radius of a wheel; else
    the largest radius of gyration of a body. 1 for bodies without extent.
    """
    # Distances between neighbouring joints, and from bodies to their frames.
    places = [body.joint.translation for body in model.bodies if body.parent != WORLD]
    places += [frame.translation for frame in model.frames if frame.body != WORLD]
    distances = [float(np.linalg.norm(place)) for place in places]
    longest = max(distances, default=0.0)
    if longest > 0.0:
        return longest

    # Lengths that constraints state.
    stated = []
    for constraint in constraints:
        for name in ('radius', 'surface_radius', 'length'):
            length = getattr(constraint, name, None)
            if length is not None:
                stated.append(length)
    longest = max(stated, default=0.0)
    if longest > 0.0:
        return longest

    # Radii of gyration, where all joints and frames coincide.
    radii = [_gyration(body.inertial) for body in model.bodies]
    return max(radii, default=0.0) or 1.0


def rate_of(model: Model, constraints: Sequence[Constraint] = ()) -> float:
    """
    Return the characteristic rate of a mechanism, 1/s.

    It is sqrt(F / (m L)), with the characteristic length L, the mass m, rotors included, and
    the larger F of the weight and of the largest friction of a joint: the rate of a motion
    that they end or begin within about a radian. 1 without weight and friction.
    """
    length = length_of(model, constraints)
    mass = 0.0
    largest_friction = 0.0
    for body in model.bodies:
        joint = body.joint
        # Torques and inertias of joints that turn, as forces and masses at this length.
        arm = 1.0 if joint.kind == 'prismatic' else length
        mass += body.inertial.mass + joint.armature / arm**2
        friction = max(breakaway_levels(joint)) / arm
        largest_friction = max(largest_friction, friction)
    force = max(mass * float(np.linalg.norm(model.gravity)), largest_friction)
    if force == 0.0 or mass == 0.0:
        return 1.0
    return math.sqrt(force / (mass * length))


def closure_length(model: Model, closure: Closure, longest: float) -> float:
    """
    Return the characteristic length of one loop, m, by which its residual is judged.

    It is the longest distance between neighbouring joints and frames of the loop alone,
    so that a small loop counts as open although a distant frame makes the mechanism
    long. `longest`, the mechanism's, stands for it where the points of the loop
    coincide.
    """
    frames = {frame.name: frame for frame in model.frames}
    if closure.first not in frames or closure.second not in frames:
        return longest  # the closure itself names the unknown frame where it is used
    ends = [frames[closure.first], frames[closure.second]]
    branches = [list(model.path(frame.body)) for frame in ends]
    shared = set(branches[0]) & set(branches[1])

    # Along both branches down to the body that they share, or the world. Where the zero
    # of a joint that slides lies along its axis says nothing about the size of the loop.
    distances = [closure.length or 0.0]
    roots = []
    for frame, branch in zip(ends, branches):
        place = frame.translation
        for body in branch:
            if body in shared:
                break
            distances.append(float(np.linalg.norm(place)))
            place = _beside_axis(model.bodies[body].joint)
        roots.append(place)
    # On the shared body: between the joints that begin the branches.
    distances.append(float(np.linalg.norm(roots[0] - roots[1])))

    own = max(distances)
    return own if own > ROUNDING * longest else longest


def _beside_axis(joint: Joint) -> Array:
    """Return a joint's translation, m; without the part along the axis if it slides."""
    if joint.kind != 'prismatic':
        return joint.translation
    axis = joint.rotation @ joint.axis
    return np.asarray(joint.translation - (axis @ joint.translation) * axis)


def _gyration(inertial: Inertial) -> float:
    """Return a body's largest radius of gyration about its origin, m; 0 without mass."""
    if inertial.mass <= 0.0:
        return 0.0
    # int r . r dm / m about the origin, by the parallel axis theorem.
    about_com = 0.5 * float(np.trace(inertial.inertia)) / inertial.mass
    return math.sqrt(max(about_com + float(inertial.com @ inertial.com), 0.0))


def coordinate_units(model: Model, constraints: Sequence[Constraint] = ()) -> Array:
    """Return the unit of each coordinate, (n_q,): the length if sliding, else 1."""
    units = np.ones(len(model.coordinate_names))
    length = length_of(model, constraints)
    for name, place in zip(model.joint_names, model.places):
        if place is not None and name in model.sliding:
            units[place] = length
    return units


def turning_rows(constraint: Constraint, model: Model) -> list[bool]:
    """Return for each row of a constraint whether it constrains a rotation."""
    if isinstance(constraint, Coupling | Prescribed):
        return [constraint.joint not in model.sliding]
    if isinstance(constraint, PointVelocity):
        return [constraint.angular]
    turning = []
    # Other constraints name their rows of rotation so.
    for label in constraint.labels:
        _, _, row = label.rpartition('/')
        turning.append(row.startswith('turn_'))
    return turning
