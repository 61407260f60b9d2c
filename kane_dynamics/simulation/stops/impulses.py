"""
The impulses of joint stops at the end of a step.

With constraints or chosen speeds, both corrections, of positions and of speeds, act in the space
of the admissible motions: an impulse p of a stop at joint j changes the independent speeds by
-M^-1 T_j^T s p.
"""

from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.ball_joints import on_unit_quaternions
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.constraints.row_units import coordinate_units
from kane_dynamics.mechanics.integrators.held_joints import REGULAR
from kane_dynamics.mechanics.joint_stops import (ended_motion, nearest_stops, stop_impulses,
                                                 stopped_state)
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.stops.pressed_steps import PressedSteps, ROUNDING
from kane_dynamics.simulation.stops.stop_forces import TOUCHING
import numpy as np

DRIVEN = 1e-6  # relative: speed into a stop that its impulse cannot end
ITERATIONS = 20  # of moving joints back and closing loops


def resolved_state(robot: Robot, state: Array, t: float, lower: Array, upper: Array, held: Array,
                   one: PressedSteps | None, step: float) -> tuple[Array, Array]:
    """
    Return a state, (size,), after the impulses of the stops, and the speeds they ended, (n_q,).

    Parameters
    ----------
    robot, state, t, lower, upper
        At the end of a step; s; the stops are rad or m.
    held : (n_q,) array
        The sides of the stops that held joints in this step, else 0.
    one : PressedSteps or None
        That step; None if no stop held. The impulses of its forces act already.
    step : float
        s.

    """
    n_q, n = robot.n_q, robot.n
    constrained = isinstance(robot.equations, ConstrainedEquations)
    q, u, after = state[:n_q].copy(), state[n_q:n_q + n].copy(), state.copy()
    given = np.zeros((2, n_q))
    if one is not None:
        places, against = np.flatnonzero(held), -one.force[:, 0].mean(axis=0)
        if constrained:
            at = {'t': t} if robot.equations.timed else {}
            against = np.linalg.lstsq(_partial_rates(robot, q, at)[0][places].T, against)[0]
        else:
            against = against[places]
        given[:, places] = np.maximum(0.0, held[places] * against)
        given *= [[0.5 * step * step], [step]]
    after[:n_q], after[n_q:n_q + n], speeds = admissible_state(
        robot, q, u, t, lower, upper, given) if constrained else stopped_state(
        q, u, robot.inverse_mass_matrix(q), lower, upper, given)
    return after, speeds


def admissible_state(robot: Robot, q: Array, u: Array, t: float, lower: Array, upper: Array,
                     given: Array) -> tuple[Array, Array, Array]:
    """
    Return q and u after the impulses of the stops, and the speeds that they ended, (n_q,).

    The impulses that move joints back solve the complementarity problem of `stop_impulses`: of
    stops that act on the same motion, those that would pull have none. Loops are not linear, so
    the problem is linearized again where its solution leads, until no joint is past its stop.
    `given` is that of `stopped_state`.

    Raises
    ------
    ConstraintError
        The constraints drive a joint into its stop.

    """
    at: dict[str, Any] = {'t': t} if robot.equations.timed else {}
    units = coordinate_units(robot.model, robot.mechanism.constraints)
    most = ROUNDING * units
    moved = given[0].copy()  # by the impulse of each stop so far
    for _ in range(ITERATIONS):
        T, X, inverse = _partial_rates(robot, q, at)
        side, away = nearest_stops(q, lower, upper)
        acting = np.flatnonzero(moved)
        held_back = np.abs(away[acting]) <= most[acting]
        if not (side * away > most).any() and held_back.all():
            break
        stops = np.flatnonzero(side)
        s, along, A = _response(side, stops, T, inverse)
        p = stop_impulses(s * away[stops] + A @ moved[stops], A)[0]
        q = _closed(robot, q - T @ (along @ (p - moved[stops])), t)
        moved[stops] = p
    else:
        raise _driven(robot, q, side * away, t)
    side = side * ((np.abs(away) < TOUCHING * units) | (given[1] > 0.0))
    qdot, stops = T @ u + X, np.flatnonzero(side)
    s, along, A = _response(side, stops, T, inverse)
    p = stop_impulses(s * qdot[stops] + A @ given[1, stops], A)[0]
    u = u - along @ (p - given[1, stops])
    into = side * (T @ u + X)
    fastest = np.abs(qdot / units).max(initial=1e-6)
    if (into / units > DRIVEN * fastest).any():
        raise _driven(robot, q, into, t)
    ended = np.zeros(robot.n_q)
    ended[stops] = ended_motion(s * qdot[stops], A, p)
    return q, u, ended


def _partial_rates(robot: Robot, q: Array,
                   at: dict[str, Any]) -> tuple[Array, Array, Array]:
    """Return T (n_q, n), X (n_q,) of q' = T u + X, and M^-1 (n, n)."""
    n = robot.n
    rows = np.concatenate([np.zeros((1, n)), np.eye(n)])
    rates = robot.joint_rates(np.tile(q, (n + 1, 1)), rows, **at)
    return (rates[1:] - rates[0]).T, rates[0], robot.inverse_mass_matrix(q, **at)


def _closed(robot: Robot, q: Array, t: float) -> Array:
    """Return q on unit quaternions after two Newton steps on the loops."""
    equations: Any = robot.equations
    if not equations.keeps_positions(q, t):
        return np.asarray(on_unit_quaternions(robot.model, q))
    arguments = [Argument('q', (robot.n_q,)), Argument('t', ())]
    block = robot.parameters.block
    kernel = robot.kernels.extra('closure_step', lambda: trace_program(
        'closure_step', lambda q, t, _: equations.closure_step(q, t[()]),
        [('q', (robot.n_q,)), ('t', ()), ('parameters', block.shape)]), arguments, block,
        (robot.n_q,))
    result: Array = on_unit_quaternions(robot.model, kernel(kernel(q, t), t))
    return result


def _driven(robot: Robot, q: Array, into: Array, t: float) -> ConstraintError:
    name = robot.coordinate_names[int(np.argmax(into))]
    return ConstraintError(f"{t:.6g} s: joint '{name}' is at its stop, and the constraints "
                           'drive it on; expected a motion between the stops')


def _response(side: Array, joints: Any, T: Array, inverse: Array) -> tuple[Array, Array, Array]:
    """
    Return the response to impulses of the stops of k joints, given by index.

    It is their sides (k,), the changes of the independent speeds (n, k), and the motion away from
    each stop (k, k), regular where the constraints couple stops.
    """
    s = side[joints]
    along = inverse @ (T[joints] * s[:, None]).T
    A = s[:, None] * T[joints] @ along
    return s, along, A + (REGULAR * np.diag(A).max(initial=0.0) or 1.0) * np.eye(len(A))
