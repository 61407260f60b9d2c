"""
Efforts for a joint trajectory, as feedforward for joint_trajectory_controller.

That controller adds the trajectory's effort, interpolated linearly between points, to its PID
command. The efforts are those of the motion that it executes between the points: see
`kane_dynamics.motion.controller_points`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

from kane_dynamics._util.checks import finite_row, instance, integer, per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.control.constrained_law import followed_joints
from kane_dynamics.control.constrained_torques import LinkageEfforts
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.terms import EVERY_TERM, Terms
from kane_dynamics.control.trajectory_limits import check_efforts, check_motion
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.motion.controller_points import completed, ControllerPoints
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.points import (checked_joint_names, Start, start_state, State,
                                         trajectory_points)
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

PROBES = np.arange(1.0, 8.0) / 8.0  # fractions of a segment at which its effort is checked
MOST_POINTS = 100_000
LONGEST = 2**31 - 1  # s, of `time_from_start`, whose resolution is 1 ns
TURN = 2.0 * math.pi


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
                    bending: QuasiStatic | None = None) -> FilledTrajectory:
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
        With chosen speeds or constraints on positions, the trajectory is of as many joints as
        there are independent speeds, those with actuators; the other joints follow from them.
    times : (K,) array_like
        s from the start of the trajectory; nonnegative, strictly increasing, K >= 1.
    positions, velocities, accelerations : (K, m) array_like
        rad or m, and s; accelerations only with velocities.
    joint_names : sequence of m str, optional
        The joints of the columns: some or all of the robot's. Default: all, in its order.
    rest : (n,) array_like, optional
        Positions of the robot's joints, in its order, rad or m. Joints that are not in
        `joint_names` rest there; needed if there are any. With constraints: the configuration
        near which the loops are closed; default: that of the robot.
    start : (q, u, udot), optional
        State of the trajectory's joints at time 0, (m,) each; u and udot may be None (rest). If
        the first point is later, the trajectory begins with this state. Joints without limits
        begin at the angle next to the first point, as in the controller.
    tolerance : float or (m,) array_like, optional
        Largest accepted error of the linearly interpolated effort, N m or N. Points of the same
        motion are inserted where the error, checked at seven times between each two points, is
        larger. Default: no points are inserted.
    compensate : Terms
        False for terms that the arm adds itself.
    effort_limit : float or (n,) array_like
        N m or N, of the robot's joints, in addition to the robot's own limits.
    clip : bool
        Clamp efforts to their limits instead of raising an error.
    max_points : int
        Largest number of points of the result.
    bending : QuasiStatic, optional
        The flexible arm of which `robot` is the rigid model.

    Raises
    ------
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
    max_points = integer(max_points, 'max_points', 1)
    arm = _Arm(robot, bending or robot, joint_names, rest, compensate) if isinstance(
        robot.equations, TreeEquations) else _Linkage(robot, bending, joint_names, rest,
                                                      compensate)
    names, limits = arm.names, arm.limits(effort_limit)
    t, q, u, udot = trajectory_points(times, positions, velocities, accelerations, names)
    _check_times(t)
    points = completed(t, q, u, udot, None if start is None else arm.turned(
        start_state(start, names), q[0], limits))
    _check_count(len(points.t), max_points, 'trajectory')
    if len(points.t) > len(t):  # a measured position may be slightly outside of the limits
        limits = replace(limits, lower=np.minimum(limits.lower, points.q[0]),
                         upper=np.maximum(limits.upper, points.q[0]))
    check_motion(points, limits, names, t)
    tau = arm.efforts(points.q, points.u, points.udot)
    count, error = len(points.t), None
    if tolerance is not None:
        points, tau, error = _refined(arm, points, tau, per_joint(
            tolerance, 'tolerance', names, finite=False), max_points)
    if clip:
        tau = np.clip(tau, -limits.effort, limits.effort)
    else:
        check_efforts(points.t, tau, limits.effort, names, t)
    return FilledTrajectory(names, *points, tau, len(points.t) - count, error)


class _Arm:
    """The joints of a trajectory, and the robot whose other joints rest."""

    def __init__(self, robot: Robot, source: Robot | QuasiStatic,
                 joint_names: Sequence[str] | None, rest: ArrayLike | None,
                 compensate: Terms) -> None:
        every = robot.joint_names
        self.names = every if joint_names is None else checked_joint_names(joint_names,
                                                                           'joint_names')
        unknown = [name for name in self.names if name not in every]
        if unknown:
            raise InputError(f"joint_names: '{unknown[0]}' is not a joint of the robot; expected "
                             f'some or all of {", ".join(every)}')
        others = [name for name in every if name not in self.names]
        if rest is None and others:
            raise InputError(f'joint_names: without {", ".join(others)}; expected these too, or '
                             'the positions at which they rest')
        self._pose = np.zeros(len(every)) if rest is None else finite_row(
            rest, 'rest: positions', every)
        self._columns = np.array([every.index(name) for name in self.names])
        self._robot, self._source, self._compensate = robot, source, compensate

    def limits(self, effort: ArrayLike) -> JointLimits:
        """Return the limits of the trajectory's joints, with a further effort limit."""
        found, every = self._robot.limits, self._robot.joint_names
        smaller = np.minimum(found.effort, per_joint(effort, 'effort_limit', every, finite=False))
        return JointLimits(*(values[self._columns] for values in (
            found.lower, found.upper, found.velocity, smaller)))

    def turned(self, start: State, first: Array, limits: JointLimits) -> State:
        """Return a state with joints that turn without limits next to the first point."""
        turns = np.isinf(limits.lower) & np.isinf(limits.upper) & np.array(
            [name not in self._robot.model.sliding for name in self.names])
        return start[0] + turns * TURN * np.round((first - start[0]) / TURN), *start[1:]

    def efforts(self, *state: Array) -> Array:
        """Return the efforts at q, u and udot, (..., m) each; InputError if one overflows."""
        rows = [values.reshape(-1, len(self.names)) for values in state]
        whole = np.zeros((3, len(rows[0]), len(self._pose)))
        whole[0] = self._pose
        whole[:, :, self._columns] = rows
        tau = self._compensate.inverse_dynamics(self._source, *whole)[:, self._columns]
        return tau.reshape(state[0].shape)


