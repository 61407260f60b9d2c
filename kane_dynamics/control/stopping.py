"""Bring an arm to rest by its model alone, where its state is not measured any more."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.control.terms import Terms
from kane_dynamics.control.traced_laws import motion_torque
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
import numpy as np

FRICTION = TORQUE_TERMS.index('friction')
NEAR_REST = 0.01  # rad/s or m/s


def reached_state(robot: Robot, terms: Terms, places: Sequence[int], q: Vector, u: Vector,
                  tau: Vector, elapsed: Scalar, parameters: Vector, t: Scalar = 0.0
                  ) -> tuple[Vector, Vector]:
    """
    Return where joints are, and their rates, some time after they were measured last.

    The torque has been constant since then: `state_after` in one step.

    Parameters
    ----------
    robot : Robot
        Without ball joints.
    terms : Terms
        Terms of the commands; the arm adds the others itself.
    places : sequence of k int
        The joints.
    q, u : (n_q,), (n,) arrays of Scalar
        The last state, rad or m, and s.
    tau : (n_q,) array of Scalar
        The commanded torques of the joints, N m or N.
    elapsed : Scalar
        Time since then, s.
    parameters : array of Scalar
        Of the robot.
    t : Scalar
        Time of the state, s.

    Returns
    -------
    (k,), (k,) arrays of Scalar
        Positions and rates.

    """
    q_end, _, rates = state_after(robot, terms, q, u, tau, elapsed, parameters, t)
    return q_end[list(places)], rates[list(places)]


def state_after(robot: Robot, terms: Terms, q: Vector, u: Vector, tau: Vector,
                elapsed: Scalar, parameters: Vector, t: Scalar = 0.0
                ) -> tuple[Vector, Vector, Vector]:
    """
    Return the state that a constant torque reaches in a short time, and the joints' rates.

    One step of the linearly implicit midpoint method, of second order: friction brings a
    joint to rest, however light it is, and does not turn its speed over. The arguments
    are those of `reached_state`; the results are (n_q,), (n,) and (n_q,).
    """
    equations = robot.equations

    def speeds_after(q_at: Vector, u_at: Vector, duration: Scalar) -> Vector:
        """Return the speeds after a duration, with the forces at another state."""
        motion = equations.joint_motion(q_at, u_at, equations.zeros, t)
        # M u_after = M u + duration force, with the slope of friction implicit: stiff
        # friction brings joints to rest instead of reversing them.
        force = motion.projected(tau) - _held(robot, terms, q_at, u_at, parameters, t)
        M = equations.mass_matrix(q_at, parameters, t)
        damped = M
        if terms.friction:
            slopes = friction_per_rate(robot, motion.qdot)
            damped = M + duration * motion.congruent(np.diag(slopes))
        return equations.mechanism.solved(damped, M @ u + duration * force)

    # To the middle with the forces at the begin, then to the end with those of the middle.
    half = 0.5 * elapsed
    u_middle = speeds_after(q, u, half)
    q_middle = q + half * equations.joint_rates(q, 0.5 * (u + u_middle), t)
    u_end = speeds_after(q_middle, u_middle, elapsed)
    mean_rates = equations.joint_rates(q_middle, 0.5 * (u + u_end), t)
    q_end = q + elapsed * mean_rates
    rates = equations.joint_rates(q_middle, u_end, t)
    return q_end, u_end, rates


def friction_per_rate(robot: Robot, qdot: Vector) -> Vector:
    """
    Return the friction of each joint beyond that at rest, divided by its rate.

    Near rest it is the slope of the law there.
    """
    tree = robot.equations.tree
    at_rest = 0.0 * qdot
    friction = tree.friction_force(qdot) - tree.friction_force(at_rest)
    slope = tree.friction_slope(at_rest)
    squared = qdot * qdot
    return (friction * qdot + slope * NEAR_REST**2) / (squared + NEAR_REST**2)


def _held(robot: Robot, terms: Terms, q: Vector, u: Vector, parameters: Vector,
          t: Scalar) -> Vector:
    """Return the force that commands hold at a state, without friction that moves, (n,)."""
    equations = robot.equations
    rows = equations.torque_terms(q, u, equations.zeros, parameters, t)
    weights = terms.weights.copy()
    weights[FRICTION] = 0.0
    held: Vector = weights @ rows
    if terms.arm is not None:
        held = held - terms.arm.force(robot, q, parameters, t)
    # Of friction, what acts without a motion: the offsets.
    if terms.friction:
        motion = equations.at_rest(q, t)
        held = held + motion.projected(equations.tree.friction_force(0.0 * motion.qdot))
    return held


def stopping_torque(robot: Robot, terms: Terms, q: Vector, u: Vector, elapsed: Scalar,
                    duration: Scalar, parameters: Vector) -> Vector:
    """
    Return the torque of the stop from a state, (n,), as `Controller.stopping_motion`.

    The speeds fall as 1 - 3 x^2 + 2 x^3 in the time x of the stop: the quintic from
    (q, u, 0) to rest.

    Parameters
    ----------
    robot, terms, q, u, parameters
        As of `reached_state`, at the begin of the stop.
    elapsed, duration : Scalar
        Time since the begin of the stop, and that of the stop, s.

    """
    motion = stopping_motion(q, u, elapsed, duration)
    torque = motion_torque(robot, terms, *motion, parameters)
    if terms.arm is not None:
        torque = torque - terms.arm.force(robot, motion[0], parameters)
    return torque


def stopping_motion(q: Vector, u: Vector, elapsed: Scalar, duration: Scalar
                    ) -> tuple[Vector, Vector, Vector]:
    """Return q, u, udot of the stop; arguments as of `stopping_torque`."""
    x = elapsed / duration
    x = select(x < 1.0, x, 1.0)
    x = select(x > 0.0, x, 0.0)
    passed = duration * (x - x * x * x + 0.5 * x * x * x * x)
    rate = 1.0 - 3.0 * x * x + 2.0 * x * x * x
    change = 6.0 * (x * x - x) / duration
    return q + passed * u, rate * u, change * u


def motion_to_rest(q: Array, u: Array, duration: float, joint_names: Sequence[str]
                   ) -> Motion:
    """Return `stopping_motion` of joints as a motion, of a duration in s."""
    end = q + 0.5 * duration * u
    at_rest = 0.0 * u
    return Motion.from_points([0.0, duration], [q, end], [u, at_rest],
                              [at_rest, at_rest], joint_names=joint_names)
