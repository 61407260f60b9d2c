"""The kernel of `LoopTracker`: Newton's method on the loops and the measured joints."""

from collections.abc import Iterable, Sequence
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


def tracking_kernel(robot: Robot, places: Sequence[int]) -> Kernel:
    """
    Return the kernel of one call: the predicted configuration, one Newton step, speeds, figures.

    Its arguments are q (n_q,) and T (n_q, n), the rates of all joints per rate of each measured
    joint, at the last configuration, positions and rates of the measured joints (n,), and
    positions of all joints, (n_q,), with the weights, 1 or 0, of their deviations. The prediction
    q + T dq has an error of second order, and Newton's step one of fourth order. The result is q
    (n_q,), T (n_q n,) at the prediction, u (n,), and the squares of the motion, of the residuals
    of the independent rows and of all rows, of the figure at the prediction, of the longest step
    of a measured joint in its unit, and of the largest weighted deviation.
    """
    equations: Any = robot.equations
    mechanism: Mechanism = equations.mechanism
    n_q, n, block = robot.n_q, robot.n, robot.parameters.block
    measured = np.eye(n_q)[list(places)].astype(object)
    per_unit = 1.0 / mechanism.units

    def system(q: Any, t: Any) -> tuple[Any, Any, Any, Any]:
        here = mechanism.state(q, t, equations.tree.geometry)
        rows = mechanism.rows(here)
        missed = [0.0 if x is None else x for x in rows.residual]
        return (here, np.concatenate([measured, rows.J[mechanism.kept]]), rows.b[mechanism.kept],
                np.array(missed, dtype=object))

    def tracked(q: Any, T: Any, target: Any, rates: Any, seen: Any, weights: Any,
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
        moved, kept = (closed - q) * per_unit, missed[mechanism.kept]
        return np.concatenate([closed, inverse[:, :n].ravel(), Y @ qdot + Z, [
            moved @ moved, kept @ kept, missed @ missed, squared_figure(mechanism, S, inverse),
            largest(change * per_unit[places]), largest(weights * (seen - closed))]])
    arguments = [Argument('q', (n_q,), robot.coordinate_names), Argument('T', (n_q, n)),
                 Argument('measured', (n,)), Argument('rates', (n,)),
                 Argument('seen', (n_q,)), Argument('weights', (n_q,))]
    arguments += [Argument('t', ())] if equations.timed else []
    name = f'tracking_{"_".join(map(str, places))}'
    return robot.kernels.extra(name, lambda: trace_program(name, tracked, [
        *((a.name, a.shape) for a in arguments), ('parameters', block.shape)]), arguments, block,
        (n_q + n_q * n + n + FIGURES,))


def largest(values: Iterable[Any]) -> Any:
    """Return the largest square of some scalars, by pairs: a short chain of comparisons."""
    squares = [x * x for x in values]
    while len(squares) > 1:
        pairs = list(zip(squares[::2], squares[1::2]))
        squares = [select(a > b, a, b) for a, b in pairs] + squares[2 * len(pairs):]
    return squares[0] if squares else 0.0
