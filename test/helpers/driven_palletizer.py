"""The palletizer on the simulated robot: only its driven joints are measured."""

import time

from kane_dynamics import Motion
from node_process import DEEP, prefer, Process, wait_until
import numpy as np
from palletizer import DRIVEN
from sensor_msgs.msg import JointState

START = (0.0, 0.0, 0.0, 0.0)
REST = [(0.0,) * 4] * 2
DURATION = 1.6  # s
PATIENCE = 120.0  # s, for models that compile first


def tracking_errors(client, start, files, ready, end, gains, **plant_options):
    """
    Return |q - desired q| of the driven joints at each state, from START to `end`.

    `ready` is what the plant logs when it runs, `gains` are kp and kd of the node.
    """
    plant = Process(module='kane_dynamics.ros.plant.main', after_timeout='hold',
                    measured=list(DRIVEN), **plant_options, **files)
    states = []

    def on_state(message):
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        states.append((stamp, np.array(message.position)))
    listening = client.create_subscription(JointState, 'joint_states', on_state, DEEP)
    kp, kd = gains
    try:
        plant.wait_for(ready, PATIENCE)
        node = start(real_states=True, mode='computed_torque', gains__kp=kp,
                     gains__kd=kd, state_timeout=1.0, **files)
        node.wait_for('active, mode', PATIENCE)
        # The arm follows in real time, also beside other work.
        for process, priority in ((plant, 25), (node, 18)):
            prefer(process.pid, priority)
        assert wait_until(lambda: client.motions.get_subscription_count() > 0 and states
                          and client.commands)
        assert len(states[0][1]) == 4 and len(client.commands[-1]) == 4

        # The motion begins a little later, so that it is known before.
        began = time.time_ns() + 300_000_000
        client.joints = DRIVEN
        client.follow([(0.0, START), (DURATION, end)], start=began, velocities=REST)
        assert wait_until(lambda: states[-1][0] > began + DURATION * 1e9, 20.0)
        assert plant.alive()
        assert 'stopped until' not in plant.log
        assert 'rejected' not in node.log
    finally:
        client.destroy_subscription(listening)
        plant.end()
        print(node.log, plant.log)

    motion = Motion.from_points([0.0, DURATION], [START, end], REST, joint_names=DRIVEN)
    errors = []
    for stamp, q in states:
        elapsed = (stamp - began) * 1e-9
        if 0.0 <= elapsed <= DURATION:
            errors.append(np.abs(q - motion.sample(elapsed)[0]))
    return errors
