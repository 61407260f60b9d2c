"""
Ball joints: quaternions in q, angular velocities in u, and the maps between them.

A ball joint has four coordinates, the quaternion (x, y, z, w) of its body in the joint's frame,
and three speeds, the components omega of the body's angular velocity relative to its parent on the
body's own axes. A model without ball joints has as many coordinates as speeds; every function here
returns its argument for it.

**Local angles.** Let theta be three angles about x, y and z, each axis rotated by the previous
ones, that start at zero from the configuration q. There the axes are those of the body, so

    theta' = omega,    theta'' = omega' - gamma,    gamma = (w2 w3, -w1 w3, w1 w2)

gamma being the rate of the axes' directions times theta'. So every algorithm for revolute joints
is one for ball joints, with the rotation of q before the first of three joints at zero.
"""

from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.quaternion import (conjugate, exponential, logarithm,
                                                        normalized, product, quaternion_rate,
                                                        rotation_matrix)
from kane_dynamics.model.model import Model, WORLD
import numpy as np

UNIT = 1e-6  # largest error of the length of a quaternion in an initial state


class Ball(NamedTuple):
    """
    A ball joint: its first body, and where its speeds and its coordinates begin in u and q.

    `name` is the joint's, without the names of its parts.
    """

    name: str
    body: int
    speed: int
    place: int

    def quaternion(self, q: Any) -> Any:
        """Return the quaternion in q, (..., 4)."""
        return q[..., self.place:self.place + 4]

    def omega(self, u: Any) -> Any:
        """Return the angular velocity in u, (..., 3)."""
        return u[..., self.speed:self.speed + 3]


def balls(model: Model) -> list[Ball]:
    """Return the ball joints of a model, in the order of `Model.balls`."""
    firsts = {body: model.bodies[body].joint.coordinate for body in model.balls}
    return [Ball(model.bodies[body].joint.name.removesuffix('/wx'), body, r,
                 r + sum(other < r for other in firsts.values())) for body, r in firsts.items()]


def angles(model: Model) -> list[int]:
    """Return the indices in u of the joints that have a position."""
    return [r for r, place in enumerate(model.places) if place is not None]


def angle_places(model: Model) -> list[int]:
    """Return the indices in q of the positions of joints: all but those of quaternions."""
    return [place for place in model.places if place is not None]


def joint_positions(model: Model, q: Any) -> Any:
    """Return the positions of the joints of one degree of freedom, (n,): 0 in ball joints."""
    if not model.balls:
        return q
    return np.array([0.0 if place is None else q[place] for place in model.places])


def rotations(model: Model, q: Any) -> dict[int, Any]:
    """Return the rotation of the ball joints, (3, 3), by the index of their first body."""
    return {ball.body: rotation_matrix(ball.quaternion(q)) for ball in balls(model)}


def free_bodies(model: Model) -> list[Ball]:
    """Return the ball joints of free bodies: those that three slides of the world carry."""
    return [ball for ball in balls(model) if ball.body >= 3 and _slides_before(model, ball)]


def _slides_before(model: Model, ball: Ball) -> bool:
    """Return whether slides along x, y, z without mass, spring or rotor carry the ball alone."""
    first = ball.body - 3
    bodies, parents = model.bodies[first:ball.body], [body.parent for body in model.bodies]
    series = parents[first:ball.body + 1] == [WORLD, first, first + 1, first + 2] and all(
        parents.count(first + k) == 1 for k in range(3))
    still = all(np.array_equal(body.joint.rotation, np.eye(3)) and not body.joint.translation.any()
                for body in model.bodies[first + 1:ball.body + 1])
    massless = all(body.beam is None and not body.inertial.pseudo_inertia.any()
                   for body in bodies)
    used = [body.joint.coordinate for body in model.bodies]
    plain = all(joint.kind == 'prismatic' and np.array_equal(joint.axis, np.eye(3)[k])
                and joint.coordinate == ball.speed - 3 + k and used.count(joint.coordinate) == 1
                and joint.multiplier == 1.0 and joint.armature == joint.stiffness == 0.0
                for k, joint in enumerate(body.joint for body in bodies))
    return series and still and massless and plain


def coordinate_rates(model: Model, q: Any, v: Any) -> Any:
    """Return q', (n_q,), for the speeds of the joints, (n,)."""
    if not model.balls:
        return v
    return _arranged(model, v, {ball.place: quaternion_rate(ball.quaternion(q), ball.omega(v))
                                for ball in balls(model)})


def joint_speeds(model: Model, q: Any, qdot: Any) -> Any:
    """Return the speeds of the joints, (..., n), for q', (..., n_q): `coordinate_rates` undone."""
    if not model.balls:
        return qdot
    result = np.empty((*qdot.shape[:-1], model.n), dtype=np.result_type(q, qdot))
    result[..., angles(model)] = qdot[..., angle_places(model)]
    for ball in balls(model):
        p = ball.quaternion(q)
        result[..., ball.speed:ball.speed + 3] = (
            2.0 * product(conjugate(p), ball.quaternion(qdot))[..., :3]
            / np.sum(p * p, axis=-1, keepdims=True))
    return result


def on_unit_quaternions(model: Model, q: Any) -> Any:
    """Return q, (n_q,), with the quaternions divided by their lengths."""
    result = q
    for ball in balls(model):
        k = ball.place
        result = np.concatenate([result[:k], normalized(ball.quaternion(q)), result[k + 4:]])
    return result


