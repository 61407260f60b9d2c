"""
Supplement of a URDF: data that URDF cannot express, in one YAML file.

Schema; every key is optional unless noted::

    joints:
      <joint>:                  # a joint of the URDF that can move; also <joint>/rx
        armature: 0.1           # rotor inertia seen through the gear, kg m^2 or kg, >= 0
        stiffness: 5.0          # spring towards `rest`, N m/rad or N/m, >= 0
        rest: 0.0               # rad or m
        damping: 0.5            # viscous, for the URDF's, N m s/rad or N s/m, >= 0
        fast_damping: 0.2       # at rates far above damping_speed, >= 0; default: damping
        damping_speed: 1.0      # at which it is the mean of both, rad/s or m/s, > 0
        friction: 1.2           # Coulomb friction in place of the URDF's, N m or N, >= 0
        friction_backward: 1.0  # at negative rates, N m or N, >= 0; default: friction
        breakaway_friction: 1.5 # at rest, N m or N, >= friction; default: friction
        stribeck_speed: 0.1     # at which it falls to friction, rad/s or m/s; default 0
        load_friction: 0.05     # per torque that the drive transmits, >= 0
        load_friction_backdriven: 0.1  # where the load drives; default: load_friction
        friction_speed: 0.05    # of friction * tanh(rate / friction_speed), > 0
        friction_offset: 0.1    # added at any rate, N m or N
        presliding_stiffness: 500.0  # of bristles, N m/rad or N/m, >= 0; default: none
        presliding_damping: 2.0 # of their rate, N m s/rad or N s/m, >= 0; default 0
    links:
      <link>:                   # replaces the inertial of the URDF
        mass: 1.5               # required: kg, >= 0
        com: [0.0, 0.0, 0.05]   # center of mass from the link's origin, m; default 0
        inertia:                # about com, in the link's axes, kg m^2; default 0
          {ixx: 0.01, iyy: 0.01, izz: 0.01, ixy: 0.0, ixz: 0.0, iyz: 0.0}
    payload:
      link: tool0               # required: the link that carries it
      mass: 2.0                 # required: kg, >= 0
      com: [0.0, 0.0, 0.05]     # center of mass from the link's origin, m; default 0
      inertia:                  # about com, in the link's axes, kg m^2; default 0
        {ixx: 0.01, iyy: 0.01, izz: 0.01, ixy: 0.0, ixz: 0.0, iyz: 0.0}
    beams:
      <link>:                   # a moving link; the beam replaces its inertial
        length: 1.0             # required: m, along `direction` from the link's joint
        density: 2.0            # required: mass per length, kg/m
        stiffness: 100.0        # required: EI, N m^2; or two, along `up` and across it
        modes: [3, 0]           # number in these two directions; default 3 each
        direction: [1, 0, 0]    # in the link's axes
        up: [0, 1, 0]
        damping: 0.0            # material damping, s
        tip_mass: 0.0           # assumed by the mode shapes, kg
        torsion:                # omitted: no torsion
          stiffness: 50.0       # required: GJ, N m^2
          inertia: 1e-3         # required: rho I_p, kg m: moment of inertia per length
          modes: 1
          tip_inertia: 0.0      # assumed by the mode shapes, kg m^2
    drives:
      <joint>:                  # of an elastic joint; see Drive
        side: joint             # or motor: the side of the gear of all numbers below
        ratio: 100.0            # motor revolutions per joint revolution; default 1
        stiffness: 1e4          # required: N m/rad or N/m, > 0; or a curve:
          # {deflection: [1e-3, 3e-3], torque: [5.0, 30.0], rounding: 1e-4}
        damping: 5.0            # of the spring, N m s/rad or N s/m; default 0
        rotor_inertia: 0.5      # kg m^2 or kg, > 0; default: armature of the joint
        friction: {damping: 1.0, friction: 2.0}  # of the motor, with the keys above
        motor_effort: 80.0      # limit of the motor's torque, N m or N, > 0; and
        motor_velocity: 3.0     # of its speed; default: those of the joint in the URDF
        gear_effort: 120.0      # limit of the gear's torque; default: none
        torque_sensor: false
        full_coupling: false    # the rotor also moves with the link that carries it

Entries for joints that are locked or not part of the model have no effect.
"""

