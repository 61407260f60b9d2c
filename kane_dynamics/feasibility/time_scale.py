"""
The highest speed at which a motion's path keeps every limit.

A motion q(s t), s times as fast as q(t), has the speeds s u and accelerations s^2 udot. Its torque
at a sample is a quadratic in s plus what Coulomb friction asks for,

    tau(s) = s^2 (M udot + Coriolis) + s d u + (gravity + springs + offset) + T(s u),

(Hollerbach, ASME J. Dynamic Systems 106 (1984), with friction added), so that a limit forbids
intervals of s that are known in closed form, and the highest s outside all of them is the answer:
exact where there is no Coulomb friction and no limit of power. T(s u) = mu tanh(s u / u_s) only
grows with s, and tau is bounded by P / (s |u|) where power is by P. Over an interval of s both lie
between their values at its ends: the most favourable ones forbid too little, the least favourable
ones too much, and intervals are split until both agree. Where the motion at that speed comes near
a limit between samples, more are taken there, and the speed is sought again. Slower is not always
feasible: an arm that cannot hold a posture may swing through it.
"""

from dataclasses import dataclass
import math

from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.samples import NONE, ROUNDING, ROUNDS, sampled, STEP
from kane_dynamics.feasibility.torque_demand import Demand, demand_at, torque_of
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike, NDArray

LEAST, MOST = 1e-6, 1e4  # speeds that are looked at
PRECISION = 1e-10  # of the speed, relative, where friction or power leave no closed form

Indices = NDArray[np.int_]


@dataclass(frozen=True, eq=False)
class TimeScale:
    """
    The highest speed of a motion, and what bounds it.

    Attributes
    ----------
    speed : float
        2 is twice as fast as the motion; infinite if nothing bounds it.
    joint, limit : str or None
        Which limit, 'effort', 'velocity' or 'power', of which joint is reached; None if none is.
    t : float or None
        When, s in the time of the scaled motion.

    """

    speed: float
    joint: str | None = None
    limit: str | None = None
    t: float | None = None


def fastest(robot: Robot, motion: Motion, *, most: float = math.inf, step: float = STEP,
            power: ArrayLike = math.inf) -> TimeScale | None:
    """
    Return the highest speed at which a motion keeps all limits; None if there is none.

    Parameters
    ----------
    robot : Robot
        With joint rates for speeds.
    motion : Motion
        Of its joints, in their order.
    most : float
        Highest speed to consider: 1 asks how slow the motion must be, not how fast it may be.
    step : float
        Largest time between two samples of the motion at speed 1, s.
    power : float or (n,) array_like
        Largest size of the mechanical power of each joint, W.

    Returns
    -------
    TimeScale or None
        None if a position is out of its limits, or if no speed from a millionth of the motion's
        on keeps the limits: most often a posture that the motors cannot hold, which
        ``demand(robot, motion, speed=1e-6).excesses`` names.

    Raises
    ------
    InputError
        The robot or the motion is not of that kind, a number is out of range: names it.

    """
    if not most > 0.0:
        raise InputError(f'most is {most}; expected a positive number')
    more = NONE
    for _ in range(ROUNDS + 1):
        course = SampledPath(robot, motion, step, power, more)
        top = min(most, MOST, course.speed_bound)
        speed = _highest(course, LEAST, top) if course.inside and top >= LEAST else None
        if speed is None:
            return None
        asked = demand_at(robot, motion, speed, step, power, more)
        scale = TimeScale(math.inf) if speed == MOST else _bound(asked, speed)
        doubtful = asked.in_doubt
        if not doubtful.size:
            break
        more = np.concatenate([more, speed * doubtful])
    return scale


def _bound(asked: Demand, speed: float) -> TimeScale:
    """Return the speed with the limit that a motion reaches."""
    uses = asked.uses
    limit = max(uses, key=lambda name: float(uses[name].max()))
    j = int(uses[limit].argmax())
    if uses[limit][j] < 1.0 - 1e3 * ROUNDING:
        return TimeScale(speed)
    values = {'effort': asked.tau, 'velocity': asked.u, 'power': asked.power}[limit]
    return TimeScale(speed, asked.joint_names[j], limit,
                     float(asked.t[int(np.abs(values[:, j]).argmax())]))


