"""
Refuse motions that cannot be: one set of rules for every motion that the node receives.

A motion is refused if it leaves the position limits, sets out far from where the arm is,
begins or ends with a jump of the speed, or needs speeds or efforts beyond the limits by
more than a factor. It is judged at its points, on both sides of them, and at some times
between them.
"""

from collections.abc import Sequence
import math

from kane_dynamics.control.computed_torque import joints_that_follow
from kane_dynamics.control.terms import Mode
from kane_dynamics.control.trajectory_limits import described_time
from kane_dynamics.errors import InputError
from kane_dynamics.loop_tracking.driven_mechanism import (driving_tracker,
                                                          motion_of_closed)
from kane_dynamics.loop_tracking.loop_error import LoopError
from kane_dynamics.motion.motion import Motion, State
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.parameters.command_form import EFFORT
from kane_dynamics.ros.parameters.parameter_checks import per_joint, terms
from kane_dynamics.ros.parameters.task_settings import joint_stiffness
from kane_dynamics.ros.services.served_robot import ServedRobot
from kane_dynamics.ros.torque_path.state_check import looks_like_degrees, speed_limits
import numpy as np
import numpy.ma  # noqa: F401  # else the first motion imports it, for 0.1 s

# Fractions of a segment at which it is judged; the last one is its end, before a jump of the
# acceleration.
INSIDE = np.append(np.arange(1.0, 8.0) / 8.0, 1.0 - 1e-9)
MOST_TIMES = 20_000  # at which a motion is judged: a few milliseconds of native code
MOST_CLOSURES = 400  # of closed loops, in Python
ROUNDING = 1e-6  # rad or m
# Jumps of the desired speed that are accepted, as shares of the joint's limit: at the end
# what rounding leaves; where a motion sets out also what it gains while its message is on
# the way and is judged.
JUMP_AT_END, JUMP_AT_START = 0.01, 0.05


def refuse_impossible(served: ServedRobot, motion: Motion, place: Array | None = None,
                      moment: float = 0.0, speeds: Array | None = None) -> None:
    """
    Raise InputError unless an arm can move like that.

    Parameters
    ----------
    served : ServedRobot
        The robot of the calling thread, with its loads applied, and the node's
        parameters: trajectory.*, limits.* and arm_compensates are used.
    motion : Motion
        Of some or all joints of the robot.
    place : (n,) array, optional
        Where the joints of the motion are at `moment`, rad or m; the motion must be
        near.
    moment : float
        Time of the motion, s, from which on it is executed.
    speeds : (n,) array, optional
        Desired speeds until `moment`, rad/s or m/s; the motion must begin with them.

    Raises
    ------
    InputError
        Names the joint, the time, the value and the limit.
    LoopError
        The loops do not close along the motion.

    """
    names = motion.joint_names
    # First the points that the message states, then what lies between them.
    check_positions(served, names, motion.positions, motion.times, place=place)
    if place is not None:
        _check_start(served, motion, place, moment)
    _check_ends(served, motion, moment, speeds)
    times = _times(motion, MOST_TIMES)
    state = motion.sample(times)
    check_positions(served, names, state[0], motion.times, times, place)
    _check_speeds(served, motion, times, state[1])
    # Efforts follow from a motion of all joints that determine the others.
    if set(joints_that_follow(served.robot)) <= _places(served, names):
        _check_efforts(served, motion)
        if place is not None:
            _check_first_effort(served, motion, place, max(moment, 0.0))


def check_positions(served: ServedRobot, names: Sequence[str], positions: Array,
                    points: Array,
                    times: Array | None = None, place: Array | None = None) -> None:
    """
    Raise InputError unless positions are within the limits of their joints.

    Parameters
    ----------
    served : ServedRobot
        The robot and the node's parameters.
    names : sequence of n str
        Names of the joints.
    positions : (K, n) array
        rad or m.
    points : array
        Times of the points of the motion, s, by which the message describes a time.
    times : (K,) array, optional
        Times of the positions, s. Default: those of the points.
    place : (n,) array, optional
        Where the joints are: if outside the limits, they may move back from there.

    """
    limits = served.robot.limits
    places = _indices(served, names)
    lower = limits.lower[places] - ROUNDING
    upper = limits.upper[places] + ROUNDING
    if place is not None:
        # An arm outside its limits may move back, but no farther out.
        lower = np.minimum(lower, place)
        upper = np.maximum(upper, place)
    # How far each position is outside; negative inside.
    outside = np.maximum(lower - positions, positions - upper)
    if not (outside > 0.0).any():
        return
    k, j = divmod(int(np.argmax(outside)), len(names))
    value = float(positions[k, j])
    low = float(lower[j])
    high = float(upper[j])
    expected = f'at most {high:.6g}' if value > high else f'at least {low:.6g}'
    time_of_row = points[k] if times is None else times[k]
    when = described_time(float(time_of_row), points)
    raise InputError(f"joint '{names[j]}': position {value:.6g} {when}; expected "
                     f'{expected}{looks_like_degrees(value, low, high)}')


