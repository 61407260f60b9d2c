"""
Fastest motion along a path within limits of torque, power, speed and acceleration.

The path is timed on a grid by reachability analysis (`reachability`), for limits that
are linear in the squared path velocity (`path_limits`); friction and power limits are
made linear at the previous profile. The motion between the grid points is then checked,
and limits are tightened where it exceeds them, as at the corners of the profile. What
depends on the kind of robot is in `path_robot`.
"""

from collections.abc import Sequence
import math

from kane_dynamics._util.checks import (instance, integer, limit_per_joint,
                                        number)
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.jerk_limited.rate_peaks import rate_uses_at_points
from kane_dynamics.feasibility.jerk_limited.third_order_limits import RateBounds
from kane_dynamics.feasibility.jerk_limited.third_order_timing import rate_limited
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.feasibility.path_limits import Bounds, PathLimits
from kane_dynamics.feasibility.path_robot import PathRobot
from kane_dynamics.feasibility.path_timing import (Checked, joined_sections,
                                                   profile_duration)
from kane_dynamics.feasibility.reachability import (controllable_sets, end_limit, HIGH,
                                                    Infeasible, IntervalLimits,
                                                    largest_profile)
from kane_dynamics.feasibility.samples import MOST_SAMPLES, ROUNDING
from kane_dynamics.feasibility.timing_result import TimeOptimal
from kane_dynamics.loop_tracking.loop_error import LoopError
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.friction import has_linear_damping, refuse_load_friction
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import SmoothMotion
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

POINTS, FINEST = 1000, 16_000  # intervals of the grid
CONVERGED, PROGRAMS = 1e-6, 40  # relative change of the duration by the last profile
FASTEST = 1e9  # speed at an end, whose square is a number
SMALLEST = 1e-9  # x relative to its size
SLOW = 1e-3  # x of the first profile with limits of power, relative to that without
SLOWER = 12  # times that a profile is slowed down where its limits have no solution
ROUNDS, FINEST_ROUNDS = 6, 20  # in which limits are tightened; on the finest grid
# Limits are tightened by this factor in their excess: the next profile leaves an excess
# beside a tightened limit. The factor grows after `ROUNDS`.
TIGHTER, GROWTH = 1.1, 1.5
SMALL, LARGEST = 1e-5, 1e-3  # excess of a limit between points; on the finest grid
# A grid on which tighter limits cost more time, relative, and is not fine yet.
COARSE, FINE = 2e-3, 4000
DIVISIONS = 32  # intervals that resolve a segment of the path
ROUNDED = 50.0  # error of accelerations, in the rounding of positions over dt^2; measured
EPSILON = float(np.finfo(np.float64).eps)
FEW = 50  # every so many points show whether a path moves
RESTING = 100.0  # roundings of its position that a joint at rest may vary by, at most


