"""The robots and settings that serve requests."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.parameters.parameter_checks import per_joint
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

    """

    robot: Robot
    simulated: Robot
    loads: GravityAndPayload
    kp: Array
    kd: Array
    bounds: RequestLimits
    frames: WrenchFrames
    integrator: str

    @classmethod
    def from_values(cls, robot: Robot, simulated: Robot, loads: GravityAndPayload,
                    values: Mapping[str, Any], frames: WrenchFrames) -> 'ServedRobot':
        """Return a record with gains and bounds from the node's parameters."""
        kp, kd = (per_joint(values, name, robot.joint_names, 0.0)
                  for name in ('gains.kp', 'gains.kd'))
        return cls(robot, simulated, loads, kp, kd, RequestLimits(
            values['simulation.max_duration'], values['simulation.max_steps'],
            values['simulation.max_points'], values['trajectory.max_points']), frames,
            values['simulation.integrator'])
