"""Motions of a frame on a straight line: from task space to joints."""

from __future__ import annotations

from kane_dynamics._util.checks import instance, integer, number
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.damped_least_squares import AT_LIMIT, inverse_kinematics
from kane_dynamics.kinematics.poses import checked_pose, pose_error, rotation_exp
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.motion.motion import Motion
from kane_dynamics.native.runtime.kernel import Argument, checked
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

JUMP = 0.5  # rad or m between two points: the configuration has changed, not followed


def straight_line(robot: Robot, frame: str, q: ArrayLike, target: ArrayLike,
                  duration: float, *,
                  points: int = 51) -> Motion:
    """
    Return a motion of the joints in which a frame moves on a straight line, from rest to rest.

    The origin of the frame moves on the line, while the frame turns about a fixed axis;
    both follow the same quintic polynomial of time. Joint positions are those of
    `inverse_kinematics`, each near the one before, and are interpolated by a cubic
    spline: more points keep the frame closer to the line.

    Parameters
    ----------
    robot : Robot
        With joint angles and positions as coordinates, no ball joints.
    frame : str
        One of `robot.frame_names`.
    q : (n_q,) array_like
        The configuration at the start, within the limits, rad or m.
    target : (4, 4) array_like
        Pose of the frame in the world at the end, m, such as of `pose_from`.
    duration : float
        s.
    points : int
        Of the spline, 5 or more.

    Returns
    -------
    Motion
        Of all joints; with constraints, of the joints of the independent speeds.

    Raises
    ------
    InputError
        An argument is invalid; a part of the line is out of reach, or next to a singular
        configuration, where the joints would jump: names the fraction of the line.

    """
    instance(robot, Robot, 'robot')
    require_angles(robot.model, 'straight_line')
    duration = number(duration, 'duration', 'a positive, finite time, s',
                      lambda x: 0.0 < x < np.inf)
    points = integer(points, 'points', 5)
    end = checked_pose(target, 'target')
    names = _moved_joints(robot)
    q_start = _start(robot, q)
    start = robot.frame_pose(frame, q_start)
    along = pose_error(start, end)  # a translation, and a rotation vector in world axes

    times = np.linspace(0.0, duration, points)
    share = times / duration
    shares = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    configurations = [q_start]
    for done in shares[1:]:
        pose = np.eye(4)
        pose[:3, :3] = rotation_exp(done * along[3:]) @ start[:3, :3]
        pose[:3, 3] = start[:3, 3] + done * along[:3]
        # One start: another configuration than the nearest one is no continuation.
        solution = inverse_kinematics(robot, frame, pose, configurations[-1], starts=1)
        if not solution.converged:
            raise InputError(f"target: '{frame}' does not reach {100.0 * done:.3g} % of "
                             'the line within the joint limits; expected a line within '
                             'reach')
        jump = np.abs(solution.q - configurations[-1])
        if jump.max() > JUMP:
            name = robot.coordinate_names[int(jump.argmax())]
            raise InputError(f"target: joint '{name}' jumps by {jump.max():.3g} rad or "
                             f'm at {100.0 * done:.3g} % of the line, next to a '
                             'singular configuration; expected another line, or more '
                             'points')
        configurations.append(solution.q)
    columns = [robot.coordinate_names.index(name) for name in names]
    return Motion.from_points(times, np.array(configurations)[:, columns],
                              joint_names=names)


def _moved_joints(robot: Robot) -> tuple[str, ...]:
    """Return the joints of the motion, which determine the others under constraints."""
    if not robot.constraint_names:
        return robot.coordinate_names
    speeds = [name for name in robot.speed_names if name not in robot.coordinate_names]
    if speeds:
        raise InputError(f'robot: constraints with the speeds {speeds}; expected rates of '
                         'joints as independent speeds')
    return robot.speed_names


def _start(robot: Robot, q: ArrayLike) -> Array:
    """Return the start; InputError unless it is one configuration within the limits."""
    q_start = checked(Argument('q', (robot.n_q,), robot.coordinate_names), q)
    if q_start.ndim != 1:
        raise InputError(f'q: shape {q_start.shape}; expected ({robot.n_q},), one '
                         'configuration')
    beyond = np.maximum(robot.limits.lower - q_start, q_start - robot.limits.upper)
    worst = int(beyond.argmax())
    if beyond[worst] > AT_LIMIT:
        raise InputError(f"q: joint '{robot.coordinate_names[worst]}': position "
                         f'{q_start[worst]:g}; expected within its limits '
                         f'{robot.limits.lower[worst]:g} to {robot.limits.upper[worst]:g}')
    return q_start
