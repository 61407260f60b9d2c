"""A robot during one traced step in which forces hold joints: stops, or sticking friction."""

from abc import abstractmethod
from typing import Any, ClassVar, NamedTuple

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints.conditioning import LIMITS
from kane_dynamics.mechanics.integrators.held_joints import (held_solution, linear_system,
                                                             Solution, Solver)
from kane_dynamics.mechanics.integrators.interface import StageRates
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.simulation.step_kernels import (deflection_input, first_stage_inputs,
                                                   optional_inputs, RobotMotion,
                                                   tau_from, time_input, wrench_input)
import numpy as np


class HeldStage(NamedTuple):
    """
    A stage of a step: its state, and the solution of its equations of motion.

    `modes`, (k,), say how the k joints move; `t` is 0 where the equations do not depend
    on the time.
    """

    q: Vector
    u: Vector
    tau: Vector
    modes: Vector
    t: Scalar
    solution: Solution


class HeldMotion(RobotMotion):
    """
    A robot during one traced step, some of whose joints may be held.

    Whether a joint is held is a number of the input `modes`, so that one program serves
    every combination. Subclasses say what its values mean and which results they need.

    Parameters
    ----------
    joints : list of int
        Indices of the k joints among the speeds of the joints.
    modes : (k,) array
        How they move in this step.
    *arguments
        Of `RobotMotion`.

    """

    dynamics_name: ClassVar[str]  # of the subroutine
    tree_terms = None  # held joints have stages of their own

    def __init__(self, joints: list[int], modes: Vector, *arguments: Any) -> None:
        """Store the joints and their modes."""
        super().__init__(*arguments)
        self._joints = joints
        self._modes = modes

    @abstractmethod
    def held(self, modes: Vector, q: Vector) -> Solver:
        """Return the solver of a stage."""

    @abstractmethod
    def results(self, stage: HeldStage) -> list[Scalar]:
        """Return the results of a stage that follow its rates."""

    def directions(self, modes: Vector) -> Vector | None:
        """Return the directions of sliding of all joints, (n_j,); None: smooth friction."""
        return None

    def called(self, program: Program, q: Vector, u: Vector, tau: Vector, time: Any,
               *inputs: Any) -> Any:
        """Return the results of the dynamics of a stage in the modes of this step."""
        return super().called(program, q, u, tau, time, self._modes, *inputs)

    @lazy_property
    def _motion(self) -> Program:
        return self._program(None)

    @lazy_property
    def _stage(self) -> Program:
        return self._program(ImplicitStep(self.equations))

    def _program(self, method: ImplicitStep | None) -> Program:
        """Trace the dynamics of a stage, explicit without `method`: rates, then `results`."""
        robot = self.robot
        equations: Any = robot.equations

        # An implicit stage also has the results of the first stage, and its factor g.
        first_stage: list[tuple[str, Shape]] = []
        if method is not None:
            first_stage = first_stage_inputs(robot)

        def dynamics(q: Vector, u: Vector, tau: Vector, modes: Vector,
                     *inputs: Any) -> list[Scalar]:
            options = inputs[len(first_stage):]
            wrench, t, parameters, deflections = optional_inputs(robot, options)
            physical = parameters[:robot.parameters.physical]
            if self._dual_to is not None:
                tau = tau_from(equations, self._dual_to, q, tau, t)

            # Which joints are held, and the directions of those that slide.
            held = self.held(modes, q)
            directions = self.directions(modes)
            # Explicit methods: udot and the forces that hold joints, from M udot = net.
            if method is None:
                system = linear_system(equations, q, u, tau, wrench, physical, t,
                                       directions, deflections)
                solution = held_solution(system, system.M, system.net, held)
                rates: Any = []  # q' = u
                if not equations.in_joint_rates:
                    rates = coordinate_rates(robot.model, q, system.v)
                bent: Any = []  # rates of the deflections of bristles
                if deflections is not None:
                    bent = equations.deflection_rates(q, system.v, deflections, tau, t)
            else:
                # The linearly implicit method solves its own system, held in the same
                # way.
                *first, g = inputs[:len(first_stage)]
                of_stage, solution = method.held_stage(
                    held, q, u, tau, StageRates(*first), g[()], wrench, physical, t,
                    directions=directions, deflections=deflections)
                rates, _, bent = of_stage

            stage = HeldStage(q, u, tau, modes, t, solution)
            results = [*rates, *solution.w, *bent, *self.results(stage)]
            if self.watched:
                results.append(equations.margin(q, t, parameters[-LIMITS:]))
            return results

        # Subroutines of one kernel differ in their names.
        name = self.dynamics_name
        if method is not None:
            name = f'implicit_{name}'
        if self.watched:
            name = f'watched_{name}'
        return trace_program(name, dynamics, [
            ('q', (robot.n_q,)), ('u', (robot.n,)), ('tau', (robot.n,)),
            ('modes', np.shape(self._modes)), *first_stage, *wrench_input(robot),
            *time_input(robot), *deflection_input(robot),
            ('parameters', robot.parameters.block.shape)])