from collections.abc import Collection, Mapping
import contextlib
from dataclasses import dataclass, field
import math
import os
from typing import Any

from kane_dynamics._util.text import listing, SHORT
from kane_dynamics._util.yaml_io import mapping, read_yaml
from kane_dynamics.errors import ModelError, UrdfError
from kane_dynamics.model.drive import Drive, StiffnessCurve
from kane_dynamics.model.flexible_link import FlexibleLink
from kane_dynamics.model.inertial import Inertial, principal_moments
from kane_dynamics.model.mode_shapes import Bending, Torsion
from kane_dynamics.model.model import FRICTION, POSITIVE
import numpy as np

DRIVE_KEYS = ('side', 'ratio', 'stiffness', 'damping', 'rotor_inertia', 'friction',
              'motor_effort', 'motor_velocity', 'gear_effort', 'torque_sensor',
              'full_coupling')
CURVE_KEYS = ('deflection', 'torque', 'rounding')
JOINT_KEYS = ('armature', 'stiffness', 'rest', *FRICTION, 'friction_speed')
SIGNED_KEYS = ('rest', 'friction_offset')
BEAM_KEYS = ('length',
             'density', 'stiffness', 'modes', 'direction', 'up', 'damping', 'tip_mass',
             'torsion')
TORSION_KEYS = ('stiffness', 'inertia', 'modes', 'tip_inertia')
INERTIAL_KEYS = ('mass', 'com', 'inertia')
INERTIA_KEYS = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')


@dataclass(frozen=True)
class Supplement:
    """Values and drives by joint; the payload's link and inertial; beams, inertials by link."""

    joints: dict[str, dict[str, float]] = field(default_factory=dict)
    payload: tuple[str, Inertial] | None = None
    beams: dict[str, FlexibleLink] = field(default_factory=dict)
    drives: dict[str, Drive] = field(default_factory=dict)
    links: dict[str, Inertial] = field(default_factory=dict)


def read_supplement(
        source: str | os.PathLike[str] | Mapping[str, Any] | None) -> Supplement:
    """
    Read the supplement from a YAML file or a dict of the same layout.

    Raises
    ------
    UrdfError
        If a key or value is invalid; the message names it.
    ModelError
        If the payload's inertia has a negative principal moment.

    """
    if source is None:
        return Supplement()
    data = source if isinstance(source, Mapping) else read_yaml(source, 'supplement')
    # Unknown keys are errors: a misspelled one would be ignored.
    top = mapping(data, 'supplement', ('joints', 'payload', 'beams', 'drives', 'links'))
    joints = {}
    for name, entry in mapping(top.get('joints', {}), 'supplement: joints').items():
        joints[name] = _joint(name, entry)
    payload = None
    if top.get('payload') is not None:
        payload = _payload(top['payload'])
    beams = {}
    for name, entry in mapping(top.get('beams', {}), 'supplement: beams').items():
        beams[name] = _beam(name, entry)
    drives = {}
    for name, entry in mapping(top.get('drives', {}), 'supplement: drives').items():
        drives[name] = _drive(name, entry)
    links = {}
    for name, entry in mapping(top.get('links', {}), 'supplement: links').items():
        what = f"supplement: link '{name}'"
        links[name] = _inertial(mapping(entry, what, INERTIAL_KEYS), what)
    return Supplement(joints, payload, beams, drives, links)


