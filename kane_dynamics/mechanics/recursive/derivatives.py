"""
Analytic derivatives of inverse dynamics (RNEA) with respect to q and u.

A small displacement of joint j moves its subtree as a rigid body. In axes fixed to the
subtree, the acceleration of each of its points P changes by

    da + chi x r + 2 delta x v_P

with r and v_P the position and velocity of P relative to the joint's origin. For a joint
with axis s, with the origin's acceleration a and U = [alpha]x + [omega]x [omega]x, these
are of a revolute joint

    with q:  delta = omega x s,  chi = U s,          da = a x s
    with u:  delta = s,          chi = 2 omega x s,  da = 0

and of a prismatic one

    with q:  delta = 0,          chi = 0,            da = U s
    with u:  delta = 0,          chi = 0,            da = 2 omega x s

The torque of a joint i beyond j changes by f . da + n . chi + e . delta. The vectors f,
n and e of the subtree of i are transformed from i to the root once for all j on that
path. The torques of these joints j change with joint i by one force and moment each for
q and for u.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.vector import cross, symmetric
from kane_dynamics.mechanics.recursive.inverse_dynamics import (inertia_wrench,
                                                                JointStep, link_motion,
                                                                LinkMotion, ZERO)
from kane_dynamics.mechanics.recursive.link import Link, Z
from kane_dynamics.mechanics.recursive.subroutines import directly, Share
from kane_dynamics.model.model import WORLD
import numpy as np

Rows = list[list[Scalar]]


@dataclass
class CompositeBody:
    """
    Composite body of a joint's subtree, about its link's origin, in link axes.

    Attributes
    ----------
    mass, h, S : scalar, (3,), (3, 3)
        Mass, first and second moment: int dm, int r dm, int r r^T dm.
    p, L, S_rate : (3,), (3,), (3, 3)
        Momentum, angular momentum and rate of S, with velocities relative to the origin:
        int v dm, int r x v dm, int v r^T + r v^T dm.
    force, moment : (3,), (3,)
        Negated inertia force and moment, including gravity.

    """

    mass: Scalar
    h: Vector
    S: Matrix
    p: Vector
    L: Vector
    S_rate: Matrix
    force: Vector
    moment: Vector


class LinkState:
    """
    Joint transform and motion of a link, and its velocity past the parent's origin.

    `rows` and `columns` propagate vectors by one link toward the root. The only varying
    data they use is `state`, (15,), so that many joints can share one subroutine.
    """

    def __init__(self, link: Link, step: JointStep, motion: LinkMotion,
                 velocity: Vector) -> None:
        """Store the data and collect the varying part in `state`."""
        self.link = link
        self.step = step
        self.motion = motion
        self.velocity = velocity
        # The projections on a joint's axis z use only these entries of omega, U and a.
        omega, _, a, U = motion
        self.state = np.array([step.s, step.c, *step.offset, *velocity,
                               omega[0], omega[1], *U[:, 2], a[0], a[1]])

    def rows(self, carried: Vector, state: Vector) -> Vector:
        """
        Return entries of dtau/dq, dtau/du and M, then `carried` for the parent, (12,).

        `carried`, (9,), are the vectors f, n and e (see the module) in this link's axes.
        """
        step, velocity, omega, U_z, a = self._read(state)
        f, n, e = carried[:3], carried[3:6], carried[6:]

        # f . da + n . chi + e . delta with s = z, for the displacement, the rate and the
        # acceleration of this joint.
        if self.link.kind == 'revolute':
            by_q = (n @ U_z + (f[0] * a[1] - f[1] * a[0])
                    + (e[0] * omega[1] - e[1] * omega[0]))
            by_u = n[0] * (omega[1] + omega[1]) - n[1] * (omega[0] + omega[0]) + e[2]
            inertia = n[2]
        else:
            by_q = f @ U_z
            by_u = f[0] * (omega[1] + omega[1]) - f[1] * (omega[0] + omega[0])
            inertia = f[2]

        # The vectors in the parent's axes, about its origin.
        f = step.inward(f)
        n = step.inward(n)
        e = step.inward(e)
        n = n + cross(step.offset, f)
        e = e + 2.0 * cross(velocity, f)
        return np.array([by_q, by_u, inertia, *f, *n, *e])

    def columns(self, wrenches: Vector, state: Vector) -> Vector:
        """Transform two forces and moments, (12,), from this link to its parent."""
        step = self._read(state)[0]
        by_q = step.inward_wrench(wrenches[:3], wrenches[3:6])
        by_u = step.inward_wrench(wrenches[6:9], wrenches[9:])
        return np.concatenate([*by_q, *by_u])

    def _read(self, state: Vector) -> tuple[JointStep, Vector, Vector, Vector, Vector]:
        """Return transform, velocity, omega (x, y), U z and acceleration (x, y)."""
        step = self.step.at(state[0], state[1], state[2:5])
        return step, state[5:8], state[8:10], state[10:13], state[13:]


def inverse_dynamics_derivatives(links: Sequence[Link], q: Vector, u: Vector,
                                 udot: Vector, gravity: Vector,
                                 share: Share = directly) -> Matrix:
    """
    Return dtau/dq, dtau/du and M of the links without friction and springs, (3, n, n).

    Arguments as `inverse_dynamics`; `share` evaluates repeated parts, possibly as
    subroutines (see `subroutines`).
    """
    # Outward pass: motions of the links, and their inertia forces as single bodies.
    states = []
    bodies = []
    for state in link_states(links, q, u, udot, gravity):
        states.append(state)
        bodies.append(single_link(state.link, state.motion))

    # Inward pass: with the composite body of its subtree, joint i has a row of the
    # results (its torque by q, u of the joints toward the root) and a column (their
    # torques by q_i, u_i).
    n = len(q)
    by_q: Rows = [[0.0] * n for _ in range(n)]
    by_u: Rows = [[0.0] * n for _ in range(n)]
    M: Rows = [[0.0] * n for _ in range(n)]
    for i in reversed(range(len(links))):
        _add_row(states, bodies[i], i, (by_q, by_u, M), share)
        _add_column(states, bodies[i], i, (by_q, by_u), share)
        if links[i].parent != WORLD:
            add_body_to_parent(states[i], bodies[i], bodies[links[i].parent])
    return np.reshape([by_q, by_u, M], (3, n, n))


def link_states(links: Sequence[Link], q: Vector, u: Vector, udot: Vector,
                gravity: Vector) -> Iterator[LinkState]:
    """Yield the state of every link."""
    motions: list[LinkMotion] = []
    for link in links:
        step = JointStep(link, q)
        motions.append(link_motion(link, step, motions, q, u, udot, gravity))
        # The velocity of the link's origin relative to its parent's, from joint to
        # joint: omega x offset, and the rate of a sliding joint.
        velocity = ZERO
        if link.parent != WORLD:
            parent_omega = motions[link.parent][0]
            velocity = cross(parent_omega, step.offset)
            if link.kind == 'prismatic':
                rate = link.multiplier * u[link.coordinate]
                velocity = velocity + rate * step.axis
        yield LinkState(link, step, motions[-1], velocity)


def single_link(link: Link, motion: LinkMotion) -> CompositeBody:
    """Return the composite body of a single link."""
    # Momentum int omega x r dm, and angular momentum int r x (omega x r) dm.
    omega = motion[0]
    S, h = link.second_moment, link.first_moment
    v_r = np.stack([cross(omega, column) for column in S.T], axis=1)  # int v r^T dm
    trace = S[0, 0] + S[1, 1] + S[2, 2]
    momentum = cross(omega, h)
    angular_momentum = trace * omega - S @ omega
    S_rate = v_r + v_r.T
    force, moment = inertia_wrench(link, motion)
    return CompositeBody(link.mass, h, S, momentum, angular_momentum, S_rate, force,
                         moment)


def _add_row(states: Sequence[LinkState], body: CompositeBody, i: int,
             results: tuple[Rows, Rows, Rows], share: Share) -> None:
    """Add row i: derivatives with respect to joint i and the joints toward the root."""
    joint = states[i].link
    row = joint.coordinate
    M = results[2]
    carried = row_vectors(joint.kind, body)
    # The composite body of joint i is carried from joint to joint toward the root; its
    # projections there are the entries of the row.
    j = i
    while j != WORLD:
        link = states[j].link
        values = share(f'row_{j}', states[j].rows, carried, states[j].state)
        entries, carried = values[:3], values[3:]
        column = link.coordinate
        factor = joint.multiplier * link.multiplier
        for matrix, entry in zip(results, entries):
            matrix[row][column] = matrix[row][column] + factor * entry
        if j != i:  # M is symmetric
            M[column][row] = M[column][row] + factor * entries[2]
        j = link.parent


def row_vectors(kind: str, body: CompositeBody) -> Vector:
    """Return f, n and e (see the module) of a link's joint in link axes, (9,)."""
    # f = s x h, n = I s and e, with the velocities, for a rotation about s = z; then
    # the same for a slide along z.
    h, S, S_rate, L = body.h, body.S, body.S_rate, body.L
    if kind == 'revolute':
        return np.array([-h[1], h[0], 0.0,
                         -S[0, 2], -S[1, 2], S[0, 0] + S[1, 1],
                         L[1] - S_rate[0, 2], -L[0] - S_rate[1, 2],
                         S_rate[0, 0] + S_rate[1, 1]])
    return np.array([0.0, 0.0, body.mass, h[1], -h[0], 0.0,
                     2.0 * body.p[1], -2.0 * body.p[0], 0.0])


