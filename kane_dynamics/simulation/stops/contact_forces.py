"""
The forces and the impulses of joint stops at states of a simulation.

At a state, the forces f of the stops at which joints rest and the accelerations a into
them solve the complementarity problem f >= 0, a <= 0, f . a = 0 of
`mechanics.joint_stops.stop_impulses`. At the end of a step past a stop, impulses end the
motion into it, and solve the same problem for speeds and for positions.

With constraints or chosen speeds both act in the space of the admissible motions: a
force or an impulse p of a stop at joint j, on side s, changes the independent speeds by
-M^-1 T_j^T s p.
"""

from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.ball_joints import angle_places, angles, on_unit_quaternions
from kane_dynamics.mechanics.constraints.row_units import coordinate_units, rate_of
from kane_dynamics.mechanics.integrators.held_joints import REGULAR
from kane_dynamics.mechanics.joint_stops import (ended_motion, nearest_stops,
                                                 stop_impulses, stopped_state)
from kane_dynamics.robot.robot import Robot
import numpy as np

TOUCHING = 1e-9  # rad, or lengths of the mechanism: distance of a joint at its stop
AT_REST = 3e-8  # rad, or lengths, in the time of the mechanism, with constraints
ROUNDING = 1e-11  # rad or lengths: past a stop, with constraints, after loops are closed
DRIVEN = 1e-6  # relative: speed into a stop that its impulse cannot end
ITERATIONS = 20  # of moving joints back and closing loops


def resting_sides(robot: Robot, q: Array, u: Array, lower: Array, upper: Array,
                  t: Any) -> Array:
    """
    Return the sides of the stops at which joints rest, of the shape of q; 0 of other joints.

    Parameters
    ----------
    robot : Robot
        Of any kind.
    q, u : (..., n_q), (..., n) arrays
        States of the robot; rad or m, and s.
    lower, upper : (n_q,) arrays
        The stops, rad or m; infinite where there is none.
    t : float or (K,) array
        The time, s.

    """
    # At the nearer stop, with a rate of zero: to rounding of the loops under
    # constraints.
    side, away = nearest_stops(q, lower, upper)
    if not robot.equations.in_joint_rates:
        units = coordinate_units(robot.model, robot.mechanism.constraints)
        near = TOUCHING * units
        slow = AT_REST * rate_of(robot.model, robot.mechanism.constraints) * units
    else:
        # Joints of trees rest at their stops exactly.
        near = np.zeros(robot.n_q)
        slow = near
    resting = (np.abs(away) <= near) & (np.abs(robot.joint_rates(q, u, t=t)) <= slow)
    sides: Array = side * resting
    return sides


def with_stop_forces(robot: Robot, q: Array, u: Array, udot: Array, lower: Array,
                     upper: Array, t: Array) -> tuple[Array, Array]:
    """
    Return the accelerations under the forces of the stops, and these forces.

    Parameters
    ----------
    robot : Robot
        Of any kind.
    q, u, udot : (K, n_q), (K, n), (K, n) arrays
        States, and the accelerations without the stops.
    lower, upper : (n_q,) arrays
        As in `resting_sides`.
    t : (K,) array
        The times, s.

    Returns
    -------
    udot : (K, n) array
    forces : (K, n_j) array
        Generalized forces of the stops on the joints, N m or N: positive at lower stops.

    """
    forces = np.zeros((len(q), robot.model.n))
    # Only rows in which a joint rests at a stop have a force.
    side = resting_sides(robot, q, u, lower, upper, t=t)
    rows = np.flatnonzero(side.any(axis=1))
    if not len(rows):
        return udot, forces
    udot = udot.copy()
    joints, places = np.array(angles(robot.model)), angle_places(robot.model)
    constrained = not robot.equations.in_joint_rates
    T, inverse = _speeds_of_joints(robot, q[rows], t[rows])
    accelerations = robot.joint_accelerations(q[rows], u[rows], udot[rows], t=t[rows])

    # The least forces s f >= 0 for which no pressed joint accelerates into its stop.
    for row, partial_rates, inverse_mass, qddot in zip(rows, T, inverse, accelerations):
        of_joints = side[row, places]
        held = np.flatnonzero(of_joints)
        s, pressed = of_joints[held], joints[held]
        # M^-1 T_s^T: the acceleration that unit forces cause, and from it their effect
        # on the joints.
        along = inverse_mass @ (s[:, None] * partial_rates[pressed]).T
        A = (s[:, None] * partial_rates[pressed]) @ along
        if constrained:  # may couple stops: then A is singular, and the stops share the force
            A = A + REGULAR * np.diag(A).max() * np.eye(len(A))
        force, _ = stop_impulses(s * qddot[pressed], A)
        udot[row] -= along @ force
        forces[row, pressed] = -s * force
    return udot, forces