def time_optimal(robot: Robot, path: Motion | SmoothMotion | ArrayLike, *,
                 power: ArrayLike = math.inf,
                 acceleration: ArrayLike = math.inf, jerk: ArrayLike = math.inf,
                 torque_rate: ArrayLike = math.inf, start_speed: float = 0.0,
                 end_speed: float = 0.0, points: int = POINTS,
                 rest: ArrayLike | None = None) -> TimeOptimal:
    """
    Return the fastest motion along a path within the joint limits of a robot.

    Torques include friction and the payload. The path is followed exactly at the points
    of the result, and to rounding between them.

    Parameters
    ----------
    robot : Robot
        Without beams and elastic joints. With chosen speeds or constraints, the limits of
        all joints count, those of effort and power where joints have actuators
        (`Robot.joint_torques`).
    path : Motion, SmoothMotion or (K, n) array_like
        A motion, whose timing is ignored, or waypoints, rad or m, through which a cubic
        spline is drawn. The result rests where the motion rests between its ends, without
        dwells. With constraints, of as many joints as there are independent
        speeds, which determine the others as in `demand`; waypoints are of the joints
        that follow motions (`ComputedTorque`).
    power : float or (n,) array_like
        Limit on the absolute mechanical power of each joint, W.
    acceleration : float or (n,) array_like
        Limit on the absolute acceleration of each joint, rad/s^2 or m/s^2.
    jerk : float or (n,) array_like
        Limit on the absolute jerk of each joint, rad/s^3 or m/s^3.
    torque_rate : float or (n,) array_like
        Limit on the absolute rate of the torque of each joint, N m/s or N/s, without
        Coulomb friction, which changes almost at once where a joint reverses.
    start_speed, end_speed : float
        Euclidean norm of the velocities of the path's joints at its ends, rad/s or m/s;
        0 with limits of jerk or torque rate.
    points : int
        Intervals of the grid, about; more where they are needed.
    rest : (n_q,) array_like, optional
        With constraints: a nearly closed configuration, whose assembly mode is kept on
        the way from there to the start of the path and along it. Default: that of the
        robot, or else the closure that is found from zeros, as in `demand`.

    Raises
    ------
    InputError
        If an argument is invalid, the path exceeds a position limit, the motors cannot
        hold the robot on the path, or nothing bounds the motion; the message names joint
        and place.
    ConstraintError
        Loops do not close, or come near a singular configuration; names the place.

    """
    instance(robot, Robot, 'robot')
    if robot.model.balls:
        require_angles(robot.model, 'time_optimal')
    if robot.equations.tree.flexible:
        raise InputError('robot: with beams; expected a rigid robot, as a path does not '
                         'state their deflections')
    if robot.drives:
        raise InputError('robot: elastic joints; expected rigid ones (with_rigid_joints), '
                         'and `fastest` for a SmoothMotion of the elastic ones')
    if robot.friction:
        refuse_load_friction(robot.model, 'time_optimal')
    names = robot.joint_names

    # The limits of the second order, then those of the third, which need another solver.
    bounds = Bounds(robot.limits.effort, robot.limits.velocity,
                    limit_per_joint(power, 'power', names),
                    limit_per_joint(acceleration, 'acceleration', names))
    rates = RateBounds(limit_per_joint(jerk, 'jerk', names),
                       limit_per_joint(torque_rate, 'torque_rate', names))
    limits_rates = bool(np.isfinite(rates).any())
    speeds = _speed(start_speed, 'start_speed'), _speed(end_speed, 'end_speed')
    points = integer(points, 'points', 10, MOST_SAMPLES)
    # A path is one of positions alone: the timing of a SmoothMotion would be ignored.
    if isinstance(path, SmoothMotion):
        raise InputError('path: a SmoothMotion; expected a Motion or waypoints')
    # The path with the dynamics of the robot along it, then the profile of its speed.
    along = PathRobot(robot, path, bounds, rest)
    if limits_rates:
        _require_linear_damping(robot, rates)
        return _rate_limited(along, rates, speeds, points)
    parts = _fastest(along, speeds, points)
    return _result(along, parts, {})


def _require_linear_damping(robot: Robot, rates: RateBounds) -> None:
    """Raise InputError if the torque's rate is limited and friction is not linear."""
    if not robot.friction or np.isinf(rates.torque_rate).all():
        return
    for body in robot.model.bodies:
        joint = body.joint
        if not has_linear_damping(joint):
            raise InputError(f"torque_rate: joint '{joint.name}' has fast_damping or "
                             'Stribeck friction; expected neither')


def _speed(value: float, name: str) -> float:
    """Return the checked speed at an end of the path."""
    return number(value, name, f'a number from 0 to {FASTEST:g}',
                  lambda speed: 0.0 <= speed <= FASTEST)


def _rate_limited(along: PathRobot, rates: RateBounds, speeds: tuple[float, float],
                  points: int) -> TimeOptimal:
    """Return the fastest motion with limits of jerk or torque rate."""
    robot = along.robot
    motion = along.motion
    if along.driving is not None:
        # The third derivatives along the path are those of the joints themselves.
        raise InputError('robot: chosen speeds or constraints with a limit of jerk or '
                         'torque rate; expected a robot in joint rates, or none of '
                         'these limits')
    rates = rates.along(motion)
    # These motions rest at both ends, where the jerk is bounded too.
    for name, speed in zip(('start_speed', 'end_speed'), speeds):
        if speed:
            raise InputError(f'{name}: {speed:g} with a limit of jerk or torque rate; '
                             'expected 0')
    parts = rate_limited(robot, motion, along.bounds, rates, points, along.check)
    uses = rate_uses_at_points(robot, [part.points for part in parts], rates)
    return _result(along, parts, uses)


