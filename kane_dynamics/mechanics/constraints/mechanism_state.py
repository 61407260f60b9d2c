"""A mechanism at one configuration and time: poses, partial velocities, speeds."""

from collections.abc import Sequence
from copy import copy

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.ball_joints import axis_acceleration, joint_positions
from kane_dynamics.mechanics.constraints.speeds import speed_places, Speeds
from kane_dynamics.mechanics.definition import kinematics
from kane_dynamics.mechanics.recursive import frame_kinematics
from kane_dynamics.mechanics.recursive.link import Link, posed
from kane_dynamics.model.model import Frame, Model, WORLD
import numpy as np

PARALLEL = 1e-12  # 1 - cos(angle) below which a joint turns a wheel about its axle


class MechanismState:
    """A mechanism at one configuration and time; implements `constraints.Geometry`."""

    def __init__(self, model: Model, speeds: Speeds, q: Vector, t: Scalar,
                 links: Sequence[Link] | None = None) -> None:
        """Use the kinematics of the definition, or those of the compiled links."""
        self.model = model
        self.q = q
        self.t = t
        self.width = model.n  # of rows
        self._speeds = speeds
        self._positions = joint_positions(model, q)
        self._links = None if links is None else posed(links, model, q)
        self._axes = WORLD

    @lazy_property
    def _bodies(self) -> tuple[kinematics.Configuration, ...]:
        """Return the configurations of all bodies, by the definition."""
        return kinematics.configurations(self.model, self.q)

    @lazy_property
    def _link_poses(self) -> frame_kinematics.LinkPoses:
        """Return the poses of the compiled links in the axes of a body."""
        return frame_kinematics.LinkPoses(self._links or (), self._positions, self._axes)

    def in_axes_of(self, frame: str | Frame) -> 'MechanismState':
        """Return this state in the axes of a frame's body; the definition's as it is."""
        body = self._frame(frame).body
        if self._links is None or body == self._axes:
            return self
        # The copy shares all but the poses, which depend on the axes.
        state = copy(self)
        state.__dict__.pop('_link_poses', None)
        state._axes = body
        return state

    def axle_carrier(self, frame: str, axis: Vector) -> Frame:
        """Return the axes of the body that carries a wheel's axle; else the wheel's."""
        wheel = self.model.frame(frame)
        if wheel.body != WORLD:
            # The parent carries the axle if the wheel turns about it on a joint.
            body = self.model.bodies[wheel.body]
            cosine = abs(body.joint.axis @ wheel.rotation @ axis)
            if body.joint.kind == 'revolute' and cosine > 1.0 - PARALLEL:
                return Frame('', body.parent)
        return Frame('', wheel.body)

    def carrier(self, first: str, second: str) -> Frame:
        """Return the axes of the outermost body that moves both frames, or the world."""
        first_path = self.model.path(self.model.frame(first).body)
        second_path = self.model.path(self.model.frame(second).body)
        common = set(first_path) & set(second_path)
        return Frame('', max(common, default=WORLD))

    def _frame(self, frame: str | Frame) -> Frame:
        """Return a frame of the model by its name."""
        return frame if isinstance(frame, Frame) else self.model.frame(frame)

    def pose(self, frame: str | Frame) -> tuple[Matrix, Vector]:
        """Return axes (3, 3, columns) and origin (3,) of a frame, m."""
        frame = self._frame(frame)
        if self._links is None:
            return kinematics.frame_pose(self.model, frame, self.q, self._bodies)
        return frame_kinematics.frame_axes(self._links, frame, self._link_poses)

    def partial_velocities(self, frame: str | Frame, at: Vector | None = None) -> Matrix:
        """Return the Jacobian (6, n_q) at a frame's origin or at a point of its body."""
        frame = self._frame(frame)
        if self._links is None:
            return kinematics.frame_partial_velocities(self.model, frame, self.q, at,
                                                       self._bodies)
        return frame_kinematics.partial_velocities(self._links, frame, self._positions,
                                                   at, self._link_poses)

    def motion(self, frame: str | Frame, qdot: Vector) -> Matrix:
        """
        Return velocity and acceleration of a frame at constant joint rates, (2, 6).

        Linear, then angular; relative to the axes of `in_axes_of`, of the compiled links
        only.
        """
        # Constant q' of ball joints: their axes turn, which is an acceleration.
        qddot = -axis_acceleration(self.model, qdot)
        return frame_kinematics.frame_motion(self._frame(frame), self._link_poses, qdot,
                                             qddot)

    def coordinate(self, name: str, constraint: str) -> tuple[Vector, Scalar]:
        """Return a coordinate's row, (n,), and its value, for the named constraint."""
        model = self.model
        names = []
        for joint, place in zip(model.joint_names, model.places):
            if place is not None:  # a ball joint has no angle
                names.append(joint)
        if name not in names:
            raise ConstraintError(f"constraint '{constraint}': no coordinate '{name}'; "
                                  f'expected one of {", ".join(names)}')
        k = model.joint_names.index(name)
        return np.eye(model.n)[k], self._positions[k]

    def speed_rows(self, names: Sequence[str]) -> tuple[Matrix, Vector]:
        """Return rows of Y, (k, n_q), and of Z, (k,), of these speeds."""
        Y, Z = self._speeds.of(self.q, self.t)
        places = speed_places(self._speeds, names)
        return Y[places], Z[places]

    def other_speeds(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return the names of all speeds but these."""
        return tuple(name for name in self._speeds.names if name not in names)


class ReleasedJointState(MechanismState):
    """
    A mechanism with one released joint; rows have a column per degree of freedom of it.

    The columns are the six auxiliary speeds of the bodies behind the joint, along and
    about the world axes at the joint's origin.
    """

    def __init__(self, state: MechanismState, body: int, origin: Vector) -> None:
        """Release the joint of the body with index `body`; its origin is (3,), m."""
        super().__init__(state.model, state._speeds, state.q, state.t)
        self._links = state._links
        self._body = body
        self._origin = origin
        self.width = 6

    def partial_velocities(self, frame: str | Frame, at: Vector | None = None) -> Matrix:
        """Return the Jacobian of one rigid body, (6, 6); zero before the joint."""
        body = self._frame(frame).body
        if body == WORLD or self._body not in self.model.path(body):
            return np.zeros((6, 6)).astype(object)

        # The world's axes and origin, in the axes of this state.
        R_world, world_origin = self.pose(Frame('', WORLD))
        point = at
        if point is None:
            _, point = self.pose(frame)
        r = point - (R_world @ self._origin + world_origin)

        # A rotation about an axis e moves the point by e x r.
        moment_arms = np.array([cross(axis, r) for axis in R_world.T]).T
        linear = np.concatenate([R_world, moment_arms], axis=1)
        angular = np.concatenate([0.0 * R_world, R_world], axis=1)
        return np.concatenate([linear, angular])

    def coordinate(self, name: str, constraint: str) -> tuple[Vector, Scalar]:
        """Return a zero row, (6,), and the coordinate's value."""
        _, position = super().coordinate(name, constraint)
        return np.zeros(6), position

    def speed_rows(self, names: Sequence[str]) -> tuple[Matrix, Vector]:
        """Return zero rows: the released degrees of freedom do not change the speeds."""
        return np.zeros((len(names), 6)), np.zeros(len(names))
