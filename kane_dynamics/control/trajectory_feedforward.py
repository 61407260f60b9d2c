"""
Efforts for a joint trajectory, as feedforward for joint_trajectory_controller.

That controller adds the trajectory's effort, interpolated linearly between points, to
its PID command. The efforts are those of the motion that it executes between the points:
see `kane_dynamics.motion.controller_points`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

from kane_dynamics._util.checks import instance, integer
from kane_dynamics._util.typing import Array
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.terms import EVERY_TERM, Terms
from kane_dynamics.control.trajectory_joints import TrajectoryJoints
from kane_dynamics.control.trajectory_limits import check_efforts, check_motion
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints.conditioning import SINGULAR
from kane_dynamics.model.elastic_model import require_rigid_joints
from kane_dynamics.motion.controller_points import completed, ControllerPoints
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.points import Start, start_state, trajectory_points
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

PROBES = np.arange(1.0, 8.0) / 8.0  # of a segment: where its effort is checked
MOST_POINTS = 100_000
LONGEST = 2**31 - 1  # s, of `time_from_start`, whose resolution is 1 ns
LOOP_TOLERANCE = 0.02  # rad or m, of further joints from the closed loops


@dataclass(frozen=True, eq=False)
class FilledTrajectory:
    """
    A joint trajectory with positions, velocities, accelerations and efforts.

    Attributes
    ----------
    joint_names : tuple of str
    times : (K,) array
        s from the start of the trajectory.
    positions, velocities, accelerations, efforts : (K, n) arrays
        rad or m, and s; N m or N.
    inserted : int
        Number of points that were inserted.
    effort_error : (n,) array or None
        Largest error of the linearly interpolated effort, N m or N, at the times between
        points at which it was checked; None without a tolerance.

    """

    joint_names: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array
    accelerations: Array
    efforts: Array
    inserted: int
    effort_error: Array | None

    @property
    def motion(self) -> Motion:
        """Return the motion that the controller executes."""
        return Motion.from_points(self.times, self.positions, self.velocities,
                                  self.accelerations, joint_names=self.joint_names)


def fill_trajectory(robot: Robot, times: ArrayLike, positions: ArrayLike,
                    velocities: ArrayLike | None = None,
                    accelerations: ArrayLike | None = None, *,
                    joint_names: Sequence[str] | None = None,
                    rest: ArrayLike | None = None, start: Start | None = None,
                    tolerance: ArrayLike | None = None, compensate: Terms = EVERY_TERM,
                    effort_limit: ArrayLike = math.inf, clip: bool = False,
                    max_points: int = MOST_POINTS, bending: QuasiStatic | None = None,
                    loop_tolerance: float = LOOP_TOLERANCE,
                    max_figure: float = SINGULAR) -> FilledTrajectory:
    """
    Return a trajectory with derivatives and efforts for joint_trajectory_controller.

    The controller moves between the points of the result by quintics. Missing velocities
    are those of a cubic spline, missing accelerations those of the cubics between the
    points (their mean where they differ). A trajectory that ends at rest ends without
    acceleration, because the controller holds the last effort. Efforts are
    `Robot.inverse_dynamics` with the robot's gravity and payload; friction is that of
    the desired velocity, which is zero at standstill.

    Parameters
    ----------
    robot : Robot
        With chosen speeds or constraints on positions, the result is of as many joints
        as there are independent speeds, those with actuators; the other joints follow
        from them. With more actuators than independent speeds (`Robot(actuated=)`) the
        result is of all actuators, which share the load as in `joint_torques`; their
        positions are closed at the points.
    times : (K,) array_like
        s from the start of the trajectory; nonnegative, strictly increasing, K >= 1.
    positions, velocities, accelerations : (K, m) array_like
        rad or m, and s; accelerations only with velocities.
    joint_names : sequence of m str, optional
        The joints of the columns: some or all of the robot's. Default: all, in its
        order. With constraints: those with actuators, or these and further ones, whose
        positions are compared with the loop closure at the points and, without an
        actuator, not part of the result. Default: the former. With more actuators than
        independent speeds: as many joints as these, or the independent joints and
        further ones; default: the independent joints.
    rest : (n,) array_like, optional
        Positions of the robot's joints, in its order, rad or m. Joints that are not in
        `joint_names` rest there; needed if there are any. With constraints: a nearly
        closed configuration, whose assembly mode is kept on the way from there to the
        first point and along the trajectory. Default: that of the robot, or the first
        point if of all joints, or else the closure that is found from zeros, which may
        be another mode than that of the arm.
    start : (q, u, udot), optional
        State of the trajectory's joints at time 0, (m,) each; u and udot may be None
        (rest). If the first point is later, the trajectory begins with this state.
        Joints without limits begin at the angle next to the first point, as in the
        controller.
    tolerance : float or (m,) array_like, optional
        Largest accepted error of the linearly interpolated effort, N m or N. Points of
        the same motion are inserted where the error, checked at seven times between each
        two points, is larger. Default: no points are inserted. Actuators that are not
        among the trajectory's joints have the smallest of the tolerances. With more
        actuators than independent speeds, points are inserted too where the quintic of
        an actuator deviates from the closed loops by more than `loop_tolerance`.
    compensate : Terms
        False for terms that the arm adds itself.
    effort_limit : float or (n,) array_like
        N m or N, of the robot's joints, in addition to the robot's own limits.
    clip : bool
        Clamp efforts to their limits instead of raising an error.
    max_points : int
        Largest number of points of the result.
    bending : QuasiStatic, optional
        The flexible arm of which `robot` is the rigid model, in the same joints and
        speeds; with constraints, the joints with actuators are the independent ones.
    loop_tolerance : float
        With constraints: largest deviation of further joints from the closed loops, rad
        or m.
    max_figure : float
        With constraints: largest conditioning figure, as in `LoopTracker`.

    Raises
    ------
    ConstraintError
        The actuators cannot produce every motion in a configuration.
    LoopError
        With constraints: a singular configuration, further joints that contradict the
        loops, or loops that do not close; names the point.
    InputError
        If an argument is invalid; if the motion exceeds a limit of position, velocity or
        effort, at a point or between points: the message names the joint, the point, the
        value and the limit; or if the tolerance needs more than `max_points`.

    """
    instance(robot, Robot, 'robot')
    require_angles(robot.model, 'fill_trajectory')
    require_rigid_joints(robot.model)
    instance(compensate, Terms, 'compensate')
    # With bending, the torques are those of the flexible robot in equilibrium.
    source: Robot | QuasiStatic = robot
    if bending is not None:
        instance(bending, QuasiStatic, 'bending')
        bending.require_rigid_model(robot)
        source = bending
    max_points = integer(max_points, 'max_points', 1)
    joints = TrajectoryJoints(robot, source, joint_names, rest, compensate,
                              loop_tolerance, max_figure)
    limits = joints.limits(effort_limit, joints.driving)
    actuator_limits = joints.limits(effort_limit, joints.actuators)

    # The points as given, of all joints of the trajectory; then those of the driving
    # joints.
    t, q, u, udot = trajectory_points(times, positions, velocities, accelerations,
                                      joints.names)
    assert q is not None
    _check_times(t)
    allowed = joints.allowed(math.inf if tolerance is None else tolerance)
    points = _completed(joints, t, (q, u, udot), start, limits)
    _check_count(len(points.t), max_points, 'trajectory')
    has_start = len(points.t) > len(t)
    if has_start:
        limits = _with_start(limits, points)
    check_motion(points, limits, joints.driving, t)
    joints.follow(points, q, t)

    # Efforts, with more points where their interpolation deviates. More actuators than
    # driving joints move by quintics too, which must stay near the closed loops.
    tau = joints.efforts(points.q, points.u, points.udot)
    count = len(points.t)
    error: Array | None = None
    redundant = joints.actuators != joints.driving
    if tolerance is not None or redundant:
        points, tau, deviation = _refined(joints, points, tau, allowed, max_points)
        error = None if tolerance is None else deviation
    if redundant:
        points = joints.executed(points)
        if has_start:
            actuator_limits = _with_start(actuator_limits, points)
        check_motion(points, actuator_limits, joints.actuators, t)
    if clip:
        tau = np.clip(tau, -actuator_limits.effort, actuator_limits.effort)
    else:
        check_efforts(points.t, tau, actuator_limits.effort, joints.actuators, t)
    inserted = len(points.t) - count
    return FilledTrajectory(joints.actuators, *points, tau, inserted, error)


def _completed(joints: TrajectoryJoints, t: Array, state: tuple[Array | None, ...],
               start: Start | None, limits: JointLimits) -> ControllerPoints:
    """Return the points of the driving joints, from the start if there is one."""
    q, u, udot = (None if rows is None else joints.chosen(rows) for rows in state)
    assert q is not None
    if start is None:
        return completed(t, q, u, udot)
    measured = joints.chosen(np.array(start_state(start, joints.names)))
    return completed(t, q, u, udot, joints.turned(measured, q[0], limits))


def _with_start(limits: JointLimits, points: ControllerPoints) -> JointLimits:
    """Return limits widened to the first point, which is measured and may be outside."""
    return replace(limits, lower=np.minimum(limits.lower, points.q[0]),
                   upper=np.maximum(limits.upper, points.q[0]))


def _refined(joints: TrajectoryJoints, points: ControllerPoints, tau: Array,
             tolerance: Array, max_points: int) -> tuple[ControllerPoints, Array, Array]:
    """
    Return points, more of them until interpolated efforts are right; efforts, errors.

    Every segment with an error is halved, and both halves are checked next.
    """
    error = np.zeros(len(joints.actuators))
    pending = np.arange(len(points.t) - 1)
    x = PROBES[:, None, None]
    while pending.size:
        efforts = joints.efforts(*points.inside(pending, PROBES))
        interpolated = (1.0 - x) * tau[pending] + x * tau[pending + 1]
        deviation = np.abs(efforts - interpolated).max(axis=0)
        wrong = (deviation > tolerance).any(axis=1) | joints.strays(points, pending,
                                                                    PROBES)
        error = np.maximum(error, deviation[~wrong].max(axis=0, initial=0.0))
        # Halve the segments with an error: their middles are probes that are known.
        split = pending[wrong]
        _check_count(len(points.t) + len(split), max_points, 'tolerance')
        points = points.halved(split)
        middle = efforts[len(PROBES) // 2, wrong]
        tau = np.insert(tau, split + 1, middle, axis=0)
        # Every point that was inserted moves the segments behind it on by one.
        first = split + np.arange(len(split))
        pending = np.stack([first, first + 1], axis=1).ravel()
    return points, tau, error


def _check_times(t: Array) -> None:
    """Raise InputError unless a JointTrajectory can have these times."""
    if t[-1] > LONGEST:
        raise InputError(f'point {len(t) - 1}: time {t[-1]:g} s; expected at most '
                         f'{LONGEST} s, as in a JointTrajectory')
    # Stamps have whole nanoseconds.
    near = np.flatnonzero(np.diff(np.rint(1e9 * t)) < 1.0)
    if near.size:
        k = int(near[0])
        raise InputError(f'point {k + 1}: {t[k + 1] - t[k]:.3g} s after point {k}; '
                         'expected at least 1e-09 s, the resolution of a '
                         'JointTrajectory')


def _check_count(count: int, largest: int, what: str) -> None:
    """Raise InputError for too many points; `what` leads to them."""
    if count <= largest:
        return
    remedy = ': a larger tolerance' if what == 'tolerance' else ''
    raise InputError(f'{what}: {count} points or more; expected at most '
                     f'{largest}{remedy}')
