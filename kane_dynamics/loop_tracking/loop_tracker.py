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

Where one call of the kernel does not reach the measurement, a search goes there in steps,
call by call; `SearchRules` decides after each call what follows. The torque path of the
node calls the same rules without the interpreter.

The module has four parts: the step, the rules of a search, `LoopStep` with the kernels
and their arrays, and `LoopTracker`, which raises the errors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import lru_cache
import math
from typing import Any, NamedTuple

from kane_dynamics._util.checks import (constant, finite_row, instance,
                                        names_of_joints, number)
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.loop_tracking.loop_error import (BRANCH, CONTRADICTION, LoopError,
                                                    SINGULAR, UNKNOWN)
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.flags import branch, either, finite, flag, packed
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.ball_joints import neutral, require_angles
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
LARGEST_ANGLE = 1e6  # rad: a larger deviation counts as one, whatever its whole turns

# Outcomes of a search, and the reason of each.
(REACHED, NOT_FINITE, ILL_CONDITIONED, OPEN, LEAPT, TOO_FAR, DEVIATING,
 UNKNOWN_MODE) = range(8)
REASONS = ('', SINGULAR, SINGULAR, BRANCH, BRANCH, BRANCH, CONTRADICTION, UNKNOWN)


SINCE_SINGULAR = ('since the loops came near a singular configuration, where it may '
                  'change; expected a state of all joints, or a restart')


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
    per_row_unit = 1.0 / mechanism.closure_units

    def system(q: Vector, t: Scalar) -> LoopSystem:
        state = mechanism.state(q, t, equations.tree.geometry)
        rows = mechanism.rows(state)
        S = np.concatenate([E, rows.J[mechanism.kept]])
        return LoopSystem(state, S, rows.b[mechanism.kept], rows.residual_or_zero)

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

        # What tells whether the step is valid: motion in units of the mechanism, residuals
        # in lengths of their own loops.
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
        # The larger of each pair; one without a partner stays.
        larger = []
        for a, b in zip(squares[::2], squares[1::2]):
            larger.append(select(a > b, a, b))
        if len(squares) % 2:
            larger.append(squares[-1])
        squares = larger
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
    # All figures are squares, so that no roots are needed.
    motion, independent_residual, residual, conditioning, step, deviation = figures
    if timed:
        longest_motion = TIMED**2
    else:
        no_jump = select(step > ROUNDING**2, step, ROUNDING**2)
        longest_motion = LEAP**2 * conditioning * no_jump
    # Each figure and its bound, all of which must hold.
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
# The rules of a search, over any scalar.

class MeasuredJoints(NamedTuple):
    """
    Measured joints.

    Attributes
    ----------
    positions, rates : (n,) arrays
        Of the joints that determine the others.
    seen, weights : (n_q,) arrays
        Positions of further joints, and 1 for each that is measured, else 0.

    """

    positions: Vector
    rates: Vector
    seen: Vector
    weights: Vector


class LoopSearch(NamedTuple):
    """
    The last accepted configuration, and the search for the next one.

    Attributes
    ----------
    q, T, u : (n_q,), (n_q n,), (n,) arrays
        The last accepted result; T are rates of all joints per rate of each measured
        one.
    figure : Scalar
        Its squared conditioning figure; 0 if it is unknown.
    figures : (6,) array
        Of the last call, accepted or not: as of `tracking_kernel`.
    followed : Scalar
        Whether `following_kernel` accepted its result.
    known : Scalar
        Whether the assembly mode is known.
    searching : Scalar
        Whether the search needs further calls.
    outcome : Scalar
        `REACHED`, or why the measurement is refused.
    last, last_T : (n_q,), (n_q n,) arrays
        Where the next call begins; of a refused search, where it ended.
    target : (n,) array
        Positions of the measured joints for the next call.
    length, distance : Scalar
        Of the step, and from its begin to the measurement, rad or lengths.
    motion : Scalar
        Sum of the motions in the calls of the step.
    calls, steps : Scalar
        Calls of the step, and steps before it.

    """

    q: Vector
    T: Vector
    u: Vector
    figure: Scalar
    figures: Vector
    followed: Scalar
    known: Scalar
    searching: Scalar
    outcome: Scalar
    last: Vector
    last_T: Vector
    target: Vector
    length: Scalar
    distance: Scalar
    motion: Scalar
    calls: Scalar
    steps: Scalar


