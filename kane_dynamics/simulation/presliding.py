"""
Joints with bristles in a simulation: their energy, and how fast they settle.

The deflections of the bristles are states in addition to q and v
(`step_kernels.state_names`), and the law is that of `mechanics.friction`.
"""

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.observers import Chunk, Observer
from kane_dynamics.simulation.step_kernels import deflections_of, state_layout
from kane_dynamics.simulation.step_size import REAL_RADIUS, settling_rates
import numpy as np


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
        for i, rows in enumerate(chunk.states):
            v = np.ascontiguousarray(rows[:, state_layout(self._robot).v])
            decays = settling_rates(self._robot, v)
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
