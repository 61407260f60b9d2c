"""What anybody on the ROS graph may send: descriptions, and transitions at any time."""

from pathlib import Path
import subprocess
import sys

import pytest

pytest.importorskip('rclpy')

from kane_dynamics._util.resources import resource_path  # noqa: E402, I100
from kane_dynamics.errors import InputError, UrdfError  # noqa: E402
from kane_dynamics.ros.common.configuration_files import (  # noqa: E402
    load_model, MAX_URDF_BYTES)
from node_values import node_values  # noqa: E402

VALUES = node_values({})
URDF = resource_path('urdf', 'two_link.urdf')


def loaded(text):
    """Return the model of a text as a topic sends it."""
    return load_model(text, VALUES, lambda warning: None)


@pytest.mark.parametrize('text', ['/etc/passwd', str(URDF), 'arm.urdf.xacro',
                                  'file:///etc/passwd', '', 'text <robot name="r"/>'])
def test_a_description_is_a_text_and_never_a_path(text):
    with pytest.raises(InputError, match='expected the URDF as XML text') as refused:
        loaded(text)
    assert 'root:' not in str(refused.value)
    assert loaded(URDF.read_text()).n == 2


def test_a_description_reads_no_other_file(tmp_path):
    secret = tmp_path / 'secret.xacro'
    secret.write_text('<robot name="secret"><link name="a"/></robot>')
    text = ('<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
            f'<xacro:include filename="{secret}"/><link name="a"/></robot>')
    with pytest.raises(UrdfError, match='xacro:include') as refused:
        loaded(text)
    assert 'expected the output of xacro' in str(refused.value)


def test_a_description_is_bounded():
    text = URDF.read_text()
    with pytest.raises(InputError, match=f'expected at most {MAX_URDF_BYTES}'):
        loaded(text + ' ' * MAX_URDF_BYTES)


def test_a_robot_without_joints_is_refused_in_words():
    with pytest.raises(InputError, match='no joint that moves; expected at least one'):
        loaded('<robot name="r"><link name="only"/></robot>')


PROGRAM = """
import rclpy
from kane_dynamics.ros.dynamics_node.node import DynamicsNode

given = ('urdf:=URDF', 'arm_compensates:=none', 'activation:=on_request',
         'autostart:=false', 'torque_path:=native')
rclpy.init(args=['--ros-args', *[x for one in given for x in ('-p', one)]])
node = DynamicsNode()
counts = []
for _ in range(3):
    node.trigger_configure()
    node.trigger_cleanup()
    counts.append((len(list(node.subscriptions)), len(list(node.waitables)),
                   len(list(node.timers)), len(list(node.publishers))))
print(counts[0] == counts[1] == counts[2], counts)
node.halt()
rclpy.shutdown()
"""


def test_a_node_that_is_cleaned_up_leaves_nothing_behind():
    """Events of the thread's subscription stayed, and failed at the next transition."""
    done = subprocess.run([sys.executable, '-c', PROGRAM.replace('URDF', str(URDF))],
                          capture_output=True, text=True, timeout=100,
                          cwd=Path(__file__).parents[3])
    assert done.stdout.startswith('True'), done.stdout + done.stderr