def axis_acceleration(model: Model, u: Any) -> Any:
    """Return gamma of the module, (n,): omega' minus the accelerations of the local angles."""
    return sum((np.eye(model.n)[ball.speed:ball.speed + 3].T @ np.array([y * z, -(x * z), x * y])
                for ball in balls(model) for x, y, z in [ball.omega(u)]),
               np.zeros(model.n).astype(object))


def axis_rates(model: Model, u: Any) -> Any:
    """Return the matrix A(u), (n, n), with gamma = A u: omega = (1 + A dt) theta' after dt."""
    A = np.zeros((model.n, model.n)).astype(object)
    for ball in balls(model):
        r, (_, y, z) = ball.speed, ball.omega(u)
        A[r, r + 1], A[r + 1, r], A[r + 2, r] = z, -z, y
    return A


def neutral(model: Model) -> Array:
    """Return the configuration with all coordinates 0 and all ball joints unrotated, (n_q,)."""
    q = np.zeros(len(model.coordinate_names))
    for ball in balls(model):
        q[ball.place + 3] = 1.0
    return q


def moved(model: Model, q: Array, step: Array) -> Array:
    """Return q, (..., n_q), after constant speeds `step`, (..., n), for 1 s: exponential map."""
    if not model.balls:
        result: Array = q + step
        return result
    turned = {ball.place: product(ball.quaternion(q), exponential(ball.omega(step)))
              for ball in balls(model)}
    places = angle_places(model)
    result = np.empty((*np.broadcast_shapes(q.shape[:-1], step.shape[:-1]), q.shape[-1]))
    result[..., places] = q[..., places] + step[..., angles(model)]
    for place, p in turned.items():
        result[..., place:place + 4] = p / np.linalg.norm(p, axis=-1, keepdims=True)
    return result


def difference(model: Model, q0: Array, q1: Array) -> Array:
    """Return the step, (..., n), for which `moved` takes q0 to q1; rotations of at most pi."""
    if not model.balls:
        result: Array = q1 - q0
        return result
    places = angle_places(model)
    result = np.empty((*np.broadcast_shapes(q0.shape[:-1], q1.shape[:-1]), model.n))
    result[..., angles(model)] = q1[..., places] - q0[..., places]
    for ball in balls(model):
        result[..., ball.speed:ball.speed + 3] = logarithm(
            product(conjugate(ball.quaternion(q0)), ball.quaternion(q1)))
    return result


def chord(model: Model, q0: Any, q1: Any) -> Any:
    """
    Return the step, (n,), from q0 to q1, with 2 sin(angle / 2) for the angle of a ball joint.

    Of first order that is `difference`, but smooth, over any scalar, and not of batches.
    """
    if not model.balls:
        return q1 - q0
    result = [0.0 if place is None else q1[place] - q0[place] for place in model.places]
    for ball in balls(model):
        p = product(conjugate(ball.quaternion(q0)), ball.quaternion(q1))
        side = select(p[3] < 0.0, -2.0, 2.0)  # p and -p are one rotation
        result[ball.speed:ball.speed + 3] = [side * x for x in p[:3]]
    return np.array(result)


def require_unit(model: Model, q: Array, what: str) -> Array:
    """Return q, (..., n_q), with unit quaternions; InputError for one that is far from unit."""
    result = q.copy()
    for ball in balls(model):
        length = np.linalg.norm(ball.quaternion(q), axis=-1, keepdims=True)
        off = np.abs(length - 1.0)
        if off.max(initial=0.0) > UNIT:
            worst = float(length.ravel()[np.argmax(off)])
            raise InputError(f"{what}: the quaternion of '{ball.name}' has the length "
                             f'{worst:.9g}; expected 1 to within {UNIT:g}')
        ball.quaternion(result)[...] /= length
    return result


def least_square(model: Model, q: Any) -> Any:
    """Return the smallest squared length of the quaternions in q, (n_q,), over any scalar."""
    least: Any = None
    for ball in balls(model):
        square = sum((x * x for x in ball.quaternion(q)), 0.0)
        least = square if least is None else select(square < least, square, least)
    return least


def require_direction(model: Model, q: Array, square: float) -> None:
    """Raise InputError for a quaternion in q, (n_q,), without direction: of a small length."""
    for ball in balls(model):
        quaternion = ball.quaternion(q)
        if not quaternion @ quaternion > square:
            raise InputError(f"q: the quaternion of '{ball.name}' is {quaternion.tolist()}; "
                             'expected one of length 1')


def require_angles(model: Model, what: str) -> None:
    """Raise InputError for a model with ball joints, of a feature that needs joint positions."""
    if model.balls:
        names = ', '.join(f"'{ball.name}'" for ball in balls(model))
        raise InputError(f'{what}: a robot with ball joints ({names}), whose position is a '
                         "quaternion; expected joints with positions, such as kind='spherical' "
                         "or 'floating'")


def _arranged(model: Model, singles: Any, quaternions: dict[int, Any]) -> Any:
    """Return an array like q, (n_q,), from one like u, (n,), and what replaces the quaternions."""
    entries: list[Any] = [0.0] * len(model.coordinate_names)
    for r, place in enumerate(model.places):
        if place is not None:
            entries[place] = singles[r]
    for place, values in quaternions.items():
        entries[place:place + 4] = values
    return np.array(entries)
