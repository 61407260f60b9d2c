"""A signal at any moment of a node's start ends the process, and is never lost."""

import os
import random
import signal
import subprocess
import sys
import time

import pytest

NODES = ('kane_dynamics.ros.dynamics_node.main', 'kane_dynamics.ros.guard.main',
         'kane_dynamics.ros.plant.main')
START = 2.0  # s, about the longest start of a node on an idle machine
TIMEOUT = 60.0  # s
# Not 0: before the node's code has begun; 2: plant_node had no URDF before the signal
# came.
ENDED = (0, 1, 2, -signal.SIGINT, -signal.SIGTERM)

# The signal comes in a finalizer, whose exceptions the interpreter ignores, in a long
# import.
LOST = """
import importlib, os, signal, sys

class Last:
    def __del__(self):
        os.kill(os.getpid(), signal.{signal})
        sum([])

class Finder:
    def find_spec(self, name, path, target=None):
        if name == '{module}':
            Last()

sys.meta_path.insert(0, Finder())
sys.argv[1:] = ['--ros-args', '-p', 'autostart:=false']
sys.exit(importlib.import_module('{node}').main())
"""


def started(*command):
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)}

    # Jobs in the background of a shell inherit an ignored SIGINT.
    def reset():
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    return subprocess.Popen([sys.executable, *command], env=environment,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                            preexec_fn=reset)


def code_and_output(process):
    try:
        output, _ = process.communicate(timeout=TIMEOUT)
    except subprocess.TimeoutExpired:
        process.kill()
        raise AssertionError(f'runs on: {process.communicate()[0]}') from None
    return process.returncode, output


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('module', ['numpy', 'rclpy'])
@pytest.mark.parametrize('node', NODES)
def test_a_signal_during_an_import_ends_the_node(node, module, number):
    program = LOST.format(node=node, module=module, signal=number.name)
    assert code_and_output(started('-c', program)) == (0, '')


def signal_at_random(rng, node):
    process = started('-m', node)
    time.sleep(rng.uniform(0.0, START))
    process.send_signal(rng.choice([signal.SIGINT, signal.SIGTERM]))
    code, output = code_and_output(process)
    assert code in ENDED, output


def test_a_signal_at_a_random_moment_ends_the_node():
    rng = random.Random(time.time_ns())
    for node in NODES:
        signal_at_random(rng, node)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_a_signal_at_many_random_moments_ends_the_node():
    rng = random.Random(time.time_ns())
    for _ in range(150):
        for node in NODES:
            signal_at_random(rng, node)
