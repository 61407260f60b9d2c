"""Replace links of a model by beams, and beams by rigid links."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from kane_dynamics._util.checks import instance
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
from kane_dynamics.model.ball_coordinates import quaternion_names
from kane_dynamics.model.flexible_link import AssumedModes, FlexibleLink
from kane_dynamics.model.model import Body, Frame, Inertial, Joint, Model, WORLD
import numpy as np

Place = tuple[int, Array, Array]  # a body, and a rotation and a translation in its axes
ON_AXIS = 1e-9  # relative to the length: distance at which a joint is at a section


def with_beam(model: Model, link: str, beam: FlexibleLink,
              riders: Collection[tuple[str, Inertial]] = ()) -> Model:
    """
    Return the model with one of its links replaced by a beam.

    The beam begins at the link's joint. Its inertia replaces that of the body, except
    for `riders`. Joints and frames on the link are attached to the nearest section of
    the beam; those behind the joint are attached to the root.

    Parameters
    ----------
    model : Model
        A chain or tree, rigid or with other beams.
    link : str
        Name of a moving body, in whose axes the beam's `direction` and `up` are given.
    beam : FlexibleLink
        The beam.
    riders : collection of (str, Inertial)
        Inertias attached to the link that are kept: a frame on the link, and the inertia
        in its axes. They move with that frame; inertia in the link's own frame moves
        with the section nearest to its center of mass.

    Raises
    ------
    ModelError
        If the body does not exist or is a beam already, or a value of the beam is
        invalid.

    """
    instance(model, Model, 'model')
    instance(beam, FlexibleLink, 'beam')
    names = [body.name for body in model.bodies]
    if link not in names:
        raise ModelError(f"no moving link '{link}' to bend; expected one of "
                         f"{', '.join(names)}")
    # The link's root becomes the beam's: its inertia is that of the modes.
    bent = names.index(link)
    if model.bodies[bent].beam is not None:
        raise ModelError(f"link '{link}': is a beam already; expected a rigid link")
    modes = beam.assumed_modes(link)
    coordinates = tuple(range(model.n, model.n + modes.count))
    root = replace(model.bodies[bent], inertial=modes.inertial)
    if modes.count:
        root = replace(root, beam=modes.beam(coordinates))

    # What the link carries moves to sections, which become bodies behind its root.
    sections = _Sections(modes, bent, coordinates)
    carried_joints, carried_frames = _on_sections(model, bent, sections)
    tip = sections.place(np.eye(3), modes.length * modes.axes[0])
    for name, inertial in riders:
        root = sections.with_load(model.frame(name), inertial, root)

    # Bodies behind the link have new numbers, since the sections come before them.
    def number(body: int) -> int:
        return body if body <= bent else body + len(sections.bodies)
    outer_bodies = []
    for index, body in enumerate(model.bodies[bent + 1:], bent + 1):
        # A body on the link is carried by a section, at the place where it was.
        if index in carried_joints:
            parent, R, p = carried_joints[index]
            joint = replace(body.joint, rotation=R, translation=p)
            outer_bodies.append(replace(body, parent=parent, joint=joint))
        else:
            outer_bodies.append(replace(body, parent=number(body.parent)))
    frames = []
    for frame in model.frames:
        if frame.name in carried_frames:
            frames.append(Frame(frame.name, *carried_frames[frame.name]))
        else:
            frames.append(replace(frame, body=number(frame.body)))
    frames.append(Frame(f'{link}/tip', *tip))
    bodies = (*model.bodies[:bent], root, *sections.bodies, *outer_bodies)
    return replace(model, bodies=bodies, frames=tuple(frames),
                   balls=tuple(number(first) for first in model.balls),
                   coordinate_names=(*model.coordinate_names, *modes.names))


def _on_sections(model: Model, bent: int,
                 sections: _Sections) -> tuple[dict[int, Place], dict[str, Place]]:
    """Return the places of a body's outward joints, and of its frames, on sections."""
    joints = {}
    # Joints and frames of the straight beam move to the section at their distance.
    for index, body in enumerate(model.bodies):
        if body.parent == bent:
            joint = body.joint
            joints[index] = sections.place(joint.rotation, joint.translation)
    frames = {}
    for frame in model.frames:
        if frame.body == bent:
            frames[frame.name] = sections.place(frame.rotation, frame.translation)
    return joints, frames


