"""Kane's definition behind `Robot`'s method names, so that one test can hold both."""

import energies
from hyperdual import seeded
from kane_dynamics.mechanics.definition import kane, kinematics
import numpy as np


class Definition:
    """What `Robot(model, ...)` computes, by the two sums over bodies and speeds."""

    def __init__(self, model, *, friction=True, wrench_frames=()):
        """Take the same arguments as Robot."""
        self.model = model
        self.n = model.n
        self.joint_names = model.joint_names
        self._friction = friction
        self._wrench_frames = wrench_frames

    def _forces(self, wrench):
        named = {} if wrench is None else {
            name: (w[:3], w[3:]) for name, w in zip(self._wrench_frames, wrench)}
        return {'friction': self._friction, 'wrenches': named}

    def inverse_dynamics(self, q, u, udot, *, wrench=None):
        """Return tau."""
        return kane.inverse_dynamics(self.model, q, u, udot, **self._forces(wrench))

    def forward_dynamics(self, q, u, tau, *, wrench=None):
        """Return udot."""
        return kane.forward_dynamics(self.model, q, u, tau, **self._forces(wrench))

    def bias_force(self, q, u):
        """Return the bias."""
        return kane.bias_force(self.model, q, u, friction=self._friction)

    def gravity_force(self, q):
        """Return the torque that holds gravity."""
        return kane.gravity_force(self.model, q)

    def mass_matrix(self, q):
        """Return M."""
        return kane.mass_matrix(self.model, q)

    def inverse_mass_matrix(self, q):
        """Return M^-1."""
        return np.linalg.inv(kane.mass_matrix(self.model, q))

    def kinetic_energy(self, q, u):
        """Return the kinetic energy by the energy formulation."""
        return energies.kinetic_energy(self.model, q, u)

    def potential_energy(self, q):
        """Return the potential energy by the energy formulation."""
        return energies.potential_energy(self.model, q)

    def frame_pose(self, frame, q):
        """Return a (4, 4) pose."""
        R, p = kinematics.frame_pose(self.model, self.model.frame(frame), q)
        return np.block([[R, p[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])

    def frame_velocity(self, frame, q, u):
        """Return (6,)."""
        return kinematics.frame_motion(
            self.model, self.model.frame(frame), q, u, 0.0 * u)[0]

    def frame_acceleration(self, frame, q, u, udot):
        """Return (6,)."""
        return kinematics.frame_motion(
            self.model, self.model.frame(frame), q, u, udot)[1]

    def jacobian(self, frame, q):
        """Return (6, n)."""
        return kane.partial_velocities(self.model, q, frame)

    def jacobian_rate(self, frame, q, u):
        """Return (6, n), by exact differentiation."""
        moving = kane.partial_velocities(self.model, seeded(q, u, 0, self.n), frame)
        return np.vectorize(lambda x: getattr(x, 'rate', 0.0), otypes=[float])(moving)


def relative_error(value, expected):
    """Return the largest difference, relative to the largest entry expected."""
    value = np.asarray(value)
    expected = np.asarray(expected)
    assert value.shape == expected.shape
    scale = np.abs(expected).max(initial=0.0)
    difference = np.abs(value - expected).max(initial=0.0)
    return difference / scale if scale > 0.0 else difference
