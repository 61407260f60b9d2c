"""
Kernels of one trial: the plant, its controller and the recorded outcomes.

The state of a trial is (q, u, time, work, squared error, margin, tau): coordinates,
speeds, the time if the equations depend on it, the work of torques and friction, the
integrals of the squared tracking error of the joints that follow, `conditioning.margin`
of constraints, and the torques at the beginning of the last step. The Runge-Kutta step
integrates everything but margin and tau. The implicit step integrates q and u; the
integrals then use the trapezoidal rule.

With q' = T u + X and the friction f of the joints, the net generalized force is tau -
T^T f. The step is that of `simulate`: the integrator, one Newton step on the loops, and
the margin of the state, which is positive where the independent speeds are well
conditioned and the loops closed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.control.computed_torque import law_margin, law_program
from kane_dynamics.control.controller import Mode
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.ball_joints import on_unit_quaternions
from kane_dynamics.mechanics.constraints.conditioning import (EXCESS, in_lengths,
                                                              limits_of, loosened,
                                                              WELL_CHOSEN)
from kane_dynamics.mechanics.integrators import integrator_of
from kane_dynamics.mechanics.integrators.interface import StageRates
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.native.tracing.subroutine import call
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.energy_balance import prescribes_motion
from kane_dynamics.simulation.speed_choice import STEP_RESIDUAL
from kane_dynamics.simulation.step_kernels import implicit_stage, time_input
import numpy as np

NONE = 'none'
CONTROLLERS = (Mode.COMPUTED_TORQUE.value, Mode.GRAVITY_COMPENSATION.value, NONE)
PAYLOAD = 10  # inertial parameters of a payload, in the order of a robot's parameters

# The torque of a controller from q, u, the desired motion of the tracked joints, (3 m,),
# and the time, (0 or 1,).
Law = Callable[[Vector, Vector, Vector, Vector], Vector]


class TrialParts(NamedTuple):
    """Slices of the entries of a trial's state; time and margin may be empty."""

    q: slice
    u: slice
    time: slice
    work: int
    squared_error: slice
    margin: slice
    tau: slice
    size: int


def parts_of(robot: Robot, tracked: int) -> TrialParts:
    """Return the slices of a trial's state for a number of tracked joints."""
    equations = robot.equations
    sizes = [robot.n_q, robot.n, len(time_input(robot)), 1, tracked,
             int(equations.watched), robot.n]
    ends = np.cumsum(sizes).tolist()
    begins = [0, *ends[:-1]]
    q, u, time, work, error, margin, tau = map(slice, begins, ends)
    return TrialParts(q, u, time, work.start, error, margin, tau, ends[-1])


@dataclass(frozen=True)
class PlantParameters:
    """
    Parameters that vary between trials, as rows for the kernels.

    Attributes
    ----------
    payload : (N, 10) array
        Inertial parameters of the payload: m, m c, second moments.
    known : (N, 1) array
        Fraction of the payload in the controller's model.
    friction : (N, n_j) array
        Factors on the friction of the joints.
    kp, kd : (N, n) arrays
        Gains of computed torque, of the joints that follow, 1/s^2 and 1/s.

    """

    payload: Array
    known: Array
    friction: Array
    kp: Array
    kd: Array

    @property
    def rows(self) -> Array:
        """Return all parameters in one array, (N, 11 + n_j + 2 n)."""
        return np.ascontiguousarray(np.concatenate(
            [self.payload, self.known, self.friction, self.kp, self.kd], axis=1))


