"""
Accelerations, friction and sticking joints at samples of a simulation with exact friction.

The native search of `transition_kernel` says how the joints move from each sample on, as at
the beginning of a step. Self-locking drives, which it does not know, have the search of
`friction_state` in Python.
"""

from kane_dynamics._util.typing import Array
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import StepChoice
from kane_dynamics.simulation.sticking.friction_state import (friction_state,
                                                              FrictionModes,
                                                              FrictionSamples,
                                                              FrictionState, NEGLIGIBLE,
                                                              stops_of)
from kane_dynamics.simulation.sticking.transition_kernel import (settled_modes,
                                                                 settling_kernel)
import numpy as np


class ExactFriction:
    """
    Set-valued friction at states of a simulation.

    Parameters
    ----------
    contact : FrictionState
        With the joints, and the stops if they act.

    """

    sticking = True

    def __init__(self, contact: FrictionState) -> None:
        """Store the joints."""
        self._contact = contact
        # The search of a step of 1 s under held torques.
        self._kernel = settling_kernel(StepChoice(False, dual_to=contact.dual_to), contact)

    def compile_kernels(self) -> None:
        """Compile the kernels."""
        self._contact.kernel.compile_lanes()
        if not self._contact.locks:
            self._kernel.compile()

    def at_samples(self, states: Array, tau: Array, times: Array) -> FrictionSamples:
        """Return accelerations, forces and sticking joints at K states, (K, size)."""
        contact = self._contact
        robot = contact.robot
        directions, sides = self.modes_at(states, tau, times)
        # A joint with neither friction nor a stop rests by itself: nothing holds it.
        held = (directions == 0.0) & (contact.has_friction | (sides != 0.0))
        forces = contact.forces_at(states, tau, directions, times)
        f = forces.holding(held)
        udot = forces.udot + np.einsum('rik,rk->ri', forces.B, f)

        # Friction holds first; a stop carries what is beyond breakaway friction.
        beyond = f - np.clip(f, forces.least, forces.largest)
        beyond = np.where(sides != 0.0, beyond, 0.0)
        stop_forces = np.zeros((len(states), robot.model.n))
        stop_forces[:, contact.joints] = beyond
        friction = forces.friction.copy()
        friction[:, contact.joints] -= f - beyond

        # Joints at rest stick if they are held, or do not begin to move.
        resting = np.abs(forces.v) <= 2.0 * contact.slow
        a = forces.a + np.einsum('rjk,rk->rj', forces.A, f)
        size = np.abs(forces.a).max(axis=1, initial=1e-300)
        still = np.abs(a) <= NEGLIGIBLE * size[:, None]
        sticking = np.zeros((len(states), robot.model.n), dtype=bool)
        sticking[:, contact.joints] = resting & (held | still) & contact.has_friction
        return FrictionSamples(udot, stop_forces, sticking, friction)

    def modes_at(self, states: Array, tau: Array, times: Array) -> FrictionModes:
        """Return how the joints move from K states on, (K, k) arrays."""
        contact = self._contact
        if contact.locks:
            return contact.modes_at(states, tau, times)
        constants = np.concatenate([[1.0], contact.robot.parameters.block])
        directions, sides = np.empty((2, len(states), len(contact.joints)))
        for row, (state, torque) in enumerate(zip(states, tau)):
            modes = settled_modes(self._kernel, contact, state, torque, constants, 1.0)
            if modes is None:  # the search in Python raises the error
                modes = contact.modes(state, torque, float(times[row]))
            directions[row], sides[row] = modes
        return FrictionModes(directions, sides)


def exact_friction(robot: Robot, stops: bool) -> ExactFriction:
    """Return the `ExactFriction` of a robot, made once for its limits and kept with it."""
    key = 'exact friction', stops_of(robot, stops)
    kept = robot.kernels.kept
    if key not in kept:
        kept[key] = ExactFriction(friction_state(robot, stops))
    friction: ExactFriction = kept[key]
    return friction