def check_names(supplement: Supplement, valid: Collection[str],
                links: Collection[str]) -> None:
    """Raise UrdfError if the supplement names a joint or a link that the URDF lacks."""
    for name in supplement.links:
        if name not in links:
            raise UrdfError(f"supplement: links: no link '{name}' in the URDF; expected "
                            f'some of {listing(links)}')
    for key, names in (('joints', supplement.joints), ('drives', supplement.drives)):
        for name in names:
            if name not in valid:
                raise UrdfError(f"supplement: {key}: '{name}' is no joint that can "
                                f'move; expected some of {listing(valid)}')


def _number(value: Any, what: str, *, signed: bool = False,
            positive: bool = False) -> float:
    """Return a finite number within bounds; also of a text, as YAML reads 1e-3."""
    number = math.nan
    types = (int, float, str, np.floating, np.integer)
    if isinstance(value, types) and not isinstance(value, bool):
        with contextlib.suppress(ValueError, OverflowError):
            number = float(value)
    # 1e60 is beyond any quantity, and squares of it still have a double.
    if signed:
        expected = 'finite number'
        valid = True
    elif positive:
        expected = 'positive number'
        valid = number > 0.0
    else:
        expected = 'finite number that is not negative'
        valid = number >= 0.0
    if not abs(number) < 1e60 or not valid:
        raise UrdfError(f'{what}: {SHORT.repr(value)}; expected a {expected}')
    return number


def _joint(name: str, data: Any) -> dict[str, float]:
    """Return the properties of a joint."""
    what = f"supplement: joint '{name}'"
    properties = {}
    for key, value in mapping(data, what, JOINT_KEYS).items():
        properties[key] = _number(value, f'{what}: {key}', signed=key in SIGNED_KEYS,
                                  positive=key in POSITIVE)
    return properties


def _drive(name: str, data: Any) -> Drive:
    """Return the drive of a joint, with joint-side numbers."""
    what = f"supplement: drive of joint '{name}'"
    entry = mapping(data, what, DRIVE_KEYS)
    if 'stiffness' not in entry:
        raise UrdfError(f"{what}: no 'stiffness'; expected it, and optionally "
                        f'{", ".join(key for key in DRIVE_KEYS if key != "stiffness")}')
    # Numbers of the motor's side need the ratio of the gear.
    side = entry.get('side', 'joint')
    if side not in ('joint', 'motor'):
        raise UrdfError(f'{what}: side {SHORT.repr(side)}; expected joint or motor')
    if side == 'motor' and 'ratio' not in entry:
        raise UrdfError(f"{what}: side motor without 'ratio'; expected the motor's "
                        'revolutions per revolution of the joint')
    # Numbers and friction of the drive, then its switches.
    numbers: dict[str, Any] = {'stiffness': _stiffness(entry['stiffness'], what)}
    for key in ('damping', 'rotor_inertia', 'ratio', 'motor_effort', 'motor_velocity',
                'gear_effort'):
        if key in entry:
            numbers[key] = _number(entry[key], f'{what}: {key}', signed=key == 'ratio')
    law = mapping(entry.get('friction', {}), f'{what}: friction',
                  (*FRICTION, 'friction_speed'))
    numbers['friction'] = {}
    for key, value in law.items():
        numbers['friction'][key] = _number(value, f'{what}: friction: {key}',
                                           signed=key in SIGNED_KEYS)
    for key in ('torque_sensor', 'full_coupling'):
        if key in entry:
            numbers[key] = entry[key]
    # The drive names the fault, the supplement the joint.
    try:
        if side == 'motor':
            return Drive.from_motor_side(**numbers)
        return Drive(**numbers)
    except ModelError as error:
        raise UrdfError(f'{what}: {str(error).removeprefix("drive: ")}') from None


