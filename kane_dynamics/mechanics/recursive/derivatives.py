"""
Analytic derivatives of inverse dynamics (RNEA) with respect to q and u.

A small displacement of joint j moves its subtree as a rigid body. In axes fixed to the subtree,
the acceleration of each of its points P changes by

    da + chi x r + 2 delta x v_P

with r and v_P the position and velocity of P relative to the joint's origin. For a joint with
axis s, with the origin's acceleration a and U = [alpha]x + [omega]x [omega]x,

    d/dq: delta = omega x s,  chi = U s,          da = a x s   (revolute);  0, 0, U s  (prismatic)
    by u:  delta = s,          chi = 2 omega x s,  da = 0       (revolute);  0, 0, 2 omega x s

The torque of a joint i beyond j changes by f . da + n . chi + e . delta. The vectors f, n and e
of the subtree of i are transformed from i to the root once for all j on that path. The torques
of these joints j change with joint i by one force and moment each for q and for u.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics.mechanics.algebra.vector import cross, symmetric
from kane_dynamics.mechanics.recursive.inverse_dynamics import (inertia_wrench, JointStep,
                                                                link_motion, LinkMotion, Z)
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.mechanics.recursive.subroutines import directly, Share
from kane_dynamics.model.model import WORLD
import numpy as np

NONE = np.array([0.0, 0.0, 0.0])
Matrix = list[list[Any]]


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

    mass: Any
    h: Any
    S: Any
    p: Any
    L: Any
    S_rate: Any
    force: Any
    moment: Any


class LinkState:
    """
    Joint transform and motion of a link, with its velocity relative to the parent's origin.

    `rows` and `columns` propagate vectors by one link toward the root. The only varying data
    they use is `state`, (15,), so that many joints can share one subroutine.
    """

    def __init__(self, link: Link, step: JointStep, motion: LinkMotion, velocity: Any) -> None:
        """Store the data and collect the varying part in `state`."""
        self.link, self.step, self.motion, self.velocity = link, step, motion, velocity
        omega, _, a, U = motion
        self.state = np.array([step.s, step.c, *step.offset, *velocity, omega[0], omega[1],
                               *U[:, 2], a[0], a[1]])

    def rows(self, carried: Any, state: Any) -> Any:
        """
        Return entries of dtau/dq, dtau/du and M, then `carried` in the parent's axes, (12,).

        `carried`, (9,), are the vectors f, n and e (see the module) in this link's axes.
        """
        step, velocity, x, y, U_z, a = self._read(state)
        f, n, e = carried[:3], carried[3:6], carried[6:]
        if self.link.kind == 'revolute':
            entries = (n @ U_z + (f[0] * a[1] - f[1] * a[0]) + (e[0] * y - e[1] * x),
                       n[0] * (y + y) - n[1] * (x + x) + e[2], n[2])
        else:
            entries = (f @ U_z, f[0] * (y + y) - f[1] * (x + x), f[2])
        f, n, e = (step.inward(v) for v in (f, n, e))
        n = n + cross(step.offset, f)
        e = e + 2.0 * cross(velocity, f)
        return np.array([*entries, *f, *n, *e])

    def columns(self, wrenches: Any, state: Any) -> Any:
        """Transform two forces and moments, (12,), from this link to its parent."""
        step = self._read(state)[0]
        result: list[Any] = []
        for force, moment in ((wrenches[:3], wrenches[3:6]), (wrenches[6:9], wrenches[9:])):
            force, moment = step.inward(force), step.inward(moment)
            result += [*force, *(moment + cross(step.offset, force))]
        return np.array(result)

    def _read(self, state: Any) -> tuple[JointStep, Any, Any, Any, Any, Any]:
        s, c, offset, velocity, (x, y) = state[0], state[1], state[2:5], state[5:8], state[8:10]
        return self.step.at(s, c, offset), velocity, x, y, state[10:13], state[13:]


def inverse_dynamics_derivatives(links: Sequence[Link], q: Any, u: Any, udot: Any, gravity: Any,
                                 share: Share = directly) -> Any:
    """
    Return dtau/dq, dtau/du and M of the links without friction and springs, (3, n, n).

    Arguments as `inverse_dynamics`; `share` evaluates repeated parts, possibly as subroutines (see
    `subroutines`).
    """
    n = len(q)
    states, carried = [], []
    for state in link_states(links, q, u, udot, gravity):
        states.append(state)
        carried.append(single_link(state.link, state.motion))
    by_q, by_u, M = ([[0.0] * n for _ in range(n)] for _ in range(3))
    for i in reversed(range(len(links))):
        _add_row(states, carried[i], i, (by_q, by_u, M), share)
        _add_column(states, carried[i], i, (by_q, by_u), share)
        if links[i].parent != WORLD:
            add_to_parent(states[i], carried[i], carried[links[i].parent])
    return np.array([by_q, by_u, M])


def link_states(links: Sequence[Link], q: Any, u: Any, udot: Any,
                gravity: Any) -> Iterator[LinkState]:
    """Yield the state of every link."""
    motion: list[LinkMotion] = []
    for link in links:
        step = JointStep(link, q)
        motion.append(link_motion(link, step, motion, q, u, udot, gravity))
        velocity = NONE
        if link.parent != WORLD:
            velocity = cross(motion[link.parent][0], step.offset)
            if link.kind == 'prismatic':
                velocity = velocity + (link.multiplier * u[link.coordinate]) * step.axis
        yield LinkState(link, step, motion[-1], velocity)


def single_link(link: Link, motion: LinkMotion) -> CompositeBody:
    """Return the composite body of a single link."""
    omega, S, h = motion[0], link.second_moment, link.first_moment
    v_r = np.stack([cross(omega, column) for column in S.T], axis=1)  # int v r^T dm
    spin = S[0, 0] + S[1, 1] + S[2, 2]
    return CompositeBody(link.mass, h, S, cross(omega, h), spin * omega - S @ omega, v_r + v_r.T,
                         *inertia_wrench(link, motion))


def _add_row(states: Sequence[LinkState], body: CompositeBody, i: int,
             results: tuple[Matrix, Matrix, Matrix], share: Share) -> None:
    """Add row i: derivatives with respect to joint i and the joints toward the root."""
    own = states[i].link
    passed = row_vectors(own.kind, body)
    j, row, M = i, own.coordinate, results[2]
    while j != WORLD:
        link = states[j].link
        answer = share(f'row_{j}', states[j].rows, passed, states[j].state)
        entries, passed = answer[:3], answer[3:]
        column, factor = link.coordinate, own.multiplier * link.multiplier
        for matrix, entry in zip(results, entries):
            matrix[row][column] = matrix[row][column] + factor * entry
        if j != i:
            M[column][row] = M[column][row] + factor * entries[2]
        j = link.parent


def row_vectors(kind: str, body: CompositeBody) -> Any:
    """Return the vectors f, n and e (see the module) of a link's joint in link axes, (9,)."""
    h, S, K, L = body.h, body.S, body.S_rate, body.L
    if kind == 'revolute':
        return np.array([-h[1], h[0], 0.0, -S[0, 2], -S[1, 2], S[0, 0] + S[1, 1],
                         L[1] - K[0, 2], -L[0] - K[1, 2], K[0, 0] + K[1, 1]])
    return np.array([0.0, 0.0, body.mass, h[1], -h[0], 0.0,
                     2.0 * body.p[1], -2.0 * body.p[0], 0.0])


