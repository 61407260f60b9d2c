"""The node moves an FR3 with elastic joints, which MuJoCo simulates, over DDS."""

import json

from builtin_interfaces.msg import Duration
from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from node_process import active_until_end, DEEP, NAME, Process, wait_until
import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

mujoco = pytest.importorskip('mujoco')
from two_mass_arm import TwoMassArm  # noqa: E402, I100

JOINTS = tuple(f'fr3_joint{k}' for k in range(1, 8))
HOME = np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8])
MOVE = np.array([0.5, 0.3, -0.3, 0.4, 0.4, -0.4, 0.5])
KP = [600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0]
KD = [30.0, 30.0, 30.0, 30.0, 10.0, 10.0, 5.0]
# s
SETTLE = 0.1
DURATION = 0.5
AFTER = 0.7
CYCLE = 1e-3
SUBSTEPS = 4
# From rest to rest with four continuous derivatives, s from 0 to 1.
SHAPE = np.polynomial.Polynomial([0, 0, 0, 0, 0, 126, -420, 540, -315, 70])
DRIVES = {name: {'stiffness': stiffness, 'damping': 0.2, 'rotor_inertia': inertia}
          for name, stiffness, inertia in zip(
              JOINTS, [14e3] * 4 + [3e3] * 3, [0.6, 0.6, 0.5, 0.5, 0.2, 0.2, 0.2],
              strict=True)}


@pytest.fixture(scope='module')
def module_node(tmp_path_factory):
    supplement = tmp_path_factory.mktemp('drives') / 'drives.yaml'
    supplement.write_text(json.dumps({'drives': DRIVES}))
    yield from active_until_end(Process(
        urdf=resource_path('urdf', 'fr3.urdf'), supplement=supplement,
        state_timeout=600.0,
        use_sim_time=True, joints=f'[{",".join(JOINTS)}]', mode='motor_side',
        modes='[joint_impedance]', drives__lead=0.5 * CYCLE, drives__kp=KP,
        drives__kd=KD, joint_impedance__stiffness=KP, joint_impedance__damping=KD))


def plant():
    """Return the arm, and its configuration with links at home on their springs."""
    urdf = resource_path('urdf', 'fr3.urdf')
    model = load_urdf(urdf, joints=JOINTS, supplement={'drives': DRIVES})
    gravity = Robot(model).inverse_dynamics(np.tile(HOME, 2), *np.zeros((2, 14)))[:7]
    stiffness = np.array([drive['stiffness'] for drive in DRIVES.values()])
    start = np.concatenate([HOME, HOME + gravity / stiffness])
    return TwoMassArm(urdf.read_text(encoding='utf-8'), model, CYCLE / SUBSTEPS,
                      'RK4'), start


def move(stamp):
    """Return the message of a fast motion that begins at a time, ns."""
    message = JointTrajectory(joint_names=list(JOINTS))
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    for t in np.linspace(0.0, DURATION, 101):
        s = t / DURATION
        point = JointTrajectoryPoint(
            positions=(HOME + SHAPE(s) * MOVE).tolist(),
            velocities=(SHAPE.deriv(1)(s) / DURATION * MOVE).tolist(),
            accelerations=(SHAPE.deriv(2)(s) / DURATION**2 * MOVE).tolist())
        point.time_from_start = Duration(sec=int(t), nanosec=round(t % 1.0 * 1e9))
        message.points.append(point)
    return message


def residual_vibration(client, clock, start, arm, rest, mode):
    """
    Return the largest distance of the tip from its place at rest after the motion, m.

    The simulated time begins at `start`, ns, and waits for the node's command to each
    state.
    """
    assert client.adjust(mode=mode).successful
    client.joints = JOINTS
    arm.put(rest, np.zeros(14))
    count = round((SETTLE + DURATION + AFTER) / CYCLE)
    places = []
    for k in range(count):
        q, u = arm.state
        stamp = start + round(k * CYCLE * 1e9)
        now = Clock()
        now.clock.sec, now.clock.nanosec = divmod(stamp, 10**9)
        clock.publish(now)
        torques = answer(client, q[7:], u[7:], stamp)
        assert torques is not None, f'no command for state {k}'
        if k == 1:
            client.motions.publish(move(start + round(SETTLE * 1e9)))
        tau = np.zeros(14)
        tau[7:] = torques
        arm.step(tau, SUBSTEPS)
        places.append(arm.position('fr3_link8'))
    places = np.array(places)
    travelled = np.linalg.norm(places[-1] - places[0])
    assert travelled > 0.1, client.process.log  # the motion was followed
    settled = places[round((SETTLE + DURATION) / CYCLE):]
    place = settled[-200:].mean(axis=0)
    return np.linalg.norm(settled - place, axis=1).max()


