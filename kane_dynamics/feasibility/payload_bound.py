"""The largest payload that a motion leaves torque for."""

from copy import copy
from dataclasses import dataclass, replace
import math

from kane_dynamics._util.checks import constant
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.samples import NONE, ROUNDS, STEP
from kane_dynamics.feasibility.torque_demand import demand, Demand, demand_at, torque_of
from kane_dynamics.model.builder_checks import check_moments
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

NOTHING = 1e-13  # of two torques, relative: a difference of rounding


@dataclass(frozen=True, eq=False)
class PayloadBound:
    """
    The largest payload of a motion, and what bounds it.

    Attributes
    ----------
    mass : float
        kg; infinite if nothing bounds it.
    joint, limit : str or None
        Which limit, 'effort' or 'power', of which joint it reaches.
    t : float or None
        When, s.

    """

    mass: float
    joint: str | None = None
    limit: str | None = None
    t: float | None = None


def largest_payload(robot: Robot, motion: Motion, *, com: ArrayLike = (0.0, 0.0, 0.0),
                    inertia: ArrayLike | None = None, speed: float = 1.0, step: float = STEP,
                    power: ArrayLike = math.inf) -> PayloadBound:
    """
    Return the largest mass that a robot can carry along a motion.

    The torque is linear in the mass m of a payload whose mass centre is given and whose inertia
    grows with it: tau = tau_0 + m tau_1 at each sample, so that each limit bounds m exactly.

    Parameters
    ----------
    robot : Robot
        With a `payload_frame`; what it carries now is put down first.
    motion : Motion
        Of its joints, in their order.
    com : (3,) array_like
        Mass centre from the origin of the payload frame, in its axes, m.
    inertia : (3, 3) array_like, optional
        About the mass centre, in axes of the frame, of each kilogram, m^2; default: a point mass.
    speed, step, power
        As in `demand`.

    Raises
    ------
    InputError
        The motion passes a limit without any payload: names the joint, the limit and the time;
        or the robot has no payload frame.
    ModelError
        The mass centre or the inertia is not valid.

    """
    unit = Inertial(1.0, constant(com, (3,), 'mass centre'),
                    np.zeros((3, 3)) if inertia is None else constant(inertia, (3, 3), 'inertia'))
    check_moments('payload', unit)
    carrier = copy(robot)
    carrier.parameters.payload = None
    empty = demand(carrier, motion, speed=speed, step=step, power=power)
    if not empty.fits:
        raise InputError(f'the motion passes a limit without a payload: {empty.excesses[0]}')
    more = NONE
    for _ in range(ROUNDS + 1):
        carrier.parameters.payload = None
        empty = demand_at(carrier, motion, speed, step, power, more)
        carrier.parameters.payload = unit
        slope = _slope(empty, demand_at(carrier, motion, speed, step, power, more))
        best = _bound(empty, slope)
        if math.isinf(best.mass):
            break
        doubtful = replace(empty, tau=empty.tau + best.mass * slope).in_doubt
        if not doubtful.size:
            break
        more = np.concatenate([more, speed * doubtful])
    return best


def _slope(empty: Demand, loaded: Demand) -> Array:
    """Return the torque that each kilogram asks for, (N, n)."""
    slope = loaded.tau - empty.tau
    slope[np.abs(slope) <= NOTHING * (np.abs(loaded.tau) + np.abs(empty.tau))] = 0.0
    return np.asarray(slope)


def _bound(empty: Demand, slope: Array) -> PayloadBound:
    """Return the largest mass that limits at samples leave room for."""
    bounds = {'effort': np.broadcast_to(empty.limits.effort, slope.shape),
              'power': torque_of(empty.power_limit, empty.u)}
    best = PayloadBound(math.inf)
    for limit, bound in bounds.items():
        with np.errstate(divide='ignore', invalid='ignore'):
            most = np.maximum((np.copysign(bound, slope) - empty.tau) / slope, 0.0)
        most[(slope == 0.0) | np.isnan(most)] = math.inf
        k, j = np.unravel_index(int(most.argmin()), most.shape)
        if most[k, j] < best.mass:
            best = replace(best, mass=float(most[k, j]), joint=empty.joint_names[int(j)],
                           limit=limit, t=float(empty.t[k]))
    return best
