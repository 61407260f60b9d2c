"""The robots and settings that serve requests."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from kane_dynamics.control.controller import Terms
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.parameters.parameter_checks import per_joint, terms
from kane_dynamics.ros.torque_path.gravity_payload import GravityAndPayload
from kane_dynamics.ros.torque_path.wrench_input import WrenchFrames


@dataclass(frozen=True)
class RequestLimits:
    """The largest requests that are served, from parameters simulation.* and trajectory.*."""

    max_duration: float
    max_steps: int
    max_points: int
    max_reference: int


@dataclass(frozen=True)
class FillSettings:
    """
    Settings of filled trajectories: parameters feedforward.*, compensate.* and limits.effort.

    Attributes
    ----------
    compensate : Terms
    effort_limit : (n,) array
        N m or N, in addition to that of the robot.
    tolerance, rest : (n,) arrays or None
        Largest error of the interpolated effort, N m or N, and positions of the joints that a
        trajectory lacks, rad or m; None if not set.
    clip : bool
        Clamp efforts instead of rejecting a trajectory.

    """

    compensate: Terms
    effort_limit: Array
    tolerance: Array | None
    rest: Array | None
    clip: bool

    @classmethod
    def from_values(cls, values: Mapping[str, Any], joints: Sequence[str]) -> 'FillSettings':
        """Return the settings of the parameters; raise InputError if one does not fit."""
        def if_set(name: str) -> Array | None:
            return per_joint(values, name, joints, 0.0) if values[name].shape != (0,) else None
        return cls(terms(values), per_joint(values, 'limits.effort', joints, math.inf),
                   if_set('feedforward.tolerance'), if_set('feedforward.rest'),
                   values['feedforward.clip'])


@dataclass(frozen=True)
class ServedRobot:
    """
    The robots, loads and settings that serve requests.

    Attributes
    ----------
    robot, simulated : Robot
        The robots of the services' thread and of the simulation thread.
    loads : GravityAndPayload
        Gravity and payload, applied to a robot before each request.
    kp, kd : (n,) arrays
        Default gains of the computed torque, 1/s^2 and 1/s.
    bounds : RequestLimits
    frames : WrenchFrames
        Frames of `robot` at which a request may apply wrenches.
    integrator : str
        Integrator of simulations, from parameter simulation.integrator.
    fill : FillSettings
    bending : QuasiStatic or None
        The flexible arm of which `robot` is the rigid model, for filled trajectories.
    measured : callable
        Returns the measured positions, (n,), or None.

    """

    robot: Robot
    simulated: Robot
    loads: GravityAndPayload
    kp: Array
    kd: Array
    bounds: RequestLimits
    frames: WrenchFrames
    integrator: str
    fill: FillSettings
    bending: QuasiStatic | None
    measured: Callable[[], Array | None]

    def apply_loads(self) -> None:
        """Set gravity and payload of the robots of the services' thread."""
        self.loads.apply(self.robot)
        if self.bending is not None:
            self.loads.apply(self.bending.robot)

    @classmethod
    def from_values(cls, robot: Robot, simulated: Robot, loads: GravityAndPayload,
                    values: Mapping[str, Any], frames: WrenchFrames,
                    bending: QuasiStatic | None = None,
                    measured: Callable[[], Array | None] = lambda: None) -> 'ServedRobot':
        """Return a record with gains, bounds and settings from the node's parameters."""
        kp, kd = (per_joint(values, name, robot.joint_names, 0.0)
                  for name in ('gains.kp', 'gains.kd'))
        return cls(robot, simulated, loads, kp, kd, RequestLimits(
            values['simulation.max_duration'], values['simulation.max_steps'],
            values['simulation.max_points'], values['trajectory.max_points']), frames,
            values['simulation.integrator'], FillSettings.from_values(values, robot.joint_names),
            bending, measured)
