"""A guard refuses an arm that another guard guards, and an arm of other equations."""

import signal

from graph import URDF, wait_until
from std_msgs.msg import String

GUARD = 'kane_dynamics.ros.guard.main'
WATCHING, ANOTHER = 'watching kane_dynamics', 'another torque_guard guards this arm'


def guards(start, **parameters):
    return start(module=GUARD, **parameters)


def test_a_second_guard_waits_until_the_first_one_ends_and_one_of_another_arm_refuses(
        client, start):
    """The URDF comes by topic, where it changes while the node is active."""
    with client.describing() as description:
        description.publish(String(data=URDF))
        client.process = start(robot_description="''", guard__enabled=True)
        first = guards(start)
        first.wait_for(WATCHING)
        client.connect()
        second = guards(start)
        second.wait_for(ANOTHER)
        watched = second.log.count(WATCHING)  # until it finds the first one
        assert client.rest() is not None
        first.end(signal.SIGKILL)
        assert wait_until(lambda: second.log.count(WATCHING) > watched, 30.0), second.log
        description.publish(String(data=URDF.replace('mass value="3.0"', 'mass value="9.0"')))
        client.process.wait_for('robot_description: changed while the node is active')
        second.end(signal.SIGKILL)
        third = guards(start)
        third.wait_for('another arm than that of kane_dynamics')
        assert WATCHING not in third.log
