"""
Computed torque of the links through the elasticity of their joints.

With the motors' positions theta and those of the links q, both on the joint's side, and
the independent speeds v of the links, whose rates of all joints are T v,

    M v' + h = T_A^T tau_J,    tau_J = k(theta - q_A) + D (theta' - q_A')
    B theta'' + friction(theta') + tau_J = tau_m

The state of links and motors determines v' by the first line, and v'' by its time
derivative, in which tau_J' = k' (theta' - q_A'). With as many drives A as independent
speeds, the second derivative of the first line yields the tau_J'' that gives the links a
wanted v''', hence theta'' and the torque of each motor (A. De Luca, Decoupling and feedback
linearization of robots with mixed rigid/elastic joints, Int. J. Robust Nonlinear Control 8,
1998). In a tree T is 1, and every joint has a drive.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from kane_dynamics._util.checks import finite_row, instance, number, per_joint
from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.control.elastic_control import DERIVATIVES, derivatives_of
from kane_dynamics.control.elastic_feedforward import ElasticFeedforward
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.jet import (derivative, Jet, moving, series_of,
                                                 value_of)
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints.mechanism import congruent, MotionSeries
from kane_dynamics.mechanics.elastic_inverse_dynamics import (drive_sides, DriveSide,
                                                              ElasticLinks)
from kane_dynamics.mechanics.elastic_joints import (damping_torque, spring_slope,
                                                    spring_torque)
from kane_dynamics.mechanics.friction import friction_torque
from kane_dynamics.model.elastic_model import link_side
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import require_smooth, SmoothMotion
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

BANDWIDTH = 30.0  # rad/s


class LinkSideControl:
    """
    Computed torque of the links through the elasticity (feedback linearization).

    From the state of links and motors follow acceleration and jerk of the links; the
    motor torque gives them the fourth derivative

        q'''' = q_d'''' + k_3 e''' + k_2 e'' + k_1 e' + k_0 e,    e = q_d - q

    so that every joint of the motion has four poles at -bandwidth: k = (w^4, 4 w^3, 6 w^2,
    4 w).

    Friction is that of the measured rates, which decides the acceleration. The law is as
    good as the model: friction that it lacks counts as an acceleration times k / M, so
    that stiff drives need exact friction and a fast cycle. `MotorSideControl` does not.

    Damping D of a drive acts in the law's acceleration, but not in its jerk: with it, the
    motor's acceleration changes the jerk at once, by D / k, and the exact law would
    divide by D. The errors this leaves are of the order w D / k.

    Parameters
    ----------
    robot : Robot
        With a drive at every joint; under constraints, with as many drives as independent
        speeds of the links, and no other actuators.
    motion : SmoothMotion or Motion
        Of the links, in their order; under constraints, of as many joints as independent
        speeds. As of `MotorSideControl`, its jerk must not jump.
    bandwidth : float or (p,) array_like
        w, rad/s, of each joint of the motion.

    Raises
    ------
    InputError
        As of `ElasticFeedforward`; rigid joints with actuators, beams, ball joints, more
        drives than independent speeds, a motion of other joints, or an invalid bandwidth.

    """

    def __init__(self, robot: Robot, motion: Motion | SmoothMotion, *,
                 bandwidth: ArrayLike = BANDWIDTH) -> None:
        """Check robot, motion and bandwidth, and compile the law."""
        feedforward = ElasticFeedforward(robot)
        _require_drives(feedforward)
        if not isinstance(motion, SmoothMotion):
            instance(motion, Motion, 'motion')
        require_angles(robot.model, 'motion')
        feedforward.check_joints(motion.joint_names)
        feedforward.warn_of_degrees(motion)
        if isinstance(motion, Motion):
            require_smooth(motion)
        self.robot = robot
        self.motion = motion
        joints = motion.joint_names
        w = per_joint(bandwidth, 'bandwidth', joints)
        self._bandwidth = w
        # (s + w)^4 of the error of each joint, for a chain of four integrators.
        with np.errstate(over='ignore'):
            self.gains = np.array([w**4, 4.0 * w**3, 6.0 * w**2, 4.0 * w])
        if not np.isfinite(self.gains).all():
            raise InputError(f'bandwidth: {w.max():g} rad/s; expected numbers whose fourth '
                             'power is finite')

        # Indices among the joints and coordinates of the robot; without ball joints they
        # are the same.
        names = robot.joint_names
        links = link_side(robot.model).joint_names
        self._links = list(map(names.index, links))
        self._joints = list(map(names.index, joints))
        self._motors = [elastic.motor for elastic in robot.drives]
        # Among the links: those of the motion, and those with drives.
        self._followed = list(map(links.index, joints))
        self._sides = drive_sides(robot.model, links)
        self._driven = [side.link for side in self._sides]
        count = len(joints)
        drives = len(self._sides)
        inputs = {'speeds': (count,), 'theta': (drives,), 'theta_rate': (drives,),
                  'desired': (DERIVATIVES, count), 'gains': (DERIVATIVES - 1, count)}
        self._law = feedforward.compiled(joints, self._traced, 'link_side_control', inputs,
                                         (drives,))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arguments; the law loads from the cache."""
        return partial(type(self), bandwidth=self._bandwidth), (self.robot, self.motion)

    def __call__(self, t: float, q: ArrayLike, u: ArrayLike) -> Array:
        """Return tau, (n,), at a time and a state of links and motors."""
        robot = self.robot
        t = number(t, 't', 'a finite number, s', np.isfinite)
        q = finite_row(q, 'q', robot.coordinate_names)
        u = finite_row(u, 'u', robot.speed_names, part='speed')
        rates = robot.joint_rates(q, u, t=t)
        desired = derivatives_of(self.motion, np.array([t]))[0]
        torques = np.zeros(robot.model.n)
        torques[self._motors] = self._law(
            q[self._links], rates[self._joints], q[self._motors], rates[self._motors],
            desired, self.gains, *robot.equations.time_inputs(t))
        return np.asarray(robot.generalized_force(torques, q, t=t))

    def _traced(self, links: ElasticLinks, state: dict[str, Any]) -> Vector:
        """Return the torques of the motors, (k,), over any scalar."""
        q, v, t = state['q'], state['speeds'], state['t']
        parameters = state['parameters']
        driven = self._driven
        still = np.zeros(len(v)).astype(object)

        # Torques of the gears in this state, and the rates of their springs.
        motion = links.motion(q, np.stack([v, still]), t)
        deflections = state['theta'] - motion.q[driven]
        rates = state['theta_rate'] - motion.qdot[driven]
        gear_torques = []
        spring_rates = []
        for side, deflection, rate in zip(self._sides, deflections, rates, strict=True):
            gear_torques.append(_gear_torque(links, side, deflection, rate))
            spring_rates.append(spring_slope(side.drive, deflection) * rate)
        of_gears = moving(gear_torques, spring_rates)

        # Acceleration of the links, then their jerk by the derivative of its equation.
        inertia = _Inertia(links, motion, parameters)
        missing = motion.T[driven].T @ gear_torques - _needed(links, motion, parameters)
        acceleration = inertia.solved(missing)
        motion = links.motion(q, np.stack([v, acceleration, still]), t)
        missing = motion.T[driven].T @ of_gears - _needed(links, motion, parameters)
        jerk = inertia.solved(derivative(missing, 1))

        # The fourth derivative, with the errors of the lower ones fed back.
        desired = state['desired']
        snap = desired[4]
        measured = q[self._followed], v, acceleration, jerk
        for gain, wanted, actual in zip(state['gains'], desired, measured):
            snap = snap + gain * (wanted - actual)

        # The second derivative of the gears' torques that it needs, and theta''.
        motion = links.motion(q, np.stack([v, acceleration, jerk, snap]), t)
        needed = links.actuator_torques(motion, _joint_forces(links, motion, parameters))
        second_rates = derivative(needed[driven], 2)
        torques = []
        for k, side in enumerate(self._sides):
            # k'' delta'^2 is the second derivative of the spring at delta'' = 0.
            moving_spring = spring_torque(side.drive, Jet((deflections[k], rates[k], 0.0)))
            curvature = 2.0 * series_of(moving_spring, 3)[2]
            change = (second_rates[k] - curvature) / spring_slope(side.drive, deflections[k])
            link_acceleration = value_of(motion.qddot[side.link])
            load = (side.drive.rotor_inertia * (link_acceleration + change)
                    + gear_torques[k])
            friction: Scalar = 0.0
            if links.tree.friction:
                friction = friction_torque(side.motor, state['theta_rate'][k], load)
            torques.append(load + friction)
        return np.array(torques)


