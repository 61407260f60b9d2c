"""
Detection of singularities in a simulation: where a step computes its margin, and between steps.

A native step computes one margin (`step_kernels`). With closed loops it is that of the step's
end, before the loops are closed, where the correction needs the same system. With constraints of
velocities alone it is the smallest of the stages of the integrator, where the dynamics need that
system; the step's end is then a stage of the next step.
"""

from collections.abc import Callable
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.constraints.conditioning import (best_choice, constraints_at_fault,
                                                              described, SHARE, Stack, stacked)
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.integrators import integrator_of
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.user_speeds import tau_from
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
        """Return the kernel of all rows of speeds and constraints, (n_j + m, n_j), by q and t."""
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
            (robot.model.n + len(mechanism.labels), robot.model.n))


def trusted(states: Array) -> Any:
    """Return which states, (K, size), are finite with a positive margin; first always true."""
    good = np.isfinite(states).all(axis=-1) & (states[:, -1] > 0.0)
    good[0] = True
    return good


def all_trusted(buffer: Array) -> Any:
    """Return for which simulations, (N, K, size), every state is `trusted`."""
    with np.errstate(over='ignore', invalid='ignore'):  # a finite sum has finite terms
        whole = np.isfinite(buffer.sum(axis=(1, 2))) & (buffer[:, 1:, -1] > 0.0).all(axis=1)
    whole[~whole] = [trusted(states).all() for states in buffer[~whole]]
    return whole


def watches_stages(robot: Robot, q: Any, t: Any) -> bool:
    """Return whether a step's margin is that of its stages: no constraint is one of positions."""
    equations = robot.equations
    return (isinstance(equations, ConstrainedEquations) and equations.watched
            and not equations.keeps_positions(q, t))


def residual_error(mechanism: Mechanism, stack: Stack, kept: bool, q: Array, t: float, most: float,
                   where: str, step: float) -> None:
    """
    Raise ConstraintError if a step from q, t ends at residuals of positions over `most`.

    With `kept`, if the largest is that of a kept row, else if it is that of another.
    """
    missed_lengths = stack.residual / mechanism.row_units
    worst = int(np.argmax(np.abs(missed_lengths)))
    if np.linalg.norm(missed_lengths) <= SHARE * most or kept != (worst in mechanism.kept):
        return
    what = f"{where}constraint '{mechanism.labels[worst]}'"
    unit = 'rad' if mechanism.turning[worst] else 'm'
    missed = f'{abs(stack.residual[worst]):.3g} {unit}'
    if kept:
        raise ConstraintError(
            f'{what} opens by {missed} within one step of {step:g} s at '
            f'{described(mechanism, q)}; expected at most '
            f'{most * mechanism.row_units[worst]:.3g} {unit}, as with a shorter step')
    raise ConstraintError(
        f'{what} contradicts the others at {described(mechanism, q)}, t = {t:.6g} s: its residual '
        f'is {missed} where the others hold; expected 0')


class _StagesInNumbers:
    """A robot during one step in NumPy, in the interface of the integrators (`System`)."""

    def __init__(self, robot: Robot, state: Array, tau: Array, dual_to: tuple[str, ...],
                 step: float) -> None:
        """Store the arguments of `watched_configurations`."""
        self.equations: Any = robot.equations
        self.stages: list[tuple[float, Array]] = []
        self._tau, self._dual_to, self._step = tau, dual_to, step
        self._split = [robot.n_q, robot.n_q + robot.n]
        self._time = state[self._split[1]:-1]
        self.start = self._time[0] if len(self._time) else 0.0
        self._block = robot.parameters.block[:robot.parameters.physical]
        self._wrench = robot.kernels.no_wrench if len(robot.kernels.no_wrench) else None

    def _stage(self, q: Array, moment: int) -> tuple[Array, float]:
        """Store the configuration of a stage; return the torque, (n,), and the time."""
        after = 0.5 * moment * self._step
        self.stages.append((after, np.asarray(q, dtype=np.float64)))
        t = self.start + after
        return tau_from(self.equations, self._dual_to, q, self._tau, t), t

    def rates(self, state: Any, moment: int) -> Any:
        """Return the rates of q, u, time and margin."""
        q, u, _ = np.split(state, self._split)
        tau, t = self._stage(q, moment)
        found = self.equations.state_rates(q, u, tau, self._wrench, self._block, t)
        return np.array([*found, *self.quadratures(q, u, moment)], dtype=np.float64)

    def torque(self, q: Any, u: Any, moment: int) -> Any:
        """Return the held torque."""
        return self._tau

    def implicit_stage(self, q: Any, u: Any, tau: Any, before: tuple[Any, Any], g: Any,
                       moment: int) -> tuple[Any, Any]:
        """Return joint rates and udot of a stage of the linearly implicit equations."""
        own, t = self._stage(q, moment)
        found = ImplicitStep(self.equations).stage(q, u, own, before, g, self._wrench,
                                                   self._block, t)
        return np.asarray(found[0], dtype=np.float64), np.asarray(found[1], dtype=np.float64)

    def quadratures(self, q: Any, u: Any, moment: int) -> Any:
        """Return the rates of time and margin."""
        return np.array([*(1.0 for _ in self._time), 0.0])


def watched_configurations(robot: Robot, state: Array, tau: Array, dual_to: tuple[str, ...],
                           step: float, integrator: str) -> list[tuple[float, Array]]:
    """
    Return where a step computes its margin: times after its start, s, and q, (n_q,).

    Computed in NumPy, without the correction of closed loops.

    Parameters
    ----------
    robot : Robot
        With constraints.
    state : (size,) array
        Entries as `state_names`; rad or m, and s.
    tau : (n,) array
        Dual to the speeds named `dual_to`, held during the step; N m or N.
    dual_to : tuple of str
        Names of independent speeds.
    step : float
        s.
    integrator : str
        One of `mechanics.integrators.INTEGRATORS`.

    Raises
    ------
    ConstraintError, ZeroDivisionError
        The mass matrix, or the system of speeds and constraints, is singular.

    """
    motion = _StagesInNumbers(robot, state, tau, dual_to, step)
    with np.errstate(all='ignore'):
        after = integrator_of(integrator).step(motion, state, step)
    if not watches_stages(robot, state[:robot.n_q], motion.start):
        return [(step, np.asarray(after[:robot.n_q], dtype=np.float64))]
    return motion.stages
