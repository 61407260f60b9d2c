"""The balance of power: what joints and environment put in is stored or lost to friction."""

import math
from typing import NamedTuple

from kane_dynamics.errors import InputError
from kane_dynamics.model import Array
from kane_dynamics.robot import Robot, TORQUE_TERMS
import numpy as np

STEP = 1e-3  # largest motion, rad or m, between two of the energies that give their rate


class PowerBalance(NamedTuple):
    """Power, W: of the joints, of the environment, lost to friction, and the energy's rate."""

    joints: float
    external: float
    friction: float
    energy_rate: float

    @property
    def residual(self) -> float:
        """Return what does not balance, W: zero but for rounding if the equations are right."""
        return self.joints + self.external - self.friction - self.energy_rate


def power_balance(robot: Robot, q: Array, u: Array, udot: Array, *,
                  wrench: Array | None = None) -> PowerBalance:
    """
    Return the power of a motion: ``tau u + external u = friction u + d(T + V)/dt``.

    The energy's rate comes from the energies alone, by central differences of fourth order along
    the motion, so the residual holds torques against an independent road.

    Parameters
    ----------
    robot : Robot
        With joint rates for speeds; what constrains it does no work unless it depends on time.
    q, u, udot : (n_q,), (n,), (n,) arrays
        rad or m, and s.
    wrench : (k, 6) array, optional
        As in `Robot.inverse_dynamics`.

    Raises
    ------
    InputError
        Names the argument, what was given and what is expected; also where a power is not finite.

    """
    tau = robot.inverse_dynamics(q, u, udot, wrench=wrench)
    external = robot.external_force(q, wrench=wrench)
    friction = robot.torque_terms(q, u, udot)[TORQUE_TERMS.index('friction')]
    with np.errstate(over='ignore', invalid='ignore'):  # refused below, in words
        balance = PowerBalance(float(tau @ u), float(external @ u),
                               float(friction @ u), _energy_rate(robot, q, u, udot))
    if not all(map(math.isfinite, balance)):
        raise InputError(f'the power is not finite: {balance}; the motion is beyond any physical '
                         'range')
    return balance


def _energy_rate(robot: Robot, q: Array, u: Array, udot: Array) -> float:
    # A step in time in which neither speed nor acceleration moves a joint by more than STEP.
    h = STEP / max(np.abs(u).max(), math.sqrt(STEP * np.abs(udot).max()), STEP)

    rates = robot.joint_rates(q, u)

    def energy(t: float) -> float:
        at, speed = q + t * rates, u + t * udot  # right to the first order, which is asked for
        return float(robot.kinetic_energy(at, speed) + robot.potential_energy(at))
    near, far = energy(h) - energy(-h), energy(2.0 * h) - energy(-2.0 * h)
    return float((8.0 * near - far) / (12.0 * h))
