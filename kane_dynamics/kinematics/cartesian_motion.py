"""
Motions of the joints in which a frame follows a path of poses.

Inverse kinematics gives the configuration at each time, near the one that the motion
before it predicts; the pseudoinverse of the Jacobian and its rate give the speeds and
accelerations, so that the joints move along quintics. Between the times the frame is
compared with the path, and times are added until it is near enough. What the joints
cannot follow is an error before anything moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from kane_dynamics._util.checks import instance, number
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.damped_least_squares import (AT_LIMIT, inverse_kinematics,
                                                           InverseKinematics)
from kane_dynamics.kinematics.pose_motion import PoseLimits, PoseMotion
from kane_dynamics.kinematics.pose_path import PosePath
from kane_dynamics.kinematics.poses import pose_error
from kane_dynamics.loop_tracking.driven_mechanism import DrivenLoops
from kane_dynamics.loop_tracking.loop_tracker import velocity_rows
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.model.model import WORLD
from kane_dynamics.motion.motion import Motion
from kane_dynamics.native.runtime.kernel import Argument, checked
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

EXACT = 1e-10  # m and rad, of inverse kinematics at the times
FINEST = 1e-9  # m and rad, least tolerance
ITERATIONS = 50
FIRST_INTERVALS = 8  # of each phase of the motion along the path
MOST_POINTS = 20_000
FRACTIONS = np.array([0.2, 0.5, 0.8])  # of an interval, where the frame is compared
JUMP = 0.5  # rad or m between two points: the configuration has changed, not followed
SHORTEST = 1e-7  # of the duration: of a phase that gets points of its own
CLOSE = 1e-4  # of the duration: of a time that is reached to one that is not
NEGLIGIBLE = 1e-9  # of the largest singular value: directions that do not move
NEAR_SINGULAR = 0.05  # smallest singular value that an error calls singular
PARTS = 0.1  # of a unit vector that an error states
SLACK = 1e-9  # of limits of speed, relative


@dataclass(frozen=True, eq=False)
class CartesianMotion:
    """
    A motion of the joints in which a frame follows a path of poses.

    Attributes
    ----------
    motion : Motion
        Of all joints; with constraints, of the joints of the independent speeds.
    desired : PoseMotion
        The motion of the frame.
    distance : float
        Largest distance of the frame from its desired pose between the points of the
        motion, m.
    angle : float
        Likewise the angle, rad; 0 along a path of positions.
    smallest_singular_value : float
        Of the Jacobian along the motion, m/rad and 1 mixed: near 0 next to a singular
        configuration.
    nearest_singular : float
        Its time, s.
    largest_speed : float
        Largest share of a velocity limit of a joint; 0 without limits.

    """

    motion: Motion
    desired: PoseMotion
    distance: float
    angle: float
    smallest_singular_value: float
    nearest_singular: float
    largest_speed: float


class _State(NamedTuple):
    """Coordinates, their rates and accelerations, (n_q,), at a time of the motion."""

    q: Array
    rates: Array
    accelerations: Array
    singular_values: Array


def cartesian_motion(robot: Robot, frame: str, q: ArrayLike,
                     path: PosePath | PoseMotion | ArrayLike,
                     limits: PoseLimits | None = None, *, duration: float | None = None,
                     tolerance: float = 1e-5) -> CartesianMotion:
    """
    Return the motion of the joints in which a frame follows a path, from rest to rest.

    Redundant joints move with the smallest norm of the independent speeds. The result is
    a path for `feasibility.time_optimal`, which ignores its timing.

    Parameters
    ----------
    robot : Robot
        With joint angles and positions as coordinates, no ball joints, no beams;
        constraints of positions, with rates of joints as independent speeds.
    frame : str
        One of `robot.frame_names`.
    q : (n_q,) array_like
        The configuration at the start, within the limits, rad or m.
    path : PosePath, PoseMotion, (4, 4) or (3,) array_like
        A path from the frame's pose at the start; a motion along one, without limits and
        duration; or a pose or a position to which the frame moves on a straight line.
    limits : PoseLimits, optional
        Of the frame: the motion is as fast as they allow.
    duration : float, optional
        Instead of limits, s.
    tolerance : float
        Largest distance, m, and angle, rad, of the frame from the path between the
        points of the motion.

    Raises
    ------
    InputError
        An argument is invalid; the path leaves the reach or the limits of the joints, or
        a joint exceeds its velocity limit, as next to a singular configuration. Names the
        place on the path, the joint, and the directions in which the frame cannot move.
    LoopError
        Loops do not close between two configurations.

    """
    instance(robot, Robot, 'robot')
    require_angles(robot.model, 'cartesian_motion')
    if robot.model.flexible:
        raise InputError('robot: with beams; expected a rigid robot, as a path does not '
                         'state their deflections')
    # Below this, rounding decides which points are needed.
    tolerance = number(tolerance, 'tolerance', f'a number from {FINEST:g}, m and rad',
                       lambda x: FINEST <= x < np.inf)
    if robot.model.frame(frame).body == WORLD:
        raise InputError(f"frame: '{frame}', which does not move; expected a frame of a "
                         'moving body')

    # The joints follow the desired motion of the frame from its first pose.
    names = _moved_joints(robot)
    start = _start(robot, q)
    desired = _desired(robot, frame, start, path, limits, duration)
    follower = _Follower(robot, frame, desired, names, tolerance)
    return follower.follow(start)


class _Follower:
    """The joints of a robot behind a desired motion of a frame."""

    def __init__(self, robot: Robot, frame: str, desired: PoseMotion,
                 names: tuple[str, ...], tolerance: float) -> None:
        self.robot = robot
        self.frame = frame
        self.desired = desired
        self.tolerance = tolerance
        self.names = names
        self.columns = list(map(robot.coordinate_names.index, names))
        self.rows = 6 if desired.path.oriented else 3
        self.rank = 1  # of the Jacobian, the largest one along the motion
        self.loops = DrivenLoops(robot, names)

    def follow(self, start: Array) -> CartesianMotion:
        """Return the motion from a configuration, with as many points as needed."""
        # March along the motion, and divide intervals until errors between the points
        # are small.
        times = _divided(self.desired.times, FIRST_INTERVALS)
        self._require_start(start)
        while True:
            states, failure = self._march(times, start)
            if failure is not None:
                times = self._divided_at(times, len(states), failure)
                continue
            whole = self._motion(times, states)
            distances, angles = self._errors(whole)
            # Deviations between the points, where only the interpolation decides.
            far = np.maximum(distances, angles).max(axis=1) > self.tolerance
            if not far.any():
                break
            middles = 0.5 * (times[:-1] + times[1:])[far]
            times = np.sort(np.concatenate([times, middles]))
            if len(times) > MOST_POINTS:
                place = self._place(float(middles[0]))
                raise InputError(f'tolerance: {self.tolerance:g} with more than '
                                 f'{MOST_POINTS} points, {place}; expected a larger one, '
                                 'or a path farther from singular configurations')
        # The figures of the result: speeds, and the place nearest to a singularity.
        largest_speed = self._largest_speed(times, states)
        singular_values = _smallest([state.singular_values for state in states])
        nearest = int(singular_values.argmin())
        return CartesianMotion(
            self._of_joints(whole), self.desired, float(distances.max()),
            float(angles.max()), float(singular_values[nearest]), float(times[nearest]),
            largest_speed)

    def _require_start(self, start: Array) -> None:
        """Raise InputError unless the path begins at the pose of the start."""
        # Of a path of positions alone, the first three rows count.
        error = pose_error(self.robot.frame_pose(self.frame, start),
                           self.desired.sample(0.0).pose)[:self.rows]
        if np.abs(error).max() > self.tolerance:
            distance = float(np.linalg.norm(error[:3]))
            angle = float(np.linalg.norm(error[3:]))
            raise InputError(f"q: '{self.frame}' is {distance:.4g} m and {angle:.4g} rad "
                             'from the start of the path; expected a configuration of '
                             'inverse_kinematics there')

    def _march(self, times: Array, start: Array
               ) -> tuple[list[_State], InputError | None]:
        """Return the states, up to the first time that is not reached, and why."""
        desired = self.desired.sample(times)
        states: list[_State] = []
        q = start
        for k, t in enumerate(times):
            # Predict from the last state, then close the remaining error of the pose.
            if k:
                q = self._predicted(states[-1], times[k] - times[k - 1])
            twist = desired.twist[k]
            acceleration = desired.acceleration[k]
            try:
                q = self._at_pose(q, desired.pose[k], t)
                state = self._state(q, twist, acceleration)
                if k and self._redundant:
                    # The integral of the speeds, in fourth order, back on the path.
                    q = _integrated(states[-1], state, times[k] - times[k - 1])
                    q = self._at_pose(q, desired.pose[k], t)
                    state = self._state(q, twist, acceleration)
                if k:
                    self._require_no_jump(states[-1], state, t)
            except InputError as error:
                return states, error
            states.append(state)
        return states, None

    @property
    def _redundant(self) -> bool:
        """Return whether more joints move than the path determines."""
        return self.robot.n > self.rows

    def _predicted(self, state: _State, interval: float) -> Array:
        """Return a configuration within the limits after an interval."""
        limits = self.robot.limits
        step = interval * (state.rates + 0.5 * interval * state.accelerations)
        longest = float(np.abs(step).max())
        if longest > JUMP:
            step *= JUMP / longest
        return np.clip(state.q + step, limits.lower, limits.upper)

    def _at_pose(self, q: Array, pose: Array, t: float) -> Array:
        """Return the configuration at a pose, near q; InputError without one."""
        target = pose if self.rows == 6 else pose[:3, 3]
        # One start: another configuration than the nearest one is no continuation.
        solution = inverse_kinematics(self.robot, self.frame, target, q, starts=1,
                                      tolerance=EXACT, iterations=ITERATIONS)
        if not solution.converged:
            raise InputError(f"path: '{self.frame}' does not reach {self._place(t)}: "
                             f'{self._obstacle(solution)}; expected a path within reach '
                             'and within the limits of the joints')
        return solution.q

    def _state(self, q: Array, twist: Array, acceleration: Array) -> _State:
        """Return the motion of all coordinates that has a twist and its rate."""
        robot = self.robot
        J = robot.jacobian(self.frame, q)[:self.rows]
        left, singular_values, right = np.linalg.svd(J, full_matrices=False)
        moves = singular_values > NEGLIGIBLE * singular_values[0]
        self.rank = max(self.rank, int(moves.sum()))
        inverse = (right.T[:, moves] / singular_values[moves]) @ left.T[moves]
        u = inverse @ twist[:self.rows]
        rate = robot.jacobian_rate(self.frame, q, u)[:self.rows]
        # The derivative of the pseudoinverse (Golub, Pereyra, 1973), whose second term
        # is along the motions that leave the frame at rest.
        udot = inverse @ (acceleration[:self.rows] - rate @ u)
        free = rate.T @ (inverse.T @ u)
        udot += free - inverse @ (J @ free)
        return _State(q, robot.joint_rates(q, u), robot.joint_accelerations(q, u, udot),
                      singular_values)

    def _motion(self, times: Array, states: Sequence[_State]) -> Motion:
        """Return the motion of all coordinates."""
        q, rates, accelerations, _ = map(np.array, zip(*states))
        return Motion.from_points(times, q, rates, accelerations,
                                  joint_names=self.robot.coordinate_names)

    def _of_joints(self, whole: Motion) -> Motion:
        """Return the motion of the joints that move, which determine all others."""
        if self.names == whole.joint_names:
            return whole
        coefficients = whole.coefficients[:, :, self.columns].copy()
        return Motion(self.names, whole.times, whole.positions[:, self.columns].copy(),
                      coefficients)

    def _errors(self, whole: Motion) -> tuple[Array, Array]:
        """Return distances and angles from the path between the points, (K - 1, 3)."""
        # Between the points, where the joints follow their own curves and not the path.
        intervals = np.diff(whole.times)
        t = (whole.times[:-1, None] + intervals[:, None] * FRACTIONS).ravel()
        q = whole.positions_at(t)
        q = self.loops.closed(q, np.zeros(len(q)), lambda k: self._place(float(t[k])))
        errors = pose_error(self.robot.frame_pose(self.frame, q),
                            self.desired.sample(t).pose)
        distances = np.linalg.norm(errors[:, :3], axis=1)
        angles = np.linalg.norm(errors[:, 3:self.rows], axis=1)
        shape = len(intervals), len(FRACTIONS)
        return distances.reshape(shape), angles.reshape(shape)

    def _largest_speed(self, times: Array, states: Sequence[_State]) -> float:
        """Return the largest share of a velocity limit; InputError if it exceeds one."""
        limits = self.robot.limits.velocity
        rates = np.abs([state.rates for state in states])
        # A joint without a limit has a share of 0; one at limit 0 that moves an infinite
        # share.
        with np.errstate(divide='ignore', invalid='ignore'):
            shares = np.nan_to_num(rates / limits, nan=0.0, posinf=np.inf)
        k, joint = np.unravel_index(int(shares.argmax()), shares.shape)
        largest = float(shares[k, joint])
        if largest > 1.0 + SLACK:
            name = self.robot.coordinate_names[int(joint)]
            near = self._singular(states[int(k)])
            raise InputError(
                f"path: joint '{name}': {rates[k, joint]:.4g} rad/s or m/s "
                f'{self._place(float(times[k]))}{near}; expected at most its velocity '
                f'limit {limits[joint]:.4g}: a motion {largest:.4g} times slower, one by '
                'time_optimal, or another path')
        return largest

    def _divided_at(self, times: Array, k: int, failure: InputError) -> Array:
        """Return the times and one more: halfway to time k, whose pose is not reached."""
        if k == 0 or times[k] - times[k - 1] < CLOSE * self.desired.duration:
            raise failure
        return np.insert(times, k, 0.5 * (times[k - 1] + times[k]))

    def _require_no_jump(self, before: _State, after: _State, t: float) -> None:
        """Raise InputError where the configuration changes instead of being followed."""
        change = np.abs(after.q - before.q)
        if change.max() <= JUMP:
            return
        name = self.robot.coordinate_names[int(change.argmax())]
        raise InputError(f"path: joint '{name}' jumps by {change.max():.3g} rad or m "
                         f'{self._place(t)}{self._singular(before)}; expected a path '
                         'farther from singular configurations')

    def _place(self, t: float) -> str:
        """Return the place on the path at a time in words."""
        position = self.desired.sample(t).pose[:3, 3].round(4).tolist()
        share = 100.0 * t / self.desired.duration
        return f'at {share:.3g} % of the time, position {position}'

    def _obstacle(self, solution: InverseKinematics) -> str:
        """Return why a pose is not reached."""
        # A joint at its limit is the most likely reason.
        robot = self.robot
        at_lower = solution.q <= robot.limits.lower + AT_LIMIT
        at_upper = solution.q >= robot.limits.upper - AT_LIMIT
        at_limits = []
        for k in np.flatnonzero(at_lower | at_upper):
            side = 'lower' if at_lower[k] else 'upper'
            at_limits.append(f"joint '{robot.coordinate_names[k]}' at its {side} limit "
                             f'{solution.q[k]:.4g}')
        if at_limits:
            return ', '.join(at_limits)

        # No limit is in the way: the pose is singular or out of reach.
        state = self._state(solution.q, np.zeros(6), np.zeros(6))
        distance = float(np.linalg.norm(solution.error[:3]))
        remaining = f'{distance:.3g} m'
        if self.rows == 6:
            angle = float(np.linalg.norm(solution.error[3:]))
            remaining += f' and {angle:.3g} rad'
        return f'{remaining} remain{self._singular(state) or ", out of reach"}'

    def _singular(self, state: _State) -> str:
        """Return a singular configuration in words, or nothing if it is none."""
        robot = self.robot
        last = self.rank - 1  # of the directions in which the frame moves elsewhere
        if state.singular_values[last] > NEAR_SINGULAR:
            return ''
        # The left singular vector is the motion that the frame lost; the right one moves
        # the joints without it.
        J = robot.jacobian(self.frame, state.q)[:self.rows]
        left, singular_values, right = np.linalg.svd(J)
        lost = left[:, last]
        directions = []
        for what, part in (('move along', lost[:3]), ('turn about', lost[3:])):
            if np.abs(part).max(initial=0.0) > PARTS:
                directions.append(f'{what} {part.round(2).tolist()}')
        moving = np.abs(right[last]) > PARTS
        joints = [name for name, moves in zip(robot.speed_names, moving) if moves]
        return (f', next to a singular configuration (singular value '
                f'{singular_values[last]:.2g}), where {", ".join(joints)} move without '
                f'the frame, which cannot {" and ".join(directions)}')


def _integrated(before: _State, after: _State, interval: float) -> Array:
    """Return the configuration after an interval, by Hermite's quadrature."""
    rates = 0.5 * interval * (before.rates + after.rates)
    change = interval**2 / 12.0 * (before.accelerations - after.accelerations)
    return np.asarray(before.q + rates + change)


