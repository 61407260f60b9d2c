"""
Every field of a `Trajectory` against an evaluation at the same states by the definition.

The balance of forces of all joints, by Kane's definition of a tree, holds accelerations,
torques, forces of constraints and of stops to each other. It uses all rows of the
constraints and neither the choice of independent speeds nor that of rows. With exact
friction, what is missing in the balance of a joint is its friction, which the set-valued
law bounds.
"""


import energies
from kane_dynamics.mechanics.algebra.jet import moving, rates
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.definition import kane
from mechanisms import with_joints
import numpy as np

AT_REST = 1e-9  # rad/s or m/s


def check_fields(robot, run, samples=5, tolerance=1e-8, torque=None, sticking=False):
    """
    Fail unless the fields of a single simulation are true at `samples` of its times.

    `torque` is that which the simulation was given, for every time; `sticking` says
    whether it had exact friction.
    """
    mechanism = robot.mechanism if hasattr(robot.equations, 'mechanism') else Mechanism(
        robot.model)
    places = np.unique(np.linspace(0, len(run.t) - 1, samples).astype(int))
    for k in places:
        state = {name: getattr(run, name)[k] for name in ('q', 'u', 'udot', 'tau')}
        time = run.t[k] if robot.equations.timed else 0.0
        rows = rows_at(mechanism, state['q'], time)
        qdot, qddot = motion_of(mechanism, time=time, **state)
        applied = actuators(robot, mechanism, state['q'], state['tau'], time)
        model = without_dry_friction(robot.model) if sticking else robot.model
        needed = kane.inverse_dynamics(model, state['q'], qdot, qddot)
        supplied = applied + rows.J.T @ run.constraint_forces[k] + run.stop_forces[k]
        size = max(1.0,
                   *(np.abs(x).max() for x in (needed, applied, run.stop_forces[k])))
        least, largest = np.zeros((2, len(needed)))
        if sticking:
            least, largest = dry_friction(robot.model, qdot)
            held = run.sticking[k]
            assert np.abs(qdot[held]).max(initial=0.0) < AT_REST
            assert np.abs(qddot[held]).max(initial=0.0) < 1e-7 * size
        friction = supplied - needed
        beyond = np.maximum(friction - largest, least - friction)
        assert beyond.max() < tolerance * size, (
            f'balance of forces at {run.t[k]:.6g} s: {friction}, from {least} to '
            f'{largest}')
        if torque is not None:
            np.testing.assert_array_equal(state['tau'], torque)
        expected = [kinetic(robot.model, state['q'], qdot),
                    energies.potential_energy(robot.model, state['q'])]
        np.testing.assert_allclose(run.energy[k], expected, rtol=1e-10, atol=1e-10)
        if robot.constraint_names:
            np.testing.assert_allclose(run.constraint_residual[k], rows.residual,
                                       atol=1e-12)
            np.testing.assert_allclose(run.constraint_velocity_residual[k],
                                       rows.J @ qdot - rows.b, atol=1e-9)
        check_stops(robot, run.q[k], qdot, qddot, run.stop_forces[k], size)


def without_dry_friction(model):
    """Return a model whose joints have no friction but damping and the offset."""
    return with_joints(model, friction=0.0, friction_backward=None,
                       breakaway_friction=None)


def dry_friction(model, qdot):
    """Return the least and largest dry friction, (n,) each; equal in motion."""
    least, largest = np.zeros((2, len(qdot)))
    for body in model.bodies:
        joint = body.joint
        m = body.joint.multiplier
        if not (joint.friction or joint.friction_backward or joint.breakaway_friction):
            continue
        rate = m * qdot[joint.coordinate]
        forward = joint.friction
        backward = (forward if joint.friction_backward is None
                    else joint.friction_backward)
        excess = (0.0 if joint.breakaway_friction is None
                  else joint.breakaway_friction - forward)
        if abs(rate) < AT_REST:
            ends = -m * (backward + excess), m * (forward + excess)
        else:
            falls = np.exp(
                -(rate / joint.stribeck_speed)**2) if joint.stribeck_speed else 0.0
            level = (forward if rate > 0.0 else backward) + excess * falls
            ends = (m * np.sign(rate) * level,) * 2
        least[joint.coordinate] += min(ends)
        largest[joint.coordinate] += max(ends)
    return least, largest


