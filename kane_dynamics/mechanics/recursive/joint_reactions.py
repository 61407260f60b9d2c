"""
Joint reactions, and the joint torques due to each body.

The reaction at a joint is the force and moment that the parent exerts on the child: the inertia
and weight of the subtree minus the external wrenches on it. This is Kane's method of auxiliary
speeds (Kane & Levinson, chapter 4): with six fictitious speeds of the joint along and about the
world's axes, the partial velocities of the subtree are those of one rigid body.
"""

from collections.abc import Sequence
from typing import Any

from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.recursive.flexible_modes import bent
from kane_dynamics.mechanics.recursive.frame_kinematics import frame_in_link, link_poses
from kane_dynamics.mechanics.recursive.inverse_dynamics import (JointStep, link_forces,
                                                                link_motion, LinkMotion)
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.model.model import Frame, WORLD
import numpy as np


def joint_reactions(links: Sequence[Link], q: Any, u: Any, udot: Any, gravity: Any,
                    external: Sequence[tuple[Frame, Any]]) -> list[Any]:
    """
    Return the reaction of each joint, (6,): force, then moment about the joint's origin.

    The reaction is what the parent exerts on the child, in world axes.

    Parameters
    ----------
    links : sequence of Link
        Links with their origins at the model's joints (`link_frames.linkage`) and with full
        inertial parameters.
    q, u, udot, gravity
        As `inverse_dynamics`.
    external : sequence of (Frame, (6,) array)
        External wrenches, force then moment at the frame's origin, world axes.

    """
    links = bent(links, q)
    steps = [JointStep(link, q) for link in links]
    wrenches = [(force, moment) for force, moment, _ in _forces(links, steps, q, u, udot, gravity)]
    for k in reversed(range(len(links))):
        if links[k].parent != WORLD:
            wrenches[links[k].parent] = _add_to_parent(steps[k], wrenches[k],
                                                       wrenches[links[k].parent])
    poses = link_poses(links, q)
    reactions = [np.concatenate([R @ force, R @ moment])
                 for (R, _), (force, moment) in zip(poses, wrenches)]
    for frame, wrench in external:
        k = frame.body
        if k != WORLD:
            R, p = poses[k]
            at = p + R @ frame_in_link(links, frame)[1]
        while k != WORLD:  # the wrench acts on all joints toward the base
            moment = wrench[3:] + cross(at - poses[k][1], wrench[:3])
            reactions[k] = reactions[k] - np.concatenate([wrench[:3], moment])
            k = links[k].parent
    return reactions


def body_torques(links: Sequence[Link], q: Any, u: Any, udot: Any, gravity: Any) -> Any:
    """Return the joint torques due to each body's inertia and weight, (n_bodies, n)."""
    links = bent(links, q)
    steps = [JointStep(link, q) for link in links]
    result: list[list[Any]] = [[0.0] * len(q) for _ in links]
    for k, (force, moment, modal) in enumerate(_forces(links, steps, q, u, udot, gravity)):
        for coordinate, along in modal:
            result[k][coordinate] = result[k][coordinate] + along
        j = k
        while True:
            link = links[j]
            along = moment[2] if link.kind == 'revolute' else force[2]
            for coordinate, weight in steps[j].partials:
                result[k][coordinate] = result[k][coordinate] + weight * along
            if link.parent == WORLD:
                break
            force, moment = steps[j].inward(force), steps[j].inward(moment)
            moment = moment + cross(steps[j].offset, force)
            j = link.parent
    return np.array(result).reshape(len(links), len(q))


def _forces(links: Sequence[Link], steps: Sequence[JointStep], q: Any, u: Any, udot: Any,
            gravity: Any) -> list[tuple[Any, Any, list[tuple[int, Any]]]]:
    """Return `link_forces` of inertia and weight of all links, which are bent; link axes."""
    motion: list[LinkMotion] = []
    for link, step in zip(links, steps):
        motion.append(link_motion(link, step, motion, q, u, udot, gravity))
    return [link_forces(link, m, u, udot) for link, m in zip(links, motion)]


def _add_to_parent(step: JointStep, wrench: tuple[Any, Any],
                   above: tuple[Any, Any]) -> tuple[Any, Any]:
    """Return the parent's wrench plus that of a link."""
    force, moment = step.inward(wrench[0]), step.inward(wrench[1])
    return above[0] + force, above[1] + (moment + cross(step.offset, force))
