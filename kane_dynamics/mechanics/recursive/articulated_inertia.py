"""
Forward dynamics in linear time by articulated inertias (ABA).

The links move at first without accelerations of the joints. What the torques lack for
that motion accelerates articulated inertias: with the axis S of a joint and the
articulated inertia K of all that it carries, the joint takes D = S . K S for a unit
acceleration, the links toward the root bear K S / D of its torque, and K loses
K S (K S)^T / D (Featherstone, Rigid Body Dynamics Algorithms, ch. 7; Angeles' decoupled
natural orthogonal complement factors M in the same order). Three passes, all in link
axes: motion outward, inertia and wrench inward, accelerations outward.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.vector import cross, skew, symmetric
from kane_dynamics.mechanics.recursive.inverse_dynamics import (inertia_wrench, JointStep,
                                                                link_motion, LinkMotion,
                                                                ZERO)
from kane_dynamics.mechanics.recursive.link import Link, Z
from kane_dynamics.mechanics.recursive.subroutines import directly, Share
from kane_dynamics.model.model import WORLD
import numpy as np

UPPER = np.triu_indices(3)
PLACES = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # of a symmetric matrix, in `UPPER`


class ArticulatedBody(NamedTuple):
    """
    Inertia of a link with all that it carries, and the wrench of its motion.

    force = A a + B alpha + `force`, moment = B^T a + C alpha + `moment`, about the origin.
    """

    A: Matrix
    B: Matrix
    C: Matrix
    force: Vector
    moment: Vector

    def entries(self) -> list[Scalar]:
        """Return all entries, each of a symmetric matrix once, (27,)."""
        return [*self.A[UPPER], *self.B.ravel(), *self.C[UPPER], *self.force, *self.moment]

    @staticmethod
    def of_entries(entries: Vector) -> 'ArticulatedBody':
        """Return the body from the result of `entries`."""
        A, B, C, force, moment = np.split(entries, [6, 15, 21, 24])
        return ArticulatedBody(A[PLACES], B.reshape(3, 3), C[PLACES], force, moment)

    def joined(self, other: 'ArticulatedBody') -> 'ArticulatedBody':
        """Return the sum of two bodies that move together."""
        return ArticulatedBody(*(x + y for x, y in zip(self, other, strict=True)))

    def in_parent(self, step: JointStep) -> 'ArticulatedBody':
        """Return the body in the parent's axes about the parent's origin."""
        A = step.inward_tensor(self.A)
        half_turned = np.stack([step.inward(row) for row in self.B])
        B = np.stack([step.inward(column) for column in half_turned.T], axis=1)
        C = step.inward_tensor(self.C)
        # The link's origin accelerates by a + alpha x p.
        P = skew(step.offset)
        shifted = B - A @ P
        C = C + symmetric(P @ shifted - B.T @ P)
        return ArticulatedBody(A, shifted, C,
                               *step.inward_wrench(self.force, self.moment))


class JointResponse(NamedTuple):
    """K S as force and moment, 1 / D, and the acceleration while the parent does not move."""

    force: Vector
    moment: Vector
    reciprocal: Scalar
    acceleration: Scalar


def _rigid(link: Link, motion: LinkMotion) -> ArticulatedBody:
    """Return a link alone."""
    S = link.second_moment
    trace = S[0, 0] + S[1, 1] + S[2, 2]
    return ArticulatedBody(link.mass * np.eye(3), -skew(link.first_moment),
                           trace * np.eye(3) - S, *inertia_wrench(link, motion))


def _joint_response(body: ArticulatedBody, step: JointStep, torque: Scalar,
                    armature: float) -> JointResponse:
    """Return how a joint accelerates the body that it carries."""
    if step.turns:
        force, moment = body.B[:, 2], body.C[:, 2]
        inertia, needed = moment[2], body.moment[2]
    else:
        force, moment = body.A[:, 2], body.B[2]
        inertia, needed = force[2], body.force[2]
    reciprocal = 1.0 / (inertia + armature)
    return JointResponse(force, moment, reciprocal, reciprocal * (torque - needed))


def _released(body: ArticulatedBody, response: JointResponse) -> ArticulatedBody:
    """Return the body that the parent carries while the joint accelerates freely."""
    force, moment, reciprocal, acceleration = response
    return ArticulatedBody(
        A=body.A - symmetric(np.outer(reciprocal * force, force)),
        B=body.B - np.outer(force, reciprocal * moment),
        C=body.C - symmetric(np.outer(reciprocal * moment, moment)),
        force=body.force + acceleration * force,
        moment=body.moment + acceleration * moment)


def _inward(step: JointStep, armature: float, entries: Vector, state: Vector) -> Vector:
    """
    Return the response of a joint, (8,), and what its body adds to the parent, (27,).

    `entries` are those of the body, `state` the sine, the cosine and the offset of the
    step, and the torque.
    """
    body = ArticulatedBody.of_entries(entries)
    s, c, *offset, torque = state
    step = step.at(s, c, np.array(offset))
    response = _joint_response(body, step, torque, armature)
    of_parent = _released(body, response).in_parent(step)
    return np.array([*response.force, *response.moment, response.reciprocal,
                     response.acceleration, *of_parent.entries()])


def forward_dynamics(links: Sequence[Link], q: Vector, u: Vector, torque: Vector,
                     armature: Vector, gravity: Vector,
                     share: Share = directly) -> Vector:
    """
    Return the accelerations of the joints, (n,).

    Parameters
    ----------
    links : sequence of Link
        Parents before children, rigid, each moved by a coordinate of its own with
        multiplier 1.
    q, u : (n,) arrays of scalars
        Coordinates and their rates.
    torque : (n,) array of scalars
        Of the joints: what accelerates them, in addition to gravity.
    armature : (n,) array
        Inertia of rotors.
    gravity : (3,) array of scalars
        m/s^2, world axes.
    share : callable
        Evaluates the inward pass of each joint, possibly as a subroutine: one function of
        hundreds of joints compiles for minutes.

    """
    # Outward: motion without accelerations of the joints.
    at_rest = np.zeros(len(q)).astype(object)
    steps: list[JointStep] = []
    motions: list[LinkMotion] = []
    bodies: list[ArticulatedBody] = []
    for link in links:
        step = JointStep(link, q)
        motions.append(link_motion(link, step, motions, q, u, at_rest, gravity))
        steps.append(step)
        bodies.append(_rigid(link, motions[-1]))

    # Inward: each joint accelerates by the torque that the motion leaves it.
    responses: dict[int, JointResponse] = {}
    for i in reversed(range(len(links))):
        link, step = links[i], steps[i]
        k = link.coordinate
        inward = partial(_inward, step, armature[k])
        state = np.array([step.s, step.c, *step.offset, torque[k]])
        entries = np.array(bodies[i].entries())
        of_joint, of_parent = np.split(share(f'inward_{i}', inward, entries, state), [8])
        responses[i] = JointResponse(of_joint[:3], of_joint[3:6], *of_joint[6:])
        if link.parent != WORLD:
            carried = ArticulatedBody.of_entries(of_parent)
            bodies[link.parent] = bodies[link.parent].joined(carried)

    # Outward: accelerations of the joints, and those of the links that follow from them.
    udot = np.zeros(len(q)).astype(object)
    accelerations: list[tuple[Vector, Vector]] = []
    for i, (link, step) in enumerate(zip(links, steps)):
        response = responses[i]
        acceleration = response.acceleration
        if link.parent == WORLD:
            a, alpha = ZERO, ZERO
        else:
            a, alpha = accelerations[link.parent]
            a = step.outward(a + cross(alpha, step.offset))
            alpha = step.outward(alpha)
            opposed = response.force @ a + response.moment @ alpha
            acceleration = acceleration - response.reciprocal * opposed
        udot[link.coordinate] = acceleration
        along_axis = acceleration * Z
        if step.turns:
            alpha = alpha + along_axis
        else:
            a = a + along_axis
        accelerations.append((a, alpha))
    return udot
