"""The first command to an arm that compensates gravity, and the guard's: over DDS."""

import signal

from guard_rig import PLANT_ARM, Rig
from kane_dynamics._util.resources import resource_path
from node_process import DEEP, Process, wait_until
import numpy as np
import pytest
from sensor_msgs.msg import JointState

PLANT = 'kane_dynamics.ros.plant.main'
UR10E = str(resource_path('config', 'ur10e.yaml'))
WATCHED = 500  # joint states after the first command: one second


@pytest.fixture
def states(client):
    """Return a function that starts a UR10e and a node; it returns the joint states."""
    running = []
    received = []
    subscription = client.create_subscription(
        JointState, 'joint_states', lambda message: received.append(
            (np.array(message.position), np.array(message.effort))), DEEP)

    def run(*arguments):
        node = Process('--params-file', UR10E, *arguments)
        running.append(node)
        node.wait_for('active, mode')
        running.append(
            Process('--params-file', str(resource_path('config', 'plant.yaml')),
                    '-p', 'command_timeout:=100.0', '-p', 'after_timeout:=hold',
                    module=PLANT))
        running[1].wait_for('joint states/s')
        assert wait_until(lambda: client.commands, 20.0), node.log
        count = len(received)
        assert wait_until(lambda: len(received) > count + WATCHED, 20.0)
        return received, node
    yield run
    client.destroy_subscription(subscription)
    for process in running:
        process.end()


def test_the_shipped_way_leaves_an_arm_that_holds_itself_where_it_is(states):
    received, node = states()
    positions = np.array([q for q, _ in received])
    np.testing.assert_allclose(positions, positions[:1].repeat(len(positions), 0),
                               atol=1e-9)
    assert np.abs([effort for _, effort in received]).max() < 1e-6
    assert 'count twice' not in node.log


def test_gravity_twice_throws_the_arm_and_the_node_warns_of_it(states):
    """The fault that the shipped way prevents: the same arm with the wrong statement."""
    received, node = states('-p', 'arm_compensates:=none', '-p',
                            'mode:=gravity_compensation')
    assert np.abs(received[-1][0] - received[0][0]).max() > 0.05
    assert ('arm_compensates: none, where gravity would count twice; expected gravity'
            in node.log)


def test_a_node_that_is_not_told_what_the_arm_adds_does_not_configure(client, start):
    node = start('-p', f'urdf:={resource_path("urdf", "fr3.urdf")}',
                 robot_description="''", arm_compensates=None)
    node.wait_for("parameter 'arm_compensates': not stated; expected what the arm adds")
    assert 'fr3 is known: gravity, friction for Franka Robotics' in node.log
    assert client.state() == 'unconfigured'


@pytest.mark.slow  # arm, node, guard and test share the processors in real time
def test_after_a_kill_in_motion_the_guard_stops_an_arm_that_holds_itself(tmp_path):
    rig = Rig(tmp_path, PLANT_ARM, arm_compensates='gravity')
    try:
        rig.move()
        recorder = rig.recorder
        rig.node.end(signal.SIGKILL)
        recorder.spin(1.5)  # 30 time constants of the damping
        assert recorder.of('guard'), rig.logs()
        stopped = recorder.states[-1]
        assert np.abs(stopped[2]).max() < 1e-3
        recorder.spin(0.5)
        np.testing.assert_allclose(recorder.states[-1][1], stopped[1], atol=1e-3)
        # No gravity: that is up to 40.
        assert np.abs(recorder.of('guard')[-1].tau).max() < 1.0
    finally:
        rig.close()
