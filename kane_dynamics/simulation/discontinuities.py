"""
Detection of jumps of user-defined functions during a simulation.

A jump of a prescribed velocity needs an impulse, which the equations of motion do not include. For
a continuous function f with the derivative f', the change over an interval is the integral of f'.
Intervals where Simpson's rule does not confirm this are halved: for a smooth function, however
steep, the difference vanishes; at a jump it stays, down to the resolution of the time. An interval
is halved as well if the outcome of a comparison (numpy.where, abs, minimum) changes in it, so that
jumps which cancel each other within a step are found.
"""

from collections.abc import Callable
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.dual import moving, rates, select, values
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.batch_loop import run_batch, Strided
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, trace_program
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.observers import Chunk, Observer
import numpy as np

SMALL = 1e-10  # rad/s, m/s, rad or m: smaller jumps are not looked for
EPS = float(np.finfo(float).eps)
ROUNDING = 64.0 * EPS  # of a function, and of its argument
# Relative length of an interval that is not halved: of functions of time; of q, whose rounding
# makes the time of a decision uncertain.
SHORT, SHORT_OF_STATE = 4.0 * EPS, 1e-11
MOST = 2**14  # intervals in one round; of more, those with the largest differences
SIDE = 8  # points on either side of a suspected jump
NOISE = 3.0  # a jump is larger than the scatter of the points on both sides by this factor
SAME = 1e-12  # relative: jumps that are as close in time are one
GOLDEN = 0.5 * (5.0**0.5 - 1.0)  # spreads the weights of comparisons

# Differences, (K,), above 1 where f may jump, and f at the begin, (K, C), of intervals given by
# begin, (K,), end, (K,), s, and number of the step, (K,).
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

    def __init__(self, robot: Robot, starts: Array, start: float, step: float, count: int,
                 single: bool) -> None:
        """Find the functions; kernels compile on first use."""
        self._robot, self._start, self._step = robot, start, step
        self._count, self._single = count, single
        # The integrator adds up its time, which may pass the last nominal time by its rounding.
        end = start + count * step
        self._range = start, end + 0.5 * EPS * count * max(abs(start), abs(end))
        equations = robot.equations
        self._mechanism = equations.mechanism if isinstance(
            equations, ConstrainedEquations) and equations.timed and len(starts) else None
        self._names = {of_state: [] if self._mechanism is None else [
            name for name, x in _functions(self._mechanism, starts[0, :robot.n_q],
                                           np.zeros(robot.n_q), start, of_state).items()
            for _ in np.ravel(x)] for of_state in (False, True)}

    def look_ahead(self, done: int, steps: int) -> None:
        """Raise ConstraintError for a jump of a function of time within the next steps."""
        if self._names[False]:
            times = self._times(done, steps)
            if done + steps == self._count:
                times[-1] = self._range[1]
            self._search(None, times, 'simulation')

    def look(self, chunk: Chunk) -> None:
        """Raise ConstraintError for a jump of a function of q and t along computed states."""
        if self._names[True]:
            for i, rows in enumerate(chunk.states[..., :self._robot.n_q]):
                which = 'simulation' if self._single else f'simulation {i}'
                self._search(rows, chunk.times, which)

    def _times(self, done: int, steps: int) -> Array:
        times: Array = self._start + (done + np.arange(steps + 1)) * np.float64(self._step)
        return times

    def _search(self, q: Array | None, times: Array, which: str) -> None:
        """Raise ConstraintError for the first jump; q, (K + 1, n_q), moves linearly in a step."""
        kernel, names = self._kernel(q is not None), self._names[q is not None]
        along = None if q is None else np.diff(q, axis=0) / np.diff(times)[:, None]

        def screen(begin: Array, end: Array, step: Array) -> tuple[Array, Array]:
            moved = [] if q is None or along is None else [
                q[step] + (begin - times[step])[:, None] * along[step], along[step]]
            found = _run(kernel, [*moved, begin, end])
            bad = np.flatnonzero(~np.isfinite(found[:, 0]))
            if len(bad):
                k = int(bad[0])
                at = [x[k] for x in moved] or [np.zeros(self._robot.n_q)] * 2
                self._refuse(at[0], at[1], float(begin[k]), float(end[k]), q is not None)
            return found[:, 0], found[:, 1:]
        jump = first_jump(screen, times, self._range, SHORT if q is None else SHORT_OF_STATE)
        if jump is not None:
            t, channel, size = jump
            name, unit = names[channel]
            raise ConstraintError(
                f'{which}, t = {t:.9g} s: {name} jumps by {size:.3g}{unit}; expected a continuous '
                'function, because a jump needs an impulse, which the equations do not include')

    def _refuse(self, q: Array, along: Array, begin: float, end: float, of_state: bool) -> None:
        """Raise ConstraintError that names the function that is not finite in an interval."""
        assert self._mechanism is not None
        for t in (begin, 0.5 * (begin + end), end):
            _functions(self._mechanism, q + (t - begin) * along, along, t, of_state)
        names = ', '.join(dict.fromkeys(name for name, _ in self._names[of_state]))
        raise ConstraintError(f'{names}: one of these or its derivative is too large between t = '
                              f'{begin:.9g} and {end:.9g} s; expected numbers below 1e100')

    def _kernel(self, of_state: bool) -> Kernel:
        """Return the kernel of `Screen`, (1 + C,), by begin and end, and by q and q' before."""
        robot, mechanism = self._robot, self._mechanism
        assert mechanism is not None
        shape = (robot.n_q,)
        inputs: Any = [('q', shape), ('along', shape)] if of_state else []
        inputs = [*inputs, ('begin', ()), ('end', ())]
        name = 'functions_of_state' if of_state else 'functions_of_time'

        def traced(*given: Any) -> Any:
            q, along = given[:2] if of_state else (np.zeros(shape), np.zeros(shape))
            begin, end = (x[()] for x in given[-3:-1])
            return _difference(begin, end, [_parts(_functions(
                mechanism, q + (t - begin) * along, along, t, of_state))
                for t in (begin, 0.5 * (begin + end), end)])
        block = robot.parameters.block
        return robot.kernels.extra(
            name, lambda: trace_program(name, traced, [*inputs, ('parameters', block.shape)]),
            [Argument(*x) for x in inputs], block, (1 + len(self._names[of_state]),))


