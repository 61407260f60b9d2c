"""The balance of power: what joints and environment put in is stored or lost to friction."""

from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
import numpy as np

STEP = 1e-3  # of time, in units of the motion's own: 1 / |u| or 1 / sqrt(|udot|) for 1 rad or m


class PowerBalance(NamedTuple):
    """
    Power, W: of the joints, of the environment, lost to friction, and the energy's rate.

    Floats, or (N,) arrays of a batch.
    """

    joints: Any
    external: Any
    friction: Any
    energy_rate: Any

    @property
    def residual(self) -> Any:
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
    q, u, udot : (n_q,), (n,), (n,) or (N, ...) arrays
        rad or m, and s.
    wrench : (k, 6) or (N, k, 6) array, optional
        As in `Robot.inverse_dynamics`.

    Raises
    ------
    InputError
        Names the argument, what was given and what is expected; also where a power is not finite.

    """
    if not set(robot.speed_names) <= set(robot.joint_names):
        raise InputError(f'the speeds of this robot are {list(robot.speed_names)}; the balance of '
                         'power needs joint rates')
    tau = robot.inverse_dynamics(q, u, udot, wrench=wrench)
    external = robot.external_force(q, wrench=wrench)
    friction = robot.torque_terms(q, u, udot)[..., TORQUE_TERMS.index('friction'), :]
    with np.errstate(over='ignore', invalid='ignore'):  # refused below, in words
        put_in, pushed, lost = (np.sum(force * u, axis=-1)
                                for force in (tau, external, friction))
        balance = PowerBalance(put_in, pushed, lost, _energy_rate(robot, q, u, udot))
    if not np.isfinite(balance).all():
        raise InputError(f'the power is not finite: {balance}; the motion is beyond any physical '
                         'range')
    return balance


def unaccounted_energy(t: Array, energy: Array, power: Array) -> Array:
    """
    Return what the energy gained beyond what was put in, (K,), J: the error of an integration.

    Parameters
    ----------
    t, energy, power : (K,) arrays
        Times, s; kinetic and potential energy together, J; what joints and environment put in
        less what friction takes, W. Between two times the power is taken as a cubic, so the
        integral's error is of fourth order in their distance where the power is smooth.

    """
    h = np.diff(t)
    slope = np.gradient(power, t, edge_order=2) if len(t) > 2 else np.zeros(len(t))
    work = 0.5 * h * (power[1:] + power[:-1]) - h * h / 12.0 * np.diff(slope)
    gained: Array = energy - energy[0] - np.concatenate([[0.0], np.cumsum(work)])
    return gained


def _energy_rate(robot: Robot, q: Any, u: Any, udot: Any) -> Any:
    fastest, hardest = (np.abs(rate).max(axis=-1) for rate in (u, udot))
    h = STEP / np.maximum(np.maximum(fastest, np.sqrt(hardest)), STEP)
    rates = robot.joint_rates(q, u)

    def energy(steps: float) -> Any:
        t = steps * h[..., None]
        at, speed = q + t * rates, u + t * udot  # right to the first order, which is asked for
        return robot.kinetic_energy(at, speed) + robot.potential_energy(at)
    near, far = energy(1.0) - energy(-1.0), energy(2.0) - energy(-2.0)
    return (8.0 * near - far) / (12.0 * h)