@lru_cache
def search_places(n_q: int, n: int) -> LoopSearch:
    """Return where each field of a `LoopSearch` is in its array: an index, or a slice."""
    # Fields that are numbers have one entry; the others are arrays.
    lengths = {'q': n_q, 'T': n_q * n, 'u': n, 'figures': FIGURES, 'last': n_q,
               'last_T': n_q * n, 'target': n}
    places: list[Any] = []
    start = 0
    for name in LoopSearch._fields:
        if name in lengths:
            places.append(slice(start, start + lengths[name]))
        else:
            places.append(start)
        start += lengths.get(name, 1)
    return LoopSearch(*places)


def search_size(n_q: int, n: int) -> int:
    """Return the number of entries of a `LoopSearch` as an array."""
    return int(search_places(n_q, n).steps) + 1


def unpacked_search(array: Vector, n_q: int, n: int) -> LoopSearch:
    """Return the `LoopSearch` of an array."""
    return LoopSearch(*[array[place] for place in search_places(n_q, n)])


class SearchRules:
    """
    The rules of a search for the configuration of a measurement.

    Parameters
    ----------
    robot : Robot
        With constraints.
    places : sequence of n int
        Indices of the measured joints.

    """

    def __init__(self, robot: Robot, places: Sequence[int]) -> None:
        mechanism = robot.mechanism
        names = robot.coordinate_names
        self.n_q = robot.n_q
        self.n = robot.n
        self._step = tracking_step(robot, list(places))
        self._places = list(places)
        self._per_unit = 1.0 / mechanism.units[self._places]
        self._turning = [name not in robot.model.sliding for name in names]
        self._timed = robot.equations.timed

    def begun(self, search: LoopSearch, measured: MeasuredJoints, limits: Vector,
              t: Scalar) -> LoopSearch:
        """
        Return the search after its first call, which usually reaches the measurement.

        Otherwise it begins at the last configuration; where the assembly mode is
        unknown, at the measurement, if that is of all joints.
        """
        T = search.T.reshape(self.n_q, self.n)
        result = self._step(search.q, T, *measured, t)
        follows = search.known * valid(result[-FIGURES:], search.figure, limits,
                                       self._timed)
        followed = self._accepted(search, result, result[-FIGURES:])

        # Else the search sets out from the last configuration, or from all joints if
        # none is known.
        all_joints = np.array(measured.seen, dtype=object)
        all_joints[self._places] = measured.positions
        last = either(search.known, search.q, all_joints)
        last_T = either(search.known, search.T, 0.0 * search.T)
        figures = np.array([0.0] * FIGURES, dtype=object)
        figures[CONDITIONING] = either(search.known, search.figure, 0.0)
        begun = self._towards(search._replace(
            last=last, last_T=last_T, figures=figures, steps=0.0), measured.positions)

        is_complete = flag(self.n_q - self.n - 0.5 < sum(measured.weights))
        can_begin = either(search.known, 1.0, is_complete)
        refused = search._replace(outcome=float(UNKNOWN_MODE), searching=0.0)
        searching = branch(can_begin, begun, refused)
        return branch(follows, followed, searching)

    def continued(self, search: LoopSearch, measured: MeasuredJoints, limits: Vector,
                  t: Scalar) -> LoopSearch:
        """Return the search after one more call."""
        nothing = np.zeros(self.n_q)
        T = search.last_T.reshape(self.n_q, self.n)
        result = self._step(search.last, T, search.target, measured.rates, nothing,
                            nothing, t)
        q, last_T = result[:self.n_q], result[self.n_q:self.n_q * (self.n + 1)]
        figures = result[-FIGURES:]
        is_finite = finite(result)
        motion = search.motion + np.sqrt(figures[MOTION])
        arrives = 1.0 - flag(search.length < search.distance)
        deviation = self._deviation(q, measured)
        compared = np.array([*figures[:DEVIATION], arrives * deviation])
        called = search._replace(last=q, last_T=last_T, figures=compared, motion=motion,
                                 calls=search.calls + 1.0)

        # Newton's method goes on until the loops are closed.
        is_closed = flag(figures[INDEPENDENT_RESIDUAL] < CLOSED**2)
        iterates = (1.0 - is_closed) * flag(called.calls < CALLS - 0.5)

        # What is wrong with the step: from consequence to cause, because a singular state
        # also has large residuals.
        outcome = self._outcome_of_arrival(called, arrives, deviation, limits[1],
                                           sum(measured.weights))
        leaps = search.known * flag(self._longest_motion(search, figures) < motion)
        outcome = either(leaps, float(LEAPT), outcome)
        fits = is_closed * flag(figures[RESIDUAL] < limits[0])
        outcome = either(fits, outcome, float(OPEN))
        is_regular = flag(figures[CONDITIONING] < limits[2])
        outcome = either(is_regular, outcome, float(ILL_CONDITIONED))
        is_valid = flag(outcome < 0.5)

        onward = self._towards(called._replace(steps=search.steps + 1.0),
                               measured.positions)
        reached = branch(arrives, self._accepted(called, result, compared), onward)
        stepped = branch(is_valid, reached, _refused(called, outcome))
        after = branch(iterates, called, stepped)
        far = np.array([*search.figures], dtype=object)
        far[[RESIDUAL, CONDITIONING]] = FAR**2
        without_result = _refused(search._replace(figures=far), float(NOT_FINITE))
        return branch(is_finite, after, without_result)

    def _accepted(self, search: LoopSearch, result: Vector, figures: Vector
                  ) -> LoopSearch:
        """Return the search that has reached its end with a result."""
        q, T, u, _ = np.split(result, np.cumsum([self.n_q, self.n_q * self.n, self.n]))
        return search._replace(q=q, T=T, u=u, figure=figures[CONDITIONING],
                               figures=figures, known=1.0, searching=0.0,
                               outcome=float(REACHED))

    def _towards(self, search: LoopSearch, positions: Vector) -> LoopSearch:
        """Return the search with its next step towards the measurement."""
        change = positions - search.last[self._places]
        distance_2 = largest_square(change * self._per_unit)
        distance = np.sqrt(select(distance_2 < FAR**2, distance_2, FAR**2))
        figure_2 = search.figures[CONDITIONING]
        # The longest step is a share of the distance to a singularity, which the figure
        # measures.
        is_known = flag(figure_2 > 0.0)
        figure = np.sqrt(either(is_known, figure_2, 1.0))
        of_distance = select(SHARE / figure < STRIDE, SHARE / figure, STRIDE)
        longest = either(is_known, of_distance, STRIDE)
        arrives = flag(distance < longest)
        share = either(arrives, 1.0, longest / either(arrives, 1.0, distance))
        return search._replace(target=positions - change * (1.0 - share),
                               length=either(arrives, distance, longest),
                               distance=distance, motion=0.0, calls=0.0, searching=1.0)

    def _longest_motion(self, search: LoopSearch, figures: Vector) -> Scalar:
        """Return the longest motion of all joints in a step without a leap."""
        if self._timed:
            return TIMED
        # On one branch the joints move by at most the figure times the measured change.
        length = select(search.length < ROUNDING, ROUNDING, search.length)
        return LEAP * np.sqrt(figures[CONDITIONING]) * length

    def _outcome_of_arrival(self, search: LoopSearch, arrives: Scalar, deviation: Scalar,
                            largest: Scalar, compared: Scalar) -> Scalar:
        """Return whether the further joints agree at the end, or whether it is too far."""
        agrees = either(flag(compared < 0.5), 1.0, flag(deviation < largest))
        at_end = either(agrees, float(REACHED), float(DEVIATING))
        may_go_on = flag(search.steps < MOST_STEPS - 1.5)
        before = either(may_go_on, float(REACHED), float(TOO_FAR))
        return either(arrives, at_end, before)

    def _deviation(self, q: Vector, measured: MeasuredJoints) -> Scalar:
        """Return the largest squared deviation of further joints, up to whole turns."""
        deviations = []
        for j in range(self.n_q):
            x = measured.seen[j] - q[j]
            if self._turning[j]:
                x = either(flag(x * x < LARGEST_ANGLE**2), _wrapped(x), FAR)
            deviations.append(measured.weights[j] * x)
        largest = largest_square(deviations)
        return select(largest < FAR**2, largest, FAR**2)


