"""Kernels of one integration step of a robot, with its dynamics as subroutines."""

from collections.abc import Sequence
from functools import partial, reduce
from typing import Any, NamedTuple

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.control.computed_torque import law_margin, law_program
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.ball_joints import coordinate_rates, on_unit_quaternions
from kane_dynamics.mechanics.constraints.conditioning import LIMITS
from kane_dynamics.mechanics.constraints.speeds import speed_places
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.integrators import integrator_of
from kane_dynamics.mechanics.integrators.held_joints import (held_solution, linear_system)
from kane_dynamics.mechanics.integrators.interface import StageRates
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.native.tracing.subroutine import call
from kane_dynamics.robot.kernel_set import kernel_per_robot
from kane_dynamics.robot.robot import Robot
import numpy as np


def tau_from(equations: Equations, names: Sequence[str], q: Any, tau: Any,
             t: Any = 0.0) -> Any:
    """Convert forces dual to the named speeds to generalized forces, (n,)."""
    if tuple(names) == equations.speed_names:
        return tau
    state = equations.mechanism.state(q, t, equations.tree.geometry)
    return equations.at_rest(q, t).T.T @ (state.speed_rows(names)[0].T @ tau)


class StepChoice(NamedTuple):
    """Which step a kernel computes: the arguments of `step_kernel` after the robot."""

    feedback: bool
    integrator: str = 'rk4'
    dual_to: tuple[str, ...] | None = None
    followed: Sequence[int] = ()

    def needed(self, robot: Robot) -> 'StepChoice':
        """Return the choice without what changes nothing for this robot."""
        # Torques are dual to the robot's own speeds anyway, and in joint rates no joints
        # are followed.
        dual_to = None if self.dual_to == robot.equations.speed_names else self.dual_to
        follows = self.feedback and not robot.equations.in_joint_rates
        followed = tuple(self.followed) if follows else ()
        return self._replace(dual_to=dual_to, followed=followed)


@kernel_per_robot
def step_kernel(robot: Robot, feedback: bool, integrator: str = 'rk4',
                dual_to: tuple[str, ...] | None = None,
                followed: Sequence[int] = ()) -> Kernel:
    """
    Return the kernel of one step of one of `INTEGRATORS`.

    Its pointers: state, as `state_names`, inputs, constants, next state. With held
    torques the inputs are tau (n) and the constants the step and the robot's parameters.
    With feedback the inputs are q, u and udot desired at the step's beginning, middle
    and end (3, 3 n), and the constants begin with kp and kd; `followed` are the indices
    of the joints that follow, of robots with chosen speeds or constraints. With
    `dual_to`, tau is dual to the speeds of these names.

    The last entry of a constrained robot's state is `conditioning.margin`, whose limits
    are the last of the constants: a state is accepted if it is positive. It is that of
    the step's end, or, for constraints of velocities alone, the smallest of the
    configurations at which the step evaluates the dynamics, where it costs least; see
    `watches_stages`.

    Raises
    ------
    InputError
        The integrator is unknown.

    """
    # The name is checked first; what the robot does not need is left out of the choice.
    integrator_of(integrator)
    choice = StepChoice(feedback, integrator, dual_to, tuple(followed)).needed(robot)
    name, inputs, constants = step_signature(robot, choice)
    step = partial(traced_step, robot, choice)
    return robot.kernels.compiled(step, name, inputs, inputs['state'],
                                  constants=constants)


def step_signature(robot: Robot, choice: StepChoice) -> tuple[str, dict[str, Shape], Shape]:
    """Return name, inputs and constants of the kernel of a step."""
    integrator_of(choice.integrator)
    feedback, integrator, dual_to, followed = choice.needed(robot)
    name = 'step_computed_torque' if feedback else 'step_held_torque'
    if integrator != 'rk4':
        name = f'{name}_{integrator}'
    # The places of speeds and joints tell the kernels of one robot apart.
    if dual_to is not None:
        places = speed_places(robot.mechanism.speeds, dual_to)
        name = f'{name}_dual_to_{"_".join(map(str, places))}'
    if followed:
        name = f'{name}_{"_".join(map(str, followed))}'
    # The constants are the gains of feedback, the step, and the robot's parameters.
    n = robot.n
    parameters = len(robot.parameters.block)
    state = (state_layout(robot).size,)
    if feedback:
        return name, {'state': state, 'inputs': (3, 3 * n)}, (2 * n + 1 + parameters,)
    return name, {'state': state, 'inputs': (1, n)}, (1 + parameters,)


