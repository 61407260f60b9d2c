"""Detection of singularities between successive states of a simulation."""

from collections.abc import Callable
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.constraints.conditioning import (best_choice, constraints_at_fault,
                                                              described, stacked)
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.robot import Robot
import numpy as np

TURN = 0.5  # largest change of S in a step, relative to S, near a singularity


class SingularityWatch:
    """
    Detects singularities between successive rows of states.

    Parameters
    ----------
    asked : Robot
        The user's robot; independent speeds that the user named must stay regular.
    step : float
        Time between two rows, s.

    """

    def __init__(self, asked: Robot, step: float) -> None:
        """Store the robot; kernels compile on first use."""
        self._asked, self._step = asked, step

    def look(self, robot: Robot, near: bool, q: Array, times: Array, where: Callable[[int], str],
             speeds: Callable[[int], Array]) -> None:
        """
        Raise ConstraintError for a singularity between a row and the next.

        Parameters
        ----------
        robot : Robot
            The robot in the current choice of the simulation.
        near : bool
            Whether that choice is nearly singular and no other is better.
        q, times : (K, n_q), (K,) arrays
            Configurations, rad or m, and their times, s.
        where, speeds : callable
            Return the begin of a message, and the user's speeds, for the number of a row.

        """
        mechanism, asked = robot.mechanism, self._asked.mechanism
        fixed = self._asked.speeds_are_given and mechanism.free != asked.free
        if len(q) < 2 or not (near or fixed):
            return
        every = self._rows()(np.ascontiguousarray(q),
                             *([times] if self._asked.equations.timed else []))
        n = len(mechanism.speeds.names)
        kept = [n + k for k in mechanism.kept]
        if fixed:
            side = np.sign(np.linalg.det(every[:, [*asked.free, *kept]]))
            for k in np.flatnonzero(side[1:] * side[:-1] <= 0.0)[:1].tolist():
                stack = stacked(asked, q[k], times[k])
                loop = constraints_at_fault(asked, stack, asked.free,
                                            best_choice(asked, stack, asked.free).kept)
                raise ConstraintError(
                    f'{where(k)}the independent speeds {", ".join(asked.speed_names)} become '
                    f'singular within the next step under {loop}, at {described(asked, q[k])}, '
                    f'u = {np.round(speeds(k), 9).tolist()}: they do not determine the joint '
                    'rates there; expected others, or independent=None, which changes them')
        if near:
            S = every[:, [*mechanism.free, *kept]]
            turn = np.linalg.solve(S[:-1], S[1:]) - np.eye(n)
            for k in np.flatnonzero(np.linalg.norm(turn, axis=(1, 2)) > TURN)[:1].tolist():
                loop = constraints_at_fault(mechanism, stacked(mechanism, q[k], times[k]),
                                            mechanism.free, mechanism.kept)
                raise ConstraintError(
                    f'{where(k)}a kinematic singularity (dead point) of {loop} is passed, or so '
                    f'near that a step of {self._step:g} s is too long, at '
                    f'{described(mechanism, q[k])}: the rows depend on each other there, and the '
                    'motion beyond is not determined, or takes shorter steps')

    def _rows(self) -> Kernel:
        """Return the kernel of all rows of speeds and constraints, (n_q + m, n_q), by q and t."""
        robot, equations = self._asked, self._asked.equations
        assert isinstance(equations, ConstrainedEquations)
        mechanism, geometry = equations.mechanism, equations.tree.geometry
        inputs: Any = [('q', (robot.n_q,)), *([('t', ())] if equations.timed else [])]

        def rows(q: Any, *rest: Any) -> Any:
            here = mechanism.state(q, rest[0][()] if equations.timed else 0.0, geometry)
            return np.concatenate([here.speed_rows(mechanism.speeds.names)[0] * mechanism.units,
                                   mechanism.rows(here).J * mechanism.units
                                   / np.array(mechanism.sizes)[:, None]])
        block = robot.parameters.block
        return robot.kernels.extra(
            'stacked_rows', lambda: trace_program('stacked_rows', rows, [
                *inputs, ('parameters', block.shape)]), [Argument(*x) for x in inputs], block,
            (robot.n_q + len(mechanism.labels), robot.n_q))
