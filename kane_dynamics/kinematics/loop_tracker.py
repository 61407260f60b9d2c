"""
Loop closure from measured joints, cycle by cycle, in native code.

As many joints as there are degrees of freedom determine the others near a configuration. From the
last closed configuration q, Newton's method solves

    [ E ]        [ measured - E q ]
    [ J ] dq  =  [   - residual   ],

where E selects the measured joints and J has the rows of the constraints. The columns of the
inverse that belong to E are T, the rates of all joints per rate of each measured joint, which also
predict the configuration of the next cycle. The Frobenius
norm of the inverse (`conditioning.squared_figure`) grows as one over the distance from a singular
configuration; no step is longer than a part of that distance, so that no step of the solution
crosses it. What the mechanism does between two measurements is not seen; see `LoopTracker`.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

from kane_dynamics._util.checks import constant, finite_row
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.loop_error import (BRANCH, CONTRADICTION, LoopError, SINGULAR,
                                                 UNKNOWN)
from kane_dynamics.kinematics.loop_kernel import CLOSED, LEAP, ROUNDING, STRIDE, TIMED
from kane_dynamics.kinematics.loop_step import longest_step, LoopStep
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints.conditioning import ROUNDED
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

CALLS = 5  # of the kernel for one step, at most
MOST_STEPS = 1000  # from the last configuration to the measured one
FAR = 1e100  # has a finite square


class LoopTracker:
    """
    Tracks the configuration of a mechanism with closed loops by its measured joints.

    The assembly mode is kept from measurement to measurement, which is an assumption: between two
    of them the mechanism moves by little, near singular configurations by no more than about 0.05
    rad of its independent motion (not of the measured joints, which may reverse there). A singular
    configuration passed between measurements further apart is not seen, and the mode may then be
    wrong without an error; further measured joints show it. After a measurement next to a singular
    configuration, or beyond one, the mode is unknown until all joints are measured or `restart` is
    called.

    Parameters
    ----------
    robot : Robot
        With constraints.
    measured : sequence of n str
        The joints that determine the others, as many as independent speeds.
    tolerance : float
        Largest deviation of further measured joints from the closed loop, rad or m.
    max_figure : float
        Largest conditioning figure: about one over the distance from a singular configuration,
        rad or lengths of the mechanism.

    Attributes
    ----------
    q, u : (n_q,), (n,) arrays
        The last closed configuration and its independent speeds; overwritten by `update`. Zeros
        before the first.
    given : (2 n,) array
        Positions of the measured joints, rad or m, then their rates, of the last `update` and the
        next `update_given`.
    known : bool
        Whether the assembly mode is known.
    path_rows : tuple of str
        Rows of constraints on velocities: with these the measured joints determine the rates, but
        not the configuration, which depends on the path.

    Raises
    ------
    InputError
        The robot has no constraints or has ball joints, or the joints do not fit it.

    """

    def __init__(self, robot: Robot, measured: Sequence[str], *, tolerance: float = 0.02,
                 max_figure: float = 200.0) -> None:
        require_angles(robot.model, 'LoopTracker')
        equations, names = robot.equations, robot.coordinate_names
        if not isinstance(equations, ConstrainedEquations):
            raise InputError('robot: without constraints; expected closed loops')
        rows = equations.mechanism.rows(equations.mechanism.state(np.zeros(robot.n_q)))
        self.path_rows = tuple(equations.mechanism.labels[k] for k in equations.mechanism.kept
                               if rows.residual[k] is None)
        if len(set(measured)) != robot.n or not set(measured) <= set(names) or (
                len(measured) != robot.n):
            raise InputError(f'measured: {list(measured)}; expected {robot.n} of the joints '
                             f'{list(names)}, as many as degrees of freedom')
        self.robot, self.measured = robot, tuple(measured)
        self.places = [names.index(name) for name in measured]
        self._per_unit = 1.0 / equations.mechanism.units[self.places]
        self._closed = CLOSED + ROUNDED * equations.mechanism.rank_tolerance
        self._turning = np.array([name not in robot.model.sliding for name in names])
        self._timed = equations.timed
        self._step = LoopStep(robot, self.places)
        self._step.limits[0] = self._closed**2
        self.tolerance, self.max_figure = tolerance, max_figure
        self.q, self.u, self.given = self._step.q, self._step.u, self._step.given
        self._reference = None if robot.configuration is None else robot.closed_posture(
            robot.configuration)
        self._way = 0.0
        self.restart()

    @property
    def tolerance(self) -> float:
        """Largest deviation of further measured joints from the closed loop, rad or m."""
        return self._tolerance

    @tolerance.setter
    def tolerance(self, value: float) -> None:
        self._tolerance, self._step.limits[1] = value, _square(value)

    @property
    def max_figure(self) -> float:
        """Largest conditioning figure."""
        return self._max_figure

    @max_figure.setter
    def max_figure(self, value: float) -> None:
        self._max_figure, self._step.limits[2] = value, _square(value)

    @property
    def residual(self) -> float:
        """Constraint residual of the last update, accepted or not, rad or lengths (2-norm)."""
        return math.sqrt(self._step.figures[2])

    @property
    def figure(self) -> float:
        """Conditioning figure of the last update, accepted or not."""
        return math.sqrt(self._step.figures[3])

    @property
    def accepted_figure(self) -> float:
        """Conditioning figure of the last accepted configuration."""
        return math.sqrt(self._step.accepted_figure)

    @property
    def deviation(self) -> float:
        """Largest deviation of further measured joints in the last update, rad or m."""
        return math.sqrt(self._step.figures[-1])

    def restart(self, start: ArrayLike | None = None, t: float = 0.0) -> None:
        """
        Continue from a nearly closed configuration, (n_q,), at time t, s.

        The default is that of the robot, if one was given; else a first state of all joints. An
        InputError for numbers that are missing or not finite changes nothing. LoopError if the
        loops do not close nearby; the assembly mode is unknown then.
        """
        given = self._reference if start is None else finite_row(
            start, 'start', self.robot.coordinate_names)
        constant(t, (), 't', InputError)
        self.known = False
        self._why = ('no closed `configuration` of the robot or of a restart; expected one, or a '
                     'first state of all joints')
        if given is None:
            return
        self._step.rates[:], self._step.time[()] = 0.0, t
        self._step.start(given)
        self._step.target[:] = given[self.places]
        for _ in range(CALLS):
            missed, _ = self._step.evaluate()
            self._step.proceed()
            if missed <= CLOSED:
                break
        else:
            raise LoopError(BRANCH, f'start: residual {missed:.3g} rad or lengths after {CALLS} '
                            'iterations; expected a nearly closed configuration')
        self._step.accept()
        self.known = True

    @property
    def before(self) -> tuple[Array, Array]:
        """Return the last configuration, (n_q,), and its T, (n_q, n): where `update` begins."""
        return self._step.before

    def update(self, measured: Array, rates: Array, others: Sequence[int] = (),
               values: Array | None = None, t: float = 0.0) -> None:
        """
        Move `q` and `u` to a measurement; both stay valid until the next one.

        Parameters
        ----------
        measured, rates : (n,) arrays
            Positions and rates of the measured joints; rad or m, and s.
        others : sequence of int
            Indices of further measured joints.
        values : array
            Their positions, rad or m.
        t : float
            Time, s, for constraints that depend on it.

        Raises
        ------
        InputError
            A number is missing or not finite. Nothing has changed then.
        LoopError
            The configuration does not follow from the measurement. `q` and `u` are the last valid
            ones, from which the next update continues while the assembly mode is `known`.

        """
        step = self._step
        step.check(measured, rates, others, values, t)
        step.measured[:], step.rates[:] = np.array(measured), np.array(rates)
        self.update_given(others, values, t)

    def update_given(self, others: Sequence[int] = (), values: Array | None = None,
                     t: float = 0.0) -> None:
        """Move `q` and `u` as `update`, to the measurement in `given`; nothing is checked."""
        step = self._step
        step.time[()] = t
        step.compare(others, values)
        if self.known and step.follow():
            return
        others = list(others)  # a tuple would index dimensions
        if self.known:
            step.start()
        elif values is None or len({*self.places, *others}) < len(self.q):
            raise LoopError(UNKNOWN, self._why)
        else:
            whole = np.zeros_like(self.q)
            whole[self.places], whole[others] = step.measured, values
            step.start(whole)
        try:
            self._move(step.measured)
            self._compare(others, values)
        except LoopError as error:
            if error.reason == SINGULAR or (error.reason == BRANCH and self._way <= STRIDE):
                self.known = False
                self._why = ('since the loops came near a singular configuration, where it may '
                             'change; expected a state of all joints, or a restart')
            raise
        step.accept()
        self.known = True

    def _move(self, measured: Array) -> None:
        """Move from the last configuration to the measured joints, in steps if they are far."""
        for _ in range(MOST_STEPS):
            change = measured - self._step.last[self.places]
            self._way = way = max(map(abs, (change * self._per_unit).tolist()), default=0.0)
            longest = longest_step(self.figure)
            if way <= longest:
                self._step.target[:] = measured
                self._close(way)
                return
            self._step.target[:] = measured - change * (1.0 - longest / way)
            self._close(longest)
            self._step.proceed()
        raise LoopError(BRANCH, f'measured joints {dict(zip(self.measured, measured.tolist()))}, '
                        'too far from the last configuration')

    def _close(self, way: float) -> None:
        """Close the loops at the target, `way` from the last configuration; raise LoopError."""
        whole = 0.0
        for _ in range(CALLS):
            missed, moved = self._step.evaluate()
            whole += moved
            if missed <= CLOSED:
                break
            self._step.proceed()
        self._check_step(missed, whole, way)

    def _check_step(self, missed: float, moved: float, way: float) -> None:
        """Raise LoopError unless the result of a step of length `way` is valid."""
        if not self.figure <= self.max_figure:
            raise LoopError(SINGULAR, f'conditioning figure {self.figure:.3g}; expected at most '
                            f'{self.max_figure:g}')
        if not (missed <= CLOSED and self.residual <= self._closed):
            raise LoopError(BRANCH, f'residual {self.residual:.3g} rad or lengths; expected '
                            'joints for which the loops close')
        if self.known and moved > (TIMED if self._timed else
                                   LEAP * self.figure * max(way, ROUNDING)):
            raise LoopError(BRANCH, f'the joints moved by {moved:.3g} rad or lengths in one '
                            'step; expected a continuous motion')

    def _compare(self, others: Sequence[int], values: Array | None) -> None:
        """Raise LoopError if further measured joints deviate from the closed loop."""
        if values is None or not len(others):
            return
        q = self._step.reached
        away = values - q[others]
        turning = self._turning[others]
        away = np.abs(np.where(turning, np.remainder(away + math.pi, 2.0 * math.pi) - math.pi,
                               away))
        self._step.figures[-1] = _square(float(away.max()))
        if not away.max() <= self.tolerance:
            k = int(np.argmax(away))
            name = self.robot.coordinate_names[others[k]]
            raise LoopError(CONTRADICTION, f"'{name}' at {values[k]:.6g}, where the loops close "
                            f'at {q[others[k]]:.6g} rad or m; expected a deviation of at '
                            f'most {self.tolerance:g}')


def _square(x: float) -> float:
    """Return the square of a limit or deviation; of a negative limit, its negative."""
    return math.copysign(min(abs(x), FAR)**2, x)