def state_names(robot: Robot) -> tuple[str, ...]:
    """
    Return the names of the entries of a state.

    They are q, the joint rates v, and if needed the time, the deflections of bristles and
    the margin.
    """
    time = robot.equations.time_inputs('time')
    margin = ('margin',) if robot.equations.watched else ()
    bristles = [f'{name}/deflection' for name in robot.equations.tree.bristle_names]
    return (*robot.coordinate_names, *robot.joint_names, *time, *bristles, *margin)


class StateLayout(NamedTuple):
    """Slices of the parts of a state, whose entries are those of `state_names`."""

    q: slice
    v: slice
    time: slice
    deflections: slice
    without_margin: int  # number of entries but for the margin
    size: int


def state_layout(robot: Robot) -> StateLayout:
    """Return the layout of the states of a robot."""
    return _layout(robot, robot.model.n)


def _layout(robot: Robot, speeds: int) -> StateLayout:
    """Return the layout of states with so many speeds."""
    equations = robot.equations
    n_q = equations.n_q
    time = n_q + speeds
    deflections = time + len(equations.time_inputs('time'))
    end = deflections + len(equations.tree.bristles)
    return StateLayout(slice(0, n_q), slice(n_q, time), slice(time, deflections),
                       slice(deflections, end), end, end + int(equations.watched))


def independent_speeds(equations: Equations, q: Vector, v: Vector,
                       t: Scalar = 0.0) -> Vector:
    """Return the independent speeds u = Y v + Z, (n,), in a motion of the joints."""
    if equations.in_joint_rates:
        return v
    Y, Z = equations.state(q, t).speed_rows(equations.speed_names)
    return Y @ v + Z


def times_of(robot: Robot, states: Array) -> Array:
    """Return the times in states, (K, size), as (K,); zeros where the equations have none."""
    part = states[:, state_layout(robot).time]
    return part[:, 0] if part.shape[1] else np.zeros(len(states))


def deflections_of(robot: Robot, states: Array) -> Array:
    """Return the deflections of bristles in states, (..., size), as (..., n_b)."""
    return states[..., state_layout(robot).deflections]


def watches_stages(robot: Robot, q: Vector, t: Scalar) -> bool:
    """
    Return whether a step's margin is the smallest of its stages, not that of its end.

    With closed loops it is that of the step's end, before the loops are closed, where
    the correction needs the same system. With constraints of velocities alone the
    dynamics of the stages need that system; the step's end is then a stage of the next
    step.
    """
    equations = robot.equations
    return equations.watched and not equations.keeps_positions(q, t)