def _add_column(states: Sequence[LinkState], body: CompositeBody, i: int,
                results: tuple[Rows, Rows], share: Share) -> None:
    """Add column i: derivatives of the torques toward the root by q_i and u_i."""
    joint = states[i].link
    column = joint.coordinate
    wrenches = column_wrenches(joint.kind, states[i].motion, body)
    # The changes of the wrench by q_i and by u_i, carried toward the root.
    j = i
    while states[j].link.parent != WORLD:
        wrenches = share(f'column_{j}', states[j].columns, wrenches, states[j].state)
        j = states[j].link.parent
        link = states[j].link
        row = link.coordinate
        along = 5 if link.kind == 'revolute' else 2  # index of the component along z
        for matrix, entry in zip(results, (wrenches[along], wrenches[along + 6])):
            change = joint.multiplier * link.multiplier * entry
            matrix[row][column] = matrix[row][column] + change


def column_wrenches(kind: str, motion: LinkMotion, body: CompositeBody) -> Vector:
    """Return the changes of force and moment with q, then u, of the joint, (12,)."""
    omega, _, a, U = motion
    across = np.array([omega[1], -omega[0], 0.0])  # omega x s
    turned_force = np.array([-body.force[1], body.force[0], 0.0])  # s x force
    if kind == 'revolute':
        a_across = np.array([a[1], -a[0], 0.0])  # a x s
        force, moment = _wrench_change(body, across, U[:, 2], a_across)
        # The force and moment themselves turn with the joint.
        force = force + turned_force
        moment = moment + np.array([-body.moment[1], body.moment[0], 0.0])
        by_u = _wrench_change(body, Z, across + across, ZERO)
        return np.concatenate([force, moment, *by_u])
    force, moment = _wrench_change(body, ZERO, ZERO, U[:, 2])
    moment = moment + turned_force  # the force is applied at another place
    by_u = _wrench_change(body, ZERO, ZERO, across + across)
    return np.concatenate([force, moment, *by_u])


