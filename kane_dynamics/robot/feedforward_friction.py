"""The friction of commands at rest and at reversals, compiled."""

from __future__ import annotations

from typing import Any

from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.mechanics.constraints.conditioning import guarded
from kane_dynamics.mechanics.friction import DESIRED_SPEED
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import in_regular_speeds, Robot
import numpy as np
from numpy.typing import ArrayLike


def changes_friction(robot: Any) -> bool:
    """Return whether commands have other friction than at the desired speed."""
    if not isinstance(robot, Robot):  # one of a user's own, with methods of these names
        return False
    return robot.friction and robot.equations.tree.feedforward_choice != DESIRED_SPEED


def feedforward_change(robot: Robot, q: ArrayLike, u: ArrayLike, udot: ArrayLike,
                       t: ArrayLike = 0.0) -> Array:
    """
    Return the torques by which commands of a motion exceed inverse dynamics, (..., n).

    Parameters
    ----------
    robot : Robot
        With its choice `feedforward_friction`.
    q, u, udot, t
        As in `Robot.inverse_dynamics`.

    """
    kernel = change_kernel(robot)
    time = robot.equations.time_inputs(t, q)
    return np.asarray(kernel(q, u, udot, *time))


def change_kernel(robot: Robot) -> Kernel:
    """Return the kernel of `feedforward_change`."""
    equations = robot.equations

    def change(q: Vector, u: Vector, udot: Vector, t: Scalar, parameters: Vector,
               limits: Vector) -> Vector:
        result = equations.feedforward_change(q, u, udot, parameters, t)
        if not equations.watched:  # a tree has no singular or open configuration
            return result
        return guarded(result, equations.margin(q, t, limits))

    # At a singular state the same in other speeds, as of other quantities.
    def reason(state: dict[str, Array]) -> Kernel | None:
        """Return the kernel in speeds that are regular at a state, or raise the error."""
        regular = in_regular_speeds(robot, state)
        return None if regular is None else change_kernel(regular)
    inputs: dict[str, Any] = {'q': (robot.n_q,), 'u': (robot.n,), 'udot': (robot.n,)}
    kernel: Kernel = robot.kernels.compiled(change, 'feedforward_change', inputs,
                                            (robot.n,), reason=reason)
    return kernel
