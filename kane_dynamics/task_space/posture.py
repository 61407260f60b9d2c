"""Posture: joint springs and damping for motion that does not move the frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from kane_dynamics._util.typing import Vector
from kane_dynamics.mechanics.constraints.mechanism import JointMotion
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.task_space.frame_task import TaskInertia
from kane_dynamics.task_space.joint_walls import JointWalls
import numpy as np

RATIO = 0.7  # damping ratio of each joint on its spring


def posture_forces(equations: Equations, walls: JointWalls, inertia: TaskInertia,
                   q: Vector, speeds: Vector, motion: JointMotion, parameters: Vector,
                   values: Mapping[str, Any]) -> tuple[Vector, Vector]:
    """
    Return the forces of the posture and of the null-space damping, (n,) each.

    Over any scalar: N^T k (posture - q) and -N^T (D + beta M) N s, with D the damping of
    every joint by its own inertia and spring. N^T D N and N^T M N are positive
    semidefinite, so that the damping takes energy out in every configuration.

    Parameters
    ----------
    equations : Equations
        Of the robot.
    walls : JointWalls
        Names the joints with positions.
    inertia : TaskInertia
        Of the task.
    q, speeds : (n_q,), (n,) arrays
        Configuration; speeds relative to the reference motion.
    motion : JointMotion
        At q.
    parameters : array
        Of the robot.
    values : mapping
        `posture`, `posture_stiffness`, `null_damping`.

    """
    M_q = equations.tree.mass_matrix(q, parameters)
    null_speeds = inertia.null_speeds(speeds)
    null_rates = motion.T @ null_speeds
    momentum = motion.projected(M_q @ null_rates)

    springs = np.zeros(len(motion.qdot)).astype(object)
    dampers = np.zeros(len(motion.qdot)).astype(object)
    for k, (r, place) in enumerate(zip(walls.joints, walls.places)):
        stiffness = values['posture_stiffness'][k]
        damping = 2.0 * RATIO * np.sqrt(stiffness * M_q[r, r])
        stretch = values['posture'][place] - q[place]
        springs[r] = stiffness * stretch
        dampers[r] = -damping * null_rates[r]
    drag = motion.projected(dampers) - values['null_damping'] * momentum
    return (inertia.null_force(motion.projected(springs)), inertia.null_force(drag))