def _divided(times: Array, parts: int) -> Array:
    """Return times with the intervals divided into equal parts."""
    # Phases as short as their rounding need no points.
    long = np.diff(times) > SHORTEST * times[-1]
    starts = times[:-1][long]
    ends = np.append(starts[1:], times[-1])
    inner = starts[:, None] + (ends - starts)[:, None] * np.arange(parts) / parts
    return np.append(inner.ravel(), times[-1])


def _smallest(singular_values: Sequence[Array]) -> Array:
    """Return the smallest singular values of directions in which the frame moves, (K,)."""
    values = np.array(singular_values)
    # Directions in which it moves nowhere, as across a plane, do not count.
    moves: Flags = values.max(axis=0) > NEGLIGIBLE * values.max()
    return np.asarray(values[:, moves].min(axis=1))


def _desired(robot: Robot, frame: str, start: Array,
             path: PosePath | PoseMotion | ArrayLike, limits: PoseLimits | None,
             duration: float | None) -> PoseMotion:
    """Return the desired motion of the frame; a pose is the end of a straight line."""
    # A motion has its own timing; a path or a pose is timed by limits or duration.
    if isinstance(path, PoseMotion):
        if limits is not None or duration is not None:
            raise InputError('limits and duration: given for a PoseMotion, which has '
                             'them; expected None')
        return path
    if not isinstance(path, PosePath):
        try:
            target = np.asarray(path, dtype=np.float64)
        except (TypeError, ValueError):
            target = np.empty(0)
        if target.shape not in ((4, 4), (3,)):
            raise InputError(f'path: a {type(path).__name__} of shape {target.shape}; '
                             'expected a PosePath, a PoseMotion, a pose (4, 4) or a '
                             'position (3,)')
        # A pose or position is the end of a straight line from where the frame is.
        pose = robot.frame_pose(frame, start)
        first = pose if target.ndim == 2 else pose[:3, 3]
        path = PosePath.through([first, target])
    return PoseMotion(path, limits, duration=duration)


