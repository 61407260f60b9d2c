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
    Return the kernel of one call: the predicted configuration, one Newton step, speeds, figures.

    Its arguments are q (n_q,) and T (n_q, n), the rates of all joints per rate of each measured
    joint, at the last configuration, and positions and rates of the measured joints (n,). The
    prediction q + T dq has an error of second order, and Newton's step one of fourth order. The
    result is q (n_q,), T (n_q n,) at the prediction, u (n,), and the squares of the motion, of the
    residuals of the independent rows and of all rows, and of the figure at the prediction.
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

    def tracked(q: Any, T: Any, target: Any, rates: Any, *rest: Any) -> Any:
        t = rest[0][()] if equations.timed else 0.0
        near = q + T @ (target - q[places])
        near[places] = target
        _, S, _, missed = system(near, t)
        inverse = mechanism.solved(S, np.eye(n_q))
        closed = near - inverse[:, n:] @ missed[mechanism.kept]
        here, S_closed, b, missed = system(closed, t)
        Y, Z = here.speed_rows(mechanism.speed_names)
        qdot = mechanism.solved(S_closed, np.concatenate([rates, b]))
        moved, kept = (closed - q) * (1.0 / mechanism.units), missed[mechanism.kept]
        return np.concatenate([closed, inverse[:, :n].ravel(), Y @ qdot + Z, [
            moved @ moved, kept @ kept, missed @ missed, squared_figure(mechanism, S, inverse)]])
    arguments = [Argument('q', (n_q,), robot.coordinate_names), Argument('T', (n_q, n)),
                 Argument('measured', (n,)), Argument('rates', (n,))]
    arguments += [Argument('t', ())] if equations.timed else []
    name = f'tracking_{"_".join(map(str, places))}'
    return robot.kernels.extra(name, lambda: trace_program(name, tracked, [
        *((a.name, a.shape) for a in arguments), ('parameters', block.shape)]), arguments, block,
        (n_q + n_q * n + n + 4,))
