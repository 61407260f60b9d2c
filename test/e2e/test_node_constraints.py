"""The services of a node with a closed loop: constraint forces, simulations."""

from pathlib import Path
import subprocess
import sys

from action_msgs.msg import GoalStatus
from kane_dynamics import load_constraints, load_urdf, Robot, simulate
from kane_dynamics_interfaces.action import SimulateMotion
from kane_dynamics_interfaces.srv import (Explain, ForwardDynamics, GetDynamics,
                                          InverseDynamics, Simulate)
from node_process import Process, wait_until
import numpy as np
import pytest

BARS = (('crank', 'base', '0 0 0', 0.3), ('coupler', 'crank', '0.3 0 0', 0.9),
        ('rocker', 'coupler', '0.9 0 0', 0.7))
LINKS = ('<robot name="four-bar"><link name="base"/><link name="ground"/><link '
         'name="end"/>')
URDF = LINKS + ''.join(
    f'<link name="{name}"><inertial><origin xyz="{length / 2} 0 0"/><mass '
    f'value="{2 * length}"/>'
    f'<inertia ixx="1e-3" iyy="{length**3 / 6}" izz="{length**3 / 6}" ixy="0" ixz="0" '
    f'iyz="0"/></inertial></link><joint name="{name}_joint" type="continuous"><parent '
    f'link="{parent}"/><child link="{name}"/><origin xyz="{at}"/><axis xyz="0 -1 0"/>'
    '<dynamics damping="0.1" friction="0.05"/></joint>'
    for name, parent, at, length in BARS) + (
        '<joint name="g" type="fixed"><parent link="base"/><child link="ground"/>'
        '<origin xyz="1 0 0"/></joint><joint name="e" type="fixed"><parent '
        'link="rocker"/><child link="end"/><origin xyz="0.7 0 0"/></joint></robot>')
LOOP = """
constraints:
  pin:
    closure: {first: end, second: ground, kind: revolute, axis: [0, 1, 0]}
independent: [crank_joint]
"""


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp('loop')
    (folder / 'four_bar.urdf').write_text(URDF)
    (folder / 'loop.yaml').write_text(LOOP)
    return folder / 'four_bar.urdf', folder / 'loop.yaml'


@pytest.fixture(scope='module')
def linkage(files):
    return Robot(load_urdf(files[0]), **load_constraints(files[1]))


@pytest.fixture(scope='module')
def configuration(linkage):
    return linkage.closed_configuration((0.8, 0.0, -1.5), fixed=['crank_joint'])


def test_the_file_is_read_once_for_all_robots_of_the_node(files):
    program = f"""
import sys
import rclpy
from kane_dynamics.ros.dynamics_node.node import DynamicsNode
rclpy.init(args=['--ros-args', '-p', 'urdf:={files[0]}', '-p', 'constraints:={files[1]}',
                 '-p', 'arm_compensates:=none'])
opened = []
sys.addaudithook(lambda event, given: event == 'open' and opened.append(str(given[0])))
node = DynamicsNode()
node.trigger_configure()
print(node.state, opened.count('{files[1]}'))
rclpy.shutdown()
"""
    done = subprocess.run([sys.executable, '-c', program], capture_output=True,
                          text=True, timeout=100, cwd=Path(__file__).parents[2])
    assert done.stdout.split() == ['inactive', '1'], done.stderr


@pytest.fixture(scope='module')
def process(files):
    process = Process(urdf=files[0], constraints=files[1])
    try:
        process.wait_for('active, mode')
        yield process
    finally:  # else it would answer the requests of other tests
        code, _ = process.end()
    assert code == 0
    assert 'Traceback' not in process.log


@pytest.fixture
def node(process, client):
    client.process = process
    return client


def close(value, expected):
    np.testing.assert_allclose(value, expected, rtol=1e-12, atol=1e-12)