def _wrapped(angle: Scalar) -> Scalar:
    """Return an angle without whole turns, by the tangent of its half."""
    x = 1.0 + np.cos(angle)
    is_half_turn = flag(x < ROUNDING**2)
    half = np.arctan(np.sin(angle) / either(is_half_turn, 1.0, x))
    return either(is_half_turn, math.pi, 2.0 * half)


def _refused(search: LoopSearch, outcome: Scalar) -> LoopSearch:
    """Return the search that ends without a configuration."""
    is_singular = flag(outcome < ILL_CONDITIONED + 0.5)
    is_near = flag(outcome < TOO_FAR + 0.5) * flag(search.distance < STRIDE)
    loses = either(is_singular, 1.0, is_near)
    return search._replace(outcome=outcome, searching=0.0,
                           known=search.known * (1.0 - loses))


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


def search_kernels(robot: Robot, places: Sequence[int]) -> tuple[Kernel, Kernel]:
    """
    Return the kernels of `SearchRules.begun` and `continued`.

    Their arguments are the search as an array; positions and rates of the measured
    joints, (n,); positions of all joints with their weights, (n_q,); and the squares of
    the largest residual, deviation and figure.
    """
    n_q, n = robot.n_q, robot.n
    rules = SearchRules(robot, places)

    # Both rules have the same inputs; searches are arrays in native code.
    def kernel_of(rule: Callable[..., LoopSearch], name: str) -> Kernel:
        def called(search: Vector, positions: Vector, rates: Vector, seen: Vector,
                   weights: Vector, limits: Vector, t: Scalar) -> Vector:
            measured = MeasuredJoints(positions, rates, seen, weights)
            return packed(rule(unpacked_search(search, n_q, n), measured, limits, t))
        size = search_size(n_q, n)
        return robot.compiled(called, name=f'{name}_{_joined(places)}', search=(size,),
                              positions=(n,), rates=(n,), seen=(n_q,), weights=(n_q,),
                              limits=(3,), shape=(size,))
    return (kernel_of(rules.begun, 'search_begun'),
            kernel_of(rules.continued, 'search_continued'))


