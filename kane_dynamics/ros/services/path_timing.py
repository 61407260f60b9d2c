"""Time-optimal timing of a path: the computation behind its service."""

from collections.abc import Callable
import math
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.control.trajectory_joints import driving_joints
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility import time_optimal
from kane_dynamics.feasibility.path_geometry import path_of
from kane_dynamics.motion.motion import Motion
from kane_dynamics.ros.common.conversion import check_points, doubles, message_of_points
from kane_dynamics.ros.services.motion_check import check_positions
from kane_dynamics.ros.services.served_robot import RIGID, ServedRobot
from kane_dynamics.ros.services.trajectory_filling import assembly_mode, FIELDS, table
import numpy as np


def timing_request(served: ServedRobot, request: Any) -> Callable[[Any], None]:
    """
    Return the computation of a TimeOptimal request, which fills in a response, for a worker.

    It uses the robot of the simulations, with the gravity and the payload of now. The path is of
    the driving joints: all joints without closed loops, else those with actuators, or the
    independent joints if there are more actuators. The response has further actuators too.

    Raises
    ------
    InputError
        If the request is invalid; the message names the field.

    """
    robot = served.simulated
    every, joints = robot.joint_names, list(driving_joints(robot))
    places = [every.index(joint) for joint in joints]
    rest = assembly_mode(served) if robot.constraint_names else None
    names = list(request.joint_names) or joints
    if sorted(names) != sorted(joints):
        raise InputError(f'joint_names: {names}; expected each of {", ".join(joints)} once')
    order = [names.index(joint) for joint in joints]
    times, n = np.array(request.time_from_start), len(names)
    count = len(times) or len(request.positions) // n
    check_points(count, served.values['trajectory.max_points'])
    columns = [table(request, field, count, n) for field in FIELDS]
    q, u, udot = (None if rows is None else rows[:, order] for rows in columns)
    assert q is not None  # `table` raises
    if not len(times) and (u is not None or udot is not None):
        raise InputError('time_from_start: empty; expected the times of points with velocities or '
                         'accelerations')
    check_positions(served, joints, q, times if len(times) else np.arange(float(count)))
    limits: dict[str, Any] = {}
    for what in ('acceleration', 'power', 'jerk', 'torque_rate'):
        limit = _per_joint(getattr(request, f'max_{what}'), what, n, order)
        limits[what] = limit
        if np.ndim(limit):  # of the joints of the request; others have none
            limits[what] = np.full(len(every), math.inf)
            limits[what][places] = limit

    def compute(response: Any) -> None:
        served.loads.apply(robot)
        response.message = RIGID * (served.bending is not None)
        path = (Motion.from_points(times, q, u, udot, joint_names=joints) if len(times)
                else path_of(q, joints))
        found = time_optimal(robot, path, rest=rest, **limits)
        t, *states = found.points
        moved = [*names, *(joint for joint in robot.actuated_names if joint not in names)]
        back = [every.index(joint) for joint in moved]
        response.joint_names = moved
        response.time_from_start = doubles(t)
        columns = {field: rows[:, back] for field, rows in zip(
            (*FIELDS, 'effort'), (*states, found.tau))}
        for field, rows in columns.items():
            setattr(response, field, doubles(rows))
        if request.as_trajectory:
            response.trajectory = message_of_points(moved, t, columns)
    return compute


def _per_joint(values: Any, what: str, n: int, order: list[int]) -> Array | float:
    """Return a limit in the robot's order of joints; infinite if it is empty."""
    given = np.array(values)
    if len(given) not in (0, 1, n):
        raise InputError(f'max_{what}: {len(given)} entries; expected none, 1 or {n}')
    return given[order] if len(given) == n else float(given[0]) if len(given) else math.inf
