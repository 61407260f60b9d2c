"""Result of `time_optimal`: the motion, its torques and its use of the limits."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.path_limits import Bounds
from kane_dynamics.feasibility.samples import MOST_SAMPLES, STEP
from kane_dynamics.feasibility.torque_demand import Demand, demand, share
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.parameters import JointLimits, Parameters
from kane_dynamics.robot.robot import Robot
import numpy as np

ACTIVE = 0.99  # least share of a limit that is active


class ActiveLimit(NamedTuple):
    """An interval of time in which a limit of a joint is used most, by 99 % or more."""

    start: float
    end: float
    joint: str
    limit: str  # a name in `TimeOptimal.uses`


@dataclass(frozen=True, eq=False)
class TimeOptimal:
    """
    Fastest motion along a path.

    With chosen speeds or constraints, `motion` is of the driving joints. Everything else
    is of all joints, in the order of `joint_names`, as in `Demand`; torques are those of
    `Robot.joint_torques`, zero at joints without actuators.

    Attributes
    ----------
    motion : Motion
        The motion, with continuous accelerations between rests.
    points : ControllerPoints
        Its K points for a controller that interpolates quintics: at the two points of a
        rest between sections, the accelerations before and after it.
    tau : (K, n) array
        Torques at the points of the motion, N m or N.

    """

    motion: Motion
    points: ControllerPoints
    tau: Array
    _robot: Robot
    _parameters: Parameters  # of the call, as are the limits
    _limits: JointLimits
    _bounds: Bounds
    _rate_uses: dict[str, Array]

    @cached_property
    def uses(self) -> dict[str, Array]:
        """
        Return the shares of the limits at the points of the motion, (K, n) arrays.

        They are of effort, velocity, power, acceleration, jerk and torque_rate, where
        limited; of the last two the larger one on both sides of a point.
        """
        _, _, u, udot = self.points
        quantities = self.tau, u, self.tau * u, udot
        uses = {}
        for name, values, bound in zip(Bounds._fields, quantities, self._bounds):
            if np.isfinite(bound).any():
                uses[name] = share(np.abs(values), bound)
        return uses | self._rate_uses

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Return the names of the columns of points, torques and uses: all joints."""
        return self._robot.joint_names

    @property
    def duration(self) -> float:
        """Return the duration, s."""
        return self.motion.duration

    @property
    def demand(self) -> Demand:
        """Return torque, speed and power of the motion, with the limits."""
        robot = self._robot.copy()  # has its own payload
        robot.parameters.assign(self._parameters)
        robot.limits = self._limits
        step = max(STEP, 4.0 * self.duration / MOST_SAMPLES)
        return demand(robot, self.motion, step=step, power=self._bounds.power)

    @property
    def active(self) -> tuple[ActiveLimit, ...]:
        """Return the limits that bound the motion, in order of time."""
        names = self.joint_names
        limits = tuple(self.uses)
        uses = np.stack([self.uses[name] for name in limits], axis=1)
        uses = uses.reshape(len(self.tau), -1)
        # The number of the limit and joint that are used most, -1 for none.
        number = np.where(uses.max(axis=1) >= ACTIVE, uses.argmax(axis=1), -1)
        # Neighboring points with the same limit and joint are one stretch.
        starts = np.flatnonzero(np.diff(number, prepend=-2))
        ends = np.append(starts[1:], len(number)) - 1
        active = []
        for start, end in zip(starts.tolist(), ends.tolist()):
            if number[start] >= 0:
                limit, joint = divmod(int(number[start]), len(names))
                active.append(ActiveLimit(
                    float(self.points.t[start]), float(self.points.t[end]),
                    names[joint], limits[limit]))
        return tuple(active)
