"""
Rigid contacts of named points for `simulate`: `Contact`, and the surfaces that it meets.

Non-smooth: Newton's restitution for impacts, and Coulomb friction that sticks exactly.
`mechanics.contacts` has the geometry, `stepper` the times at which contacts change.

`load_contacts` reads contacts from a YAML file::

    contacts:
      tool:                    # name of the contact
        frame: tool0
        radius: 0.01           # m; default 0, a point
        friction: 0.3          # default 0
        restitution: 0.0       # default 0
        plane:                 # or sphere or cylinder, with the fields of its class
          point: [0, 0, 0.1]
          normal: [0, 0, 1]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, MISSING
import os
from typing import Any

from kane_dynamics._util.checks import constant
from kane_dynamics._util.yaml_io import mapping, read_yaml
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.contacts import ContactPair, gap
from kane_dynamics.model.model import Frame, WORLD
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.stepper import Contacts
import numpy as np

Numbers = Sequence[float]
PENETRATION = 1e-9  # m: rounding of an initial configuration


@dataclass(frozen=True)
class PlaneSurface:
    """
    A plane that is fixed in the world or in a link.

    Parameters
    ----------
    point : (3,) array_like
        In the plane, m.
    normal : (3,) array_like
        Toward the free side; of any length.
    frame : str, optional
        Frame of the model in which `point` and `normal` are; None: the world.

    """

    point: Numbers = (0.0, 0.0, 0.0)
    normal: Numbers = (0.0, 0.0, 1.0)
    frame: str | None = None
    shape = 'plane'
    radius = 0.0


@dataclass(frozen=True)
class SphereSurface:
    """
    The outside of a sphere that is fixed in the world or in a link.

    Parameters
    ----------
    center : (3,) array_like
        m.
    radius : float
        m.
    frame : str, optional
        Frame of the model in which `center` is; None: the world.

    """

    center: Numbers
    radius: float
    frame: str | None = None
    shape = 'sphere'
    normal = (0.0, 0.0, 1.0)

    @property
    def point(self) -> Numbers:
        """Return the center."""
        return self.center


@dataclass(frozen=True)
class CylinderSurface:
    """
    The outside of a cylinder of any length that is fixed in the world or in a link.

    Parameters
    ----------
    point : (3,) array_like
        On the axis, m.
    axis : (3,) array_like
        Of any length.
    radius : float
        m.
    frame : str, optional
        Frame of the model in which `point` and `axis` are; None: the world.

    """

    point: Numbers
    axis: Numbers
    radius: float
    frame: str | None = None
    shape = 'cylinder'

    @property
    def normal(self) -> Numbers:
        """Return the axis, which is the z axis of the surface."""
        return self.axis


Surface = PlaneSurface | SphereSurface | CylinderSurface


@dataclass(frozen=True)
class Contact:
    """
    A rigid contact of a point, or of a sphere around it, with a surface.

    Parameters
    ----------
    frame : str
        Frame of the model, at whose origin the point or the center of the sphere is.
    on : PlaneSurface, SphereSurface or CylinderSurface
        In the world or in another link.
    radius : float
        Of the sphere, m; 0: a point.
    friction : float
        Coulomb friction, a fraction of the normal force: of sliding, and the most that
        sticks.
    restitution : float
        Newton's: speed after an impact as a fraction of that before it, 0 to 1.
    name : str, optional
        In results and errors. Default: the frame's name.

    """

    frame: str
    on: Surface
    radius: float = 0.0
    friction: float = 0.0
    restitution: float = 0.0
    name: str | None = None


SURFACES: dict[str, Any] = {'plane': PlaneSurface, 'sphere': SphereSurface,
                            'cylinder': CylinderSurface}


def load_contacts(source: str | os.PathLike[str] | Mapping[str, Any], *,
                  prefix: str = '') -> tuple[Contact, ...]:
    """
    Return the contacts of a YAML file, for `simulate`.

    The schema is in the docstring of `kane_dynamics.simulation.contact`.

    Parameters
    ----------
    source : path or dict
        The file, or its content.
    prefix : str
        Prefix of every frame name (`Model.prefixed`).

    Raises
    ------
    InputError
        Names the contact, the key, its value and what is expected. `simulate` checks
        whether the frames exist, and the numbers.

    """
    data = source
    if not isinstance(source, Mapping):
        data = read_yaml(source, 'contacts', InputError)
    top = mapping(data, 'contacts file', ('contacts',), InputError)
    entries = mapping(top.get('contacts'), 'contacts file: contacts', None, InputError)
    contacts = []
    for name, entry in entries.items():
        what = f"contact '{name}'"
        keys = ('frame', 'radius', 'friction', 'restitution', *SURFACES)
        stated = dict(mapping(entry, what, keys, InputError))
        shapes = [shape for shape in SURFACES if shape in stated]
        if len(shapes) != 1:
            raise InputError(f'{what}: {len(shapes)} surfaces; expected one of '
                             f'{", ".join(SURFACES)}')
        surface = _record(SURFACES[shapes[0]], stated.pop(shapes[0]),
                          f'{what}: {shapes[0]}', prefix)
        contacts.append(_record(Contact, {**stated, 'on': surface, 'name': name}, what,
                                prefix))
    return tuple(contacts)


def _record(record: Any, stated: Any, what: str, prefix: str) -> Any:
    """Return a record of the fields that a file states; InputError for a field that it lacks."""
    names = tuple(field.name for field in fields(record))
    values = dict(mapping(stated, what, names, InputError))
    for field in fields(record):
        if field.default is MISSING and field.name not in values:
            raise InputError(f"{what}: no key '{field.name}'; expected its value")
    if 'frame' in values:
        values['frame'] = f"{prefix}{values['frame']}"
    return record(**values)


def checked_contacts(robot: Robot, contacts: Any) -> Contacts:
    """
    Return the contacts of a robot, checked.

    Raises
    ------
    InputError
        Names the contact, the value and what is expected.

    """
    if isinstance(contacts, Contact):
        raise InputError('contacts: a Contact; expected a sequence of them')
    pairs, names, numbers = [], set(), []
    for contact in contacts:
        if not isinstance(contact, Contact):
            raise InputError(f'contacts: {type(contact).__name__}; expected Contact')
        name = contact.frame if contact.name is None else contact.name
        what = f"contact '{name}'"
        if name in names:
            raise InputError(f'{what}: the second of this name; expected different names')
        names.add(name)
        if not isinstance(contact.on, Surface):
            raise InputError(f'{what}: on {contact.on!r}; expected a PlaneSurface, '
                             'SphereSurface or CylinderSurface')
        point = robot.model.frame(contact.frame)
        surface = _surface_frame(robot, contact.on, what)
        if point.body == surface.body:
            raise InputError(f'{what}: point and surface on one link; expected two')
        needs_radius = contact.on.shape != 'plane'
        pairs.append(ContactPair(
            name, point, _number(contact.radius, f'{what}: radius', np.inf),
            contact.on.shape, surface,
            _number(contact.on.radius, f'{what}: radius of the surface', np.inf,
                    positive=needs_radius)))
        numbers.append((_number(contact.friction, f'{what}: friction', np.inf),
                        _number(contact.restitution, f'{what}: restitution', 1.0)))
    friction, restitution = np.array(numbers).reshape(-1, 2).T
    return Contacts(tuple(pairs), friction, restitution)


def _number(value: Any, what: str, most: float, positive: bool = False) -> float:
    """Return a checked number from 0 to `most`."""
    number = float(constant(value, (), what, InputError))
    if number < 0.0 or number > most or (positive and not number):
        bounds = 'a positive number' if positive else 'at least 0'
        if np.isfinite(most):
            bounds = f'0 to {most:g}'
        raise InputError(f'{what}: {number:g}; expected {bounds}')
    return number


def _surface_frame(robot: Robot, on: Surface, what: str) -> Frame:
    """Return the frame of a surface: its z axis is the normal or the axis."""
    z = np.asarray(constant(on.normal, (3,), f'{what}: normal or axis', InputError))
    length = float(np.linalg.norm(z))
    if not length:
        raise InputError(f'{what}: normal or axis of length 0; expected a direction')
    z = z / length
    # The x axis: across the axis of the frame that is farthest from z.
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z], axis=1)
    translation = np.asarray(constant(on.point, (3,), f'{what}: point', InputError))
    body = WORLD
    if on.frame is not None:
        base = robot.model.frame(on.frame)
        body = base.body
        translation = base.rotation @ translation + base.translation
        rotation = base.rotation @ rotation
    return Frame(f'{what} surface', body, rotation, translation)


def require_open(robot: Robot, contacts: Contacts, q: Any) -> None:
    """Raise InputError if a point of initial configurations, (N, n_q), is in a surface."""
    for pair in contacts.pairs:
        for number, row in enumerate(q):
            distance = distance_of(robot, pair, row)
            if distance < -PENETRATION:
                which = '' if len(q) == 1 else f' of state {number}'
                raise InputError(f"q0{which}: contact '{pair.name}' is {-distance:.3g} m "
                                 'inside its surface; expected a distance of at least 0')


def distance_of(robot: Robot, pair: ContactPair, q: Any) -> float:
    """Return the distance of a contact at a configuration, m; negative inside."""
    tree = robot.equations.tree
    poses = (np.array(tree.frame_pose(frame, q), dtype=float)
             for frame in (pair.point, pair.surface))
    return float(gap(pair, *poses)[0])
