"""Arrows of joint torques, joint reactions and forces of contacts."""

from __future__ import annotations

from dataclasses import dataclass

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.definition.kinematics import configurations
from kane_dynamics.robot.robot import Robot
import numpy as np

KINDS = ('torques', 'forces', 'moments', 'contacts')
LONGEST = 0.4  # length of the longest arrow, in units of the robot's size
_LEAST = 0.01  # of the longest; shorter arrows are not drawn
_ROUNDING = 1e-9
_SAMPLES = 100  # configurations in the search for the largest gravity torques


@dataclass(frozen=True, eq=False)
class LoadArrows:
    """
    Torques and reactions of every joint, and forces of contacts, at several states.

    Attributes
    ----------
    robot : Robot
    q : (K, n_q) array
        rad or m.
    tau : (K, n_q) array
        Actuator torque of each joint, N m or N.
    reactions : (K, n_bodies, 6) array
        `Robot.joint_reactions`, N and N m; zero in a motion with contacts, whose
        forces they would lack.
    contacts : (K, 2, c, 3) array
        Points, m, and forces, N, of contacts, in the world.

    """

    robot: Robot
    q: Array
    tau: Array
    reactions: Array
    contacts: Array

    @classmethod
    def along(cls, robot: Robot, q: Array, u: Array, udot: Array, tau: Array,
              t: Array, contacts: Array | None = None) -> LoadArrows:
        """Return the loads of a motion, (K, ...) arrays, tau dual to u."""
        if contacts is None:
            contacts = np.zeros((len(q), 2, 0, 3))
        # One state at a time: compiling the kernels of batches would take seconds.
        shared = [robot.joint_torques(tau[k], q[k], t=t[k]) for k in range(len(q))]
        reactions = np.zeros((len(q), len(robot.model.bodies), 6))
        if not contacts.size:
            reactions[:] = [robot.joint_reactions(q[k], u[k], udot[k], t=t[k])
                            for k in range(len(q))]
        return cls(robot, q, np.array(shared), reactions, contacts)

    @classmethod
    def at_rest(cls, robot: Robot, q: Array) -> LoadArrows:
        """Return the gravity loads at rest, for K configurations, (K, n_q)."""
        still = np.zeros((len(q), robot.n))
        tau = np.array([robot.gravity_force(row) for row in q])
        return cls.along(robot, q, still, still, tau, np.zeros(len(q)))

    @lazy_property
    def largest(self) -> dict[str, float]:
        """
        Return the largest magnitude of each of `KINDS`: N m of revolute joints, N, N m, N.

        Zero for a kind that is only rounding error, relative to the others.
        """
        names = self.robot.joint_names
        sliding = np.array([name in self.robot.model.sliding for name in names])
        # Each kind of arrow has its own scale.
        forces = np.linalg.norm(self.reactions[..., :3], axis=-1)
        moments = np.linalg.norm(self.reactions[..., 3:], axis=-1)
        of_contacts = np.linalg.norm(self.contacts[:, 1], axis=-1)
        # The actuator of a prismatic joint exerts a force.
        actuator_torque = np.abs(self.tau[:, ~sliding]).max(initial=0.0)
        actuator_force = np.abs(self.tau[:, sliding]).max(initial=0.0)
        largest = {'torques': float(actuator_torque),
                   'forces': float(max(forces.max(initial=0.0), actuator_force)),
                   'moments': float(moments.max(initial=0.0)),
                   'contacts': float(of_contacts.max(initial=0.0))}
        rounding = _ROUNDING * max(largest.values())
        # Arrows of rounding errors would be as long as those of real loads.
        for kind, magnitude in largest.items():
            if magnitude <= rounding:
                largest[kind] = 0.0
        return largest

    def arrows(self, k: int, length: float,
               largest: dict[str, float]) -> dict[str, Array]:
        """
        Return arrows by kind, (m, 2, 3): start, at a joint's origin or a contact, and end, m.

        Parameters
        ----------
        k : int
            Index of the state.
        length : float
            Length of the arrows of the largest magnitudes, m.
        largest : dict
            Largest magnitudes; the torque of a prismatic joint is a force.

        """
        robot = self.robot
        tau = dict(zip(robot.joint_names, self.tau[k]))
        placed_bodies = configurations(robot.model, self.q[k])
        drawn: dict[str, list[Array]] = {kind: [] for kind in KINDS}
        bodies = robot.model.bodies
        # In units of the largest magnitude of each kind; small ones are left out.
        for body, placed, reaction in zip(bodies, placed_bodies, self.reactions[k],
                                          strict=True):
            joint = body.joint
            vectors = {'forces': reaction[:3] / (largest['forces'] or 1.0),
                       'moments': reaction[3:] / (largest['moments'] or 1.0)}
            if joint.name in tau:
                unit = 'forces' if joint.kind == 'prismatic' else 'torques'
                scale = largest[unit] or 1.0
                vectors['torques'] = tau[joint.name] / scale * placed.axis
            for kind, vector in vectors.items():
                if np.linalg.norm(vector) > _LEAST:
                    start = placed.p_wb
                    drawn[kind].append(np.stack([start, start + length * vector]))
        for point, force in self.contacts[k].swapaxes(0, 1):
            vector = force / (largest['contacts'] or 1.0)
            if np.linalg.norm(vector) > _LEAST:
                drawn['contacts'].append(np.stack([point, point + length * vector]))
        return {kind: np.array(pairs).reshape(-1, 2, 3) for kind, pairs in drawn.items()}


def sampled_configurations(robot: Robot) -> Array:
    """Return closed configurations in the range of the joints, (K, n_q), rad or m."""
    return robot.random_configuration(0, _SAMPLES)