def _check_start(served: ServedRobot, motion: Motion, place: Array,
                 moment: float) -> None:
    """Raise InputError unless the motion sets out near the place where the arm is."""
    tolerance = served.values['trajectory.start_tolerance']
    # A motion that has begun already is compared where it is now.
    q = motion.sample(max(moment, 0.0))[0]
    away = np.abs(q - place)
    if (away <= tolerance).all():
        return
    j = int(np.argmax(away))
    # The joint that is farthest away; a value that fits in degrees is remarked on.
    name = motion.joint_names[j]
    limits = served.robot.limits
    at = _indices(served, [name])[0]
    hint = ''
    if abs(math.radians(float(q[j])) - place[j]) < 0.1 * abs(q[j] - place[j]):
        hint = looks_like_degrees(float(q[j]), float(limits.lower[at]),
                                  float(limits.upper[at]))
    raise InputError(f"joint '{name}': the motion sets out at {q[j]:.6g}, the arm is at "
                     f'{place[j]:.6g} rad or m; expected at most {tolerance:g} away '
                     '(parameter trajectory.start_tolerance), or a first point after 0 '
                     f's{hint}')


def _check_ends(served: ServedRobot, motion: Motion, moment: float,
                speeds: Array | None) -> None:
    """Raise InputError if the desired speed jumps where a motion begins or ends."""
    still = np.zeros(motion.n)
    last = still
    fastest = still
    if len(motion.times) > 1:
        inside = motion.velocities_inside(np.array([0.0, 0.5, 1.0]))
        last = inside[-1, -1]
        fastest = np.abs(inside).max(axis=(0, 1))
    limit = speed_limits(served.robot, served.values)[_indices(served,
                                                               motion.joint_names)]
    scale = np.where(np.isfinite(limit), limit, fastest)
    jumps = [(last, still, JUMP_AT_END, f'at the last point ({motion.duration:g} s)', '')]
    begin = float(motion.times[0])
    if speeds is not None:
        jumps.append((motion.sample(max(moment, 0.0))[1], speeds, JUMP_AT_START,
                      f'where the motion sets out ({max(moment, 0.0):g} s)',
                      ', the desired speed until then, or a first point after 0 s'))
    if begin > max(moment, 0.0):
        jumps.append((motion.sample(begin)[1], still, JUMP_AT_END,
                      f'at the first point ({begin:g} s)', ''))
    for after, before, share, where, remedy in jumps:
        excess = np.abs(after - before) - share * scale - ROUNDING
        if (excess > 0.0).any():
            j = int(np.argmax(excess))
            raise InputError(f"joint '{motion.joint_names[j]}': velocity {after[j]:.4g} "
                             f'rad/s or m/s {where}; expected {before[j] + 0.0:.4g}'
                             f'{remedy}')


def _check_speeds(served: ServedRobot, motion: Motion, times: Array, u: Array) -> None:
    """Raise InputError if a joint must be faster than its limit times the factor."""
    factor = served.values['trajectory.limit_factor']
    limit = speed_limits(served.robot, served.values)[_indices(served,
                                                               motion.joint_names)]
    _check_limit('speed', motion, motion.joint_names, times, u, limit, factor)


def _check_efforts(served: ServedRobot, motion: Motion) -> None:
    """Raise InputError if the motion needs more effort than the factor allows."""
    robot = served.robot
    values = served.values
    # The limit of the command, by which the motion would be clipped.
    factor = values['trajectory.limit_factor']
    stated = per_joint(values, 'limits.effort', robot.joint_names, math.inf)
    limit = np.minimum(robot.limits.effort, stated)
    direct = robot.equations.in_joint_rates
    times = _times(motion, MOST_TIMES if direct else MOST_CLOSURES)
    tau = motion_efforts(served, motion, times, motion.sample(times))
    _check_limit('effort', motion, robot.joint_names, times, tau, limit, factor)


def _check_first_effort(served: ServedRobot, motion: Motion, place: Array,
                        moment: float) -> None:
    """Raise InputError if the offset at the start asks a law for more effort than allowed."""
    robot = served.robot
    values = served.values
    mode = Mode(values['mode'])
    columns = _indices(served, motion.joint_names)
    times = np.array([moment])
    q, u, udot = motion.sample(times)
    offset = q - place
    # The spring of the law acts on the acceleration, or on the torque of each joint.
    spring = np.zeros(len(robot.joint_names))
    if mode is Mode.COMPUTED_TORQUE:
        udot = udot + per_joint(values, 'gains.kp', robot.joint_names, 0.0)[columns] * offset
    elif mode is Mode.JOINT_IMPEDANCE:
        spring[columns] = joint_stiffness(values, robot)[columns] * offset[0]
    elif mode is Mode.INVERSE_DYNAMICS and values['commands.form'] != EFFORT:
        drives = per_joint(values, 'commands.stiffness', robot.joint_names, 0.0)
        spring[columns] = drives[columns] * offset[0]
    else:
        return
    stated = per_joint(values, 'limits.effort', robot.joint_names, math.inf)
    tau = motion_efforts(served, motion, times, (q, u, udot)) + spring
    _check_limit('effort with the distance from the arm', motion, robot.joint_names, times,
                 tau, np.minimum(robot.limits.effort, stated),
                 values['trajectory.limit_factor'])