def stiffened(model: Model) -> Model:
    """Return the model with rigid links for beams, without modal coordinates."""
    instance(model, Model, 'model')
    if not model.flexible:
        return model
    # Outward, as in `with_locked`: sections merge into their beam, all others stay.
    modal = model.modal_coordinates
    rigid = [k for k in range(model.n) if k not in modal]
    bodies: list[Body] = []
    places: list[Place] = []  # of the model's bodies, on those of the result

    def placed(body: int, R: Array, p: Array) -> Place:
        if body == WORLD:
            return body, R, p
        carrier, R_carrier, p_carrier = places[body]
        return carrier, R_carrier @ R, p_carrier + R_carrier @ p
    for body in model.bodies:
        carrier, R, p = placed(body.parent, body.joint.rotation, body.joint.translation)
        if body.joint.deflection is None:
            joint = replace(body.joint, rotation=R, translation=p,
                            coordinate=rigid.index(body.joint.coordinate))
            bodies.append(replace(body, parent=carrier, beam=None, joint=joint))
            places.append((len(bodies) - 1, np.eye(3), np.zeros(3)))
        else:  # a section, which becomes a part of its beam
            inertial = bodies[carrier].inertial + body.inertial.moved(R, p)
            bodies[carrier] = replace(bodies[carrier], inertial=inertial)
            places.append((carrier, R, p))
    frames = []
    for frame in model.frames:
        place = placed(frame.body, frame.rotation, frame.translation)
        frames.append(Frame(frame.name, *place))
    balls = tuple(places[first][0] for first in model.balls)
    names = [model.joint_names[k] for k in rigid]
    return replace(model, bodies=tuple(bodies), frames=tuple(frames), balls=balls,
                   coordinate_names=quaternion_names(names, bodies, balls))


class _Sections:
    """Sections of a beam, created on demand as massless bodies in series."""

    def __init__(self, modes: AssumedModes, root: int,
                 coordinates: tuple[int, ...]) -> None:
        """Begin at body `root` of the model, with the beam's modal coordinates."""
        self.bodies: list[Body] = []
        self._modes = modes
        self._root = root
        self._coordinates = coordinates
        self._last_bodies: dict[float, int] = {}  # of each section, by its distance

    def with_load(self, frame: Frame, inertial: Inertial, root: Body) -> Body:
        """Add inertia, in a frame's axes, to its section; return the root body."""
        # A rider moves with the section at its frame, and is rigid beside it.
        at = frame.translation
        if frame.name == self._modes.name:
            at = inertial.com  # of the link itself: at the section nearest to it
        index, R, p = self.place(frame.rotation, at)
        moved = inertial.moved(R, p + frame.translation - at)
        if index == self._root:
            return replace(root, inertial=root.inertial + moved)
        k = index - self._root - 1
        section = self.bodies[k]
        self.bodies[k] = replace(section, inertial=section.inertial + moved)
        return root

    def place(self, R: Array, p: Array) -> Place:
        """Return the body that carries a pose on the straight beam, and the pose."""
        e = self._modes.axes[0]
        length = self._modes.length
        # Nothing beyond the tip bends: it moves with the last section.
        x = min(float(p @ e), length)
        if x <= ON_AXIS * length or not self._coordinates:
            return self._root, R, p
        # Places at nearly the same distance share a section.
        for section in self._last_bodies:
            if abs(section - x) < ON_AXIS * length:
                x = section
                break
        if x not in self._last_bodies:
            self._last_bodies[x] = self._add_section(x)
        return self._last_bodies[x], R, p - x * e

    def _add_section(self, x: float) -> int:
        """Add the bodies of a section at distance x; return the last one's index."""
        # A chain of massless bodies, one for each rotation and displacement of the
        # section.
        parent = self._root
        start = x * self._modes.axes[0]
        deflections = self._modes.deflections(x, self._coordinates)
        for name, kind, axis, deflection in deflections:
            label = f'{self._modes.name}/at_{x:.6g}/{name}'
            joint = Joint(label, kind, axis, np.eye(3), start, self._coordinates[0],
                          deflection=deflection)
            self.bodies.append(Body(label, parent, joint))
            parent = self._root + len(self.bodies)
            start = np.zeros(3)
        return parent
