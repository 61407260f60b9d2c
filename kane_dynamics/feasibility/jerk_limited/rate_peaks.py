"""Jerk and rate of torque in the quintics between the points of a motion."""

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.jerk_limited.third_order_limits import damping, RateBounds
from kane_dynamics.feasibility.path_limits import friction
from kane_dynamics.feasibility.torque_demand import share
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.robot.robot import Robot
import numpy as np

ORDER = 8  # of the polynomials of the torque between two points
# Chebyshev's, with both ends.
NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(ORDER + 1) / ORDER)
PLACES = np.linspace(0.0, 1.0, 33)  # in a segment, at which the rates are computed


def _derivative() -> Array:
    """Return the matrix of slopes at the places for values at the nodes."""
    powers = np.polynomial.chebyshev.chebvander(2.0 * NODES - 1.0, ORDER)
    slopes = 2.0 * np.polynomial.chebyshev.chebval(
        2.0 * PLACES - 1.0, np.polynomial.chebyshev.chebder(np.eye(ORDER + 1))).T
    return np.asarray(slopes @ np.linalg.inv(powers))


DERIVATIVE = _derivative()


def rate_uses(robot: Robot, points: ControllerPoints, rates: RateBounds
              ) -> dict[str, Array]:
    """Return shares of the limits of jerk and torque rate, (places, S, n), by name."""
    shares = {}
    if np.isfinite(rates.jerk).any():
        shares['jerk'] = share(np.abs(jerks(points)), rates.jerk)
    if np.isfinite(rates.torque_rate).any():
        values = np.abs(torque_rates(robot, points))
        shares['torque_rate'] = share(values, rates.torque_rate)
    return shares


def jerks(points: ControllerPoints) -> Array:
    """Return the jerks at the places of all segments, (places, S, n)."""
    polynomials = points.coefficients
    x = PLACES[:, None, None]
    scale = np.diff(points.t)[:, None]**-3
    change = 24.0 * polynomials[:, 4] + x * 60.0 * polynomials[:, 5]
    return np.asarray(scale * (6.0 * polynomials[:, 3] + x * change))


def torque_rates(robot: Robot, points: ControllerPoints) -> Array:
    """
    Return the rates of the torques without Coulomb friction, (places, S, n).

    The torques at the nodes are differentiated as polynomials of time.
    """
    segments = np.arange(len(points.t) - 1)
    q, u, udot = (rows.reshape(-1, robot.n) for rows in points.inside(segments, NODES))
    tau = robot.inverse_dynamics(q, u, udot) - friction(robot, u)[0] + damping(robot) * u
    rows = tau.reshape(len(NODES), -1)
    rows = rows - rows[ORDER // 2]  # less rounding
    slopes = (DERIVATIVE @ rows).reshape(len(PLACES), len(segments), robot.n)
    return np.asarray(slopes / np.diff(points.t)[:, None])


def rate_uses_at_points(robot: Robot, parts: list[ControllerPoints], rates: RateBounds
                        ) -> dict[str, Array]:
    """Return the shares at the points, the larger one of both sides, (K, n), by name."""
    shares: dict[str, list[Array]] = {}
    for points in parts:
        for name, uses in rate_uses(robot, points, rates).items():
            # Those at the starts and at the ends of the segments; outside there are
            # none.
            starts, ends = np.pad(uses[[0, -1]], ((0, 0), (1, 1), (0, 0)))
            rows = np.maximum(starts[1:], ends[:-1])
            shares.setdefault(name, []).append(rows)
    return {name: np.concatenate(rows) for name, rows in shares.items()}
