"""Parameters qos_overrides: which topics they change, and with which values."""

from kane_dynamics.errors import InputError
import pytest

rclpy = pytest.importorskip('rclpy')

from kane_dynamics.ros.common.qos import (BEST_EFFORT, overridable,  # noqa: E402, I100
                                          OVERRIDES, overrides_of)
from rclpy.parameter import Parameter  # noqa: E402
from std_msgs.msg import String  # noqa: E402


@pytest.mark.parametrize(('policy', 'value', 'expected'), [
    ('reliability', 'reliabel', 'reliable, best_effort'),
    ('history', 'keep', 'keep_last'),
    ('depth', 0, 'at least 1'), ('depth', '5', 'at least 1'),
    ('reliability', 1, 'best_effort')])
def test_a_quality_of_service_that_does_not_exist_is_refused(policy, value, expected):
    name = f'qos_overrides./states.subscription.{policy}'
    with pytest.raises(InputError, match=f'{policy}.: {value!r}; expected .*{expected}'):
        overrides_of({name: value}, ['/states.subscription'])


def test_overrides_of_other_topics_and_policies_are_told_apart():
    used = {f'qos_overrides./states.subscription.{policy}': value for policy, value in (
        ('reliability', 'RELIABLE'), ('history', 'keep_last'), ('depth', 3))}
    unused = ['qos_overrides./typo.subscription.depth',
              'qos_overrides./states.publisher.depth',
              'qos_overrides./states.subscription.durability', 'qos_overrides.depth']
    parameters = used | dict.fromkeys(unused, 'volatile') | {'mode': 'computed_torque'}
    assert overrides_of(parameters, ['/states.subscription']) == (list(used), unused)


def test_an_override_of_one_topic_leaves_the_profile_of_the_others():
    context = rclpy.Context()
    rclpy.init(context=context)
    asked = Parameter('qos_overrides./states.subscription.depth', value=77)
    node = rclpy.create_node('overridden', context=context, parameter_overrides=[asked])
    depth = BEST_EFFORT.depth
    changed = node.create_subscription(String, 'states', print, overridable(BEST_EFFORT),
                                       qos_overriding_options=OVERRIDES)
    assert changed.qos_profile.depth == 77
    assert BEST_EFFORT.depth == depth
    node.destroy_node()
    rclpy.shutdown(context=context)
