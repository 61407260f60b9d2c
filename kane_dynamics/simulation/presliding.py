"""
Accelerations, friction and energy of joints with bristles, at states of a simulation.

The deflections of the bristles are states beside q and u (`step_kernels.state_names`),
and the law is that of `mechanics.friction`. The steps of the integrators are those of
`step_kernels`.
"""

from typing import Any, NamedTuple, Protocol

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Flags, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.integrators.held_joints import (held_solution, linear_system)
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.observers import Chunk, Observer
from kane_dynamics.simulation.step_kernels import deflections_of
from kane_dynamics.simulation.step_size import REAL_RADIUS, settling_rates
import numpy as np


class FrictionSamples(NamedTuple):
    """
    Accelerations, forces and sticking joints at K states.

    Attributes
    ----------
    udot : (K, n) array
    stop_forces : (K, n_j) array
        Forces of the stops on the joints, N m or N.
    sticking : (K, n_j) array of bool
        Which joints friction holds.
    friction : (K, n_j) array
        Torques that overcome the friction of the joints, N m or N.

    """

    udot: Array
    stop_forces: Array
    sticking: Flags
    friction: Array


class StateFriction(Protocol):
    """The friction of a robot at states of a simulation, whichever law it has."""

    sticking: bool  # whether friction of joints is set-valued

    def at_samples(self, states: Array, tau: Array, times: Array) -> Any:
        """Return accelerations, forces of stops and friction at K states, (K, size)."""


class BristleFriction:
    """
    The friction of a robot with bristles at states of a simulation.

    Parameters
    ----------
    robot : Robot
        The simulated robot, in the speeds of the states.

    """

    sticking = False

    def __init__(self, robot: Robot) -> None:
        """Store the robot."""
        self.robot = robot

    @lazy_property
    def kernel(self) -> Kernel:
        """Return the kernel of udot, (n,), friction, (n_j,), and the energy of bristles."""
        equations: Any = self.robot.equations
        tree = equations.tree

        def forces(q: Vector, u: Vector, tau: Vector, deflections: Vector, t: Scalar,
                   parameters: Vector) -> Vector:
            # The deflections decide the friction, and with it udot: M udot = net.
            system = linear_system(equations, q, u, tau, None, parameters, t, None,
                                   deflections)
            solution = held_solution(system, system.M, system.net)
            friction = equations.driven_friction(q, system.v, tau, t, None, deflections)
            energy = tree.bristle_energy(deflections)
            return np.array([*solution.w, *friction, energy])
        n, n_b = self.robot.n, len(tree.bristles)
        return self.robot.compiled(forces, name='forces_of_bristles', q=(self.robot.n_q,),
                                   u=(n,), tau=(n,), deflections=(n_b,),
                                   shape=(n + tree.n + 1,))

    def rows_at(self, states: Array, tau: Array, times: Array) -> Array:
        """Return the results of the kernel at K states, (K, size)."""
        n_q = self.robot.n_q
        # The entries of the states, as the kernel's arguments.
        n = self.robot.n
        inputs = [states[:, :n_q], states[:, n_q:n_q + n], tau,
                  deflections_of(self.robot, states),
                  *self.robot.equations.time_inputs(times)]
        rows = np.empty((len(states), *self.kernel.shape))
        arrays = [np.ascontiguousarray(x, dtype=np.float64) for x in inputs]
        self.kernel.run(arrays, rows, len(rows))
        return rows

    def at_samples(self, states: Array, tau: Array, times: Array) -> FrictionSamples:
        """Return accelerations, forces of stops and friction at K states, (K, size)."""
        n, n_j = self.robot.n, self.robot.model.n
        rows = self.rows_at(states, tau, times)
        udot = np.ascontiguousarray(rows[:, :n])
        stop_forces = np.zeros((len(states), n_j))
        # Bristles never hold a joint: it creeps with their deflection.
        held = np.zeros((len(states), n_j), dtype=bool)
        return FrictionSamples(udot, stop_forces, held, rows[:, n:n + n_j])


def bristle_friction(robot: Robot) -> BristleFriction:
    """Return the `BristleFriction` of a robot, made once and kept with it."""
    kept = robot.kernels.kept
    if ('bristles',) not in kept:
        kept['bristles',] = BristleFriction(robot)
    friction: BristleFriction = kept['bristles',]
    return friction


def bristle_energies(robot: Robot, states: Array) -> Array:
    """Return the energies of the bristles in states, (..., size), J."""
    stiffness = np.array([joint.presliding_stiffness
                          for joint in robot.equations.tree.bristles])
    energies: Array = 0.5 * deflections_of(robot, states)**2 @ stiffness
    return energies


class SettlingWatch(Observer):
    """
    Watches that the step of an explicit method resolves how fast bristles settle.

    Parameters
    ----------
    robot : Robot
    step : float
        s.
    single : bool
        Leave out the number of the simulation.

    """

    def __init__(self, robot: Robot, step: float, single: bool) -> None:
        """Begin without a state at which the step is too long."""
        self._robot, self._step, self._single = robot, step, single
        self._text: str | None = None

    def look(self, chunk: Chunk) -> None:
        """Look at the states of a chunk until the step is too long at one of them."""
        if self._text is not None:
            return
        n_q, n = self._robot.n_q, self._robot.n
        states = chunk.energetics.in_user_speeds(chunk.states, chunk.done)
        for i, rows in enumerate(states):
            q = np.ascontiguousarray(rows[:, :n_q])
            u = np.ascontiguousarray(rows[:, n_q:n_q + n])
            decays = settling_rates(self._robot, q, u, chunk.times)
            # A bristle settles like x' = -decay x, which the method follows up to this
            # product.
            too_fast = decays * self._step > REAL_RADIUS
            if too_fast.any():
                k, j = np.argwhere(too_fast)[0]
                self._note(i, chunk.times[k], j, decays[k, j])
                return

    def _note(self, simulation: int, t: float, joint: int, decay: float) -> None:
        """Store the text of the warning."""
        which = '' if self._single else f'simulation {simulation}: '
        name = self._robot.equations.tree.bristle_names[joint]
        # The first step that is too long is so by little: with all digits that differ.
        longest = f'{REAL_RADIUS / decay:.2g}'
        if float(longest) >= self._step:
            longest = f'{REAL_RADIUS / decay:.6g}'
        self._text = (f'{which}from {t:.6g} s on a step of {self._step:g} s is too long for '
                      f"the bristles of joint '{name}' with 'rk4'; expected at most "
                      f"{longest} s at this speed, or the integrator 'implicit'")

    def warning(self) -> str | None:
        """Return the text, or None."""
        return self._text


def require_no_bristles(robot: Robot, what: str) -> None:
    """Raise InputError if the friction of a joint has a state of its own."""
    for joint in robot.equations.tree.bristles:
        raise InputError(f"{what}: joint '{joint.name}' has presliding_stiffness "
                         f'{joint.presliding_stiffness:g}; expected none (0)')
