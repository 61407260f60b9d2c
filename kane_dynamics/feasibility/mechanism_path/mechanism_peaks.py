"""Largest shares of limits between points where quintics of driving joints move a mechanism."""

from collections.abc import Callable

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.segment_peaks import (BEND, CHANGING, MotionStates, Peaks,
                                                     quintic, RANGE, SegmentPeaks, SMALLEST)
from kane_dynamics.motion.controller_points import Segments
from kane_dynamics.robot.robot import Robot
import numpy as np

BLOCK = 1024  # places that are computed together, for arrays that fit the caches

States = Callable[[Array, Array, Array], tuple[Array, Array, Array, Array]]


class MechanismPeaks(SegmentPeaks):
    """
    Shares of limits between points, where quintics of the driving joints determine the motion.

    Parameters
    ----------
    states : callable
        Returns q, q', q'' and torques of all joints for nearly closed configurations, rates and
        accelerations of the driving joints.
    driving : list of int
        Indices of the driving joints.
    robot, limits
        As of `SegmentPeaks`.

    """

    def __init__(self, states: States, driving: list[int], robot: Robot, limits: Array) -> None:
        self._states, self._driving, self.n = states, driving, robot.n_q
        self.factors = 1.0 / np.maximum(limits, SMALLEST)

    def torques(self, q: Array, u: Array, udot: Array) -> Array:
        """Return the torques at points, (P, n_q)."""
        return self._states(q, u[:, self._driving], udot[:, self._driving])[3]

    def _peaks(self, states: MotionStates, x: Array, segments: Segments | None) -> Peaks:
        """Return the shares at one place in all segments, or at a place in each of some."""
        every = np.arange(len(states.h)) if segments is None else segments
        places = np.broadcast_to(x, every.shape)
        blocks = [self._block(states, every[k:k + BLOCK], places[k:k + BLOCK])
                  for k in range(0, len(every), BLOCK)]
        return Peaks(*(np.concatenate(rows) for rows in zip(*blocks)))

    def _block(self, states: MotionStates, segments: Segments, x: Array) -> Peaks:
        """Return the shares for a part of the segments."""
        *rows, h = states
        begin, end = [row[segments] for row in rows], [row[segments + 1] for row in rows]
        near, u, udot = quintic(begin, end, h[segments, None], x[:, None])
        inside = self._states(near, u[:, self._driving], udot[:, self._driving])
        shares = [np.stack([tau, u, tau * u, udot], axis=1) * self.factors
                  for _, u, udot, tau in (begin, end, inside)]
        high, low = np.maximum.reduce(shares), np.minimum.reduce(shares)
        peaks, ranges = np.maximum(high, -low), high - low
        beyond = RANGE * ranges + BEND * np.abs(shares[0] + shares[1] - 2.0 * shares[2])
        estimates = peaks + np.where(ranges > CHANGING, beyond, 0.0)
        changes = np.where(estimates > 1.0, ranges, 0.0)
        return Peaks(peaks, *(each.max(axis=(1, 2)) for each in (peaks, changes, estimates)))
