"""Jerk and rate of torque in the quintics between the points of a motion."""

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.jerk_limited.third_order_limits import damping, RateBounds
from kane_dynamics.feasibility.path_limits import friction
from kane_dynamics.feasibility.torque_demand import share
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.robot.robot import Robot
import numpy as np

ORDER = 8  # of the polynomials of the torque between two points
NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(ORDER + 1) / ORDER)  # of Chebyshev, with both ends
PLACES = np.linspace(0.0, 1.0, 33)  # in a segment, at which the rates are computed


def _derivative() -> Array:
    """Return the matrix of the slopes at the places of a polynomial with values at the nodes."""
    powers = np.polynomial.chebyshev.chebvander(2.0 * NODES - 1.0, ORDER)
    slopes = 2.0 * np.polynomial.chebyshev.chebval(
        2.0 * PLACES - 1.0, np.polynomial.chebyshev.chebder(np.eye(ORDER + 1))).T
    return np.asarray(slopes @ np.linalg.inv(powers))


DERIVATIVE = _derivative()


def rate_uses(robot: Robot, points: ControllerPoints, rates: RateBounds) -> dict[str, Array]:
    """Return shares of the limits of jerk and torque rate in all segments, (places, S, n)."""
    found = {}
    if np.isfinite(rates.jerk).any():
        found['jerk'] = share(np.abs(jerks(points)), rates.jerk)
    if np.isfinite(rates.torque_rate).any():
        found['torque_rate'] = share(np.abs(torque_rates(robot, points)), rates.torque_rate)
    return found


def jerks(points: ControllerPoints) -> Array:
    """Return the jerks at the places of all segments, (places, S, n)."""
    polynomials = points.coefficients
    x = PLACES[:, None, None]
    scale = np.diff(points.t)[:, None]**-3
    return np.asarray(scale * (6.0 * polynomials[:, 3] + x * (
        24.0 * polynomials[:, 4] + x * 60.0 * polynomials[:, 5])))


def torque_rates(robot: Robot, points: ControllerPoints) -> Array:
    """
    Return the rates of the torques without Coulomb friction at the places, (places, S, n).

    The torques at the nodes are differentiated as polynomials of time.
    """
    segments = np.arange(len(points.t) - 1)
    q, u, udot = (rows.reshape(-1, robot.n) for rows in points.inside(segments, NODES))
    tau = robot.inverse_dynamics(q, u, udot) - friction(robot, u)[0] + damping(robot) * u
    rows = tau.reshape(len(NODES), -1)
    rows = rows - rows[ORDER // 2]  # less rounding
    return np.asarray((DERIVATIVE @ rows).reshape(len(PLACES), len(segments), robot.n)
                      / np.diff(points.t)[:, None])


def rate_uses_at_points(robot: Robot, parts: list[ControllerPoints], rates: RateBounds
                        ) -> dict[str, Array]:
    """Return the shares at the points of all sections, the larger one of both sides, (K, n)."""
    found: dict[str, list[Array]] = {}
    for points in parts:
        for name, uses in rate_uses(robot, points, rates).items():
            ends = np.pad(uses[[0, -1]], ((0, 0), (1, 1), (0, 0)))
            found.setdefault(name, []).append(np.maximum(ends[0, 1:], ends[1, :-1]))
    return {name: np.concatenate(rows) for name, rows in found.items()}
