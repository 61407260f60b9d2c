"""
Inverse dynamics of elastic joints: motor torques of a motion of the links.

The gear torque tau_J is that of inverse dynamics of the links. With a spring k alone
between motor and link, the motor's position and torque follow from tau_J and two of its
time derivatives, hence from four of q (A. De Luca, Decoupling and feedback linearization
of robots with mixed rigid/elastic joints, Int. J. Robust Nonlinear Control 8, 1998):

    theta = q + k^-1(tau_J),    tau_m = B theta'' + tau_J + friction(theta')

RNEA runs once, on jets (`algebra.jet`) of order two: with q, q', q'' as a jet of q, q',
q'', q''' as one of u, and q'', q''', q'''' as one of udot, it yields tau_J, tau_J',
tau_J''. The inverse of a stiffness curve yields its derivatives in the same manner.

Under constraints or with chosen speeds, the motion of all joints follows from that of
the independent speeds as a power series (`Mechanism.motion_series`). The joint forces are
projected on these speeds by Kane's method, T^T f, and the torques of the gears have the
same generalized forces, T_A^T tau_J = T^T f, all of it on jets.
"""

from collections.abc import Mapping, Sequence
import math
from typing import NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.jet import derivative, Jet, moving, series_of
from kane_dynamics.mechanics.constraints.conditioning import guarded, margin
from kane_dynamics.mechanics.constraints.mechanism import Mechanism, MotionSeries
from kane_dynamics.mechanics.constraints.transmission import (least_torques,
                                                              transmission_margin)
from kane_dynamics.mechanics.elastic_joints import spring_deflection, spring_torque
from kane_dynamics.mechanics.friction import feedforward_direction, friction_torque
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.model.drive import Drive
from kane_dynamics.model.model import Joint, Model
import numpy as np

ORDER = 2  # of the jets
NEWTON_STEPS = 4  # for a curve; the first one is exact for a constant stiffness


class DriveSide(NamedTuple):
    """Drive of a joint: index of the link among the links, and the motor's joint."""

    link: int
    drive: Drive
    motor: Joint


def drive_sides(model: Model, names: Sequence[str]) -> list[DriveSide]:
    """Return the drives of a model whose links have these names, in order."""
    joints = {body.joint.name: body.joint for body in model.bodies}
    sides = []
    for name, drive, _, _ in model.drives:
        sides.append(DriveSide(names.index(name), drive, joints[drive.motor]))
    return sides


