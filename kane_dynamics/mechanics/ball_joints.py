"""
Ball joints: quaternions in q, angular velocities in u, and the maps between them.

A ball joint has four coordinates, the quaternion (x, y, z, w) of its body in the joint's
frame, and three speeds, the components omega of the body's angular velocity relative to
its parent on the body's own axes. A model without ball joints has as many coordinates as
speeds; every function here returns its argument for it.

**Local angles.** Let theta be three angles about x, y and z, each axis rotated by the
previous ones, that start at zero from the configuration q. There the axes are those of
the body, so

    theta' = omega,    theta'' = omega' - gamma,    gamma = (w2 w3, -w1 w3, w1 w2)

gamma being the rate of the axes' directions times theta'. So every algorithm for
revolute joints is one for ball joints, with the rotation of q before the first of three
joints at zero.
"""

from typing import NamedTuple

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.quaternion import (conjugate, exponential,
                                                        logarithm, normalized,
                                                        quaternion_product,
                                                        quaternion_rate, rotation_matrix)
from kane_dynamics.model.model import Model, WORLD
import numpy as np

UNIT = 1e-6  # largest error of the length of a quaternion in an initial state


class Ball(NamedTuple):
    """
    A ball joint: its first body, and where its part of u and of q begins.

    `name` is the joint's, without the names of its parts.
    """

    name: str
    body: int
    speed: int
    place: int

    def quaternion(self, q: Vector) -> Vector:
        """Return the quaternion in q, (..., 4)."""
        return q[..., self.place:self.place + 4]

    def omega(self, u: Vector) -> Vector:
        """Return the angular velocity in u, (..., 3)."""
        return u[..., self.speed:self.speed + 3]


def balls(model: Model) -> list[Ball]:
    """Return the ball joints of a model, in the order of `Model.balls`."""
    result = []
    speeds = []
    for body in model.balls:
        joint = model.bodies[body].joint
        speeds.append(joint.coordinate)
        result.append(Ball(joint.name.removesuffix('/wx'), body, joint.coordinate, 0))
    # A ball joint has one coordinate more than speeds, so that those after it in u are
    # one further in q.
    speeds.sort()
    for k, ball in enumerate(result):
        result[k] = ball._replace(place=ball.speed + speeds.index(ball.speed))
    return result


def angles(model: Model) -> list[int]:
    """Return the indices in u of the joints that have a position."""
    return [r for r, place in enumerate(model.places) if place is not None]


def angle_places(model: Model) -> list[int]:
    """Return the indices in q of the positions of joints: without quaternions."""
    return [place for place in model.places if place is not None]


def joint_positions(model: Model, q: Vector) -> Vector:
    """Return the positions of the joints of one degree of freedom, 0 in balls, (n,)."""
    if not model.balls:
        return q
    positions: list[Scalar] = []
    for place in model.places:
        positions.append(0.0 if place is None else q[place])
    return np.array(positions)


def rotations(model: Model, q: Vector) -> dict[int, Matrix]:
    """Return the rotation of the ball joints, (3, 3), by their first body's index."""
    result = {}
    if model.balls:
        for ball in balls(model):
            result[ball.body] = rotation_matrix(ball.quaternion(q))
    return result


def free_bodies(model: Model) -> list[Ball]:
    """Return the ball joints of free bodies: those that three slides carry."""
    result = []
    if model.balls:
        for ball in balls(model):
            if ball.body >= 3 and _slides_before(model, ball):
                result.append(ball)
    return result


