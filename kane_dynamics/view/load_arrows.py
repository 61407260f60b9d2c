"""Arrows of joint torques and joint reactions."""

from dataclasses import dataclass

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.definition.kinematics import configurations
from kane_dynamics.robot.robot import Robot
import numpy as np

KINDS = ('torques', 'forces', 'moments')
LONGEST = 0.4  # length of the longest arrow, in units of the robot's size
_LEAST = 0.01  # of the longest; shorter arrows are not drawn
_ROUNDING = 1e-9
_SAMPLES = 100  # configurations in the search for the largest gravity torques
_CLOSED_SAMPLES = 20  # of closed loops: each takes some milliseconds


@dataclass(frozen=True, eq=False)
class LoadArrows:
    """
    Torques and reactions of every joint at several states.

    Attributes
    ----------
    robot : Robot
    q : (K, n_q) array
        rad or m.
    tau : (K, n_q) array
        Actuator torque of each joint, N m or N.
    reactions : (K, n_bodies, 6) array
        `Robot.joint_reactions`, N and N m.

    """

    robot: Robot
    q: Array
    tau: Array
    reactions: Array

    @classmethod
    def along(cls, robot: Robot, q: Array, u: Array, udot: Array, tau: Array,
              t: Array) -> 'LoadArrows':
        """Return the loads of a motion, (K, ...) arrays, tau dual to u."""
        # One state at a time: compiling the kernels of batches would take seconds.
        shared = [robot.joint_torques(tau[k], q[k], t=t[k]) for k in range(len(q))]
        reactions = [robot.joint_reactions(q[k], u[k], udot[k], t=t[k]) for k in range(len(q))]
        return cls(robot, q, np.array(shared), np.array(reactions))

    @classmethod
    def at_rest(cls, robot: Robot, q: Array) -> 'LoadArrows':
        """Return the loads at rest under gravity of configurations, (K, n_q)."""
        still = np.zeros((len(q), robot.n))
        tau = np.array([robot.gravity_force(row) for row in q])
        return cls.along(robot, q, still, still, tau, np.zeros(len(q)))

    @lazy_property
    def largest(self) -> dict[str, float]:
        """
        Return the largest magnitude of each of `KINDS`: N m of revolute joints, N, N m.

        Zero for a kind that is only rounding error, relative to the others.
        """
        sliding = [name in self.robot.model.sliding for name in self.robot.joint_names]
        turning = np.logical_not(sliding)
        force, moment = (np.linalg.norm(self.reactions[..., part], axis=-1).max(initial=0.0)
                         for part in (slice(0, 3), slice(3, 6)))
        found = {'torques': float(np.abs(self.tau[:, turning]).max(initial=0.0)),
                 'forces': float(max(force, np.abs(self.tau[:, sliding]).max(initial=0.0))),
                 'moments': float(moment)}
        least = _ROUNDING * max(found.values())
        return {kind: size if size > least else 0.0 for kind, size in found.items()}

    def arrows(self, k: int, length: float, largest: dict[str, float]) -> dict[str, Array]:
        """
        Return arrows by kind, (m, 2, 3): start, at the origin of the joint, and end, m.

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
        place = {name: i for i, name in enumerate(robot.joint_names)}
        drawn: dict[str, list[Array]] = {kind: [] for kind in KINDS}
        for body, placed, reaction in zip(robot.model.bodies, configurations(
                robot.model, self.q[k]), self.reactions[k], strict=True):
            joint = body.joint
            vectors = {'forces': reaction[:3] / (largest['forces'] or 1.0),
                       'moments': reaction[3:] / (largest['moments'] or 1.0)}
            if joint.name in place:
                scale = largest['forces' if joint.kind == 'prismatic' else 'torques'] or 1.0
                vectors['torques'] = self.tau[k, place[joint.name]] / scale * placed.axis
            for kind, vector in vectors.items():
                if np.linalg.norm(vector) > _LEAST:
                    drawn[kind].append(np.stack([placed.p_wb, placed.p_wb + length * vector]))
        return {kind: np.array(pairs).reshape(-1, 2, 3) for kind, pairs in drawn.items()}


def sampled_configurations(robot: Robot) -> Array:
    """Return configurations in the whole range of the joints, (K, n_q), rad or m; closed ones."""
    if robot.constraint_names:
        return robot.random_configuration(0, _CLOSED_SAMPLES)
    lower, upper = (np.where(np.isfinite(bound), bound, end) for bound, end in (
        (robot.limits.lower, -np.pi), (robot.limits.upper, np.pi)))
    return np.asarray(np.random.default_rng(0).uniform(lower, np.maximum(lower, upper),
                                                       (_SAMPLES, robot.n_q)))