def _speeds_of_joints(robot: Robot, q: Array, t: Array) -> tuple[Array, Array]:
    """Return T, (K, n_j, n), of the joints' speeds T u + X, and M^-1, (K, n, n)."""
    n, count = robot.n, len(q)
    inverse = robot.inverse_mass_matrix(q, t=t)
    if robot.equations.in_joint_rates:
        return np.broadcast_to(np.eye(n), (count, n, n)), inverse
    # At rest the accelerations of the joints are T udot, and those of moving
    # constraints.
    T = np.empty((count, robot.model.n, n))
    rest = np.zeros((count, n))
    of_constraints = robot.joint_accelerations(q, rest, rest, t=t)
    for k, unit in enumerate(np.eye(n)):
        total = robot.joint_accelerations(q, rest, np.tile(unit, (count, 1)), t=t)
        T[:, :, k] = total - of_constraints
    return T, inverse


def resolved_state(robot: Robot, state: Array, t: float, lower: Array, upper: Array,
                   held: Array,
                   force: Array | None, step: float) -> tuple[Array, Array]:
    """
    Return a state, (size,), after the impulses of the stops, and the speeds removed, (n_q,).

    Parameters
    ----------
    robot, state, t, lower, upper
        At the end of a step; s; the stops are rad or m.
    held : (n_q,) array
        The sides of the stops that held joints in this step, else 0.
    force : (n,) array or None
        The mean generalized force of these stops in the step, whose impulses act
        already; None if no stop held.
    step : float
        s.

    """
    n_q = robot.n_q
    n = robot.n
    constrained = not robot.equations.in_joint_rates
    q = state[:n_q].copy()
    u = state[n_q:n_q + n].copy()
    # Impulses that the forces in the step had on positions and on speeds.
    applied = np.zeros((2, n_q))
    if force is not None:
        places = np.flatnonzero(held)
        against: Any = -force
        if constrained:
            T, _, _ = _partial_rates(robot, q, t)
            against = np.linalg.lstsq(T[places].T, against)[0]
        else:
            against = against[places]
        applied[:, places] = np.maximum(0.0, held[places] * against)
        # Half of h^2 f on positions, h f on speeds.
        applied *= [[0.5 * step * step], [step]]
    # Positions back to the stops and rates into them ended; with constraints, by all
    # joints.
    if constrained:
        q, u, speeds = admissible_state(robot, q, u, t, lower, upper, applied)
    else:
        q, u, speeds = stopped_state(q, u, robot.inverse_mass_matrix(q), lower, upper,
                                     applied)
    resolved = state.copy()
    resolved[:n_q], resolved[n_q:n_q + n] = q, u
    return resolved, speeds