class Trial:
    """
    Kernels of a robot's trials, each compiled at its first use.

    Parameters
    ----------
    robot : Robot
        The robot of the user.
    payload_frame : str, optional
        Frame in which payloads are given. Default: no payload.
    integrator : str
        One of `mechanics.integrators.INTEGRATORS`.
    tracked : sequence of int
        Indices in q of the joints with a tracking error.
    followed : sequence of int
        Indices in q of the joints that follow by computed torque, among the tracked
        ones.

    """

    def __init__(self, robot: Robot, payload_frame: str | None, integrator: str,
                 tracked: Sequence[int], followed: Sequence[int] = ()) -> None:
        """Create the robots; kernels compile at the first use."""
        options = {**robot.options, 'payload_frame': payload_frame, 'wrench_frames': ()}
        self.robot = Robot(robot.model, **options)
        self.robot.limits = robot.limits
        # The friction of the plant varies, so its equations are those without friction.
        self.frictionless = Robot(robot.model, **{**options, 'friction': False})
        self.tracked, self.followed = list(tracked), list(followed)
        self.integrator = integrator_of(integrator)
        self.equations: Any = self.robot.equations
        self.n = self.robot.n
        # The layout of a trial's state, and the limits within which its speeds count as
        # regular.
        self.parts = parts_of(self.robot, len(self.tracked))
        self._gravity = robot.parameters.gravity
        self._carries = payload_frame is not None
        mechanism = self.robot.mechanism
        self._limits = limits_of(WELL_CHOSEN * float(np.sqrt(mechanism.model.n)),
                                 in_lengths(mechanism,
                                            loosened(mechanism, STEP_RESIDUAL)),
                                 loosened(mechanism, EXCESS))

    def step(self, controller: str) -> Kernel:
        """
        Return the kernel of one step with one of `CONTROLLERS`.

        Its arguments are the state, the desired q, u and udot of the tracked joints at
        the beginning, middle and end of the step (3, 3 m), a row of `PlantParameters`,
        and step and gravity (4,).
        """
        if controller not in CONTROLLERS:
            raise InputError(f"controller: '{controller}'; expected one of "
                             f"{', '.join(CONTROLLERS)}")
        places = '_'.join(map(str, self.tracked))
        name = f'trial_{controller}_{self.integrator.name}_{places}'
        return self._kernel(name, partial(self._step, controller),
                            ('state', 'desired', 'plant', 'shared'), (self.parts.size,))

    def energy(self) -> Kernel:
        """Return the kernel of kinetic and potential energy, (2,), J, of a state."""
        return self._kernel('trial_energies', self._energies,
                            ('state', 'plant', 'shared'), (2,))

    def shared(self, step: float) -> Array:
        """Return the arguments that all trials share: step (s) and gravity."""
        return np.array([step, *self._gravity])

    def _kernel(self, name: str, function: Any, names: tuple[str, ...],
                shape: Shape) -> Kernel:
        """Return the kernel of a function of arguments of these names."""
        shapes = {'state': (self.parts.size,), 'desired': (3, 3 * len(self.tracked)),
                  'plant': (PAYLOAD + 1 + self.robot.model.n + 2 * self.n,),
                  'shared': (4,)}
        *inputs, constants = names
        return self.robot.kernels.compiled(function, name,
                                           {key: shapes[key] for key in inputs},
                                           shape, constants=shapes[constants])

    def _step(self, controller: str, state: Vector, desired: Matrix, plant: Vector,
              shared: Vector) -> list[Scalar]:
        """Return the state after one step."""
        at, equations = self.parts, self.equations
        motion = TrialMotion(self, controller, desired, plant, shared, state[at.time])
        after = self.integrator.step(motion, state[:at.tau.start], shared[0])
        # The margin of the end, then one Newton step on the loops and unit quaternions.
        q, t = after[at.q], time_of(after[at.time])
        watched = range(at.margin.start, at.margin.stop)
        for k in watched:
            after[k] = equations.margin(q, t, self._limits)
        if equations.keeps_positions(q, t):
            q = equations.closure_step(q, t)
        q = on_unit_quaternions(self.robot.model, q)
        after[at.q] = q
        # The joints that follow must determine the motion too.
        if controller == Mode.COMPUTED_TORQUE:
            for k in watched:
                margin = law_margin(self.robot, self.followed, q, t)
                if not isinstance(margin, float):
                    after[k] = select(margin < after[k], margin, after[k])
        tau = motion.law(state[at.q], state[at.u], desired[0], state[at.time])
        return [*after, *tau]

    def law(self, controller: str, gains: Vector, assumed: Vector) -> Law:
        """Return a control law with gains and the parameters of the controller's model."""
        parameters = padded(self.robot, assumed)
        if controller == NONE:
            # Laws without feedback have no gains.
            return lambda q, u, desired, time: np.zeros(self.n).astype(object)
        if controller == Mode.GRAVITY_COMPENSATION:
            gravity = self.robot.kernels.program('gravity_force')
            return lambda q, u, desired, time: np.array(
                call(gravity, q, *time, parameters))
        # Computed torque follows some of the tracked joints.
        program = law_program(self.robot, self.followed)
        columns = list(map(self.tracked.index, self.followed))

        def computed_torque(q: Vector, u: Vector, desired: Vector,
                            time: Vector) -> Vector:
            motion = (x[columns] for x in np.split(desired, 3))
            tau: Any = call(program, q, u, *motion, gains, *time, parameters)
            return np.array(tau)
        return computed_torque

    def _energies(self, state: Vector, plant: Vector, shared: Vector) -> list[Scalar]:
        """Return the kinetic and the potential energy, J."""
        q, u, equations = state[self.parts.q], state[self.parts.u], self.equations
        carried, _ = self.parameters(plant, shared)
        t = time_of(state[self.parts.time])
        return [equations.kinetic_energy(q, u, carried, t),
                equations.potential_energy(q, carried, t)]

    def parameters(self, plant: Vector, shared: Vector) -> tuple[Vector, Vector]:
        """Return the parameters of the plant and of the controller's model."""
        gravity, payload = shared[1:], plant[:PAYLOAD]
        if not self._carries:
            return gravity, gravity
        known = plant[PAYLOAD]
        return np.array([*gravity, *payload]), np.array([*gravity, *(known * payload)])

    @lazy_property
    def motion_program(self) -> Program:
        """Return the program of q', udot and the power that changes the energy, (n_q + n + 1,)."""
        free: Any = self.frictionless.equations
        tree, driven = self.equations.tree, prescribes_motion(self.robot)

        def rates(q: Vector, u: Vector, tau: Vector, factors: Vector,
                  *inputs: Any) -> list[Scalar]:
            *time, parameters = inputs
            t = time[0][()] if time else 0.0
            # Friction scaled by the trial's factors, which multiply the whole law.
            motion = free.joint_motion(q, u, free.zeros, t)
            if tree.carries_loads:
                torques = self.equations.drive_torques(q, tau, t)
                friction = torques - tree.drive_loads(motion.qdot, torques, factors)
            else:
                friction = tree.scaled_friction(motion.qdot, factors)
            net = tau - motion.projected(friction)
            # Moving constraints do work as well, so that power is counted joint by
            # joint.
            power = net @ u
            if driven:
                forces = free.actual_joint_forces(q, u, net, parameters, t)
                power = forces @ motion.qdot
            return [*free.state_rates(q, u, net, None, parameters, t), power]
        return trace_program('trial_rates', rates, [
            ('q', (self.robot.n_q,)), ('u', (self.n,)), ('tau', (self.n,)),
            ('factors', (self.robot.model.n,)), *time_input(self.robot),
            ('parameters', (self.robot.parameters.physical,))])


