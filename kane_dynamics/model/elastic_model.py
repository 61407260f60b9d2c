"""Make joints of a model elastic, and elastic joints rigid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from kane_dynamics._util.checks import instance
from kane_dynamics._util.text import listing, SHORT
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, ModelError
from kane_dynamics.model.ball_coordinates import is_ball_part, quaternion_names
from kane_dynamics.model.beam import renumbered
from kane_dynamics.model.drive import Drive, friction_seen_through
from kane_dynamics.model.inertial import Inertial, principal_moments
from kane_dynamics.model.model import Body, FRICTION, Joint, Limits, Model, WORLD
import numpy as np

SUFFIX = '_motor'  # of the name of a motor's joint and body


def with_drives(model: Model, drives: Mapping[str, Drive]) -> Model:
    """
    Return the model with elastic joints, each with the motor and spring of a drive.

    The motor of joint 'a' is the joint 'a_motor'. Its coordinate, the motor's position
    divided by the ratio, comes behind all others in q and u, in the order of `drives`.
    Its torque in tau is the motor's times the ratio; the entries of tau of the links are
    torques beside those of the gears. `Model.drives` has the indices of both.

    The armature of an elastic joint becomes the rotor inertia of its drive, unless the
    drive states one, which then replaces it. The friction of the joint is that of the
    link's side. The motor has the drive's limits of velocity and effort, by default those
    of the joint.

    Parameters
    ----------
    model : Model
        The mechanism with rigid joints, or with drives of other joints.
    drives : mapping of str to Drive
        Drives by the names of joints of one degree of freedom.

    Raises
    ------
    ModelError
        `drives` is no mapping, a joint is unknown, mimics another, has a drive already
        or no position of its own; a rotor has no inertia, or more of it than the link
        that carries it (`full_coupling`).

    """
    instance(model, Model, 'model')
    if not isinstance(drives, Mapping):
        raise ModelError(f'drives: {SHORT.repr(drives)}; expected a mapping of joint '
                         'names to Drive')
    # Motors come after all bodies, so that indices of the others stay.
    bodies = list(model.bodies)
    names = list(model.joint_names)
    for name, drive in drives.items():
        index = _driven_body(model, name, drive)
        motor = _motor(bodies[index], drive, len(names))
        if drive.full_coupling:
            _take_from_carrier(bodies, motor)
        inertia = _rotor_inertia(bodies[index].joint, drive)
        complete = replace(drive, motor=motor.name, rotor_inertia=inertia)
        # The rotor's inertia is that of the motor, no longer of the link.
        joint = replace(bodies[index].joint, armature=0.0, drive=complete)
        bodies[index] = replace(bodies[index], joint=joint)
        bodies.append(motor)
        names.append(motor.name)
    return replace(model, bodies=tuple(bodies),
                   coordinate_names=quaternion_names(names, bodies, model.balls))


def with_rigid_joints(model: Model) -> Model:
    """
    Return the model with rigid joints for elastic ones: the motors follow the links.

    The motor of a joint becomes a joint that mimics it, so that inertia and friction of
    the motor's side stay, and its coordinate is gone. The joint's limit of effort is the
    motor's, its limit of velocity the smaller one.

    Load friction acts where the drive is, which a joint that mimics another does not have:
    the joint has the law of a motor with load friction, and the motor has the law of the
    link's side. The load then leaves out the friction of the link's side.
    """
    instance(model, Model, 'model')
    # Each motor moves with its link; coordinates of motors go.
    links = {elastic.drive.motor: elastic.link for elastic in model.drives}
    coordinates = [k for k, name in enumerate(model.joint_names) if name not in links]
    # Bodies and beams with the coordinates that stay.
    joints = {body.joint.name: body.joint for body in model.bodies}
    laws: dict[str, dict[str, Any]] = {}
    for name, drive, _, _ in model.drives:
        if _has_load_friction(joints[drive.motor]):
            laws[name] = _law(joints[drive.motor])
            laws[drive.motor] = _law(joints[name])
    bodies = []
    for body in model.bodies:
        joint = body.joint
        coordinate = links.get(joint.name, joint.coordinate)
        joint = replace(joint, **laws.get(joint.name, {}), drive=None,
                        coordinate=coordinates.index(coordinate),
                        limits=_limits_with_motor(joint, joints),
                        deflection=renumbered(joint.deflection, coordinates.index))
        bodies.append(replace(body, joint=joint,
                              beam=renumbered(body.beam, coordinates.index)))
    names = [model.joint_names[k] for k in coordinates]
    return replace(model, bodies=tuple(bodies),
                   coordinate_names=quaternion_names(names, bodies, model.balls))


def _limits_with_motor(joint: Joint, joints: Mapping[str, Joint]) -> Limits:
    """Return the limits of a joint that its motor moves without elasticity, if it has one."""
    limits = joint.limits
    if joint.drive is None:
        return limits
    motor = joints[joint.drive.motor].limits
    return replace(limits, effort=motor.effort,
                   velocity=min(limits.velocity, motor.velocity))


def with_motors_at_links(model: Model, q: Array) -> Array:
    """Return configurations, (..., n_q), in which no spring of a drive is deflected."""
    relaxed = q.copy()
    for elastic in model.drives:
        link, motor = model.places[elastic.link], model.places[elastic.motor]
        relaxed[..., motor] = q[..., link]
    return relaxed


def require_rigid_joints(model: Model) -> None:
    """
    Raise InputError for a model with elastic joints.

    For what takes every coordinate for one that an actuator moves: it would command the
    torques that links need at the links, where no actuator is.
    """
    if model.drives:
        names = listing([elastic.name for elastic in model.drives])
        raise InputError(f'robot: with elastic joints {names}; expected rigid ones, such as '
                         'those of with_rigid_joints(model), because motors move the '
                         'links through springs; MotorSideControl, LinkSideControl and '
                         'ElasticFeedforward command the motors')


def link_side(model: Model) -> Model:
    """Return the links of an elastic model alone: without motors, drives and rotors."""
    motors = {elastic.drive.motor for elastic in model.drives}
    coordinates = []  # those that stay, in order
    for k, name in enumerate(model.joint_names):
        if name not in motors:
            coordinates.append(k)

    # Bodies, joints and beams with the indices of what is left.
    numbers = {WORLD: WORLD}  # of the bodies that stay
    bodies: list[Body] = []
    for index, body in enumerate(model.bodies):
        joint = body.joint
        if joint.name in motors:
            continue
        numbers[index] = len(bodies)
        joint = replace(joint, drive=None, coordinate=coordinates.index(joint.coordinate),
                        deflection=renumbered(joint.deflection, coordinates.index))
        bodies.append(replace(body, parent=numbers[body.parent], joint=joint,
                              beam=renumbered(body.beam, coordinates.index)))
    frames = [replace(frame, body=numbers[frame.body]) for frame in model.frames]
    balls = tuple(numbers[first] for first in model.balls)
    names = [model.joint_names[k] for k in coordinates]
    return replace(model, bodies=tuple(bodies), frames=tuple(frames), balls=balls,
                   coordinate_names=quaternion_names(names, bodies, balls))


def _driven_body(model: Model, name: str, drive: Drive) -> int:
    """Return the index of the body whose joint gets a drive."""
    valid = []
    for index, body in enumerate(model.bodies):
        joint = body.joint
        is_own = joint.name in model.joint_names and joint.deflection is None
        # Only a joint with a coordinate of its own can have a drive.
        if is_own and joint.drive is None and not is_ball_part(index, model.balls):
            valid.append(joint.name)
        elif joint.name == name and joint.drive is not None:
            raise ModelError(f"drives: joint '{name}' has a drive; expected joints "
                             'without one')
    # Motors of the model are joints too, but of drives.
    motors = {elastic.drive.motor for elastic in model.drives}
    valid = [joint for joint in valid if joint not in motors]
    if name not in valid:
        raise ModelError(f'drives: {name!r} is no joint of one degree of freedom with a '
                         f'position of its own; expected some of {listing(valid)}')
    if not isinstance(drive, Drive):
        raise ModelError(f"drives: joint '{name}': {SHORT.repr(drive)}; expected a "
                         'Drive')
    names = [body.joint.name for body in model.bodies]
    return names.index(name)


def _rotor_inertia(joint: Joint, drive: Drive) -> float:
    """Return the rotor's inertia on the joint's side, kg m^2 or kg."""
    inertia = drive.rotor_inertia
    if inertia is None:
        inertia = joint.armature
    if not inertia:
        raise ModelError(f"drives: joint '{joint.name}': a drive without rotor_inertia "
                         'at a joint without armature; expected one of them')
    return inertia


def _has_load_friction(joint: Joint) -> bool:
    """Return whether the friction of a joint depends on the torque that it transmits."""
    return bool(joint.load_friction or joint.load_friction_backdriven)


def _law(joint: Joint) -> dict[str, Any]:
    """Return the fields of the friction law of a joint."""
    return {name: getattr(joint, name) for name in (*FRICTION, 'friction_speed')}


def _motor(body: Body, drive: Drive, coordinate: int) -> Body:
    """Return the body of a drive's rotor."""
    joint = body.joint
    if _has_load_friction(joint):
        # No motor acts on the link's side: the load of its law would always vanish.
        raise ModelError(f"drives: joint '{joint.name}': load friction of the link's "
                         'side; expected it in the friction of the drive')
    name = joint.name + SUFFIX
    inertia = _rotor_inertia(joint, drive)
    effort, velocity = joint.limits.effort, joint.limits.velocity
    if drive.motor_effort is not None:
        effort = drive.motor_effort
    if drive.motor_velocity is not None:
        velocity = drive.motor_velocity
    limits = Limits(velocity=velocity, effort=effort)
    if not drive.full_coupling:
        # Spong's reduced model: the rotor turns in the world, with its own energy alone.
        law: dict[str, Any] = dict(drive.friction)
        motor = Joint(name, joint.kind, joint.axis, coordinate=coordinate,
                      limits=limits, armature=inertia, **law)
        return Body(name, WORLD, motor)
    if joint.kind != 'revolute':
        raise ModelError(f"drives: joint '{joint.name}': full_coupling of a "
                         f'{joint.kind} joint; expected a revolute one, whose motor '
                         'turns about the same axis')
    fractions = ('load_friction', 'load_friction_backdriven')
    if any(drive.friction.get(fraction) for fraction in fractions):
        # The load of the law is the torque of the motor's joint, on the joint's side of
        # the gear, while this joint has the motor's rate.
        raise ModelError(f"drives: joint '{joint.name}': full_coupling with load "
                         'friction of the motor; expected full_coupling=False')
    # The rotor turns by the motor's angle relative to its carrier, so that its friction
    # is that of the motor's side. Its mass is part of the carrier's.
    r = drive.ratio
    joint_side = {'friction_speed': Joint.friction_speed, **drive.friction}
    law = dict(friction_seen_through(joint_side, 1.0 / r))
    spin = np.outer(joint.axis, joint.axis) * (inertia / (r * r))
    motor = Joint(name, 'revolute', joint.axis, joint.rotation, joint.translation,
                  coordinate, multiplier=r, limits=limits, **law)
    return Body(name, body.parent, motor, Inertial(0.0, np.zeros(3), spin))


def _take_from_carrier(bodies: list[Body], motor: Body) -> None:
    """Subtract the rotor's inertia about its axis from that of the link carrying it."""
    if motor.parent == WORLD:
        return
    carrier = bodies[motor.parent]
    R = motor.joint.rotation
    # The link's inertia in the file includes the rotor, which is a body now.
    inertia = carrier.inertial.inertia - R @ motor.inertial.inertia @ R.T
    # What is left must be the inertia of a possible body.
    moments = principal_moments(inertia, mass=carrier.inertial.mass)
    if moments.indefinite:
        axis = motor.joint.axis
        spin = float(axis @ motor.inertial.inertia @ axis)
        raise ModelError(f"drives: joint '{motor.joint.name.removesuffix(SUFFIX)}': "
                         f"rotor with {spin:.4g} kg m^2 in link '{carrier.name}', whose "
                         f'principal moments would be {moments}; expected a link whose '
                         "inertia includes the rotor's, or full_coupling=False")
    inertial = replace(carrier.inertial, inertia=inertia)
    bodies[motor.parent] = replace(carrier, inertial=inertial)