def test_inverse_and_forward_dynamics_return_constraint_forces(
        node, linkage, configuration):
    q = configuration
    u = np.array([5.0])
    a = np.array([1.0])
    tau = linkage.inverse_dynamics(q, u, a)
    forces = linkage.constraint_forces(q, u, tau)
    answer = node.call(InverseDynamics, 'inverse_dynamics', position=q.tolist(),
                       velocity=[5.0], acceleration=[1.0])
    assert answer.success, answer.message
    assert tuple(answer.joint_names) == linkage.joint_names
    close(answer.effort, [tau[0], 0.0, 0.0])
    assert tuple(answer.constraint_names) == linkage.constraint_names
    close(answer.constraint_forces, forces)
    close([w.force.x for w in answer.joint_reactions],
          linkage.joint_reactions(q, u, a)[:, 0])
    assert np.abs(forces).max() > 1.0
    # The order of the request is that of the answer.
    order = [2, 0, 1]
    names = [linkage.joint_names[k] for k in order]
    mixed = node.call(InverseDynamics, 'inverse_dynamics', joint_names=names,
                      velocity=[5.0], position=q[order].tolist(), acceleration=[1.0])
    close(mixed.effort, [0.0, tau[0], 0.0])
    forward = node.call(ForwardDynamics, 'forward_dynamics', position=q.tolist(),
                        velocity=[5.0], effort=tau.tolist())
    assert forward.joint_names == ['crank_joint']
    close(forward.acceleration, a)
    close(forward.constraint_forces, forces)


def test_get_dynamics_and_explain_use_the_independent_joints(
        node, linkage, configuration):
    answer = node.call(GetDynamics, 'get_dynamics', position=configuration.tolist(),
                       velocity=[5.0])
    assert answer.joint_names == ['crank_joint']
    close(answer.mass_matrix, linkage.mass_matrix(configuration).ravel())
    close(answer.bias_force, linkage.bias_force(configuration, [5.0]))
    assert answer.friction_force[0] != 0.0
    explanation = node.call(Explain, 'explain', position=configuration.tolist(),
                            velocity=[5.0], acceleration=[1.0])
    assert explanation.success, explanation.message
    close(sum(explanation.explanation.by_source),
          linkage.inverse_dynamics(configuration, [5.0], [1.0])[0])
    assert abs(explanation.explanation.power_residual) < 1e-9


def test_simulations_return_constraint_forces(node, linkage, configuration):
    expected = simulate(linkage, configuration, np.array([2.0]), 0.5,
                        step=1e-3, sample=0.1)
    request = {'position': configuration.tolist(), 'velocity': [2.0], 'duration': 0.5,
               'sample_period': 0.1}
    answer = node.call(Simulate, 'simulate', **request)
    assert answer.success, answer.message
    _, result = node.send_goal(SimulateMotion, 'simulate_motion', **request)
    assert wait_until(result.done)
    outcome = result.result()
    assert outcome.status == GoalStatus.STATUS_SUCCEEDED
    for message in (answer, outcome.result):
        assert tuple(message.constraint_names) == linkage.constraint_names
        close(np.reshape(message.constraint_forces, (6, -1)), expected.constraint_forces)
        points = message.trajectory.points
        close([point.positions for point in points], expected.q)
        close([point.velocities for point in points],
              linkage.joint_rates(expected.q, expected.u))
        close([point.accelerations for point in points],
              linkage.joint_accelerations(expected.q, expected.u, expected.udot))


def test_an_arm_whose_file_names_no_measured_joints_is_not_activated(
        client, start, files, tmp_path):
    (tmp_path / 'loop.yaml').write_text(LOOP.replace('independent: [crank_joint]', ''))
    other_node = start('-r', '__node:=other',
                       urdf=files[0], constraints=tmp_path / 'loop.yaml')
    other_node.wait_for(
        "the node remains inactive: parameter 'constraints': no key `independent`")


@pytest.mark.parametrize(('kind', 'name', 'change', 'words'), [
    (InverseDynamics, 'inverse_dynamics', {'position': [0.8, 0.0, -1.5]},
     "of constraint 'pin/"),
    (InverseDynamics, 'inverse_dynamics', {'velocity': [1.0, 2.0, 3.0]}, 'expected 1'),
    (Simulate, 'simulate', {'duration': 0.1, 'torque_source': 2},
     'trajectory: 0 points')])
def test_requests_that_violate_constraints_are_refused(
        node, configuration, kind, name, change, words):
    fields = {'position': configuration.tolist(), 'velocity': [1.0], **change}
    if kind is InverseDynamics:
        fields['acceleration'] = [0.0]
    answer = node.call(kind, name, **fields)
    assert not answer.success
    assert words in answer.message


def test_a_small_constraint_residual_is_corrected(node, linkage, configuration):
    moved = configuration + [0.0, 1e-3, -1e-3]
    answer = node.call(InverseDynamics, 'inverse_dynamics', position=moved.tolist(),
                       velocity=[5.0], acceleration=[1.0])
    near = linkage.inverse_dynamics(configuration, [5.0], [1.0])
    assert answer.effort[0] == pytest.approx(near[0], rel=1e-9)