class TrialMotion:
    """
    A trial during one traced step, in the interface of the integrators (`System`).

    Parameters
    ----------
    trial : Trial
        The trial.
    controller, desired, plant, shared
        Arguments of the step, as of `Trial.step`.
    start : (0 or 1,) array
        The time at its beginning.

    """

    bristles = 0  # sweeps have the law of friction without presliding

    def __init__(self, trial: Trial, controller: str, desired: Matrix, plant: Vector,
                 shared: Vector, start: Vector) -> None:
        """Split the arguments of the step."""
        self._trial, self._desired, self.equations = trial, desired, trial.equations
        self._start, self._h = start, shared[0]
        _, _, self._factors, gains = np.split(
            plant, [PAYLOAD, PAYLOAD + 1, PAYLOAD + 1 + trial.robot.model.n])
        self._carried, assumed = trial.parameters(plant, shared)
        self.law = trial.law(controller, gains, assumed)

    def _time(self, moment: int) -> Vector:
        """Return the time at a moment, or nothing if the equations do not depend on it."""
        return np.array([t + (0.5 * moment) * self._h for t in self._start])

    def _rates(self, q: Vector, u: Vector, moment: int, time: Vector) -> list[Scalar]:
        """Return q', udot and the power."""
        tau = self.law(q, u, self._desired[moment], time)
        rates: list[Scalar] = call(self._trial.motion_program, q, u, tau, self._factors,
                                   *time,
                                   self._carried)
        return rates

    def rates(self, state: Vector, moment: int) -> Vector:
        """Return the time derivative of q, u, time, work, squared errors and margin."""
        at = self._trial.parts
        q, time = state[at.q], state[at.time]
        *motion, power = self._rates(q, state[at.u], moment, time)
        return np.array([*motion, *self._integrands(q, moment, power)])

    def _integrands(self, q: Vector, moment: int, power: Scalar) -> list[Scalar]:
        """Return the rates of time, work, squared errors and margin."""
        tracked, margins = self._trial.tracked, self._trial.parts.margin
        error = self._desired[moment][:len(tracked)] - q[tracked]
        return [*(1.0 for _ in self._start), power, *(error * error),
                *[0.0] * (margins.stop - margins.start)]

    def torque(self, q: Vector, u: Vector, moment: int) -> Vector:
        """Return the torque of the controller and the plant's deviation from model friction."""
        time = self._time(moment)
        motion = self.equations.joint_motion(q, u, self.equations.zeros, time_of(time))
        tree = self.equations.tree
        tau: Vector = self.law(q, u, self._desired[moment], time)
        if tree.carries_loads:
            # The torque that gives the drives their loads with the model's friction.
            torques = self.equations.drive_torques(q, tau, time_of(time))
            loads = tree.drive_loads(motion.qdot, torques, self._factors)
            return motion.projected(loads + tree.friction_force(motion.qdot, loads))
        deviation = (tree.friction_force(motion.qdot)
                     - tree.scaled_friction(motion.qdot, self._factors))
        return tau + motion.projected(deviation)

    @lazy_property
    def _stage(self) -> Program:
        return implicit_stage(self._trial.robot, ImplicitStep(self.equations),
                              varied=True)

    def implicit_stage(self, q: Vector, u: Vector, tau: Vector,
                       before: StageRates, g: Scalar, moment: int,
                       deflections: Vector) -> StageRates:
        """Return the rates of a stage of the linearly implicit equations."""
        robot = self._trial.robot
        rates: Any = call(self._stage, q, u, tau, *before[:2], np.array(g), self._factors,
                          *self._time(moment), padded(robot, self._carried))
        n_j = robot.model.n
        return StageRates(np.array(rates[:n_j]), np.array(rates[n_j:]))

    def quadratures(self, q: Vector, u: Vector, moment: int) -> Vector:
        """Return the rates of time, work, squared errors and margin."""
        *_, power = self._rates(q, u, moment, self._time(moment))
        return np.array(self._integrands(q, moment, power))


def time_of(time: Vector) -> Scalar:
    """Return the time of an array with one entry, or 0."""
    return time[0] if len(time) else 0.0


def padded(robot: Robot, parameters: Vector) -> Vector:
    """Return parameters as the robot's own, with limits of margins that no law reads."""
    return np.array([*parameters, *[0.0] * robot.equations.limits])
