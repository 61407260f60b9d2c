"""
Loop closure from measured joints, cycle by cycle, in native code.

As many joints as there are degrees of freedom determine the others near a configuration.
From the last closed configuration q, Newton's method solves

    [ E ]        [ measured - E q ]
    [ J ] dq  =  [   - residual   ],

where E selects the measured joints and J has the rows of the constraints. The columns of
the inverse that belong to E are T, the rates of all joints per rate of each measured
joint, which also predict the configuration of the next cycle. The Frobenius norm of the
inverse (`conditioning.squared_figure`) grows as one over the distance from a singular
configuration; no step is longer than a part of that distance, so that no step of the
solution crosses it. What the mechanism does between two measurements is not seen; see
`LoopTracker`.

The module has three parts: the functions that are traced into kernels, `LoopStep` with
the kernels and their arrays, and `LoopTracker`, which decides what is accepted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
import math
from typing import Any, NamedTuple

from kane_dynamics._util.attribute_hints import hinting
from kane_dynamics._util.checks import (constant, finite_row, instance,
                                        names_of_joints, number)
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.loop_tracking.loop_error import (BRANCH, CONTRADICTION, LoopError,
                                                    SINGULAR, UNKNOWN)
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints.conditioning import ROUNDED, squared_figure
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

# Squares of a step, at the end of a kernel's result: the motion of all joints, the
# residual of the independent rows and of all rows, the conditioning figure at the
# prediction, the longest step of a measured joint, and the largest deviation of a
# further measured joint.
MOTION, INDEPENDENT_RESIDUAL, RESIDUAL, CONDITIONING, STEP, DEVIATION = range(6)
FIGURES = 6

CLOSED = 1e-10  # rad, or lengths of the mechanism: residual of the independent rows
STRIDE = 0.05  # rad, or lengths: longest step of a measured joint
SHARE = 0.25  # of the distance from a singular configuration: longest step
ROUNDING = 1e-6  # rad, or lengths: motion that is no jump
TIMED = 0.5  # rad, or lengths: longest motion by a function of time in one step
LEAP = 3.0  # ratio of a motion to the expected one: jump to another branch
CALLS = 5  # of the kernel for one step, at most
MOST_STEPS = 1000  # from the last configuration to the measured one
FAR = 1e100  # has a finite square


# -------------------------------------------------------------------------------------
# The functions of the kernels, over any scalar.

class LoopSystem(NamedTuple):
    """
    The equations S dq = right-hand side of a configuration, with S = [E; J].

    Attributes
    ----------
    state : MechanismState
        Speed and constraint rows at the configuration.
    S : (n_q, n_q) array
        Rows of the measured joints, then the independent rows of the constraints.
    drift : (n_q - n,) array
        Rates that the independent rows prescribe: J q' = drift.
    residual : array
        Of all rows; 0 for rows of velocities.

    """

    state: Any
    S: Matrix
    drift: Vector
    residual: Vector


def tracking_step(robot: Robot, places: Sequence[int]) -> Callable[..., Vector]:
    """
    Return the function of `tracking_kernel`, to trace.

    Parameters
    ----------
    robot : Robot
        With constraints.
    places : sequence of n int
        Indices of the measured joints.

    """
    equations: Any = robot.equations
    mechanism: Mechanism = equations.mechanism
    n_q, n = robot.n_q, robot.n
    E = np.eye(n_q)[list(places)].astype(object)
    per_unit = 1.0 / mechanism.units
    per_row_unit = 1.0 / mechanism.row_units

    def system(q: Vector, t: Scalar) -> LoopSystem:
        state = mechanism.state(q, t, equations.tree.geometry)
        rows = mechanism.rows(state)
        residual = [0.0 if x is None else x for x in rows.residual]
        S = np.concatenate([E, rows.J[mechanism.kept]])
        return LoopSystem(state, S, rows.b[mechanism.kept],
                          np.array(residual, dtype=object))

    def step(q: Vector, T: Matrix, target: Vector, rates: Vector, seen: Vector,
             weights: Vector, t: Scalar) -> Vector:
        # Predict along the tangent T, with an error of second order. Entries that vanish
        # in every configuration stay exact zeros, so that the program does not compute
        # them.
        change = target - q[places]
        structure = mechanism.solved(system(q, t).S, np.eye(n_q))[:, :n]
        tangent = with_zeros_of(structure, T)
        predicted = q + tangent @ change
        predicted[places] = target

        # One Newton step, with an error of fourth order.
        _, S, _, residual = system(predicted, t)
        inverse = mechanism.solved(S, np.eye(n_q))
        closed = predicted - inverse[:, n:] @ residual[mechanism.kept]

        # The rates of all joints, and the independent speeds u = Y q' + Z.
        reached = system(closed, t)
        qdot = mechanism.solved(reached.S, np.concatenate([rates, reached.drift]))
        Y, Z = reached.state.speed_rows(mechanism.speed_names)

        # What tells whether the step is valid, in units of the mechanism.
        motion = (closed - q) * per_unit
        residual = reached.residual * per_row_unit
        independent_residual = residual[mechanism.kept]
        figures = [motion @ motion,
                   independent_residual @ independent_residual,
                   residual @ residual,
                   squared_figure(mechanism, S, inverse),
                   largest_square(change * per_unit[places]),
                   largest_square(weights * (seen - closed))]
        return np.concatenate([closed, inverse[:, :n].ravel(), Y @ qdot + Z, figures])
    return step


def with_zeros_of(structure: Matrix, values: Matrix) -> Matrix:
    """Return `values` with exact zeros where `structure` is always zero."""
    result = np.array(values)
    for place in np.ndindex(structure.shape):
        if is_zero(structure[place]):
            result[place] = 0.0
    return result


def largest_square(values: Iterable[Scalar]) -> Scalar:
    """Return the largest square of scalars, by pairs: few comparisons in a row."""
    squares = [x * x for x in values]
    while len(squares) > 1:
        pairs = list(zip(squares[::2], squares[1::2]))
        unpaired = squares[2 * len(pairs):]
        squares = [select(a > b, a, b) for a, b in pairs] + unpaired
    return squares[0] if squares else 0.0


def valid(figures: Vector, last_figure: Scalar, limits: Vector, timed: bool) -> Scalar:
    """
    Return 1 if the result of one call is valid, else 0; NaN and infinity are not.

    Parameters
    ----------
    figures : (6,) scalars
        As of `tracking_kernel`.
    last_figure : scalar
        Square of the conditioning figure where the step begins; 0 if it is unknown.
    limits : (3,) scalars
        As of `following_kernel`.
    timed : bool
        Whether constraints depend on time.

    """
    motion, independent_residual, residual, conditioning, step, deviation = figures
    if timed:
        longest_motion = TIMED**2
    else:
        no_jump = select(step > ROUNDING**2, step, ROUNDING**2)
        longest_motion = LEAP**2 * conditioning * no_jump
    bounds = ((independent_residual, CLOSED**2),
              (residual, limits[0]),
              (deviation, limits[1]),
              (conditioning, limits[2]),
              (step, STRIDE**2),
              (step * last_figure, SHARE**2),
              (motion, longest_motion))
    result: Scalar = 1.0
    for square, bound in bounds:
        result = select(square < bound, result, 0.0)  # false for what is not a number
    return result


# -------------------------------------------------------------------------------------
# The kernels, and the arrays on which they work.

def tracking_kernel(robot: Robot, places: Sequence[int]) -> Kernel:
    """
    Return the kernel of one call: prediction, one Newton step, speeds, figures.

    Its arguments are q (n_q,) and T (n_q, n), the rates of all joints per rate of each
    measured joint, at the last configuration; positions and rates of the measured joints
    (n,); and positions of all joints, (n_q,), with the weights, 1 or 0, of their
    deviations. The result is q (n_q,), T (n_q n,) at the prediction, u (n,), and the
    `FIGURES` squares that are listed at the beginning of this module.
    """
    n_q, n = robot.n_q, robot.n
    size = n_q + n_q * n + n + FIGURES
    return robot.compiled(tracking_step(robot, places),
                          name=f'tracking_{_joined(places)}',
                          q=(n_q,), T=(n_q, n), measured=(n,), rates=(n,), seen=(n_q,),
                          weights=(n_q,), shape=(size,))


def following_kernel(robot: Robot, places: Sequence[int]) -> Kernel:
    """
    Return the kernel of one call that moves a state in place where the result is valid.

    Its arguments are the state, (n_q + n_q n + n + 1,): q, T, u and the square of the
    figure; the others of `tracking_kernel`; and the squares of the largest residual,
    deviation and figure. The result is the state, the new one if it is valid, the
    figures of the new one, and 1 if it is valid, else 0. Numbers that are not finite are
    not valid.
    """
    n_q, n = robot.n_q, robot.n
    step = tracking_step(robot, places)
    timed = robot.equations.timed
    ends = np.cumsum([n_q, n_q * n, n])

    def follow(state: Vector, target: Vector, rates: Vector, seen: Vector,
               weights: Vector, limits: Vector, t: Scalar) -> Vector:
        q, T, _, last_figure = np.split(state, ends)
        # Predict along T and correct by the closure, then judge by the figures of the
        # step.
        result = step(q, T.reshape(n_q, n), target, rates, seen, weights, t)
        figures = result[-FIGURES:]
        new_state = [*result[:-FIGURES], figures[CONDITIONING]]
        # A result that is not valid leaves the whole state as it was.
        is_valid = valid(figures, last_figure[0], limits, timed)
        accepted = [select(is_valid > 0.0, new, old)
                    for new, old in zip(new_state, state)]
        return np.array([*accepted, *figures, is_valid])
    size = int(ends[-1]) + 1
    return robot.compiled(follow, name=f'following_{_joined(places)}',
                          state=(size,), measured=(n,), rates=(n,), seen=(n_q,),
                          weights=(n_q,), limits=(3,), shape=(size + FIGURES + 1,))


def _joined(places: Sequence[int]) -> str:
    return '_'.join(map(str, places))


class LoopStep:
    """
    A step from one configuration to the next, and the last result that was accepted.

    `follow` moves that result in place, if one call of a kernel is enough. Otherwise
    `start`, `evaluate` and `proceed` move another one, call by call, until `accept`.

    Parameters
    ----------
    robot : Robot
        With constraints.
    places : sequence of n int
        Indices of the measured joints.

    Attributes
    ----------
    measurement : (2 n,) array
        Positions of the measured joints, rad or m, and their rates, rad/s or m/s:
        `measured` and `rates`.
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
        self.measurement = np.zeros(2 * n)
        self.measured = self.measurement[:n]
        self.rates = self.measurement[n:]
        self.limits = np.zeros(3)
        self.time = np.zeros(())

        # Further measured joints: positions, weights, and the indices that they are set
        # at.
        self._seen = np.zeros(n_q)
        self._weights = np.zeros(n_q)
        self._others: tuple[int, ...] = ()
        self._rows = np.zeros(0, dtype=int)
        further = [self._seen, self._weights]
        time = [self.time] if robot.equations.timed else []

        # The state of `follow`: q, T, u and the square of the figure; then figures, and
        # whether they are valid. The kernel writes where it reads.
        both = n_q + n_q * n  # q and T
        size = both + n + 1
        self._block = np.zeros(size + FIGURES + 1)
        self._state, self.figures, self._valid = np.split(self._block,
                                                          [size, size + FIGURES])
        self.q = self._state[:n_q]
        self.u = self._state[both:-1]
        inputs = [self._state, self.measured, self.rates, *further, self.limits, *time]
        self._follow = following_kernel(robot, places).bind(
            inputs, self._block, 'Follow the measured joints.')

        # `evaluate` goes from q and T in `_from` to q, T, u and figures in `_result`.
        self._from = np.zeros(both)
        self.last = self._from[:n_q]
        T = self._from[n_q:].reshape(n_q, n)
        self.target = np.zeros(n)
        self._result = np.zeros(both + n + FIGURES)
        self._next = self._result[:both]
        self._figures = self._result[-FIGURES:]
        self.reached = self._next[:n_q]
        self._evaluate = tracking_kernel(robot, places).bind(
            [self.last, T, self.target, self.rates, *further, *time], self._result,
            'Close the loops.')

    @property
    def accepted_figure(self) -> float:
        """Square of the conditioning figure of the last accepted result."""
        return float(self._state[-1])

    @property
    def accepted(self) -> tuple[Array, Array]:
        """Return copies of q, (n_q,), and T, (n_q, n), where the next step begins."""
        n_q = len(self.last)
        q, T = np.split(self._state[:len(self._from)], [n_q])
        return q.copy(), T.reshape(n_q, -1).copy()

    def follow(self) -> bool:
        """Move `q` and `u` to the measured joints by one call; return if that is valid."""
        try:
            self._follow()
        except InputError:  # not finite
            return False
        return bool(self._valid[0])

    def check(self, measured: Array, rates: Array, others: Sequence[int],
              values: Array | None, t: float) -> None:
        """Raise InputError for arguments of another shape, or that are not finite."""
        further = () if values is None else values
        n = len(self.target)
        with suppress(TypeError, ValueError):  # no numbers: named below
            x, v, y = np.asarray(measured), np.asarray(rates), np.asarray(further)
            if x.shape == v.shape == (n,) and y.shape == (len(others),):
                # One sum of all numbers, because this runs in every cycle.
                total = sum(x.tolist()) + sum(v.tolist()) + sum(y.tolist()) + t
                if math.isfinite(total):
                    return
        finite_row(measured, 'measured', self._measured)
        finite_row(rates, 'rates', self._measured)
        finite_row(further, 'values', [self._names[k] for k in others])
        constant(t, (), 't', InputError)

    def compare(self, others: Sequence[int], values: Array | None) -> None:
        """Compare the result with the positions of these joints; with none for None."""
        compared = () if values is None else tuple(others)
        if compared != self._others:
            self._others = compared
            self._rows = np.array(compared, dtype=int)
            self._weights.fill(0.0)
            self._weights[self._rows] = 1.0
        if compared:
            self._seen[self._rows] = values

    def start(self, q: Array | None = None) -> None:
        """
        Set the initial guess of `evaluate`: the last accepted result, or `q`, (n_q,).

        Afterwards `evaluate` compares no further measured joints, whose deviations may be too
        large to be squared.
        """
        self._seen.fill(0.0)
        self.figures[DEVIATION] = 0.0
        if q is None:
            self._from[:] = self._state[:len(self._from)]
            self.figures[CONDITIONING] = self._state[-1]
        else:
            self._from.fill(0.0)
            self.last[:] = q
            self.figures[CONDITIONING] = 0.0

    def evaluate(self) -> tuple[float, float]:
        """
        Make a step to `target`, and set `figures`; LoopError if it has no finite result.

        Return the residual of the independent rows and the motion, rad or lengths of the
        mechanism.
        """
        try:
            self._evaluate()
        except InputError:
            self.figures[[RESIDUAL, CONDITIONING]] = math.inf
            raise LoopError(SINGULAR, 'no finite configuration') from None
        self.figures[:DEVIATION] = self._figures[:DEVIATION]
        motion, residual = self._figures[:RESIDUAL].tolist()
        return math.sqrt(residual), math.sqrt(motion)

    def proceed(self) -> None:
        """Begin the next step at the result."""
        self._from[:] = self._next

    def accept(self) -> None:
        """Keep the result of `evaluate`."""
        self.q[:] = self.reached  # at once, for other threads
        self._state[:-1] = self._result[:-FIGURES]
        self._state[-1] = self.figures[CONDITIONING]


