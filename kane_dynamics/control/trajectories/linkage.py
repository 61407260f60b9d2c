"""The driving joints of a trajectory of a robot with chosen speeds or constraints."""

from collections.abc import Callable, Sequence

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.control.constrained_law import followed_joints, require_rigid
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.terms import Terms
from kane_dynamics.control.trajectories.arm import TrajectoryArm
from kane_dynamics.control.trajectory_limits import described_time
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.closed_path import ClosedPath, LoopLimits
from kane_dynamics.kinematics.loop_tracker import LoopTracker
from kane_dynamics.kinematics.mechanism_motion import MechanismMotion, motion_of_closed
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.motion.controller_points import ControllerPoints, Segments
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike


class TrajectoryLinkage(TrajectoryArm):
    """
    The driving joints of a trajectory of a robot with chosen speeds or constraints.

    These are as many as independent speeds and determine the other joints. They have the
    actuators; of more actuators than independent speeds, which share the load as in
    `Robot.joint_torques`, all are joints of the result. Further joints of the trajectory are
    compared with the loop closure at its points.

    Parameters
    ----------
    robot, source, joint_names, rest, compensate
        As `TrajectoryArm`; `rest` is nearly closed and gives the assembly mode. Default: that of
        the robot, or of the first point if that is of all joints.
    limits : LoopLimits

    """

    def __init__(self, robot: Robot, source: Robot | QuasiStatic,
                 joint_names: Sequence[str] | None, rest: ArrayLike | None, compensate: Terms,
                 limits: LoopLimits) -> None:
        require_rigid(robot)
        if robot.equations.timed:
            raise InputError('robot: speeds or constraints that are functions of time; expected '
                             'none, as a trajectory does not state when in that time it starts')
        if joint_names is None:
            joint_names = [robot.joint_names[k] for k in followed_joints(robot)]
        super().__init__(robot, source, joint_names, np.zeros(robot.n_q) if rest is None else rest,
                         compensate)
        self._select(_driving(robot, self.given))
        stated = _stated_actuators(robot)
        self._act, self._tolerance = stated is not None, limits.tolerance
        if stated is not None:
            self.actuators = (*(name for name in self.given if name in stated),
                              *(name for name in stated if name not in self.given))
        self._acting = [robot.joint_names.index(name) for name in self.actuators]
        if isinstance(source, QuasiStatic):
            source.require_drives('joint_names', self.names)
            source.require_drives('actuated', self.actuators)
        self._others = [k for k, name in enumerate(robot.joint_names) if name not in self.names]
        self._given_start = rest is not None
        self._path = ClosedPath(robot, self.names, limits) if robot.constraint_names else None

    def follow(self, points: ControllerPoints, positions: Array, times: Array) -> None:
        """Close the loops along a motion; LoopError names the point at which that fails."""
        path, every = self._path, self._robot.joint_names
        if path is None:
            return
        further = [k for k, name in enumerate(self.given) if name not in self.names]
        path.begin(*self._starts(points, positions))
        path.follow(points, [every.index(self.given[k]) for k in further],
                    positions[:, further], lambda t: described_time(t, times))

    def _starts(self, points: ControllerPoints, positions: Array) -> list[Array]:
        """Return nearly closed configurations, of which the first that closes is the start."""
        robot = self._robot
        if self._given_start:  # joints that turn without limits may be turns away from it
            q, columns = robot.closed_posture(self._pose), self._columns
            turned = q.copy()
            turned[columns] = self.turned(np.tile(q[columns], (3, 1)), points.q[0],
                                          self.limits(np.inf, self.names))[0]
            return [turned, q]
        if len(self.given) == robot.n_q and robot.configuration is None:
            every = [self.given.index(name) for name in robot.joint_names]
            return [robot.closed_posture(positions[0, every], fixed=self.names)]
        guess = np.zeros(robot.n_q)
        if robot.configuration is not None:
            return [robot.closed_posture(robot.configuration)]
        guess[self._columns] = points.q[0]
        return [robot.closed_posture(guess, fixed=self.names)]

    def executed(self, points: ControllerPoints) -> ControllerPoints:
        """Return the points of `actuators` for those of `names`, with closed loops."""
        if self.actuators == self.names:
            return points
        robot, acting = self._robot, self._acting
        whole = self._whole(*points[1:])
        return ControllerPoints(points.t, *(values[:, acting] for values in (
            whole.q, robot.joint_rates(whole.q, whole.u), robot.joint_accelerations(*whole))))

    def strays(self, points: ControllerPoints, segments: Segments, x: Array) -> Flags:
        """Return in which segments the motion of `actuators` leaves the closed loops, (S,)."""
        if self.actuators == self.names:
            return super().strays(points, segments, x)
        closed = self._in_order(lambda q: self._configurations(q)[:, self._acting],
                                points.inside(segments, x)[:1])
        apart = np.abs(self.executed(points).inside(segments, x)[0] - closed)
        return np.asarray((apart > self._tolerance).any(axis=(0, 2)))

    def efforts(self, *state: Array) -> Array:
        """Return the efforts at q, u and udot, (..., n) each; InputError if one overflows."""
        return self._in_order(self._efforts, state)

    def _in_order(self, function: Callable[..., Array], state: Sequence[Array]) -> Array:
        """Return a function of rows in the order of time, for the columns of `names`."""
        # Each configuration is closed from the one before.
        rows = [np.swapaxes(values, 0, -2) for values in state]
        found = function(*(values.reshape(-1, len(self.names)) for values in rows))
        return np.swapaxes(found.reshape(*rows[0].shape[:-1], -1), 0, -2)

    def _efforts(self, q: Array, rates: Array, accelerations: Array) -> Array:
        """Return the efforts of `actuators` of rows in the order of time."""
        robot, limits, columns = self._robot, self._robot.limits, self._columns
        whole = self._whole(q, rates, accelerations)
        for j in self._others:
            at, lower, upper = whole.q[:, j], limits.lower[j], limits.upper[j]
            if at.min() < lower or at.max() > upper:
                raise InputError(f"joint '{robot.joint_names[j]}': positions from {at.min():.4g} "
                                 f'to {at.max():.4g} follow from the trajectory; expected '
                                 f'{lower:.4g} to {upper:.4g}')
        tau = self._compensate.inverse_dynamics(self._source, *whole)
        if self._act:
            return robot.joint_torques(tau, whole.q)[:, self._acting]
        none = np.zeros_like(tau)
        still = robot.joint_rates(whole.q, none)
        T = np.stack([(robot.joint_rates(whole.q, none + unit) - still)[:, columns]
                      for unit in np.eye(robot.n)], axis=-1)
        return np.asarray(np.linalg.solve(np.swapaxes(T, 1, 2), tau[..., None])[..., 0])

    def _whole(self, q: Array, rates: Array, accelerations: Array) -> MechanismMotion:
        """Return the motion of all joints, for rows in the order of time."""
        return motion_of_closed(self._robot, self._columns.tolist(), np.zeros(len(q)),
                                self._configurations(q), rates, accelerations)

    def _configurations(self, q: Array) -> Array:
        """Return the configurations, (K, n_q), of the driving joints, (K, n)."""
        if self._path is not None:
            return self._path.closed(q)
        Q = np.empty_like(q)
        Q[:, self._columns] = q
        return Q


