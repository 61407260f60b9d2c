"""One call of the tracking kernel, with its arrays."""

from collections.abc import Sequence
import math

from kane_dynamics._util.checks import constant, finite_row
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.loop_error import LoopError, SINGULAR
from kane_dynamics.kinematics.loop_kernel import FIGURES, tracking_kernel
from kane_dynamics.robot.robot import Robot
import numpy as np

STRIDE = 0.05  # rad, or lengths: longest step of a measured joint
FAR = 1e100  # rad or m: more has no finite square
SHARE = 0.25  # of the distance from a singular configuration: longest step of a measured joint


class LoopStep:
    """
    A step from one configuration to the next, and the last result that was accepted.

    Parameters
    ----------
    robot : Robot
        With constraints.
    places : sequence of n int
        Indices of the measured joints.

    Attributes
    ----------
    last : (n_q,) array
        The configuration from which the step begins.
    target, rates : (n,) arrays
        Positions and rates of the measured joints; rad or m, and s.
    time : () array
        Time, s.
    q, u : (n_q,), (n,) arrays
        The result.
    figure, residual : float
        Conditioning figure and largest constraint residual of the result, m or rad.

    """

    def __init__(self, robot: Robot, places: Sequence[int]) -> None:
        n_q, n = robot.n_q, robot.n
        self._names = robot.coordinate_names
        self._measured = [self._names[k] for k in places]
        both = n_q + n_q * n
        self._from = np.zeros(both)  # q and T
        self.last, T = self._from[:n_q], self._from[n_q:].reshape(n_q, n)
        self.target, self.rates, self.time = np.zeros(n), np.zeros(n), np.zeros(())
        self._seen, self._weights = np.zeros(n_q), np.zeros(n_q)
        self._others: tuple[int, ...] = ()
        self._rows = np.zeros(0, dtype=int)
        self._result = np.zeros(both + n + FIGURES)
        self._accepted = np.zeros_like(self._result)
        self._next, self.u, self._figures = np.split(self._result, [both, both + n])
        self.q = self._next[:n_q]
        self.figure = self.residual = 0.0
        given = [self.last, T, self.target, self.rates, self._seen, self._weights]
        given += [self.time] * robot.equations.timed
        self._call = tracking_kernel(robot, places).bind(given, self._result, 'Close the loops.')

    def begin(self, rates: Array | float, t: float) -> None:
        """Use these rates, rad/s or m/s, and this time, s."""
        self.rates[:], self.time[...] = rates, t

    def check(self, measured: Array, rates: Array, others: Sequence[int], values: Array | None,
              t: float) -> None:
        """Raise InputError for arguments of another shape, or that are not finite."""
        x, v, y = np.asarray(measured), np.asarray(rates), np.asarray(
            () if values is None else values)
        if x.shape == v.shape == (len(self.target),) and y.shape == (len(others),) and (
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
        if values is not None:
            self._seen[self._rows] = np.clip(values, -FAR, FAR)

    def evaluate(self) -> list[float]:
        """
        Make the step, and set `figure` and `residual`; LoopError if it has no finite result.

        Return the residual of the independent rows, the motion, the longest step of a measured
        joint (all in m or rad, the two last in lengths of the mechanism or rad), and the largest
        deviation of the compared joints.
        """
        try:
            self._call()
        except InputError:
            self.figure = self.residual = math.inf
            raise LoopError(SINGULAR, 'no finite configuration') from None
        moved, missed, self.residual, self.figure, way, deviation = map(
            math.sqrt, self._figures.tolist())
        return [missed, moved, way, deviation]

    def proceed(self) -> None:
        """Begin the next step at the result."""
        self._from[:] = self._next

    def start(self, q: Array) -> None:
        """Begin the next step at a configuration, without prediction."""
        self._from.fill(0.0)
        self.last[:] = q

    def accept(self) -> None:
        """Begin the next step at the result, and keep it."""
        self._from[:], self._accepted[:] = self._next, self._result

    def restore(self) -> None:
        """Return to the last result that was accepted."""
        self._result[:] = self._accepted
        self._from[:] = self._next

    @property
    def before(self) -> tuple[Array, Array]:
        """Return copies of `last`, (n_q,), and T, (n_q, n), with which the step begins."""
        q, T = np.split(self._from, [len(self.last)])
        return q.copy(), T.reshape(len(q), -1).copy()


def longest_step(figure: float) -> float:
    """Return the longest step of a measured joint at a conditioning figure; 0 if unknown."""
    return min(STRIDE, SHARE / figure) if figure else STRIDE
