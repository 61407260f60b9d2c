"""
Posture: joint springs and damping for motion that does not move the frame.

The springs have the torque k (posture - q); N^T of it, which does not accelerate the
frame, is applied. The damping takes the force beta S s off the speeds s, with

    S = M - J^T Lambda J.

S is positive semidefinite, also where Lambda is regularized, so that the damping takes
energy out in every configuration. Where Lambda is not regularized, S s does not
accelerate the frame, and motion that the frame does not see decays at the rate beta.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.mechanics.constraints.mechanism import JointMotion
from kane_dynamics.task_space.frame_task import TaskInertia
from kane_dynamics.task_space.joint_walls import JointWalls
import numpy as np


def posture_force(walls: JointWalls, inertia: TaskInertia, q: Vector,
                  motion: JointMotion, values: Mapping[str, Any]) -> Vector:
    """
    Return the force of the springs, (n,), over any scalar.

    Parameters
    ----------
    walls : JointWalls
        Names the joints with positions.
    inertia : TaskInertia
        Of the task.
    q : (n_q,) array
        rad or m.
    motion : JointMotion
        At q.
    values : mapping
        `posture`, `posture_stiffness`.

    """
    springs = np.zeros(len(motion.qdot)).astype(object)
    for k, (r, place) in enumerate(zip(walls.joints, walls.places)):
        stretch = values['posture'][place] - q[place]
        springs[r] = values['posture_stiffness'][k] * stretch
    return inertia.null_force(motion.projected(springs))


def null_damping(inertia: TaskInertia, momentum: Vector, velocity: Vector,
                 rate: Scalar) -> Vector:
    """
    Return -rate S s, (n,), for speeds s.

    Parameters
    ----------
    inertia : TaskInertia
        Of the task.
    momentum, velocity : (n,), (6,) arrays
        M s, and the velocity J s of the frame.
    rate : scalar
        1/s.

    """
    return -rate * (momentum - inertia.momentum(velocity))
