"""Configurations of closed loops along a trajectory of the joints that drive them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.kinematics.driven_loops import driving_tracker
from kane_dynamics.kinematics.loop_error import (CONTRADICTION, CONTRADICTORY_POINT,
                                                 LoopError)
from kane_dynamics.kinematics.loop_kernel import STRIDE
from kane_dynamics.mechanics.constraints.conditioning import SINGULAR
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.robot.robot import Robot
import numpy as np

INNER = np.arange(1.0, 8.0) / 8.0  # fractions of a long segment at which its loops are closed


class LoopLimits(NamedTuple):
    """
    Limits of a trajectory of closed loops.

    Attributes
    ----------
    tolerance : float
        Largest deviation of further joints of the trajectory from the closed loops, rad or m.
    max_figure : float
        Largest conditioning figure, as in `LoopTracker`.

    """

    tolerance: float = 0.02
    max_figure: float = SINGULAR


class ClosedPath:
    """
    Closed configurations along a trajectory, in the assembly mode of its start.

    `LoopTracker` closes the loops from configuration to configuration, so that none of them is
    beyond a singular one.

    Parameters
    ----------
    robot : Robot
        With constraints on positions.
    joints : sequence of n str
        The driving joints, as many as independent speeds.
    limits : LoopLimits

    """

    def __init__(self, robot: Robot, joints: Sequence[str], limits: LoopLimits) -> None:
        """Check the joints."""
        self._tracker = driving_tracker(robot, joints, tolerance=limits.tolerance,
                                        max_figure=limits.max_figure)
        self._order = [list(joints).index(name) for name in self._tracker.measured]
        self._rest = np.zeros(robot.n)
        self._known: list[Array] = []

    def begin(self, *starts: Array) -> None:
        """Begin at the first of some nearly closed configurations that closes, (n_q,)."""
        for k, start in enumerate(starts):
            try:
                self._tracker.restart(start)
            except LoopError as error:
                if k + 1 == len(starts):
                    raise LoopError(error.reason, f'start of the trajectory: {error.detail}'
                                    ) from None
            else:
                break
        self._known = [self._tracker.q.copy()]

    def follow(self, points: ControllerPoints, others: Sequence[int], given: Array,
               described: Callable[[float], str]) -> None:
        """
        Close the loops at the points, and in the segments in which a joint moves far.

        Parameters
        ----------
        points : ControllerPoints
            Of the driving joints; the first configuration follows from `begin`.
        others : sequence of int
            Indices of further joints of the trajectory.
        given : (K, m) array
            Their positions at the last K points, rad or m.
        described : callable
            Returns a time of the trajectory, s, in words.

        Raises
        ------
        LoopError
            A configuration does not follow; names the time and the reason.

        """
        inner, far = np.zeros((len(INNER), 0, 0)), []
        if len(points.t) > 1:
            inner = points.inside(np.arange(len(points.t) - 1), INNER)[0]
            far = (np.abs(inner - points.q[:-1]).max(axis=(0, 2)) > STRIDE).tolist()
        first = len(points.t) - len(given)
        for k, t in enumerate(points.t.tolist()):
            if k and far[k - 1]:
                before = float(points.t[k - 1])
                for x, q in zip(INNER.tolist(), inner[:, k - 1]):
                    self._move(q, described, before + x * (t - before))
            if len(others) and k >= first:
                self._move(points.q[k], described, t, others, given[k - first])
            else:
                self._move(points.q[k], described, t)

    def closed(self, q: Array) -> Array:
        """Return the configurations, (K, n_q), of driving joints, (K, n), near those followed."""
        tracker, known = self._tracker, np.array(self._known)
        found = np.empty((len(q), known.shape[1]))
        steps = np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0).tolist()
        for k, row in enumerate(q[:, self._order]):
            if k == 0 or steps[k - 1] > STRIDE:  # rows of distant segments may follow each other
                away = np.abs(known[:, tracker.places] - row).sum(axis=1)
                tracker.restart(known[int(away.argmin())])
            tracker.update(row, self._rest)
            found[k] = tracker.q
        return found

    def _move(self, q: Array, described: Callable[[float], str], t: float,
              others: Sequence[int] = (), values: Array | None = None) -> None:
        """Move to the driving joints of a time and keep the configuration."""
        try:
            self._tracker.update(q[self._order], self._rest, others, values)
        except LoopError as error:
            raise LoopError(CONTRADICTORY_POINT if error.reason == CONTRADICTION else error.reason,
                            f'{described(t)}: {error.detail}') from None
        self._known.append(self._tracker.q.copy())
