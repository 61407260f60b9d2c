"""Largest payload with which a motion satisfies the joint limits."""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
import math

from kane_dynamics._util.checks import constant, instance
from kane_dynamics._util.typing import Array
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.fixed_point import upper_fixed_point
from kane_dynamics.feasibility.samples import NONE, ROUNDS, STEP
from kane_dynamics.feasibility.torque_demand import (Demand, demand, demand_at, DrivesAlong,
                                                     motion_of_rigid_joints,
                                                     refined_demand,
                                                     refuse_with_drives, torque_of)
from kane_dynamics.mechanics.friction import refuse_load_friction
from kane_dynamics.model.inertial import check_moments, Inertial
from kane_dynamics.model.placement import point
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import SmoothMotion
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

ROUNDING_SHARE = 1e-13  # relative difference of two torques that is rounding
SMALL = 1e-3  # kg, hardly bends a beam
SETTLED = 1e-9  # relative change of the last mass tried with beams or elastic joints
HEAVIEST = 1e6  # kg; beyond, nothing bounds the payload of elastic joints


@dataclass(frozen=True, eq=False)
class PayloadBound:
    """
    Largest payload of a motion, and the limit that bounds it.

    Attributes
    ----------
    mass : float
        kg; infinite if nothing bounds it.
    joint, limit : str or None
        The joint that reaches a limit first, and the limit: 'effort' or 'power', with
        elastic joints also 'gear' or 'velocity'.
    t : float or None
        Time of that, s.

    """

    mass: float
    joint: str | None = None
    limit: str | None = None
    t: float | None = None


def largest_payload(robot: Robot, motion: Motion | SmoothMotion, *,
                    com: ArrayLike = (0.0, 0.0, 0.0),
                    inertia: ArrayLike | None = None, speed: float = 1.0,
                    step: float = STEP, power: ArrayLike = math.inf,
                    bending: QuasiStatic | None = None) -> PayloadBound:
    """
    Return the largest mass that a robot can carry along a motion.

    For a payload with a given center of mass and an inertia proportional to its mass m,
    the torque is linear in m: tau = tau_0 + m tau_1 at each sample. So each limit bounds
    m exactly. With beams, which the payload bends, tau_1 is that of the mass found, by
    iteration. The motors of elastic joints have friction at a speed that depends on the
    mass, and stiffness may be a curve: then the mass is searched until a limit is reached
    within 1e-9, from below.

    Parameters
    ----------
    robot : Robot
        A robot with a `payload_frame`; its current payload is ignored.
    motion : Motion or SmoothMotion
        Motion of the robot's joints, in their order; of elastic joints, of their links, as
        in `demand`.
    com : (3,) array_like
        Center of mass in the payload frame, m.
    inertia : (3, 3) array_like, optional
        Inertia per kilogram about the center of mass, in axes of the payload frame, m^2.
        Default: a point mass.
    speed, step, power, bending
        As in `demand`; the robot of `bending` has the payload frame, its payload is
        ignored too.

    Raises
    ------
    InputError
        If the motion exceeds a limit without a payload (the message names the joint, the
        limit and the time), the robot has no payload frame, or a payload bends the beams
        beyond their equilibrium before it exceeds a limit; with elastic joints, as in
        `demand`.
    ModelError
        If the center of mass or the inertia is invalid.

    """
    instance(robot, Robot, 'robot')
    if robot.drives:
        refuse_with_drives(bending, None)
    else:
        motion_of_rigid_joints(motion)
    if robot.friction:
        refuse_load_friction(robot.model, 'largest_payload')
    per_mass = _inertial_per_mass(com, inertia)
    if bending is not None:

        # Copies, since the payload of the caller's robots must stay.
        instance(bending, QuasiStatic, 'bending')
        bending = QuasiStatic(copy(bending.robot))
    carrier = copy(robot)
    loaded = carrier if bending is None else bending.robot
    loaded.parameters.payload = None
    # The motion must be feasible without a payload; otherwise no mass is.
    empty = demand(carrier, motion, speed=speed, step=step, power=power, bending=bending)
    if not empty.fits:
        raise InputError(f'motion without a payload: {empty.excesses[0]}; expected a '
                         'motion within the limits')

    def load(mass: float) -> None:
        payload = None
        if mass:
            payload = Inertial(mass, per_mass.com, mass * per_mass.inertia)
        loaded.parameters.payload = payload

    # Elastic joints: the demand is not linear in the mass.
    if robot.drives:
        drives = DrivesAlong(carrier, motion, step, power)

        def demand_of_drives(mass: float) -> Demand:
            load(mass)
            return refined_demand(drives.demand_at, speed)
        return _searched_bound(demand_of_drives)

    def demand_with(mass: float, additional: Array) -> Demand:
        load(mass)
        return demand_at(carrier, motion, speed, step, power, additional, bending)
    # The torque is linear in the mass of a rigid arm: the bound follows in closed form,
    # and samples are added where the demand may rise between them.
    additional = NONE
    for _ in range(ROUNDS + 1):
        at_samples = partial(demand_with, additional=additional)
        empty = at_samples(0.0)
        best, slope = _bound_at(empty, at_samples, bends=bending is not None)
        if math.isinf(best.mass):
            break
        refined = replace(empty, tau=empty.tau + best.mass * slope).in_doubt
        if not refined.size:
            break
        additional = np.concatenate([additional, speed * refined])
    return best


