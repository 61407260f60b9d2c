"""Frames of tf2 and attached objects of MoveIt, over DDS, with test packages."""

import os
from pathlib import Path
import time

from geometry_msgs.msg import TransformStamped, WrenchStamped
from kane_dynamics import Inertial, Robot
from moveit_messages import imported_tf_and_moveit
from node_process import model, wait_until
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from shape_msgs.msg import SolidPrimitive

pytestmark = pytest.mark.timeout(900)  # the packages are built at the first run
Q = np.array([0.3, -0.4, 0.2])
STATIC = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FORCE = np.array([3.0, -2.0, 5.0])


@pytest.fixture(scope='module', autouse=True)
def packages():
    with imported_tf_and_moveit():
        yield


def commands(client, expected, tolerance=1e-9, timeout=10.0):
    """Return whether the node answers states with these torques before long."""
    def answers():
        client.send(Q, np.zeros(3))
        time.sleep(0.005)
        return client.commands and np.abs(
            client.commands[-1] - expected).max() < tolerance
    return wait_until(answers, timeout)


def transform(parent, child, at, client, old=0.0):
    """Return a transform with the axes of the parent turned by a right angle about z."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    stamp = client.get_clock().now().nanoseconds - round(old * 1e9)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    p = message.transform.translation
    r = message.transform.rotation
    p.x, p.y, p.z = at
    r.z, r.w = np.sin(np.pi / 4), np.cos(np.pi / 4)
    return message


def test_wrenches_in_frames_of_tf_act_on_the_declared_frame_of_their_body(client, start):
    from tf2_msgs.msg import TFMessage
    static = client.create_publisher(TFMessage, '/tf_static', STATIC)
    moving = client.create_publisher(TFMessage, '/tf', 10)
    # Published before the node starts: a bracket on link c, the sensor on the bracket.
    static.publish(
        TFMessage(transforms=[transform('c', 'bracket', (0.0, 0.0, 0.1), client),
                              transform('bracket', 'sensor', (0.2, 0.0, 0.0), client)]))
    node = start(tf__enabled='true', wrench__frames='[c]')
    node.wait_for('active, mode', 240.0)
    client.connect()
    hold = Robot(model()).gravity_force(Q)
    assert commands(client, hold), (client.commands[-1:], node.log)
    wrench = client.create_publisher(WrenchStamped, 'kane_dynamics/wrench', 10)
    assert wait_until(lambda: wrench.get_subscription_count() == 1)

    def press(frame):
        message = WrenchStamped()
        message.header.frame_id = frame
        message.header.stamp = client.get_clock().now().to_msg()
        f = message.wrench.force
        f.x, f.y, f.z = FORCE
        wrench.publish(message)

    # Half a turn in all; the sensor is 0.2 m along the axes of the bracket, turned once.
    R = np.diag([-1.0, -1.0, 1.0])
    p = np.array([0.0, 0.2, 0.1])
    robot = Robot(model(), wrench_frames=('c',))
    of_link = robot.frame_pose('c', Q)[:3, :3]
    load = np.concatenate([of_link @ R @ FORCE, of_link @ np.cross(p, R @ FORCE)])
    expected = hold - robot.external_force(Q, wrench=load[None])

    def compensates():
        press('sensor')
        client.send(Q, np.zeros(3))
        time.sleep(0.005)
        return client.commands and np.abs(client.commands[-1] - expected).max() < 1e-9
    assert wait_until(compensates), (client.commands[-1:], expected, node.log)
    # A frame that moves in tf2 is refused once its transform is stale, and the load
    # ends.
    moving.publish(
        TFMessage(transforms=[transform('c', 'probe', (0.0, 0.0, 0.0), client, 3.0)]))
    assert wait_until(lambda: press('probe') or 's old; expected at most' in node.log)
    assert wait_until(lambda: press('camera') or "frame 'camera'" in node.log)
    moving.publish(
        TFMessage(transforms=[transform('sensor', 'bracket', (0.0,) * 3, client)]))
    assert wait_until(lambda: 'a cycle; expected a tree of frames' in node.log)
    assert commands(client, hold)


def attached(mass_of, *, size=0.1, link='c', at=(0.0, 0.0, 0.05)):
    """Return an AttachedCollisionObject: a cube."""
    from moveit_msgs.msg import AttachedCollisionObject
    message = AttachedCollisionObject(link_name=link)
    shape = message.object
    shape.id, shape.operation, shape.header.frame_id = mass_of, shape.ADD, link
    p = shape.pose.position
    p.x, p.y, p.z = at
    shape.primitives = [SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[size] * 3)]
    shape.primitive_poses = [type(shape.pose)()]
    return message


def test_attached_objects_are_payload_until_they_are_detached(client, start):
    from moveit_msgs.msg import PlanningScene
    from moveit_msgs.srv import GetPlanningScene
    asked = []

    def answer(request, response):
        asked.append(request.components.components)
        response.scene.robot_state.attached_collision_objects = [attached('first')]
        return response
    service = client.create_service(GetPlanningScene, '/get_planning_scene', answer)
    node = start(attached_objects__topic='/monitored_planning_scene', payload__frame='c',
                 payload__mass='0.5', payload__com='[0.0, 0.1, 0.0]',
                 attached_objects__masses="['first:=1.5']",
                 attached_objects__density='800.0', mode='gravity_compensation')
    node.wait_for('active, mode', 240.0)
    client.connect()
    robot = Robot(model(), payload_frame='c')
    tool = Inertial(0.5, np.array([0.0, 0.1, 0.0]))

    def torques(*loads):
        robot.parameters.payload = sum(loads, tool)
        return robot.gravity_force(Q)
    cube = Inertial(1.5, np.array([0.0, 0.0, 0.05]))  # gravity needs no inertia
    assert commands(client, torques(cube)), (client.commands[-1:], node.log)
    assert asked == [4]
    scene = client.create_publisher(PlanningScene, '/monitored_planning_scene', 10)
    assert wait_until(lambda: scene.get_subscription_count() == 1)

    def publish(*objects, diff=True):
        message = PlanningScene(is_diff=diff)
        message.robot_state.is_diff = diff
        message.robot_state.attached_collision_objects = list(objects)
        scene.publish(message)
    # Another one, of density and volume; one of another link has no effect, with the
    # reason.
    publish(attached('second', at=(0.0, 0.2, 0.0)), attached('third', link='a'))
    second = Inertial(0.8, np.array([0.0, 0.2, 0.0]))
    assert commands(client, torques(cube, second)), (client.commands[-1:], node.log)
    assert wait_until(
        lambda: "object 'third': frame: 'a', not fixed to the body" in node.log)
    # Changes of the state alone have no objects: nothing is detached.
    publish()
    time.sleep(0.3)
    assert commands(client, torques(cube, second))
    gone = attached('first')
    gone.object.operation = gone.object.REMOVE
    publish(gone)
    assert commands(client, torques(second))
    assert client.adjust(attached_objects__density=0.0).successful
    assert commands(client, torques())
    assert ("object 'second': no mass; expected one in attached_objects.masses"
            in node.log)
    assert client.adjust(attached_objects__density=400.0).successful
    assert commands(client, torques(Inertial(0.4, np.array([0.0, 0.2, 0.0]))))
    publish(diff=False)  # a whole scene without objects
    assert commands(client, torques())
    client.destroy_service(service)


def test_without_the_packages_the_node_warns_and_works(start, monkeypatch):
    # The packages for tests alone leave the path; others, such as of a workspace, stay.
    folders = os.environ.get('PYTHONPATH', '').split(os.pathsep)
    others = []
    for folder in folders:
        if not any((Path(folder) / name).exists()
                   for name in ('tf2_msgs', 'moveit_msgs')):
            others.append(folder)
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join(others))
    node = start(tf__enabled='true', attached_objects__topic='/scene',
                 payload__frame='c')
    node.wait_for('active, mode', 120.0)
    assert "parameter 'tf.enabled': true without tf2_msgs/TFMessage" in node.log
    assert ("parameter 'attached_objects.topic': set without moveit_msgs/PlanningScene"
            in node.log)


def test_masses_that_are_no_masses_are_refused(start):
    node = start(attached_objects__masses='[cup]')
    node.wait_for("'cup'; expected object:=mass, kg, at least 0", 120.0)
