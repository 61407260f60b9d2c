"""
Task speeds: generalized speeds that are the velocity of a frame and a complement.

    u = [ v; w ],    v = J q',    w = Z^T M q'

with Z a basis of the joint rates that neither move the frame nor open a loop. w are the
momenta of these motions: M(u) is then block diagonal, its first block is Lambda, and the
first entries of bias, gravity and external force are mu and the rest of the dynamics in
the space of the frame. One call of the robot computes them, as for all other speeds.
"""

from __future__ import annotations

from collections.abc import Sequence

from kane_dynamics._util.checks import finite_row, instance
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra import linear_solve
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.constraints.speeds import Speeds
from kane_dynamics.mechanics.definition import kinematics
from kane_dynamics.mechanics.recursive.tree_equations import NO_GRAVITY, TreeEquations
from kane_dynamics.robot.methods.frame_methods import DIRECTIONS
from kane_dynamics.robot.robot import Robot
from kane_dynamics.task_space.frame_task import (frame_task, FrameTask, in_axes,
                                                 ordinary_configuration)
import numpy as np
from numpy.typing import ArrayLike

SINGULAR = 1e-6  # relative singular value of the velocity's rows at the configuration


def in_task_speeds(robot: Robot, frame: str, *, axes: str = 'world',
                   directions: Sequence[str] | None = None,
                   configuration: ArrayLike | None = None) -> Robot:
    """
    Return a robot whose first generalized speeds are the velocity of a frame.

    M(u) is block diagonal: its first block is Lambda of the frame, and mu and its
    gravity are the first entries of `bias_force` and `gravity_force`. It has the robot's
    present limits, gravity and payload.

    Parameters
    ----------
    robot : Robot
        A tree in joint rates, or with closed loops or other constraints; without beams
        and ball joints. A payload of `parameters` couples the blocks, one that is a part
        of the model (`with_payload`) does not.
    frame : str
        One of `frame_names` of a moving body.
    axes : str
        As of `TaskSpace`.
    directions : sequence of str, optional
        Of x, y, z, rx, ry, rz. Default: as many as the frame can follow.
    configuration : (n_q,) array_like, optional
        Where the complement is chosen; it must not be singular. Default: one within the
        limits.

    Returns
    -------
    Robot
        With speeds `<frame>/x` ... and `<frame>/null_1` ... where the frame leaves
        degrees of freedom. Its `configuration` is the one at which the complement was
        chosen.

    Raises
    ------
    InputError
        Names the argument, what was given and what is expected; or the frame cannot move
        independently in the directions at the configuration.

    """
    instance(robot, Robot, 'robot')
    require_angles(robot.model, 'in_task_speeds')
    if not robot.mechanism.speeds.key == 'joint_rates':
        raise InputError('robot: with chosen speeds; expected joint rates, in place of '
                         'which the task speeds are chosen')
    task = frame_task(robot, frame, axes, directions)
    if configuration is None:
        q = ordinary_configuration(robot)
    else:
        q = finite_row(configuration, 'configuration', robot.coordinate_names)
    speeds = _speeds(robot, task, q)
    # The same robot, with these speeds and the parameters that may change.
    options = {**robot.options, 'speeds': speeds,
               'independent': speeds.names[:robot.n], 'configuration': q}
    chosen = Robot(robot.model, **options)
    chosen.limits = robot.limits
    chosen.parameters.gravity = robot.parameters.gravity
    if robot.parameters.payload is not None:
        chosen.parameters.payload = robot.parameters.payload
    return chosen


