"""
Motor-side control of arms with elastic joints: feedforward and PD of the motors.

With the motor's position theta and the link's q on the joint's side, delta = theta - q,

    M(q) q'' + h(q, q') = tau_J,    tau_J = k(delta) + D delta'
    B theta'' + friction(theta') + tau_J = tau_m

A motion q(t) of the links has one motion of the motors and one motor torque: the gear's
torque is the inverse dynamics of the links, which determines the deflection, and with two
time derivatives more also theta' and theta'' (A. De Luca, Decoupling and feedback
linearization of robots with mixed rigid/elastic joints, Int. J. Robust Nonlinear Control
8, 1998). So the motor torque depends on four derivatives of q.

The law is a function over any scalar; derivatives along the motion are those of jets.
Vectors of joints are in the order of the link coordinates; tau has the entries of links
and motors, as in `Robot`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from kane_dynamics._util.checks import constant, instance, per_joint
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.control.trajectory_feedforward import (FilledTrajectory, MOST_POINTS,
                                                          PROBES)
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.jet import Jet, moving, series_of, value_of
from kane_dynamics.mechanics.elastic_inverse_dynamics import (drive_sides,
                                                              DriveSide,
                                                              elastic_inverse_dynamics,
                                                              ElasticLinks,
                                                              torque_of_motor)
from kane_dynamics.mechanics.elastic_joints import spring_deflection
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.model.drive import StiffnessCurve
from kane_dynamics.model.elastic_model import link_side
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import require_smooth, SmoothMotion
from kane_dynamics.robot.methods.configuration_methods import warn_of_degrees
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

DERIVATIVES = 5  # of a motion: position to snap
COMMAND = 5  # rows of a command: theta, theta', theta'', tau_m, tau_J
MOTOR, LINK = 'motor', 'link'  # sides of the gear on which positions are measured


class MotorCommand(NamedTuple):
    """
    Motion and torques of the motors along a motion of the links, joint-side, (K, n) each.

    Attributes
    ----------
    positions, velocities, accelerations : arrays
        Of the motors divided by their ratio, rad or m, and s; of a rigid joint, its own.
    torques : arrays
        Of the motors times their ratio, N m or N.
    gear_torques : arrays
        That the gears transmit to the links, N m or N.

    """

    positions: Array
    velocities: Array
    accelerations: Array
    torques: Array
    gear_torques: Array


class ElasticArm:
    """
    The equations of an arm with elastic joints as control needs them, over any scalar.

    Parameters
    ----------
    robot : Robot
        With drives (`with_drives`), without constraints, chosen speeds, ball joints and
        beams.

    Attributes
    ----------
    names : tuple of str
        The n joints of the links; everything of joints is in their order.
    tree : TreeEquations
        Of the links alone.
    links, motors : list of int
        Indices of the links in q and tau, and of the motor of each; of a rigid joint,
        its own.

    Raises
    ------
    InputError
        No such robot; or a drive with the rotor's full coupling, with which the links
        feel the motors' accelerations and no feedforward in closed form exists.

    """

    def __init__(self, robot: Robot) -> None:
        """Check the robot and collect the indices."""
        instance(robot, Robot, 'robot')
        model = robot.model
        if not model.drives:
            raise InputError('robot: with rigid joints; expected one with elastic '
                             'joints, from with_drives')
        if not robot.equations.in_joint_rates:
            raise InputError('robot: with constraints, chosen speeds or ball joints; '
                             'expected a tree in joint rates')
        if model.modal_coordinates:
            raise InputError('robot: with beams; expected rigid links, such as '
                             'stiffened(model), because no motor moves the coordinates '
                             'of bending')
        # The links alone, in their own order, with the robot's friction and payload.
        self.robot = robot
        self.n = robot.n
        links = link_side(model)
        self.names = links.joint_names
        self.n_links = len(self.names)
        options = robot.options
        self.tree = TreeEquations(links, payload_frame=options['payload_frame'],
                                  friction=robot.friction,
                                  feedforward_friction=options['feedforward_friction'])
        self.sides = drive_sides(model, self.names)
        self.elastic_links = ElasticLinks(self.tree, self.sides, robot.mechanism)
        for name, drive, _, _ in model.drives:
            if drive.full_coupling:
                raise InputError(f"joint '{name}': a drive with full_coupling; expected "
                                 "Spong's reduced model")
        # By the links' order: the drive of each joint, if it has one, and its indices.
        self.drives: dict[int, DriveSide] = {side.link: side for side in self.sides}
        joint_names = list(model.joint_names)
        self.links = list(map(joint_names.index, self.names))
        self.motors = list(self.links)
        for side in self.sides:
            self.motors[side.link] = joint_names.index(side.motor.name)

    def require_deflections(self) -> None:
        """Raise InputError if a torque does not determine the deflection of a drive."""
        for side in self.sides:
            curve = side.drive.stiffness
            if isinstance(curve, StiffnessCurve) and curve.dead_zone:
                raise InputError(f"motor '{side.motor.name}': a dead zone of "
                                 f'{curve.dead_zone:g} in its stiffness curve; expected '
                                 'a curve without one, because within it the '
                                 'torque 0 leaves the deflection open')

    def in_tau(self, torques: Vector) -> Vector:
        """Return tau, (n_tau,), with torques of the motors or rigid joints, (n,)."""
        tau = np.zeros(self.n).astype(object)
        tau[self.motors] = torques
        return tau

    def motor_command(self, motion: Matrix, parameters: Vector) -> Matrix:
        """Return the rows of `MotorCommand`, (5, n), for q to its fourth derivative, (5, n)."""
        # Gravity of a base at rest, with derivatives of zero.
        gravity = np.concatenate([parameters[:3][None], np.zeros((2, 3)).astype(object)])
        rows = elastic_inverse_dynamics(self.elastic_links, motion[0], motion[1:], None,
                                        gravity, parameters[3:])
        command = np.concatenate([rows[3:], rows[:1]])
        # With damping, the spring lags: its rate is part of the torque.
        for side in self.sides:
            if side.drive.damping and self.robot.friction:
                torque = moving(*rows[:3, [side.link]])[0]
                command[:, side.link] = self._damped_command(side, motion, torque)
        return command

    def _damped_command(self, side: DriveSide, motion: Matrix, torque: Scalar) -> Vector:
        """
        Return the rows of `MotorCommand` of one drive with damping, (5,).

        D delta' is subtracted from the torque, with delta' of the spring alone: position
        and rate are right to the first order of the drive's time constant D / k. In the
        acceleration, D / k times the third derivative is left out, which would need the
        fifth one of the motion.
        """
        drive = side.drive
        of_spring = series_of(spring_deflection(drive, torque), 3)
        rate = Jet((of_spring[1], 2.0 * of_spring[2], 0.0))
        deflection = spring_deflection(drive, torque - drive.damping * rate)
        position, speed, half_acceleration = series_of(deflection, 3)
        # The motor's motion is the link's and the deflection's.
        link = motion[:, side.link]
        theta = [link[0] + position, link[1] + speed, link[2] + 2.0 * half_acceleration]
        gear_torque = value_of(torque)
        load = drive.rotor_inertia * theta[2] + gear_torque
        motor = torque_of_motor(self.tree, side.motor, (theta[1], theta[2]), load)
        return np.array([*theta, motor, gear_torque])

    def motor_side_torque(self, q: Vector, u: Vector, desired: Matrix, kp: Vector,
                          kd: Vector, parameters: Vector) -> Vector:
        """Return tau, (n_tau,), of the feedforward and PD on the motors."""
        return self.in_tau(self.feedback_of_motors(
            q[self.motors], u[self.motors], desired, desired, kp, kd,
            parameters=parameters))

    def feedback_of_motors(self, measured: Vector, rates: Vector, desired: Matrix,
                           ahead: Matrix, kp: Vector, kd: Vector, *, parameters: Vector
                           ) -> Vector:
        """
        Return torques of motors, (n,): feedforward and PD on measured motors.

        `desired`, (5, n), is the motion at the state; the feedforward is that at `ahead`.
        """
        theta, theta_rate, _, _, _ = self.motor_command(desired, parameters)
        torque = self.motor_command(ahead, parameters)[3]
        return torque + kp * (theta - measured) + kd * (theta_rate - rates)

    def feedback_of_links(self, measured: Vector, rates: Vector, desired: Matrix,
                          ahead: Matrix, kp: Vector, kd: Vector, *, parameters: Vector
                          ) -> Vector:
        """Return torques of motors, (n,): feedforward and PD on measured links."""
        torque = self.motor_command(ahead, parameters)[3]
        return torque + kp * (desired[0] - measured) + kd * (desired[1] - rates)


def warn_of_degrees_of_links(arm: ElasticArm, motion: Motion | SmoothMotion,
                             stacklevel: int = 4) -> None:
    """Warn if the points of a motion of the links look like degrees."""
    positions = motion.sample(motion.times)[0]
    rows = np.zeros((len(positions), arm.robot.n_q))
    rows[:, arm.links] = positions
    warn_of_degrees(arm.robot, rows, 'motion', stacklevel)


class MotorSideControl:
    """
    PD of the motors added to the elastic feedforward: the passive law.

    tau_m = tau_m,d + kp (theta_d - theta) + kd (theta'_d - theta')

    It needs no sensor of the links. Spring and damper between the motor and its desired
    position cannot feed energy into the arm, whatever the model's errors (P. Tomei, A
    simple PD controller for robots with elastic joints, IEEE Trans. Autom. Control 36,
    1991).

    Parameters
    ----------
    robot : Robot
        With elastic joints, all or some.
    motion : SmoothMotion or Motion
        Of the links, in their order; the torques jump where its fourth derivative does. A
        Motion through dense points, with accelerations, of one that is smooth: its jerk
        may jump by a tenth of its largest value.
    kp, kd : float or (n,) array_like
        N m/rad and N m s/rad, joint-side.

    Raises
    ------
    InputError
        The robot has no elastic joints; it has constraints, chosen speeds, ball joints,
        beams, or drives with `full_coupling` or a dead zone; the motion is of other
        joints, or not smooth; or a gain is invalid.

    """

    def __init__(self, robot: Robot, motion: Motion | SmoothMotion, *, kp: ArrayLike,
                 kd: ArrayLike) -> None:
        """Check motion and gains, and compile the law."""
        self.arm = ElasticArm(robot)
        self.robot = robot
        self.arm.require_deflections()
        if not isinstance(motion, SmoothMotion):
            instance(motion, Motion, 'motion')
        # Elastic arms follow a motion of their links; the motors' motion is computed.
        names = self.arm.names
        if motion.joint_names != names:
            raise InputError(f'motion: of the joints {list(motion.joint_names)}; '
                             f'expected {list(names)}, those of the links')
        warn_of_degrees_of_links(self.arm, motion)
        if isinstance(motion, Motion):
            require_smooth(motion)
        self.motion = motion
        self.kp = per_joint(kp, 'kp', names)
        self.kd = per_joint(kd, 'kd', names)
        # Desired motion and gains are arguments, so that they change without a new
        # kernel.
        n = len(names)
        self._law = robot.compiled(self.arm.motor_side_torque, name='motor_side_torque',
                                   q=(robot.n,), u=(robot.n,), desired=(DERIVATIVES, n),
                                   kp=(n,), kd=(n,), shape=(robot.n,))
        self._command = robot.compiled(self.arm.motor_command, name='elastic_command',
                                       motion=(DERIVATIVES, n), shape=(COMMAND, n))

    def command(self, times: ArrayLike) -> MotorCommand:
        """
        Return the desired motion and torques of the motors, for drives that close the loop.

        Parameters
        ----------
        times : (K,) array_like
            s from the start of the motion. Of a torque that is held for a cycle, the
            middle of the cycle is best: the beginning is late by half a cycle.

        """
        t = constant(times, np.shape(times), 'times', InputError)
        if t.ndim != 1:
            raise InputError(f'times: shape {t.shape}; expected one axis of times in s')
        rows = self._command(derivatives_of(self.motion, t))
        return MotorCommand(*np.moveaxis(np.asarray(rows), 1, 0).copy())

    def trajectory(self, tolerance: ArrayLike, *, sensor_side: str = MOTOR,
                   max_points: int = MOST_POINTS) -> FilledTrajectory:
        """
        Return the motion as a trajectory for joint_trajectory_controller.

        Its positions are those that the controller measures, of the motors or of the
        links; its efforts are the motors' torques. The controller moves between the points
        by quintics and interpolates efforts linearly.

        Parameters
        ----------
        tolerance : float or (n,) array_like
            Largest error of the interpolated effort, N m or N, positive: points are
            inserted between those of the motion where it is larger, at seven times
            between each two points.
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
        allowed = effort_tolerance(tolerance, self.arm.names)
        times = self.motion.times.copy()
        count = len(times)
        while True:
            torques = self.command(times).torques
            # Between the points, the torques that act and those that are needed.
            between = times[:-1, None] + PROBES * np.diff(times)[:, None]
            needed = self.command(between.ravel()).torques
            needed = needed.reshape(*between.shape, -1)
            shares = PROBES[:, None]
            acting = (1.0 - shares) * torques[:-1, None] + shares * torques[1:, None]
            errors = np.abs(needed - acting).max(axis=1)
            wrong = (errors > allowed).any(axis=1)
            # Bisect the intervals in which the interpolated torque is too far away.
            if not wrong.any():
                break
            times = np.sort(np.append(times, 0.5 * (times[:-1] + times[1:])[wrong]))
            if len(times) > max_points:
                raise InputError(f'tolerance: {allowed.tolist()} needs more than '
                                 f'{max_points} points; expected a larger one, or a '
                                 'motion whose fourth derivative does not jump')
        command = self.command(times)
        measured = command.positions, command.velocities, command.accelerations
        if sensor_side == LINK:
            measured = self.motion.sample(times)[:3]
        # At its end the motion rests, and the controller holds the last effort.
        return FilledTrajectory(self.arm.names, times, *measured, command.torques,
                                len(times) - count, errors.max(axis=0, initial=0.0))

    def __call__(self, t: float, q: ArrayLike, u: ArrayLike) -> Array:
        """Return tau, (n_tau,), at a time and a state of links and motors."""
        desired = derivatives_of(self.motion, np.array([t]))[0]
        return np.asarray(self._law(q, u, desired, self.kp, self.kd))