def _joined(places: Sequence[int]) -> str:
    return '_'.join(map(str, places))


class LoopStep:
    """
    The kernels of a tracker, and the array of its `LoopSearch`, which they move in place.

    `follow` is enough where one call reaches the measurement; otherwise `search`.

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
        Squares of the largest residual, deviation and figure.
    time : () array
        Time, s.
    array : array
        Of the search.
    search : LoopSearch
        Views of the array; an index stands for each scalar.

    """

    def __init__(self, robot: Robot, places: Sequence[int]) -> None:
        n_q, n = robot.n_q, robot.n
        self._robot = robot
        self._places = list(places)
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
        time = robot.equations.time_inputs(self.time)
        self._inputs = [self.measured, self.rates, *further, self.limits, *time]

        # The search begins with what `follow` reads and writes: q, T, u and the square
        # of the figure; then figures, and whether they are valid.
        self.array = np.zeros(search_size(n_q, n))
        self._at = search_places(n_q, n)
        self.search = LoopSearch(*[self.array[place] for place in self._at])
        self.q = self.search.q
        self.u = self.search.u
        self.figures = self.search.figures
        state = self.array[:self._at.figure + 1]
        result = self.array[:self._at.followed + 1]
        self._valid = self.array[self._at.followed:self._at.followed + 1]
        self._follow = following_kernel(robot, places).bind(
            [state, *self._inputs], result, 'Follow the measured joints.')

    @lazy_property
    def _search(self) -> tuple[Callable[[], Any], Callable[[], Any]]:
        """Return the first and the further calls of a search, which are rarely needed."""
        inputs = [self.array, *self._inputs]
        begin, go_on = search_kernels(self._robot, self._places)
        return (begin.bind(inputs, self.array, 'Begin a search.'),
                go_on.bind(inputs, self.array, 'Continue a search.'))

    @property
    def accepted_figure(self) -> float:
        """Square of the conditioning figure of the last accepted result."""
        return float(self.array[self._at.figure])

    @property
    def accepted(self) -> tuple[Array, Array]:
        """Return copies of q, (n_q,), and T, (n_q, n), where the next step begins."""
        return self.q.copy(), self.search.T.reshape(len(self.q), -1).copy()

    def follow(self) -> bool:
        """Move `q` and `u` to the measured joints by one call; return if that is valid."""
        try:
            self._follow()
        except InputError:  # not finite
            return False
        return bool(self._valid[0])

    def search_from(self, known: bool) -> tuple[int, bool]:
        """
        Search the configuration of the measurement, whether the mode is known or not.

        Return the outcome, and whether the mode is known then.
        """
        begin, _ = self._search
        self.figures.fill(0.0)  # those of `follow` may be infinite
        self.array[self._at.known] = known
        begin()
        return self._searched()

    def restart_at(self, q: Array) -> tuple[int, bool]:
        """Search the configuration near another one, as `search_from`, without limits."""
        # A restart compares nothing and has no limits; those of the caller come back,
        # whatever the outcome.
        measurement = self.measurement.copy()
        seen = self._seen.copy()
        weights = self._weights.copy()
        limits = self.limits.copy()
        self.rates[:] = 0.0
        self.measured[:] = q[self._places]
        # Those of a refused state need not be finite.
        self._seen[:] = q
        self._weights.fill(0.0)
        self.limits.fill(FAR**2)
        # What a search accepted survives in its array; all else is cleared.
        accepted = np.concatenate([self.q, self.search.T, self.u, [self.accepted_figure]])
        self.array.fill(0.0)
        self.array[:len(accepted)] = accepted
        self.search.last[:] = q
        self.search.target[:] = self.measured
        self.array[self._at.searching] = 1.0
        try:
            return self._searched()
        finally:
            self.measurement[:] = measurement
            self._seen[:] = seen
            self._weights[:] = weights
            self.limits[:] = limits

    def _searched(self) -> tuple[int, bool]:
        """Call until the search has ended."""
        _, go_on = self._search
        while self.array[self._at.searching]:
            go_on()
        return int(self.array[self._at.outcome]), bool(self.array[self._at.known])

    def check(self, measured: Array, rates: Array, others: Sequence[int],
              values: Array | None, t: float) -> None:
        """Raise InputError for arguments of another shape, or that are not finite."""
        further = () if values is None else values
        n = len(self.measured)
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

    @property
    def motion(self) -> float:
        """Motion of all joints in the last step of the search, rad or lengths."""
        return float(self.array[self._at.motion])

    def seen_at(self, k: int) -> float:
        """Return the measured position of a further joint."""
        return float(self._seen[k])

    def most_deviating(self, turning: Array) -> int:
        """Return the further joint that deviates most where the search ended."""
        deviation = self._seen - self.search.last
        # Angles are equal up to whole turns.
        wrapped = np.remainder(deviation + math.pi, 2.0 * math.pi) - math.pi
        deviation = np.abs(np.where(turning, wrapped, deviation))
        return int(np.argmax(self._weights * deviation))

    def compare(self, others: Sequence[int], values: Array | None) -> None:
        """Compare the result with the positions of further joints, if there are any."""
        compared = () if values is None else tuple(others)
        if compared != self._others:
            self._others = compared
            self._rows = np.array(compared, dtype=int)
            self._seen.fill(0.0)  # others, of a refused state, need not be finite
            self._weights.fill(0.0)
            self._weights[self._rows] = 1.0
        if compared:
            self._seen[self._rows] = values