def _add_column(states: Sequence[LinkState], body: CompositeBody, i: int,
                results: tuple[Matrix, Matrix], share: Share) -> None:
    """Add column i: derivatives of the torques toward the root with respect to q_i and u_i."""
    link = states[i].link
    wrenches = column_wrenches(link.kind, states[i].motion, body)
    j = i
    while states[j].link.parent != WORLD:
        wrenches = share(f'column_{j}', states[j].columns, wrenches, states[j].state)
        j = states[j].link.parent
        below = states[j].link
        row, column = below.coordinate, link.coordinate
        along = 5 if below.kind == 'revolute' else 2  # index of the component along z
        for matrix, entry in zip(results, (wrenches[along], wrenches[along + 6])):
            matrix[row][column] = (matrix[row][column]
                                   + link.multiplier * below.multiplier * entry)


def column_wrenches(kind: str, motion: LinkMotion, body: CompositeBody) -> Any:
    """Return the changes of force and moment with q and u of the own joint, (12,), link axes."""
    omega, _, a, U = motion
    across = np.array([omega[1], -omega[0], 0.0])  # omega x s
    turned = np.array([-body.force[1], body.force[0], 0.0])  # s x force
    if kind == 'revolute':
        force, moment = _wrench_change(body, across, U[:, 2], np.array([a[1], -a[0], 0.0]))
        N = body.moment
        return np.concatenate([force + turned, moment + np.array([-N[1], N[0], 0.0]),
                               *_wrench_change(body, Z, across + across, NONE)])
    force, moment = _wrench_change(body, NONE, NONE, U[:, 2])
    return np.concatenate([force, moment + turned,
                           *_wrench_change(body, NONE, NONE, across + across)])


def _wrench_change(body: CompositeBody, delta: Any, chi: Any, da: Any) -> tuple[Any, Any]:
    """Return the force and moment for an acceleration change da + chi x r + 2 delta x v."""
    S, K = body.S, body.S_rate
    force = body.mass * da + cross(chi, body.h) + cross(delta + delta, body.p)
    spin, growth = S[0, 0] + S[1, 1] + S[2, 2], K[0, 0] + K[1, 1] + K[2, 2]
    moment = (cross(body.h, da) + spin * chi - S @ chi
              + growth * delta - K @ delta - cross(body.L, delta))
    return force, moment


def add_to_parent(state: LinkState, body: CompositeBody, parent: CompositeBody) -> None:
    """Add the composite body of a link to that of its parent."""
    step, mass, r, w = state.step, body.mass, state.step.offset, state.velocity
    h, p, force = step.inward(body.h), step.inward(body.p), step.inward(body.force)
    h_all, p_all = h + mass * r, p + mass * w
    grown = np.outer(h, w) + np.outer(p_all, r)
    parent.mass = parent.mass + mass
    parent.h, parent.p = parent.h + h_all, parent.p + p_all
    parent.S = parent.S + symmetric(step.inward_tensor(body.S) + np.outer(r, h)
                                    + np.outer(h_all, r))
    parent.S_rate = parent.S_rate + symmetric(step.inward_tensor(body.S_rate)
                                              + (grown + grown.T))
    parent.L = parent.L + (step.inward(body.L) + cross(r, p_all) + cross(h, w))
    parent.force = parent.force + force
    parent.moment = parent.moment + (step.inward(body.moment) + cross(r, force))
