"""Promises of `kane-dynamics fill`: efforts for trajectories in files and bags."""

import json
from pathlib import Path

from command_in_process import command
from kane_dynamics import load_urdf, Robot, Terms
from kane_dynamics.cli.tables import read_states
from kane_dynamics.control.trajectory_feedforward import fill_trajectory
from kane_dynamics.identification.recordings.bag import bag_messages
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
import yaml

URDF = Path(__file__).resolve().parents[2] / 'urdf' / 'two_link.urdf'
TIMES = [0.0, 0.5, 1.0]
POINTS = [[0.0, 0.0], [0.4, -0.2], [0.6, 0.1]]
ECHO = """header:
  stamp:
    sec: 0
    nanosec: 0
  frame_id: ''
joint_names:
- joint2
- joint1
points:
- positions: [0.0, 0.0]
  velocities: []
  accelerations: []
  effort: []
  time_from_start: {sec: 0, nanosec: 0}
- positions: [-0.2, 0.4]
  velocities: []
  accelerations: []
  effort: []
  time_from_start: {sec: 0, nanosec: 500000000}
- positions: [0.1, 0.6]
  velocities: []
  accelerations: []
  effort: []
  time_from_start: {sec: 1, nanosec: 0}
---
"""


@pytest.fixture(scope='module')
def robot():
    return Robot(load_urdf(URDF))


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / 'plan.yaml'
    path.write_text(ECHO)  # as `ros2 topic echo` prints it
    return path


def test_efforts_with_gravity_for_an_arm_that_adds_it_give_a_warning(tmp_path):
    plan = tmp_path / 'plan.csv'
    arm = URDF.with_name('ur10e.urdf')
    names = load_urdf(arm).joint_names
    plan.write_text('t,' + ','.join(f'q.{name}' for name in names) + '\n'
                    '0,0,-1.2,1.4,-1.7,-1.57,0\n1,0.1,-1.2,1.4,-1.7,-1.57,0\n')
    arguments = ('fill', str(arm), '--motion', str(plan), '--json')
    done = command(*arguments)
    assert done.returncode == 0, done.stderr
    assert ('--without: none, where gravity would count twice; expected gravity'
            in done.stderr)
    without = command(*arguments, '--without', 'gravity', 'friction')
    assert 'warning' not in without.stderr


def test_output_of_topic_echo_becomes_a_trajectory_with_all_fields(plan, robot):
    out = plan.with_name('filled.yaml')
    done = command('fill', str(URDF), '--motion', str(plan), '--out', str(out),
                   '--tolerance', '0.05', '--json')
    assert done.returncode == 0, done.stderr
    expected = fill_trajectory(robot, TIMES, POINTS, tolerance=0.05)
    data, = json.loads(done.stdout)
    written = yaml.safe_load(out.read_text())
    assert written['joint_names'] == data['joint_names'] == ['joint2', 'joint1']
    for name, expected_rows in (('positions', expected.positions),
                                ('velocities', expected.velocities),
                                ('accelerations', expected.accelerations),
                                ('effort', expected.efforts)):
        np.testing.assert_allclose([point[name] for point in written['points']],
                                   expected_rows[:, ::-1], rtol=0, atol=1e-12)
    assert [point['time_from_start'] for point in written['points']][-1] == {
        'sec': 1, 'nanosec': 0}
    assert data['inserted'] == expected.inserted > 0
    assert max(data['effort_error']) <= 0.05


def test_a_table_and_terms_that_the_arm_adds(plan, robot, tmp_path):
    out = tmp_path / 'filled.csv'
    again = tmp_path / 'again.csv'
    for source, target in ((plan, out), (out, again)):
        done = command('fill', str(URDF), '--motion', str(source), '--out', str(target),
                       '--without', 'gravity', '--joints', 'joint2', 'joint1')
        assert done.returncode == 0, done.stderr
        assert '3 points in 1 s, 0 inserted' in done.stdout
    expected = fill_trajectory(robot, TIMES, POINTS, compensate=Terms(gravity=False))
    states = read_states(again, robot.joint_names)
    np.testing.assert_allclose(states.tau, expected.efforts, rtol=0, atol=1e-12)
    assert out.read_text() == again.read_text()  # a filled trajectory is complete


