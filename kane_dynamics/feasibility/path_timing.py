"""The motion along a path with given squared path velocities."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.motion.motion import Motion
import numpy as np

PAUSE = 1e-6  # s between two sections, in which the acceleration changes
# Gauss-Legendre quadrature with four points on [0, 1].
NODES, WEIGHTS = (0.5 * (np.polynomial.legendre.leggauss(4)[k] + (1.0, 0.0)[k]) for k in (0, 1))


def timed(parts: Sequence[tuple[Section, Array]], names: tuple[str, ...]) -> Motion:
    """
    Return the motion along sections with squared path velocities x at their vertices.

    Its points are the ends of each section and the middles between its vertices. There x and its
    slope are those of the polygon through the vertices, so x(s) is a quadratic spline, which
    rounds the corners of the polygon, and the acceleration is continuous.
    """
    times, states, begin = [], [], 0.0
    for section, x in parts:
        t, *state = _points(section, x)
        times.append(begin + t)
        states.append(state)
        begin += t[-1] + PAUSE
    return Motion.from_points(np.concatenate(times),
                              *(np.concatenate(rows) for rows in zip(*states)), joint_names=names)


def _points(section: Section, x: Array) -> tuple[Array, Array, Array, Array]:
    """Return t, q, u and udot at the points of a section."""
    h, places = section.step, np.r_[0, 1:len(section.q):2, len(section.q) - 1]
    s2 = np.diff(x) / (2.0 * h)  # s'' between the vertices
    s2 = np.concatenate([s2[:1], s2, s2[-1:]])
    at = np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]])
    steps = np.full(len(at) - 1, h)
    steps[[0, -1]] = 0.5 * h
    begin, end = s2[:-1, None], s2[1:, None]
    inside = at[:-1, None] + steps[:, None] * NODES * (2.0 * begin + (end - begin) * NODES)
    durations = steps * (WEIGHTS / np.sqrt(inside)).sum(axis=1)
    first, second = section.first[places], section.second[places]
    return (np.concatenate([[0.0], np.cumsum(durations)]), section.q[places],
            first * np.sqrt(at)[:, None], second * at[:, None] + first * s2[:, None])
