"""Linear equations of motion of a robot about a motion, and its equilibria."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.checks import finite_row, instance
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import coordinate_rates, require_unit
from kane_dynamics.mechanics.constraints.conditioning import RANK
from kane_dynamics.robot.robot import Robot
import numpy as np

STEPS = 60  # of Newton's method for an equilibrium
BALANCED = 1e-11  # of the forces at the start: an equilibrium


@dataclass(frozen=True, eq=False)
class Linearization:
    """
    Linear equations x' = A x + B dtau of deviations x = [dq, du] from a motion.

    Attributes
    ----------
    A, B : (k + n, k + n), (k + n, n) arrays
    names : tuple of str
        Of x: the k independent joints (of a ball joint, rotations about the axes of its
        body), then the n independent speeds.
    positions : (n_j, k) array
        Deviations of all joints per unit of those of the independent ones.

    """

    A: Array
    B: Array
    names: tuple[str, ...]
    positions: Array

    def modes(self) -> list[tuple[complex, str]]:
        """Return the eigenvalues, 1/s, each with the entry of x that takes most part."""
        values, right = np.linalg.eig(self.A)
        left = np.linalg.pinv(right)
        # Participation factors: products of the right and left eigenvectors' entries.
        largest = np.argmax(np.abs(right * left.T), axis=0)
        order = np.lexsort([values.imag, values.real])
        return [(complex(values[k]), self.names[largest[k]]) for k in order]


def linearized(robot: Robot, q: Any, u: Any = None, tau: Any = None, *,
               t: float = 0.0) -> Linearization:
    """
    Return the linear equations of motion about a state, exact to rounding.

    Under constraints the deviations are those that the constraints admit: those of the
    independent joints, as many as position constraints leave, and of the independent
    speeds. In a motion that is not steady, A and B are those of this instant.

    Parameters
    ----------
    robot : Robot
        Of any kind.
    q : (n_q,) array_like
        Coordinates that meet the constraints, rad or m.
    u : (n,) array_like, optional
        Independent speeds. Default: at rest.
    tau : (n,) array_like, optional
        Generalized forces of the actuators. Default: those that keep the speeds.
    t : float
        Time, s.

    Raises
    ------
    InputError
        Names the argument, what was given and what is expected.
    ConstraintError
        The configuration is not closed.

    """
    instance(robot, Robot, 'robot')
    model = robot.model
    n = robot.n
    q = require_unit(model, finite_row(q, 'q', robot.coordinate_names), 'q')
    u = np.zeros(n) if u is None else finite_row(u, 'u', robot.speed_names)
    if tau is None:
        tau = robot.bias_force(q, u, t=t)
    accelerations = robot.derivative('forward_dynamics', q, u, tau, by=('q', 'u', 'tau'),
                                     t=t)
    by_q, by_u = robot.derivative('joint_rates', q, u, by=('q', 'u'), t=t)

    # dq = G dx of deviations dx of the joints, and dx' = G^+ (dq' - G' dx).
    G = _coordinate_rates(robot, q)
    qdot = robot.joint_rates(q, u, t=t)
    G_rate = _coordinate_rates(robot, q + qdot) - G
    inverse = np.linalg.pinv(G)
    independent, positions = admitted(robot, q, G, t)
    of_positions = (inverse @ (by_q @ G - G_rate) @ positions)[independent]
    A = np.block([[of_positions, (inverse @ by_u)[independent]],
                  [accelerations[0] @ G @ positions, accelerations[1]]])
    B = np.concatenate([np.zeros((len(independent), n)), accelerations[2]])
    names = [model.joint_names[k] for k in independent]
    names += [f'rate of {name}' for name in robot.speed_names]
    return Linearization(A, B, tuple(names), positions)


def equilibrium(robot: Robot, near: Any = None, tau: Any = None) -> tuple[Array, Array]:
    """
    Return an equilibrium: a configuration at rest, and the torques that hold it.

    Parameters
    ----------
    robot : Robot
        Of any kind that does not depend on time.
    near : (n_q,) array_like, optional
        The configuration itself if the torques are unknown; else where Newton's method
        begins. Default: `Robot.feasible_configuration`.
    tau : (n,) array_like, optional
        Torques of an equilibrium whose configuration is unknown, such as zeros. Default:
        the torques are unknown.

    Returns
    -------
    q : (n_q,) array
        rad or m.
    tau : (n,) array
        Generalized forces of the actuators, N m or N.

    Raises
    ------
    InputError
        No equilibrium is found from there.

    """
    instance(robot, Robot, 'robot')
    robot.equations.require_timeless('equilibrium', 'so that the robot has one')
    if near is None:
        near = robot.feasible_configuration()
    q = require_unit(robot.model, finite_row(near, 'near', robot.coordinate_names), 'near')
    q = robot.closed_configuration(q)
    rest = np.zeros(robot.n)
    force = robot.bias_force(q, rest)
    if tau is None:
        return q, force
    torque = finite_row(tau, 'tau', robot.speed_names)
    residual = force - torque
    start = np.abs(force).max() + np.abs(torque).max()
    for _ in range(STEPS):
        if np.abs(residual).max() <= BALANCED * start:
            return q, torque
        slope = robot.derivative('bias_force', q, rest, by='q')
        along = robot.derivative('joint_rates', q, rest, by='u')
        step = np.linalg.lstsq(slope @ along, -residual, rcond=None)[0]
        # A shorter step where the full one, of at most a radian, does not help.
        step /= max(1.0, np.abs(step).max())
        for _ in range(STEPS):
            moved = robot.closed_configuration(robot.integrate(q, step))
            remaining = robot.bias_force(moved, rest) - torque
            if np.abs(remaining).max() < np.abs(residual).max():
                break
            step = 0.5 * step
        else:
            break
        q = moved
        residual = remaining
    raise InputError(f'equilibrium: {np.abs(residual).max():.3g} N m or N remain at '
                     f'q = {q.tolist()}; expected torques that can hold the robot, and a '
                     'start nearer to the equilibrium')


def _coordinate_rates(robot: Robot, q: Array) -> Array:
    """Return G, (n_q, n_j): q' per unit of each joint's speed."""
    rows = [coordinate_rates(robot.model, q, unit) for unit in np.eye(robot.model.n)]
    return np.array(rows, dtype=np.float64).T


def admitted(robot: Robot, q: Array, G: Array, t: float) -> tuple[list[int], Array]:
    """Return the places of the independent joints, and the deviations of all, (n_j, k)."""
    n = robot.model.n
    rows = robot.derivative('constraint_residual', q, by='q', t=t) @ G
    # Pivots, each the largest column that is left, make joints dependent; joints whose
    # rates are independent speeds come last.
    last = [name in robot.speed_names for name in robot.model.joint_names]
    left = rows.copy()
    dependent: list[int] = []
    for chosen in (False, True):
        while True:
            size = np.linalg.norm(left, axis=0)
            size[[k for k in range(n) if last[k] != chosen or k in dependent]] = 0.0
            k = int(np.argmax(size))
            if size[k] <= RANK * max(1.0, np.abs(rows).max(initial=0.0)):
                break
            unit = left[:, k] / size[k]
            left = left - np.outer(unit, unit @ left)
            dependent.append(k)
    independent = [k for k in range(n) if k not in dependent]
    positions = np.zeros((n, len(independent)))
    positions[independent] = np.eye(len(independent))
    positions[dependent] = -np.linalg.lstsq(rows[:, dependent], rows[:, independent],
                                            rcond=None)[0]
    return independent, positions
