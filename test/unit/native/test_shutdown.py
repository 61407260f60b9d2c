"""Batches and compiling in other threads, atexit functions, finalizers end."""

import os
import subprocess
import sys

import pytest

START = """
import atexit, os, sys, threading, time
from mechanisms import random_model
from kane_dynamics import Robot, simulate
from kane_dynamics.native.runtime import threads
import numpy as np
threads.THREAD_WORK = 1e-12
MODEL = random_model(3, 3)
GIVEN = np.random.default_rng(0).normal(size=(3, 20_000, 3))
robot = Robot(MODEL)
expected = robot.inverse_dynamics(*GIVEN)

def batch():
    assert np.array_equal(robot.inverse_dynamics(*GIVEN), expected)

def compile():
    os.environ['KANE_DYNAMICS_CACHE'] = 'off'
    other = Robot(MODEL, friction=False)
    other.compile('mass_matrix', 'gravity_force', 'bias_force', batches=True)
    assert np.isfinite(other.mass_matrix(GIVEN[0, :99])).all()
"""

AT_EXIT = START + """
def last():
    batch()
    compile()
    simulate(robot, GIVEN[0, :5], 0.0 * GIVEN[0, :5], 0.01, step=1e-3)
    print('ended')
atexit.register(last)
"""

# The main thread ends, and the interpreter waits for the others, which find no executor
# any more.
OTHER_THREAD = START + """
def work():
    threading.main_thread().join()
    time.sleep(0.1)
    batch()
    compile()
    print('ended')
threading.Thread(target=work).start()
"""

# Daemon threads are stopped wherever they are; the process must still end in order.
DAEMONS = START + """
def work():
    while True:
        batch()
def calls():
    workspace = robot.bind()
    while True:
        workspace.inverse_dynamics()
        robot.inverse_dynamics(*GIVEN[:, 0])
for target in (work, work, calls):
    threading.Thread(target=target, daemon=True).start()
time.sleep(0.2)
print('ended')
"""

FINALIZER = START + """
class Last:
    def __init__(self):
        self.me, self.robot, self.workspace = self, robot, robot.bind()
    def __del__(self):
        self.workspace.inverse_dynamics()
        self.robot.inverse_dynamics(*self.given)
        print('ended', flush=True)
last = Last()
last.given = GIVEN[:, 0].copy()
last.workspace.inverse_dynamics()
"""


@pytest.mark.parametrize('program', [AT_EXIT, OTHER_THREAD, DAEMONS, FINALIZER],
                         ids=['atexit', 'other thread', 'daemons', 'finalizer'])
def test_calls_at_the_end_of_the_interpreter_end_as_usual(program):
    done = subprocess.run([sys.executable, '-X', 'faulthandler', '-c', program],
                          timeout=100, capture_output=True, text=True, env={
                              **os.environ, 'KANE_DYNAMICS_THREADS': '3',
                              'PYTHONPATH': os.pathsep.join(sys.path),
                              'PYTHONMALLOC': 'malloc', 'MALLOC_PERTURB_': '2'})
    assert (done.returncode, done.stdout, done.stderr) == (0, 'ended\n', '')
