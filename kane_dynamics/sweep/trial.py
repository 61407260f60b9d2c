"""
Kernels of one trial: the plant, its controller and the recorded outcomes.

The state of a trial is (q, u, time, work, squared error, margin, tau): coordinates, speeds, the
time if the equations depend on it, the work of torques and friction, the integrals of the squared
tracking error of the joints that follow, `conditioning.margin` of constraints, and the torques at
the beginning of the last step. The Runge-Kutta step integrates everything but margin and tau. The
implicit step integrates q and u; the integrals then use the trapezoidal rule.
`constrained_trial` has robots with chosen speeds or constraints.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque import law_program
from kane_dynamics.control.controller import Mode
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.integrators import integrator_of
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, Shape
from kane_dynamics.native.tracing.subroutine import call
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import implicit_stage
import numpy as np

NONE = 'none'
CONTROLLERS = (Mode.COMPUTED_TORQUE.value, Mode.GRAVITY_COMPENSATION.value, NONE)
PAYLOAD = 10  # inertial parameters of a payload, in the order of a robot's parameters


class Parts(NamedTuple):
    """Slices of the entries of a trial's state; time and margin are empty for a tree."""

    q: slice
    u: slice
    time: slice
    work: int
    squared_error: slice
    margin: slice
    tau: slice
    size: int


def parts(n_q: int, n: int, tracked: int, timed: int = 0, margins: int = 0) -> Parts:
    """Return the slices of a trial's state for numbers of its entries."""
    ends = np.cumsum([n_q, n, timed, 1, tracked, margins, n]).tolist()
    q, u, time, work, error, margin, tau = (slice(*x) for x in zip([0, *ends], ends))
    return Parts(q, u, time, work.start, error, margin, tau, ends[-1])


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
    given : Robot
    payload_frame : str, optional
        Frame in which payloads are given. Default: no payload.
    integrator : str
        One of `step_kernels.INTEGRATORS`.
    tracked : sequence of int
        Indices in q of the joints with a tracking error.

    """

    def __init__(self, given: Robot, payload_frame: str | None, integrator: str,
                 tracked: Sequence[int]) -> None:
        """Create the robot; kernels compile at the first use."""
        options = {**given.options, 'payload_frame': payload_frame, 'wrench_frames': ()}
        self.robot = Robot(given.model, **options)
        self.robot.limits = given.limits
        self.frictionless = Robot(given.model, **{**options, 'friction': False})
        self.tracked, self.integrator = list(tracked), integrator_of(integrator)
        self.equations: Any = self.robot.equations
        self.n = self.robot.n
        self.parts = self._parts()
        self._gravity = given.parameters.gravity
        self._carries = payload_frame is not None

    def _parts(self) -> Parts:
        return parts(self.n, self.n, len(self.tracked))

    def step(self, controller: str) -> Kernel:
        """
        Return the kernel of one step with one of `CONTROLLERS`.

        Its arguments are the state, the desired q, u and udot of the tracked joints at the
        beginning, middle and end of the step (3, 3 m), a row of `PlantParameters`, and step and
        gravity (4,).
        """
        if controller not in CONTROLLERS:
            raise InputError(f"controller: '{controller}'; expected one of "
                             f"{', '.join(CONTROLLERS)}")
        name = f'trial_{controller}_{self.integrator.name}_{"_".join(map(str, self.tracked))}'
        return self._kernel(name, partial(self._step, controller),
                            ('state', 'desired', 'plant', 'shared'), (self.parts.size,))

    def energy(self) -> Kernel:
        """Return the kernel of kinetic and potential energy, (2,), J, of a state."""
        return self._kernel('trial_energies', self._energies, ('state', 'plant', 'shared'), (2,))

    def shared(self, step: float) -> Array:
        """Return the arguments that all trials share: step (s) and gravity."""
        return np.array([step, *self._gravity])

    def _kernel(self, name: str, program: Any, names: tuple[str, ...], shape: Shape) -> Kernel:
        shapes = {'state': (self.parts.size,), 'desired': (3, 3 * len(self.tracked)),
                  'plant': (PAYLOAD + 1 + self.robot.model.n + 2 * self.n,), 'shared': (4,)}
        *inputs, constants = names
        return self.robot.kernels.compiled(program, name, {key: shapes[key] for key in inputs},
                                           shape, constants=shapes[constants])

    def _step(self, controller: str, state: Any, desired: Any, plant: Any, shared: Any) -> Any:
        """Return the state after one step."""
        motion = TrialMotion(self, controller, desired, plant, shared)
        q, u = state[self.parts.q], state[self.parts.u]
        after = self.integrator.step(motion, state[:self.parts.tau.start], shared[0])
        return [*after, *motion.law(q, u, desired[0])]

    def law(self, controller: str, gains: Any, assumed: Any) -> Any:
        """Return the control law: torque from q, u and the desired q, u, udot."""
        kernels = self.robot.kernels
        if controller == Mode.COMPUTED_TORQUE:
            computed = law_program(self.robot)
            return lambda q, u, wanted: np.array(
                call(computed, q, u, *np.split(wanted, 3), gains, assumed))
        if controller == Mode.GRAVITY_COMPENSATION:
            weight = kernels.program('gravity_force')
            return lambda q, u, wanted: np.array(call(weight, q, assumed))
        return lambda q, u, wanted: np.zeros(self.n).astype(object)

    def _energies(self, state: Any, plant: Any, shared: Any) -> Any:
        """Return the kinetic and the potential energy, J."""
        q, u, equations = state[self.parts.q], state[self.parts.u], self.equations
        carried, _ = self.parameters(plant, shared)
        return [equations.kinetic_energy(q, u, carried), equations.potential_energy(q, carried)]

    def parameters(self, plant: Any, shared: Any) -> tuple[Any, Any]:
        """Return the parameters of the plant and of the controller's model."""
        gravity, payload = shared[1:], plant[:PAYLOAD]
        if not self._carries:
            return gravity, gravity
        known = plant[PAYLOAD]
        return np.array([*gravity, *payload]), np.array([*gravity, *(known * payload)])


