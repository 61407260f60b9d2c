"""Read the goals of FollowJointTrajectory from bytes, and refuse what is not followed."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.cdr import Reader
from kane_dynamics.ros.inputs.trajectory_input import (CdrTime, next_trajectory,
                                                       ReceivedTrajectory)

# The fields of a goal, in the order of their bytes.
GOAL_FIELDS = ('trajectory', 'multi_dof_trajectory', 'path_tolerance',
               'component_path_tolerance', 'goal_tolerance', 'component_goal_tolerance',
               'goal_time_tolerance')
FORMATS = {'double': 'd', 'uint16': 'H'}  # of `struct`
UUID_SIZE = 16  # bytes, of the identifier before the goal
COORDINATES = ('planar and floating joints have the coordinates <joint>/x and so on in '
               '`trajectory`')


@dataclass(frozen=True, eq=False)
class TrajectoryGoal:
    """The part of a goal that is used; tolerances are dicts of their fields."""

    trajectory: ReceivedTrajectory
    path_tolerance: list[dict[str, Any]]
    goal_tolerance: list[dict[str, Any]]
    goal_time_tolerance: CdrTime


class GoalReader:
    """
    Reads serialized goals.

    Parameters
    ----------
    action_type : type
        The action, whose tolerances have other fields in newer releases.

    Raises
    ------
    InputError
        The action has other fields.

    """

    def __init__(self, action_type: Any) -> None:
        fields = tuple(action_type.Goal.get_fields_and_field_types())
        if fields != GOAL_FIELDS:
            raise InputError(f'fields of {action_type.__name__}.Goal: '
                             f'{", ".join(fields)}; expected {", ".join(GOAL_FIELDS)}')
        tolerance_type = _element_type(action_type, 'path_tolerance')
        self._tolerance_fields = tolerance_type.get_fields_and_field_types()

    def read(self, data: bytes, max_points: int) -> TrajectoryGoal:
        """
        Return the goal of a serialized request.

        Raises
        ------
        InputError
            The request is not valid CDR, has too many points, or has a trajectory or
            tolerances of joints with several degrees of freedom.

        """
        reader = Reader(data)
        reader.advance(1, UUID_SIZE)
        trajectory = next_trajectory(reader, max_points)
        self._refuse_multi_dof(reader)
        path = self._tolerances(reader)
        self._refuse_components(reader, 'component_path_tolerance')
        goal = self._tolerances(reader)
        self._refuse_components(reader, 'component_goal_tolerance')
        return TrajectoryGoal(trajectory, path, goal, CdrTime(*reader.pair()))

    def _tolerances(self, reader: Reader) -> list[dict[str, Any]]:
        """Read a sequence of JointTolerance."""
        tolerances = []
        for _ in range(reader.word()):
            tolerance: dict[str, Any] = {}
            for field, kind in self._tolerance_fields.items():
                is_text = kind == 'string'
                tolerance[field] = (reader.text() if is_text
                                    else reader.number(FORMATS[kind]))
            tolerances.append(tolerance)
        return tolerances

    def _refuse_multi_dof(self, reader: Reader) -> None:
        """Read a MultiDOFJointTrajectory, and refuse one that is not empty."""
        reader.pair()
        reader.text()
        names = reader.texts()
        points = reader.word()
        if names or points:
            raise InputError(f'multi_dof_trajectory: {len(names)} joints, {points} '
                             f'points; expected none, as {COORDINATES}')

    def _refuse_components(self, reader: Reader, field: str) -> None:
        """Read a sequence of JointComponentTolerance, and refuse one that is not empty."""
        count = reader.word()
        if count:
            raise InputError(f'{field}: {count} entries; expected none, as '
                             f'{COORDINATES}')


def _element_type(action_type: Any, field: str) -> Any:
    """Return the class of the elements of a sequence of the goal."""
    # Of the elements rosidl gives the name: sequence<control_msgs/JointTolerance>.
    name = action_type.Goal.get_fields_and_field_types()[field]
    package, kind = name.removeprefix('sequence<').removesuffix('>').split('/')
    return getattr(import_module(f'{package}.msg'), kind)
