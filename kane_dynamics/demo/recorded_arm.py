"""Records that the plant of the demo saved, and its arm, for the reports."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar, Self

from kane_dynamics._util.typing import Array
from kane_dynamics.demo.demo_settings import DemoRobot
from kane_dynamics.loop_tracking.loop_tracker import LoopTracker
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


def closed_along(arm: Robot, joints: Sequence[str], q: Array, u: Array) -> Array:
    """
    Return all coordinates along states of the joints with motors, (K, n_q).

    Loops are closed from one configuration to the next.
    """
    if not arm.constraint_names:
        return q
    tracker = LoopTracker(arm, joints)
    coordinates = []
    for positions, speeds in zip(q, u, strict=True):
        tracker.update(positions, speeds)
        coordinates.append(tracker.q.copy())
    return np.array(coordinates)
