"""A mechanism at one configuration and time: poses, partial velocities, speeds."""

from collections.abc import Sequence
from copy import copy
from typing import Any

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.ball_joints import axis_acceleration, joint_positions
from kane_dynamics.mechanics.constraints.speeds import speed_places, Speeds
from kane_dynamics.mechanics.definition import kinematics
from kane_dynamics.mechanics.recursive import frame_kinematics
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.mechanics.recursive.link_frames import posed
from kane_dynamics.model.model import Frame, Model, WORLD
import numpy as np

PARALLEL = 1e-12  # 1 - cos(angle) below which a joint turns a wheel about its axle


class MechanismState:
    """A mechanism at one configuration and time; implements `constraints.Geometry`."""

    def __init__(self, model: Model, speeds: Speeds, q: Any, t: Any,
                 links: Sequence[Link] | None = None) -> None:
        """Use the kinematics of the definition, or those of the compiled links."""
        self.model, self.q, self.t = model, q, t
        self.width = model.n  # of rows
        self._speeds = speeds
        self._positions = joint_positions(model, q)
        self._links = None if links is None else posed(links, model, q)
        self._axes = WORLD

    @lazy_property
    def _bodies(self) -> tuple[kinematics.Configuration, ...]:
        return kinematics.configurations(self.model, self.q)

    @lazy_property
    def _link_poses(self) -> frame_kinematics.LinkPoses:
        return frame_kinematics.LinkPoses(self._links or (), self._positions, self._axes)

    def in_axes_of(self, frame: str | Frame) -> 'MechanismState':
        """Return this state with vectors in the axes of a body; the definition's stay as is."""
        body = self._frame(frame).body
        if self._links is None or body == self._axes:
            return self
        other = copy(self)
        other.__dict__.pop('_link_poses', None)
        other._axes = body
        return other

    def axle_carrier(self, frame: str, axis: Any) -> Frame:
        """Return the axes of the body that carries a wheel's axle: the wheel's own, if none."""
        at = self.model.frame(frame)
        if at.body != WORLD:
            body = self.model.bodies[at.body]
            along = abs(body.joint.axis @ at.rotation @ axis)
            if body.joint.kind == 'revolute' and along > 1.0 - PARALLEL:
                return Frame('', body.parent)
        return Frame('', at.body)

    def carrier(self, first: str, second: str) -> Frame:
        """Return the axes of the outermost body that moves both frames, or of the world."""
        one, other = (self.model.path(self.model.frame(name).body) for name in (first, second))
        return Frame('', max(set(one) & set(other), default=WORLD))

    def _frame(self, frame: str | Frame) -> Frame:
        return frame if isinstance(frame, Frame) else self.model.frame(frame)

    def pose(self, frame: str | Frame) -> tuple[Any, Any]:
        """Return axes (3, 3, columns) and origin (3,) of a frame, m."""
        at = self._frame(frame)
        if self._links is None:
            return kinematics.frame_pose(self.model, at, self.q, self._bodies)
        return frame_kinematics.frame_axes(self._links, at, self._link_poses)

    def partial_velocities(self, frame: str | Frame, at: Any = None) -> Any:
        """Return the Jacobian (6, n_q) at a frame's origin, or at the point `at` of its body."""
        of = self._frame(frame)
        if self._links is None:
            return kinematics.frame_partial_velocities(self.model, of, self.q, at, self._bodies)
        return frame_kinematics.partial_velocities(self._links, of, self._positions, at,
                                                   self._link_poses)

    def motion(self, frame: str | Frame, qdot: Any) -> Any:
        """
        Return velocity and acceleration of a frame at constant joint rates, (2, 6).

        Linear, then angular; relative to the axes of `in_axes_of`, of the compiled links only.
        """
        return frame_kinematics.frame_motion(self._frame(frame), self._link_poses, qdot,
                                             -axis_acceleration(self.model, qdot))

    def coordinate(self, name: str, asking: str) -> tuple[Any, Any]:
        """Return a coordinate's row, (n,), and its value; ConstraintError for no such name."""
        model = self.model
        names = [joint for joint, place in zip(model.joint_names, model.places)
                 if place is not None]  # a ball joint has no angle
        if name not in names:
            raise ConstraintError(f"constraint '{asking}': no coordinate '{name}'; expected one "
                                  f'of {", ".join(names)}')
        k = model.joint_names.index(name)
        return np.eye(model.n)[k], self._positions[k]

    def speed_rows(self, names: Sequence[str]) -> tuple[Any, Any]:
        """Return rows of Y, (k, n_q), and of Z, (k,), of these speeds."""
        Y, Z = self._speeds.of(self.q, self.t)
        places = speed_places(self._speeds, names)
        return Y[places], Z[places]

    def other_speeds(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return the names of all speeds but these."""
        return tuple(name for name in self._speeds.names if name not in names)


class ReleasedJointState(MechanismState):
    """
    A mechanism with one released joint; its rows have a column per degree of freedom of the joint.

    The columns are the six auxiliary speeds of the bodies behind the joint, along and about the
    world axes at the joint's origin.
    """

    def __init__(self, here: MechanismState, body: int, origin: Any) -> None:
        """Release the joint of the body with index `body`; its origin is (3,), m."""
        super().__init__(here.model, here._speeds, here.q, here.t)
        self._links = here._links
        self._body, self._origin = body, origin
        self.width = 6

    def partial_velocities(self, frame: str | Frame, at: Any = None) -> Any:
        """Return the Jacobian of one rigid body, (6, 6); zero for frames not behind the joint."""
        of = self._frame(frame)
        if of.body == WORLD or self._body not in self.model.path(of.body):
            return np.zeros((6, 6)).astype(object)
        world, start = self.pose(Frame('', WORLD))
        r = (self.pose(frame)[1] if at is None else at) - (world @ self._origin + start)
        turned = np.array([cross(axis, r) for axis in world.T]).T
        return np.concatenate([np.concatenate([world, turned], axis=1),
                               np.concatenate([0.0 * world, world], axis=1)])

    def coordinate(self, name: str, asking: str) -> tuple[Any, Any]:
        """Return a zero row, (6,), and the coordinate's value."""
        return np.zeros(6), super().coordinate(name, asking)[1]

    def speed_rows(self, names: Sequence[str]) -> tuple[Any, Any]:
        """Return zero rows: the released degrees of freedom do not change the speeds."""
        return np.zeros((len(names), 6)), np.zeros(len(names))
