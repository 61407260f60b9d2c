"""
The native step with given directions of sliding and given joints that stick.

Directions and held joints are arguments, constant in the step: its order is that of the
integrator. A step is valid if no held joint needs more than breakaway friction at its
beginning, no joint that slides changes its direction, and none passes its stop.
`Sticking` computes the other steps, in pieces.
"""

from functools import partial
from typing import Any

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints.conditioning import LIMITS
from kane_dynamics.mechanics.integrators.held_joints import (Held, held_response,
                                                             held_solution,
                                                             linear_system)
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.native.tracing.subroutine import call
from kane_dynamics.simulation.step_kernels import (RobotMotion, step_signature,
                                                   StepChoice, time_input,
                                                   traced_step, wrench_input)
from kane_dynamics.simulation.sticking.friction_state import (driving_torques,
                                                              friction_bounds,
                                                              FrictionModes,
                                                              FrictionState,
                                                              of_all_joints)
from kane_dynamics.simulation.user_speeds import tau_from
import numpy as np

ROUNDING = 1e-12  # of a force that holds a joint, relative
MODES = 4  # rows of an input: directions, sides, lower and upper stops


def sticking_kernel(choice: StepChoice, state: FrictionState, holds: bool) -> Kernel:
    """
    Return the kernel of a step: the state after it, then whether begin and end are valid.

    Parameters
    ----------
    choice : StepChoice
        Of the step with smooth friction, whose inputs it has, and `modes` (4, k).
    state : FrictionState
        With the joints.
    holds : bool
        Whether joints may be held; without any the step takes less time.

    """
    robot = state.robot
    choice = choice.needed(robot)
    k = len(state.joints)
    kind = 'sticking' if holds else 'sliding'
    free, inputs, constants = step_signature(robot, choice)
    name = f'{kind}_{free}_{"_".join(map(str, state.joints))}'
    if state.stops:
        name += '_stops'
    row = partial(_traced_row, state, choice, holds)
    return robot.kernels.compiled(row, name, {**inputs, 'modes': (MODES, k)},
                                  (inputs['state'][0] + 2,), constants=constants)


def _traced_row(contact: FrictionState, choice: StepChoice, holds: bool, state: Vector,
                inputs: Matrix, modes: Matrix, constants: Vector) -> list[Scalar]:
    """Return the state after a step, and whether its begin and its end are valid."""
    robot = contact.robot
    directions, sides, lower, upper = modes
    motions: list[FrictionMotion] = []

    def motion(*arguments: Any) -> FrictionMotion:
        motions.append(FrictionMotion(contact, directions, holds, *arguments))
        return motions[0]
    after = traced_step(robot, choice, state, inputs, constants, motion)

    if holds and contact.constrained:
        after = without_creep(contact, directions, after, constants)

    # The begin: every held joint needs a force within its bounds; stops only press. Self-
    # locking drives that slide are driven.
    begin_valid: Scalar = 1.0
    for driving in motions[0].driving:
        begin_valid = begin_valid * select(driving > 0.0, 1.0, 0.0)
    if holds:
        f, least, largest = motions[0].first
        for direction, side, x, low, high in zip(directions, sides, f, least, largest):
            rounding = ROUNDING * select(x < 0.0, -x, x)
            below = select(side > 0.5, 0.0, select(x < low - rounding, 1.0, 0.0))
            above = select(side < -0.5, 0.0, select(high + rounding < x, 1.0, 0.0))
            moves = direction * direction
            begin_valid = begin_valid * (1.0 - (1.0 - moves) * (below + above))

    # The end: no reversed motion, no joint past its stop, and a regular state.
    n_q, n = robot.n_q, robot.n
    time = after[n_q + n:][:int(robot.equations.timed)]
    equations: Any = robot.equations
    rates = equations.joint_speeds(after[:n_q], after[n_q:n_q + n], *time)
    end_valid: Scalar = 1.0
    for joint, direction, slow in zip(contact.joints, directions, contact.slow):
        reversed_ = select(direction * rates[joint] < -slow, 1.0, 0.0)
        end_valid = end_valid * (1.0 - reversed_)
    if contact.stops:
        for place, side, low, high in zip(contact.places, sides, lower, upper):
            if place >= 0:
                x = after[place]
                past = select(x < low, 1.0, select(high < x, 1.0, 0.0))
                end_valid = end_valid * (1.0 - past * (1.0 - side * side))
    if equations.watched:
        end_valid = end_valid * select(after[-1] > 0.0, 1.0, 0.0)
    for x in after[:n_q + n]:  # of a diverged state nothing is valid
        end_valid = end_valid * select(x * 0.0 < 1.0, 1.0, 0.0)
    return [*after, begin_valid, end_valid]


def without_creep(contact: FrictionState, directions: Vector, after: Vector,
                  constants: Vector) -> Vector:
    """Return a state in which the rates of held joints are zero, by impulses on them."""
    robot = contact.robot
    equations: Any = robot.equations
    n_q, n, joints = robot.n_q, robot.n, contact.joints
    times = time_input(robot)
    parameters = constants[-len(robot.parameters.block):]

    def parts(q: Vector, *inputs: Any) -> Vector:
        t = inputs[0][()] if times else 0.0
        physical = inputs[-1][:robot.parameters.physical]
        motion = equations.at_rest(q, t)
        inverse = equations.inverse_mass_matrix(q, physical, t)
        return np.concatenate([np.ravel(motion.T[joints]), motion.qdot[joints],
                               np.ravel(inverse)])
    program = trace_program('held_rates', parts, [
        ('q', (n_q,)), *times, ('parameters', np.shape(parameters))])
    q, u = after[:n_q], after[n_q:n_q + n]
    time = list(after[n_q + n:][:int(equations.timed)])
    k = len(joints)
    T, X, inverse = np.split(np.array(call(program, q, *time, parameters)),
                             [k * n, k * n + k])
    T, inverse = T.reshape(k, n), inverse.reshape(n, n)
    along = inverse @ T.T
    held = [x * x < 0.5 for x in directions]
    for _ in range(2):  # the second has the error of the regular response
        u = u - along @ held_response(T @ along, held, T @ u + X)
    return np.array([*q, *u, *after[n_q + n:]])