# -------------------------------------------------------------------------------------
# What is accepted.

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
        self.path_rows = path_rows(robot)
        distinct = set(names_of_joints(measured, 'measured'))
        if not len(measured) == len(distinct) == robot.n or not distinct <= set(names):
            raise InputError(f'measured: {list(measured)}; expected {robot.n} of the '
                             f'joints {list(names)}, as many as degrees of freedom')

        # The step, its buffers and the limits of a valid result.
        self.robot = robot
        self.measured = tuple(measured)
        self.places = list(map(names.index, measured))
        self._turning = np.array([name not in robot.model.sliding for name in names])
        self._step = LoopStep(robot, self.places)
        self._step.limits[0] = (CLOSED + ROUNDED * mechanism.rank_tolerance)**2
        self.tolerance = tolerance
        self.max_figure = max_figure
        self.q = self._step.q
        self.u = self._step.u
        self.measurement = self._step.measurement
        # A closed configuration to start from, if the robot has one.
        self._reference: Array | None = None
        if robot.configuration is not None:
            self._reference = robot.closed_configuration(robot.configuration)
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
    def _independent_residual(self) -> float:
        """Residual of the independent rows in the last update, rad or lengths."""
        return math.sqrt(self._step.figures[INDEPENDENT_RESIDUAL])

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
        self._step.time[()] = t
        # The start need not be closed to rounding: a few iterations close it.
        outcome, self.known = self._step.restart_at(np.asarray(nearly_closed))
        if outcome == NOT_FINITE:
            raise self._error(outcome)
        if outcome != REACHED:
            raise LoopError(BRANCH, f'start: residual {self._independent_residual:.3g} '
                            f'rad or lengths after {CALLS} iterations; expected a nearly '
                            'closed configuration')

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
        # Otherwise a search in steps, which also finds why a measurement is refused.
        was_known = self.known
        outcome, self.known = step.search_from(was_known)
        if outcome == REACHED:
            return
        error = self._error(outcome)
        if was_known and not self.known:
            self._why_unknown = SINCE_SINGULAR
        raise error

    def _error(self, outcome: int) -> LoopError:
        """Return the error of a refused search."""
        return LoopError(REASONS[outcome], self._detail(outcome))

    def _detail(self, outcome: int) -> str:
        """Return the numbers of a refused search, and what is expected."""
        step = self._step
        measured = step.measured.tolist()
        # Outcomes without a number.
        if outcome == UNKNOWN_MODE:
            return self._why_unknown
        if outcome == NOT_FINITE:
            return 'no finite configuration'
        # The number that was out of bounds, by outcome.
        if outcome == ILL_CONDITIONED:
            return (f'conditioning figure {self.figure:.3g}; expected at most '
                    f'{self.max_figure:g}')
        if outcome == OPEN:
            return (f'residual {self.residual:.3g} rad or lengths; expected joints for '
                    'which the loops close')
        if outcome == LEAPT:
            return (f'the joints moved by {step.motion:.3g} rad or lengths in one step; '
                    'expected a continuous motion')
        if outcome == TOO_FAR:
            return (f'measured joints {dict(zip(self.measured, measured))}, too far from '
                    'the last configuration')
        # The measured joint that is farthest from where the loops close.
        k = step.most_deviating(self._turning)
        name = self.robot.coordinate_names[k]
        return (f"'{name}' at {step.seen_at(k):.6g}, where the loops close at "
                f'{step.search.last[k]:.6g} rad or m; expected a deviation of at most '
                f'{self.tolerance:g}')