class RobotMotion:
    """A robot during one traced step, in the interface of the integrators (`System`)."""

    def __init__(self, robot: Robot, inputs: Matrix, gains: Vector | None,
                 parameters: Vector, dual_to: tuple[str, ...] | None, watched: bool,
                 followed: Sequence[int], start: Vector, h: Scalar) -> None:
        """
        Store the arguments of the step of length h, which begins at the time `start`, (0 or 1,).

        `gains` is None if torques are held; with `watched`, `margins` collects those of
        stages.
        """
        # The step reads its inputs by moment: 0 at its begin, 1 in the middle, 2 at its
        # end.
        self.robot = robot
        self.equations = robot.equations
        self.bristles = len(robot.equations.tree.bristles)
        self._layout = _layout(robot, robot.n)  # of what is integrated: q, u
        self.watched = watched
        self.margins: list[Scalar] = []
        self._dual_to = dual_to
        self._inputs = inputs
        self._parameters = parameters
        self._gains: Any = gains
        self._start = start
        self._h = h

        # No wrench acts in simulations, but programs may have it as an input.
        no_wrench = robot.kernels.no_wrench
        self._wrench = [no_wrench] if len(no_wrench) else []
        self._law: Program | None = None
        if gains is not None:
            self._law = law_program(robot, followed or None)

    def torque(self, q: Vector, u: Vector, moment: int, *time: Scalar) -> Vector:
        """Return the held torque, or that of the control law; by default at the moment's time."""
        torque: Vector = self._inputs[0]
        if self._law is not None:
            # The law is evaluated at the time of the moment, or of a stage's state.
            time = time or self._time(moment)
            desired = np.split(self._inputs[moment], 3)
            law: Any = call(self._law, q, u, *desired, self._gains, *self._wrench, *time,
                            self._parameters)
            torque = np.array(law)
        return torque

    def _time(self, moment: int) -> tuple[Scalar, ...]:
        """Return the time at a moment, or nothing if the equations do not depend on it."""
        return tuple(t + (0.5 * moment) * self._h for t in self._start)

    def called(self, program: Program, q: Vector, u: Vector, tau: Vector, time: Any,
               *inputs: Any) -> Any:
        """
        Return the results of the dynamics of a stage; their margin, if any, is stored.

        `time` has the time and the deflections of bristles, where there are these.
        """
        # A program of one stage is called, not inlined: all stages share its code.
        results = call(program, q, u, tau, *inputs, *self._wrench, *time,
                       self._parameters)
        if self.watched:
            *results, margin = results
            self.margins.append(margin)
        return results

    @lazy_property
    def _motion(self) -> Program:
        """
        Trace udot; with chosen speeds or constraints, q' and udot.

        Then come the rates of the deflections of bristles and, if `watched`, the margin.
        """
        robot = self.robot
        equations = self.equations
        if equations.in_joint_rates and not self.bristles:
            return robot.kernels.program('forward_dynamics')
        physical = robot.parameters.physical

        # u' for the torque, in whatever speeds the torque is dual to.
        def rates(q: Vector, u: Vector, tau: Vector, *inputs: Any) -> Any:
            wrench, t, parameters, deflections = optional_inputs(robot, inputs)
            if self._dual_to is not None:
                tau = tau_from(equations, self._dual_to, q, tau, t)
            at = wrench, parameters[:physical], t
            if deflections is None:
                state_rates = equations.state_rates(q, u, tau, *at)
            else:
                state_rates = presliding_rates(robot, q, u, tau, *at, deflections)
            # The margin stands last, and shows a singular state without a branch.
            if not self.watched:
                return state_rates
            return [*state_rates, equations.margin(q, t, parameters[-LIMITS:])]
        return trace_program('state_rates', rates, [
            ('q', (robot.n_q,)), ('u', (robot.n,)), ('tau', (robot.n,)),
            *wrench_input(robot), *time_input(robot), *deflection_input(robot),
            ('parameters', robot.parameters.block.shape)])

    def rates(self, state: Vector, moment: int) -> Vector:
        """Return the time derivative of q, u, time, deflections and margin."""
        # The rate of the time is 1, that of the margin 0: steps write it at their end.
        layout = self._layout
        q = state[layout.q]
        u = state[layout.v]
        time = state[layout.time]
        inputs: list[Any] = list(time)
        if self.bristles:
            inputs.append(state[layout.deflections])
        rates = self.called(self._motion, q, u, self.torque(q, u, moment, *time), inputs)
        # In joint rates the coordinates move with u itself.
        if self.equations.in_joint_rates:
            rates = [*u, *rates]
        # The order of the state: q, u, time, deflections, margin; t' = 1, and the margin
        # has no rate.
        end = len(rates) - self.bristles
        return np.array([*rates[:end], *(1.0 for _ in time), *rates[end:],
                         *[0.0] * int(self.equations.watched)])

    @lazy_property
    def _stage(self) -> Program:
        return implicit_stage(self.robot, ImplicitStep(self.equations), self._dual_to,
                              watched=self.watched)

    def implicit_stage(self, q: Vector, u: Vector, tau: Vector,
                       before: StageRates, g: Scalar, moment: int,
                       deflections: Vector) -> StageRates:
        """Return the rates of a stage of the linearly implicit equations."""
        # Without bristles, the rates of the stage before have no third part.
        first: tuple[Any, ...] = before[:2]
        inputs: list[Any] = list(self._time(moment))
        if self.bristles:
            first = before
            inputs.append(deflections)
        rates = self.called(self._stage, q, u, tau, inputs, *first, np.array(g))
        n_j, n = self.robot.model.n, self.robot.n
        return StageRates(*np.split(np.array(rates), [n_j, n_j + n]))

    def quadratures(self, q: Vector, u: Vector, moment: int) -> Vector:
        """Return the rates of time and margin."""
        return np.array([*(1.0 for _ in self._start),
                         *[0.0] * int(self.equations.watched)])