def _inertial_per_mass(com: ArrayLike, inertia: ArrayLike | None) -> Inertial:
    """Return the checked inertial properties of one kilogram of payload."""
    moments = np.zeros((3, 3))
    if inertia is not None:
        moments = constant(inertia, (3, 3), 'inertia')
    per_mass = Inertial(1.0, point(com, 'center of mass'), moments)
    check_moments('payload', per_mass)
    return per_mass


def _searched_bound(demand_with: Callable[[float], Demand]) -> PayloadBound:
    """Return the largest payload by bisection between one that fits and one that does not."""
    # Double the mass until a limit is exceeded.
    low, high = 0.0, SMALL
    while not (excessive := demand_with(high).excesses):
        low, high = high, 2.0 * high
        if high > HEAVIEST:
            return PayloadBound(math.inf)
    # Bisect between the last mass that fits and the first that does not.
    while high - low > SETTLED * high:
        middle = 0.5 * (low + high)
        if beyond := demand_with(middle).excesses:
            high, excessive = middle, beyond
        else:
            low = middle
    # Close to the bound only the limit that is reached first is exceeded.
    first = excessive[0]
    return PayloadBound(low, first.joint, first.limit, first.t)


def _bound_at(empty: Demand, demand_with: Callable[[float], Demand], bends: bool
              ) -> tuple[PayloadBound, Array]:
    """Return the largest payload at the samples, and the torque per kilogram."""
    def bound_from(mass: float) -> tuple[PayloadBound, Array]:
        slope = _slope(empty, demand_with(mass), mass)
        return _bound(empty, slope), slope
    if not bends:
        return bound_from(1.0)  # the torque is linear in the mass
    # Bending makes the torque per kilogram depend on the mass: a fixed point.
    message = (f'bending: no largest payload found from {SMALL:g} kg; expected beams '
               'that bend less')
    mass = upper_fixed_point(lambda tried: bound_from(tried)[0].mass, SMALL, SETTLED,
                             message)
    if mass is None or math.isinf(mass):
        mass = SMALL
    return bound_from(max(mass, SMALL))


def _slope(empty: Demand, loaded: Demand, mass: float) -> Array:
    """Return the torque per kilogram of payload, (N, n), from that of a mass, kg."""
    slope = loaded.tau - empty.tau
    size = np.abs(loaded.tau) + np.abs(empty.tau)
    slope[np.abs(slope) <= ROUNDING_SHARE * size] = 0.0
    return np.asarray(slope / mass)


def _bound(empty: Demand, slope: Array) -> PayloadBound:
    """Return the largest mass allowed by the limits at the samples."""
    bounds = {'effort': np.broadcast_to(empty.limits.effort, slope.shape),
              'power': torque_of(empty.power_limit, empty.u)}
    # Each sample and joint bounds the mass: where its torque reaches the limit on the
    # side on which the mass acts.
    best = PayloadBound(math.inf)
    for limit, bound in bounds.items():
        with np.errstate(divide='ignore', invalid='ignore'):
            mass = np.maximum((np.copysign(bound, slope) - empty.tau) / slope, 0.0)
        # Torques that do not depend on the mass bound nothing.
        mass[(slope == 0.0) | np.isnan(mass)] = math.inf
        k, j = np.unravel_index(int(mass.argmin()), mass.shape)
        if mass[k, j] < best.mass:
            best = replace(best, mass=float(mass[k, j]), joint=empty.joint_names[int(j)],
                           limit=limit, t=float(empty.t[k]))
    return best
