"""
Points of a trajectory with all derivatives, as joint_trajectory_controller takes them.

That controller interpolates points with positions, velocities and accelerations by
quintics, so points with all three define the motion that it executes. Here missing ones
are filled in such that the motion is smooth: the acceleration is continuous from rest to
rest.
"""

from __future__ import annotations

from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.algebra.spline import (inside_segments,
                                                    segment_coefficients, segment_ends,
                                                    spline_velocities)
from kane_dynamics.motion.points import State
import numpy as np
from numpy.typing import NDArray

Segments = NDArray[np.intp]  # numbers of segments

AT_REST = 1e-6  # rad/s or m/s: the controller refuses trajectories that end faster


class ControllerPoints(NamedTuple):
    """
    Points of a trajectory: times (K,), s; positions, velocities, accelerations (K, n).

    The segments between the points have the numbers 0 to K - 2.
    """

    t: Array
    q: Array
    u: Array
    udot: Array

    @property
    def coefficients(self) -> Array:
        """Return the coefficients of q in x, 0 to 1, of all segments, (K - 1, 6, n)."""
        return segment_coefficients(self.t, self.q, self.u, self.udot)

    def inside(self, segments: Segments, x: Array) -> State:
        """Return q, u, udot, (m, S, n), at fractions x, (m,), of segments, (S,)."""
        ends = segment_ends(self.t, self.q, self.u, self.udot)
        return inside_segments(ends[:, segments], np.diff(self.t)[segments], x)

    def halved(self, segments: Segments) -> ControllerPoints:
        """
        Return the points with one more in the middle of each of some segments, (S,).

        The motion is the same: a part of a quintic is the quintic between its ends.
        """
        # The middle of a segment, on the motion itself.
        t = self.t[segments] + 0.5 * np.diff(self.t)[segments]
        q, u, udot = self.inside(segments, np.array([0.5]))
        places = segments + 1
        return ControllerPoints(np.insert(self.t, places, t),
                                np.insert(self.q, places, q[0], 0),
                                np.insert(self.u, places, u[0], 0),
                                np.insert(self.udot, places, udot[0], 0))


def completed(t: Array, q: Array, u: Array | None, udot: Array | None,
              start: State | None = None) -> ControllerPoints:
    """
    Return points with velocities and accelerations.

    Missing velocities are those of the cubic spline, at rest at the end. Missing
    accelerations are those of the cubics between the points; where they differ at an
    inner point, their mean. A motion that begins or ends at rest does so without
    acceleration; for the end this holds for given accelerations too, because the
    controller holds the effort of the last point.

    Parameters
    ----------
    t : (K,) array
        Times, s, increasing.
    q, u, udot : (K, n) arrays
        Positions, rad or m, velocities and accelerations; u and udot may be None.
    start : three (n,) arrays, optional
        State at time 0, from which the motion begins if the first point is later;
        default: it begins at the first point.

    """
    first_velocity = np.zeros(q.shape[1])
    # A start before the first point is one more point.
    if start is not None and t[0] > 0.0:
        q0, first_velocity, udot0 = start
        t = np.concatenate([[0.0], t])
        q = np.vstack([q0, q])
        if u is not None:
            u = np.vstack([first_velocity, u])
        if udot is not None:
            udot = np.vstack([udot0, udot])
    # The rules of joint_trajectory_controller fill what is missing: a clamped cubic
    # spline, then accelerations that continue it.
    if u is None:
        u = spline_velocities(t, q, first_velocity)
    if udot is None:
        udot = _mean_accelerations(t, q, u)
        # From rest and to rest, without a jump of the acceleration.
        udot[0, np.abs(u[0]) <= AT_REST] = 0.0
    udot[-1, np.abs(u[-1]) <= AT_REST] = 0.0
    return ControllerPoints(t, q, u, udot)


def _mean_accelerations(t: Array, q: Array, u: Array) -> Array:
    """Return the mean of the accelerations at both sides of each point, (K, n)."""
    accelerations = np.zeros_like(q)
    if len(t) < 2:
        return accelerations
    # Accelerations of the cubic Hermite segments at their begins and ends.
    h = np.diff(t)[:, None]
    slope = 3.0 * np.diff(q, axis=0) / h
    begin = 2.0 * (slope - 2.0 * u[:-1] - u[1:]) / h
    end = 2.0 * (u[:-1] + 2.0 * u[1:] - slope) / h
    accelerations[0] = begin[0]
    accelerations[-1] = end[-1]
    accelerations[1:-1] = 0.5 * (end[:-1] + begin[1:])
    return accelerations
