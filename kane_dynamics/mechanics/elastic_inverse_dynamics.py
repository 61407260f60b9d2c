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
"""

from collections.abc import Sequence
from typing import NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.jet import derivative, moving_jets, series_of
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.elastic_joints import spring_deflection
from kane_dynamics.mechanics.friction import friction_torque
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.model.drive import Drive
from kane_dynamics.model.model import Joint, Model
import numpy as np

ORDER = 2  # of the jets


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


def elastic_inverse_dynamics(tree: TreeEquations, sides: Sequence[DriveSide], q: Vector,
                             rates: Matrix, wrenches: Matrix | None, gravity: Matrix,
                             payload: Vector) -> Matrix:
    """
    Return gear torques with two derivatives, motor motion and motor torques, (7, n).

    Parameters
    ----------
    tree : TreeEquations
        Of the links alone.
    sides : sequence of DriveSide
        The drives. Joints without one are rigid: their motor moves with the link.
    q : (n_q,) array of scalars
        Coordinates of the links, rad or m.
    rates : (4, n) array of scalars
        u, u', u'' and u''' of the links.
    wrenches : (3, k, 6) array of scalars, or None
        Wrenches at the declared frames, and their first and second time derivatives.
    gravity : (3, 3) array of scalars
        Gravity and its derivatives, as of a moving base; world axes.
    payload : array of scalars
        The run-time parameters behind gravity.

    Returns
    -------
    (7, n) array
        tau_J, tau_J', tau_J'', theta, theta', theta'', tau_m.

    """
    u = moving_jets(rates[0], rates[1], rates[2])
    udot = moving_jets(rates[1], rates[2], rates[3])
    q_jets = coordinate_jets(tree.model, q, u)
    parameters = np.concatenate([moving_jets(*gravity), payload])
    wrench_jets = None if wrenches is None else moving_jets(*wrenches)
    torques = tree.inverse_dynamics(q_jets, u, udot, wrench_jets, parameters)

    # Rigid joints: the motor moves with the link and has its torque.
    # The entries of ball joints, which have no position, are zero.
    positions: list[Scalar] = [0.0] * tree.n
    for k, place in enumerate(tree.model.places):
        if place is not None:
            positions[k] = q_jets[place]
    motor = list(positions)
    motor_torque = list(derivative(torques, 0))

    # Elastic joints: deflection and motor from the torque of the gear.
    for link, drive, joint in sides:
        theta = positions[link] + spring_deflection(drive, torques[link])
        motor[link] = theta
        motor_torque[link] = _motor_torque(drive, joint, theta, torques[link],
                                           friction=tree.friction)
    theta = np.array(motor, dtype=object)
    torque_rows = [derivative(torques, order) for order in range(ORDER + 1)]
    motor_rows = [derivative(theta, order) for order in range(ORDER + 1)]
    return np.stack([*torque_rows, *motor_rows, np.array(motor_torque, dtype=object)])


def _motor_torque(drive: Drive, joint: Joint, theta: Scalar, gear_torque: Scalar, *,
                  friction: bool) -> Scalar:
    """Return tau_m = B theta'' + tau_J + friction(theta'), N m or N."""
    _, rate, half_acceleration = series_of(theta, ORDER + 1)
    gear = series_of(gear_torque, ORDER + 1)[0]
    load = drive.rotor_inertia * (2.0 * half_acceleration) + gear
    if not friction:
        return load
    return load + friction_torque(joint, rate, load)


def coordinate_jets(model: Model, q: Vector, u: Vector) -> Vector:
    """Return q as jets, (n_q,), from the jets of the speeds u, (n,): q' = G(q) u."""
    rate = coordinate_rates(model, q, derivative(u, 0))
    # Each order of q' is known from one order less of q.
    first = moving_jets(q, rate)
    short = moving_jets(derivative(u, 0), derivative(u, 1))
    acceleration = derivative(coordinate_rates(model, first, short), 1)
    return moving_jets(q, rate, acceleration)
