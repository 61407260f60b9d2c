"""Jerk and rate of torque in the quintics between the points of a motion."""

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.jerk_limited.third_order_limits import damping
from kane_dynamics.feasibility.path_limits import friction
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.robot.robot import Robot
import numpy as np

ORDER = 8  # of the polynomials of the torque between two points
NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(ORDER + 1) / ORDER)  # of Chebyshev, with both ends
PLACES = np.linspace(0.0, 1.0, 65)  # in a segment, at which the rates are computed


def _derivative() -> Array:
    """Return the matrix of the slopes at the places of a polynomial with values at the nodes."""
    powers = np.polynomial.chebyshev.chebvander(2.0 * NODES - 1.0, ORDER)
    slopes = 2.0 * np.polynomial.chebyshev.chebval(
        2.0 * PLACES - 1.0, np.polynomial.chebyshev.chebder(np.eye(ORDER + 1))).T
    return np.asarray(slopes @ np.linalg.inv(powers))


DERIVATIVE = _derivative()


def jerks(points: ControllerPoints) -> Array:
    """Return the jerks at the places of all segments, (65, S, n)."""
    polynomials = points.coefficients
    x = PLACES[:, None, None]
    scale = np.diff(points.t)[:, None]**-3
    return np.asarray(scale * (6.0 * polynomials[:, 3] + x * (
        24.0 * polynomials[:, 4] + x * 60.0 * polynomials[:, 5])))


def torque_rates(robot: Robot, points: ControllerPoints) -> Array:
    """
    Return the rates of the torques without Coulomb friction at the places, (65, S, n).

    The torques at the nodes are differentiated as polynomials of time.
    """
    segments = np.arange(len(points.t) - 1)
    q, u, udot = (rows.reshape(-1, robot.n) for rows in points.inside(segments, NODES))
    tau = robot.inverse_dynamics(q, u, udot) - friction(robot, u)[0] + damping(robot) * u
    rows = tau.reshape(len(NODES), -1)
    rows = rows - rows[ORDER // 2]  # less rounding
    return np.asarray((DERIVATIVE @ rows).reshape(len(PLACES), len(segments), robot.n)
                      / np.diff(points.t)[:, None])
