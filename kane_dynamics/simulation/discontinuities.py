"""
Detection of jumps of user-defined functions during a simulation.

A jump of a prescribed velocity needs an impulse, which the equations of motion do not
include. For a continuous function f with the derivative f', the change over an interval
is the integral of f'. Intervals where Simpson's rule does not confirm this are halved:
for a smooth function, however steep, the difference vanishes; at a jump it stays, down
to the resolution of the time. An interval is halved as well if the outcome of a
comparison (numpy.where, abs, minimum) changes in it, so that jumps which cancel each
other within a step are found.
"""

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.choice import magnitude, select
from kane_dynamics.mechanics.algebra.jet import moving, rates, values
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, Shape
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.observers import Chunk, Observer
import numpy as np

SMALL = 1e-10  # rad/s, m/s, rad or m: smaller jumps are not looked for
EPS = float(np.finfo(float).eps)
ROUNDING = 64.0 * EPS  # of a function, and of its argument
# Relative length of an interval that is not halved: of functions of time; of q, whose
# rounding makes the time of a decision uncertain.
SHORT, SHORT_OF_STATE = 4.0 * EPS, 1e-11
MOST = 2**14  # intervals in one round; of more, the first
SAME = 1e-12  # relative: jumps that are as close in time are one
GOLDEN = 0.5 * (5.0**0.5 - 1.0)  # spreads the weights of comparisons

# Differences, (K,), above 1 where f may jump, and the changes of the entries of f that may,
# (K, C), in intervals given by begin, (K,), end, (K,), s, and number of the step, (K,).
Screen = Callable[[Array, Array, Any], tuple[Array, Array]]


