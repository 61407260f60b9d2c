"""The kernel of `LoopTracker`: Newton's method on the loops and the measured joints."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics.mechanics.constraints.conditioning import squared_figure
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.robot import Robot
import numpy as np


def tracking_kernel(robot: Robot, places: Sequence[int]) -> Kernel:
    """
    Return the kernel of one call: two Newton steps, then speeds and figures.

    Its arguments are q (n_q,), positions and rates of the measured joints (n,); its result is q
    (n_q,), u (n,), and the squares of the last step, of the whole motion, of the residuals, and of
    the figure before the last step.
    """
    equations: Any = robot.equations
    mechanism: Mechanism = equations.mechanism
    n_q, n, block = robot.n_q, robot.n, robot.parameters.block
    select = np.eye(n_q)[list(places)].astype(object)

    def system(q: Any, t: Any) -> tuple[Any, Any, Any, Any]:
        here = mechanism.state(q, t, equations.tree.geometry)
        rows = mechanism.rows(here)
        missed = [0.0 if x is None else x for x in rows.residual]
        return (here, np.concatenate([select, rows.J[mechanism.kept]]), rows.b[mechanism.kept],
                np.array(missed, dtype=object))

    def squared(step: Any) -> Any:
        scaled = step * (1.0 / mechanism.units)
        return scaled @ scaled

    def tracked(q: Any, target: Any, rates: Any, *rest: Any) -> Any:
        t = rest[0][()] if equations.timed else 0.0
        _, S, _, missed = system(q, t)
        first = mechanism.solved(S, np.concatenate([target - q[places], -missed[mechanism.kept]]))
        near = q + first
        near[places] = target
        _, S, _, missed = system(near, t)
        inverse = mechanism.solved(S, np.eye(n_q))
        step = -(inverse[:, n:] @ missed[mechanism.kept])
        closed = near + step
        here, S_closed, b, missed = system(closed, t)
        Y, Z = here.speed_rows(mechanism.speed_names)
        qdot = mechanism.solved(S_closed, np.concatenate([rates, b]))
        return np.concatenate([closed, Y @ qdot + Z, [
            squared(step), squared(closed - q), missed @ missed,
            squared_figure(mechanism, S, inverse)]])
    arguments = [Argument('q', (n_q,), robot.coordinate_names), Argument('measured', (n,)),
                 Argument('rates', (n,))]
    arguments += [Argument('t', ())] if equations.timed else []
    name = f'tracking_{"_".join(map(str, places))}'
    return robot.kernels.extra(name, lambda: trace_program(name, tracked, [
        *((a.name, a.shape) for a in arguments), ('parameters', block.shape)]), arguments, block,
        (n_q + n + 4,))
