"""The kernels of `LoopTracker`: Newton's method on the loops and the measured joints."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.constraints.conditioning import squared_figure
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.robot import Robot
import numpy as np

FIGURES = 6  # at the end of the result
CLOSED = 1e-10  # rad, or lengths of the mechanism: residual of the independent rows
STRIDE = 0.05  # rad, or lengths: longest step of a measured joint
SHARE = 0.25  # of the distance from a singular configuration: longest step of a measured joint
ROUNDING = 1e-6  # rad, or lengths: motion that is no jump
TIMED = 0.5  # rad, or lengths: longest motion that a function of time may cause in one step
LEAP = 3.0  # ratio of the motion of the joints to the expected one: jump to another branch


def tracking_kernel(robot: Robot, places: Sequence[int]) -> Kernel:
    """
    Return the kernel of one call: the predicted configuration, one Newton step, speeds, figures.

    Its arguments are q (n_q,) and T (n_q, n), the rates of all joints per rate of each measured
    joint, at the last configuration, positions and rates of the measured joints (n,), and
    positions of all joints, (n_q,), with the weights, 1 or 0, of their deviations. The prediction
    q + T dq has an error of second order, and Newton's step one of fourth order. The result is q
    (n_q,), T (n_q n,) at the prediction, u (n,), and the squares of the motion, of the residuals
    of the independent rows and of all rows in units of the mechanism, of the figure at the
    prediction, of the longest step of a measured joint in its unit, and of the largest weighted
    deviation.
    """
    n_q, n, block = robot.n_q, robot.n, robot.parameters.block
    arguments = [Argument('q', (n_q,), robot.coordinate_names), Argument('T', (n_q, n)),
                 *_measurement(robot)]
    name = f'tracking_{"_".join(map(str, places))}'
    return robot.kernels.extra(name, lambda: trace_program(name, tracked(robot, places), [
        *((a.name, a.shape) for a in arguments), ('parameters', block.shape)]), arguments, block,
        (n_q + n_q * n + n + FIGURES,))


def following_kernel(robot: Robot, places: Sequence[int]) -> Kernel:
    """
    Return the kernel of one call that moves a state in place where the result is valid.

    Its arguments are the state, (n_q + n_q n + n + 1,): q, T, u and the square of the figure; the
    others of `tracking_kernel`; and the squares of the largest residual, deviation and figure.
    The result is the state, the new one if it is valid, the figures of the new one, and 1 if it
    is valid, else 0. Numbers that are not finite are not valid.
    """
    n_q, n, block = robot.n_q, robot.n, robot.parameters.block
    moves, timed, ends = tracked(robot, places), robot.equations.timed, np.cumsum([
        n_q, n_q * n, n])

    def followed(state: Any, target: Any, rates: Any, seen: Any, weights: Any, limits: Any,
                 *rest: Any) -> Any:
        q, T, _, figure = np.split(state, ends)
        result = moves(q, T.reshape(n_q, n), target, rates, seen, weights, *rest)
        figures = result[-FIGURES:]
        found = [*result[:-FIGURES], figures[3]]
        right = valid(figures, figure[0], limits, timed)
        accepted = [select(right > 0.0, x, y) for x, y in zip(found, state, strict=True)]
        return [*accepted, *figures, right]
    size = int(ends[-1]) + 1
    measured, rates, seen, weights, *time = _measurement(robot)
    arguments = [Argument('state', (size,)), measured, rates, seen, weights,
                 Argument('limits', (3,)), *time]
    name = f'following_{"_".join(map(str, places))}'
    return robot.kernels.extra(name, lambda: trace_program(name, followed, [
        *((a.name, a.shape) for a in arguments), ('parameters', block.shape)]), arguments, block,
        (size + FIGURES + 1,))


def valid(figures: Sequence[Any], before: Any, limits: Sequence[Any], timed: bool) -> Any:
    """
    Return 1 if the result of one call is valid, else 0; also where a number is not finite.

    Parameters
    ----------
    figures : (6,) scalars
        As of `tracking_kernel`.
    before : scalar
        Square of the figure where the step begins; 0 if it is unknown.
    limits : (3,) scalars
        As of `following_kernel`.
    timed : bool
        Whether constraints depend on time.

    """
    moved, missed, residual, figure, way, deviation = figures
    leap = TIMED**2 if timed else LEAP**2 * figure * select(
        way > ROUNDING**2, way, ROUNDING**2)
    result: Any = 1.0
    for square, most in ((missed, CLOSED**2), (residual, limits[0]), (deviation, limits[1]),
                         (figure, limits[2]), (way, STRIDE**2), (way * before, SHARE**2),
                         (moved, leap)):
        result = select(square < most, result, 0.0)  # false for what is not a number
    return result


def _measurement(robot: Robot) -> list[Argument]:
    """Return the arguments of a measurement, as in `tracking_kernel`."""
    n_q, n = robot.n_q, robot.n
    return [Argument('measured', (n,)), Argument('rates', (n,)), Argument('seen', (n_q,)),
            Argument('weights', (n_q,)), *[Argument('t', ())] * robot.equations.timed]


def tracked(robot: Robot, places: Sequence[int]) -> Callable[..., Any]:
    """Return the function of `tracking_kernel`, to trace."""
    equations: Any = robot.equations
    mechanism: Mechanism = equations.mechanism
    n_q, n = robot.n_q, robot.n
    measured = np.eye(n_q)[list(places)].astype(object)
    per_unit = 1.0 / mechanism.units

    def system(q: Any, t: Any) -> tuple[Any, Any, Any, Any]:
        here = mechanism.state(q, t, equations.tree.geometry)
        rows = mechanism.rows(here)
        missed = [0.0 if x is None else x for x in rows.residual]
        return (here, np.concatenate([measured, rows.J[mechanism.kept]]), rows.b[mechanism.kept],
                np.array(missed, dtype=object))

    def function(q: Any, T: Any, target: Any, rates: Any, seen: Any, weights: Any,
                 *rest: Any) -> Any:
        t = rest[0][()] if equations.timed else 0.0
        change = target - q[places]
        structure = mechanism.solved(system(q, t)[1], np.eye(n_q))[:, :n]
        near = q + np.array([[0.0 if is_zero(x) else y for x, y in zip(*rows)]
                             for rows in zip(structure, T)]).reshape(n_q, n) @ change
        near[places] = target
        _, S, _, missed = system(near, t)
        inverse = mechanism.solved(S, np.eye(n_q))
        closed = near - inverse[:, n:] @ missed[mechanism.kept]
        here, S_closed, b, missed = system(closed, t)
        Y, Z = here.speed_rows(mechanism.speed_names)
        qdot = mechanism.solved(S_closed, np.concatenate([rates, b]))
        moved, missed = (closed - q) * per_unit, missed * (1.0 / mechanism.row_units)
        kept = missed[mechanism.kept]
        return np.concatenate([closed, inverse[:, :n].ravel(), Y @ qdot + Z, [
            moved @ moved, kept @ kept, missed @ missed, squared_figure(mechanism, S, inverse),
            largest(change * per_unit[places]), largest(weights * (seen - closed))]])
    return function


def largest(values: Iterable[Any]) -> Any:
    """Return the largest square of some scalars, by pairs: a short chain of comparisons."""
    squares = [x * x for x in values]
    while len(squares) > 1:
        pairs = list(zip(squares[::2], squares[1::2]))
        squares = [select(a > b, a, b) for a, b in pairs] + squares[2 * len(pairs):]
    return squares[0] if squares else 0.0
