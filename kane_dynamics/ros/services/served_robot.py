"""The robots and settings that serve requests."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.torque_path.gravity_payload import GravityAndPayload
from kane_dynamics.ros.torque_path.wrench_input import WrenchFrames


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
    values : mapping
        The node's parameters; gains.*, simulation.* and trajectory.max_points are used.
    frames : WrenchFrames
        Frames of `robot` at which a request may apply wrenches.

    """

    robot: Robot
    simulated: Robot
    loads: GravityAndPayload
    values: Mapping[str, Any]
    frames: WrenchFrames
