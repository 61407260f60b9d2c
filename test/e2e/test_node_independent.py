"""Another DDS implementation, without ROS, reads torques and calls a service."""

import json
import os
from pathlib import Path
import subprocess
import sys

from kane_dynamics import Robot
from node_process import JOINTS, model
import numpy as np
import pytest

pytest.importorskip('cyclonedds')

CYCLONE = """<CycloneDDS><Domain>
<General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>100</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""
Q = [0.3, -0.4, 0.2]


def test_a_client_without_rclpy_gets_the_same_torques_by_topic_and_service(start):
    start(state_timeout=1.0).wait_for('active, mode')
    client = subprocess.run(
        [sys.executable,
         str(Path(__file__).parents[1] / 'helpers' / 'plain_dds_client.py'),
         os.environ['ROS_DOMAIN_ID'], ','.join(JOINTS), ','.join(map(str, Q))],
        env=dict(os.environ, CYCLONEDDS_URI=CYCLONE), capture_output=True, text=True,
        timeout=60)
    assert client.returncode == 0, client.stderr
    answer = json.loads(client.stdout)
    expected = Robot(model()).gravity_force(np.array(Q))
    assert answer['service']['success'], answer['service']['message']
    for interface in ('topic', 'service'):
        assert answer[interface]['name'] == list(JOINTS)
        np.testing.assert_allclose(answer[interface]['effort'], expected, rtol=1e-12)
    assert answer['topic']['commands'] == answer['topic']['effort']