class _Inertia:
    """The mass matrix of the independent speeds of the links, T^T M T, in factors."""

    def __init__(self, links: ElasticLinks, motion: MotionSeries,
                 parameters: Vector) -> None:
        M = links.tree.mass_matrix(motion.q, parameters)
        if motion.unit:
            self._order = links.tree.order
            self._factors = links.tree.factors(M)
        else:
            self._order = list(range(motion.T.shape[1]))
            self._factors = factorize(congruent(M, motion.T), self._order)

    def solved(self, force: Vector) -> Vector:
        """Return the accelerations by a generalized force, (p,)."""
        return solve(self._factors, self._order, force)


def _gear_torque(links: ElasticLinks, side: DriveSide, deflection: Scalar,
                 rate: Scalar) -> Scalar:
    """Return the torque that a drive transmits, tau_J = k(delta) + D delta'."""
    torque = spring_torque(side.drive, deflection)
    if not links.tree.friction:
        return torque
    return torque + damping_torque(side.drive, rate)


def _joint_forces(links: ElasticLinks, motion: MotionSeries, parameters: Vector) -> Vector:
    """Return the forces that the links need at their joints, with their friction, (n,)."""
    tree = links.tree
    rigid = tree.rigid_dynamics(motion.q, motion.qdot, motion.qddot, None, parameters)
    # Passive joints transmit no torque of an actuator, on which friction may depend.
    loads = links.actuator_torques(motion, rigid)
    return np.asarray(rigid + tree.friction_force(motion.qdot, loads))


def _needed(links: ElasticLinks, motion: MotionSeries, parameters: Vector) -> Vector:
    """Return the generalized force that the links need, (p,)."""
    return motion.projected(_joint_forces(links, motion, parameters))


def _require_drives(feedforward: ElasticFeedforward) -> None:
    """Raise InputError unless each independent speed of the links has a drive."""
    model = feedforward.robot.model
    if model.modal_coordinates:
        raise InputError('robot: with beams; expected rigid links, such as '
                         'stiffened(model), because no motor moves the coordinates '
                         'of bending')
    elastic = [drive.name for drive in model.drives]
    rigid = [name for name in feedforward.actuated_names if name not in elastic]
    if rigid:
        raise InputError(f'robot: rigid joints {rigid}; expected a drive at every '
                         'joint with an actuator, because the torque of a rigid one would '
                         'jump through the derivatives of the others')
    speeds = feedforward.speed_names
    if len(elastic) != len(speeds):
        raise InputError(f'robot: drives {listing(elastic)}; expected {len(speeds)}, as many '
                         f'as independent speeds of the links ({listing(speeds)}), because '
                         'the motion leaves open how further drives are preloaded')
