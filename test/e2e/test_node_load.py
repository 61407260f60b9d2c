"""The torque path under load: states answered during simulations, memory flat."""

import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from kane_dynamics import load_urdf
from kane_dynamics._util.resources import resource_path
from kane_dynamics_interfaces.srv import GetDynamics, Simulate
from node_process import Process, wait_until
import numpy as np
import pytest

ARM = resource_path('urdf', 'fr3.urdf')
JOINTS = tuple(name for name in load_urdf(ARM).joint_names if 'finger' not in name)
HOME = [0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8]
HELPERS = Path(__file__).resolve().parents[1] / 'helpers'
FEWEST = 200  # states on which a share is judged


@pytest.fixture(scope='module')
def module_node():
    process = Process(urdf=ARM, state_timeout=1.0, mode='computed_torque',
                      joints=f'[{",".join(JOINTS)}]')
    process.wait_for('active, mode')
    yield process
    assert process.end()[0] == 0


@pytest.fixture
def node(module_node, client):
    client.process = module_node
    client.joints = JOINTS
    client.listen(False)
    yield client
    client.listen(True)


def drive(node, seconds, meanwhile=lambda: None):
    """Let a driver send states at 500 Hz; return its counts."""
    path = os.pathsep.join([str(HELPERS), str(HELPERS.parents[1]),
                            os.environ.get('PYTHONPATH', '')])
    process = subprocess.Popen([sys.executable, str(HELPERS / 'joint_state_process.py'),
                                str(seconds),
                                ','.join(JOINTS), str(node.process.pid)],
                               stdout=subprocess.PIPE, text=True,
                               env=dict(os.environ, PYTHONPATH=path))
    assert process.stdout.readline() == 'ready\n'
    began = time.monotonic()
    while time.monotonic() < began + seconds:
        meanwhile()
    with process.stdout:
        counts = json.loads(process.stdout.readline())
    assert process.wait(10.0) == 0
    assert counts['sent'] == 500 * seconds
    return counts


def unanswered(node, most, *arguments):
    """
    Return the share of states unanswered: of all, or of those judged if it is smaller.

    A drive in which the machine held up the driver or the node is repeated while more
    than `most` are unanswered: it may also have held up the node in ways that are not
    counted.
    """
    for _ in range(5):
        counts = drive(node, *arguments)
        share = counts['unanswered'] / counts['sent']
        judged = counts['judged']
        if judged >= FEWEST:
            share = min(share, counts['lost'] / judged)
        if share <= most or judged == counts['sent']:
            break
    if share > most and judged < FEWEST:
        pytest.skip(f'{counts}: the machine held up the driver or the node too often')
    return share


def simulate(node, **fields):
    answer = node.call(Simulate, 'simulate', position=HOME, duration=10.0, **fields)
    assert answer.success, answer.message
    return answer


def test_every_state_gets_a_command_while_idle(node):
    assert unanswered(node, 0.0, 5.0, lambda: time.sleep(0.1)) == 0.0


def test_states_that_are_lost_while_the_node_stands_still_are_counted(node):
    def stand_still():
        # For longer than the queue of the native thread lasts, 100 states at 500 Hz
        os.kill(node.process.pid, signal.SIGSTOP)
        time.sleep(0.35)
        os.kill(node.process.pid, signal.SIGCONT)
        time.sleep(0.3)
    assert drive(node, 3.0, stand_still)['lost'] > 0


def test_at_most_two_percent_of_states_are_lost_during_simulations(node):
    simulate(node)
    requests = 0

    def request():
        nonlocal requests
        simulate(node)
        requests += 1

    assert unanswered(node, 0.02, 5.0, request) <= 0.02
    assert requests > 25


def test_large_trajectories_do_not_stall_the_torque_path(node):
    points = [(1e-2 * (k + 1), HOME) for k in range(10_000)]
    asked = 0

    def ask():
        nonlocal asked
        answer = simulate(node, sample_period=1e-2)
        assert len(answer.trajectory.points) == 1001
        asked += 1

    ask()
    node.follow(points)
    assert unanswered(node, 0.02, 5.0, ask) <= 0.02
    assert asked > 10


def resident(pid):
    """Return the resident size of a process, MB."""
    pages = int(Path(f'/proc/{pid}/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 2**20


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_memory_does_not_grow_over_100000_states_and_1000_service_calls(node):
    pid = node.process.pid
    zeros = np.zeros(len(JOINTS))

    def messages(count):
        for k in range(count):
            node.send(HOME, zeros)
            time.sleep(2e-4)
            if k % 1000 == 0:
                node.torques.clear()
                node.commands.clear()

    def calls(count):
        for _ in range(count):
            assert node.call(GetDynamics, 'get_dynamics', position=HOME).success
            assert node.call(Simulate, 'simulate', position=HOME, duration=0.5).success

    node.listen(True)
    node.connect()
    messages(10_000)
    calls(100)
    memory_before = resident(pid)
    messages(100_000)
    calls(500)
    assert wait_until(node.process.alive)
    assert resident(pid) < memory_before + 3.0