class JumpWatch(Observer):
    """
    Watch of user-defined functions, which raises an error if one jumps within a step.

    Parameters
    ----------
    robot : Robot
        Its speeds and constraints may have user-defined functions.
    starts : (N, size) array
        Initial states, entries as `step_kernels.state_names`.
    start, step : float
        Time at the begin, and of one step, s.
    count : int
        Number of steps.
    single : bool
        Leave out the number of the simulation from messages.

    Raises
    ------
    ConstraintError
        A function or a derivative is not finite at the start.

    """

    def __init__(self, robot: Robot, starts: Array, start: float, step: float,
                 count: int,
                 single: bool) -> None:
        """Find the functions; kernels compile on first use."""
        self._robot, self._start, self._step = robot, start, step
        self._count, self._single = count, single
        # The integrator adds up its time, which may pass the last nominal time by its
        # rounding.
        end = start + count * step
        self._end = end + 0.5 * EPS * count * max(abs(start), abs(end))
        self._mechanism: Mechanism | None = None
        if len(starts):
            self._mechanism = robot.equations.mechanism
        # Names and units of all entries of the functions: of time alone (False), of
        # state (True).
        self._names = {of_state: self._functions_at_start(starts, of_state)
                       for of_state in (False, True)}

    def _functions_at_start(self, starts: Array,
                            of_state: bool) -> list[tuple[str, str]]:
        """Return name and unit of every entry of the functions, which are finite at the start."""
        if self._mechanism is None:
            return []
        n_q = self._robot.n_q
        functions = _functions(self._mechanism, starts[0, :n_q], np.zeros(n_q),
                               self._start, of_state)
        names: list[tuple[str, str]] = []
        # A function may be an array: each entry is watched by itself.
        for name, x in functions.items():
            names += [name] * np.size(x)
        return names

    def look_ahead(self, done: int, steps: int) -> None:
        """Raise ConstraintError for a jump of a function of time within the next steps."""
        if self._names[False]:
            times = self._start + (done + np.arange(steps + 1)) * np.float64(self._step)
            if done + steps == self._count:
                times[-1] = self._end
            self._search(None, times, 'simulation')

    def look(self, chunk: Chunk) -> None:
        """Raise ConstraintError for a jump of a function of q and t along computed states."""
        if self._names[True]:
            for i, rows in enumerate(chunk.states[..., :self._robot.n_q]):
                which = 'simulation' if self._single else f'simulation {i}'
                self._search(rows, chunk.times, which)

    def _search(self, q: Array | None, times: Array, which: str) -> None:
        """Raise ConstraintError for the first jump; q, (K + 1, n_q), moves linearly in a step."""
        of_state = q is not None
        kernel = self._kernel(of_state)
        # Within a step q moves on a straight line, so that a function of q becomes one
        # of t.
        slopes = None if q is None else np.diff(q, axis=0) / np.diff(times)[:, None]

        def screen(begin: Array, end: Array, step: Array) -> tuple[Array, Array]:
            motion = []
            if q is not None and slopes is not None:
                q_begin = q[step] + (begin - times[step])[:, None] * slopes[step]
                motion = [q_begin, slopes[step]]
            results = _run(kernel, [*motion, begin, end])
            differences = results[:, 0]
            # A value that is not finite is refused at once: no bisection finds where it
            # begins.
            refused = np.flatnonzero(~np.isfinite(differences))
            if len(refused):
                k = int(refused[0])
                at = [x[k] for x in motion] or [np.zeros(self._robot.n_q)] * 2
                self._refuse(at[0], at[1], float(begin[k]), float(end[k]), of_state)
            return differences, results[:, 1:]
        jump = first_jump(screen, times, SHORT_OF_STATE if of_state else SHORT)
        if jump is not None:
            name, unit = self._names[of_state][jump.channel]
            raise ConstraintError(
                f'{which}, t = {jump.t:.9g} s: {name} jumps by {jump.size:.3g}{unit}; '
                'expected a continuous function, because a jump needs an impulse, which '
                'the equations do not include')

    def _refuse(self, q: Array, slope: Array, begin: float, end: float,
                of_state: bool) -> None:
        """Raise ConstraintError that names the function that is not finite in an interval."""
        assert self._mechanism is not None
        # The function that is not finite at one of these times is refused by its name.
        for t in (begin, 0.5 * (begin + end), end):
            _functions(self._mechanism, q + (t - begin) * slope, slope, t, of_state)
        names = ', '.join(dict.fromkeys(name for name, _ in self._names[of_state]))
        raise ConstraintError(f'{names}: one of these or its derivative is too large '
                              f'between t = {begin:.9g} and {end:.9g} s; expected '
                              'numbers below 1e100')

    def _kernel(self, of_state: bool) -> Kernel:
        """Return the kernel of `Screen`, (1 + C,), for an interval of time."""
        robot, mechanism = self._robot, self._mechanism
        assert mechanism is not None
        shape = (robot.n_q,)
        moved: dict[str, Shape] = {}
        name = 'functions_of_time'
        if of_state:
            moved = {'q': shape, 'along': shape}
            name = 'functions_of_state'

        # The functions at both ends and in the middle: a jump is a change that bisection
        # does not halve.
        def traced(*arguments: Any) -> Any:
            *moved_arguments, begin, end = arguments
            q, slope = moved_arguments or np.zeros((2, *shape))
            parts = []
            for t in (begin, 0.5 * (begin + end), end):
                q_t = q + (t - begin) * slope
                parts.append(_parts(_functions(mechanism, q_t, slope, t, of_state)))
            return _difference(begin, end, parts)
        return robot.compiled(traced, name=name, **moved, begin=(), end=(),
                              shape=(1 + len(self._names[of_state]),))


def _functions(mechanism: Mechanism, q: Any, qdot: Any, t: Any,
               of_state: bool) -> dict[tuple[str, str], Any]:
    """Return user-defined functions as dual numbers, by name and unit."""
    return mechanism.functions(mechanism.state(moving(q, qdot), moving(t, 1.0)),
                               of_state)


class _Parts(NamedTuple):
    """Functions and derivatives, (C,) each, and a number for the comparisons' outcomes."""

    values: Vector
    rates: Vector
    branch: Scalar