class TrialMotion:
    """A trial during one traced step, in the interface of the integrators (`System`)."""

    def __init__(self, trial: Trial, controller: str, desired: Any, plant: Any,
                 shared: Any) -> None:
        """Split the arguments of the step."""
        self._trial, self._desired, self.equations = trial, desired, trial.equations
        _, _, self._factors, gains = np.split(
            plant, [PAYLOAD, PAYLOAD + 1, PAYLOAD + 1 + trial.robot.model.n])
        self._carried, assumed = trial.parameters(plant, shared)
        self.law = trial.law(controller, gains, assumed)

    def _squared_errors(self, q: Any, moment: int) -> Any:
        """Return the squared errors of the tracked joints."""
        tracked = self._trial.tracked
        error = self._desired[moment][:len(tracked)] - q[tracked]
        return error * error

    @lazy_property
    def _forward(self) -> Program:
        return self._trial.frictionless.kernels.program('forward_dynamics')

    @lazy_property
    def _stage(self) -> Program:
        return implicit_stage(self._trial.robot, ImplicitStep(self.equations), varied=True)

    def _net_torque(self, q: Any, u: Any, moment: int) -> Any:
        """Return the torque of the controller minus the plant's friction."""
        return (self.law(q, u, self._desired[moment])
                - self._factors * self.equations.friction_force(u))

    def rates(self, state: Any, moment: int) -> Any:
        """Return the time derivative of q, u, work and squared errors."""
        q, u = state[self._trial.parts.q], state[self._trial.parts.u]
        net = self._net_torque(q, u, moment)
        return np.array([*u, *call(self._forward, q, u, net, self._carried), net @ u,
                         *self._squared_errors(q, moment)])

    def torque(self, q: Any, u: Any, moment: int) -> Any:
        """Return the torque of the controller and the plant's deviation from model friction."""
        return (self.law(q, u, self._desired[moment])
                + (1.0 - self._factors) * self.equations.friction_force(u))

    def implicit_stage(self, q: Any, u: Any, tau: Any, before: tuple[Any, Any], g: Any,
                       moment: int) -> tuple[Any, Any]:
        """Return joint rates and udot of a stage of the linearly implicit equations."""
        found = np.array(call(self._stage, q, u, tau, *before, np.array(g), self._factors,
                              self._carried))
        return found[:self._trial.n], found[self._trial.n:]

    def quadratures(self, q: Any, u: Any, moment: int) -> Any:
        """Return the rates of work and squared errors."""
        return np.array([self._net_torque(q, u, moment) @ u, *self._squared_errors(q, moment)])