def motion_efforts(served: ServedRobot, motion: Motion, times: Array,
                   state: State) -> Array:
    """
    Return the efforts of all joints, (K, n_q), without what the arm adds itself.

    Parameters
    ----------
    served : ServedRobot
        The robot of the calling thread, with its loads applied.
    motion : Motion
        Of the joints that determine the others.
    times : (K,) array
        s.
    state : (q, u, udot)
        The motion at these times, (K, n) each.

    Raises
    ------
    KaneError
        The loops do not close, or leave the position limits.

    """
    if not served.robot.equations.in_joint_rates:
        return _constrained_efforts(served, motion, times, state)
    return terms(served.values).inverse_dynamics(served.bending or served.robot,
                                                 *_whole(served, motion, state))


def _whole(served: ServedRobot, motion: Motion, state: State) -> Array:
    """Return q, u and udot, (3, K, n), in the order of the robot's joints."""
    columns = list(map(motion.joint_names.index, served.robot.joint_names))
    return np.ascontiguousarray(np.array(state)[..., columns])


def _constrained_efforts(served: ServedRobot, motion: Motion, times: Array,
                         state: State) -> Array:
    """Return the torques of all joints, (K, n_q), of a robot with closed loops."""
    robot = served.robot
    # The driving joints of the motion, and all joints that follow from them.
    driving = joints_that_follow(robot)
    columns = [motion.joint_names.index(robot.joint_names[k]) for k in driving]
    q, rates, accelerations = (values[:, columns] for values in state)
    Q = _closed(served, motion, times, q, driving)
    check_positions(served, robot.joint_names, Q, motion.times, times, served.measured())
    whole = motion_of_closed(robot, driving, np.zeros(len(times)), Q, rates,
                             accelerations)
    # The torques of the command, with the terms that are switched on.
    tau = terms(served.values).inverse_dynamics(served.bending or robot, *whole)
    efforts: Array = robot.joint_torques(tau, whole.q)
    return efforts


def _closed(served: ServedRobot, motion: Motion, times: Array, q: Array,
            driving: Sequence[int]) -> Array:
    """Return closed configurations, (K, n_q), in the assembly mode of the arm."""
    robot = served.robot
    values = served.values
    tracker = driving_tracker(robot, [robot.joint_names[k] for k in driving],
                              tolerance=values['closure.tolerance'],
                              max_figure=values['closure.max_conditioning'])
    if tracker is None:  # chosen speeds of a tree: no joint follows from others
        closed = np.zeros((len(q), robot.n_q))
        closed[:, driving] = q
        return closed
    order = [list(driving).index(k) for k in tracker.places]
    # From where the arm is, so that the loops keep its assembly mode.
    start = served.measured()
    if start is not None:
        tracker.restart(start)
    # Only the configurations are asked for: the rates are zero.
    still = np.zeros(robot.n)
    rows = []
    for time, row in zip(times.tolist(), q[:, order]):
        try:
            tracker.update(row, still)
        except LoopError as error:
            raise LoopError(error.reason, f'{described_time(time, motion.times)}: '
                            f'{error.detail}') from None
        rows.append(tracker.q.copy())
    return np.array(rows)


def _check_limit(what: str, motion: Motion, names: Sequence[str], times: Array,
                 values: Array, limit: Array, factor: float) -> None:
    """Raise InputError if values, (K, n), exceed a limit, (n,), times the factor."""
    excess = np.abs(values) - factor * limit * (1.0 + ROUNDING)
    if not (excess > 0.0).any():
        return
    # The largest excess, relative to the limit.
    k, j = divmod(int(np.argmax(np.abs(values) / limit)), len(names))
    raise InputError(f"joint '{names[j]}': {what} {values[k, j]:.6g} "
                     f'{described_time(float(times[k]), motion.times)}; expected at '
                     f'most {factor * limit[j]:.6g}, {factor:g} times its limit '
                     '(parameter trajectory.limit_factor)')


def _times(motion: Motion, most: int) -> Array:
    """Return times at which a motion is judged: its points, and some between them."""
    knots = motion.times
    count = len(motion.times)
    # Of very many points some are judged; of few, also places between them.
    if count > most:
        chosen: Array = knots[np.unique(np.linspace(0, count - 1, most).astype(int))]
        return chosen
    inside = INSIDE[::max(1, math.ceil(len(INSIDE) * count / most))]
    between = knots[:-1] + inside[:, None] * np.diff(knots)
    return np.sort(np.concatenate([knots, between.ravel()]))


def _indices(served: ServedRobot, names: Sequence[str]) -> list[int]:
    """Return the indices of joints of the robot."""
    return list(map(served.robot.joint_names.index, names))


def _places(served: ServedRobot, names: Sequence[str]) -> set[int]:
    """Return the indices of joints of the robot, as a set."""
    return set(_indices(served, names))