class _Linkage(_Arm):
    """The driving joints of a trajectory of a robot with chosen speeds or constraints."""

    def __init__(self, robot: Robot, bending: QuasiStatic | None,
                 joint_names: Sequence[str] | None, rest: ArrayLike | None,
                 compensate: Terms) -> None:
        if bending is not None:
            raise InputError('bending: given for a robot with chosen speeds or constraints; '
                             'expected one in joint rates without constraints')
        place = np.zeros(robot.n_q) if rest is None else rest
        super().__init__(robot, robot, [robot.joint_names[k] for k in followed_joints(robot)]
                         if joint_names is None else joint_names, place, compensate)
        self._efforts = LinkageEfforts(robot, self.names, compensate,
                                       None if rest is None else self._pose)

    def efforts(self, *state: Array) -> Array:
        """Return the efforts at q, u and udot, (..., m) each; InputError if one overflows."""
        # In the order of time: each configuration is closed from the one before.
        rows = [np.swapaxes(values, 0, -2) for values in state]
        tau = self._efforts(*(values.reshape(-1, len(self.names)) for values in rows))
        return np.swapaxes(tau.reshape(rows[0].shape), 0, -2)


def _refined(arm: _Arm, points: ControllerPoints, tau: Array, tolerance: Array, max_points: int
             ) -> tuple[ControllerPoints, Array, Array]:
    """Return points with more of them until the interpolated effort is right, efforts, errors."""
    error = np.zeros(len(arm.names))
    pending = np.arange(len(points.t) - 1)
    while pending.size:
        found = arm.efforts(*points.inside(pending, PROBES))
        x = PROBES[:, None, None]
        deviation = np.abs(found - (1.0 - x) * tau[pending] - x * tau[pending + 1]).max(axis=0)
        wrong = (deviation > tolerance).any(axis=1)
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
