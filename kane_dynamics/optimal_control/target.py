"""The target of a horizon: configuration, rates of the joints and torques, at each time."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.checks import finite_row
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.loop_tracking.driven_mechanism import mechanism_motion
from kane_dynamics.mechanics.ball_joints import require_angles, require_unit
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike


class Target:
    """
    Rows of targets for a robot.

    Parameters
    ----------
    robot : Robot
    actuators : sequence of m int
        Indices of the joints with actuators.

    """

    def __init__(self, robot: Robot, actuators: Sequence[int]) -> None:
        """Store the robot."""
        self._robot, self._actuators = robot, list(actuators)

    def rows(self, target: ArrayLike | Motion, t: Array) -> Array:
        """
        Return q, joint rates and torques at times t, (N, n_q + n_j + m), or the same for all.

        Raises
        ------
        InputError
            The motion is not one of this robot, or the configuration is invalid; names it.
        ConstraintError
            The loops of the configuration do not close, or are singular.

        """
        if isinstance(target, Motion):
            return self._of_motion(target, t)
        robot = self._robot
        q = self.configuration(target, 'target')
        if robot.equations.timed and robot.constraint_names:
            q = np.array([robot.closed_posture(q, t=float(s)) for s in t])
        elif robot.equations.timed:
            q = np.tile(q, (len(t), 1))
        rest = np.zeros((*q.shape[:-1], len(robot.joint_names)))
        return np.concatenate([q, rest, self.holding(q, t)], axis=-1)

    def configuration(self, q: ArrayLike, what: str) -> Array:
        """Return a checked configuration, (n_q,)."""
        robot = self._robot
        return require_unit(robot.model, finite_row(q, what, robot.coordinate_names), what)

    def holding(self, q: Array, t: Any) -> Array:
        """Return the torques of the actuators that hold gravity, (m,) or (N, m)."""
        return self._of_actuators(self._robot.gravity_force(q, **self.at(t)), q, t)

    def at(self, t: Any) -> dict[str, Any]:
        """Return the keyword of time, if the robot depends on it."""
        return {'t': t} if self._robot.equations.timed else {}

    def _of_actuators(self, tau: Array, q: Array, t: Any) -> Array:
        """Return the torques of the actuators for a generalized force."""
        result: Array = self._robot.joint_torques(tau, q, **self.at(t))[..., self._actuators]
        return result

    def _of_motion(self, motion: Motion, t: Array) -> Array:
        """Return the rows of a motion."""
        robot, states = self._robot, motion.sample(t)
        require_angles(robot.model, 'target')
        if isinstance(robot.equations, ConstrainedEquations):
            q, u, udot = mechanism_motion(robot, motion.joint_names, t, *states)
            rates = robot.joint_rates(q, u, **self.at(t))
        elif motion.joint_names != robot.joint_names:
            raise InputError(f'target: a motion of {", ".join(motion.joint_names)}; expected '
                             f'{", ".join(robot.joint_names)}')
        else:
            q, u, udot = states
            rates = u
        tau = robot.inverse_dynamics(q, u, udot, **self.at(t))
        return np.concatenate([q, rates, self._of_actuators(tau, q, t)], axis=-1)
