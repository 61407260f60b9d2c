"""Configurations of closed loops along a trajectory of the joints that drive them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.loop_tracking.loop_error import (CONTRADICTION, CONTRADICTORY_POINT,
                                                    LoopError)
from kane_dynamics.loop_tracking.loop_tracker import LoopTracker, STRIDE
from kane_dynamics.motion.controller_points import ControllerPoints
import numpy as np

INNER = np.arange(1.0, 8.0) / 8.0  # of a long segment: where its loops are closed


class ClosedPath:
    """
    Closed configurations along a trajectory, in the assembly mode of its start.

    `LoopTracker` closes the loops from configuration to configuration, so that none of
    them is beyond a singular one.

    Parameters
    ----------
    tracker : LoopTracker
        Its measured joints are the driving joints.
    joints : sequence of n str
        The driving joints, in the order of the trajectory.

    """

    def __init__(self, tracker: LoopTracker, joints: Sequence[str]) -> None:
        self._tracker = tracker
        self._order = list(map(list(joints).index, tracker.measured))
        self._at_rest = np.zeros(len(joints))
        self._passed: list[Array] = []  # configurations, in the order of the motion

    def begin(self, *starts: Array) -> None:
        """Begin at the first of some configurations whose loops can be closed."""
        for k, start in enumerate(starts):
            try:
                self._tracker.restart(start)
            # The last start decides: its reason is the one that the caller learns.
            except LoopError as error:
                if k + 1 == len(starts):
                    raise LoopError(error.reason, 'start of the trajectory: '
                                    f'{error.detail}') from None
            else:
                break
        self._passed = [self._tracker.q.copy()]

    def follow(self, points: ControllerPoints, others: Sequence[int], positions: Array,
               described: Callable[[float], str]) -> None:
        """
        Close the loops at the points, and in the segments in which a joint moves far.

        Parameters
        ----------
        points : ControllerPoints
            Of the driving joints; the first configuration follows from `begin`.
        others : sequence of int
            Indices of further joints of the trajectory.
        positions : (K, m) array
            Their positions at the last K points, rad or m.
        described : callable
            Returns a time of the trajectory, s, in words.

        Raises
        ------
        LoopError
            A configuration does not follow; names the time and the reason.

        """
        # Long segments are followed in steps, since loops close from the last
        # configuration.
        segments = np.arange(len(points.t) - 1)
        inner = np.zeros((len(INNER), 0, 0))
        is_long: list[bool] = []
        if len(segments):
            inner = points.inside(segments, INNER)[0]
            is_long = (np.abs(inner - points.q[:-1]).max(axis=(0, 2)) > STRIDE).tolist()
        first = len(points.t) - len(positions)  # a point before it is a measured start
        for k, t in enumerate(points.t.tolist()):
            if k and is_long[k - 1]:
                t_0 = float(points.t[k - 1])
                for x, q in zip(INNER.tolist(), inner[:, k - 1]):
                    self._move(q, described, t_0 + x * (t - t_0))
            if len(others) and k >= first:
                self._move(points.q[k], described, t, others, positions[k - first])
            else:
                self._move(points.q[k], described, t)

    def closed(self, q: Array) -> Array:
        """Return configurations, (K, n_q), of driving joints, (K, n), near the path."""
        tracker = self._tracker
        passed = np.array(self._passed)
        result = np.empty((len(q), passed.shape[1]))
        steps = np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0).tolist()
        for k, target in enumerate(q[:, self._order]):
            # Rows of distant segments may follow each other: begin at the nearest
            # configuration.
            if k == 0 or steps[k - 1] > STRIDE:
                distances = np.abs(passed[:, tracker.places] - target).sum(axis=1)
                tracker.restart(passed[int(distances.argmin())])
            tracker.update(target, self._at_rest)
            result[k] = tracker.q
        return result

    def _move(self, q: Array, described: Callable[[float], str], t: float,
              others: Sequence[int] = (), values: Array | None = None) -> None:
        """Move to the driving joints of a time and keep the configuration."""
        try:
            self._tracker.update(q[self._order], self._at_rest, others, values)
        except LoopError as error:
            reason = error.reason
            if reason == CONTRADICTION:
                reason = CONTRADICTORY_POINT
            raise LoopError(reason, f'{described(t)}: {error.detail}') from None
        self._passed.append(self._tracker.q.copy())
