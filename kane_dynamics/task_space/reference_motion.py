"""The speeds, and their rates, that move a frame as desired."""

from __future__ import annotations

from typing import NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.task_space.frame_task import FrameTask, in_axes, TaskInertia
import numpy as np


class TargetMotion(NamedTuple):
    """
    Motion of a target.

    Attributes
    ----------
    axes : (3, 3) array
        The axes of the task as columns, in the world.
    twist, acceleration : (6,) arrays
        Linear then angular, world axes.

    """

    axes: Matrix
    twist: Vector
    acceleration: Vector


def reference_motion(equations: Equations, task: FrameTask, inertia: TaskInertia,
                     q: Vector, u: Vector, desired: TargetMotion,
                     t: Scalar) -> tuple[Vector, Vector]:
    """
    Return u_r and its rate, (n,) each, over any scalar: J u_r = the desired twist.

    Of all such speeds they have the least kinetic energy. Where the task is singular,
    its regularization bounds them.
    """
    J = equations.partial_velocities(task.frame, q, t)
    J_rate = equations.partial_velocity_rates(task.frame, q, u, t)
    twist = desired.twist
    forced_acceleration: Vector = np.zeros(6).astype(object)
    if equations.timed:  # velocity and acceleration that the speeds do not cause
        twist = twist - (equations.frame_velocity(task.frame, q, u, t) - J @ u)
        total = equations.frame_acceleration(task.frame, q, u, equations.zeros, t)
        forced_acceleration = total - J_rate @ u
    u_r = inertia.speeds(in_axes(desired.axes, twist))

    # J udot_r = the desired acceleration - J' u_r.
    missing = desired.acceleration - forced_acceleration - J_rate @ u_r
    if task.moving:
        # The axes turn with the target: the rate of axes^T x is axes^T (x' - omega x x).
        lag = twist - J @ u_r
        omega = desired.twist[3:]
        missing = missing - np.concatenate([cross(omega, lag[:3]),
                                            cross(omega, lag[3:])])
    udot_r = inertia.speeds(in_axes(desired.axes, missing))
    return u_r, udot_r