def _speeds(robot: Robot, task: FrameTask, q: Array) -> Speeds:
    """Return the task speeds, with a complement chosen at a configuration."""
    mechanism = robot.mechanism
    rows_at_q = np.asarray(_rows(mechanism, task, q, 0.0), dtype=np.float64)
    # Each direction needs a motion of its own at the configuration.
    moves = np.linalg.svd(rows_at_q / mechanism.units, compute_uv=False)
    if len(rows_at_q) > rows_at_q.shape[1] or moves.min() < SINGULAR * moves.max():
        listed = ', '.join(DIRECTIONS[row] for row in task.rows)
        raise InputError(f"directions: {listed}; frame '{task.frame.name}' does not move "
                         'independently in these at the configuration; expected fewer, '
                         'or another configuration')
    dependent = _best_columns(rows_at_q)
    # Kernels of task speeds are cached unless functions of the user have no key.
    key = ''
    if mechanism.key is not None:
        key = f'task_speeds {task.words} {dependent} {mechanism.key}'
    matrix = _SpeedMatrix(robot, task, dependent)
    return Speeds(matrix, None, _speed_names(robot, task), key)


class _SpeedMatrix:
    """
    The matrix Y of the task speeds, a function of q and t that can be pickled.

    Parameters
    ----------
    robot : Robot
        In joint rates; unlike its mechanism it can be pickled.
    task : FrameTask
    dependent : tuple of int
        The joints whose rates follow from the velocity and the others.

    """

    def __init__(self, robot: Robot, task: FrameTask, dependent: tuple[int, ...]) -> None:
        self._robot = robot
        self._task = task
        self._dependent = dependent

    def __call__(self, q: Vector, t: Scalar) -> Matrix:
        """Return Y, (n_q, n_q)."""
        rows = _rows(self._robot.mechanism, self._task, q, t)
        count = len(self._task.rows)
        # The complement is momentum along the null space of the rows: it vanishes where
        # the arm moves with the least kinetic energy for the velocity of the frame.
        Z = _null_basis(rows, self._dependent)
        M = TreeEquations(self._robot.model).mass_matrix(q, NO_GRAVITY)
        return np.concatenate([rows[:count], Z.T @ M, rows[count:]])


def _speed_names(robot: Robot, task: FrameTask) -> tuple[str, ...]:
    """Return the names of the speeds: of the frame, of its null space, of the closures."""
    names = [DIRECTIONS[row] for row in task.rows]
    for r in range(robot.n - len(task.rows)):
        names.append(f'null_{r + 1}')
    for r in range(len(robot.mechanism.kept)):
        names.append(f'closure_{r + 1}')
    return tuple(f'{task.frame.name}/{name}' for name in names)


def _rows(mechanism: Mechanism, task: FrameTask, q: Vector, t: Scalar) -> Matrix:
    """Return the rows of the frame's velocity, then of the constraints, (k + m, n_q)."""
    model = mechanism.model
    R, _ = kinematics.frame_pose(model, task.frame, q)
    J = kinematics.frame_partial_velocities(model, task.frame, q)
    velocity = in_axes(task.in_world(R), J)[list(task.rows)]
    if not mechanism.labels:
        return velocity
    closing = mechanism.rows(mechanism.state(q, t)).J[mechanism.kept]
    return np.concatenate([velocity, closing])


def _best_columns(rows: Array) -> tuple[int, ...]:
    """Return as many independent columns as rows: pivots of Gram-Schmidt."""
    remainder = rows.copy()
    columns: list[int] = []
    for _ in range(len(rows)):
        lengths = np.linalg.norm(remainder, axis=0)
        lengths[columns] = -1.0
        column = int(np.argmax(lengths))
        direction = remainder[:, column] / lengths[column]
        remainder = remainder - np.outer(direction, direction @ remainder)
        columns.append(column)
    return tuple(sorted(columns))


def _null_basis(rows: Matrix, dependent: Sequence[int]) -> Matrix:
    """Return Z with rows Z = 0, (n_q, n - k): 1 in the columns that are not dependent."""
    count = rows.shape[1]
    free = [c for c in range(count) if c not in dependent]
    Z = np.zeros((count, len(free))).astype(object)
    if not free:
        return Z
    # The dependent entries cancel the rows for a unit of each free column.
    solved = linear_solve.solution(rows[:, list(dependent)], rows[:, free])
    for place, column in enumerate(dependent):
        Z[column] = -solved[place]
    for place, column in enumerate(free):
        Z[column, place] = 1.0
    return Z
