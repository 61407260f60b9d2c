"""
Simulated arms that are held in poses, without the library's dynamics.

The torque that holds a chain is the sum over its links of the moment of their weights
about each joint's axis, written out here by vectors. Stick-slip keeps a random part of
the friction in the direction of the last motion.
"""

from typing import NamedTuple

import numpy as np

G = np.array([0.0, 0.0, -9.81])
LINK = """<link name="l{k}"><inertial><origin xyz="{com}"/><mass value="{mass!r}"/>
<inertia ixx="{inertia!r}" ixy="0" ixz="0" iyy="{inertia!r}" iyz="0" izz="{inertia!r}"/>
</inertial></link>
<joint name="j{k}" type="revolute"><parent link="l{parent}"/><child link="l{k}"/>
<origin xyz="{origin}"/><axis xyz="{axis}"/>
<limit lower="-2.5" upper="2.5" effort="40" velocity="3"/></joint>
"""


def rotation(axis, angle):
    """Return the rotation about a unit axis by Rodrigues' formula, (3, 3)."""
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


class HeldArm(NamedTuple):
    """A chain: axes and origins of joints, masses and centers of mass of links."""

    axes: np.ndarray
    origins: np.ndarray
    masses: np.ndarray
    coms: np.ndarray

    def holding_torque(self, q, load=0.0, load_com=(0.0, 0.0, 0.1)):
        """Return the torque that holds the arm and a load on its last link, N m."""
        R, p = np.eye(3), np.zeros(3)
        axes, points, weights = [], [], []
        for k in range(len(q)):
            p = p + R @ self.origins[k]
            R = R @ rotation(self.axes[k], q[k])
            axes.append((R @ self.axes[k], p))
            points.append(p + R @ self.coms[k])
            weights.append(self.masses[k])
        points.append(p + R @ np.array(load_com))
        weights.append(load)
        torque = np.zeros(len(q))
        for j, (axis, origin) in enumerate(axes):
            for k in range(j, len(points)):
                torque[j] -= axis @ np.cross(points[k] - origin, weights[k] * G)
        return torque

    def urdf(self, masses=None, coms=None):
        """Return the URDF, with other masses and centers of mass on request."""
        masses = self.masses if masses is None else masses
        coms = self.coms if coms is None else coms
        text = '<robot name="held"><link name="l0"/>\n'
        for k in range(len(masses)):
            text += LINK.format(
                k=k + 1, parent=k, mass=float(masses[k]),
                inertia=float(2e-3 * masses[k]),
                com=' '.join(map(repr, coms[k].tolist())),
                origin=' '.join(map(repr, self.origins[k].tolist())),
                axis=' '.join(map(str, self.axes[k])))
        return text + '</robot>'


def held_arm(n, rng):
    """Return a random chain of n joints, the first one vertical if there are many."""
    kinds = np.eye(3)[[2, 1, 1, 0, 1, 0, 1]]
    axes = kinds[:n] if n > 3 else kinds[1:1 + n]
    origins = np.column_stack([rng.uniform(0.15, 0.3, n), rng.uniform(-0.02, 0.02, n),
                               rng.uniform(0.0, 0.05, n)])
    masses = np.geomspace(1.0, 0.25, n) * rng.uniform(0.7, 1.3, n)
    coms = np.column_stack([rng.uniform(0.05, 0.15, n), rng.uniform(-0.02, 0.02, n),
                            rng.uniform(-0.02, 0.05, n)])
    return HeldArm(axes, origins, masses, coms)


class Holding(NamedTuple):
    """Poses, efforts and directions of the approach, (k, n)."""

    q: np.ndarray
    effort: np.ndarray
    approach: np.ndarray


def held(arm, q, scale, rng, *, load=0.0, stick=0.1, noise=5e-3):
    """Return how an arm holds poses, each approached from both sides."""
    torque = np.array([arm.holding_torque(row, load) for row in q])
    size = np.sqrt(np.mean(torque**2, axis=0))
    direction = np.where(rng.uniform(size=q.shape) < 0.5, 1.0, -1.0)
    direction = np.concatenate([direction, -direction])
    # Stick-slip leaves between half of the friction and all of it.
    friction = stick * size * direction * rng.uniform(0.5, 1.0, direction.shape)
    effort = (np.concatenate([torque, torque]) + friction) / scale
    effort += noise * size * rng.normal(size=effort.shape)
    return Holding(np.concatenate([q, q]), effort, direction)
