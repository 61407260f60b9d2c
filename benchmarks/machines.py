"""Machines with closed loops and free bases: ours, and as Pinocchio builds them."""

from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
import io
from pathlib import Path
import runpy
import sys
from typing import Any
from unittest.mock import patch

from constrained_loop import four_bar
from kane_dynamics import box, Model, ModelBuilder, Robot
from kane_dynamics.mechanics.algebra.quaternion import rotation_matrix
from native_loop import shipped_arm, STATES
import numpy as np
from pinocchio_native import depth_first

ROOT = Path(__file__).resolve().parents[1]
DISTINCT = 64  # closed configurations, repeated to `STATES`
SAME = 1e-9  # relative to the largest entry: both must agree before they are timed
# Accuracies and regularizations of Pinocchio's proximal solver. Redundant rows never
# reach the smallest accuracy, so that all iterations run; others need few.
SETTINGS = tuple((accuracy, mu) for accuracy in (1e-6, 1e-8, 1e-10)
                 for mu in (1e-4, 1e-6, 1e-8, 1e-10))
REVOLUTE, PRISMATIC, FREE_FLYER = range(3)
FREE = 6  # bodies of a free joint in our models: three that slide, three that turn


@dataclass(frozen=True, eq=False)
class Machine:
    """
    A robot with states, and the same machine as Pinocchio's joints.

    Attributes
    ----------
    robot : Robot
        Without friction, which Pinocchio ignores.
    q, u, x : (STATES, n_q), (STATES, n), (STATES, n) arrays
        x is tau, or udot.

    """

    robot: Robot
    q: np.ndarray
    u: np.ndarray
    x: np.ndarray

    @cached_property
    def groups(self) -> list[list[int]]:
        """Return our bodies of each of Pinocchio's joints, depth first."""
        model = self.robot.model
        found = []
        order = depth_first(model)
        while order:
            size = FREE if len(order) > 3 and order[3] in model.balls else 1
            found.append(order[:size])
            del order[:size]
        return found

    @cached_property
    def joints(self) -> np.ndarray:
        """Return the rows of `make` in pinocchio_machines.cpp, (count, 31)."""
        model = self.robot.model
        rows = []
        for group in self.groups:
            joint = model.bodies[group[0]].joint
            inertial = model.bodies[group[-1]].inertial
            kind = (FREE_FLYER if len(group) > 1 else
                    PRISMATIC if joint.kind == 'prismatic' else REVOLUTE)
            rows.append(np.concatenate([
                [self.place(model.bodies[group[0]].parent), kind], joint.axis,
                joint.rotation.ravel(), joint.translation, [inertial.mass], inertial.com,
                inertial.inertia.ravel(), [joint.armature]]))
        return np.array(rows)

    def place(self, body: int) -> int:
        """Return the number of Pinocchio's joint of a body; -1 for the world."""
        return next((k for k, group in enumerate(self.groups) if group[-1] == body), -1)

    @cached_property
    def contacts(self) -> np.ndarray:
        """Return both joints and placements of every closure, (closures, 26)."""
        if not self.robot.constraint_names:
            return np.zeros((0, 26))
        frames = []
        for constraint in self.robot.mechanism.constraints:
            frames.append([self.robot.model.frame(name)
                           for name in (constraint.first, constraint.second)])
        return np.array([np.concatenate([part for frame in pair for part in (
            [self.place(frame.body)], frame.rotation.ravel(), frame.translation)])
            for pair in frames])

    def as_peer(self, q: np.ndarray, of_joints: np.ndarray) -> np.ndarray:
        """
        Return velocities or forces of joints, (K, nv), in Pinocchio's order and axes.

        The velocity of a free-flyer is on its own axes, ours on the axes of its carrier.
        """
        columns = [self.robot.model.bodies[k].joint.coordinate for group in self.groups
                   for k in group]
        reordered = np.array(of_joints[:, columns])
        for begin, group in self._flyers():
            R = np.array([rotation_matrix(row) for row in self._quaternions(q, group)])
            reordered[:, begin:begin + 3] = np.einsum('kij,ki->kj', R,
                                                      reordered[:, begin:begin + 3])
        return reordered

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Return configurations, (K, nq), in Pinocchio's order."""
        names = self.robot.coordinate_names
        columns: list[int] = []
        for group in self.groups:
            first = self.robot.model.bodies[group[0]].joint
            start = names.index(self.robot.joint_names[first.coordinate])
            columns += range(start, start + (7 if len(group) > 1 else 1))
        return np.ascontiguousarray(q[:, columns])

    def accelerations(self, udot: np.ndarray) -> np.ndarray:
        """Return our accelerations of all joints in Pinocchio's order and axes."""
        result = self.as_peer(self.q,
                              self.robot.joint_accelerations(self.q, self.u, udot))
        _, v, _ = self.peer_states
        for begin, _ in self._flyers():
            result[:, begin:begin + 3] -= np.cross(v[:, begin + 3:begin + 6],
                                                   v[:, begin:begin + 3])
        return result

    @cached_property
    def peer_states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, v and tau of Pinocchio at the states with x as tau."""
        robot = self.robot
        # With angular velocities of ball joints: at rest, the accelerations for udot =
        # u.
        rates = robot.joint_accelerations(self.q, 0.0 * self.u, self.u)
        return (self.positions(self.q), self.as_peer(self.q, rates),
                self.as_peer(self.q, robot.joint_torques(self.x, self.q)))

    def _flyers(self) -> Iterator[tuple[int, list[int]]]:
        """Yield the first velocity of each free-flyer, and its bodies."""
        begin = 0
        for group in self.groups:
            if len(group) > 1:
                yield begin, group
            begin += len(group)

    def _quaternions(self, q: np.ndarray, group: list[int]) -> np.ndarray:
        """Return the quaternions of a free joint, (K, 4)."""
        joint = self.robot.model.bodies[group[0]].joint
        start = self.robot.coordinate_names.index(joint.name)
        return q[:, start + 3:start + 7]


def example(name: str) -> dict[str, Any]:
    """Return what an example defines, run without arguments."""
    path = str(ROOT / 'examples' / f'{name}.py')
    with patch('sys.argv', [path]), redirect_stdout(io.StringIO()):
        return runpy.run_path(path)


def machine(robot: Robot, q: np.ndarray) -> Machine:
    """Return a machine at configurations, with random speeds and torques."""
    q = np.tile(q, (-(-STATES // len(q)), 1))[:STATES]
    u, x = np.random.default_rng(0).uniform(-1.0, 1.0, (2, STATES, robot.n))
    return Machine(robot, np.ascontiguousarray(q), u, x)


def closed_loops() -> dict[str, Machine]:
    """Return the four-bar, the palletizer, the delta robot and the Stewart platform."""
    sys.path.append(str(ROOT / 'test' / 'helpers'))
    palletizer = import_module('palletizer')
    rng = np.random.default_rng(0)
    loop = four_bar()
    arm = palletizer.palletizer(friction=False)
    delta = example('delta_robot')
    stewart = example('stewart_platform')
    poses = []
    for _ in range(DISTINCT):
        turn = np.append(rng.uniform(-0.1, 0.1, 3), 1.0)
        poses.append(np.concatenate([rng.uniform(-0.2, 0.2, 3) + (-1.5, 0.0, 1.0),
                                     turn / np.linalg.norm(turn)]))
    return {
        'four-bar': machine(loop, np.array([
            loop.closed_configuration((angle, 0.0, -1.5), fixed=['crank'])
            for angle in rng.uniform(0.4, 1.2, DISTINCT)])),
        'palletizer': machine(arm, np.array([
            palletizer.positions(arm, *driven) for driven in rng.uniform(
                (-1.0, -0.2, -0.2, -1.0), (1.0, 0.5, 0.5, 1.0), (DISTINCT, 4))])),
        'delta robot': machine(delta['robot'], delta['qs']),
        'stewart platform': machine(stewart['robot'], np.array([
            stewart['closed'](pose) for pose in poses]))}


def free_arm() -> Machine:
    """Return the seven-axis arm of the FR3 on a free base."""
    robot = Robot(free_model(), friction=False)
    q = robot.random_configuration(0, STATES)
    u, x = np.random.default_rng(1).uniform(-1.0, 1.0, (2, STATES, robot.n))
    return Machine(robot, q, u, x)


def free_model() -> Model:
    """Return the model of `free_arm`."""
    b = ModelBuilder('free-flying fr3')
    b.body('base', 'world',
           'free', inertial=box(50.0, (0.6, 0.5, 0.4), at=(0.02, 0.01, 0.0)))
    b.mount(shipped_arm('fr3'), 'base', at=(0.1, 0.0, 0.2))
    return b.model()
