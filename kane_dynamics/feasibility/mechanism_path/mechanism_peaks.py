"""Largest shares of limits between points where quintics of driving joints move a mechanism."""

from collections.abc import Callable

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.segment_peaks import (CHANGING, Peaks, quintic, SegmentPeaks,
                                                     SMALLEST)
from kane_dynamics.motion.controller_points import ControllerPoints, Segments
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
    robot, limits, points
        As of `SegmentPeaks`; points of all joints.

    """

    def __init__(self, states: States, driving: list[int], robot: Robot, limits: Array,
                 points: ControllerPoints) -> None:
        """Compute the torques at the points."""
        self._states, self._driving, self.n = states, driving, robot.n_q
        self.factors = 1.0 / np.maximum(limits, SMALLEST)
        _, *state = points
        self.tau = states(points.q, *(each[:, driving] for each in state[1:]))[3]
        rows = [*state, self.tau]
        self.ends = [*rows, *(each[1:] for each in rows), points.t[1:] - points.t[:-1]]

    def _peaks(self, x: Array, segments: Segments | None = None) -> Peaks:
        """Return the shares at one place in all segments, or at a place in each of some."""
        every = np.arange(len(self.tau) - 1) if segments is None else segments
        places = np.broadcast_to(x, every.shape)
        blocks = [self._block(every[k:k + BLOCK], places[k:k + BLOCK])
                  for k in range(0, len(every), BLOCK)]
        return Peaks(*(np.concatenate(rows) for rows in zip(*blocks)))

    def _block(self, segments: Segments, x: Array) -> Peaks:
        """Return the shares for a part of the segments."""
        given = [each[segments] for each in self.ends]
        begin, end, h = given[:4], given[4:8], given[8]
        near, u, udot = quintic(begin, end, h[:, None], x[:, None])
        inside = self._states(near, u[:, self._driving], udot[:, self._driving])
        shares = [np.stack([tau, u, tau * u, udot], axis=1) * self.factors
                  for _, u, udot, tau in (begin, end, inside)]
        high, low = np.maximum.reduce(shares), np.minimum.reduce(shares)
        peaks, ranges = np.maximum(high, -low), high - low
        estimates = peaks + np.where(ranges > CHANGING, ranges, 0.0)
        changes = np.where(estimates > 1.0, ranges, 0.0)
        return Peaks(peaks, *(each.max(axis=(1, 2)) for each in (peaks, changes, estimates)))