class SampledPath:
    """
    The torque of a motion as a function of its speed; arrays are (N, n).

    Parameters
    ----------
    robot : Robot
    motion : Motion
    step : float
        As in `fastest`.
    power : float or (n,) array_like
        As in `fastest`.
    more : (k,) array
        Further times of the motion to look at, s.

    """

    def __init__(self, robot: Robot, motion: Motion, step: float, power: ArrayLike,
                 more: Array) -> None:
        """Take the torque apart by powers of the speed."""
        _, q, self.u, udot = sampled(robot, motion, step, more)
        inertia, coriolis, gravity, _, spring = np.moveaxis(
            robot.torque_terms(q, self.u, udot), 1, 0)
        self.robot, limits = robot, robot.limits
        self.offset = robot.friction_force(np.zeros(robot.n))
        self.square, self.constant = inertia + coriolis, gravity + spring + self.offset
        self.linear = self.u * _damping(robot)
        self.effort = limits.effort
        self.power = per_joint(power, 'power', robot.joint_names, finite=False)
        slack = [ROUNDING * np.maximum(1.0, np.abs(b)) for b in (limits.lower, limits.upper)]
        self.inside = bool(((q >= limits.lower - slack[0])
                            & (q <= limits.upper + slack[1])).all())
        with np.errstate(divide='ignore', invalid='ignore'):
            bound = limits.velocity / np.abs(self.u).max(axis=0)
        self.speed_bound = float(np.where(np.isnan(bound), math.inf, bound).min())

    def coulomb(self, rows: Indices, speed: float) -> Array:
        """Return T at a speed: friction without what is linear in the speed."""
        return np.asarray(self.robot.friction_force(speed * self.u[rows]) - self.offset
                          - speed * self.linear[rows])

    def bound(self, rows: Indices, speed: float) -> Array:
        """Return the largest torque that effort and power allow at a speed."""
        return np.minimum(self.effort, torque_of(self.power, speed * self.u[rows]))

    def forbidden(self, rows: Indices, low: float, high: float) -> tuple[Array, Array]:
        """
        Return forbidden open intervals of speeds between two, (k, 4, n, 2) each.

        Returns
        -------
        some, all_and_more : arrays
            Some that are forbidden, and all that are, with others perhaps.

        """
        T = [self.coulomb(rows, low), self.coulomb(rows, high)]
        least, largest = np.minimum(*T), np.maximum(*T)
        A, B, C = self.square[rows], self.linear[rows], self.constant[rows]
        wide, narrow = self.bound(rows, low), self.bound(rows, high)
        some, more = (np.concatenate([positive(A, B, C + under - bound),
                                      positive(-A, -B, -C - over - bound)], axis=1)
                      for under, over, bound in ((least, largest, wide),
                                                 (largest, least, narrow)))
        return some, more


def _damping(robot: Robot) -> Array:
    """Return each coordinate's coefficient of viscous friction, (n,)."""
    total = np.zeros(robot.n)
    for body in robot.model.bodies if robot.friction else ():
        total[body.joint.coordinate] += body.joint.multiplier**2 * body.joint.damping
    return total


def _highest(course: SampledPath, low: float, high: float) -> float | None:
    """Return the highest allowed speed between two, None if there is none."""
    boxes = [(low, high, np.arange(len(course.u)))]
    while boxes:
        low, high, rows = boxes.pop()
        some, more = course.forbidden(rows, low, high)
        up = highest_free(some.reshape(-1, 2), low, high)
        if up is None:
            continue
        down = highest_free(more.reshape(-1, 2), low, up)
        if down is not None and up - down <= PRECISION * up:
            return down
        if down is None:
            if up - low <= PRECISION * up:
                continue
            down = low
        # What is forbidden nowhere in between needs no further look.
        touched = (more[..., 0] < np.minimum(up, more[..., 1])) & (more[..., 1] > down)
        rows = rows[touched.any(axis=(1, 2))]
        down = max(low, down * (1.0 - PRECISION))  # rounding may have put it too high
        middle = math.sqrt(down * up)
        boxes += [(down, middle, rows), (middle, up, rows)]
    return None


def positive(A: Array, B: Array, C: Array) -> Array:
    """
    Return the open intervals on which A s^2 + B s + C > 0, (k, 2, n, 2) for (k, n) arrays.

    There are up to two; one that is not there ends where it begins, or before.
    """
    inf = math.inf
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        # The two roots without cancellation; not a number where there is none.
        half = -0.5 * (B + np.copysign(np.sqrt(B * B - 4.0 * A * C), B))
        roots = half / A, C / half
    first, second = np.fmin(*roots), np.fmax(*roots)
    none, flat = np.isnan(half) | np.isinf(C), A == 0.0
    everywhere = np.where(C > 0.0, -inf, inf)
    cases = [flat & (B > 0.0), flat & (B < 0.0), flat | none, A < 0.0]
    left = np.select(cases, [roots[1], -inf, everywhere, first], -inf)
    right = np.select(cases, [inf, roots[1], inf, second], first)
    beyond = np.where(flat | none | (A < 0.0), inf, second)
    return np.stack([np.stack([left, right], axis=-1),
                     np.stack([beyond, np.full_like(beyond, inf)], axis=-1)], axis=1)


def highest_free(intervals: Array, low: float, high: float) -> float | None:
    """Return the highest number from low to high that is in none of open intervals (m, 2)."""
    start, end = intervals[(intervals[:, 0] < np.minimum(high, intervals[:, 1]))
                           & (intervals[:, 1] > low)].T
    order = np.argsort(-end)
    start, end = np.minimum.accumulate(start[order]), end[order]
    if not len(end) or end[0] <= high:
        return high
    gaps = np.flatnonzero(end[1:] <= start[:-1])
    found = float(start[gaps[0] if len(gaps) else -1])
    return found if found >= low else None
