"""The joints of a filled trajectory, and the motion of the robot that follows."""

from collections.abc import Callable, Sequence
from contextlib import suppress
import math

from kane_dynamics._util.checks import finite_row, per_joint
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.control.computed_torque import followed_joints, require_rigid
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.control.terms import Terms
from kane_dynamics.control.torque_limiter import lowered_efforts
from kane_dynamics.control.trajectory_limits import described_time
from kane_dynamics.errors import InputError
from kane_dynamics.loop_tracking.closed_path import ClosedPath
from kane_dynamics.loop_tracking.driven_mechanism import (DrivenLoops, driving_tracker,
                                                          motion_of_closed)
from kane_dynamics.motion.controller_points import ControllerPoints, Segments
from kane_dynamics.motion.points import checked_joint_names, State
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

TURN = 2.0 * math.pi
# Of trajectories; in joint rates without constraints the last three need no kernel.
QUANTITIES_ALONG = ('inverse_dynamics', 'torque_terms', 'joint_rates',
                    'joint_accelerations', 'joint_torques')


class TrajectoryJoints:
    """
    Assigns joints their roles: given by a trajectory, driving the motion, with a torque.

    Of a robot in joint rates without constraints, all three are the same joints, and the
    others rest. With chosen speeds or constraints the driving joints are as many as
    independent speeds and determine the others. They have the actuators; of more
    actuators than independent speeds, which share the load as in `Robot.joint_torques`,
    all are joints of the result. Further joints of the trajectory are compared with the
    loop closure at its points.

    Parameters
    ----------
    robot : Robot
    source : Robot or QuasiStatic
        Its torques are the efforts.
    names : sequence of str, optional
        The joints of the trajectory. Default: all; with chosen speeds or constraints,
        those that follow motions.
    rest : (n_q,) array_like, optional
        Positions of the joints that rest, rad or m. With constraints: a nearly closed
        configuration, which gives the assembly mode. Default: that of the robot, or of
        the first point if that is of all joints.
    compensate : Terms
    loop_tolerance, max_figure : float
        With constraints: as `LoopTracker`.

    Attributes
    ----------
    names, driving, actuators : tuple of str
        The joints of the trajectory, those that determine the motion, and those of the
        result.

    Raises
    ------
    InputError
        The joints do not determine the motion, or the robot has beams or depends on
        time.

    """

    def __init__(self, robot: Robot, source: Robot | QuasiStatic,
                 names: Sequence[str] | None, rest: ArrayLike | None, compensate: Terms,
                 loop_tolerance: float, max_figure: float) -> None:
        self._robot = robot
        self._source = source
        self._compensate = compensate
        self._tolerance = loop_tolerance
        # Without constraints and in joint rates, q, u and udot are those of the joints.
        self._plain = robot.equations.in_joint_rates
        if not self._plain:
            _require_rigid_and_timeless(robot)
        if names is None and self._plain:
            names = robot.joint_names
        elif names is None:
            names = [robot.joint_names[k] for k in followed_joints(robot)]
        self.names = checked_joint_names(names, 'joint_names')
        self._check_names(rest)
        self._has_start = rest is not None
        self._pose = np.zeros(robot.n_q)
        if rest is not None:
            self._pose = finite_row(rest, 'rest: positions', robot.joint_names)

        # Of a robot in joint rates all three sets are the same.
        self.driving = self.actuators = self.names
        self._path: ClosedPath | None = None
        if not self._plain:
            self.driving = _driving(robot, self.names)
            self.actuators = _actuators(robot, self.names, self.driving)
        if isinstance(source, QuasiStatic) and not self._plain:
            source.require_drives('joint_names', self.driving)
            source.require_drives('actuated', self.actuators)
        # Only under constraints do other joints follow from the driving ones.
        tracker = driving_tracker(robot, self.driving, tolerance=loop_tolerance,
                                  max_figure=max_figure)
        if tracker is not None:
            self._path = ClosedPath(tracker, self.driving)
        # Places of driving joints and actuators in the robot's order, and of driving
        # joints in the trajectory's.
        self._columns = np.array(self._places(self.driving))
        self._acting = self._places(self.actuators)
        self._chosen = list(map(self.names.index, self.driving))

    def _check_names(self, rest: ArrayLike | None) -> None:
        """Raise InputError for an unknown joint, or one of a tree without a position."""
        joints = self._robot.joint_names
        unknown = [name for name in self.names if name not in joints]
        if unknown:
            expected = ', '.join(joints)
            raise InputError(f"joint_names: '{unknown[0]}' is not a joint of the robot; "
                             f'expected some or all of {expected}')
        others = [name for name in joints if name not in self.names]
        if self._plain and others and rest is None:
            raise InputError(f'joint_names: without {", ".join(others)}; expected these '
                             'too, or the positions at which they rest')

    def _places(self, names: Sequence[str]) -> list[int]:
        """Return the indices of joints in the robot's order."""
        return list(map(self._robot.joint_names.index, names))

    def chosen(self, values: Array) -> Array:
        """Return the columns of the driving joints, from all of the trajectory."""
        return values[..., self._chosen]

    def allowed(self, tolerance: ArrayLike) -> Array:
        """Return tolerances of the efforts; the smallest for those not in `names`."""
        values = per_joint(tolerance, 'tolerance', self.names, finite=False)
        by_name = dict(zip(self.names, values.tolist()))
        smallest = float(values.min())
        return np.array([by_name.get(name, smallest) for name in self.actuators])

    def limits(self, effort: ArrayLike, names: Sequence[str]) -> JointLimits:
        """Return the limits of joints, with a further effort limit of all joints."""
        stated = self._robot.limits
        efforts = lowered_efforts(stated.effort, effort, self._robot.joint_names)
        places = self._places(names)
        return JointLimits(stated.lower[places], stated.upper[places],
                           stated.velocity[places], efforts[places])

    def turned(self, start: Array, first: Array, limits: JointLimits) -> State:
        """Return a state, (3, n), with unlimited joints next to the first point."""
        q, u, udot = start
        unlimited = np.isinf(limits.lower) & np.isinf(limits.upper)
        turning = np.array([name not in self._robot.model.sliding
                            for name in self.driving])
        turns = np.round((first - q) / TURN)
        return q + (unlimited & turning) * TURN * turns, u, udot

    def follow(self, points: ControllerPoints, positions: Array, times: Array) -> None:
        """
        Close the loops along a motion; LoopError names the point at which that fails.

        Parameters
        ----------
        points : ControllerPoints
            Of the driving joints.
        positions : (K, m) array
            Of the trajectory's joints, at the last K points.
        times : (K,) array
            Times of the trajectory as given, s.

        """
        if self._path is None:
            return
        further = [k for k, name in enumerate(self.names) if name not in self.driving]
        self._path.begin(*self._starts(points, positions))
        self._path.follow(points, self._places([self.names[k] for k in further]),
                          positions[:, further], lambda t: described_time(t, times))

    def _starts(self, points: ControllerPoints, positions: Array) -> list[Array]:
        """Return nearly closed configurations; the first that closes is the start."""
        robot = self._robot
        if self._has_start:  # joints that turn without limits may be turns away from it
            q = robot.closed_configuration(self._pose)
            driving = q[self._columns]
            limits = self.limits(np.inf, self.driving)
            turned = q.copy()
            turned[self._columns] = self.turned(np.tile(driving, (3, 1)), points.q[0],
                                                limits)[0]
            return [turned, q]
        if robot.configuration is not None:
            return [robot.closed_configuration(robot.configuration)]
        # A point of all joints gives the assembly mode; else it is that near zero.
        if len(self.names) == robot.n_q:
            order = list(map(self.names.index, robot.joint_names))
            return [robot.closed_configuration(positions[0, order], fixed=self.driving)]
        guess = np.zeros(robot.n_q)
        guess[self._columns] = points.q[0]
        return [robot.closed_configuration(guess, fixed=self.driving)]

    def executed(self, points: ControllerPoints) -> ControllerPoints:
        """Return the points of the actuators for those of the driving joints."""
        if self.actuators == self.driving:
            return points
        q, u, udot = self._motion(points.q, points.u, points.udot)
        rates = self._robot.joint_rates(q, u)
        accelerations = self._robot.joint_accelerations(q, u, udot)
        acting = self._acting
        return ControllerPoints(points.t, q[:, acting], rates[:, acting],
                                accelerations[:, acting])

    def strays(self, points: ControllerPoints, segments: Segments, x: Array) -> Flags:
        """
        Return in which segments the actuators leave the closed loops, (S,).

        Arguments are those of `ControllerPoints.inside`.
        """
        if self.actuators == self.driving:
            return np.zeros(len(segments), dtype=bool)
        closed = self._in_order(lambda q: self._configurations(q)[:, self._acting],
                                points.inside(segments, x)[:1])
        deviation = np.abs(self.executed(points).inside(segments, x)[0] - closed)
        return np.asarray((deviation > self._tolerance).any(axis=(0, 2)))

    def efforts(self, q: Array, u: Array, udot: Array) -> Array:
        """
        Return the efforts of the actuators for motions of the driving joints.

        InputError if one overflows, or if another joint leaves its limits.
        """
        return self._in_order(self._efforts, (q, u, udot))

    def _in_order(self, function: Callable[..., Array], state: Sequence[Array]) -> Array:
        """
        Return a function of rows, of the driving joints, in the order of time.

        Arrays are (K, n), or (m, S, n) at m times inside of S segments: each
        configuration is closed from the one before, so that rows must follow each other.
        """
        rows = [np.swapaxes(values, 0, -2) for values in state]
        flat = [values.reshape(-1, len(self.driving)) for values in rows]
        result = function(*flat).reshape(*rows[0].shape[:-1], -1)
        return np.swapaxes(result, 0, -2)

    def _efforts(self, q: Array, rates: Array, accelerations: Array) -> Array:
        """Return the efforts of the actuators for rows in the order of time."""
        motion = self._motion(q, rates, accelerations)
        if self._plain:  # torques of the joints, without loops to follow
            tau = self._compensate.inverse_dynamics(self._source, *motion)
            return tau[:, self._acting]
        self._check_limits(motion[0])
        tau = self._compensate.inverse_dynamics(self._source, *motion)
        if _stated_actuators(self._robot) is not None:
            return self._robot.joint_torques(tau, motion[0])[:, self._acting]
        return self._of_driving(tau, motion[0])

    def _check_limits(self, q: Array) -> None:
        """Raise InputError if joints that follow from others leave their limits."""
        limits = self._robot.limits
        # Joints of the trajectory were checked by their points; those that follow are
        # not.
        for k, name in enumerate(self._robot.joint_names):
            if name in self.driving:
                continue
            lowest, highest = q[:, k].min(), q[:, k].max()
            if lowest < limits.lower[k] or highest > limits.upper[k]:
                raise InputError(f"joint '{name}': positions from {lowest:.4g} to "
                                 f'{highest:.4g} follow from the trajectory; expected '
                                 f'{limits.lower[k]:.4g} to {limits.upper[k]:.4g}')

    def _of_driving(self, tau: Array, q: Array) -> Array:
        """Return the torques of the driving joints for a generalized force, T^-T tau."""
        robot = self._robot
        none = np.zeros_like(tau)
        drift = robot.joint_rates(q, none)
        # T by columns: the rates of the driving joints for a unit of each speed.
        columns = []
        for unit in np.eye(robot.n):
            rates = robot.joint_rates(q, none + unit) - drift
            columns.append(rates[:, self._columns])
        T = np.stack(columns, axis=-1)
        return np.asarray(np.linalg.solve(np.swapaxes(T, 1, 2), tau[..., None])[..., 0])

    def _motion(self, q: Array, rates: Array, accelerations: Array) -> State:
        """Return q (K, n_q), u, udot (K, n) of the robot, in the order of time."""
        configurations = self._configurations(q)
        return motion_of_closed(self._robot, self._columns.tolist(), np.zeros(len(q)),
                                configurations, rates, accelerations)

    def _configurations(self, q: Array) -> Array:
        """Return the configurations, (K, n_q), of the driving joints, (K, n)."""
        if self._path is not None:
            return self._path.closed(q)
        configurations = np.tile(self._pose, (len(q), 1))
        configurations[:, self._columns] = q
        return configurations


