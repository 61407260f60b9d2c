"""The energies that joint stops take, for the energy balance."""

from typing import Any, TYPE_CHECKING

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.energy_kernels import driven_kernel, energy_kernel
from kane_dynamics.simulation.user_speeds import UserSpeeds
import numpy as np

if TYPE_CHECKING:
    from kane_dynamics.simulation.torque_input import TorqueInput

BENT = 1e-6  # uncertain part of the energy that a joint gains on its way into a stop


def energies(source: 'TorqueInput', asked: Robot, before: Array, after: Array,
             steps: Any) -> Array:
    """
    Return loss, balance and uncertainty of the contacts at the end of K steps, (K, 3).

    See `Contact`.

    Parameters
    ----------
    source : TorqueInput
        Of one simulation.
    asked : Robot
        The user's robot; held torques are dual to its speeds.
    before, after : (K, size) arrays
        States before and after the impulses of the stops.
    steps : (K,) array
        Numbers of the steps, from 1.

    """
    robot, n_q, n, h = source.robot, asked.n_q, asked.n, source.step
    constrained = isinstance(robot.equations, ConstrainedEquations)
    size, K = n_q + n + robot.equations.timed, len(steps)
    u = [x[:, n_q:n_q + n] for x in (before, after)]
    terms = energy_kernel(robot)(np.concatenate([before[:, :size], after[:, :size]]))
    (kinetic, potential, friction), rest = terms[:K].T, terms[K:].T
    lost, power = kinetic - rest[0] + potential - rest[1], rest[2] - friction
    unresolved = BENT * np.abs(kinetic - rest[0])
    if source.follows:
        given = [np.sum(source.torques(steps, state[None, :, :n_q], x[None])[0] * x, axis=1)
                 for state, x in zip((before, after), u)]
        work = 0.5 * h * (given[0] - given[1])
        # Feedback of the speed bends the power within the step by this fraction.
        bent = min(1.0, 0.5 * h * float(np.max(source.torque.kd, initial=0.0)))
        unresolved += bent * np.abs(work)
    else:
        table = source.torque[0]
        tau = table[np.minimum(steps - 1, len(table) - 1)]
        if robot.speed_names != asked.speed_names:  # tau is dual to the user's speeds
            t, user = source.start + steps * h, UserSpeeds(asked)
            u = [user.speeds(robot, state[:, :n_q], x, 0.0 * x, t)[:, 0]
                 for state, x in zip((before, after), u)]
        moved = 0.5 * h * (u[0] - u[1]) if constrained else (
            before[:, :n_q] - after[:, :n_q])
        work = np.sum(tau * moved, axis=1)
    return np.stack([lost, lost - work - 0.5 * h * power, unresolved], axis=1)


def work_through_constraints(robot: Robot, states: Array, force: Array, step: float) -> Any:
    """
    Return the work that forces of stops do through moving constraints in K steps, (K,), J.

    A held joint does not move, so a stop does no work. But the constraints that prescribe a motion
    react to it, and the balance counts their work without the forces of stops.

    Parameters
    ----------
    robot : Robot
        In the speeds of the states.
    states : (K + 1, size) array
        At the ends of the steps.
    force : (2, K, n) array
        The generalized forces of the stops at the beginning and at the end of each step.
    step : float
        s.

    """
    driven, n_q, n = driven_kernel(robot), robot.n_q, robot.n
    if driven is None:
        return 0.0
    work: Any = 0.0
    for rows, f in zip((states[:-1], states[1:]), force):
        state, u = rows[:, :n_q + n + robot.equations.timed], rows[:, n_q:n_q + n]
        power = driven(state, f) - driven(state, 0.0 * f) + np.sum(f * u, axis=1)
        work = work + 0.5 * step * power
    return work