def _slides_before(model: Model, ball: Ball) -> bool:
    """Return whether slides along x, y, z without mass or rotor carry the ball alone."""
    first = ball.body - 3
    parents = [body.parent for body in model.bodies]
    in_series = [WORLD, first, first + 1, first + 2]
    if parents[first:ball.body + 1] != in_series:
        return False
    # The slides coincide, as do the last of them and the ball.
    for body in model.bodies[first + 1:ball.body + 1]:
        joint = body.joint
        if not np.array_equal(joint.rotation, np.eye(3)) or joint.translation.any():
            return False
    # A slide carries only the next body and has no mass, rotor, spring or drive; no
    # joint mimics it.
    coordinates = [body.joint.coordinate for body in model.bodies]
    for k, body in enumerate(model.bodies[first:ball.body]):
        if parents.count(first + k) != 1:
            return False
        if body.beam is not None or body.inertial.pseudo_inertia.any():
            return False
        joint = body.joint
        coordinate = ball.speed - 3 + k
        if joint.coordinate != coordinate or coordinates.count(coordinate) != 1:
            return False
        if joint.kind != 'prismatic' or not np.array_equal(joint.axis, np.eye(3)[k]):
            return False
        if (joint.multiplier, joint.armature, joint.stiffness) != (1.0, 0.0, 0.0):
            return False
        if joint.drive is not None:
            return False
    return True


def coordinate_rates(model: Model, q: Vector, v: Vector) -> Vector:
    """Return q', (n_q,), for the speeds of the joints, (n,)."""
    if not model.balls:
        return v
    rates: list[Scalar] = [0.0] * len(model.coordinate_names)
    # A quaternion turns by p' = 1/2 p (omega, 0);
    # all other coordinates have the joints' rates.
    quaternion_rates = [quaternion_rate(ball.quaternion(q), ball.omega(v))
                        for ball in balls(model)]
    for r, place in enumerate(model.places):
        if place is not None:
            rates[place] = v[r]
    for ball, p_rate in zip(balls(model), quaternion_rates):
        rates[ball.place:ball.place + 4] = p_rate
    return np.array(rates)


def joint_speeds(model: Model, q: Vector, qdot: Vector) -> Vector:
    """Return the speeds of the joints, (..., n), for q', (..., n_q)."""
    if not model.balls:
        return qdot
    speeds = np.empty((*qdot.shape[:-1], model.n), dtype=np.result_type(q, qdot))
    speeds[..., angles(model)] = qdot[..., angle_places(model)]
    for ball in balls(model):
        # omega = 2 p* p' / |p|^2, the inverse of `quaternion_rate`
        p = ball.quaternion(q)
        square = np.sum(p * p, axis=-1, keepdims=True)
        rates = quaternion_product(conjugate(p), ball.quaternion(qdot))
        omega = 2.0 * rates[..., :3] / square
        speeds[..., ball.speed:ball.speed + 3] = omega
    return speeds


def on_unit_quaternions(model: Model, q: Vector) -> Vector:
    """Return q, (n_q,), with the quaternions divided by their lengths."""
    result = q
    for ball in balls(model):
        k = ball.place
        p = normalized(ball.quaternion(q))
        result = np.concatenate([result[:k], p, result[k + 4:]])
    return result


def axis_acceleration(model: Model, u: Vector) -> Vector:
    """Return gamma of the module, (n,): omega' minus the local angles' accelerations."""
    total = np.zeros(model.n).astype(object)
    for ball in balls(model):
        x, y, z = ball.omega(u)
        # The equation of the module.
        gamma = np.array([y * z, -(x * z), x * y])
        total = total + np.eye(model.n)[ball.speed:ball.speed + 3].T @ gamma
    return total


def axis_rates(model: Model, u: Vector) -> Matrix:
    """Return A(u), (n, n), with gamma = A u: omega = (1 + A dt) theta' after dt."""
    A = np.zeros((model.n, model.n)).astype(object)
    for ball in balls(model):
        r = ball.speed
        _, y, z = ball.omega(u)
        A[r, r + 1] = z
        A[r + 1, r] = -z
        A[r + 2, r] = y
    return A


def neutral(model: Model) -> Array:
    """Return the configuration, (n_q,), with angles 0 and ball joints unrotated."""
    q = np.zeros(len(model.coordinate_names))
    for ball in balls(model):
        q[ball.place + 3] = 1.0
    return q