def search_of(tracker: LoopTracker) -> LoopSearch:
    """Return the search of a tracker, for the rules that continue it."""
    step = tracker._step
    return unpacked_search(step.array, len(step.q), len(step.u))


def search_array(tracker: LoopTracker) -> Array:
    """Return a copy of the search of a tracker, as an array for other threads."""
    step = tracker._step
    array = step.array.copy()
    array[search_places(len(step.q), len(step.u)).known] = tracker.known
    return array


def squared_limits(tracker: LoopTracker) -> Array:
    """Return the squares of the largest residual, deviation and figure."""
    return tracker._step.limits.copy()


def compare_with(tracker: LoopTracker, others: Sequence[int], values: Array) -> None:
    """Note the further joints of a measurement, for the words of `refusal`."""
    tracker._step.compare(others, values)


def mirror(tracker: LoopTracker, array: Array) -> None:
    """Copy the search that another thread has done into a tracker."""
    step = tracker._step
    step.array[:] = array
    known = bool(array[search_places(len(step.q), len(step.u)).known])
    if tracker.known and not known:
        tracker._why_unknown = SINCE_SINGULAR
    tracker.known = known


def refusal(tracker: LoopTracker) -> LoopError:
    """Return why the search of a tracker was refused."""
    outcome = search_of(tracker).outcome
    return tracker._error(int(outcome))


def velocity_rows(robot: Robot) -> tuple[str, ...]:
    """Return the rows of velocity constraints; positions then depend on the path."""
    mechanism = robot.mechanism
    return _velocity_rows(mechanism, range(len(mechanism.labels)))


def path_rows(robot: Robot) -> tuple[str, ...]:
    """Return the independent ones of `velocity_rows`."""
    return _velocity_rows(robot.mechanism, robot.mechanism.kept)


def _velocity_rows(mechanism: Mechanism, rows: Iterable[int]) -> tuple[str, ...]:
    """Return which of some rows belong to constraints without a residual of positions."""
    at_zero = mechanism.rows(mechanism.state(neutral(mechanism.model)))
    return tuple(mechanism.labels[k] for k in rows if at_zero.residual[k] is None)


def _limit(value: float, what: str) -> float:
    """Return a limit, which may be negative; InputError unless it is a number."""
    return number(value, what, 'a number', lambda x: not math.isnan(x))


def _square(x: float) -> float:
    """Return the square of a limit or deviation; of a negative limit, its negative."""
    return math.copysign(min(abs(x), FAR)**2, x)
