"""
Limits of joint speeds in a law: of its reference motion, and brakes at the joints.

Next to a singular configuration a slow frame needs fast joints, and a spring whose frame
cannot follow accelerates them. So the reference motion is slowed down to `FREE` of the
velocity limits, all joints by one factor. A joint that would exceed `FREE` of its limit
within `HORIZON` is braked by a torque against its motion, which takes energy out in every
configuration. Slower joints, below `SLOW` of the limit, are never braked. Towards a
joint limit the speed limit is the distance that is left, divided by `STOPPING`: joints
come to their stops slowly, also those of a robot that states no speed limit.
"""

from __future__ import annotations

from typing import Any

from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import magnitude, select, smallest
from kane_dynamics.mechanics.algebra.lane_products import by_entries, product
from kane_dynamics.mechanics.algebra.lanes import Lanes
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.constraints.mechanism import JointMotion
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

FREE = 0.9  # of a velocity limit, which a law does not make a joint exceed
HORIZON = 0.01  # s: time constant of the approach to it; several periods of a controller
SLOW, RISING = 0.5, 0.8  # of the limit: the brake rises from none to its full torque
# Between two states, s. A torque is late by a period: from HORIZON on brakes overshoot.
# With 1.1 HORIZON motion grows only beyond ten times the speed limit.
LONGEST_PERIOD = 1.1 * HORIZON
STOPPING = 0.1  # s: time constant of the approach to a joint limit
CREEPING = 0.02  # of the velocity limit, which is free at a joint limit and beyond it
CROSSING = 1.0  # s: `CREEPING` is of at most a joint's range in this time
UNSTATED = 1e9  # rad/s or m/s, of a robot without a limit: slow before joint limits alone
FREED = 1e100  # rad/s or m/s: faster limits are those of a user who wants none
SWEEPS = 2  # over the joints, which accelerate each other
TINY = 1e-300


def checked_speeds(robot: Robot, stated: ArrayLike | None) -> Array:
    """Return the speed limits of all joints, (n_j,): the stated ones, or the robot's."""
    if stated is None:
        return np.minimum(np.asarray(robot.limits.velocity, np.float64), UNSTATED)
    speeds = per_joint(stated, 'speed_limit', robot.joint_names, finite=False)
    if not speeds.all():
        raise InputError(f'speed_limit: {speeds.tolist()}; expected positive numbers, '
                         'rad/s or m/s')
    return speeds


def slowdown(rates: Vector, limits: Vector, lanes: Any = Lanes) -> Scalar:
    """Return the factor, at most 1, at which no rate exceeds `FREE` of its limit."""
    return smallest([1.0, *by_entries(_share_of_rate, lanes, rates, limits)])


def _share_of_rate(rate: Scalar, limit: Scalar) -> Scalar:
    """Return the factor at which a rate is `FREE` of its limit."""
    size = magnitude(rate)
    return FREE * limit * (1.0 / select(size < TINY, TINY, size))


def brake_torques(motion: JointMotion, inverse_mass: Matrix, force: Vector,
                  limits: Vector, lanes: Any = Lanes) -> Vector:
    """
    Return the torques, (n_j,), that keep joints within their speed limits.

    They are against the motion of each joint, as large as it takes that no speed grows
    faster than (limit - speed) / `HORIZON`.

    Parameters
    ----------
    motion : JointMotion
        At u, with udot = 0.
    inverse_mass : (n, n) array
        M^-1.
    force : (n,) array
        The generalized force that acts, less the bias force of what resists the joints:
        not of what the arm compensates itself.
    limits : (n_j,) array
        Of the joint speeds, rad/s; infinite for none.
    lanes : class or object
        The functions of `Lanes`.

    """
    T = motion.T
    udot = product(force, inverse_mass, lanes)

    # By how much the accelerations, in the direction of motion, are too large.
    accelerations = motion.qddot + T @ udot
    signs = by_entries(_sign, lanes, motion.qdot)
    shares = by_entries(_braked_share, lanes, motion.qdot, limits)
    excesses = by_entries(_excess, lanes, motion.qdot, accelerations, limits)

    # Accelerations by torques, and the torque by which a joint alone loses one.
    responses = inverse_mass
    if not motion.unit:
        responses = product(T, product(responses, T.T, lanes), lanes)
    inertias: list[Scalar] = []
    for k, response in enumerate(responses):
        if is_zero(response[k]):  # its motion is prescribed: no torque brakes it
            inertias.append(0.0)
        else:
            inertias.append(signs[k] / response[k])

    # Torques that brake only, with the accelerations that they cause at other joints, by
    # projected Gauss-Seidel sweeps. Joint k gets its share of the torque that it wants.
    by_torques = product(np.diag(signs * shares), responses, lanes)
    wanted: list[Scalar] = [0.0] * len(shares)
    for _ in range(SWEEPS):
        for k, by_torque in enumerate(by_torques):
            torque = shares[k] * wanted[k] + inertias[k] * excesses[k]
            torque = select(torque < 0.0, 0.0, torque)
            change = torque - wanted[k]
            wanted[k] = torque
            for j, acceleration in enumerate(by_torque):
                excesses[j] = excesses[j] - acceleration * change
    return by_entries(lambda sign, share, torque: -(sign * share * torque), lanes, signs,
                      shares, np.array(wanted))


def _sign(rate: Scalar) -> Scalar:
    """Return the direction of a rate."""
    return select(rate < 0.0, -1.0, 1.0)


def _braked_share(rate: Scalar, limit: Scalar) -> Scalar:
    """Return the share of its full torque with which a joint of this rate is braked."""
    share = (magnitude(rate) * (1.0 / limit) - SLOW) * (1.0 / (RISING - SLOW))
    return select(share < 0.0, 0.0, select(share > 1.0, 1.0, share))


def _excess(rate: Scalar, acceleration: Scalar, limit: Scalar) -> Scalar:
    """Return the acceleration in the direction of motion that is too large, signed."""
    sign = _sign(rate)
    allowed = (FREE * limit - sign * rate) * (1.0 / HORIZON)
    return acceleration - sign * allowed
