"""Power balance: power of joints and environment, dissipation, rate of energy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from kane_dynamics._util.checks import instance
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import joint_speeds, moved
from kane_dynamics.robot.methods.dispatch import of_one_frame
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
import numpy as np

STEP = 1e-3  # of time, in units of the motion's own: 1 / |u| or 1 / sqrt(|udot|) for 1 rad or m


class PowerBalance(NamedTuple):
    """
    Power, W: of the joints, of the environment, lost to friction, and the energy's rate.

    `constraints` is the power of constraints that prescribe a motion.

    Floats, or (N,) arrays of a batch.
    """

    joints: Any
    external: Any
    friction: Any
    energy_rate: Any
    constraints: Any = 0.0

    @property
    def residual(self) -> Any:
        """Return the residual of the balance, W: zero up to rounding for correct equations."""
        return (self.joints + self.external + self.constraints - self.friction
                - self.energy_rate)


def power_balance(robot: Robot, q: Array, u: Array, udot: Array, *,
                  wrench: Any = None, t: Any = 0.0) -> PowerBalance:
    """
    Return the power balance of a motion.

    ``joint torques q' + wrenches v + constraint forces b = friction q' + d(T + V)/dt``,
    where b are the velocities that constraints prescribe.

    The energy's rate comes from the energies alone, by central differences of fourth
    order along the motion, so the residual checks torques against an independent
    formulation.

    Parameters
    ----------
    robot : Robot
        Of any kind.
    q, u, udot : (n_q,), (n,), (n,) or (N, ...) arrays
        rad or m, and s.
    wrench : array or mapping, optional
        As in `Robot.inverse_dynamics`.
    t : float or (N,) array
        Time, s.

    Raises
    ------
    InputError
        Names the argument, what was given and what is expected; also where a power is
        not finite.

    """
    instance(robot, Robot, 'robot')
    tau = robot.inverse_dynamics(q, u, udot, wrench=wrench, t=t)
    if not robot.equations.time_inputs(t):  # the time is ignored
        t = 0.0
    with np.errstate(over='ignore', invalid='ignore'):  # an error below
        energy_rate = _energy_rate(robot, q, u, udot, t)
        if not robot.equations.in_joint_rates:
            balance = _constrained_balance(robot, q, u, tau, wrench, t, energy_rate)
        else:
            external = robot.external_force(q, wrench=wrench)
            terms = robot.torque_terms(q, u, udot)
            friction = terms[..., TORQUE_TERMS.index('friction'), :]
            balance = PowerBalance(_product(tau, u), _product(external, u),
                                   _product(friction, u), energy_rate,
                                   np.zeros(np.shape(tau)[:-1])[()])
    if not np.isfinite(balance).all():
        raise InputError(f'power: not finite, {balance}; expected a motion in a '
                         'physical range')
    return balance


def _constrained_balance(robot: Robot, q: Any, u: Any, tau: Any, wrench: Any, t: Any,
                         energy_rate: Any) -> PowerBalance:
    """Return the balance of a robot with chosen speeds or constraints, joint by joint."""
    equations: Any = robot.equations
    rates = joint_speeds(robot.model, np.asarray(q), robot.joint_rates(q, u, t=t))
    joints = _product(robot.joint_torques(tau, q, t=t), rates)
    lost = []
    # Friction depends on the torques of the motors, row by row.
    times = np.broadcast_to(np.asarray(t, dtype=np.float64), len(np.atleast_2d(rates)))
    for q_row, row, tau_row, time in zip(np.atleast_2d(np.asarray(q)), np.atleast_2d(rates),
                                         np.atleast_2d(tau), times):
        friction_of_joints = equations.driven_friction(q_row, row, tau_row, time)
        lost.append(friction_of_joints.astype(np.float64) @ row)
    friction = np.reshape(lost, np.shape(joints))[()]
    external = 0.0 * joints
    # Power of external wrenches at their frames.
    for frame, row in _by_frame(robot, q, wrench).items():
        external = external + _product(row, robot.frame_velocity(frame, q, u, t=t))
    # Constraints that move with time do work: their forces times the prescribed rates.
    forces = robot.constraint_forces(q, u, tau, wrench=wrench, t=t)
    constraints = _product(forces, _prescribed(robot, q, t))
    return PowerBalance(joints, external, friction, energy_rate, constraints)


def _by_frame(robot: Robot, q: Any, wrench: Any) -> Mapping[str, Any]:
    """Return the wrenches, (6,) or (N, 6), by frame."""
    if wrench is None:
        return {}
    if isinstance(wrench, Mapping):
        return wrench
    names = [frame.name for frame in robot.equations.wrench_frames]
    rows = np.asarray(of_one_frame(wrench, np.shape(q)[:-1], len(names)))
    return {name: rows[..., k, :] for k, name in enumerate(names)}


def _prescribed(robot: Robot, q: Any, t: Any) -> Any:
    """Return the velocity that every constraint row prescribes, (m,) or (N, m)."""
    mechanism = robot.mechanism
    configurations = np.atleast_2d(np.asarray(q, dtype=np.float64))
    times = np.broadcast_to(np.asarray(t, dtype=np.float64), len(configurations))
    velocities = []
    for configuration, time in zip(configurations, times):
        rows = mechanism.rows(mechanism.state(configuration, time))
        velocities.append(np.array(rows.b, dtype=np.float64))
    return np.reshape(velocities, (*np.shape(q)[:-1], len(mechanism.labels)))


def _product(force: Any, speed: Any) -> Any:
    """Return the power of forces at speeds."""
    return np.sum(np.asarray(force) * speed, axis=-1)


def unaccounted_energy(t: Array, energy: Array, power: Array) -> Array:
    """
    Return the energy error of an integration, (K,), J: change of energy minus work.

    Parameters
    ----------
    t, energy, power : (K,) arrays
        Times, s; kinetic plus potential energy, J; power of joints and environment minus
        dissipation, W. Between two times the power is taken as a cubic, so the
        integral's error is of fourth order in their distance where the power is smooth.

    """
    h = np.diff(t)
    slope = np.gradient(power, t, edge_order=2) if len(t) > 2 else np.zeros(len(t))
    work = 0.5 * h * (power[1:] + power[:-1]) - h * h / 12.0 * np.diff(slope)
    gained: Array = energy - energy[0] - np.concatenate([[0.0], np.cumsum(work)])
    return gained


def _energy_rate(robot: Robot, q: Any, u: Any, udot: Any, t: Any) -> Any:
    """Return the rate of the energy, W, by central differences of fourth order."""
    constrained = not robot.equations.in_joint_rates
    rates = joint_speeds(robot.model, np.asarray(q), robot.joint_rates(q, u, t=t))
    # With the accelerations of all joints, loops stay closed to second order.
    accelerations = np.zeros_like(rates)
    if constrained:
        accelerations = robot.joint_accelerations(q, u, udot, t=t)
    speed = np.maximum(_largest(rates), _largest(u))
    acceleration = np.maximum(_largest(accelerations), _largest(udot))
    h = STEP / np.maximum(np.maximum(speed, np.sqrt(acceleration)), STEP)

    def energy(steps: float) -> Any:
        ahead = steps * h[..., None]
        along = ahead * (rates + 0.5 * ahead * accelerations)
        q_ahead = moved(robot.model, np.asarray(q), along)
        at = {'t': t + steps * h} if constrained else {}
        kinetic = robot.kinetic_energy(q_ahead, u + ahead * udot, **at)
        return kinetic + robot.potential_energy(q_ahead)
    near = energy(1.0) - energy(-1.0)
    far = energy(2.0) - energy(-2.0)
    return (8.0 * near - far) / (12.0 * h)


def _largest(x: Any) -> Any:
    """Return the largest magnitude along the last axis."""
    return np.abs(x).max(axis=-1, initial=0.0)
