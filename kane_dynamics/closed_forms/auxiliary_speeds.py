"""
Auxiliary generalized speeds: joints with fictitious motion along constrained directions.

A joint gets a further joint behind it, at zero, without mass between. The generalized
forces of its speed contain the reaction in its direction (Kane & Levinson, chapter 4).
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.constraints.speeds import Speeds
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.model import Body, Joint, Model
import numpy as np

DIRECTIONS = ('x', 'y', 'z', 'rx', 'ry', 'rz')


def with_auxiliary_speeds(mechanism: Mechanism, names: Sequence[str]) -> Mechanism:
    """
    Return a mechanism with a speed for each name '<joint>:<direction>', the last ones.

    Raises
    ------
    InputError
        An unknown joint or direction, or a joint that carries a beam.

    """
    model = mechanism.model
    for name in names:
        model = _with_auxiliary_joint(model, name)
    n = mechanism.model.n
    speeds = mechanism.speeds

    def Y(q: Any, t: Any) -> Any:
        inner, _ = speeds.of(q[:len(q) - len(names)], t)
        result = np.eye(n + len(names)).astype(object)
        result[:n, :n] = inner
        return result

    def Z(q: Any, t: Any) -> Any:
        _, inner = speeds.of(q[:len(q) - len(names)], t)
        return np.concatenate([inner, np.zeros(len(names))])

    if not names:
        return mechanism
    extended = Speeds(Y, Z, (*speeds.names, *names), speeds.key or 'user functions')
    free = [*mechanism.free, *range(n, n + len(names))]
    return Mechanism(model, extended, mechanism.constraints, free, mechanism.kept,
                     mechanism.sizes, mechanism.rank_tolerance)


def _with_auxiliary_joint(model: Model, name: str) -> Model:
    """Return the model with one more joint, the last coordinate."""
    joint_name, _, direction = name.rpartition(':')
    places = {body.joint.name: k for k, body in enumerate(model.bodies)}
    if joint_name not in places or direction not in DIRECTIONS:
        raise InputError(f"auxiliary: '{name}'; expected a constraint row, or "
                         f"'<joint>:<direction>' with a joint of {', '.join(places)} and "
                         f'a direction of {", ".join(DIRECTIONS)}')
    k = places[joint_name]
    carrier = model.bodies[k]
    if carrier.beam is not None:
        raise InputError(f"auxiliary: '{name}', the joint of a beam; expected that of a "
                         'rigid body')
    axis = np.eye(3)[DIRECTIONS.index(direction) % 3]
    kind = 'revolute' if direction.startswith('r') else 'prismatic'
    # The new body has the mass, the frames and the children of the joint's body.
    joint = Joint(name, kind, axis, coordinate=model.n)  # type: ignore[arg-type]
    bodies = [*model.bodies[:k], replace(carrier, inertial=Inertial(), name=name),
              Body(carrier.name, k, joint, carrier.inertial)]

    def carried(carrier: int) -> int:
        return carrier + 1 if carrier >= k else carrier
    bodies += [replace(body, parent=carried(body.parent)) for body in model.bodies[k + 1:]]
    frames = [replace(frame, body=carried(frame.body)) for frame in model.frames]
    balls = tuple(ball + 1 if ball > k else ball for ball in model.balls)
    return replace(model, bodies=tuple(bodies), frames=tuple(frames), balls=balls,
                   coordinate_names=(*model.coordinate_names, name))