class ElasticLinks:
    """
    The links of a mechanism with elastic joints, without their motors.

    Their motion does not depend on the motors, which rest at 0 in the mechanism here.

    Parameters
    ----------
    tree : TreeEquations
        Of the links alone.
    sides : sequence of DriveSide
        The drives. Joints without one are rigid: their motor moves with the link.
    mechanism : Mechanism
        Speeds and constraints, of links and motors.
    geometry : sequence of Link
        The compiled links of that model.
    speeds : sequence of int
        Indices of the independent speeds that are those of links.
    actuators : mapping of int to float, optional
        Weights of the torques of the joints with actuators, by their index among the
        links. Under constraints the torques are those with the least sum of weight times
        torque squared. Default: of a tree, each joint's own.

    """

    def __init__(self, tree: TreeEquations, sides: Sequence[DriveSide],
                 mechanism: Mechanism, geometry: Sequence[Link] = (),
                 speeds: Sequence[int] = (),
                 actuators: Mapping[int, float] | None = None) -> None:
        """Store the parts and find the links among all coordinates."""
        self.tree = tree
        self.sides = list(sides)
        self.geometry = geometry
        self.speeds = list(speeds)
        # A tree needs the mechanism of the links alone: its motors move nothing. Speeds
        # in another order than the links need the general one.
        in_order = self.speeds == sorted(self.speeds)
        self.is_tree = mechanism.in_joint_speeds and in_order
        self.mechanism = mechanism
        if self.is_tree:
            self.mechanism = Mechanism(tree.model)

        # Indices of the links' joints and coordinates among those of links and motors.
        model = mechanism.model
        self.joints = list(map(model.joint_names.index, tree.model.joint_names))
        self.places = list(map(model.coordinate_names.index, tree.model.coordinate_names))

        # Actuators, where constraints let them share the load.
        self.actuated: list[int] | None = None
        self.inverse_weights = np.ones(0)
        if actuators is not None:
            self.actuated = list(actuators)
            self.inverse_weights = 1.0 / np.array(list(actuators.values()))

    def whole(self, q: Vector) -> Vector:
        """Return the coordinates of links and motors, with the motors at 0."""
        result = np.zeros(len(self.mechanism.model.coordinate_names)).astype(object)
        result[self.places] = q
        return result

    def motion(self, q: Vector, rates: Matrix, t: Scalar) -> MotionSeries:
        """Return the motion of the links for their speeds u, u', u'', u''', (4, n)."""
        mechanism = self.mechanism
        if self.is_tree:
            return mechanism.motion_series(q, rates)
        # Motors rest in this mechanism: only the speeds of links move.
        all_rates = np.zeros((len(rates), mechanism.n)).astype(object)
        all_rates[:, self.speeds] = rates
        series = mechanism.motion_series(self.whole(q), all_rates, t, self.geometry)
        return MotionSeries(series.q[self.places], series.qdot[self.joints],
                            series.qddot[self.joints],
                            series.T[np.ix_(self.joints, self.speeds)], False)

    def actuator_torques(self, motion: MotionSeries, joint_forces: Vector) -> Vector:
        """Return the torques of actuators for the joint forces of a motion, (n,)."""
        if self.actuated is None:
            return joint_forces
        # The torques with the generalized force T^T f and the least weighted squares.
        torques = np.zeros(self.tree.n).astype(object)
        torques[self.actuated] = least_torques(
            motion.T[self.actuated], self.inverse_weights,
            motion.projected(joint_forces))
        return torques

    @property
    def determining(self) -> list[int]:
        """Return the joints of links and motors that have actuators."""
        motors = [elastic.motor for elastic in self.mechanism.model.drives]
        return [*[self.joints[k] for k in self.actuated or ()], *motors]

    def watched(self, rows: Matrix, q: Vector, t: Scalar, limits: Vector) -> Matrix:
        """Return rows, as NaN where loops are open, or the state is almost singular."""
        mechanism = self.mechanism
        whole = self.whole(q)
        rows = guarded(rows, margin(mechanism, whole, t, limits, self.geometry))
        S, _ = mechanism.system(mechanism.state(whole, t, self.geometry))
        T = mechanism.solved(S, np.eye(len(S)))[:, :mechanism.n]
        return guarded(rows, transmission_margin(mechanism, T, self.determining))


def elastic_inverse_dynamics(links: ElasticLinks, q: Vector, rates: Matrix,
                             wrenches: Matrix | None, gravity: Matrix, payload: Vector,
                             t: Scalar = 0.0) -> Matrix:
    """
    Return gear torques with two derivatives, motor motion and motor torques, (7, n).

    Parameters
    ----------
    links : ElasticLinks
        Motion, joint forces and drives.
    q : (n_q,) array of scalars
        Coordinates of the links, rad or m.
    rates : (4, p) array of scalars
        Independent speeds of the links u, u', u'' and u'''.
    wrenches : (3, k, 6) array of scalars, or None
        Wrenches at the declared frames, and their first and second time derivatives.
    gravity : (3, 3) array of scalars
        Gravity and its derivatives, as of a moving base; world axes.
    payload : array of scalars
        The run-time parameters behind gravity.
    t : scalar
        Time, s.

    Returns
    -------
    (7, n) array
        tau_J, tau_J', tau_J'', theta, theta', theta'', tau_m.

    """
    tree = links.tree
    motion = links.motion(q, rates, t)
    parameters = np.concatenate([moving(*gravity), payload])
    wrench_jets = None if wrenches is None else moving(*wrenches)
    rigid = tree.rigid_dynamics(motion.q, motion.qdot, motion.qddot, wrench_jets,
                                parameters)
    # Friction may depend on what the actuators transmit.
    loads = links.actuator_torques(motion, rigid)
    friction = tree.feedforward_friction(motion.qdot, motion.qddot, loads)
    torques = links.actuator_torques(motion, rigid + friction)

    # Rigid joints: the motor moves with the link and has its torque. The positions of
    # ball joints, which are quaternions, are zero here.
    positions: list[Scalar] = [0.0] * tree.n
    for k, place in enumerate(tree.model.places):
        if place is not None:
            positions[k] = motion.q[place]
    motor = list(positions)
    motor_torque = list(derivative(torques, 0))

    # Elastic joints: deflection and motor from the torque of the gear.
    for link, drive, joint in links.sides:
        theta = positions[link] + spring_deflection(drive, torques[link])
        motor[link] = theta
        _, speed, half_acceleration = series_of(theta, ORDER + 1)
        gear = series_of(torques[link], ORDER + 1)[0]
        acceleration = 2.0 * half_acceleration
        load = drive.rotor_inertia * acceleration + gear
        motor_torque[link] = torque_of_motor(tree, joint, (speed, acceleration), load)
    theta = np.array(motor, dtype=object)
    torque_rows = [derivative(torques, order) for order in range(ORDER + 1)]
    motor_rows = [derivative(theta, order) for order in range(ORDER + 1)]
    return np.stack([*torque_rows, *motor_rows, np.array(motor_torque, dtype=object)])


