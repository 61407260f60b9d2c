"""A forked child computes and compiles whatever the parent's threads do."""

import os
import subprocess
import sys

import pytest

START = """
import faulthandler, gc, multiprocessing, os, signal, threading, time, warnings
warnings.simplefilter('ignore')
faulthandler.dump_traceback_later(50.0, exit=True)
from mechanisms import random_model, random_state
from kane_dynamics import Robot, simulate
from kane_dynamics.native.runtime import threads
import numpy as np
threads.THREAD_WORK = 1e-12
MODEL = random_model(3, 3)
GIVEN = np.random.default_rng(0).normal(size=(3, 3000, 3))
robot = Robot(MODEL)
robot.compile('inverse_dynamics', batches=True)
expected = robot.inverse_dynamics(*GIVEN)
stop = threading.Event()

def beside(work):
    def repeat():
        while not stop.is_set():
            work()
    thread = threading.Thread(target=repeat)
    thread.start()
    return thread

def batch():
    assert np.array_equal(robot.inverse_dynamics(*GIVEN), expected)

def compile():
    os.environ['KANE_DYNAMICS_CACHE'] = 'off'
    other = Robot(MODEL, friction=False)
    other.compile('mass_matrix', 'gravity_force', batches=True)
    assert np.isfinite(other.mass_matrix(GIVEN[0, :9])).all()
    assert gc.isenabled()

def beside_two(work, forks):
    workers = [beside(work), beside(work)]
    try:
        forks()
    finally:
        stop.set()
    for worker in workers:
        worker.join()

def children(work, count):
    for _ in range(count):
        child = os.fork()
        if not child:
            signal.alarm(20)
            try:
                work()
            except BaseException:
                import traceback
                traceback.print_exc()
                os._exit(2)
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
"""

BATCHES = START + """
batch()
children(batch, 1)
beside_two(batch, lambda: children(batch, 30))
"""

COMPILING = START + """
def compile_in_parent():
    other = Robot(MODEL)
    other.compile('mass_matrix', 'inverse_mass_matrix', batches=True)
os.environ['KANE_DYNAMICS_CACHE'] = 'off'
beside_two(compile_in_parent, lambda: children(compile, 6))
assert gc.isenabled()
"""

# A kernel that another thread compiles at the fork: its lock, and the lock of lazy
# properties.
SAME_KERNEL = START + """
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics.native.machine_code import llvm
inside, go = threading.Event(), threading.Event()
assemble = llvm.assemble

def wait_inside(*given, **options):
    if threading.current_thread().name == 'compiling':
        inside.set()
        go.wait(30.0)
    return assemble(*given, **options)
llvm.assemble = wait_inside

class Lazy:
    @lazy_property
    def value(self):
        if threading.current_thread().name == 'compiling':
            wait_inside('')
        return 1
os.environ['KANE_DYNAMICS_CACHE'] = 'off'
other, lazy = Robot(MODEL, friction=False), Lazy()
other.compile('inverse_dynamics')
for work in (lambda: other.inverse_dynamics(*GIVEN), lambda: lazy.value):
    inside.clear()
    go.clear()
    thread = threading.Thread(target=lambda: [work()], name='compiling', daemon=True)
    thread.start()
    assert inside.wait(30.0)
    children(work, 1)
    go.set()
"""

# As data loaders do: a pool of forked processes that call the robot's methods.
POOL = START + """
def of_row(k):
    accelerations = robot.forward_dynamics(*GIVEN[:, k:k + 9])
    return accelerations, robot.inverse_dynamics(*GIVEN[:, k])

worker = beside(batch)
try:
    with multiprocessing.get_context('fork').Pool(2) as pool:
        rows = pool.map_async(of_row, range(20)).get(40.0)
        calls = pool.starmap_async(robot.inverse_dynamics, zip(*GIVEN[:, :20]))
        torques = calls.get(40.0)
finally:
    stop.set()
worker.join()
np.testing.assert_allclose(torques, expected[:20], rtol=1e-12)
np.testing.assert_allclose([row[1] for row in rows], expected[:20], rtol=1e-12)
"""


@pytest.mark.parametrize('program', [BATCHES, COMPILING, SAME_KERNEL, POOL],
                         ids=['batches', 'compiling', 'same kernel', 'pool'])
def test_forked_children_neither_hang_nor_differ(program):
    done = subprocess.run([sys.executable, '-c', program], timeout=100, text=True,
                          capture_output=True, env={
                              **os.environ, 'KANE_DYNAMICS_THREADS': '3',
                              'PYTHONPATH': os.pathsep.join(sys.path)})
    assert done.returncode == 0, done.stderr
