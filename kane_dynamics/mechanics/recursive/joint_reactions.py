"""
Joint reactions, and the joint torques due to each body.

The reaction at a joint is the force and moment that the parent exerts on the child: the
inertia and weight of the subtree minus the external wrenches on it. This is Kane's
method of auxiliary speeds (Kane & Levinson, chapter 4): with six fictitious speeds of
the joint along and about the world's axes, the partial velocities of the subtree are
those of one rigid body.
"""

from collections.abc import Sequence

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.recursive.frame_kinematics import frame_in_link, link_poses
from kane_dynamics.mechanics.recursive.inverse_dynamics import (add_to_parent, JointStep,
                                                                link_forces, link_motion,
                                                                LinkMotion)
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.model.model import Frame, WORLD
import numpy as np


def joint_reactions(links: Sequence[Link], q: Vector, u: Vector, udot: Vector,
                    gravity: Vector,
                    external: Sequence[tuple[Frame, Vector]]) -> list[Vector]:
    """
    Return the reaction of each joint, (6,): force, then moment about the joint's origin.

    The reaction is what the parent exerts on the child, in world axes.

    Parameters
    ----------
    links : sequence of Link
        Links with their origins at the model's joints (`link.linkage`) and with
        full inertial parameters.
    q, u, udot, gravity
        As `inverse_dynamics`.
    external : sequence of (Frame, (6,) array)
        External wrenches, force then moment at the frame's origin, world axes.

    """
    steps = [JointStep(link, q) for link in links]

    # Inertia and weight, summed over subtrees, in link axes.
    wrenches: list[tuple[Vector, Vector]] = []
    for force, moment, _ in _forces(links, steps, q, u, udot, gravity):
        wrenches.append((force, moment))
    for k in reversed(range(len(links))):
        parent = links[k].parent
        if parent != WORLD:
            wrenches[parent] = add_to_parent(steps[k], wrenches[k], wrenches[parent])

    # Rotated to world axes, and minus the external wrenches.
    poses = link_poses(links, q)
    reactions = []
    for (R, _), (force, moment) in zip(poses, wrenches):
        reactions.append(np.concatenate([R @ force, R @ moment]))
    for frame, wrench in external:
        k = frame.body
        if k != WORLD:
            R, p = poses[k]
            point = p + R @ frame_in_link(links, frame)[1]
        while k != WORLD:  # the wrench acts on all joints toward the base
            moment = wrench[3:] + cross(point - poses[k][1], wrench[:3])
            reactions[k] = reactions[k] - np.concatenate([wrench[:3], moment])
            k = links[k].parent
    return reactions


def body_torques(links: Sequence[Link], q: Vector, u: Vector, udot: Vector,
                 gravity: Vector) -> Matrix:
    """Return the joint torques due to each body's inertia and weight, (n_bodies, n)."""
    steps = [JointStep(link, q) for link in links]
    result: list[list[Scalar]] = [[0.0] * len(q) for _ in links]
    forces = _forces(links, steps, q, u, udot, gravity)
    for row, k, (force, moment, modal_forces) in zip(result, range(len(links)), forces):
        for coordinate, modal_force in modal_forces:
            row[coordinate] = row[coordinate] + modal_force
        # The wrench of this body alone, on the axes of all joints toward the base.
        j = k
        while True:
            joint_torque = moment[2] if steps[j].turns else force[2]
            for coordinate, weight in steps[j].partials:
                row[coordinate] = row[coordinate] + weight * joint_torque
            if links[j].parent == WORLD:
                break
            force, moment = steps[j].inward_wrench(force, moment)
            j = links[j].parent
    return np.array(result).reshape(len(links), len(q))


def _forces(links: Sequence[Link], steps: Sequence[JointStep], q: Vector, u: Vector,
            udot: Vector, gravity: Vector
            ) -> list[tuple[Vector, Vector, list[tuple[int, Scalar]]]]:
    """Return `link_forces` of all links, whose beams are bent."""
    motions: list[LinkMotion] = []
    for link, step in zip(links, steps):
        motions.append(link_motion(link, step, motions, q, u, udot, gravity))
    return [link_forces(link, motion, u, udot) for link, motion in zip(links, motions)]