def admissible_state(robot: Robot, q: Array, u: Array, t: float, lower: Array,
                     upper: Array,
                     applied: Array) -> tuple[Array, Array, Array]:
    """
    Return q and u after the impulses of the stops, and the speeds removed, (n_q,).

    The impulses that move joints back solve the complementarity problem of
    `stop_impulses`: of stops that act on the same motion, those that would pull have
    none. Loops are not linear, so the problem is linearized again where its solution
    leads, until no joint is past its stop. `applied` are the impulses that act already,
    as of `stopped_state`.

    Raises
    ------
    ConstraintError
        The constraints drive a joint into its stop.

    """
    units = coordinate_units(robot.model, robot.mechanism.constraints)
    rounding = ROUNDING * units
    # Positions: iterate until every joint is between its stops, and at those that moved
    # it.
    moved = applied[0].copy()  # by the impulse of each stop so far
    for _ in range(ITERATIONS):
        T, X, inverse = _partial_rates(robot, q, t)
        side, away = nearest_stops(q, lower, upper)
        acting = np.flatnonzero(moved)
        at_stops = np.abs(away[acting]) <= rounding[acting]
        if not (side * away > rounding).any() and at_stops.all():
            break
        stops = np.flatnonzero(side)
        s, along, A = _response(side, stops, T, inverse)
        p = stop_impulses(s * away[stops] + A @ moved[stops], A)[0]
        q = _closed(robot, q - T @ (along @ (p - moved[stops])), t)
        moved[stops] = p
    else:
        raise _driven(robot, q, side * away, t)
    # Speeds: the stops that joints touch, and those that held them in the step.
    side = side * ((np.abs(away) < TOUCHING * units) | (applied[1] > 0.0))
    qdot, stops = T @ u + X, np.flatnonzero(side)
    s, along, A = _response(side, stops, T, inverse)
    p = stop_impulses(s * qdot[stops] + A @ applied[1, stops], A)[0]
    u = u - along @ (p - applied[1, stops])
    into = side * (T @ u + X)
    fastest = np.abs(qdot / units).max(initial=1e-6)
    if (into / units > DRIVEN * fastest).any():
        raise _driven(robot, q, into, t)
    ended = np.zeros(robot.n_q)
    ended[stops] = ended_motion(s * qdot[stops], A, p)
    return q, u, ended


def _partial_rates(robot: Robot, q: Array, t: float) -> tuple[Array, Array, Array]:
    """Return T (n_q, n), X (n_q,) of q' = T u + X, and M^-1 (n, n)."""
    n = robot.n
    rows = np.concatenate([np.zeros((1, n)), np.eye(n)])
    rates = robot.joint_rates(np.tile(q, (n + 1, 1)), rows, t=t)
    return (rates[1:] - rates[0]).T, rates[0], robot.inverse_mass_matrix(q, t=t)


def _closed(robot: Robot, q: Array, t: float) -> Array:
    """Return q on unit quaternions after two Newton steps on the loops."""
    equations: Any = robot.equations
    # Without closed loops only the quaternions have a length to keep.
    if not equations.keeps_positions(q, t):
        return np.asarray(on_unit_quaternions(robot.model, q))
    kernel = robot.compiled(lambda q, t: equations.closure_step(q, t),
                            name='closure_step',
                            q=(robot.n_q,), t=(), shape=(robot.n_q,))
    # Newton's method converges quadratically: two steps reach rounding from a step's
    # drift.
    result: Array = on_unit_quaternions(robot.model, kernel(kernel(q, t), t))
    return result


def _driven(robot: Robot, q: Array, into: Array, t: float) -> ConstraintError:
    """Return the error for a joint that the constraints drive into its stop."""
    name = robot.coordinate_names[int(np.argmax(into))]
    return ConstraintError(f"{t:.6g} s: joint '{name}' is at its stop, and the "
                           'constraints drive it on; expected a motion between the '
                           'stops')


def _response(side: Array,
              joints: Any, T: Array, inverse: Array) -> tuple[Array, Array, Array]:
    """
    Return the response to impulses of the stops of k joints, by their numbers.

    It is their sides (k,), the changes of the independent speeds (n, k), and the motion
    away from each stop (k, k), regular where the constraints couple stops.
    """
    s = side[joints]
    along = inverse @ (T[joints] * s[:, None]).T
    A = s[:, None] * T[joints] @ along
    regular = REGULAR * np.diag(A).max(initial=0.0) or 1.0
    return s, along, A + regular * np.eye(len(A))
