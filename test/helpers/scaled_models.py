"""Mechanisms with all lengths times one number, masses and times unchanged."""

from dataclasses import replace

from kane_dynamics.model.model import Inertial, Limits
import numpy as np


def scaled_inertial(inertial, s):
    """Return an inertial with lengths times s."""
    return Inertial(inertial.mass, s * inertial.com, s**2 * inertial.inertia)


def scaled_joint(joint, s):
    """
    Return a joint with lengths times s, whose forces do the work of a scaled motion.

    Work scales with s^2: torques with s^2, forces with s, over the same angles and
    scaled slides.
    """
    slides = joint.kind == 'prismatic'
    length, force = (s, s) if slides else (1.0, s**2)
    limits = joint.limits
    return replace(
        joint, translation=s * joint.translation, offset=length * joint.offset,
        rest=length * joint.rest, stiffness=force / length * joint.stiffness,
        damping=force / length * joint.damping, armature=force / length * joint.armature,
        friction=force * joint.friction, friction_offset=force * joint.friction_offset,
        friction_speed=length * joint.friction_speed,
        limits=Limits(length * limits.lower, length * limits.upper,
                      length * limits.velocity, force * limits.effort))


def scaled_model(model, s):
    """Return a rigid model with all lengths times s, gravity too, so that times stay."""
    assert not model.flexible
    rows = []
    for body in model.bodies:
        rows.append(replace(body, joint=scaled_joint(body.joint, s),
                            inertial=scaled_inertial(body.inertial, s)))
    bodies = tuple(rows)
    frames = tuple(replace(frame, translation=s * frame.translation)
                   for frame in model.frames)
    return replace(model, bodies=bodies, frames=frames, gravity=s * model.gravity,
                   base_inertial=scaled_inertial(model.base_inertial, s))


def units_of(robot, s):
    """Return the factors of q, (n_q,), of u, (n,), and of constraint rows, (m,)."""
    model = robot.model
    rows = []
    for name in model.coordinate_names:
        rows.append(s if name in model.sliding else 1.0)
    of_q = np.array(rows)
    of_u = np.array([s if name in model.sliding else 1.0 for name in robot.speed_names])
    of_rows = np.ones(len(robot.constraint_names))
    if robot.constraint_names:
        of_rows = np.where(robot.mechanism.turning, 1.0, s)
    return of_q, of_u, of_rows