def test_all_trajectories_of_a_bag_are_filled_into_a_new_one(tmp_path, robot):
    types = get_typestore(Stores.ROS2_JAZZY)
    kind = 'trajectory_msgs/msg/JointTrajectory'
    Message = types.types[kind]
    Point = types.types['trajectory_msgs/msg/JointTrajectoryPoint']
    Duration = types.types['builtin_interfaces/msg/Duration']
    Header = types.types['std_msgs/msg/Header']
    Time = types.types['builtin_interfaces/msg/Time']
    none = np.zeros(0)
    with Writer(tmp_path / 'run', version=9,
                storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection('/plan', kind, typestore=types)
        for k in range(2):
            points = []
            for t, q in zip(TIMES, POINTS, strict=True):
                from_start = Duration(int(t), int(t % 1 * 10**9))
                points.append(Point(np.array(q) + 0.1 * k, none, none, none, from_start))
            message = Message(Header(Time(5, k), 'world'), ['joint1', 'joint2'], points)
            writer.write(connection, 10**9 * (k + 1), types.serialize_cdr(message, kind))
    done = command('fill', str(URDF), '--motion', str(tmp_path / 'run'), '--out',
                   str(tmp_path / 'filled'))
    assert done.returncode == 0, done.stderr
    messages = list(bag_messages(tmp_path / 'filled', kind, None))
    assert [(topic, logged) for topic, logged, _ in messages] == [('/plan', 10**9),
                                                                  ('/plan', 2 * 10**9)]
    for k, (_, _, message) in enumerate(messages):
        expected = fill_trajectory(robot, TIMES, np.array(POINTS) + 0.1 * k)
        np.testing.assert_allclose([p.effort for p in message.points], expected.efforts,
                                   rtol=0, atol=1e-12)
        assert (message.header.stamp.nanosec, message.header.frame_id) == (k, 'world')
    done = command('fill', str(URDF), '--motion', str(tmp_path / 'run'), '--out',
                   str(tmp_path / 'filled'))
    assert done.returncode == 2
    assert 'exists; expected the folder of a new bag' in done.stderr


@pytest.mark.parametrize(('options', 'message'), [
    (['--joints', 'joint1'], "'joint2' is not a joint of the robot"),
    (['--tolerance', '0'], 'tolerance: ')])
def test_a_trajectory_that_cannot_be_filled_is_an_error(plan, options, message):
    done = command('fill', str(URDF), '--motion', str(plan), *options)
    assert done.returncode == 2
    assert message in done.stderr


def test_degrees_are_suspected_in_every_row_and_of_joints_in_any_order(plan):
    plan.write_text(ECHO.replace('[0.1, 0.6]', '[10.0, 60.0]'))
    assert 'degrees?' in command('fill', str(URDF), '--motion', str(plan)).stderr


def test_the_friction_of_the_efforts_at_rest_is_the_stated_choice(tmp_path):
    plan = tmp_path / 'plan.csv'
    # Both joints begin at rest, with an acceleration.
    plan.write_text('t,q.joint1,q.joint2,u.joint1,u.joint2,udot.joint1,udot.joint2\n'
                    '0,0,0,0,0,3,-3\n1,0.5,-0.5,0,0,0,0\n')
    friction = tmp_path / 'friction.yaml'
    friction.write_text('joints: {joint1: {friction: 2.0}, joint2: {friction: 1.0}}')
    efforts = []
    for choice in ('desired_speed', 'ahead', '0.1', 'none'):
        done = command('fill', str(URDF), '--supplement', str(friction), '--motion',
                       str(plan), '--feedforward-friction', choice, '--json')
        efforts.append(json.loads(done.stdout)[0]['efforts'][0])
    # At the begin: the whole friction of each joint for the time ahead, else none.
    of_joints = np.array([2.0, 1.0])
    ahead = np.abs(np.array(efforts[1:3]) - efforts[0])
    assert (ahead > 0.5 * of_joints).all() and (ahead <= of_joints).all()
    np.testing.assert_allclose(efforts[3], efforts[0], atol=1e-12)