def _stiffness(value: Any, what: str) -> float | StiffnessCurve:
    """Return the stiffness of a drive, a number or a curve."""
    if not isinstance(value, Mapping):
        return _number(value, f'{what}: stiffness', positive=True)
    # A curve has points of deflection and torque.
    entry = mapping(value, f'{what}: stiffness', CURVE_KEYS)
    for key in ('deflection', 'torque'):
        if key not in entry:
            raise UrdfError(f"{what}: stiffness: no '{key}'; expected deflection and "
                            'torque, and optionally rounding')
    try:
        return StiffnessCurve(**entry)
    except ModelError as error:
        raise UrdfError(f'{what}: {error}') from None


def _beam(name: str, data: Any) -> FlexibleLink:
    """Return the beam of a link; `FlexibleLink.assumed_modes` checks the numbers."""
    what = f"supplement: beam '{name}'"
    # Numbers are checked here, their relations by the record.
    entry = dict(mapping(data, what, BEAM_KEYS))
    for key in BEAM_KEYS[:3]:
        if key not in entry:
            raise UrdfError(f'{what}: {key} is missing; expected a number')
    tip_mass = _number(entry.pop('tip_mass', 0.0), f'{what}: tip_mass')
    for key in ('length', 'density', 'damping'):
        if key in entry:
            entry[key] = _number(entry[key], f'{what}: {key}')
    # One stiffness for both planes, or one for each.
    stiffness = entry['stiffness']
    if isinstance(stiffness, list):
        entry['stiffness'] = [_number(value, f'{what}: '
                                             'stiffness') for value in stiffness]
    else:
        entry['stiffness'] = _number(stiffness, f'{what}: stiffness')
    if 'torsion' in entry:
        entry['torsion'] = _torsion(entry['torsion'], f'{what}: torsion')
    return FlexibleLink(**entry, bending=Bending.clamped_free(tip_mass))


def _torsion(data: Any, what: str) -> Torsion:
    """Return the torsion of a beam."""
    entry = dict(mapping(data, what, TORSION_KEYS))
    for key in TORSION_KEYS[:2]:
        if key not in entry:
            raise UrdfError(f'{what}: {key} is missing; expected a number')
    modes = entry.pop('modes', 1)
    numbers = {key: _number(value, f'{what}: {key}') for key, value in entry.items()}
    return Torsion(**numbers, modes=modes)


def _payload(data: Any) -> tuple[str, Inertial]:
    """Return the link and the inertial of the payload."""
    what = 'supplement: payload'
    entry = dict(mapping(data, what, ('link', *INERTIAL_KEYS)))
    link = entry.pop('link', None)
    if not isinstance(link, str):
        raise UrdfError(f'{what}: link {SHORT.repr(link)}; expected the name of a link')
    return link, _inertial(entry, what)


def _inertial(entry: Mapping[str, Any], what: str) -> Inertial:
    """Return the inertial of a payload or a link."""
    if 'mass' not in entry:
        raise UrdfError(f"{what}: no 'mass'; expected it, and optionally com and inertia")
    com = entry.get('com', (0.0, 0.0, 0.0))
    if isinstance(com, (str, Mapping)) or not hasattr(com, '__len__') or len(com) != 3:
        raise UrdfError(f'{what}: com {SHORT.repr(com)}; expected three numbers, m')
    # About the center of mass, in the axes of the link.
    moments = dict.fromkeys(INERTIA_KEYS, 0.0)
    stated = mapping(entry.get('inertia', {}), f'{what}: inertia', INERTIA_KEYS)
    for key, value in stated.items():
        # As in a URDF, six entries of a symmetric matrix.
        moments[key] = _number(value, f'{what}: inertia: {key}', signed=True)
    xx, xy, xz, yy, yz, zz = moments.values()
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    principal = principal_moments(inertia)
    if principal.indefinite:
        raise ModelError(f'{what}: inertia has the principal moment '
                         f'{principal.moments[0]:g} kg m^2; expected no negative one')
    mass = _number(entry['mass'], f'{what}: mass')
    center = [_number(coordinate, f'{what}: com', signed=True) for coordinate in com]
    return Inertial(mass, np.array(center), inertia)
