"""Steps of the integrators with some joints held: the forces that hold them act in every stage."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints.conditioning import LIMITS
from kane_dynamics.mechanics.integrators.held_joints import Held, held_solution, linear_system
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import (RobotMotion, StepChoice, time_input,
                                                   traced_step, wrench_input)
from kane_dynamics.simulation.user_speeds import tau_from
import numpy as np

ROUNDING = 1e-12  # relative to the forces of all stops


class HeldStep(NamedTuple):
    """
    The state after a step with held joints, and what holds them in each stage.

    The entries of `stages` are those of `held_joints.Solution`, w aside, for k joints with stops.
    """

    state: Any
    stages: list[Any]


def held_step(robot: Robot, choice: StepChoice, state: Any, inputs: Any, constants: Any,
              held: Any, stopped: Sequence[int]) -> HeldStep:
    """
    Return a step in which joints are held.

    Parameters
    ----------
    robot, choice, state, inputs, constants
        As of `step_kernels.traced_step`.
    held : (k,) array
        1 or -1 for a joint that is held, else 0.
    stopped : sequence of int
        The indices of the k joints in q.

    """
    motions: list[_HeldMotion] = []

    def system(*given: Any) -> _HeldMotion:
        motions.append(_HeldMotion(held, stopped, *given))
        return motions[0]
    after = traced_step(robot, choice, state, inputs, constants, system)
    return HeldStep(after, motions[0].stages)


class _HeldMotion(RobotMotion):
    """A robot with held joints during one traced step."""

    def __init__(self, held: Any, stopped: Sequence[int], *given: Any) -> None:
        """Store which joints are held, and the arguments of `RobotMotion`."""
        super().__init__(*given)
        self._held, self._stopped = held, stopped
        self.stages = list[Any]()

    def called(self, program: Program, q: Any, u: Any, tau: Any, time: Any,
               *more: Any) -> Any:
        """Return the results of the dynamics of a stage, and keep what holds joints."""
        found = super().called(program, q, u, tau, time, self._held, *more)
        k, n = len(self._stopped), self.robot.n
        rest, *stage = np.split(np.array(found), np.cumsum([len(found) - 2 * k - n, k, k]))
        self.stages.append(stage)
        return rest

    @lazy_property
    def _motion(self) -> Program:
        return self._program(None)

    @lazy_property
    def _stage(self) -> Program:
        return self._program(ImplicitStep(self.equations))

    def _program(self, method: ImplicitStep | None) -> Program:
        """Trace the dynamics of a stage: those of step_kernels, then forces, accelerations."""
        robot, dual_to = self.robot, self._dual_to
        equations: Any = robot.equations
        joints = [robot.model.places.index(k) for k in self._stopped]
        wrench, time = wrench_input(robot), time_input(robot)
        before: list[tuple[str, Shape]] = [] if method is None else [
            ('joint_rates', (robot.model.n,)), ('udot', (robot.n,)), ('g', ())]

        def dynamics(q: Any, u: Any, tau: Any, side: Any, *rest: Any) -> Any:
            *given, parameters = rest
            (*rates, g), given = given[:len(before)] or [None], given[len(before):]
            push, physical = given[0] if wrench else None, parameters[:robot.parameters.physical]
            t = given[-1][()] if time else 0.0
            tau = tau if dual_to is None else tau_from(equations, dual_to, q, tau, t)
            held = Held(joints, [s * s > 0.5 for s in side])
            if method is not None:
                v, found = method.held_stage(held, q, u, tau, (rates[0], rates[1]), g[()], push,
                                             physical, t)
            else:
                system = linear_system(equations, q, u, tau, push, physical, t)
                found = held_solution(system, system.M, system.net, held)
                v = [] if isinstance(equations, TreeEquations) else coordinate_rates(
                    robot.model, q, system.v)
            margin = [equations.margin(q, t, parameters[-LIMITS:])] if self.watched else []
            return [*v, *(x for part in found for x in part), *margin]
        return trace_program('held_dynamics', dynamics, [
            ('q', (robot.n_q,)), ('u', (robot.n,)), ('tau', (robot.n,)),
            ('held', (len(joints),)), *before, *wrench, *time,
            ('parameters', robot.parameters.block.shape)])


def pulls(stages: Sequence[Any], side: Any) -> list[Any]:
    """Return the largest pull of each stop in several stages, (k,); 0 if it presses."""
    found = [0.0 * s for s in side]
    for forces in stages:
        least = ROUNDING * sum((f * s * select(f * s < 0.0, -1.0, 1.0)
                                for f, s in zip(forces, side)), 0.0)
        pull = [f * s - least for f, s in zip(forces, side)]
        found = [select(x < y, y, x) for x, y in zip(found, pull)]
    return found