def _functions(mechanism: Mechanism, q: Any, qdot: Any, t: Any,
               of_state: bool) -> dict[tuple[str, str], Any]:
    """Return user-defined functions as dual numbers, by name and unit."""
    return mechanism.functions(mechanism.state(moving(q, qdot), moving(t, 1.0)), of_state)


def _parts(found: dict[tuple[str, str], Any]) -> tuple[Any, Any, Any]:
    """Return functions and derivatives, (C,) each, and a number for the comparisons' outcomes."""
    flat = np.concatenate([np.ravel(np.asarray(x, dtype=object)) for x in found.values()])
    f, r = values(flat), rates(flat)
    decisions = [node for node in Program('', (), (*f, *r), ()).schedule()
                 if node.op in ('less', 'floor')]
    return f, r, sum((1.0 + GOLDEN * k % 1.0) * node for k, node in enumerate(decisions))


def _difference(begin: Any, end: Any, parts: Any) -> Any:
    """Return the difference of `Screen`, then f, for `_parts` at begin, middle and end; traced."""
    (f_0, r_0, branch_0), (_, r_1, branch_1), (f_2, r_2, branch_2) = parts
    total = (branch_1 - branch_0) * (branch_1 - branch_0) + (branch_2 - branch_0) * (
        branch_2 - branch_0)
    total = total / SMALL
    late = _size(begin) + _size(end)
    for a, r_a, r_m, b, r_b in zip(f_0, r_0, r_1, f_2, r_2):
        missed = b - a - (end - begin) * (r_a + 4.0 * r_m + r_b) * (1.0 / 6.0)
        allowed = SMALL + ROUNDING * (_size(a) + _size(b) + late * (
            _size(r_a) + _size(r_m) + _size(r_b)))
        total = total + missed * missed / (allowed * allowed)
    return np.array([total, *f_0], dtype=object)


def _size(x: Any) -> Any:
    return select(x < 0.0, -x, x)


def _run(kernel: Kernel, arguments: list[Array]) -> Array:
    """Return the results of a kernel, (K, width), which may be non-finite."""
    result = np.empty((len(arguments[0]), *kernel.shape))
    rows = [np.ascontiguousarray(x) for x in arguments]
    lanes = [*(Strided(x.ctypes.data, x.strides[0]) for x in rows),
             Strided(kernel.parameters.ctypes.data),
             Strided(result.ctypes.data, result.strides[0])]
    run_batch(kernel.lane_address, lanes, len(result))
    return result


def first_jump(screen: Screen, times: Array, within: tuple[float, float],
               short: float) -> tuple[float, int, float] | None:
    """
    Return time, number and size of the first jump of functions between times, or None.

    Parameters
    ----------
    screen : callable
        Differences and functions.
    times : (K + 1,) array
        Increasing, s.
    within : (float, float)
        Begin and end of the time in which functions count, s.
    short : float
        Relative length of an interval that is not halved.

    """
    begin, end, step = times[:-1], times[1:], np.arange(len(times) - 1)
    span = float(np.diff(times).max())
    found: list[tuple[float, int, float]] = []
    while len(begin):
        difference, _ = screen(begin, end, step)
        suspect = np.flatnonzero(difference > 1.0)
        if len(suspect) > MOST:
            suspect = np.sort(suspect[np.argsort(-difference[suspect], kind='stable')[:MOST]])
        begin, end, step = begin[suspect], end[suspect], step[suspect]
        last = end - begin <= short * np.maximum(np.maximum(np.abs(begin), np.abs(end)), span)
        for k in np.flatnonzero(last).tolist():
            found += _jumps(screen, float(begin[k]), float(end[k]), int(step[k]), within)
        begin, end, step = begin[~last], end[~last], step[~last]
        middle = 0.5 * (begin + end)
        begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
        step = np.tile(step, 2)
    if not found:
        return None
    near = min(found)[0] + SAME * (abs(min(found)[0]) + span)
    return min((jump for jump in found if jump[0] <= near), key=lambda jump: jump[1])


def _jumps(screen: Screen, begin: float, end: float, step: int,
           within: tuple[float, float]) -> list[tuple[float, int, float]]:
    """Return the jumps in an interval: there the points on either side are apart."""
    away = np.arange(1, SIDE + 1) * (end - begin)
    sides = np.concatenate([np.maximum(begin - away, within[0]),
                            np.minimum(end + away, within[1])])
    before, after = np.split(screen(sides, sides, np.full(2 * SIDE, step))[1], 2)
    size = after.mean(axis=0) - before.mean(axis=0)
    scatter = np.ptp(before, axis=0) + np.ptp(after, axis=0)
    largest = np.abs(before).max(axis=0) + np.abs(after).max(axis=0)
    apart = np.abs(size) > NOISE * scatter + SMALL + ROUNDING * largest
    return [(begin, channel, float(size[channel])) for channel in np.flatnonzero(apart).tolist()]
