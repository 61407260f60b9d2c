"""
PD of motors around a computed motion of elastic joints, for every kind of mechanism.

It is the law of `MotorSideControl`,

    tau_m = tau_m,d + kp (theta_d - theta) + kd (theta'_d - theta'),

whose desired motion is computed before, by `ElasticFeedforward.along`: loops are closed
along the motion, and damped deflections are integrated. In generalized coordinates the
torques of motors and of rigid joints with actuators are T^T tau_m.
"""

from __future__ import annotations

import math

from kane_dynamics._util.checks import finite_row, instance, integer, number, per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.control.elastic_control import check_side, effort_tolerance, LINK, MOTOR
from kane_dynamics.control.elastic_feedforward import ElasticFeedforward
from kane_dynamics.control.trajectory_feedforward import FilledTrajectory, MOST_POINTS
from kane_dynamics.errors import InputError
from kane_dynamics.model.drive import StiffnessCurve
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import SmoothMotion
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike, NDArray

STEP = 5e-4  # s
SETTLED = 30.0  # time constants D / k until a deflection rests


class MotorTracking:
    """
    PD of the motors around the elastic feedforward along a motion, also of closed loops.

    The desired motion of the motors is computed once, at the construction, with the gravity
    and the payload that the robot has then. Between its rows the motors' positions are
    quintics, the torques linear. Before and after the motion the motors hold its ends; motors
    of damped drives come to rest after the links.

    Parameters
    ----------
    feedforward : ElasticFeedforward
        Of the robot.
    motion : SmoothMotion or Motion
        As of `ElasticFeedforward.along`: of all links of a tree; under constraints, of as
        many joints as independent speeds.
    kp, kd : float or (n,) array_like
        N m/rad and N m s/rad, joint-side, one or one for each of `joint_names`.
    lead : float
        By which the feedforward torque is ahead, s: half of the cycle for which a torque is
        held, and the delay until it acts.
    step : float
        Largest time between the rows, s.

    Attributes
    ----------
    joint_names : tuple of n str
        Joints with actuators, elastic or rigid.
    command : ElasticMotion
        The rows. The first ones of `link_position` and `motor_position` are the state at
        rest in which the motion begins.

    Raises
    ------
    InputError
        As of `ElasticFeedforward.along`; the robot has ball joints, or a gain is invalid.
    LoopError
        The loops do not close along the motion.

    """

    def __init__(self, feedforward: ElasticFeedforward, motion: SmoothMotion | Motion, *,
                 kp: ArrayLike, kd: ArrayLike, lead: float = 0.0,
                 step: float = STEP) -> None:
        """Compute the motion of the motors, and find their coordinates."""
        instance(feedforward, ElasticFeedforward, 'feedforward')
        self.lead = number(lead, 'lead', 'a finite number >= 0, s', lambda x: 0.0 <= x < np.inf)
        robot = feedforward.robot
        self.robot = robot
        # The command: motion and torque of the motors for the motion of the links.
        self._feedforward = feedforward
        self._motion = _with_settling(motion, robot)
        self.command = feedforward.along(self._motion, _even_step(self._motion, step))
        self.joint_names = feedforward.actuated_names
        self.kp = per_joint(kp, 'kp', self.joint_names)
        self.kd = per_joint(kd, 'kd', self.joint_names)
        # Coordinates of the motors; of a rigid joint, its own.
        motor_of = {elastic.name: elastic.motor for elastic in robot.drives}
        self._motors: list[int] = []
        columns: list[int] = []
        for name in self.joint_names:
            own = robot.model.joint_names.index(name)
            self._motors.append(motor_of.get(name, own))
            columns.append(feedforward.joint_names.index(name))
        self._columns = columns
        # The motion of the motors, as a path that can be sampled at any time.
        rows = self.command
        self._torque = rows.motor_torque[:, columns]
        self._path = Motion.from_points(
            rows.time, rows.motor_position[:, columns], rows.motor_speed[:, columns],
            rows.motor_acceleration[:, columns], joint_names=self.joint_names)

    def trajectory(self, tolerance: ArrayLike, *, sensor_side: str = MOTOR,
                   max_points: int = MOST_POINTS) -> FilledTrajectory:
        """
        Return the motion as a trajectory for joint_trajectory_controller.

        As `MotorSideControl.trajectory`, but of `joint_names`, also of closed loops and of
        drives with damping. Its points are rows of `command`.

        Parameters
        ----------
        tolerance : float or (n,) array_like
            Largest error of the interpolated effort at the rows, N m or N, positive.
        sensor_side : 'motor' or 'link'
            Side of the gear on which the encoders are.
        max_points : int
            Largest number of points.

        Raises
        ------
        InputError
            An invalid tolerance or side, or a tolerance that needs more points.

        """
        check_side(sensor_side)
        allowed = effort_tolerance(tolerance, self.joint_names)
        max_points = integer(max_points, 'max_points', 1)
        rows = self.command
        first = self._rows_of_points()
        points = first
        while True:
            if len(points) > max_points:
                raise InputError(f'tolerance: {allowed.tolist()} needs more than '
                                 f'{max_points} points; expected a larger one')
            # Errors of the efforts that are interpolated between the points, at all rows.
            errors = np.zeros_like(self._torque)
            for k, torque in enumerate(self._torque.T):
                acting = np.interp(rows.time, rows.time[points], torque[points])
                errors[:, k] = np.abs(torque - acting)
            wrong = np.flatnonzero((errors > allowed).any(axis=1))
            if not len(wrong):
                break
            # Halve the intervals in which an effort is too far away.
            ends = np.unique(np.searchsorted(points, wrong))
            middles = (points[ends - 1] + points[ends]) // 2
            points = np.unique(np.concatenate([points, middles]))
        motion = np.stack([rows.motor_position, rows.motor_speed, rows.motor_acceleration])
        if sensor_side == LINK:
            motion = self._links_along(rows.time)
        position, speed, acceleration = motion[:, points][:, :, self._columns]
        return FilledTrajectory(self.joint_names, rows.time[points], position, speed,
                                acceleration, self._torque[points],
                                len(points) - len(first), errors.max(axis=0))

    def _rows_of_points(self) -> NDArray[np.int_]:
        """Return the rows next to the points of the motion, with the first and the last."""
        last = len(self.command.time) - 1
        next_rows = np.searchsorted(self.command.time, self._motion.times)
        return np.unique([0, *np.minimum(next_rows, last), last])

    def _links_along(self, times: Array) -> Array:
        """Return position, speed and acceleration of all links at times, (3, N, n)."""
        motion = self._motion
        if isinstance(motion, Motion):
            motion = SmoothMotion.from_motion(motion)
        state = motion.sample(np.minimum(times, motion.duration))
        links = self._feedforward.rows_along(times, state, motion.joint_names)[1]
        return np.asarray(links.swapaxes(0, 1))

    def __call__(self, t: float, q: ArrayLike, u: ArrayLike) -> Array:
        """Return tau, (n,), at a time and a state, as `simulate` needs it."""
        robot = self.robot
        t = number(t, 't', 'a finite number, s', np.isfinite)
        q = finite_row(q, 'q', robot.coordinate_names)
        u = finite_row(u, 'u', robot.speed_names, part='speed')
        # The desired state of the motors, and their rates, whatever the speeds are.
        position, speed, _ = self._path.sample(np.array([t]))
        rates = robot.joint_rates(q, u, t=t)
        torques = np.zeros(robot.model.n)
        for k, motor in enumerate(self._motors):
            # Feedforward a lead ahead of time, plus feedback of each motor.
            ahead = np.interp(t + self.lead, self.command.time, self._torque[:, k])
            torques[motor] = (ahead + self.kp[k] * (position[0, k] - q[motor])
                              + self.kd[k] * (speed[0, k] - rates[motor]))
        return np.asarray(robot.generalized_force(torques, q, t=t))


def _even_step(motion: SmoothMotion | Motion, step: float) -> float:
    """Return the largest step of at most `step` with which the last row is the end."""
    longest = number(step, 'step', 'a positive number, s', lambda h: 0.0 < h < np.inf)
    span = float(motion.times[-1] - motion.times[0])
    intervals = span / longest
    if not math.isfinite(intervals):
        return longest  # which `ElasticFeedforward.along` refuses
    return span / max(math.ceil(intervals), 1)


def _with_settling(motion: SmoothMotion | Motion, robot: Robot) -> SmoothMotion | Motion:
    """Return a motion with a rest in which the deflections of damped drives settle."""
    if not isinstance(motion, Motion):
        instance(motion, SmoothMotion, 'motion')
    constants = [0.0]
    for elastic in robot.drives:
        stiffness = elastic.drive.stiffness
        if isinstance(stiffness, StiffnessCurve):
            stiffness = min(stiffness.slopes)
        # The deflection of a damped spring settles in the time D / k.
        constants.append(elastic.drive.damping / stiffness)
    if not (robot.friction and any(constants)):
        return motion
    if isinstance(motion, Motion):
        motion = SmoothMotion.from_motion(motion)
    return motion.with_rest(SETTLED * max(constants))
