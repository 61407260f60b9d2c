"""Time-optimal timing of a path: the computation behind its service."""

from collections.abc import Callable, Sequence
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
from kane_dynamics.ros.services.request_kernels import TIMINGS
from kane_dynamics.ros.services.served_robot import RIGID, ServedRobot
from kane_dynamics.ros.services.trajectory_filling import (FIELDS, resting_configuration,
                                                           table)
import numpy as np

LIMITED = ('acceleration', 'power', 'jerk', 'torque_rate')  # quantities with a limit


def timing_request(served: ServedRobot, request: Any) -> Callable[[Any], None]:
    """
    Return the computation of a TimeOptimal request, for a worker.

    The computation fills in a response.

    It uses the robot of the simulations, with the gravity and the payload of now. The
    path is of the driving joints: all joints without closed loops, else those with
    actuators, or the independent joints if there are more actuators. The response has
    further actuators too.

    Raises
    ------
    InputError
        If the request is invalid; the message names the field.

    """
    robot = served.simulated
    every_joint = robot.joint_names
    joints = list(driving_joints(robot))
    # Joints that follow from others begin in the assembly mode of the arm.
    assembled = None
    if len(joints) < len(every_joint):
        assembled = resting_configuration(served, joints)
    names = list(request.joint_names) or joints
    # Exactly the joints that drive the arm, in any order.
    if sorted(names) != sorted(joints):
        raise InputError(f'joint_names: {names}; expected each of {", ".join(joints)} '
                         'once')
    order = list(map(names.index, joints))  # of the columns of the request
    times, columns = _points(served, request, order)
    # Waypoints without times are a path alone, of which times only number the points.
    points = times if len(times) else np.arange(float(len(columns[0])))
    check_positions(served, joints, columns[0], points)
    places = list(map(every_joint.index, joints))
    limits: dict[str, Any] = {}
    for quantity in LIMITED:
        limits[quantity] = _limit(request, quantity, order, places, len(every_joint))

    def compute(response: Any) -> None:
        served.require_kernels(TIMINGS)
        served.loads.apply(robot)
        response.message = RIGID * (served.bending is not None)
        path = path_of(columns[0], joints)
        if len(times):
            path = Motion.from_points(times, *columns, joint_names=joints)
        timing = time_optimal(robot, path, rest=assembled, **limits)
        t, *states = timing.points
        # First the joints of the request, then actuators that follow from them.
        moved = list(names)
        for joint in robot.actuated_names:
            if joint not in names:
                moved.append(joint)
        moved_columns = list(map(every_joint.index, moved))
        response.joint_names = moved
        response.time_from_start = doubles(t)
        tables = {}
        for field, rows in zip((*FIELDS, 'effort'), (*states, timing.tau)):
            tables[field] = rows[:, moved_columns]
            setattr(response, field, doubles(tables[field]))
        if request.as_trajectory:
            response.trajectory = message_of_points(moved, t, tables)
    return compute


def _points(served: ServedRobot, request: Any, order: Sequence[int]
            ) -> tuple[Array, list[Any]]:
    """
    Return the points of the path in the robot's order of joints.

    Returns
    -------
    times : (K,) or (0,) array
        s; none for a path without times.
    columns : list
        Positions, velocities and accelerations, (K, n); the last two may be None.

    """
    # Without times the points are a path alone, which has no derivatives.
    times = np.array(request.time_from_start)
    count = len(times) or len(request.positions) // len(order)
    check_points(count, served.values['trajectory.max_points'])
    columns = []
    for field in FIELDS:
        rows = table(request, field, count, len(order))
        columns.append(None if rows is None else rows[:, order])
    _, velocities, accelerations = columns
    if not len(times) and (velocities is not None or accelerations is not None):
        raise InputError('time_from_start: empty; expected the times of points with '
                         'velocities or accelerations')
    return times, columns


def _limit(request: Any, quantity: str, order: Sequence[int], places: Sequence[int],
           count: int) -> Array | float:
    """
    Return a limit of the request; infinite if it has none.

    One number holds for all joints. A list is of the joints of the request, `order` and
    `places` are their places in it and among all `count` joints; other joints have no
    limit.
    """
    values = np.array(getattr(request, f'max_{quantity}'))
    if len(values) == 0:
        return math.inf
    # One number for each joint of the request, or one for all.
    if len(values) == len(order):
        limit = np.full(count, math.inf)
        limit[list(places)] = values[list(order)]
        return limit
    if len(values) == 1:
        return float(values[0])
    raise InputError(f'max_{quantity}: {len(values)} entries; expected none, 1 or '
                     f'{len(order)}')