def _parts(functions: dict[tuple[str, str], Any]) -> _Parts:
    """Return the parts of functions that are dual numbers."""
    # All entries of all functions in one row.
    entries: list[Any] = []
    for function in functions.values():
        entries += np.asarray(function, dtype=object).ravel().tolist()
    flat = np.array(entries, dtype=object)
    f = values(flat)
    r = rates(flat)

    # Every comparison has a weight of its own, so that no two outcomes cancel.
    branch: Scalar = 0
    count = 0
    for node in Program('', (), (*f, *r), ()).schedule():
        if node.op in ('less', 'floor'):
            branch = branch + (1.0 + GOLDEN * count % 1.0) * node
            count += 1
    return _Parts(f, r, branch)


def _difference(begin: Scalar, end: Scalar, parts: Sequence[_Parts]) -> Vector:
    """Return the results of `Screen` for `_parts` at begin, middle and end; traced."""
    (f_0, r_0, branch_0), (_, r_1, branch_1), (f_2, r_2, branch_2) = parts
    # Outcomes of comparisons that change in the interval.
    total = (branch_1 - branch_0) * (branch_1 - branch_0) + (branch_2 - branch_0) * (
        branch_2 - branch_0)
    total = total / SMALL
    # Changes that Simpson's rule does not confirm, relative to the rounding of f and of
    # t.
    late = magnitude(begin) + magnitude(end)
    changes = []
    for a, r_a, r_m, b, r_b in zip(f_0, r_0, r_1, f_2, r_2):
        error = b - a - (end - begin) * (r_a + 4.0 * r_m + r_b) * (1.0 / 6.0)
        allowed = SMALL + ROUNDING * (magnitude(a) + magnitude(b) + late * (
            magnitude(r_a) + magnitude(r_m) + magnitude(r_b)))
        difference = error * error / (allowed * allowed)
        total = total + difference
        changes.append(select(difference > 1.0, b - a, 0.0))
    return np.array([total, *changes], dtype=object)


def _run(kernel: Kernel, arguments: list[Array]) -> Array:
    """Return the results of a kernel, (K, width), which may be non-finite."""
    result = np.empty((len(arguments[0]), *kernel.shape))
    rows = [np.ascontiguousarray(x) for x in arguments]
    kernel.run(rows, result, len(result))
    return result


class Jump(NamedTuple):
    """A jump: its time, s, the number of the function, and its size."""

    t: float
    channel: int
    size: float


def first_jump(screen: Screen, times: Array, short: float) -> Jump | None:
    """
    Return the first jump of functions between times, or None.

    Parameters
    ----------
    screen : callable
        Differences and changes.
    times : (K + 1,) array
        Increasing, s.
    short : float
        Relative length of an interval that is not halved.

    """
    begin, end, step = times[:-1], times[1:], np.arange(len(times) - 1)
    span = float(np.diff(times).max())
    jumps: list[Jump] = []
    # Intervals are halved until they are as short as the resolution of time, where only
    # those with a jump are left.
    while len(begin):
        difference, changes = screen(begin, end, step)
        suspect = np.flatnonzero(difference > 1.0)[:MOST]
        begin, end, step = begin[suspect], end[suspect], step[suspect]
        # Intervals as short as the resolution of time hold a jump, or do not; others are
        # halved.
        latest = np.maximum(np.abs(begin), np.abs(end))
        last = end - begin <= short * np.maximum(latest, span)
        for k, channel in np.argwhere(last[:, None] & (changes[suspect] != 0.0)).tolist():
            jumps.append(Jump(float(begin[k]), channel, float(changes[suspect][k, channel])))
        begin, end, step = begin[~last], end[~last], step[~last]
        middle = 0.5 * (begin + end)
        begin = np.concatenate([begin, middle])
        end = np.concatenate([middle, end])
        step = np.tile(step, 2)
    if not jumps:
        return None
    # Jumps at the same time are one event: the first function of it is reported.
    earliest = min(jumps).t
    latest_same = earliest + SAME * (abs(earliest) + span)
    return min((jump for jump in jumps if jump.t <= latest_same),
               key=attrgetter('channel'))