def check_side(sensor_side: str) -> None:
    """Raise InputError for what is no side of a gear."""
    if sensor_side not in (MOTOR, LINK):
        raise InputError(f"sensor_side: {sensor_side!r}; expected '{MOTOR}' or '{LINK}'")


def effort_tolerance(tolerance: ArrayLike, joints: Sequence[str]) -> Array:
    """Return the checked largest error of the effort of each joint, (n,), N m or N."""
    allowed = per_joint(tolerance, 'tolerance', joints)
    if not (allowed > 0.0).all():
        raise InputError(f'tolerance: {allowed.tolist()}; expected positive numbers')
    return allowed


def derivatives_of(motion: Motion | SmoothMotion, t: Array) -> Array:
    """Return a motion and its first four derivatives at times (K,), (K, 5, n)."""
    if isinstance(motion, SmoothMotion):
        return np.stack(motion.sample(t), axis=1)
    n = motion.n
    # Before its begin and after its end a motion rests: all derivatives vanish.
    result = np.zeros((len(t), DERIVATIVES, n))
    q, u, udot = motion.sample(t)
    result[:, 0] = q
    result[:, 1] = u
    result[:, 2] = udot
    if len(motion.times) < 2:
        return result
    inside = (t >= motion.times[0]) & (t < motion.times[-1])
    k = np.searchsorted(motion.times, t[inside], side='right') - 1
    length = np.diff(motion.times)[k]
    x = ((t[inside] - motion.times[k]) / length)[:, None]
    # Derivatives of the segment's polynomial in x = (t - t_k) / length.
    c = motion.coefficients[k]
    jerk = 6.0 * c[:, 3] + x * (24.0 * c[:, 4] + x * (60.0 * c[:, 5]))
    snap = 24.0 * c[:, 4] + x * (120.0 * c[:, 5])
    result[inside, 3] = jerk / length[:, None]**3
    result[inside, 4] = snap / length[:, None]**4
    return result
