"""Largest payload with which a motion satisfies the joint limits."""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
import math

from kane_dynamics._util.checks import constant, instance
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.samples import STEP
from kane_dynamics.feasibility.torque_demand import (Demand, demand, DrivesAlong, excesses_of,
                                                     largest_fitting,
                                                     motion_of_rigid_joints,
                                                     refined_demand, refuse_with_drives)
from kane_dynamics.mechanics.friction import refuse_load_friction
from kane_dynamics.model.inertial import check_moments, Inertial
from kane_dynamics.model.placement import point
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import SmoothMotion
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

SMALL = 1e-3  # kg, hardly bends a beam
SETTLED = 1e-9  # relative precision of the mass
HEAVIEST = 1e6  # kg; beyond, nothing bounds the payload


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

    The payload has a given center of mass and an inertia proportional to its mass. The mass
    is searched until a limit is reached within 1e-9, from below.

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
        refuse_with_drives(bending)
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

    drives = DrivesAlong(carrier, motion, step, power) if robot.drives else None

    def demand_with(mass: float) -> Demand:
        load(mass)
        if drives is not None:
            return refined_demand(drives.demand_at, speed)
        return demand(carrier, motion, speed=speed, step=step, power=power, bending=bending)
    return _searched_bound(demand_with)


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
    # Double the mass until a limit is exceeded; then the last mass fits.
    low, high = 0.0, SMALL
    while not excesses_of(demand_with, high):
        low, high = high, 2.0 * high
        if high > HEAVIEST:
            return PayloadBound(math.inf)
    mass, beyond = largest_fitting(demand_with, low, high, SETTLED)
    # Close to the bound only the limit that is reached first is exceeded.
    first = beyond[0]
    return PayloadBound(mass, first.joint, first.limit, first.t)