def step_program(robot: Robot, name: str, choice: StepChoice) -> Program:
    """Trace the program of `step_kernel`."""
    _, inputs, constants = step_signature(robot, choice)
    return trace_program(name, partial(traced_step, robot, choice),
                         [*inputs.items(), ('constants', constants)])


def traced_step(robot: Robot, choice: StepChoice, state: Vector, inputs: Matrix,
                constants: Vector, system: Any = RobotMotion) -> Vector:
    """Return the state after one step of a `system`, with the end projected on constraints."""
    n, equations = robot.n, robot.equations
    layout = state_layout(robot)
    feedback, integrator, dual_to, followed = choice.needed(robot)

    start = state[layout.time]
    gain_count = 2 * n if feedback else 0
    gains, h, parameters = np.split(constants, [gain_count, gain_count + 1])
    # With constraints, the margin is that of the stages or of the end; see
    # `watches_stages`.
    keeps_positions = False
    watches_stages = False
    if equations.mechanism.labels:  # loops are closed also where nothing is watched
        keeps_positions = equations.keeps_positions(state[layout.q], *start)
        watches_stages = equations.watched and not keeps_positions
    motion = system(robot, inputs, gains if feedback else None, parameters, dual_to,
                    watches_stages, followed, start, h[0])
    # The equations are integrated in the independent speeds.
    u = independent_speeds(equations, state[layout.q], state[layout.v], *start)
    reduced = np.array([*state[layout.q], *u, *state[layout.v.stop:]])
    after: Vector = integrator_of(integrator).step(motion, reduced, h[0])
    q, u, others = np.split(after, [robot.n_q, robot.n_q + n])
    t = others[0] if len(start) else 0.0
    if not equations.in_joint_rates:
        after = np.array([*q, *equations.joint_speeds(q, u, t), *others])
    # The margin, then one Newton step on the loops and unit quaternions.
    if watches_stages:
        after[-1] = reduce(lambda x, y: select(x < y, x, y), motion.margins)
    elif keeps_positions:
        # No later step reads the margin, so it causes no latency.
        if equations.watched:
            after[-1] = equations.margin(q, t, constants[-LIMITS:])
            closed = equations.closure_step(q, t)
            # A rejected state stays where its margin shows what is wrong.
            q = np.array([select(after[-1] > 0.0, x, y) for x, y in zip(closed, q)])
        else:
            q = equations.closure_step(q, t)
    if robot.model.balls:
        q = on_unit_quaternions(robot.model, q)
    after[layout.q] = q
    # The joints that follow must determine the motion too.
    if followed and equations.watched:
        margin = law_margin(robot, followed, after[layout.q], t)
        if not isinstance(margin, float):
            after[-1] = select(margin < after[-1], margin, after[-1])
    return after


def wrench_input(robot: Robot) -> list[tuple[str, Shape]]:
    """Return the input of wrenches, if the robot declares frames for them."""
    no_wrench = robot.kernels.no_wrench
    return [('wrench', no_wrench.shape)] if len(no_wrench) else []


def time_input(robot: Robot) -> list[tuple[str, Shape]]:
    """Return the input of time, if the equations depend on it."""
    return list(robot.equations.time_inputs(('t', ())))


def deflection_input(robot: Robot) -> list[tuple[str, Shape]]:
    """Return the input of the deflections of bristles, if the robot has any."""
    count = len(robot.equations.tree.bristles)
    return [('deflections', (count,))] if count else []