def check_stops(robot, q, qdot, qddot, forces, size):
    """Fail unless stops press away from themselves and hold what presses on them."""
    for joint, place in enumerate(robot.model.places):
        if place is None:
            assert forces[joint] == 0.0
            continue
        force = forces[joint]
        low = robot.limits.lower[place]
        high = robot.limits.upper[place]
        if force:
            stop = low if force > 0.0 else high
            assert abs(q[place] - stop) < 1e-9
            assert abs(qdot[joint]) < 1e-7
            assert abs(qddot[joint]) < 1e-7 * size


class Rows:
    """The rows of all constraints as numbers: J q' = b, and residuals."""

    def __init__(self, rows):
        """Store them."""
        self.J, self.b = (np.array(x, dtype=float) for x in (rows.J, rows.b))
        self.residual = np.array([0.0 if x is None else x for x in rows.residual],
                                 dtype=float)


def rows_at(mechanism, q, t):
    """Return the rows at a configuration and time."""
    rows = Rows(mechanism.rows(mechanism.state(q, t)))
    rows.J = rows.J.reshape(-1, mechanism.model.n)
    return rows


def motion_of(mechanism, q, u, udot, tau, time):
    """Return the joints' rates and accelerations by least squares over all rows."""
    names = mechanism.speed_names

    def system(q, t):
        placed = mechanism.state(q, t)
        rows = mechanism.rows(placed)
        Y, Z = placed.speed_rows(names)
        return np.concatenate([Y,
                               rows.J.reshape(-1, mechanism.model.n)]), np.concatenate(
                                   [-Z, rows.b])
    S, s = (np.array(x, dtype=float) for x in system(q, time))
    none = np.zeros(len(S) - len(u))
    qdot = np.linalg.lstsq(S, np.concatenate([u, none]) + s)[0]
    q_moving = moving(q, coordinate_rates(mechanism.model, q, qdot))
    S_rate, s_rate = (np.array(rates(x), dtype=float) for x in system(
        q_moving, moving(time, 1.0)))
    qddot = np.linalg.lstsq(S, np.concatenate([udot, none]) + s_rate - S_rate @ qdot)[0]
    return qdot, qddot


def partial_rates(mechanism, q, t):
    """Return the joint rates per unit of each independent speed, by least squares."""
    placed = mechanism.state(q, t)
    Y = placed.speed_rows(mechanism.speed_names)[0]
    J = rows_at(mechanism, q, t).J
    S = np.concatenate([np.array(Y, dtype=float), J])
    return np.linalg.pinv(S)[:, :mechanism.n]


def actuators(robot, mechanism, q, tau, t):
    """Return the actuators' joint torques by the definition of `joint_torques`."""
    places = getattr(robot.equations, 'actuated', None)
    if places is None:
        return np.array(mechanism.state(q, t).speed_rows(mechanism.speed_names)[0],
                        dtype=float).T @ tau
    weights = robot.options['actuated']
    names = [robot.joint_names[k] for k in places]
    # The least sum of weight times torque squared: of minimum norm in scaled torques.
    rows = []
    for name in names:
        rows.append(weights[name] ** -0.5 if isinstance(weights, dict) else 1.0)
    scale = np.array(rows)
    result = np.zeros(robot.model.n)
    result[places] = scale * (
        np.linalg.pinv(partial_rates(mechanism, q, t)[places].T * scale) @ tau)
    return result


def kinetic(model, q, qdot):
    """Return the kinetic energy by the mass matrix of the definition."""
    return 0.5 * qdot @ kane.mass_matrix(model, q) @ qdot