def compile_linkage(robot: Robot) -> None:
    """Compile what trajectories of the joints with actuators need."""
    robot.compile('inverse_dynamics', 'torque_terms', 'joint_rates', 'joint_accelerations',
                  'joint_torques', batches=True)
    if robot.constraint_names:
        LoopTracker(robot, driving_joints(robot))


def driving_joints(robot: Robot) -> tuple[str, ...]:
    """
    Return the joints that drive the others, as many as independent speeds, in the robot's order.

    These are the joints with actuators, or the joints that follow motions if more have actuators.
    """
    if not isinstance(robot.equations, ConstrainedEquations):
        return robot.joint_names
    stated = _stated_actuators(robot)
    return stated if stated is not None and len(stated) == robot.n else tuple(
        robot.joint_names[k] for k in sorted(followed_joints(robot)))


def _stated_actuators(robot: Robot) -> tuple[str, ...] | None:
    """Return the joints that have actuators; None if that is not stated."""
    equations = robot.equations
    assert isinstance(equations, ConstrainedEquations)
    return None if equations.actuated is None else robot.actuated_names


def _driving(robot: Robot, given: tuple[str, ...]) -> tuple[str, ...]:
    """
    Return the driving joints among those of a trajectory, in their order.

    These are the joints with actuators, if as many as independent speeds are stated; else the
    joints of a trajectory of as many, or those that follow motions.
    """
    n, stated = robot.n, _stated_actuators(robot)
    acting = stated is not None and len(stated) == n
    wanted = set(given if len(given) == n and not acting else driving_joints(robot))
    if not wanted <= set(given):
        what = 'the joints with actuators' if acting else f'{n} joints that determine the motion'
        raise InputError(f'joint_names: {list(given)}; expected {what}, '
                         f'{", ".join(name for name in robot.joint_names if name in wanted)}, '
                         'alone or with further joints')
    return tuple(name for name in given if name in wanted)
