"""What `kane-dynamics doctor` says of URDFs, configurations and live graphs."""

import json
import os
from pathlib import Path
import subprocess
import sys
import threading

from kane_dynamics import load_urdf, Robot
from node_process import Process, URDF
import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

ROOT = Path(__file__).resolve().parents[2]
PLANT = 'kane_dynamics.ros.plant.main'


def doctor(urdf, *arguments):
    """Run the command; return its exit code and the words of each level."""
    done = subprocess.run(
        [sys.executable, '-m', 'kane_dynamics.cli', 'doctor', str(urdf), '--json',
         *arguments], capture_output=True, text=True, check=False, timeout=60,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(
            [str(ROOT), os.environ.get('PYTHONPATH', '')])})
    assert done.stderr == '', done.stderr
    findings = dict.fromkeys(('problem', 'warning', 'cannot judge', 'fine'), '')
    for finding in json.loads(done.stdout):
        findings[finding['level']] += finding['words'] + '\n'
    return done.returncode, findings


@pytest.fixture
def urdf(tmp_path):
    path = tmp_path / 'arm.urdf'
    path.write_text(URDF)
    return path


@pytest.mark.parametrize('name', ['ur10e', 'fr3'])
def test_shipped_arms_and_their_configurations_have_no_problem(name):
    code, findings = doctor(ROOT / 'urdf' / f'{name}.urdf', '--config',
                            str(ROOT / 'config' / f'{name}.yaml'))
    assert (code, findings['problem']) == (0, '')
    assert f'{name}.yaml: all parameters are known and fit the arm' in findings['fine']
    assert 'no rotor inertia (armature) is known' in findings['warning']


def test_a_weak_arm_and_an_invalid_configuration_are_reported_by_name(tmp_path):
    path = tmp_path / 'weak.urdf'
    path.write_text(URDF.replace('effort="60"', 'effort="1"'))
    wrong = tmp_path / 'wrong.yaml'
    wrong.write_text(
        '/**: {ros__parameters: {mod: fly, gains: {kp: -1.0}, gravity: [0, 0, 9.81],'
        'joints: [turn, elbow]}}')
    code, findings = doctor(path, '--config', str(wrong))
    assert code == 1
    for words in ("the arm cannot hold itself in every configuration: 'lift'",
                  "parameter 'mod': unknown and ignored; expected 'mode'",
                  "parameter 'gains.kp': -1.0"):
        assert words in findings['problem']
    wrong.write_text(
        '/**: {ros__parameters: {gravity: [0, 0, 9.81], joints: [turn, elbow]}}')
    code, findings = doctor(path, '--config', str(wrong))
    assert ("joints: 'elbow' is no joint of one degree of freedom; expected some of "
            'turn, lift' in findings['problem'])
    assert 'gravity: [0.0, 0.0, 9.81]' in findings['warning']


def test_a_valid_graph_has_no_problem(client, urdf):
    """In simulated time, on a controller's topic, beside a gripper of its own."""
    away = ('-r', '__ns:=/ward',  # from what the client itself publishes
            '-r', 'commands:=effort/commands')
    # A machine that stalls must not let the arm fall: it has to be at rest.
    running = [Process(*away, real_states=True,
                       mode='gravity_compensation', use_sim_time=True, state_timeout=2.0,
                       robot_description=f"'{URDF}'"),
               Process(*away, module=PLANT, robot_description=f"'{URDF}'", rate=200.0,
                       publish_clock=True, after_timeout='hold',
                       initial__position='[0.3, -0.4, 0.2]')]
    gripper = client.create_publisher(JointState, '/ward/joint_states', 10)
    timer = client.create_timer(0.02, lambda: gripper.publish(
        JointState(name=['finger'], position=[0.01])))
    try:
        running[0].wait_for('active, mode')
        running[1].wait_for('joint states/s')
        # A short duration, because discovery takes up to two heartbeats.
        code, findings = doctor(urdf, '--live', '1', '--namespace', 'ward', '--commands',
                                'effort/commands')
    finally:
        client.destroy_timer(timer)
        client.destroy_publisher(gripper)
        for process in running:
            process.end()
    assert (code, findings['problem']) == (0, ''), findings
    assert 'commands: from kane_dynamics to plant' in findings['fine'], findings
    assert 'joint states/s with all joints' in findings['fine'], findings
    assert 'of the weight' in findings['fine'], findings
    assert 'stamps' not in findings['warning'], findings
    assert 'commands' not in findings['warning'], findings


def test_the_problems_of_a_graph_are_reported(client, urdf):
    publishers = [client.create_publisher(JointState, 'joint_states', 10)
                  for _ in range(2)]
    described = client.create_publisher(String, 'robot_description', QoSProfile(depth=1))
    commands = [client.create_publisher(Float64MultiArray, 'commands', 1)
                for _ in range(2)]
    stop = threading.Event()
    q = np.array([0.3, -0.4, 0.2])
    upside_down = (-Robot(load_urdf(URDF)).gravity_force(q)).tolist()

    def publish():
        while not stop.wait(0.02):
            message = JointState(name=['turn', 'lift', 'reach'], position=q.tolist(),
                                 velocity=[0.0] * 3, effort=upside_down)
            message.header.stamp.sec = 1000  # of another clock
            publishers[0].publish(message)
    thread = threading.Thread(target=publish)
    thread.start()
    try:
        code, findings = doctor(urdf, '--live', '3')
    finally:
        stop.set()
        thread.join()
        for publisher in (*publishers, described, *commands):
            client.destroy_publisher(publisher)
    assert code == 1
    for words in ('joint_states: 3 publishers', 'expected the same clock',
                  'opposite sign', 'commands: 2 publishers', 'expected transient local'):
        assert words in findings['problem'], findings
    code, findings = doctor(urdf, '--live', '1', '--namespace', 'elsewhere')
    assert 'joint states: none within 1 s; expected' in findings['problem']


def test_what_a_node_says_of_itself_and_another_order_of_joints_are_problems(
        client, urdf):
    """The node refused every state, and doctor found no problem."""
    node = Process(real_states=True, robot_description=f"'{URDF}'",
                   activation='at_once', arm_compensates='none')
    controller = rclpy.create_node('effort_controller', context=client.context)
    controller.declare_parameter('joints', ['lift', 'turn', 'reach'])
    controller.create_subscription(Float64MultiArray, '/commands', lambda _: None, 1)
    executor = SingleThreadedExecutor(context=client.context)
    executor.add_node(controller)
    stop = threading.Event()
    states = client.create_publisher(JointState, 'joint_states', 10)

    def run():
        while not stop.is_set():
            executor.spin_once(timeout_sec=0.01)
            states.publish(JointState(name=['turn', 'lift', 'reach'],
                                      position=[0.3, float('nan'), 0.2],
                                      velocity=[0.0] * 3))
    thread = threading.Thread(target=run)
    try:
        node.wait_for('active, mode')
        thread.start()
        code, findings = doctor(urdf, '--live', '2')
    finally:
        stop.set()
        thread.join()
        client.destroy_publisher(states)
        controller.destroy_node()
        node.end()
    assert code == 1
    assert "parameter 'joints' of /effort_controller: lift, turn, reach" in findings[
        'problem'], findings
    assert '/diagnostics of /kane_dynamics: torques: ' in findings['problem'], findings
