"""
Highest speed at which a motion along its path satisfies all limits (time scaling).

A motion q(s t), s times as fast as q(t), has the speeds s u and accelerations s^2 udot
(Hollerbach, ASME J. Dynamic Systems 106 (1984)). The speed is found by bisection between
the lowest one, at which the motors must hold the arm, and one that exceeds a limit. If the
motion at the resulting speed comes close to a limit between samples, samples are added
there and the search is repeated. Where feasible speeds are several ranges, since viscous
friction and inertia oppose each other, the result is the end of one of them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
import math

from kane_dynamics._util.checks import instance, number
from kane_dynamics._util.typing import Array
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.feasibility.samples import NONE, ROUNDING, ROUNDS, STEP
from kane_dynamics.feasibility.torque_demand import (Demand, demand_at, DrivesAlong,
                                                     largest_fitting,
                                                     motion_of_rigid_joints,
                                                     refuse_with_drives,
                                                     require_scalable)
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import SmoothMotion
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

LOWEST, HIGHEST = 1e-6, 1e4  # range of the search


@dataclass(frozen=True, eq=False)
class TimeScale:
    """
    Highest speed of a motion, and the limit that bounds it.

    Attributes
    ----------
    speed : float
        Factor on the velocities of the motion; infinite if no limit bounds it.
    joint, limit : str or None
        The joint that reaches a limit, and the limit: 'effort', 'velocity', 'power', or
        'gear' of an elastic joint.
    t : float or None
        Time of that, s, in the scaled motion.

    """

    speed: float
    joint: str | None = None
    limit: str | None = None
    t: float | None = None


def fastest(robot: Robot, motion: Motion | SmoothMotion, *, most: float = math.inf,
            step: float = STEP, power: ArrayLike = math.inf,
            bending: QuasiStatic | None = None) -> TimeScale | None:
    """
    Return the highest speed at which a motion satisfies all limits, if there is one.

    Parameters
    ----------
    robot : Robot
        With chosen speeds or constraints, as for `demand`; they must not prescribe
        velocities.
    motion : Motion or SmoothMotion
        As for `demand`: of the robot's joints, of the driving joints, or of the links of
        elastic joints.
    most : float
        Highest speed to consider.
    step : float
        Largest time between two samples of the motion at speed 1, s.
    power : float or (n,) array_like
        Limit on the absolute mechanical power of each joint, W.
    bending : QuasiStatic, optional
        As in `demand`. The speed is a limit with the deflections that it causes.

    Returns
    -------
    TimeScale or None
        None if the motion exceeds a limit at the speed 1e-6: a position, or the torque
        that holds a configuration. ``demand(robot, motion, speed=1e-6).excesses`` names
        it.

    Raises
    ------
    InputError
        If the robot, the motion or a number is invalid; the message names it.

    """
    instance(robot, Robot, 'robot')
    most = number(most, 'most', 'a positive number', lambda x: x > 0.0)
    at_samples: Callable[..., Demand]
    if robot.drives:
        refuse_with_drives(bending)
        at_samples = DrivesAlong(robot, motion, step, power).demand_at
    else:
        require_angles(robot.model, 'fastest')
        motion = motion_of_rigid_joints(motion)

        def at_samples(speed: float, additional: Array) -> Demand:
            return demand_at(robot, motion, speed, step, power, additional, bending)

    # A speed is final if the demand at it cannot be larger between the samples.
    additional = NONE
    speed = min(most, HIGHEST)
    for _ in range(ROUNDS + 1):
        slowest = at_samples(LOWEST, additional)
        if not robot.equations.in_joint_rates:
            require_scalable(robot, slowest.q)
        if not slowest.fits or speed < LOWEST:
            return None
        speed, beyond = largest_fitting(partial(at_samples, additional=additional), LOWEST,
                                        speed, ROUNDING)
        if beyond:  # the tolerance on limits is left for the rounding of files
            speed *= 1.0 - ROUNDING
        at_speed = at_samples(speed, additional)
        scale = TimeScale(math.inf) if speed == HIGHEST else _bound(at_speed, speed)
        refined = at_speed.in_doubt
        if not refined.size:
            break
        additional = np.concatenate([additional, speed * refined])
    return scale


def _bound(demanded: Demand, speed: float) -> TimeScale:
    """Return the highest speed and the limit that bounds it."""
    uses = demanded.uses
    limit = max(uses, key=lambda name: float(uses[name].max()))
    j = int(uses[limit].argmax())
    if uses[limit][j] < 1.0 - 1e3 * ROUNDING:
        return TimeScale(speed)
    quantities = {'effort': demanded.tau, 'gear': demanded.tau, 'velocity': demanded.u,
                  'power': demanded.power}
    k = int(np.abs(quantities[limit][:, j]).argmax())
    return TimeScale(speed, demanded.joint_names[j], limit, float(demanded.t[k]))
