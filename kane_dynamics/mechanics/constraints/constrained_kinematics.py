"""
The kinematics of a mechanism in its independent speeds, over any scalar.

Joint rates q' = T u + ..., the motion of frames, constraint residuals, and the correction that
keeps loops closed.
"""

from typing import Any

from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints.conditioning import margin
from kane_dynamics.mechanics.constraints.mechanism import JointMotion, Mechanism
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.model.model import Frame
import numpy as np


class ConstrainedKinematics:
    """
    Kinematics of a mechanism; the base of `ConstrainedEquations`.

    Parameters
    ----------
    tree : TreeEquations
        Of the same model, in joint rates and without constraints.
    mechanism : Mechanism

    """

    def __init__(self, tree: TreeEquations, mechanism: Mechanism) -> None:
        """Store the tree and the mechanism."""
        self.watched = bool(mechanism.labels)  # by calls and simulations
        self.tree, self.mechanism = tree, mechanism
        self.model, self.n, self.n_q = tree.model, mechanism.n, tree.n_q
        self.speed_names = mechanism.speed_names
        self.wrench_frames, self.payload_frame = tree.wrench_frames, tree.payload_frame
        self.timed = mechanism.key is None

    @property
    def unsupported(self) -> tuple[str, ...]:
        """Return the names of the methods that do not support beams."""
        return self.tree.unsupported

    def joint_motion(self, q: Any, u: Any, udot: Any, t: Any = 0.0) -> JointMotion:
        """Return rates and accelerations of the joints, with T and N."""
        return self.mechanism.joint_motion(q, u, udot, t, self.tree.geometry)

    def at_rest(self, q: Any, t: Any) -> JointMotion:
        """Return the joint motion at u = udot = 0, for callers that use T and N alone."""
        return self.joint_motion(q, self.zeros, self.zeros, t)

    def joint_rates(self, q: Any, u: Any, t: Any = 0.0) -> Any:
        """Return q', (n_q,)."""
        return coordinate_rates(self.model, q, self.joint_speeds(q, u, t))

    def joint_speeds(self, q: Any, u: Any, t: Any = 0.0) -> Any:
        """Return the rates of the joints, (n_j,): q', and angular velocities of ball joints."""
        return self.joint_motion(q, u, self.zeros, t).qdot

    def constraint_residual(self, q: Any, t: Any = 0.0) -> Any:
        """Return the residual of every row, (m,), m or rad; 0 for velocity constraints."""
        rows = self.mechanism.rows(self.mechanism.state(q, t, self.tree.geometry))
        return np.array([0.0 if x is None else x for x in rows.residual], dtype=object)

    def closure_rows(self, q: Any, t: Any = 0.0) -> Any:
        """Return J with two more columns: residuals, and 1 where a row has one, (m, n_j + 2)."""
        rows = self.mechanism.rows(self.mechanism.state(q, t, self.tree.geometry))
        missed = np.array([[0.0, 0.0] if x is None else [x, 1.0] for x in rows.residual],
                          dtype=object)
        return np.concatenate([rows.J, missed.reshape(len(rows.residual), 2)], axis=1)

    def constraint_velocity_residual(self, q: Any, u: Any, t: Any = 0.0) -> Any:
        """Return the velocity residual J q' - b of every row, (m,)."""
        rows = self.mechanism.rows(self.mechanism.state(q, t, self.tree.geometry))
        return rows.J @ self.joint_speeds(q, u, t) - rows.b

    def joint_accelerations(self, q: Any, u: Any, udot: Any, t: Any = 0.0) -> Any:
        """Return the rates of `joint_speeds`, (n_j,): q'', and angular accelerations."""
        return self.joint_motion(q, u, udot, t).qddot

    def keeps_positions(self, q: Any, t: Any = 0.0) -> bool:
        """Return whether a constraint is one of positions, such as a closed loop."""
        rows = self.mechanism.rows(self.mechanism.state(q, t, self.tree.geometry))
        return any(x is not None for x in rows.residual)

    def closure_step(self, q: Any, t: Any = 0.0) -> Any:
        """
        Return q after one Newton step on the constraint residuals of positions, (n_q,).

        The step is in the span of N, so that it does not change the independent speeds. It
        changes the lengths of quaternions, to second order.
        """
        residual = self.mechanism.rows(self.mechanism.state(q, t, self.tree.geometry)).residual
        missed = [0.0 if residual[k] is None else residual[k] for k in self.mechanism.kept]
        step = -(self.at_rest(q, t).N @ np.array(missed, dtype=object))
        return q + coordinate_rates(self.model, q, step)

    def margin(self, q: Any, t: Any, limits: Any) -> Any:
        """Return the margin of a state, positive where it is accepted; see `conditioning`."""
        return margin(self.mechanism, q, t, limits, self.tree.geometry)

    def frame_pose(self, frame: Frame, q: Any, t: Any = 0.0) -> Any:
        """Return the homogeneous transformation frame to world, (4, 4)."""
        return self.tree.frame_pose(frame, q)

    def frame_velocity(self, frame: Frame, q: Any, u: Any, t: Any = 0.0) -> Any:
        """Return linear then angular velocity, (6,)."""
        return self.tree.frame_velocity(frame, q, self.joint_speeds(q, u, t))

    def frame_acceleration(self, frame: Frame, q: Any, u: Any, udot: Any, t: Any = 0.0) -> Any:
        """Return linear then angular acceleration, (6,)."""
        motion = self.joint_motion(q, u, udot, t)
        return self.tree.frame_acceleration(frame, q, motion.qdot, motion.qddot)

    def partial_velocities(self, frame: Frame, q: Any, t: Any = 0.0) -> Any:
        """Return the Jacobian (partial velocities) in the independent speeds, (6, n)."""
        return self.tree.partial_velocities(frame, q) @ self.at_rest(q, t).T

    def partial_velocity_rates(self, frame: Frame, q: Any, u: Any, t: Any = 0.0) -> Any:
        """Return the time derivative of the partial velocities along the motion, (6, n)."""
        motion = self.joint_motion(q, u, self.zeros, t)
        return (self.tree.partial_velocity_rates(frame, q, motion.qdot) @ motion.T
                + self.tree.partial_velocities(frame, q) @ motion.T_rate)

    @property
    def zeros(self) -> Any:
        """Return n zeros, which add no operation to a traced program."""
        return np.zeros(self.n).astype(object)
