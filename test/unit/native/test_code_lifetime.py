"""
Machine code, and what the interpreter reads of it, outlives its users.

Each case is a process of its own: what breaks the promise kills it. The allocator writes
over all that is freed, so that nothing survives by chance.
"""

import os
import subprocess
import sys

import pytest

START = """
import gc
from mechanisms import random_model, random_state
from kane_dynamics import Robot
MODEL = random_model(3, 5)
STATE = random_state(MODEL, 0)

class Holder:
    def __init__(self, held):
        self.held, self.me = held, self
"""

# A function that is collected after the table that it reads: the holder is younger.
ENTRY = START + """
gc.disable()
for _ in range(3):
    robot = Robot(MODEL)
    robot.inverse_dynamics(*STATE)
    Holder(robot.inverse_dynamics)
    del robot
    assert gc.collect()
"""

# The same of a workspace's function, and of the method of one, held when all else is
# collected.
METHOD = START + """
gc.disable()
for _ in range(3):
    robot = Robot(MODEL, wrench_frames=['frame4'])
    workspace = robot.bind()
    Holder([robot.bind().mass_matrix, workspace.inverse_dynamics,
            workspace.at_frame('frame_pose', 'frame4')])
    call = workspace.inverse_dynamics
    del robot, workspace
    assert gc.collect()
    call()
    del call
"""

# Two threads that are the first to need the same code both make it. One code is kept,
# and here the late thread's function: another time they are of one thread.
FIRST_TOGETHER = START + """
from contextlib import suppress
import threading
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.runtime import loops
robot = Robot(MODEL)
kernel = robot.kernels.kernel('inverse_dynamics')
kernel.compile()
vars(loops.SOURCE).pop('code', None)
loops._repeat.cache_clear()
both, one = threading.Barrier(2), threading.Event()
load, address = llvm.Code.__init__, llvm.Code.address

def load_together(self, objects):
    load(self, objects)
    with suppress(threading.BrokenBarrierError):
        both.wait(5.0)  # alone where cached_property has a lock, as in Python 3.11

def late(self, name):
    if threading.current_thread().name == 'late':
        assert one.wait(10.0)
    return address(self, name)
llvm.Code.__init__, llvm.Code.address = load_together, late

def work():
    kernel(*STATE)
    one.set()
threads = [threading.Thread(target=work, name=name) for name in ('early', 'late')]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
assert one.is_set()
kernel(*STATE)
"""


# A finalizer that calls what is collected with it: functions of a robot and of a
# workspace, and methods, whose code must not be unloaded by a finalizer of its own.
FINALIZERS = START + """
called = []

class Caller:
    def __init__(self, call, *given):
        self.me, self.call, self.given = self, call, given

    def __del__(self):
        assert self.call(*self.given).shape
        called.append(self)

gc.disable()
for kind in range(4):
    robot = Robot(MODEL, wrench_frames=['frame4'])
    workspace = robot.bind()
    pose = workspace.at_frame('frame_pose', 'frame4')
    calls = ([robot.gravity_force, STATE[0]], [workspace.gravity_force], [pose],
             [robot.mass_matrix, STATE])
    for call, *given in calls[kind:kind + 1]:
        call(*given)
        Caller(call, *given)
    del robot, workspace, pose, call, given
    assert gc.collect()
    assert len(called) == kind + 1
    called[-1].me = called[-1].call = None
"""


@pytest.mark.parametrize('program', [ENTRY, METHOD, FIRST_TOGETHER, FINALIZERS],
                         ids=['entry', 'method', 'first together', 'finalizers'])
def test_freed_code_and_tables_are_never_used(program):
    environment = {**os.environ, 'PYTHONMALLOC': 'malloc', 'MALLOC_PERTURB_': '2',
                   'PYTHONFAULTHANDLER': '1', 'PYTHONPATH': os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, '-c', program], env=environment, timeout=120,
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