class OptionalInputs(NamedTuple):
    """Last inputs of a program: wrench or None, time or 0, parameters, deflections or None."""

    wrench: Any
    t: Scalar
    parameters: Vector
    deflections: Vector | None


def optional_inputs(robot: Robot, values: Sequence[Any]) -> OptionalInputs:
    """Return the last inputs of a program: those that its robot has, and the parameters."""
    # They stand in this order, and only where the robot has them.
    *options, parameters = values
    wrench = None
    t: Scalar = 0.0
    deflections = None
    if wrench_input(robot):
        wrench = options.pop(0)
    if time_input(robot):
        t = options.pop(0)[()]
    if options:
        deflections = options.pop(0)
    return OptionalInputs(wrench, t, parameters, deflections)


def implicit_stage(robot: Robot, method: ImplicitStep,
                   dual_to: tuple[str, ...] | None = None,
                   *, watched: bool = False, varied: bool = False) -> Program:
    """
    Trace `ImplicitStep.stage`: its rates and, if `watched`, the margin.

    Its inputs: q, u, tau, results of the first stage, g, factors on friction if
    `varied`, wrench, time, deflections and parameters. With `varied`, friction has no
    bristles.
    """
    equations: Any = robot.equations
    n = robot.n
    n_j = robot.model.n
    # The inputs in the order in which the step supplies them; optional ones only where
    # the robot has them.
    inputs: list[tuple[str, Shape]] = [
        ('q', (robot.n_q,)), ('u', (n,)), ('tau', (n,))]
    first_stage = first_stage_inputs(robot, presliding=not varied)
    inputs += first_stage
    if varied:
        inputs.append(('factors', (n_j,)))
    inputs += [*wrench_input(robot), *time_input(robot)]
    if not varied:
        inputs += deflection_input(robot)
    inputs.append(('parameters', robot.parameters.block.shape))

    def stage(q: Vector, u: Vector, tau: Vector, *inputs: Any) -> list[Scalar]:

        # The first stage of the step supplies its rates, then g = gamma h.
        *first, g = inputs[:len(first_stage)]
        others = inputs[len(first_stage):]
        factors: Any = 1.0
        if varied:
            factors = others[0]
            others = others[1:]
        wrench, t, parameters, deflections = optional_inputs(robot, others)
        # Torques may be dual to other speeds than those of the robot.
        if dual_to is not None:
            tau = tau_from(equations, dual_to, q, tau, t)
        rates = method.stage(q, u, tau, StageRates(*first), g[()], wrench,
                             parameters[:robot.parameters.physical], t, factors,
                             deflections)
        results = [*rates.joints, *rates.udot, *rates.deflections]
        if not watched:
            return results
        return [*results, equations.margin(q, t, parameters[-LIMITS:])]
    return trace_program('implicit_stage', stage, inputs)


def first_stage_inputs(robot: Robot, presliding: bool = True) -> list[tuple[str, Shape]]:
    """Return the inputs of a stage after its torque: rates of the first stage, and g."""
    inputs: list[tuple[str, Shape]] = [('joint_rates', (robot.model.n,)),
                                       ('udot', (robot.n,))]
    if presliding and deflection_input(robot):
        inputs.append(('deflection_rates', deflection_input(robot)[0][1]))
    return [*inputs, ('g', ())]


def presliding_rates(robot: Robot, q: Vector, u: Vector, tau: Vector, wrench: Any,
                     parameters: Vector, t: Scalar, deflections: Vector) -> list[Scalar]:
    """Return q' (but in joint rates), udot, and the rates of the deflections of bristles."""
    equations: Any = robot.equations
    # Bristles bear friction at rest too, so that no joint is held.
    system = linear_system(equations, q, u, tau, wrench, parameters, t, None, deflections)
    solution = held_solution(system, system.M, system.net)
    rates: Vector = ()
    if not equations.in_joint_rates:
        rates = coordinate_rates(robot.model, q, system.v)
    change = equations.deflection_rates(q, system.v, deflections, tau, t)
    return [*rates, *solution.w, *change]