def moved(model: Model, q: Array, step: Array) -> Array:
    """Return q, (..., n_q), after constant speeds `step` for 1 s: exponential map."""
    if not model.balls:
        result: Array = q + step
        return result
    places = angle_places(model)
    batch = np.broadcast_shapes(q.shape[:-1], step.shape[:-1])
    # Joints with one coordinate move in proportion to the time.
    result = np.empty((*batch, q.shape[-1]))
    result[..., places] = q[..., places] + step[..., angles(model)]
    for ball in balls(model):
        # The speeds are on the body's axes, so that the exponential is the right factor.
        p = quaternion_product(ball.quaternion(q), exponential(ball.omega(step)))
        length = np.linalg.norm(p, axis=-1, keepdims=True)
        result[..., ball.place:ball.place + 4] = p / length
    return result


def difference(model: Model, q0: Array, q1: Array) -> Array:
    """Return the step, (..., n), for which `moved` takes q0 to q1; at most pi."""
    if not model.balls:
        result: Array = q1 - q0
        return result
    places = angle_places(model)
    batch = np.broadcast_shapes(q0.shape[:-1], q1.shape[:-1])
    result = np.empty((*batch, model.n))
    result[..., angles(model)] = q1[..., places] - q0[..., places]
    for ball in balls(model):
        # The rotation from q0 to q1, about the body's axes.
        p = quaternion_product(conjugate(ball.quaternion(q0)), ball.quaternion(q1))
        result[..., ball.speed:ball.speed + 3] = logarithm(p)
    return result


def chord(model: Model, q0: Vector, q1: Vector) -> Vector:
    """
    Return the step, (n,), from q0 to q1, with 2 sin(angle / 2) of ball joints.

    Of first order that is `difference`, but smooth, over any scalar, and not of batches.
    """
    if not model.balls:
        return q1 - q0
    step: list[Scalar] = []
    for place in model.places:
        step.append(0.0 if place is None else q1[place] - q0[place])
    for ball in balls(model):
        # Vector part of the rotation from q0 to q1: sin(angle / 2) along the axis.
        p = quaternion_product(conjugate(ball.quaternion(q0)), ball.quaternion(q1))
        factor = select(p[3] < 0.0, -2.0, 2.0)  # p and -p are one rotation
        step[ball.speed:ball.speed + 3] = [factor * x for x in p[:3]]
    return np.array(step)


def require_unit(model: Model, q: Array, what: str) -> Array:
    """Return q, (..., n_q), with unit quaternions; InputError if one is far off."""
    result = q.copy()
    for ball in balls(model):
        with np.errstate(over='ignore'):  # an infinite length is refused
            length = np.linalg.norm(ball.quaternion(q), axis=-1, keepdims=True)
        off = np.abs(length - 1.0)
        if off.max(initial=0.0) > UNIT:
            worst = float(length.ravel()[np.argmax(off)])
            raise InputError(f"{what}: the quaternion of '{ball.name}' has the length "
                             f'{worst:.9g}; expected 1 to within {UNIT:g}')
        # A deviation within the tolerance is rounding of the caller's: normalise it.
        ball.quaternion(result)[...] /= length
    return result


def least_square(model: Model, q: Vector) -> Scalar:
    """Return the smallest squared length of the quaternions in q, (n_q,)."""
    # A minimum without a branch, so that it can be traced.
    least: Scalar = None
    for ball in balls(model):
        square = sum((x * x for x in ball.quaternion(q)), 0.0)
        if least is None:
            least = square
        else:
            least = select(square < least, square, least)
    return least


def require_direction(model: Model, q: Array, square: float) -> None:
    """Raise InputError for a quaternion in q, (n_q,), of almost no length."""
    for ball in balls(model):
        quaternion = ball.quaternion(q)
        # `not ... >` refuses NaN too.
        if not quaternion @ quaternion > square:
            values = quaternion.tolist()
            raise InputError(f"q: the quaternion of '{ball.name}' is {values}; "
                             'expected one of length 1')


def require_angles(model: Model, what: str) -> None:
    """Raise InputError for a model with ball joints where joint positions are needed."""
    if model.balls:
        names = ', '.join(f"'{ball.name}'" for ball in balls(model))
        raise InputError(f'{what}: a robot with ball joints ({names}), whose position '
                         'is a quaternion; expected joints with positions, such as '
                         "kind='spherical' or 'floating'")
