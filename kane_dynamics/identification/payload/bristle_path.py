"""
The friction of bristles along measured motion, of an arm whose payload is not known.

Bristles deflect with the travel of their joint: dz/dx = 1 - s z sign(dx) / g, with the
friction of sliding g. Positions state the travel, and load friction in g follows from the
torques of the motors, so that neither payload nor time is needed. Between two samples a
joint counts as moving one way.

Where the bristles were at the first sample is not known. The law keeps the order of two
deflections, so that those from both ends of what is possible bound the true one at each
later sample. They meet as the joint slides.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.mechanics.ball_joints import difference
from kane_dynamics.mechanics.friction import breakaway_levels, has_bristles, load_fractions
from kane_dynamics.model.model import Joint
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
import numpy as np

# What bristles replace in the law of friction.
WITHOUT_SLIDING: dict[str, Any] = {
    'friction': 0.0, 'friction_backward': None, 'breakaway_friction': None,
    'stribeck_speed': 0.0, 'load_friction': 0.0, 'load_friction_backdriven': None,
    'presliding_stiffness': 0.0, 'presliding_damping': 0.0}


class BristleState(NamedTuple):
    """
    Bristles at one or N samples.

    Attributes
    ----------
    q, u : (n_q,), (n,) or (N, ...) arrays
        The sample.
    bounds : (2, n_b) or (N, 2, n_b) array
        The least and the largest possible deflection, rad or m.
    friction : (n,) or (N, n) array
        Generalized force of the bristles in the middle of these, N m or N.
    unknown : (n_j,) or (N, n_j) array
        By how much the friction of a joint may differ from that, N m or N.

    """

    q: Array
    u: Array
    bounds: Array
    friction: Array
    unknown: Array


class BristlePath:
    """
    The friction of a robot's bristles, sample by sample.

    Parameters
    ----------
    robot : Robot
        With joints that have bristles.

    Attributes
    ----------
    bare : Robot
        The robot with viscous friction and offset alone in these joints.

    """

    def __init__(self, robot: Robot) -> None:
        """Prepare the kernel; it compiles on first use."""
        self._robot = robot
        self.bare = without_bristles(robot)
        tree = robot.equations.tree
        # Numbers of the friction law, (n_b,), one entry for each joint with bristles.
        self._joints: list[Joint] = tree.bristles
        self._coordinates = [joint.coordinate for joint in self._joints]
        self._stiffness = np.array([joint.presliding_stiffness for joint in self._joints])
        self._size = np.array([abs(joint.multiplier) for joint in self._joints])
        self._levels = np.array([max(breakaway_levels(joint)) for joint in self._joints])
        self._fractions = np.array([max(load_fractions(joint)) for joint in self._joints])
        self._kernel = _path_kernel(robot, self.bare)

    def compile(self) -> None:  # noqa: A003
        """Compile the kernel now instead of at the first sample."""
        self._kernel.entry('', self._kernel)

    def after(self, last: BristleState | None, q: Array, u: Array, tau: Array,
              t: float) -> BristleState:
        """
        Return the bristles at the sample after the last one, None of the first.

        tau are the torques of the motors, dual to u, (n,), N m or N.
        """
        robot = self._robot
        mean_u = u
        travel = np.zeros(robot.model.n)
        # Without a last sample, the bristles may be anywhere up to sliding.
        if last is None:
            largest = self._largest_deflections(q, tau, t)
            bounds = np.stack([-largest, largest])
        else:
            mean_u = 0.5 * (last.u + u)
            travel = difference(robot.model, last.q, q)
            bounds = last.bounds
        time = robot.equations.time_inputs(t)
        result = self._kernel(q, u, tau, mean_u, travel, bounds, *time)
        n = robot.n
        later = np.asarray(result[n:]).reshape(bounds.shape)

        # Half of the distance between the bounds, by joint.
        apart = 0.5 * self._stiffness * self._size * (later[1] - later[0])
        unknown = np.zeros(robot.model.n)
        np.add.at(unknown, self._coordinates, apart)
        return BristleState(np.array(q), np.array(u), later, result[:n], unknown)

    def along(self, q: Array, u: Array, tau: Array, t: Array) -> BristleState:
        """Return the bristles at N samples in a row, arrays of N rows."""
        state = None
        states = []
        for sample in zip(q, u, tau, np.broadcast_to(t, len(q)), strict=True):
            state = self.after(state, *sample)
            states.append(state)
        return BristleState(*(np.stack(values) for values in zip(*states, strict=True)))

    def _largest_deflections(self, q: Array, tau: Array, t: float) -> Array:
        """Return the largest deflections under the torques of the motors, (n_b,)."""
        levels = self._levels
        if self._fractions.any():
            torques = self._robot.equations.drive_torques(q, tau, t)
            loads = np.abs(np.asarray(torques, dtype=np.float64))
            levels = levels + self._fractions * loads[self._coordinates]
        return np.asarray(levels / self._stiffness)


def without_bristles(robot: Robot) -> Robot:
    """Return the robot with viscous friction and offset alone in joints with bristles."""
    bodies = []
    for body in robot.model.bodies:
        joint = body.joint
        if has_bristles(joint):
            joint = replace(joint, **WITHOUT_SLIDING)
        bodies.append(replace(body, joint=joint))
    bare = Robot(replace(robot.model, bodies=tuple(bodies)), **robot.options)
    bare.parameters.gravity = robot.parameters.gravity
    return bare


def _path_kernel(robot: Robot, bare: Robot) -> Kernel:
    """
    Return the kernel of the friction of bristles, (n,), and of bounds after a travel.

    Its arguments are a state, the torques of the motors, the mean speeds and the travel of
    the joints since the last sample, and the bounds then, (2, n_b).
    """
    equations = robot.equations
    n_b = len(equations.tree.bristles)

    def path(q: Vector, u: Vector, tau: Vector, mean_u: Vector, travel: Vector,
             bounds: Vector, t: Scalar) -> Vector:
        # Deflections from both bounds, which grow together as the joints move.
        rates = equations.joint_motion(q, mean_u, equations.zeros, t).qdot
        least = equations.deflections_after(q, rates, bounds[0], tau, travel, t)
        largest = equations.deflections_after(q, rates, bounds[1], tau, travel, t)
        motion = equations.joint_motion(q, u, equations.zeros, t)
        # Friction of the joints without bristles, and viscous friction, cancel.
        friction = equations.driven_friction(q, motion.qdot, tau, t, None,
                                             0.5 * (least + largest))
        others = bare.equations.driven_friction(q, motion.qdot, tau, t)
        return np.concatenate([motion.projected(friction - others), least, largest])
    row = (robot.n,)
    return robot.compiled(path, name='bristle_path', q=(robot.n_q,), u=row, tau=row, mean_u=row,
                          travel=(robot.model.n,), bounds=(2, n_b), shape=(robot.n + 2 * n_b,))