def _result(along: PathRobot, parts: Sequence[Checked], rate_uses: dict[str, Array]
            ) -> TimeOptimal:
    """Return the motion along all sections."""
    points, coefficients = joined_sections([part.points for part in parts])
    motion = along.motion_of(points, coefficients)
    tau = parts[0].tau
    if len(parts) > 1:
        tau = np.concatenate([part.tau for part in parts])
    robot = along.robot
    parameters = robot.parameters.copy()  # the robot's may change later
    timing = TimeOptimal(motion, points, tau, robot, parameters, robot.limits,
                         along.bounds, rate_uses)
    _require_resolution(timing)
    return timing


def _require_resolution(timing: TimeOptimal) -> None:
    """
    Raise InputError where positions are too coarse for the accelerations between points.

    Positions are floating-point numbers, and the polynomials between points have their
    rounding over the squared interval as an error of the acceleration. It matters where
    the motion uses a limit.
    """
    points = timing.points
    intervals = points.t[1:] - points.t[:-1]
    accelerations = abs(points.udot).max()
    largest_rounding = EPSILON * abs(points.q).max()
    travel = abs(points.q[::FEW] - points.q[0]).max()
    moves = travel > RESTING * largest_rounding
    # Most grids are far from coarse, and need no more.
    if moves and ROUNDED * largest_rounding <= LARGEST * accelerations * (
            intervals.min()**2):
        return
    highest = points.q.max(axis=0)
    lowest = points.q.min(axis=0)
    positions = np.maximum(highest, -lowest)
    rounding = EPSILON * positions
    moving = highest - lowest > RESTING * rounding
    errors = ROUNDED * rounding[moving].max(initial=0.0) / accelerations / intervals**2

    # Rests between two sections, and equal positions, have no such error. Positions of
    # the sections that meet at a rest may differ by their rounding.
    at_rest = (points.u == 0.0).all(axis=1)
    equal = (np.diff(points.q, axis=0) == 0.0).all(axis=1)
    errors[equal | at_rest[1:] & at_rest[:-1]] = 0.0
    largest_use = np.zeros(len(points.t))
    for quantity, uses in timing.uses.items():
        if quantity != 'velocity':  # which no error of the acceleration changes
            largest_use = np.maximum(largest_use, uses.max(axis=1))
    excess = np.maximum(largest_use[1:], largest_use[:-1]) + errors - 1.0
    if excess.max() > LARGEST or not moving.any():
        shortest = intervals[excess.argmax()]
        raise InputError(
            f'path: {points.t[-1]:.3g} s long, with intervals of {shortest:.3g} s and '
            f'positions up to {positions[moving].max(initial=0.0):.3g}, whose rounding '
            f'exceeds limits by more than {LARGEST:g}; expected a longer path or fewer '
            'points')


class _Coarse(Exception):  # noqa: N818 - raised only inside this module
    """
    No timing was found on a grid; one may exist on a finer grid.

    `finest` is the number of intervals from which it is unlikely; None for that which
    resolves the path.
    """

    def __init__(self, message: str, finest: int | None = None,
                 reason: Exception | None = None) -> None:
        super().__init__(message)
        self.finest, self.reason = finest, reason or InputError(message)


def _fastest(along: PathRobot, speeds: tuple[float, float], points: int
             ) -> list[Checked]:
    """Return the sections of a path with their timings, on grids that get finer."""
    segments = len(along.motion.times) - 1
    # Grids from coarse to fine: a path without a timing on a coarse grid may have one on
    # a finer one.
    fine = min(max(FINE, DIVISIONS * segments), FINEST)
    best: list[Checked] = []
    shortest = math.inf
    while True:
        parts = along.sections(points, (not speeds[0], not speeds[1]))
        for part in parts:
            along.check(part)
        excess = SMALL if points < FINEST else LARGEST
        slower = math.inf
        try:
            timings, time, slower = _all_solved(along, parts, speeds, excess)
            if time < shortest:
                best = timings
                shortest = time
        except _Coarse as error:
            if points >= (error.finest or fine) and not best:
                raise error.reason from None
        # Done when the checked timing is hardly slower than the solved one, or on the
        # finest grid.
        if best and (slower <= COARSE or points >= FINE):
            return best
        points *= 2


