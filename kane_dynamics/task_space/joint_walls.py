"""
Joint limits: soft walls before them, and speeds at which joints come to them.

Walls are springs and dampers that act within a margin.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import magnitude, select
from kane_dynamics.mechanics.algebra.lane_products import by_entries
from kane_dynamics.mechanics.algebra.lanes import Lanes
from kane_dynamics.native.tracing.program import Shape
from kane_dynamics.robot.robot import Robot
from kane_dynamics.task_space.joint_speed_limits import (CREEPING, CROSSING, FREED,
                                                         STOPPING)
import numpy as np
from numpy.typing import ArrayLike

MARGIN = 0.1  # rad or m: the default, at most SHARE of a joint's range
SHARE = 0.05
WALL = ('wall_stiffness', 'wall_lower', 'wall_upper', 'wall_damping')  # settings
STOPS = ('lower_stop', 'upper_stop', 'creeping')  # settings: the joint limits
DAMPING = 0.01  # s: damping of a wall over its stiffness, at the joint limit and beyond


class JointWalls:
    """
    The walls of a robot's joint limits; none at a joint without limits.

    A wall is a spring whose damping grows with its depth, up to the joint limit, so that
    the torque is continuous. The coordinates of ball joints have no limits.
    """

    def __init__(self, robot: Robot) -> None:
        model = robot.model
        # Of joints with a position: their indices in u, and in q.
        self.joints = [r for r, place in enumerate(model.places) if place is not None]
        self.places = [place for place in model.places if place is not None]
        self._names = [robot.joint_names[r] for r in self.joints]
        self._joint_count = len(model.places)
        self._lower = np.asarray(robot.limits.lower, np.float64)[self.places]
        self._upper = np.asarray(robot.limits.upper, np.float64)[self.places]
        self._effort = np.asarray(robot.limits.effort, np.float64)[self.joints]
        self.count = len(self.joints)

    def shapes(self, *names: str) -> dict[str, Shape]:
        """Return the shapes of settings of `WALL` and `STOPS`."""
        return dict.fromkeys(names, (self.count,))

    def settings(self, stiffness: ArrayLike | None,
                 margin: ArrayLike | None) -> dict[str, Array]:
        """
        Return the settings `WALL` and `STOPS`.

        They are stiffness and damping of the walls, and the positions where they begin;
        the joint limits, and the speeds that are free at them. By default a wall holds
        the effort limit at the joint limit.
        """
        span = self._upper - self._lower
        if margin is None:
            margins = np.minimum(MARGIN, SHARE * span)
        else:
            margins = per_joint(margin, 'limit_margin', self._names)
            if (2.0 * margins > span).any():
                raise InputError(f'limit_margin: {margins.tolist()}; expected at most '
                                 'half of the range of each joint')
        if stiffness is None:
            # Joints without effort limits have no wall by default.
            effort = np.where(np.isfinite(self._effort), self._effort, 0.0)
            stiffnesses = effort / np.where(margins > 0.0, margins, 1.0)
        else:
            stiffnesses = per_joint(stiffness, 'limit_stiffness', self._names)
        # At a joint limit a joint may creep; one with a single limit, by 1 rad/s or m/s.
        crossing = np.where(np.isfinite(span), span, 1.0) / CROSSING
        # A joint without a limit has its wall beyond every position.
        return {'lower_stop': self._lower, 'upper_stop': self._upper,
                'creeping': CREEPING * crossing,
                'wall_stiffness': stiffnesses, 'wall_lower': self._lower + margins,
                'wall_upper': self._upper - margins,
                'wall_damping': DAMPING / np.where(margins > 0.0, margins, 1.0)}

    def force(self, q: Vector, joint_rates: Vector, settings: Mapping[str, Any],
              lanes: Any = Lanes) -> Vector:
        """Return the joint forces of the walls, (n_j,), over any scalar."""
        force = np.zeros(len(joint_rates)).astype(object)
        parts = [settings[name] for name in WALL]
        force[self.joints] = by_entries(_wall_force, lanes, q[self.places],
                                        joint_rates[self.joints], *parts)
        return force

    def speeds_towards(self, q: Vector, joint_rates: Vector, speeds: Vector,
                       settings: Mapping[str, Any], lanes: Any = Lanes) -> Vector:
        """
        Return the speed limits in the direction of motion: less next to joint limits.

        Parameters
        ----------
        q : (n_q,) array
            Positions.
        joint_rates : (n_j,) array
            Whose signs are the directions.
        speeds : (n_j,) array
            The limits far from the joint limits. Ball joints keep them.
        settings : mapping of str to array
            `STOPS`.
        lanes : class or object
            The functions of `Lanes`.

        """
        limits = np.array(speeds, dtype=object)
        stops = [settings[name] for name in STOPS]
        limits[self.joints] = by_entries(_speed_towards_stop, lanes, q[self.places],
                                         joint_rates[self.joints], limits[self.joints],
                                         *stops)
        return np.array(limits.tolist())

    def energy(self, q: Vector, settings: Mapping[str, Any]) -> Scalar:
        """Return the energy that the walls store, J."""
        total: Scalar = 0.0
        for k, place in enumerate(self.places):
            depth = _depth(q[place], settings['wall_lower'][k], settings['wall_upper'][k])
            total = total + 0.5 * settings['wall_stiffness'][k] * depth * depth
        return total

    def slopes(self, q: Array, settings: Mapping[str, Any]) -> tuple[Array, Array]:
        """
        Return stiffness and damping of the walls that act at q, (n_j,) each.

        The damping is that at the joint limit.
        """
        stiffness = np.zeros(self._joint_count)
        for k, (joint, place) in enumerate(zip(self.joints, self.places)):
            depth = _depth(q[place], settings['wall_lower'][k], settings['wall_upper'][k])
            if depth:
                stiffness[joint] = settings['wall_stiffness'][k]
        return stiffness, DAMPING * stiffness

    def reached(self, q: Array, settings: Mapping[str, Any]) -> list[str]:
        """Return the names of the joints on which a wall acts."""
        names = []
        for k, place in enumerate(self.places):
            depth = _depth(q[place], settings['wall_lower'][k], settings['wall_upper'][k])
            if depth and settings['wall_stiffness'][k]:
                names.append(self._names[k])
        return names


def _wall_force(position: Scalar, rate: Scalar, stiffness: Scalar, lower: Scalar,
                upper: Scalar, slope: Scalar) -> Scalar:
    """Return the force of the walls of one joint."""
    depth = _depth(position, lower, upper)
    # The damping, s, is DAMPING from the joint limit on.
    growing = slope * magnitude(depth)
    damping = select(growing > DAMPING, DAMPING, growing)
    return -(stiffness * (depth + damping * rate))


def _depth(position: Scalar, lower: Scalar, upper: Scalar) -> Scalar:
    """Return the distance of a position beyond the upper wall, or minus the lower one."""
    above = position - upper
    below = position - lower
    return select(above > 0.0, above, select(below < 0.0, below, 0.0))


def _speed_towards_stop(position: Scalar, rate: Scalar, speed: Scalar, lower: Scalar,
                        upper: Scalar, least_of_range: Scalar) -> Scalar:
    """Return the speed limit of one joint in the direction of its rate."""
    way = select(rate < 0.0, position - lower, upper - position)
    least = CREEPING * speed
    bound = select(speed < FREED, least_of_range, least)
    least = select(bound < least, bound, least)
    slow = way * (1.0 / STOPPING)
    slow = select(slow < least, least, slow)
    return select(slow < speed, slow, speed)
