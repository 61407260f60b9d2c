"""
Kernels of one trial: the plant, its controller and the recorded outcomes.

The state of a trial is (q, u, work, squared error, tau): n coordinates, n speeds, the work of
torques and friction, the n integrals of the squared tracking error, and the n torques at the
beginning of the last step. The Runge-Kutta step integrates everything but tau. The implicit step
integrates q and u; the integrals then use the trapezoidal rule.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque_law import law_program
from kane_dynamics.control.controller import Mode
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from kane_dynamics.mechanics.integrators.runge_kutta import runge_kutta_4
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.model.model import Model
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.native.tracing.subroutine import call
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import implicit_rates
import numpy as np

NONE = 'none'
CONTROLLERS = (Mode.COMPUTED_TORQUE.value, Mode.GRAVITY_COMPENSATION.value, NONE)
PAYLOAD = 10  # inertial parameters of a payload, in the order of a robot's parameters


class Parts(NamedTuple):
    """Slices of the entries of a trial's state."""

    q: slice
    u: slice
    work: int
    squared_error: slice
    tau: slice
    size: int


def parts(n: int) -> Parts:
    """Return the slices of a trial's state for n coordinates."""
    return Parts(slice(0, n), slice(n, 2 * n), 2 * n, slice(2 * n + 1, 3 * n + 1),
                 slice(3 * n + 1, 4 * n + 1), 4 * n + 1)


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
    friction : (N, n) array
        Factors on the model's friction.
    kp, kd : (N, n) arrays
        Gains of computed torque, 1/s^2 and 1/s.

    """

    payload: Array
    known: Array
    friction: Array
    kp: Array
    kd: Array

    @property
    def rows(self) -> Array:
        """Return all parameters in one array, (N, 11 + 3 n)."""
        return np.ascontiguousarray(np.concatenate(
            [self.payload, self.known, self.friction, self.kp, self.kd], axis=1))


class Trial:
    """
    Kernels of a model's trials, each compiled at its first use.

    Parameters
    ----------
    model : Model
    payload_frame : str, optional
        Frame in which payloads are given. Default: no payload.
    integrator : str
        One of `step_kernels.INTEGRATORS`.

    """

    def __init__(self, model: Model, payload_frame: str | None = None,
                 integrator: str = 'rk4') -> None:
        """Create the robot; kernels compile at the first use."""
        self.robot = Robot(model, payload_frame=payload_frame)
        self._frictionless = Robot(model, payload_frame=payload_frame, friction=False)
        assert isinstance(self.robot.equations, TreeEquations)  # a plain tree
        self._equations = self.robot.equations
        self.n = self.robot.n
        self.parts = parts(self.n)
        self._carries = payload_frame is not None
        self._implicit = integrator == 'implicit'

    def step(self, controller: str) -> Kernel:
        """
        Return the kernel of one step with one of `CONTROLLERS`.

        Its arguments are the state, the desired q, u and udot at the beginning, middle and end of
        the step (3, 3 n), a row of `PlantParameters`, and step and gravity (4,).
        """
        if controller not in CONTROLLERS:
            raise InputError(f"controller: '{controller}'; expected one of "
                             f"{', '.join(CONTROLLERS)}")
        name, step = ((f'trial_{controller}_implicit', self._implicit_step) if self._implicit
                      else (f'trial_{controller}', self._step))
        return self._kernel(name, partial(step, controller),
                            ('state', 'desired', 'plant', 'shared'), (self.parts.size,))

    def energy(self) -> Kernel:
        """Return the kernel of kinetic and potential energy, (2,), J, of a state."""
        return self._kernel('trial_energies', self._energies, ('state', 'plant', 'shared'), (2,))

    def shared(self, step: float) -> Array:
        """Return the arguments that all trials share: step (s) and gravity."""
        return np.array([step, *self.robot.model.gravity])

    def _kernel(self, name: str, program: Any, names: tuple[str, ...], shape: Shape) -> Kernel:
        shapes = {'state': (self.parts.size,), 'desired': (3, 3 * self.n),
                  'plant': (PAYLOAD + 1 + 3 * self.n,), 'shared': (4,)}
        inputs = [(key, shapes[key]) for key in names]

        def traced() -> Program:
            return trace_program(name, program, inputs)
        return self.robot.kernels.extra(name, traced, [Argument(*x) for x in inputs[:-1]],
                                        np.zeros(4), shape)

    def _step(self, controller: str, state: Any, desired: Any, plant: Any, shared: Any) -> Any:
        """Return the state after one Runge-Kutta step."""
        n, equations, at = self.n, self._equations, self.parts
        _, _, factors, gains = np.split(plant, [PAYLOAD, PAYLOAD + 1, PAYLOAD + 1 + n])
        carried, assumed = self._parameters(plant, shared)
        motion = self._frictionless.kernels.program('forward_dynamics')
        law = self._law(controller, gains, assumed)

        def rates(x: Any, wanted: Any) -> Any:
            q, u = x[at.q], x[at.u]
            tau = law(q, u, wanted)
            net = tau - factors * equations.friction_force(u)
            error = wanted[:n] - q
            return np.array([*u, *call(motion, q, u, net, carried), net @ u,
                             *(error * error)])
        after = runge_kutta_4(rates, state[:at.tau.start], desired, shared[0])
        return [*after, *law(state[at.q], state[at.u], desired[0])]

    def _implicit_step(self, controller: str, state: Any, desired: Any, plant: Any, shared: Any
                       ) -> Any:
        """Return the state after one implicit (Rosenbrock) step."""
        n, equations, at = self.n, self._equations, self.parts
        _, _, factors, gains = np.split(plant, [PAYLOAD, PAYLOAD + 1, PAYLOAD + 1 + n])
        carried, assumed = self._parameters(plant, shared)
        method, h = ImplicitStep(equations), shared[0]
        motion = implicit_rates(self.robot, method)
        law = self._law(controller, gains, assumed)

        def torque(q: Any, u: Any, moment: int) -> Any:  # with the friction factors
            return (law(q, u, desired[2 * moment])
                    + (1.0 - factors) * equations.friction_force(u))

        def rates(q: Any, u: Any, tau: Any, resistance: Any, g: Any) -> Any:
            return np.array(call(motion, q, u, tau, resistance, np.array(g), carried))

        def running(q: Any, u: Any, wanted: Any) -> Any:
            error = wanted[:n] - q
            power = (law(q, u, wanted) - factors * equations.friction_force(u)) @ u
            return np.array([power, *(error * error)])
        q, u = state[at.q], state[at.u]
        q_1, u_1 = method.step(rates, q, u, torque, h,
                               lambda u: factors * method.resistance(u))
        sums = state[at.work:at.tau.start] + (0.5 * h) * (
            running(q, u, desired[0]) + running(q_1, u_1, desired[2]))
        return [*q_1, *u_1, *sums, *law(q, u, desired[0])]

    def _law(self, controller: str, gains: Any, assumed: Any) -> Any:
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
        q, u, equations = state[self.parts.q], state[self.parts.u], self._equations
        carried, _ = self._parameters(plant, shared)
        return [equations.kinetic_energy(q, u, carried), equations.potential_energy(q, carried)]

    def _parameters(self, plant: Any, shared: Any) -> tuple[Any, Any]:
        """Return the parameters of the plant and of the controller's model."""
        gravity, payload = shared[1:], plant[:PAYLOAD]
        if not self._carries:
            return gravity, gravity
        known = plant[PAYLOAD]
        return np.array([*gravity, *payload]), np.array([*gravity, *(known * payload)])