def damped_step(tree: TreeEquations, sides: Sequence[DriveSide], before: Matrix,
                link_before: Vector, rows: Matrix, link: Vector, h: Scalar) -> Matrix:
    """
    Return the rows after a step along a motion, with damped drives, (7, n).

    The deflection of a damped drive is a state, D delta' = tau_J - k(delta). One step is
    the Pade approximation (2, 3) of the exponential, with derivatives of both ends:

        delta_1 - 3/5 h delta_1' + 3/20 h^2 delta_1'' - 1/60 h^3 delta_1'''
            = delta_0 + 2/5 h delta_0' + 1/20 h^2 delta_0''

    It is of order five and L-stable, so that D / k may be far shorter than the step.

    Parameters
    ----------
    tree : TreeEquations
        Of the links alone.
    sides : sequence of DriveSide
        The damped drives.
    before, rows : (7, n) arrays of scalars
        Rows at the beginning, complete, and at the end, with those of other joints.
    link_before, link : (3, n) array of scalars
        Position, speed and acceleration of the links at the beginning and the end.
    h : scalar
        The step, s.

    """
    result = rows.copy()
    for k, drive, joint in sides:
        # The beginning: its deflection and two derivatives are those of the rows.
        delta_0 = before[3:6, k] - link_before[:, k]
        known = delta_0[0] + h * (0.4 * delta_0[1] + 0.05 * h * delta_0[2])

        # The end, by Newton's method; its derivative is that of the same function.
        torque = rows[:3, k]
        delta = _stiff_start(drive, known, torque[0], h)
        for _ in range(NEWTON_STEPS):
            residual = _pade_residual(drive, Jet((delta, 1.0)), torque, h)
            value, slope = series_of(residual, 2)
            delta = delta - (value - known) / slope
        _, rate, acceleration, _ = deflection_rates(drive, delta, torque)
        result[3:6, k] = link[:, k] + np.array([delta, rate, acceleration], dtype=object)
        load = drive.rotor_inertia * result[5, k] + result[0, k]
        result[6, k] = torque_of_motor(tree, joint, (result[4, k], result[5, k]), load)
    return result


def deflection_rates(drive: Drive, delta: Scalar, torque: Vector) -> list[Scalar]:
    """
    Return the deflection of a damped drive with three time derivatives.

    `torque`, (3,), are tau_J, tau_J' and tau_J''. Each derivative of D delta' = tau_J -
    k(delta) needs one less of delta.
    """
    series = [delta]
    for order in range(ORDER + 1):
        # The coefficients known so far, as a jet, give that of k of this order.
        spring = spring_torque(drive, Jet(series) if order else delta)
        if order:
            spring = series_of(spring, order + 1)[order]
        coefficient = torque[order] * (1.0 / math.factorial(order)) - spring
        series.append(coefficient * (1.0 / (drive.damping * (order + 1))))
    return [x * float(math.factorial(k)) for k, x in enumerate(series)]


def torque_of_motor(tree: TreeEquations, joint: Joint, motion: tuple[Scalar, Scalar],
                    load: Scalar) -> Scalar:
    """
    Return the torque of a motor for a load B theta'' + tau_J: with its friction, N m.

    `motion` is theta' and theta''; at rest and at reversals friction is that of the
    choice of the links' equations, `feedforward_friction`.
    """
    if not tree.friction:
        return load
    y = feedforward_direction(joint, *motion, tree.feedforward_choice)
    return load + friction_torque(joint, motion[0], load, y)


def _pade_residual(drive: Drive, delta: Scalar, torque: Vector, h: Scalar) -> Scalar:
    """Return the left side of the step's equation at its end."""
    value, first, second, third = deflection_rates(drive, delta, torque)
    return value - h * (0.6 * first - h * (0.15 * second - (h / 60.0) * third))


def _stiff_start(drive: Drive, known: Scalar, torque: Scalar, h: Scalar) -> Scalar:
    """Return the end of an implicit Euler step of the linear drive, to begin with."""
    stiffness = drive.stiffness_at_rest
    return (drive.damping * known + h * torque) / (drive.damping + h * stiffness)
