"""The energy balance of the simulated arm, checked in blocks of steps."""

from kane_dynamics._util.typing import Array
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.energy_balance import EnergyBalance
from kane_dynamics.simulation.step_kernels import state_names
import numpy as np

BLOCK = 2000  # steps that are kept and checked together


class EnergyCheck:
    """
    Checks the energy balance of the simulated arm at the end of each block of steps.

    Parameters
    ----------
    robot : Robot
    step : float
        s.
    integrator : str
        One of `mechanics.integrators.INTEGRATORS`.

    Attributes
    ----------
    warning : str
        The warning of the first block with an energy error; empty if there is none.

    """

    def __init__(self, robot: Robot, step: float, integrator: str) -> None:
        self._arguments = robot, step
        self._integrator = integrator
        self._states = np.zeros((1, BLOCK + 1, len(state_names(robot))))
        self._torques = np.zeros((1, BLOCK, robot.n))
        self.warning = ''
        self.restart(self._states[0, 0])

    def restart(self, state: Array) -> None:
        """Begin a block at a state; the balance does not include earlier motion."""
        self._states[0, 0], self._count = state, 0
        self._balance = EnergyBalance(*self._arguments, self._states[:, 0], self._integrator)

    def add(self, torque: Array, state: Array) -> None:
        """Add a step: the torques held during it, and the state after it."""
        k = self._count
        self._torques[0, k], self._states[0, k + 1] = torque, state
        self._count = k + 1
        if self._count == BLOCK:
            self.close()

    def close(self) -> None:
        """Check the steps of the block, and begin the next one where they ended."""
        k = self._count
        if not k:
            return
        balance = self._balance
        balance.update(self._states[:, :k + 1].copy(), 0, self._torques[:, :k])
        self.warning = self.warning or balance.warning() or ''
        self.restart(self._states[0, k].copy())