def _wrench_change(body: CompositeBody, delta: Vector, chi: Vector,
                   da: Vector) -> tuple[Vector, Vector]:
    """Return force and moment for an acceleration change da + chi x r + 2 delta x v."""
    S, S_rate = body.S, body.S_rate
    force = body.mass * da + cross(chi, body.h) + cross(delta + delta, body.p)
    # int r x (chi x r) dm = (tr(S) 1 - S) chi; with 2 delta x v it is S', and L as its
    # antisymmetric part.
    trace = S[0, 0] + S[1, 1] + S[2, 2]
    trace_rate = S_rate[0, 0] + S_rate[1, 1] + S_rate[2, 2]
    moment = (cross(body.h, da) + trace * chi - S @ chi
              + trace_rate * delta - S_rate @ delta - cross(body.L, delta))
    return force, moment


def add_body_to_parent(state: LinkState, body: CompositeBody,
                       parent: CompositeBody) -> None:
    """Add the composite body of a link to that of its parent."""
    step = state.step
    mass = body.mass
    r = step.offset  # from the parent's origin to the link's
    w = state.velocity  # its rate
    h = step.inward(body.h)
    p = step.inward(body.p)
    force = step.inward(body.force)

    # With r + r_P and w + v_P in place of r_P and v_P in every integral.
    h_all = h + mass * r
    p_all = p + mass * w
    v_r = np.outer(h, w) + np.outer(p_all, r)
    parent.mass = parent.mass + mass
    parent.h = parent.h + h_all
    parent.p = parent.p + p_all
    parent.S = parent.S + symmetric(step.inward_tensor(body.S) + np.outer(r, h)
                                    + np.outer(h_all, r))
    parent.S_rate = parent.S_rate + symmetric(step.inward_tensor(body.S_rate)
                                              + (v_r + v_r.T))
    parent.L = parent.L + (step.inward(body.L) + cross(r, p_all) + cross(h, w))
    parent.force = parent.force + force
    parent.moment = parent.moment + (step.inward(body.moment) + cross(r, force))
