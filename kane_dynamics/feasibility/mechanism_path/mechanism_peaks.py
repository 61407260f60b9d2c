"""Largest shares of limits between points where quintics of driving joints move a mechanism."""

from collections.abc import Callable, Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.segment_peaks import (CHANGING, Peaks, quintic, SegmentPeaks,
                                                     SMALLEST)
from kane_dynamics.motion.controller_points import ControllerPoints
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
        self.rows = [*state, states(points.q, *(each[:, driving] for each in state[1:]))[3]]
        self.durations = points.t[1:] - points.t[:-1]

    def _peaks(self, ends: Sequence[Array], x: Array) -> Peaks:
        """Return the shares for the numbers of segments, and one place in all or in each."""
        count = len(ends[-1])
        given = [*(each[:count] for each in ends), np.broadcast_to(x, (count,))]
        blocks = [self._block([each[k:k + BLOCK] for each in given])
                  for k in range(0, count, BLOCK)]
        return Peaks(*(np.concatenate(rows) for rows in zip(*blocks)))

    def _block(self, given: Sequence[Array]) -> Peaks:
        """Return the shares for a part of the segments."""
        begin, end, (h, x) = given[:4], given[4:8], given[8:]
        near, u, udot = quintic(begin, end, h[:, None], x[:, None])
        inside = self._states(near, u[:, self._driving], udot[:, self._driving])
        shares = [np.stack([tau, u, tau * u, udot], axis=1) * self.factors
                  for _, u, udot, tau in (begin, end, inside)]
        high, low = np.maximum.reduce(shares), np.minimum.reduce(shares)
        peaks, ranges = np.maximum(high, -low), high - low
        estimates = peaks + np.where(ranges > CHANGING, ranges, 0.0)
        return Peaks(peaks, *(each.max(axis=(1, 2)) for each in (peaks, ranges, estimates)))
