"""An arm whose links bend, simulated by the plant, commanded by the node: who knows of it wins."""

import json
import time

from graph import DEEP, Process, wait_until
from kane_dynamics import Motion
from kane_dynamics.resources import resource_path
import numpy as np
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

JOINTS = ('joint1', 'joint2')
START, END = (0.4, 0.3), (0.9, -0.4)
BEAMS = {'link1': {'length': 0.5, 'density': 4.0, 'stiffness': 60.0, 'modes': [2, 0],
                   'up': [0, 1, 0], 'damping': 2e-3},
         'link2': {'length': 0.4, 'density': 3.0, 'stiffness': 40.0, 'modes': [1, 0],
                   'up': [0, 1, 0], 'damping': 2e-3}}
MOTORS = {'joint1': {'armature': 0.4}, 'joint2': {'armature': 0.1}}
PAYLOAD = {'link': 'tip', 'mass': 1.5}


def supplement(folder, bends):
    """Return the path of one, with the beams as they are or rigid; JSON is YAML."""
    beams = {link: beam if bends else {**beam, 'modes': 0} for link, beam in BEAMS.items()}
    path = folder / f'{"bends" if bends else "rigid"}.yaml'
    path.write_text(json.dumps({'beams': beams, 'joints': MOTORS, 'payload': PAYLOAD}))
    return path


def followed(client, start, states, known):
    """Let a node lead the arm along a motion; return the mean error of its joints, rad."""
    assert client.call(Trigger, '/plant/reset').success
    node = start(urdf=resource_path('urdf', 'two_link.urdf'), supplement=known,
                 mode='computed_torque', gains__kp=100.0, gains__kd=20.0)
    node.wait_for('active, mode', 60.0)
    assert wait_until(lambda: client.motions.get_subscription_count() > 0)
    began = time.time_ns() + 300_000_000
    client.joints = JOINTS
    points = [(0.0, START), (1.6, END)]
    client.follow(points, start=began, velocities=[(0.0, 0.0)] * 2)
    motion = Motion.from_points(*zip(*points), [(0.0, 0.0)] * 2, joint_names=JOINTS)
    time.sleep(2.0)
    assert node.end()[0] == 0
    assert 'rejected' not in node.log
    during = [(stamp - began, q) for stamp, q in states if 0 <= stamp - began <= 16 * 10**8]
    assert len(during) > 100
    return np.abs([q - motion.sample(t * 1e-9)[0] for t, q in during]).mean()


def test_a_node_that_knows_of_the_bending_leads_the_arm_far_better(client, start, tmp_path):
    plant = Process(module='kane_dynamics.ros.plant.main', after_timeout='hold',
                    urdf=resource_path('urdf', 'two_link.urdf'), rate=200, substeps=5,
                    supplement=supplement(tmp_path, True), initial__position=list(START))
    states = []
    listening = client.create_subscription(JointState, 'joint_states', lambda m: states.append(
        (m.header.stamp.sec * 10**9 + m.header.stamp.nanosec, np.array(m.position))), DEEP)
    try:
        plant.wait_for('2 joints (joint1, joint2), beams bend in link1/mode_1, link1/mode_2, '
                       'link2/mode_1, 200 joint states', 60.0)
        assert wait_until(lambda: len(states) > 5)
        assert len(states[0][1]) == 2  # modes are the plant's own business
        rigid, knowing = (followed(client, start, states, supplement(tmp_path, bends))
                          for bends in (False, True))
        assert plant.alive() and 'stands still' not in plant.log
    finally:
        client.destroy_subscription(listening)
        plant.end()
    assert knowing < 0.35 * rigid
