"""The kernels of `LoopTracker` with their arrays."""

from collections.abc import Sequence
import math

from kane_dynamics._util.checks import constant, finite_row
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.loop_error import LoopError, SINGULAR
from kane_dynamics.kinematics.loop_kernel import (FIGURES, following_kernel, SHARE, STRIDE,
                                                  tracking_kernel)
from kane_dynamics.robot.robot import Robot
import numpy as np


class LoopStep:
    """
    A step from one configuration to the next, and the last result that was accepted.

    `follow` moves that result in place, if one call of a kernel is enough. Otherwise `start`,
    `evaluate` and `proceed` move another one, call by call, until `accept`.

    Parameters
    ----------
    robot : Robot
        With constraints.
    places : sequence of n int
        Indices of the measured joints.

    Attributes
    ----------
    given : (2 n,) array
        Positions of the measured joints, rad or m, and their rates, rad/s or m/s: `measured` and
        `rates`.
    limits : (3,) array
        Squares of the largest residual, deviation and figure of `follow`.
    time : () array
        Time, s.
    q, u : (n_q,), (n,) arrays
        The last result that was accepted.
    last : (n_q,) array
        The configuration from which `evaluate` begins.
    target : (n,) array
        Positions of the measured joints for `evaluate`.
    reached : (n_q,) array
        The result of `evaluate`.
    figures : (6,) array
        Of the last result, accepted or not: as of `tracking_kernel`.

    """

    def __init__(self, robot: Robot, places: Sequence[int]) -> None:
        n_q, n = robot.n_q, robot.n
        self._names = robot.coordinate_names
        self._measured = [self._names[k] for k in places]
        both = n_q + n_q * n
        self.given, self.limits, self.time = np.zeros(2 * n), np.zeros(3), np.zeros(())
        self.measured, self.rates = self.given[:n], self.given[n:]
        self._seen, self._weights = np.zeros(n_q), np.zeros(n_q)
        self._others: tuple[int, ...] = ()
        self._rows = np.zeros(0, dtype=int)
        self._block = np.zeros(both + n + 1 + FIGURES + 1)
        self._state, self.figures, self._valid = np.split(
            self._block, [both + n + 1, len(self._block) - 1])
        self.q, self.u = self._state[:n_q], self._state[both:-1]
        more = [self._seen, self._weights]
        time = [self.time] * robot.equations.timed
        self._follow = following_kernel(robot, places).bind(
            [self._state, self.measured, self.rates, *more, self.limits, *time], self._block,
            'Follow the measured joints.')
        self._from = np.zeros(both)  # q and T
        self.last, T = self._from[:n_q], self._from[n_q:].reshape(n_q, n)
        self.target, self._result = np.zeros(n), np.zeros(both + n + FIGURES)
        self._next, self._figures = self._result[:both], self._result[-FIGURES:]
        self.reached = self._next[:n_q]
        self._call = tracking_kernel(robot, places).bind(
            [self.last, T, self.target, self.rates, *more, *time], self._result,
            'Close the loops.')

    @property
    def accepted_figure(self) -> float:
        """Square of the conditioning figure of the last accepted result."""
        return float(self._state[-1])

    def follow(self) -> bool:
        """Move `q` and `u` to the measured joints by one call; return whether that is valid."""
        try:
            self._follow()
        except InputError:  # not finite
            return False
        return bool(self._valid[0])

    def check(self, measured: Array, rates: Array, others: Sequence[int], values: Array | None,
              t: float) -> None:
        """Raise InputError for arguments of another shape, or that are not finite."""
        x, v, y = np.asarray(measured), np.asarray(rates), np.asarray(
            () if values is None else values)
        if x.shape == v.shape == self.target.shape and y.shape == (len(others),) and (
                math.isfinite(sum(x.tolist()) + sum(v.tolist()) + sum(y.tolist()) + t)):
            return
        finite_row(x, 'measured', self._measured)
        finite_row(v, 'rates', self._measured)
        finite_row(y, 'values', [self._names[k] for k in others])
        constant(t, (), 't', InputError)

    def compare(self, others: Sequence[int], values: Array | None) -> None:
        """Compare the result with the positions of these joints; with none for None."""
        compared = () if values is None else tuple(others)
        if compared != self._others:
            self._others, self._rows = compared, np.array(compared, dtype=int)
            self._weights.fill(0.0)
            self._weights[self._rows] = 1.0
        if compared:
            self._seen[self._rows] = values

    def evaluate(self) -> list[float]:
        """
        Make a step to `target`, and set `figures`; LoopError if it has no finite result.

        Return the residual of the independent rows, the motion, rad or lengths, and lengths of the
        mechanism or rad.
        """
        try:
            self._call()
        except InputError:
            self.figures[2:4] = math.inf
            raise LoopError(SINGULAR, 'no finite configuration') from None
        self.figures[:-1] = self._figures[:-1]
        moved, missed = map(math.sqrt, self._figures[:2].tolist())
        return [missed, moved]

    def proceed(self) -> None:
        """Begin the next step at the result."""
        self._from[:] = self._next

    def start(self, q: Array | None = None) -> None:
        """
        Let `evaluate` begin at the last accepted result, or at a configuration, (n_q,).

        `evaluate` does not compare further joints, whose deviations may have no finite square.
        """
        self._seen.fill(0.0)
        self.figures[-1] = 0.0
        if q is None:
            self._from[:] = self._state[:len(self._from)]
            self.figures[3] = self._state[-1]
        else:
            self._from.fill(0.0)
            self.last[:], self.figures[3] = q, 0.0

    def accept(self) -> None:
        """Keep the result of `evaluate`."""
        self.q[:] = self.reached  # at once, for other threads
        self._state[:-1] = self._result[:-FIGURES]
        self._state[-1] = self.figures[3]

    @property
    def before(self) -> tuple[Array, Array]:
        """Return copies of q, (n_q,), and T, (n_q, n), with which the next step begins."""
        n_q = len(self.last)
        q, T = np.split(self._state[:len(self._from)], [n_q])
        return q.copy(), T.reshape(n_q, -1).copy()


def longest_step(figure: float) -> float:
    """Return the longest step of a measured joint at a conditioning figure; 0 if unknown."""
    return min(STRIDE, SHARE / figure) if figure else STRIDE