def _require_rigid_and_timeless(robot: Robot) -> None:
    """Raise InputError for a robot with beams, or one that depends on time."""
    require_rigid(robot)
    robot.equations.require_timeless(
        'robot', 'as a trajectory does not state when in that time it starts')


def _stated_actuators(robot: Robot) -> tuple[str, ...] | None:
    """Return the joints that have actuators; None if that is not stated."""
    equations = robot.equations
    return None if equations.actuated is None else robot.actuated_names


def _actuators(robot: Robot, names: tuple[str, ...], driving: tuple[str, ...]
               ) -> tuple[str, ...]:
    """Return the joints of the result: actuators, those of the trajectory first."""
    stated = _stated_actuators(robot)
    if stated is None:
        return driving
    further = [name for name in stated if name not in names]
    return (*(name for name in names if name in stated), *further)


def driving_joints(robot: Robot) -> tuple[str, ...]:
    """
    Return the joints that drive the others, in the robot's order.

    These are the joints with actuators, or the joints that follow motions if more have
    actuators.
    """
    stated = _stated_actuators(robot)
    if stated is not None and len(stated) == robot.n:
        return stated
    followed = sorted(followed_joints(robot))
    return tuple(robot.joint_names[k] for k in followed)


def _driving(robot: Robot, names: tuple[str, ...]) -> tuple[str, ...]:
    """
    Return the driving joints among those of a trajectory, in their order.

    These are the joints with actuators, if as many as independent speeds are stated;
    else the joints of a trajectory of as many, or those that follow motions.
    """
    # n stated actuators drive the motion; otherwise n joints of the trajectory do.
    n = robot.n
    stated = _stated_actuators(robot)
    fully_actuated = stated is not None and len(stated) == n
    if len(names) == n and not fully_actuated:
        driving = set(names)
    else:  # an error if the independent speeds are no joint rates
        driving = set(driving_joints(robot))
    if not driving <= set(names):
        what = f'{n} joints that determine the motion'
        if fully_actuated:
            what = 'the joints with actuators'
        listed = ', '.join(name for name in robot.joint_names if name in driving)
        raise InputError(f'joint_names: {list(names)}; expected {what}, {listed}, alone '
                         'or with further joints')
    return tuple(name for name in names if name in driving)


def compile_trajectories(robot: Robot) -> None:
    """Compile what trajectories need."""
    names = [name for name in QUANTITIES_ALONG if name in robot.kernels.names]
    robot.compile(*names, batches=True)
    with suppress(InputError):  # refused where a trajectory is filled
        DrivenLoops(robot, driving_joints(robot))
