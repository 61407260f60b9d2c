"""Records that the plant of the demo saved, and its arm, for the reports."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar, Self

from kane_dynamics._util.typing import Array
from kane_dynamics.demo.demo_settings import DemoRobot
from kane_dynamics.loop_tracking.driven_mechanism import closed_configurations
from kane_dynamics.mechanics.constraints.yaml_file import load_constraints
from kane_dynamics.robot.robot import Robot
from kane_dynamics.urdf import load_urdf
import numpy as np


class SavedRecord:
    """Base of dataclasses whose fields are arrays that the plant saved."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @classmethod
    def load(cls, path: Path) -> Self:
        """Load the record that the plant saved."""
        with np.load(path) as file:
            return cls(**{name: file[name] for name in cls.__dataclass_fields__})


def loaded_arm(robot: DemoRobot) -> Robot:
    """Return the robot of the demo, with its constraints if it has closed loops."""
    if robot.constraints is None:
        return Robot(load_urdf(robot.urdf, joints=robot.joints))
    return Robot(load_urdf(robot.urdf), **load_constraints(robot.constraints))


def closed_along(arm: Robot, joints: Sequence[str], q: Array) -> Array:
    """
    Return all coordinates along positions of the joints with motors, (K, n_q).

    Loops are closed from one configuration to the next.
    """
    driving = list(map(arm.coordinate_names.index, joints))
    return closed_configurations(arm, driving, np.zeros(len(q)), q)
