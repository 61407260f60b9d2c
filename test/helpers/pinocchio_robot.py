"""Pinocchio's numbers for a robot of ours: joints matched by name, mimics projected."""

from functools import cache
import hashlib
from importlib.metadata import files
import warnings

from kane_dynamics import load_urdf
from kane_dynamics.model.model import WORLD
import numpy as np
import pinocchio as pin

N_STATES = 20
# What load_urdf refuses, and why: no error of ours can hide in a longer list.
REFUSED = {
    # It mimics joints that are not there.
    'alex_psyonic_hands.urdf': 'is no joint; expected',
    'ur3.urdf': 'name None'}  # a robot without a name


def urdf_files():
    """Return every URDF of example-robot-data once: copies are left out."""
    file_by_name = {}
    for file in sorted(files('example-robot-data'), key=str):
        if file.name.endswith('.urdf'):
            path = file.locate().resolve()
            file_by_name.setdefault(hashlib.sha256(path.read_bytes()).digest(), path)
    return list(file_by_name.values())


@cache
def loaded(path):
    """Return our model of a URDF, with the indefinite inertias a peer accepts."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        return load_urdf(path, strict=False)


class Peer:
    """
    Pinocchio on the same URDF, in our coordinates.

    With our q, the joints' positions are G q + g: G holds the mimics' multipliers, and
    projects forces the other way.
    """

    def __init__(self, path):
        """Build Pinocchio's model, every joint free, and match it with ours."""
        self.model = loaded(path)
        self.pin = pin.buildModelFromUrdf(str(path))
        self.data = self.pin.createData()
        self.pin.armature[:] = 0.0
        n = self.model.n
        self.G, self.g = np.zeros((self.pin.nv, n)), np.zeros(self.pin.nv)
        assert self.pin.nv == len(self.model.bodies)
        for body in self.model.bodies:
            joint = body.joint
            row = self.pin.joints[self.pin.getJointId(joint.name)].idx_v
            self.G[row, joint.coordinate] = joint.multiplier
            self.g[row] = joint.offset
        rng = np.random.default_rng(n)
        turns = np.array(
            [joint.kind == 'revolute' for joint in self.model.coordinate_joints])
        self.q = rng.uniform(-1.0, 1.0, (N_STATES, n)) * np.where(turns, np.pi, 0.5)
        self.u, self.udot = rng.uniform(-2.0, 2.0, (2, N_STATES, n))
        self.tau = rng.uniform(-20.0, 20.0, (N_STATES, n))
        self.frames = self._some_frames(rng)

    def _some_frames(self, rng):
        """Return the names of two links: the one behind most joints, and another."""
        frames = self.model.frames
        depths = [len(list(self.model.path(frame.body))) for frame in frames]
        deepest = frames[depths.index(max(depths))]
        moving = [frame.name for frame in frames if frame.body != WORLD]
        return dict.fromkeys([deepest.name, str(rng.choice(moving))])

    def position(self, q):
        """Return Pinocchio's q: cosine and sine where a joint turns without end."""
        x = self.G @ q + self.g
        result = np.zeros(self.pin.nq)
        for joint in list(self.pin.joints)[1:]:
            if joint.nq == 2:
                angle = x[joint.idx_v]
                result[joint.idx_q:joint.idx_q + 2] = np.cos(angle), np.sin(angle)
            else:
                result[joint.idx_q] = x[joint.idx_v]
        return result

    def inverse_dynamics(self, q, u, udot):
        """Return tau."""
        return self.G.T @ pin.rnea(self.pin, self.data, self.position(q), self.G @ u,
                                   self.G @ udot)

    def mass_matrix(self, q):
        """Return M."""
        M = np.triu(pin.crba(self.pin, self.data, self.position(q)))
        return self.G.T @ (M + np.triu(M, 1).T) @ self.G

    def bias_force(self, q, u):
        """Return the bias."""
        return self.G.T @ pin.nonLinearEffects(self.pin, self.data, self.position(q),
                                               self.G @ u)

    def gravity_force(self, q):
        """Return the torque that holds gravity."""
        return self.G.T @ pin.computeGeneralizedGravity(self.pin, self.data,
                                                        self.position(q))

    def forward_dynamics(self, q, u, tau):
        """Return udot: by the articulated-body algorithm unless a mimic ties joints."""
        if self.pin.nv > self.model.n:
            return np.linalg.solve(self.mass_matrix(q), tau - self.bias_force(q, u))
        return self.G.T @ pin.aba(self.pin, self.data, self.position(q), self.G @ u,
                                  self.G @ tau)

    def kinetic_energy(self, q, u):
        """Return the kinetic energy."""
        return pin.computeKineticEnergy(self.pin, self.data, self.position(q),
                                        self.G @ u)

    def potential_energy(self, q):
        """Return the potential energy."""
        return pin.computePotentialEnergy(self.pin, self.data, self.position(q))

    def potential_energy_scale(self, q):
        """Return the sum of the bodies' unsigned potential energies: it can't cancel."""
        pin.forwardKinematics(self.pin, self.data, self.position(q))
        heights = [pose.act(body.lever)[2]
                   for pose, body in zip(self.data.oMi, self.pin.inertias)]
        masses = [body.mass for body in self.pin.inertias]
        return 9.81 * np.abs(np.array(masses[1:]) * heights[1:]).sum()

    def _at(self, frame, q, u, udot):
        pin.forwardKinematics(self.pin, self.data, self.position(q), self.G @ u,
                              self.G @ udot)
        pin.updateFramePlacements(self.pin, self.data)
        return self.pin.getFrameId(frame, pin.BODY)

    def frame_pose(self, frame, q):
        """Return a link's (4, 4) pose."""
        return self.data.oMf[self._at(frame, q, 0.0 * q, 0.0 * q)].homogeneous

    def frame_velocity(self, frame, q, u):
        """Return a link's velocity, (6,)."""
        return pin.getFrameVelocity(self.pin, self.data, self._at(frame, q, u, 0.0 * u),
                                    pin.LOCAL_WORLD_ALIGNED).vector

    def frame_acceleration(self, frame, q, u, udot):
        """Return a link's classical acceleration, (6,)."""
        return pin.getFrameClassicalAcceleration(
            self.pin, self.data, self._at(frame, q, u,
                                          udot), pin.LOCAL_WORLD_ALIGNED).vector

    def jacobian(self, frame, q):
        """Return a link's Jacobian, (6, n)."""
        return pin.computeFrameJacobian(
            self.pin, self.data, self.position(q), self.pin.getFrameId(frame, pin.BODY),
            pin.LOCAL_WORLD_ALIGNED) @ self.G

    def partial_velocity_rates(self, frame, q, u):
        """Return the time derivative of a link's Jacobian, (6, n)."""
        x = self.position(q)
        pin.computeJointJacobiansTimeVariation(self.pin, self.data, x, self.G @ u)
        pin.updateFramePlacements(self.pin, self.data)
        at = self.pin.getFrameId(frame, pin.BODY)
        return pin.getFrameJacobianTimeVariation(self.pin, self.data, at,
                                                 pin.LOCAL_WORLD_ALIGNED) @ self.G

    def coriolis_matrix(self, q, u):
        """Return the Coriolis matrix of Christoffel's symbols."""
        return self.G.T @ pin.computeCoriolisMatrix(
            self.pin, self.data, self.position(q), self.G @ u) @ self.G

    def inverse_dynamics_derivatives(self, q, u, udot):
        """Return dtau/dq, dtau/du, M."""
        parts = pin.computeRNEADerivatives(self.pin, self.data, self.position(q),
                                           self.G @ u, self.G @ udot)
        return [*(self.G.T @ part @ self.G for part in parts[:2]), self.mass_matrix(q)]

    def forward_dynamics_derivatives(self, q, u, tau):
        """Return dudot/dq, dudot/du, M^-1 of a robot without mimics."""
        parts = pin.computeABADerivatives(self.pin, self.data, self.position(q),
                                          self.G @ u, self.G @ tau)
        W = np.triu(parts[2])
        return [self.G.T @ part @ self.G for part in (*parts[:2], W + np.triu(W, 1).T)]

    def regressor(self, q, u, udot):
        """Return the torque regressor, its columns in the order of our bodies."""
        Y = pin.computeJointTorqueRegressor(self.pin, self.data, self.position(q),
                                            self.G @ u, self.G @ udot)
        numbers = [self.pin.getJointId(body.joint.name) for body in self.model.bodies]
        return self.G.T @ np.hstack([Y[:, 10 * k - 10:10 * k] for k in numbers])

    def joint_reaction(self, joint, q, u, udot):
        """Return the wrench of parent on child at a joint, (6,), world axes."""
        self.inverse_dynamics(q, u, udot)
        k = self.pin.getJointId(joint)
        pin.forwardKinematics(self.pin, self.data, self.position(q))
        R = self.data.oMi[k].rotation
        return np.concatenate([R @ self.data.f[k].linear, R @ self.data.f[k].angular])