def _moved_joints(robot: Robot) -> tuple[str, ...]:
    """Return the joints of the motion, which determine the others under constraints."""
    # A rolling wheel reaches one configuration of its joints in many ways.
    if velocity_rows(robot):
        raise InputError('robot: with constraints of velocities; expected constraints of '
                         'positions, with which joints determine the configuration')
    # As many joints as independent speeds: there is no choice.
    if robot.n == robot.n_q:
        return robot.coordinate_names
    speeds = [name for name in robot.speed_names if name not in robot.coordinate_names]
    if speeds:
        raise InputError(f'robot: constraints with the speeds {speeds}; expected rates of '
                         'joints as independent speeds')
    return robot.speed_names


def _start(robot: Robot, q: ArrayLike) -> Array:
    """Return the start; InputError unless it is one configuration within the limits."""
    q_start = checked(Argument('q', (robot.n_q,), robot.coordinate_names), q)
    if q_start.ndim != 1:
        raise InputError(f'q: shape {q_start.shape}; expected ({robot.n_q},), one '
                         'configuration')
    # The start may be on a limit, but for rounding.
    beyond = np.maximum(robot.limits.lower - q_start, q_start - robot.limits.upper)
    worst = int(beyond.argmax())
    if beyond[worst] > AT_LIMIT:
        raise InputError(f"q: joint '{robot.coordinate_names[worst]}': position "
                         f'{q_start[worst]:g}; expected within its limits '
                         f'{robot.limits.lower[worst]:g} to {robot.limits.upper[worst]:g}')
    return q_start