def _all_solved(along: PathRobot, parts: Sequence[Section], speeds: tuple[float, float],
                excess: float) -> tuple[list[Checked], float, float]:
    """
    Return all sections with their timings, the whole time, and how much slower it is.

    That is by the limits that were tightened, as a share of the time without them.
    """
    timings = []
    whole = 0.0
    untightened = 0.0
    # The motion rests between sections; speeds are asked for at its ends alone.
    for k, part in enumerate(parts):
        start = speeds[0] if k == 0 else 0.0
        end = speeds[1] if k == len(parts) - 1 else 0.0
        try:
            timing, time = _solve(along, part, start, end, excess)
        except LoopError as error:
            # The points are too far apart beside a singular configuration.
            raise _Coarse(str(error), None, error) from None
        timings.append(timing)
        whole += float(timing.points.t[-1])
        untightened += time
    return timings, whole, whole / untightened - 1.0


def _solve(along: PathRobot, section: Section, start: float, end: float, excess: float
           ) -> tuple[Checked, float]:
    """
    Return the fastest timing of a section, and its duration before limits were tightened.

    The limits are exceeded at most by `excess`.
    """
    limits = along.limits(section)
    motion = along.motion_along(section)
    x: Array | None = None
    first = math.inf
    rounds = FINEST_ROUNDS if excess == LARGEST else ROUNDS
    # Limits hold at the points of the grid: where the motion exceeds them between, they
    # are tightened.
    for turn in range(rounds):
        x = _profile(limits, start, end, x)
        motion.follow(x)
        first = min(first, motion.duration)
        worst = motion.largest.max() - 1.0
        if worst <= 0.0 or (turn >= ROUNDS - 1 and worst <= excess):
            return motion.checked(), first
        # Where an excess persists, as in a segment in which friction jumps, more is
        # needed.
        persistent = max(turn - ROUNDS, 0)
        limits.tighten(motion.shares, motion.largest, TIGHTER * GROWTH**persistent)
    # The worst excess, for the message: limit, place and joint.
    timing = motion.checked()
    largest = timing.largest
    limit, k, j = np.unravel_index(int(largest.argmax()), largest.shape)
    quantity = Bounds._fields[motion.quantities[int(limit)]]
    count = len(limits.most) - 1
    raise _Coarse(
        f"path: joint '{along.names[int(j)]}': {largest.max():.6g} times its "
        f'{quantity} limit at {k / count:.3g} of the path, '
        f'{timing.points.q[k].round(4).tolist()}, on a grid of {count} intervals; '
        'expected a path without sharp corners', FINEST)


def _profile(limits: PathLimits, start: float, end: float, x: Array | None) -> Array:
    """Return the fastest profile of x = s'^2, from a guess; None starts without friction."""
    # s'^2 at both ends of the path; None where no speed is asked for.
    at_start = start**2 / limits.speed_squared(0) if start else None
    at_end = end**2 / limits.speed_squared(-1) if end else None
    # Limits depend on x by friction and power: programs of limits at the last x are
    # solved until x settles.
    slower = 0
    calm = limits.powered
    for _ in range(PROGRAMS):
        limited = limits.at(x, calm)
        try:
            sets = _sets(limits, limited, at_end)
        except Infeasible as error:
            if limits.powered and not calm:
                break  # by rounding, since x is a solution
            slower += 1
            if limits.linear or slower > SLOWER:
                raise _refusal(limits, limited, error.vertex, start, end) from None
            x = SLOW * limits.most if x is None else 0.25 * x
            continue
        first = _free_start(limits, sets) if at_start is None else at_start
        if not sets[0, 0] * (1.0 - ROUNDING) <= first <= sets[0, 1] * (1.0 + ROUNDING):
            scale = start / math.sqrt(first)
            raise _Coarse(f'start_speed: {start:g}; expected '
                          f'{scale * math.sqrt(abs(sets[0, 0])):.6g} to '
                          f'{scale * math.sqrt(sets[0, 1]):.6g}, from which the path '
                          'can be followed')
        new = np.maximum(largest_profile(sets, first), SMALLEST * limits.size)
        if at_start is not None:
            new[0] = at_start
        if at_end is not None:
            new[-1] = at_end
        longer = math.inf
        if x is not None and not limits.linear:
            longer = profile_duration(new) / profile_duration(x) - 1.0
        if limits.powered and not calm and longer > -CONVERGED:
            break
        # From a slow profile, which satisfies limits of power, the profiles grow
        # monotonically.
        x = SLOW * new if x is None and limits.powered else new
        if limits.linear or abs(longer) <= CONVERGED:
            if not calm:
                break
            calm = False
    assert x is not None
    if (x >= 0.5 * limits.free).any():
        raise InputError('robot: no limit bounds the motion; expected limits of effort '
                         'or acceleration, which bound it everywhere')
    return np.asarray(x)