class FrictionMotion(RobotMotion):
    """
    A robot with set-valued friction during one traced step.

    Parameters
    ----------
    contact : FrictionState
        With the joints.
    directions : (k,) array
        1 or -1 of joints that slide, 0 of those that are held.
    holds : bool
        Whether any may be held.
    *arguments
        Of `RobotMotion`.

    """

    def __init__(self, contact: FrictionState, directions: Vector, holds: bool,
                 *arguments: Any) -> None:
        """Begin without stages."""
        super().__init__(*arguments)
        self._contact = contact
        self._directions = directions
        self._holds = holds
        # Of the first stage: what holds joints, and the bounds of friction, (k,) each.
        self.first: Any = None
        self.driving: Vector = ()  # of the first stage, (k,)

    def called(self, program: Program, q: Vector, u: Vector, tau: Vector, time: Any,
               *inputs: Any) -> Any:
        """Return the results of the dynamics of a stage; those of the first are stored."""
        results = super().called(program, q, u, tau, time, self._directions, *inputs)
        k = len(self._contact.joints)
        if self._contact.locks:
            results, driving = np.split(np.array(results), [len(results) - k])
            if not len(self.driving):
                self.driving = driving
        if not self._holds:
            return results
        end = len(results) - 3 * k
        rates, f, least, largest = np.split(np.array(results), [end, end + k, end + 2 * k])
        if self.first is None:
            self.first = f, least, largest
        return rates

    def holding(self, q: Vector, u: Vector, tau: Vector,
                time: Vector) -> tuple[Vector, Vector, Vector]:
        """Return what holds joints at a state, and the bounds of friction, (k,) each."""
        self.first = None
        self.called(self._motion, q, u, tau, time)
        forces: tuple[Vector, Vector, Vector] = self.first
        return forces

    @lazy_property
    def _motion(self) -> Program:
        return self._program(None)

    @lazy_property
    def _stage(self) -> Program:
        return self._program(ImplicitStep(self.equations))

    def _program(self, method: ImplicitStep | None) -> Program:
        """Trace the dynamics of a stage: those of step_kernels, then forces and bounds."""
        robot, dual_to = self.robot, self._dual_to
        equations: Any = robot.equations
        joints = self._contact.joints
        wrenches, times = wrench_input(robot), time_input(robot)
        first_stage: list[tuple[str, Shape]] = []
        if method is not None:
            first_stage = [('joint_rates', (robot.model.n,)), ('udot', (robot.n,)),
                           ('g', ())]

        def dynamics(q: Vector, u: Vector, tau: Vector, directions: Vector,
                     *inputs: Any) -> list[Scalar]:
            # The inputs after those of every stage, in their order; most are optional.
            *options, parameters = inputs
            physical = parameters[:robot.parameters.physical]
            implicit, options = options[:len(first_stage)], options[len(first_stage):]
            wrench = options[0] if wrenches else None
            t = options[-1][()] if times else 0.0
            if dual_to is not None:
                tau = tau_from(equations, dual_to, q, tau, t)
            sliding = of_all_joints(equations, joints, directions)
            held = Held([], [])
            if self._holds:
                held = Held(joints, [x * x < 0.5 for x in directions])
            if method is not None:
                k_v, k_u, g = implicit
                v, solution = method.held_stage(held, q, u, tau, (k_v, k_u), g[()],
                                                wrench, physical, t, directions=sliding)
            else:
                system = linear_system(equations, q, u, tau, wrench, physical, t, sliding)
                solution = held_solution(system, system.M, system.net, held)
                v = []
                if not equations.in_joint_rates:
                    v = coordinate_rates(robot.model, q, system.v)
            results = [*v, *solution.w]
            if self._holds:
                least, largest = friction_bounds(equations, joints, q, tau, t)
                results += [*solution.f, *least, *largest]
            if self._contact.locks:
                rates = equations.joint_speeds(q, u, t)
                results += [*driving_torques(equations, joints, q, rates, tau, directions,
                                             t)]
            if self.watched:
                results.append(equations.margin(q, t, parameters[-LIMITS:]))
            return results
        # Subroutines of one kernel differ in their names.
        name = 'friction_dynamics' if method is None else 'implicit_friction_dynamics'
        if self.watched:
            name = f'watched_{name}'
        return trace_program(name, dynamics, [
            ('q', (robot.n_q,)), ('u', (robot.n,)), ('tau', (robot.n,)),
            ('directions', (len(joints),)), *first_stage, *wrenches, *times,
            ('parameters', robot.parameters.block.shape)])


def mode_rows(state: FrictionState, modes: FrictionModes) -> Matrix:
    """Return the input `modes` of the kernel, (4, k)."""
    return np.array([*modes, *state.finite_stops])
