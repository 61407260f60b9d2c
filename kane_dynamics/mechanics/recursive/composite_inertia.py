"""
Mass matrix by the composite rigid body algorithm (CRBA).

A unit acceleration of one joint moves its subtree as one composite rigid body. The force and
moment for that, projected on the axes of the joints toward the root, are a column of the mass
matrix (Walker & Orin 1982; Featherstone, Rigid Body Dynamics Algorithms, 6.2). Joints of a beam's
sections share coordinates; their contributions are combined per mode at the beam's root.
"""

from collections.abc import Iterator, Sequence
from typing import Any

from kane_dynamics.mechanics.algebra.vector import cross, is_zero, symmetric
from kane_dynamics.mechanics.recursive.flexible_modes import bent, Modes
from kane_dynamics.mechanics.recursive.inverse_dynamics import JointStep, Z
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.model.model import WORLD
import numpy as np

# Coefficients of the speeds; force and moment about the link's origin for a unit acceleration.
JointAxisMotion = tuple[dict[int, Any], Any, Any]
# Per joint axis motion: coefficients of the speeds, and its component along a joint's axis.
CompositeForce = list[tuple[dict[int, Any], Any]]


def mass_matrix(links: Sequence[Link], q: Any) -> Any:
    """Return M_rs = sum_k (m_k v_k^r . v_k^s + omega_k^r . I_k omega_k^s), (n, n), by CRBA."""
    links = bent(links, q)
    steps = [JointStep(link, q) for link in links]
    composite = [(link.mass, link.first_moment, link.second_moment) for link in links]
    # Motions of the subtree beyond a beam, by the beam's root.
    pending: list[list[JointAxisMotion]] = [[] for _ in links]
    seen: list[CompositeForce] = [[] for _ in links]
    M = [[0.0] * len(q) for _ in q]
    for i in reversed(range(len(links))):
        link, step, (mass, h, S) = links[i], steps[i], composite[i]
        moves = [] if link.modes is None else _combined_by_modes(pending[i], link.modes, M)
        own = _accelerated(step, mass, h, S)
        seen[i] += [(move[0], _axis_component(step, move)) for move in moves]
        seen[i].append((own[0], 0.5 * _axis_component(step, own)))
        for move in (*moves, own):
            for k, there in _propagated(links, steps, i, move):
                if links[k].beam is not None:
                    pending[k].append(there)
                else:
                    seen[k].append((there[0], _axis_component(steps[k], there)))
        if link.parent != WORLD:
            p = step.offset
            h, S = step.inward(h), step.inward_tensor(S)
            above = composite[link.parent]
            hp = h + mass * p
            shifted = S + np.outer(p, h) + np.outer(hp, p)
            composite[link.parent] = (above[0] + mass, above[1] + hp,
                                      above[2] + symmetric(shifted))
    for step, of_joint in zip(steps, seen):
        _project(dict(step.partials), of_joint, M)
    return np.array([[M[min(r, s)][max(r, s)] for s in range(len(q))] for r in range(len(q))])


def _accelerated(step: JointStep, mass: Any, h: Any, S: Any) -> JointAxisMotion:
    """Return the force and moment of a composite body for a unit acceleration of its own joint."""
    if step.turns:
        return (dict(step.partials), np.array([-h[1], h[0], 0.0]),
                np.array([-S[0, 2], -S[1, 2], S[0, 0] + S[1, 1]]))
    return dict(step.partials), mass * Z, np.array([h[1], -h[0], 0.0])


def _axis_component(step: JointStep, move: JointAxisMotion) -> Any:
    """Return the component of a force and moment along the axis of the link's joint."""
    _, force, moment = move
    return moment[2] if step.turns else force[2]


def _propagated(links: Sequence[Link], steps: Sequence[JointStep], i: int,
                move: JointAxisMotion) -> Iterator[tuple[int, JointAxisMotion]]:
    """Yield the force and moment of link i on each link toward the root, up to the next beam."""
    weights, force, moment = move
    while links[i].parent != WORLD:
        force, moment = steps[i].inward(force), steps[i].inward(moment)
        moment = moment + cross(steps[i].offset, force)
        i = links[i].parent
        yield i, (weights, force, moment)
        if links[i].beam is not None:
            return


def _project(rates: dict[int, Any], seen: CompositeForce, M: list[list[Any]]) -> None:
    """
    Add the axis components of a joint to the upper half of M; its own with half weight.

    Each component adds (w_r W_s + W_r w_s) times itself to M_rs, w being the coefficients of the
    joint and W those of the accelerating joint.
    """
    if any(not isinstance(w, (int, float)) for w in rates.values()):
        total: dict[int, Any] = {}  # traced values are summed before the multiplication
        for weights, value in seen:
            for s, W in weights.items():
                total[s] = total.get(s, 0.0) + W * value
        seen = [(total, 1.0)]
    for weights, value in seen:
        if is_zero(value):
            continue
        for s, W in weights.items():
            for r, w in rates.items():
                product = w * W
                if r in weights and s in rates:
                    if r > s:
                        continue  # covered with r and s exchanged
                    product = product + weights[r] * rates[s]
                low, high = min(r, s), max(r, s)
                M[low][high] = M[low][high] + product * value


def _combined_by_modes(moves: list[JointAxisMotion], modes: Modes,
                       M: list[list[Any]]) -> list[JointAxisMotion]:
    """Combine motions per mode of a beam and add the modal mass to M."""
    own = dict(zip(modes.coordinates, zip(modes.momentum, modes.spin)))
    rest = []
    for weights, force, moment in moves:
        for r, (f, n) in own.items():
            if r in weights:
                own[r] = f + weights[r] * force, n + weights[r] * moment
        others = {s: w for s, w in weights.items() if s not in own}
        if others:
            rest.append((others, force, moment))
    for r, row in zip(modes.coordinates, modes.mass):
        for s, value in zip(modes.coordinates, row):
            if s >= r:
                M[r][s] = M[r][s] + value
    return [*rest, *(({r: 1.0}, force, moment) for r, (force, moment) in own.items())]
