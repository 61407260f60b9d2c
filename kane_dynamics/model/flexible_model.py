"""Replace links of a model by beams, and beams by rigid links."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
from kane_dynamics.model.flexible_link import AssumedModes, FlexibleLink
from kane_dynamics.model.joint_expansion import quaternion_names
from kane_dynamics.model.model import Body, Frame, Inertial, Joint, Model, WORLD
import numpy as np

ON_AXIS = 1e-9  # relative to the length: distance at which a joint is at a section


def with_beam(model: Model, link: str, beam: FlexibleLink,
              riders: Collection[tuple[str, Inertial]] = ()) -> Model:
    """
    Return the model with one of its links replaced by a beam.

    The beam begins at the link's joint. Its inertia replaces that of the body, except for
    `riders`. Joints and frames on the link are attached to the nearest section of the beam; those
    behind the joint are attached to the root.

    Parameters
    ----------
    model : Model
        A chain or tree, rigid or with other beams.
    link : str
        Name of a moving body, in whose axes the beam's `direction` and `up` are given.
    beam : FlexibleLink
        The beam.
    riders : collection of (str, Inertial)
        Inertias attached to the link that are kept: a frame on the link, and the inertia in its
        axes. They move with that frame; inertia in the link's own frame moves with the section
        nearest to its center of mass.

    Raises
    ------
    ModelError
        If the body does not exist or is a beam already, or a value of the beam is invalid.

    """
    names = [body.name for body in model.bodies]
    if link not in names:
        raise ModelError(f"no moving link '{link}' to bend; expected one of {', '.join(names)}")
    k = names.index(link)
    if model.bodies[k].beam is not None:
        raise ModelError(f"link '{link}': is a beam already; expected a rigid link")
    shape = beam.checked(link)
    coordinates = tuple(range(model.n, model.n + shape.count))
    own = replace(model.bodies[k], inertial=shape.inertial,
                  beam=shape.beam(coordinates) if shape.count else None)
    sections = _Sections(shape, k, coordinates)
    children = {i: sections.place(body.joint.translation, body.joint.rotation)
                for i, body in enumerate(model.bodies) if body.parent == k}
    frames = {frame.name: sections.place(frame.translation, frame.rotation)
              for frame in model.frames if frame.body == k}
    tip = sections.place(shape.length * shape.axes[0], np.eye(3))
    for name, inertial in riders:
        own = sections.with_load(model.frame(name), inertial, own)
    more = len(sections.bodies)

    def number(i: int) -> int:
        return i if i <= k else i + more
    rest = []
    for i, body in enumerate(model.bodies[k + 1:], k + 1):
        parent, joint = number(body.parent), body.joint
        if i in children:
            parent, p, R = children[i]
            joint = replace(joint, translation=p, rotation=R)
        rest.append(replace(body, parent=parent, joint=joint))
    moved = [Frame(frame.name, *_rotation_first(frames[frame.name])) if frame.name in frames else
             replace(frame, body=number(frame.body)) for frame in model.frames]
    moved.append(Frame(f'{link}/tip', *_rotation_first(tip)))
    return replace(model, bodies=(*model.bodies[:k], own, *sections.bodies, *rest),
                   frames=tuple(moved), balls=tuple(number(b) for b in model.balls),
                   coordinate_names=(*model.coordinate_names, *shape.names))


def stiffened(model: Model) -> Model:
    """Return the model with rigid straight links in place of beams, without modal coordinates."""
    if not model.flexible:
        return model
    modal = model.modal_coordinates
    numbers = {k: number for number, k in enumerate(
        k for k in range(model.n) if k not in modal)}
    bodies: list[Body] = []
    places: list[tuple[int, Array, Array]] = []  # carrier and pose of each body of the model

    def placed(on: int, R: Array, p: Array) -> tuple[int, Array, Array]:
        if on == WORLD:
            return on, R, p
        body, R_on, p_on = places[on]
        return body, R_on @ R, p_on + R_on @ p
    for body in model.bodies:
        on, R, p = placed(body.parent, body.joint.rotation, body.joint.translation)
        if body.joint.deflection is None:
            bodies.append(replace(body, parent=on, beam=None, joint=replace(
                body.joint, rotation=R, translation=p,
                coordinate=numbers[body.joint.coordinate])))
            places.append((len(bodies) - 1, np.eye(3), np.zeros(3)))
        else:  # a section
            bodies[on] = replace(bodies[on],
                                 inertial=bodies[on].inertial + body.inertial.moved(R, p))
            places.append((on, R, p))
    frames = []
    for frame in model.frames:
        on, R, p = placed(frame.body, frame.rotation, frame.translation)
        frames.append(Frame(frame.name, on, R, p))
    balls = tuple(places[b][0] for b in model.balls)
    return replace(model, bodies=tuple(bodies), frames=tuple(frames), balls=balls,
                   coordinate_names=quaternion_names(
                       [model.joint_names[k] for k in numbers],
                       [bodies[b].joint.coordinate for b in balls]))


class _Sections:
    """Sections of a beam, created on demand as massless bodies in series."""

    def __init__(self, modes: AssumedModes, body: int, coordinates: tuple[int, ...]) -> None:
        self.bodies: list[Body] = []
        self._shape, self._body, self._coordinates = modes, body, coordinates
        self._ends: dict[float, int] = {}

    def with_load(self, frame: Frame, inertial: Inertial, own: Body) -> Body:
        """Add inertia, given in a frame's axes, to its section; return the beam's root body."""
        at = frame.translation if frame.name != self._shape.name else inertial.com
        body, p, R = self.place(at, frame.rotation)
        moved = inertial.moved(R, p + frame.translation - at)
        if body == self._body:
            return replace(own, inertial=own.inertial + moved)
        section = self.bodies[body - self._body - 1]
        self.bodies[body - self._body - 1] = replace(section, inertial=section.inertial + moved)
        return own

    def place(self, p: Array, R: Array) -> tuple[int, Array, Array]:
        """Return the carrying body of a pose on the straight beam, and the pose on that body."""
        e, length = self._shape.axes[0], self._shape.length
        x = min(float(p @ e), length)
        if x <= ON_AXIS * length or not self._coordinates:
            return self._body, p, R
        x = next((at for at in self._ends if abs(at - x) < ON_AXIS * length), x)
        if x not in self._ends:
            parent, start = self._body, x * e
            for name, kind, axis, deflection in self._shape.deflections(x, self._coordinates):
                label = f'{self._shape.name}/at_{x:.6g}/{name}'
                self.bodies.append(Body(label, parent, Joint(
                    label, kind, axis, np.eye(3), start, self._coordinates[0],
                    deflection=deflection)))
                parent, start = self._body + len(self.bodies), np.zeros(3)
            self._ends[x] = parent
        return self._ends[x], p - x * e, R


def _rotation_first(place: tuple[int, Any, Any]) -> tuple[int, Any, Any]:
    body, p, R = place
    return body, R, p
