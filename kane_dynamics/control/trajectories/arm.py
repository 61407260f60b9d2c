"""The joints of a trajectory of a tree, and the robot whose other joints rest."""

from collections.abc import Sequence
import math

from kane_dynamics._util.checks import finite_row, per_joint
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.terms import Terms
from kane_dynamics.errors import InputError
from kane_dynamics.motion.controller_points import ControllerPoints, Segments
from kane_dynamics.motion.points import checked_joint_names, State
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

TURN = 2.0 * math.pi


class TrajectoryArm:
    """
    The joints of a trajectory of a tree, and the robot whose other joints rest.

    Parameters
    ----------
    robot : Robot
    source : Robot or QuasiStatic
        Its torques are the efforts.
    joint_names : sequence of str, optional
        Default: all joints.
    rest : (n,) array_like, optional
        Positions of the joints that are not in `joint_names`, rad or m.
    compensate : Terms

    Attributes
    ----------
    given, names, actuators : tuple of str
        The joints of the trajectory, those that determine the motion, and those of the result.

    """

    def __init__(self, robot: Robot, source: Robot | QuasiStatic,
                 joint_names: Sequence[str] | None, rest: ArrayLike | None,
                 compensate: Terms) -> None:
        every = robot.joint_names
        self.given = every if joint_names is None else checked_joint_names(joint_names,
                                                                           'joint_names')
        unknown = [name for name in self.given if name not in every]
        if unknown:
            raise InputError(f"joint_names: '{unknown[0]}' is not a joint of the robot; expected "
                             f'some or all of {", ".join(every)}')
        others = [name for name in every if name not in self.given]
        if rest is None and others:
            raise InputError(f'joint_names: without {", ".join(others)}; expected these too, or '
                             'the positions at which they rest')
        self._pose = np.zeros(len(every)) if rest is None else finite_row(
            rest, 'rest: positions', every)
        self._robot, self._source, self._compensate = robot, source, compensate
        self._select(self.given)

    def _select(self, names: Sequence[str]) -> None:
        """Set the joints that determine the motion, which are some of those of the trajectory."""
        self.names = self.actuators = tuple(names)
        self._columns = np.array([self._robot.joint_names.index(name) for name in names])
        self._chosen = [self.given.index(name) for name in names]

    def chosen(self, values: Array) -> Array:
        """Return the columns of `names`, of those of the trajectory, (..., m)."""
        return values[..., self._chosen]

    def allowed(self, tolerance: ArrayLike) -> Array:
        """Return the tolerance of the efforts; the smallest one for actuators not in `given`."""
        values = per_joint(tolerance, 'tolerance', self.given, finite=False)
        own = dict(zip(self.given, values.tolist()))
        return np.array([own.get(name, values.min()) for name in self.actuators])

    def limits(self, effort: ArrayLike, names: Sequence[str]) -> JointLimits:
        """Return the limits of joints, with a further effort limit of all joints."""
        found, every = self._robot.limits, self._robot.joint_names
        smaller = np.minimum(found.effort, per_joint(effort, 'effort_limit', every, finite=False))
        columns = [every.index(name) for name in names]
        return JointLimits(*(values[columns] for values in (
            found.lower, found.upper, found.velocity, smaller)))

    def turned(self, start: Array, first: Array, limits: JointLimits) -> State:
        """Return a state, (3, n), with joints that turn without limits next to the first point."""
        turns = np.isinf(limits.lower) & np.isinf(limits.upper) & np.array(
            [name not in self._robot.model.sliding for name in self.names])
        return start[0] + turns * TURN * np.round((first - start[0]) / TURN), start[1], start[2]

    def follow(self, points: ControllerPoints, positions: Array, times: Array) -> None:
        """
        Check the configurations along a motion; nothing to do for a tree.

        Parameters
        ----------
        points : ControllerPoints
            Of the joints `names`.
        positions : (K, m) array
            Of the trajectory's joints, at the last K points.
        times : (K,) array
            Times of the trajectory as given, s.

        """

    def executed(self, points: ControllerPoints) -> ControllerPoints:
        """Return the points of `actuators` for those of `names`: the same for a tree."""
        return points

    def strays(self, points: ControllerPoints, segments: Segments, x: Array) -> Flags:
        """
        Return in which segments the motion of `actuators` leaves the closed loops, (S,).

        Arguments are those of `ControllerPoints.inside`. A tree has no loops.
        """
        return np.zeros(len(segments), dtype=bool)

    def efforts(self, *state: Array) -> Array:
        """Return the efforts at q, u and udot, (..., n) each; InputError if one overflows."""
        rows = [values.reshape(-1, len(self.names)) for values in state]
        whole = np.zeros((3, len(rows[0]), len(self._pose)))
        whole[0] = self._pose
        whole[:, :, self._columns] = rows
        tau = self._compensate.inverse_dynamics(self._source, *whole)[:, self._columns]
        return tau.reshape(state[0].shape)