def _free_start(limits: PathLimits, sets: Array) -> float:
    """Return the largest x with which the end can be reached from the start."""
    largest = float(sets[0, HIGH])
    # One-sided limits are exact to rounding only, and steep where q_s vanishes.
    return largest if limits.linear else largest * (1.0 - ROUNDING)


def _sets(limits: PathLimits, limited: IntervalLimits, end: float | None) -> Array:
    """Return the controllable sets; linear limits need only what has changed."""
    # Of limits that are linear, the sets of the last round hold but near tightened
    # points.
    known = None
    if limits.linear and limits.sets is not None:
        known = limits.sets, limits.tightened
    end_is_known = known is not None and len(limits.most) - 1 not in limits.tightened[-1:]
    if end is not None:
        last = end, end
    elif known is not None and end_is_known:
        last = 0.0, float(known[0][-1, HIGH])
    else:
        last = 0.0, end_limit(limited)
    limits.sets = None  # while they are written to
    limits.sets = controllable_sets(limited, last, known)
    return limits.sets


def _refusal(limits: PathLimits, limited: IntervalLimits, vertex: int, start: float,
             end: float) -> Exception:
    """Return the reason why no timing satisfies the limits."""
    names, bound = limits.robot.joint_names, limits.bounds.effort
    at_rest = limits.largest_at_rest

    # The reason in the order of certainty: torque at rest, an end speed, else a place on
    # the path.
    with np.errstate(divide='ignore', invalid='ignore'):
        uses = np.nan_to_num(at_rest / bound, posinf=math.inf)
    k, j = np.unravel_index(int(uses.argmax()), uses.shape)
    count = len(limits.constant) - 1
    if uses[k, j] > 1.0:
        q = limits.section.q[2 * k].round(4).tolist()
        return InputError(
            f"path: joint '{names[int(j)]}': torque {at_rest[k, j]:.6g} at "
            f'rest at {k / count:.3g} of the path, {q}; expected at most its effort '
            f'limit {bound[j]:.6g}')
    largest = _largest_end(limits, limited, start)
    if end > largest:
        smaller = f'at most {largest:.6g}' if limits.linear else 'a smaller one'
        return _Coarse(f'end_speed: {end:g}; expected {smaller}, with which the path '
                       'can be followed')
    # Else the place at which the set of possible speeds is empty.
    q = limits.section.q[2 * vertex].round(4).tolist()
    return _Coarse(
        f'path: no timing satisfies the limits from {vertex / count:.3g} of the path, '
        f'{q}, with start_speed {start:g} and end_speed {end:g}, on a grid of {count} '
        'intervals; expected a path that the motors can follow, or more points')


def _largest_end(limits: PathLimits, limited: IntervalLimits, start: float) -> float:
    """Return the largest speed at the end of the path; infinite if it is not known."""
    try:
        sets = controllable_sets(limited, (0.0, end_limit(limited)))
    except Infeasible:
        return math.inf
    first = start**2 / limits.speed_squared(0) if start else sets[0, 1]
    if not sets[0, 0] <= first <= sets[0, 1]:
        return math.inf
    x = largest_profile(sets, float(first))[-1]
    return math.sqrt(x * limits.speed_squared(-1))