def answer(client, q, u, stamp):
    """Return the command to a state, which is sent again if it or the answer is lost."""
    for _ in range(20):
        torques = client.ask(q, u, stamp=stamp, timeout=1.0)
        if torques is not None:
            return torques
    return None


@pytest.mark.timeout(400)  # 2600 states, each with its answer
def test_elastic_feedforward_leaves_a_twentieth_of_the_vibration(module_node, client):
    client.joints = JOINTS
    arm, resting_place = plant()
    client.process = module_node
    clock = client.create_publisher(Clock, '/clock', 1)
    assert wait_until(lambda: clock.get_subscription_count(), 60.0)
    try:
        rigid = residual_vibration(client, clock, 10**9, arm, resting_place,
                                   'joint_impedance')
        elastic = residual_vibration(client, clock, 10**10, arm, resting_place,
                                     'motor_side')
    finally:
        client.destroy_publisher(clock)
    print(f'tip after the motion: {1e3 * rigid:.4f} mm with rigid feedforward and the '
          f'same gains, {1e3 * elastic:.4f} mm with the elastic one')
    assert rigid > 20.0 * elastic


@pytest.fixture
def simulated(module_node, tmp_path):
    """Return a plant_node of the same arm, paused, with joint states of motors."""
    supplement = tmp_path / 'drives.yaml'
    supplement.write_text(json.dumps({'drives': DRIVES}))
    process = Process(
        module='kane_dynamics.ros.plant.main', supplement=supplement,
        urdf=resource_path('urdf', 'fr3.urdf'), joints=f'[{",".join(JOINTS)}]',
        drives__sensor_side='motor', initial__position=HOME.tolist(),
        publish_clock=True, rate=1000.0, rate_factor=0.1, command_timeout=600.0,
        start_paused=True)
    process.wait_for('drives of fr3_joint1')
    yield process
    assert process.end()[0] == 0
    assert 'Traceback' not in process.log and '[ERROR]' not in process.log


@pytest.mark.timeout(400)
def test_the_node_moves_an_elastic_arm_in_plant_node(module_node, client, simulated):
    """The motors follow; at rest they lead the links by what gravity deflects."""
    client.joints = JOINTS
    states = []
    clock = []
    subscriptions = [
        client.create_subscription(JointState, 'joint_states', states.append, DEEP),
        client.create_subscription(Clock, '/clock', clock.append, DEEP)]
    try:
        # The arm waits for its first command, which must not be the one to an unseen
        # state.
        assert client.call(ChangeState, f'{NAME}/change_state', transition=Transition(
            id=Transition.TRANSITION_DEACTIVATE)).success
        assert client.call(SetBool, '/plant_node/pause', data=False).success
        assert wait_until(lambda: len(states) > 5, 60.0), simulated.log
        model = load_urdf(resource_path('urdf', 'fr3.urdf'), joints=JOINTS,
                          supplement={'drives': DRIVES})
        stiffness = np.array([drive['stiffness'] for drive in DRIVES.values()])

        def motors_at(links):
            weight = Robot(model).inverse_dynamics(np.tile(links,
                                                           2), *np.zeros((2, 14)))[:7]
            return links + weight / stiffness
        assert tuple(states[-1].name) == JOINTS
        np.testing.assert_allclose(states[0].position, motors_at(HOME), atol=1e-9)
        assert client.adjust(mode='motor_side').successful
        assert client.call(ChangeState, f'{NAME}/change_state', transition=Transition(
            id=Transition.TRANSITION_ACTIVATE)).success
        assert wait_until(lambda: np.abs(states[-1].effort).max() > 1.0, 30.0)
        now = clock[-1].clock
        client.motions.publish(move(now.sec * 10**9 + now.nanosec + 3 * 10**8))
        end = motors_at(HOME + MOVE)
        assert wait_until(lambda: np.abs(states[-1].position - end).max() < 1e-3
                          and np.abs(states[-1].velocity).max() < 1e-2, 60.0), (
            states[-1].position - end, module_node.log)
    finally:
        for subscription in subscriptions:
            client.destroy_subscription(subscription)
