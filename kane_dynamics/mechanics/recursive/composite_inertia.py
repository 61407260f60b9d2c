"""
The mass matrix by composite bodies (Featherstone, Rigid Body Dynamics Algorithms, 6.2).

A joint accelerating alone moves all that it carries as one rigid body; the force and the moment
for that, seen through the axes of the joints below it, are its column. Where several joints share
their coordinates, as those of a beam's sections do, their moves become one a coordinate as soon as
they have come to the beam's root.
"""

from collections.abc import Iterator, Sequence
from typing import Any

from kane_dynamics.mechanics.algebra.vector import cross, is_zero, symmetric
from kane_dynamics.mechanics.recursive.flexible_modes import bent, Modes
from kane_dynamics.mechanics.recursive.inverse_dynamics import JointStep, Z
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.model.model import WORLD
import numpy as np

# Coefficients of the speeds, and the force and the moment about the link's origin that it takes.
JointAxisMotion = tuple[dict[int, Any], Any, Any]
# Moves' coefficients, and what is along a joint's axis.
CompositeForce = list[tuple[dict[int, Any], Any]]


def mass_matrix(links: Sequence[Link], q: Any) -> Any:
    """Return M_rs = sum_k (m_k v_k^r . v_k^s + omega_k^r . I_k omega_k^s), (n, n)."""
    links = bent(links, q)
    steps = [JointStep(link, q) for link in links]
    composite = [(link.mass, link.first_moment, link.second_moment) for link in links]
    # By what is beyond a beam, at its root.
    pending: list[list[JointAxisMotion]] = [[] for _ in links]
    seen: list[CompositeForce] = [[] for _ in links]
    M = [[0.0] * len(q) for _ in q]
    for i in reversed(range(len(links))):
        link, step, (mass, h, S) = links[i], steps[i], composite[i]
        moves = _by_modes(pending[i], Modes(link, q), M) if link.beam is not None else []
        own = _accelerated(step, mass, h, S)
        seen[i] += [(move[0], _along(step, move)) for move in moves]
        seen[i].append((own[0], 0.5 * _along(step, own)))
        for move in (*moves, own):
            for k, there in _below(links, steps, i, move):
                if links[k].beam is not None:
                    pending[k].append(there)
                else:
                    seen[k].append((there[0], _along(steps[k], there)))
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
    """Return the move of a composite body by its joint's own unit acceleration."""
    if step.turns:
        return (dict(step.partials), np.array([-h[1], h[0], 0.0]),
                np.array([-S[0, 2], -S[1, 2], S[0, 0] + S[1, 1]]))
    return dict(step.partials), mass * Z, np.array([h[1], -h[0], 0.0])


def _along(step: JointStep, move: JointAxisMotion) -> Any:
    """Return what a move is along the axis of the joint of the link that it is on."""
    _, force, moment = move
    return moment[2] if step.turns else force[2]


def _below(links: Sequence[Link], steps: Sequence[JointStep], i: int,
           move: JointAxisMotion) -> Iterator[tuple[int, JointAxisMotion]]:
    """Yield a move on link i as each link below sees it, the next beam being the last."""
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
    Add to the upper half of M what moves are along a joint's axis, its own counted by half.

    M_rs takes w_r W_s + W_r w_s times that, w the joint's coefficients and W a move's.
    """
    if any(not isinstance(w, (int, float)) for w in rates.values()):
        total: dict[int, Any] = {}  # numbers are products at once, anything else is summed first
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
                        continue  # it is done with the roles exchanged
                    product = product + weights[r] * rates[s]
                low, high = min(r, s), max(r, s)
                M[low][high] = M[low][high] + product * value


def _by_modes(moves: list[JointAxisMotion], modes: Modes,
              M: list[list[Any]]) -> list[JointAxisMotion]:
    """Return moves with those of a beam's modes made one a mode; the modes' own mass goes to M."""
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
