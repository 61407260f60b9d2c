"""
Efforts for a joint trajectory, as feedforward for joint_trajectory_controller.

That controller adds the trajectory's effort, interpolated linearly between points, to its PID
command. The efforts are those of the motion that it executes between the points: see
`kane_dynamics.motion.controller_points`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

from kane_dynamics._util.checks import instance, integer
from kane_dynamics._util.typing import Array
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.terms import EVERY_TERM, Terms
from kane_dynamics.control.trajectories.arm import TrajectoryArm
from kane_dynamics.control.trajectories.linkage import TrajectoryLinkage
from kane_dynamics.control.trajectory_limits import check_efforts, check_motion
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.closed_path import LoopLimits
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.motion.controller_points import completed, ControllerPoints
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.points import Start, start_state, trajectory_points
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

PROBES = np.arange(1.0, 8.0) / 8.0  # fractions of a segment at which its effort is checked
MOST_POINTS = 100_000
LONGEST = 2**31 - 1  # s, of `time_from_start`, whose resolution is 1 ns
CLOSED = LoopLimits()


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
        Largest error of the linearly interpolated effort, N m or N, at the times between points
        at which it was checked; None without a tolerance.

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
        return Motion.from_points(self.times, self.positions, self.velocities, self.accelerations,
                                  joint_names=self.joint_names)


def fill_trajectory(robot: Robot, times: ArrayLike, positions: ArrayLike,
                    velocities: ArrayLike | None = None, accelerations: ArrayLike | None = None,
                    *, joint_names: Sequence[str] | None = None, rest: ArrayLike | None = None,
                    start: Start | None = None, tolerance: ArrayLike | None = None,
                    compensate: Terms = EVERY_TERM, effort_limit: ArrayLike = math.inf,
                    clip: bool = False, max_points: int = MOST_POINTS,
                    bending: QuasiStatic | None = None, loops: LoopLimits = CLOSED
                    ) -> FilledTrajectory:
    """
    Return a trajectory with velocities, accelerations and efforts for joint_trajectory_controller.

    The controller moves between the points of the result by quintics. Missing velocities are those
    of a cubic spline, missing accelerations those of the cubics between the points (their mean
    where they differ). A trajectory that ends at rest ends without acceleration, because the
    controller holds the last effort. Efforts are `Robot.inverse_dynamics` with the robot's gravity
    and payload; friction is that of the desired velocity, which is zero at standstill.

    Parameters
    ----------
    robot : Robot
        With chosen speeds or constraints on positions, the result is of as many joints as there
        are independent speeds, those with actuators; the other joints follow from them. With more
        actuators than independent speeds (`Robot(actuated=)`) the result is of all actuators,
        which share the load as in `joint_torques`; their positions are closed at the points.
    times : (K,) array_like
        s from the start of the trajectory; nonnegative, strictly increasing, K >= 1.
    positions, velocities, accelerations : (K, m) array_like
        rad or m, and s; accelerations only with velocities.
    joint_names : sequence of m str, optional
        The joints of the columns: some or all of the robot's. Default: all, in its order. With
        constraints: those with actuators, or these and further ones, whose positions are compared
        with the loop closure at the points and, without an actuator, not part of the result.
        Default: the former. With more actuators than independent speeds: as many joints as these,
        or the independent joints and further ones; default: the independent joints.
    rest : (n,) array_like, optional
        Positions of the robot's joints, in its order, rad or m. Joints that are not in
        `joint_names` rest there; needed if there are any. With constraints: a nearly closed
        configuration, whose assembly mode is kept on the way from there to the first point and
        along the trajectory. Default: that of the robot, or the first point if of all joints, or
        else the closure that is found from zeros, which may be another mode than that of the arm.
    start : (q, u, udot), optional
        State of the trajectory's joints at time 0, (m,) each; u and udot may be None (rest). If
        the first point is later, the trajectory begins with this state. Joints without limits
        begin at the angle next to the first point, as in the controller.
    tolerance : float or (m,) array_like, optional
        Largest accepted error of the linearly interpolated effort, N m or N. Points of the same
        motion are inserted where the error, checked at seven times between each two points, is
        larger. Default: no points are inserted. Actuators that are not among the trajectory's
        joints have the smallest of the tolerances. With more actuators than independent speeds,
        points are inserted too where the quintic of an actuator deviates from the closed loops by
        more than `loops.tolerance`.
    compensate : Terms
        False for terms that the arm adds itself.
    effort_limit : float or (n,) array_like
        N m or N, of the robot's joints, in addition to the robot's own limits.
    clip : bool
        Clamp efforts to their limits instead of raising an error.
    max_points : int
        Largest number of points of the result.
    bending : QuasiStatic, optional
        The flexible arm of which `robot` is the rigid model, in the same joints and speeds; with
        constraints, the joints with actuators are the independent ones.
    loops : LoopLimits
        With constraints: largest deviation of further joints, and the conditioning.

    Raises
    ------
    ConstraintError
        The actuators cannot produce every motion in a configuration.
    LoopError
        With constraints: a singular configuration, further joints that contradict the loops, or
        loops that do not close; names the point.
    InputError
        If an argument is invalid; if the motion exceeds a limit of position, velocity or effort,
        at a point or between points: the message names the joint, the point, the value and the
        limit; or if the tolerance needs more than `max_points`.

    """
    instance(robot, Robot, 'robot')
    require_angles(robot.model, 'fill_trajectory')
    instance(compensate, Terms, 'compensate')
    if bending is not None:
        instance(bending, QuasiStatic, 'bending')
        bending.require_rigid_model(robot)
    max_points = integer(max_points, 'max_points', 1)
    arm = _arm(robot, bending, joint_names, rest, compensate, loops)
    limits, actuators = (arm.limits(effort_limit, names) for names in (
        arm.names, arm.actuators))
    t, *given = trajectory_points(times, positions, velocities, accelerations, arm.given)
    _check_times(t)
    assert given[0] is not None
    allowed = arm.allowed(math.inf if tolerance is None else tolerance)
    q, u, udot = (None if rows is None else arm.chosen(rows) for rows in given)
    assert q is not None
    points = completed(t, q, u, udot, None if start is None else arm.turned(arm.chosen(
        np.array(start_state(start, arm.given))), q[0], limits))
    _check_count(len(points.t), max_points, 'trajectory')
    begun, further = len(points.t) > len(t), arm.actuators != arm.names
    check_motion(points, _with_start(limits, points) if begun else limits, arm.names, t)
    arm.follow(points, given[0], t)
    tau = arm.efforts(points.q, points.u, points.udot)
    count, error = len(points.t), None
    if tolerance is not None or further:
        points, tau, error = _refined(arm, points, tau, allowed, max_points)
    if further:
        points = arm.executed(points)
        check_motion(points, _with_start(actuators, points) if begun else actuators,
                     arm.actuators, t)
    if clip:
        tau = np.clip(tau, -actuators.effort, actuators.effort)
    else:
        check_efforts(points.t, tau, actuators.effort, arm.actuators, t)
    return FilledTrajectory(arm.actuators, *points, tau, len(points.t) - count,
                            None if tolerance is None else error)


def _with_start(limits: JointLimits, points: ControllerPoints) -> JointLimits:
    """Return limits that contain the first point: measured, it may be slightly outside."""
    return replace(limits, lower=np.minimum(limits.lower, points.q[0]),
                   upper=np.maximum(limits.upper, points.q[0]))


def _arm(robot: Robot, bending: QuasiStatic | None, joint_names: Sequence[str] | None,
         rest: ArrayLike | None, compensate: Terms, loops: LoopLimits) -> TrajectoryArm:
    """Return the joints of the trajectory, of a tree or of a linkage."""
    if isinstance(robot.equations, TreeEquations):
        return TrajectoryArm(robot, bending or robot, joint_names, rest, compensate)
    return TrajectoryLinkage(robot, bending or robot, joint_names, rest, compensate, loops)


def _refined(arm: TrajectoryArm, points: ControllerPoints, tau: Array, tolerance: Array,
             max_points: int) -> tuple[ControllerPoints, Array, Array]:
    """Return points with more of them until the interpolated effort is right, efforts, errors."""
    error = np.zeros(len(arm.actuators))
    pending = np.arange(len(points.t) - 1)
    while pending.size:
        found = arm.efforts(*points.inside(pending, PROBES))
        x = PROBES[:, None, None]
        deviation = np.abs(found - (1.0 - x) * tau[pending] - x * tau[pending + 1]).max(axis=0)
        wrong = (deviation > tolerance).any(axis=1) | arm.strays(points, pending, PROBES)
        error = np.maximum(error, deviation[~wrong].max(axis=0, initial=0.0))
        split = pending[wrong]
        _check_count(len(points.t) + len(split), max_points, 'tolerance')
        points = points.halved(split)
        tau = np.insert(tau, split + 1, found[len(PROBES) // 2, wrong], axis=0)
        first = split + np.arange(len(split))
        pending = np.stack([first, first + 1], axis=1).ravel()
    return points, tau, error


def _check_times(t: Array) -> None:
    """Raise InputError unless a JointTrajectory can have these times."""
    if t[-1] > LONGEST:
        raise InputError(f'point {len(t) - 1}: time {t[-1]:g} s; expected at most {LONGEST} s, as '
                         'in a JointTrajectory')
    near = np.flatnonzero(np.diff(np.rint(1e9 * t)) < 1.0)
    if near.size:
        k = int(near[0])
        raise InputError(f'point {k + 1}: {t[k + 1] - t[k]:.3g} s after point {k}; expected at '
                         'least 1e-09 s, the resolution of a JointTrajectory')


def _check_count(count: int, most: int, what: str) -> None:
    if count > most:
        raise InputError(f'{what}: {count} points or more; expected at most {most}'
                         + (': a larger tolerance' if what == 'tolerance' else ''))
