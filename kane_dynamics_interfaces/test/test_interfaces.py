"""Every interface exists, and survives serialisation."""

from pathlib import Path

from ament_index_python import get_package_share_directory
from geometry_msgs.msg import Inertia, Point, Pose, Vector3, Wrench, WrenchStamped
from kane_dynamics_interfaces.action import SimulateMotion
from kane_dynamics_interfaces.msg import PayloadEstimate, TaskState, TorqueExplanation
from kane_dynamics_interfaces.srv import (Explain, ForwardDynamics, GetDynamics,
                                          InverseDynamics, SetPayload, Simulate)
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

PARTS = [part for service in (Explain, ForwardDynamics, GetDynamics,
                              InverseDynamics, SetPayload, Simulate)
         for part in (service.Request, service.Response)]
PARTS += [SimulateMotion.Goal, SimulateMotion.Result, SimulateMotion.Feedback,
          TorqueExplanation, TaskState, PayloadEstimate]

VALUES = {
    'boolean': True, 'double': 0.25, 'sequence<double>': [1.5, -2.5e300],
    'sequence<string>': ['a', 'b'], 'string': 'words', 'uint8': 2, 'uint32': 3,
    'geometry_msgs/Pose': Pose(position=Point(x=1.0)),
    'geometry_msgs/Vector3': Vector3(y=2.0),
    'geometry_msgs/Wrench': Wrench(torque=Vector3(z=3.0)),
    'geometry_msgs/Inertia': Inertia(m=2.0, ixy=0.5),
    'sequence<geometry_msgs/Wrench>': [Wrench(force=Vector3(x=1.0))],
    'sequence<geometry_msgs/WrenchStamped>': [
        WrenchStamped(header=Header(frame_id='tip'))],
    'kane_dynamics_interfaces/TorqueExplanation': TorqueExplanation(joint_names=['a']),
    'std_msgs/Header': Header(frame_id='tip'),
    'trajectory_msgs/JointTrajectory': JointTrajectory(joint_names=['a'])}


@pytest.mark.parametrize('part', PARTS, ids=lambda part: part.__name__)
def test_messages_come_back_as_they_went(part):
    message = part()
    for name, kind in part.get_fields_and_field_types().items():
        setattr(message, name, VALUES[kind])
        assert getattr(message, name) != getattr(part(), name)
    assert deserialize_message(serialize_message(message), part) == message


@pytest.mark.parametrize('part', PARTS, ids=lambda part: part.__name__)
def test_every_answer_says_whether_and_why_not(part):
    fields = part.get_fields_and_field_types()
    answers = part.__name__.endswith(('_Response', '_Result'))
    assert (fields.get('success') == 'boolean') == answers
    assert (fields.get('message') == 'string') == answers


def test_action_asks_and_answers_as_the_service_does():
    pairs = ((SimulateMotion.Goal, Simulate.Request),
             (SimulateMotion.Result, Simulate.Response))
    for action, service in pairs:
        assert (action.get_fields_and_field_types()
                == service.get_fields_and_field_types())


@pytest.mark.parametrize('part', [Simulate.Request, SimulateMotion.Goal])
def test_torque_sources_are_the_documented_numbers(part):
    assert (part.ZERO, part.TABLE, part.COMPUTED_TORQUE) == (0, 1, 2)


def test_interface_files_are_installed_with_their_comments():
    installed = Path(get_package_share_directory('kane_dynamics_interfaces'))
    sources = Path(__file__).parents[1]
    files = [file for folder in ('action', 'msg', 'srv')
             for file in (sources / folder).iterdir()]
    assert len(files) == 10
    for file in files:
        assert (installed / file.relative_to(sources)).read_text() == file.read_text()
