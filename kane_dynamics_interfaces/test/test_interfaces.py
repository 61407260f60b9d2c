"""Every interface exists, and survives serialisation."""

from kane_dynamics_interfaces.action import SimulateMotion
from kane_dynamics_interfaces.srv import ForwardDynamics, GetDynamics, InverseDynamics, Simulate
import pytest
from rclpy.serialization import deserialize_message, serialize_message

PARTS = [part for service in (ForwardDynamics, GetDynamics, InverseDynamics, Simulate)
         for part in (service.Request, service.Response)]
PARTS += [SimulateMotion.Goal, SimulateMotion.Result, SimulateMotion.Feedback]


@pytest.mark.parametrize('part', PARTS, ids=lambda part: part.__name__)
def test_messages_come_back_as_they_went(part):
    message = part()
    for name, kind in part.get_fields_and_field_types().items():
        if kind == 'sequence<double>':
            setattr(message, name, [1.5, -2.5])
        elif kind == 'string':
            setattr(message, name, 'words')
        elif kind == 'double':
            setattr(message, name, 0.25)
    assert deserialize_message(serialize_message(message), part) == message


def test_torque_sources_are_told_apart():
    sources = {Simulate.Request.ZERO, Simulate.Request.TABLE, Simulate.Request.COMPUTED_TORQUE}
    assert len(sources) == 3
    assert SimulateMotion.Goal.COMPUTED_TORQUE == Simulate.Request.COMPUTED_TORQUE
