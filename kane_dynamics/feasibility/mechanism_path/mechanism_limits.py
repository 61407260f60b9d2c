"""
Limits along a path of the driving joints of a mechanism, at the vertices of a section.

The torques of the actuators are a linear map W(q) of the forces of the joints: along q(s) they are
a s'' + b s'^2 + c + W friction(q_s s'), with a, b and c from the dynamics in the independent
speeds, which are linear in the rates and accelerations of the driving joints.
"""

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.feasibility.path_limits import Bounds, friction, PathLimits
from kane_dynamics.feasibility.torque_demand import at_actuators, unit_torques
from kane_dynamics.loop_tracking.driven_mechanism import motion_of_closed
from kane_dynamics.robot.robot import Robot
import numpy as np


class MechanismLimits(PathLimits):
    """The limits of a robot with chosen speeds or constraints at the vertices of a section."""

    def __init__(self, robot: Robot, section: Section, bounds: Bounds,
                 driving: list[int]) -> None:
        """Compute the coefficients of the torque."""
        self.stated = self._driving = driving
        self._rough = sorted({body.joint.coordinate for body in robot.model.bodies if (
            robot.friction and (body.joint.damping or body.joint.friction))})
        super().__init__(robot, section, bounds)

    def _compute_torques(self, q: Array, first: Array, second: Array, tau: Array) -> None:
        """Write the coefficients of the torques, (N + 1, 3, n_q), with the offset of friction."""
        robot, stated, q = self.robot, self._driving, np.ascontiguousarray(q)
        whole = motion_of_closed(robot, stated, np.zeros(len(q)), q, first[:, stated],
                                 second[:, stated])
        inertia, *_ = np.moveaxis(robot.torque_terms(q, 0.0 * whole.u, whole.u), 1, 0)
        change, coriolis, gravity, _, spring = np.moveaxis(robot.torque_terms(*whole), 1, 0)
        for k, force in enumerate((inertia, change + coriolis, gravity + spring)):
            tau[:, k] = robot.joint_torques(np.ascontiguousarray(force), q)
        offset = friction(robot, np.zeros((1, robot.n_q)))[0]
        tau[:, 2] += at_actuators(robot, q, np.broadcast_to(offset, q.shape))
        self._map = unit_torques(robot, q, self._rough)
        self.acts = np.asarray(tau.any(axis=(0, 1)) | self._map.any(axis=(0, 2)))

    def _at_actuators(self, forces: Array) -> Array:
        """Return the torques of the actuators for friction of the joints, (N + 1, n_q) each."""
        return np.asarray(np.einsum('kij,kj->ki', self._map, forces[:, self._rough]))