def longest_step(figure: float) -> float:
    """Return the longest step of a joint at a conditioning figure; 0 if unknown."""
    return min(STRIDE, SHARE / figure) if figure else STRIDE


# -------------------------------------------------------------------------------------
# What is accepted.

@hinting
class LoopTracker:
    """
    Tracks the configuration of a mechanism with closed loops by its measured joints.

    The assembly mode is kept from measurement to measurement, which is an assumption:
    between two of them the mechanism moves by little, near singular configurations by no
    more than about 0.05 rad of its independent motion (not of the measured joints, which
    may reverse there). A singular configuration passed between measurements further
    apart is not seen, and the mode may then be wrong without an error; further measured
    joints show it. After a measurement next to a singular configuration, or beyond one,
    the mode is unknown until all joints are measured or `restart` is called.

    Parameters
    ----------
    robot : Robot
        With constraints.
    measured : sequence of n str
        The joints that determine the others, as many as independent speeds.
    tolerance : float
        Largest deviation of further measured joints from the closed loop, rad or m.
    max_figure : float
        Largest conditioning figure: about one over the distance from a singular
        configuration, rad or lengths of the mechanism.

    Attributes
    ----------
    q, u : (n_q,), (n,) arrays
        The last closed configuration and its independent speeds; overwritten by
        `update`. Zeros before the first.
    measurement : (2 n,) array
        Positions of the measured joints, rad or m, then their rates, of the last
        `update` and the next `update_checked`.
    known : bool
        Whether the assembly mode is known.
    path_rows : tuple of str
        Rows of constraints on velocities: with these the measured joints determine the
        rates, but not the configuration, which depends on the path.

    Raises
    ------
    InputError
        The robot has no constraints or has ball joints, or the joints do not fit it.

    """

    def __init__(self, robot: Robot, measured: Sequence[str], *, tolerance: float = 0.02,
                 max_figure: float = 200.0) -> None:
        instance(robot, Robot, 'robot')
        require_angles(robot.model, 'LoopTracker')
        equations = robot.equations
        names = robot.coordinate_names

        # As many measured joints as degrees of freedom, and rows that determine the
        # others.
        if equations.in_joint_rates:
            raise InputError('robot: without constraints; expected closed loops')
        mechanism = equations.mechanism
        self.path_rows = _velocity_rows(mechanism, mechanism.kept)
        distinct = set(names_of_joints(measured, 'measured'))
        if not len(measured) == len(distinct) == robot.n or not distinct <= set(names):
            raise InputError(f'measured: {list(measured)}; expected {robot.n} of the '
                             f'joints {list(names)}, as many as degrees of freedom')

        # The step, its buffers and the limits of a valid result.
        self.robot = robot
        self.measured = tuple(measured)
        self.places = [names.index(name) for name in measured]
        self._per_unit = 1.0 / mechanism.units[self.places]
        self._largest_residual = CLOSED + ROUNDED * mechanism.rank_tolerance
        self._turning = np.array([name not in robot.model.sliding for name in names])
        self._timed = equations.timed
        self._step = LoopStep(robot, self.places)
        self._step.limits[0] = self._largest_residual**2
        self.tolerance = tolerance
        self.max_figure = max_figure
        self.q = self._step.q
        self.u = self._step.u
        self.measurement = self._step.measurement
        # A closed configuration to start from, if the robot has one.
        self._reference: Array | None = None
        if robot.configuration is not None:
            self._reference = robot.closed_configuration(robot.configuration)
        self._distance = 0.0  # largest of the measured joints, from the last configuration
        self.restart()

    @property
    def tolerance(self) -> float:
        """Largest deviation of further joints from the closed loop, rad or m."""
        return self._tolerance

    @tolerance.setter
    def tolerance(self, value: float) -> None:
        self._tolerance = _limit(value, 'tolerance')
        self._step.limits[1] = _square(self._tolerance)

    @property
    def max_figure(self) -> float:
        """Largest conditioning figure."""
        return self._max_figure

    @max_figure.setter
    def max_figure(self, value: float) -> None:
        self._max_figure = _limit(value, 'max_figure')
        self._step.limits[2] = _square(self._max_figure)

    @property
    def residual(self) -> float:
        """Residual of the last update, accepted or not, rad or lengths (2-norm)."""
        return math.sqrt(self._step.figures[RESIDUAL])

    @property
    def figure(self) -> float:
        """Conditioning figure of the last update, accepted or not."""
        return math.sqrt(self._step.figures[CONDITIONING])

    @property
    def accepted_figure(self) -> float:
        """Conditioning figure of the last accepted configuration."""
        return math.sqrt(self._step.accepted_figure)

    @property
    def deviation(self) -> float:
        """Largest deviation of further measured joints in the last update, rad or m."""
        return math.sqrt(self._step.figures[DEVIATION])

    @property
    def accepted(self) -> tuple[Array, Array]:
        """Last configuration, (n_q,), and its T, (n_q, n), where `update` begins."""
        return self._step.accepted

    def restart(self, start: ArrayLike | None = None, t: float = 0.0) -> None:
        """
        Continue from a nearly closed configuration, (n_q,), at time t, s.

        The default is that of the robot, if one was given; else a first state of all
        joints. An InputError for numbers that are missing or not finite changes nothing.
        LoopError if the loops do not close nearby; the assembly mode is unknown then.
        """
        nearly_closed = self._reference
        if start is not None:
            nearly_closed = finite_row(start, 'start', self.robot.coordinate_names)
        constant(t, (), 't', InputError)
        # Until a start is accepted, the configuration is unknown, with the reason.
        self.known = False
        self._why_unknown = ('no closed `configuration` of the robot or of a restart; '
                             'expected one, or a first state of all joints')
        if nearly_closed is None:
            return
        # Newton steps at constant measured joints close the loops of the start.
        self._step.rates[:] = 0.0
        self._step.time[()] = t
        self._step.start(nearly_closed)
        self._step.target[:] = nearly_closed[self.places]
        for _ in range(CALLS):
            residual, _ = self._step.evaluate()
            self._step.proceed()
            if residual <= CLOSED:
                break
        else:
            raise LoopError(BRANCH, f'start: residual {residual:.3g} rad or lengths '
                            f'after {CALLS} iterations; expected a nearly closed '
                            'configuration')
        self._step.accept()
        self.known = True

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
            The configuration does not follow from the measurement. `q` and `u` are the
            last valid ones, from which the next update continues while the assembly mode
            is `known`.

        """
        step = self._step
        step.check(measured, rates, others, values, t)
        new_rates = np.array(rates)  # a copy: both may be views of `measurement`
        step.measured[:] = np.array(measured)
        step.rates[:] = new_rates
        self.update_checked(others, values, t)

    def update_checked(self, others: Sequence[int] = (), values: Array | None = None,
                       t: float = 0.0) -> None:
        """Move `q` and `u` as `update`, to `measurement`, which is not checked."""
        step = self._step
        step.time[()] = t
        step.compare(others, values)
        # The usual case: one call of a kernel that checks the result itself.
        if self.known and step.follow():
            return
        others = list(others)  # a tuple would index dimensions
        if self.known:
            step.start()
        elif values is None or len({*self.places, *others}) < len(self.q):
            raise LoopError(UNKNOWN, self._why_unknown)
        else:
            all_joints = np.zeros_like(self.q)
            all_joints[self.places] = step.measured
            all_joints[others] = values
            step.start(all_joints)
        try:
            self._move(step.measured)
            self._compare(others, values)
        except LoopError as error:
            left_branch = error.reason == BRANCH and self._distance <= STRIDE
            if error.reason == SINGULAR or left_branch:
                self.known = False
                self._why_unknown = ('since the loops came near a singular '
                                     'configuration, where it may change; expected a '
                                     'state of all joints, or a restart')
            raise
        step.accept()
        self.known = True

    def _move(self, measured: Array) -> None:
        """Move to the measured joints, in steps if they are far."""
        for _ in range(MOST_STEPS):
            # The measured joints may be far: each step goes as far as the conditioning
            # allows.
            change = measured - self._step.last[self.places]
            steps = np.abs(change * self._per_unit)
            distance = float(steps.max(initial=0.0))
            self._distance = distance
            longest = longest_step(self.figure)
            if distance <= longest:
                self._step.target[:] = measured
                self._close(distance)
                return
            # An intermediate target on the straight line to the measured joints.
            self._step.target[:] = measured - change * (1.0 - longest / distance)
            self._close(longest)
            self._step.proceed()
        raise LoopError(BRANCH, 'measured joints '
                        f'{dict(zip(self.measured, measured.tolist()))}, too far from '
                        'the last configuration')

    def _close(self, distance: float) -> None:
        """Close the loops at the target, `distance` from the last configuration."""
        whole_motion = 0.0
        for _ in range(CALLS):
            residual, motion = self._step.evaluate()
            whole_motion += motion
            if residual <= CLOSED:
                break
            self._step.proceed()
        self._check_step(residual, whole_motion, distance)

    def _check_step(self, residual: float, motion: float, distance: float) -> None:
        """Raise LoopError unless the result of a step of this length is valid."""
        # The order is from cause to consequence: a singular state also has large
        # residuals.
        if not self.figure <= self.max_figure:
            raise LoopError(SINGULAR, f'conditioning figure {self.figure:.3g}; expected '
                            f'at most {self.max_figure:g}')
        if not (residual <= CLOSED and self.residual <= self._largest_residual):
            raise LoopError(BRANCH, f'residual {self.residual:.3g} rad or lengths; '
                            'expected joints for which the loops close')
        # Joints move by at most the conditioning figure times the measured change on one
        # branch.
        longest_motion = LEAP * self.figure * max(distance, ROUNDING)
        if self._timed:
            longest_motion = TIMED
        if self.known and motion > longest_motion:
            raise LoopError(BRANCH, f'the joints moved by {motion:.3g} rad or lengths '
                            'in one step; expected a continuous motion')

    def _compare(self, others: Sequence[int], values: Array | None) -> None:
        """Raise LoopError if further measured joints deviate from the closed loop."""
        if values is None or not len(others):
            return
        q = self._step.reached
        deviation = values - q[others]
        # Angles are equal up to whole turns.
        wrapped = np.remainder(deviation + math.pi, 2.0 * math.pi) - math.pi
        deviation = np.abs(np.where(self._turning[others], wrapped, deviation))
        self._step.figures[DEVIATION] = _square(float(deviation.max()))
        if not deviation.max() <= self.tolerance:
            k = int(np.argmax(deviation))
            name = self.robot.coordinate_names[others[k]]
            raise LoopError(CONTRADICTION, f"'{name}' at {values[k]:.6g}, where the "
                            f'loops close at {q[others[k]]:.6g} rad or m; expected a '
                            f'deviation of at most {self.tolerance:g}')


def velocity_rows(robot: Robot) -> tuple[str, ...]:
    """Return the rows of velocity constraints; positions then depend on the path."""
    mechanism = robot.mechanism
    return _velocity_rows(mechanism, range(len(mechanism.labels)))


def _velocity_rows(mechanism: Mechanism, rows: Iterable[int]) -> tuple[str, ...]:
    """Return those of some rows whose constraints have no residual of positions."""
    at_zero = mechanism.rows(mechanism.state(np.zeros(len(mechanism.units))))
    return tuple(mechanism.labels[k] for k in rows if at_zero.residual[k] is None)


def _limit(value: float, what: str) -> float:
    """Return a limit, a negative one of which refuses everything; InputError for no number."""
    return number(value, what, 'a number', lambda x: not math.isnan(x))


def _square(x: float) -> float:
    """Return the square of a limit or deviation; of a negative limit, its negative."""
    return math.copysign(min(abs(x), FAR)**2, x)
