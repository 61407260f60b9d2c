"""
Limits of joint speeds in a law: of its reference motion, and brakes at the joints.

Next to a singular configuration a slow frame needs fast joints, and a spring whose frame
cannot follow accelerates them. So the reference motion is slowed down to `FREE` of the
velocity limits, all joints by one factor. A joint that would exceed `FREE` of its limit
within `HORIZON` is braked by a torque against its motion, which takes energy out in every
configuration. Slower joints, below `SLOW` of the limit, are never braked. Towards a
joint limit the speed limit is what is left of the way, divided by `STOPPING`: joints come
to their stops slowly.
"""

from __future__ import annotations

from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.dual import magnitude, select, smallest
from kane_dynamics.mechanics.algebra.ltdl import solve
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.constraints.mechanism import JointMotion
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.robot.robot import Robot
from kane_dynamics.task_space.frame_task import symmetric_product
import numpy as np
from numpy.typing import ArrayLike

FREE = 0.9  # of a velocity limit, which a law does not make a joint exceed
HORIZON = 0.01  # s: time constant of the approach to it; several periods of a controller
SLOW, RISING = 0.5, 0.8  # of the limit: the brake rises from none to its full torque
STOPPING = 0.1  # s: time constant of the approach to a joint limit
CREEPING = 0.02  # of the velocity limit, which is free at a joint limit and beyond it
SWEEPS = 2  # over the joints, which accelerate each other
TINY = 1e-300


def checked_speeds(robot: Robot, stated: ArrayLike | None) -> Array:
    """Return the speed limits of all joints, (n_j,): the stated ones, or the robot's."""
    if stated is None:
        return np.asarray(robot.limits.velocity, np.float64)
    speeds = per_joint(stated, 'speed_limit', robot.joint_names, finite=False)
    if not speeds.all():
        raise InputError(f'speed_limit: {speeds.tolist()}; expected positive numbers, '
                         'rad/s or m/s')
    return speeds


def speeds_towards_stops(robot: Robot, q: Vector, rates: Vector, speeds: Vector
                         ) -> Vector:
    """
    Return the speed limits in the direction of motion, (n_j,): less next to joint limits.

    Parameters
    ----------
    robot : Robot
        States the joint limits.
    q : (n_q,) array
        Positions.
    rates : (n_j,) array
        Whose signs are the directions.
    speeds : (n_j,) array
        The limits far from the joint limits.

    """
    limits = list(speeds)
    for r, place in enumerate(robot.model.places):
        if place is None:  # a ball joint has no limits
            continue
        lower, upper = robot.limits.lower[place], robot.limits.upper[place]
        if not np.isfinite(lower) and not np.isfinite(upper):
            continue
        way = select(rates[r] < 0.0, q[place] - lower, upper - q[place])
        least = CREEPING * speeds[r]
        slow = way * (1.0 / STOPPING)
        slow = select(slow < least, least, slow)
        limits[r] = select(slow < speeds[r], slow, speeds[r])
    return np.array(limits)


def slowdown(rates: Vector, limits: Vector) -> Scalar:
    """Return the factor, at most 1, at which no rate exceeds `FREE` of its limit."""
    shares: list[Scalar] = [1.0]
    for rate, limit in zip(rates, limits):
        size = magnitude(rate)
        shares.append(FREE * limit / select(size < TINY, TINY, size))
    return smallest(shares)


def brake_torques(equations: Equations, q: Vector, u: Vector, motion: JointMotion,
                  force: Vector, bias: Vector, limits: Vector, parameters: Vector,
                  t: Scalar) -> Vector:
    """
    Return the torques, (n_j,), that keep joints within their speed limits.

    They are against the motion of each joint, as large as it takes that no speed grows
    faster than (limit - speed) / `HORIZON`.

    Parameters
    ----------
    equations : Equations
        Of the robot.
    q, u : (n_q,), (n,) arrays
        The state.
    motion : JointMotion
        At u, with udot = 0.
    force : (n,) array
        The generalized force that acts.
    bias : (n,) array
        That which leaves u as it is, of what resists the joints: not of what the arm
        compensates itself.
    limits : (n_j,) array
        Of the joint speeds, rad/s; infinite for none.
    parameters, t
        Of the robot; time, s.

    """
    T = motion.T
    factors, order = equations.mass_factors(q, parameters, t)
    udot = solve(factors, order, force - bias)

    # In the directions of motion: what the joints gain in speed, and lose per torque.
    signs = [select(rate < 0.0, -1.0, 1.0) for rate in motion.qdot]
    gained = np.array(signs) * (motion.qddot + T @ udot)
    accelerations = np.stack([solve(factors, order, row) for row in T], axis=1)
    responses = symmetric_product(T, accelerations)
    inertias: list[Scalar] = []
    for k, response in enumerate(responses):
        if is_zero(response[k]):  # its motion is prescribed: no torque brakes it
            inertias.append(0.0)
        else:
            inertias.append(1.0 / response[k])

    shares = []
    excesses = []
    for sign, rate, gain, limit in zip(signs, motion.qdot, gained, limits):
        speed = sign * rate
        share = (speed / limit - SLOW) * (1.0 / (RISING - SLOW))
        shares.append(select(share < 0.0, 0.0, select(share > 1.0, 1.0, share)))
        excesses.append(gain - (FREE * limit - speed) * (1.0 / HORIZON))

    # Torques that brake only, with the accelerations that they cause at other joints, by
    # projected Gauss-Seidel sweeps.
    braking: list[Scalar] = [0.0] * len(shares)
    for _ in range(SWEEPS):
        for k, response in enumerate(responses):
            torque = braking[k] + excesses[k] * inertias[k]
            torque = shares[k] * select(torque < 0.0, 0.0, torque)
            change = signs[k] * (torque - braking[k])
            braking[k] = torque
            for j, sign in enumerate(signs):
                excesses[j] = excesses[j] - sign * response[j] * change
    return -np.array(signs) * np.array(braking)
