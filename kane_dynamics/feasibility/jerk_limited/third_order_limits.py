"""
Limits of a robot at the vertices of a path as functions of x = s'^2, x' and x''.

With the torque a s'' + b s'^2 + c + friction (see `path_limits`) the limited quantities are

    velocity        q_s sqrt(x)
    acceleration    q_s x'/2 + q_ss x
    torque          a x'/2 + b x + c + friction(q_s sqrt(x))
    jerk            sqrt(x) (q_s x''/2 + 3/2 q_ss x' + q_sss x)
    torque rate     sqrt(x) (a x''/2 + (a_s/2 + b) x' + b_s x + c_s) + damping * acceleration

The rate of the torque is that without Coulomb friction. Derivatives along the path are taken from
either side of a vertex, since q_sss jumps at the points of a cubic spline.
"""

from collections.abc import Sequence
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.feasibility.path_limits import Bounds, friction, PathLimits, torque_kernel
from kane_dynamics.robot.robot import Robot
import numpy as np


class Uses(NamedTuple):
    """
    Shares of limits at the vertices, and their slopes.

    Attributes
    ----------
    values : (N + 1, m) array
        Signed shares of m limits.
    slopes : (3, N + 1, m) array
        Derivatives with respect to x, x' and x''.

    """

    values: Array
    slopes: Array


class ThirdOrderLimits:
    """The limits of a robot at the vertices of a section that begins and ends at rest."""

    def __init__(self, robot: Robot, section: Section, bounds: Bounds) -> None:
        """Compute the coefficients of the limited quantities."""
        self.robot, self.bounds = robot, bounds
        self.second_order = PathLimits(robot, section, bounds)
        self.tight = self.second_order.tight
        q, first, second = (np.ascontiguousarray(rows) for rows in section[:3])
        tau: Array = torque_kernel(robot)(q, first, second)
        inertia, square, constant = tau[::2, 0], tau[::2, 1], tau[::2, 2]
        self.first, self.second = first[::2], second[::2]
        self.effort = (square, 0.5 * inertia, constant)
        third = _slopes(second, section.step)
        self.jerk = (third, 1.5 * self.second[:, None], 0.5 * self.first[:, None])
        slope, bend, static = (_slopes(tau[:, k], section.step) for k in range(3))
        self.torque_rate = (bend, 0.5 * slope + square[:, None], 0.5 * inertia[:, None], static)
        self.damping = damping(robot)
        # What the rates of the motion have beyond those of these formulas, for x = 1.
        self.corrections = {name: np.zeros_like(third) for name in ('jerk', 'torque_rate')}

    def at(self, profile: Array) -> Uses:
        """Return the uses of all limits with x, x' and x'' at the vertices, (N + 1, 3)."""
        x, change, bend = (column[:, None] for column in profile.T)
        root = np.sqrt(x)
        none = np.zeros_like(self.first)
        u = self.first * root
        udot = self.second * x + 0.5 * self.first * change
        factor = 1.0 / (self.second_order.most * self.tight[1].min(axis=1)**2)[:, None]
        found: dict[str, Sequence[Array]] = {'velocity': (factor * x, factor, 0.0 * x, 0.0 * x)}
        accelerating = (udot, self.second, 0.5 * self.first, none)
        if np.isfinite(self.bounds.acceleration).any():
            found['acceleration'] = accelerating
        square, linear, constant = self.effort
        force, steep = friction(self.robot, u)
        effort = (square * x + linear * change + constant + force - self.second_order.offset,
                  square + 0.5 * steep * self.first / root, linear, none)
        if np.isfinite(self.bounds.effort).any():
            found['effort'] = effort
        if np.isfinite(self.bounds.power).any():
            tau, by_x, by_change, _ = effort
            found['power'] = (tau * u, by_x * u + 0.5 * tau * self.first / root,
                              by_change * u, none)
        x, change, bend, root = (each[:, None] for each in (x, change, bend, root))
        for name, (by_x, by_change, by_bend, *static) in (
                ('jerk', self.jerk), ('torque_rate', self.torque_rate)):
            if not np.isfinite(getattr(self.bounds, name)).any():
                continue
            by_x = by_x + self.corrections[name]
            inner = by_x * x + by_change * change + by_bend * bend + (static[0] if static else 0.0)
            rows = [inner * root, by_x * root + 0.5 * inner / root, by_change * root,
                    by_bend * root]
            if static:
                rows = [each + self.damping * more[:, None]
                        for each, more in zip(rows, accelerating)]
            for side in range(2):
                found[f'{name} {side}'] = [np.broadcast_to(each, by_x.shape)[:, side]
                                           for each in rows]
        values, derivatives = [], []
        for name, (value, *rows) in found.items():
            if name != 'velocity':
                limit = name.split()[0]
                bound = getattr(self.bounds, limit)
                # A limit of 0 belongs to a joint that does not move.
                used = np.isfinite(bound) & ((bound > 0.0) | (limit == 'effort'))
                scale = 1.0 / (self.tight[Bounds._fields.index(limit)] * bound)[:, used]
                value, *rows = (each[:, used] * scale for each in (value, *rows))
            values.append(value)
            derivatives.append(np.stack(np.broadcast_arrays(value, *rows)[1:]))
        return Uses(np.hstack(values), np.concatenate(derivatives, axis=2))


    def correct(self, name: str, profile: Array, values: Array) -> None:
        """
        Correct the jerk or the torque rate such that it is that of the motion with a profile.

        The two differ because a quintic between vertices does not follow a kink of q_ss. This
        difference is proportional to s'^3.

        Parameters
        ----------
        name : str
            'jerk' or 'torque_rate'.
        profile : (N + 1, 3) array
            x, x' and x'' of the motion at the vertices.
        values : (2, N, n) array
            The rates of the motion at the start and at the end of each segment.

        """
        x, change, bend = (column[:, None, None] for column in profile.T)
        by_x, by_change, by_bend, *static = getattr(self, name)
        inner = by_x * x + by_change * change + by_bend * bend
        if static:
            more = self.second * profile[:, :1] + 0.5 * self.first * profile[:, 1:2]
            inner = inner + static[0] + (self.damping * more)[:, None] / np.sqrt(x)
        found = np.stack([np.concatenate([values[0, :1], values[1]]),
                          np.concatenate([values[0], values[1, -1:]])], axis=1)
        self.corrections[name] = found / x**1.5 - inner / x


def _slopes(rows: Array, step: float) -> Array:
    """Return derivatives at vertices on their left and right side, (N + 1, 2, n), from samples."""
    before, middle, after = rows[:-2:2], rows[1::2], rows[2::2]
    right = (4.0 * middle - 3.0 * before - after) / step
    left = (3.0 * after + before - 4.0 * middle) / step
    return np.stack([np.concatenate([right[:1], left]), np.concatenate([right, left[-1:]])],
                    axis=1)


def damping(robot: Robot) -> Array:
    """Return the damping of the joints with respect to their coordinates, (n,)."""
    found = np.zeros(robot.n)
    for body in robot.model.bodies if robot.friction else ():
        found[body.joint.coordinate] += body.joint.multiplier**2 * body.joint.damping
    return found
