"""
Stress the machine code and what the interpreter reads of it, from several threads.

Run as a program: the argument is the time in s. Every number is compared with that of a
robot that lives throughout. The process exits while its threads run.
"""

from contextlib import suppress
import faulthandler
import gc
import os
import pickle
import random
import signal
import sys
import threading
import time
import warnings
import weakref

from kane_dynamics import InputError, Robot, simulate
from kane_dynamics.native.runtime import threads
from mechanisms import random_model, random_state
import numpy as np

THREADS = 4
NAMES = ('inverse_dynamics', 'mass_matrix', 'forward_dynamics', 'kinetic_energy',
         'gravity_force')
ARGUMENTS = {'inverse_dynamics': 3, 'mass_matrix': 1, 'forward_dynamics': 3,
             'kinetic_energy': 2, 'gravity_force': 1}
STATES = 40
FRAME = 'frame2'


class Interrupt(BaseException):
    """Raised in the main thread by a timer."""


class Holder:
    """A cycle that only the garbage collector frees, with a finalizer that calls."""

    def __init__(self, *held):
        self.held, self.me = held, self

    def __del__(self):
        for call in self.held:
            call()


class Stress:
    """The shared robots, replaced all the time, and what threads do with them."""

    def __init__(self):
        self.models = [random_model(seed, 3) for seed in (3, 4)]
        self.states = []
        for model in self.models:
            states = [random_state(model, k) for k in range(STATES)]
            self.states.append(np.array(states).swapaxes(0, 1))
        self.kept = [self.robot(k) for k in range(2)]
        self.shared = [self.robot(k) for k in range(2)]
        # What every thread must get, computed before there are threads.
        self.expected = []
        self.poses = []
        for k, robot in enumerate(self.kept):
            states = self.states[k]
            self.expected.append({name: self.batch(robot, name, states)
                                  for name in NAMES})
            self.poses.append(robot.frame_pose(FRAME, states[0]))
            # Simulations of one state and of many fill the cache.
            for count in (1, 9):
                self.simulated(robot, k, count)
        self.failures, self.counts = [], dict.fromkeys(self.works(), 0)
        self.callbacks = 0

    def works(self):
        return {name.removeprefix('do_'): getattr(self, name) for name in dir(self)
                if name.startswith('do_')}

    def robot(self, k):
        return Robot(self.models[k], wrench_frames=[FRAME])

    def batch(self, robot, name, states):
        return getattr(robot, name)(*states[:ARGUMENTS[name]])

    def same(self, k, name, found, rows=slice(None)):
        assert np.allclose(found, self.expected[k][name][rows],
                           rtol=1e-9, atol=1e-9), name

    def do_single(self, rng):
        k = rng.randrange(2)
        name = rng.choice(NAMES)
        call = getattr(self.shared[k], name)
        results = []
        for i in range(STATES):
            results.append(call(*self.states[k][:ARGUMENTS[name], i]))
            if rng.random() < 0.2 and name != 'kinetic_energy':
                references = [weakref.ref(results[-1], self.called_back)]
                del results[-1], references[:]
                results.append(call(*self.states[k][:ARGUMENTS[name], i]))
        self.same(k, name, results)

    def called_back(self, reference):
        self.callbacks += 1
        self.kept[0].gravity_force(self.states[0][0, 0])

    def do_batch(self, rng):
        k = rng.randrange(2)
        name = rng.choice(NAMES)
        rows = np.array([rng.randrange(STATES) for _ in range(rng.choice([1, 7, 500]))])
        self.same(k, name, self.batch(self.shared[k], name, self.states[k][:, rows]),
                  rows)

    def do_workspace(self, rng):
        k = rng.randrange(2)
        i = rng.randrange(STATES)
        workspace = self.shared[k].bind()
        workspace.q[:], workspace.u[:], workspace.udot[:] = self.states[k][:, i]
        calls = []
        for name in NAMES:
            if name != 'forward_dynamics':
                calls.append(getattr(workspace, name))
        pose = workspace.at_frame('frame_pose', FRAME)
        for call in calls:
            self.same(k, call.__name__, call(), i)
        assert np.allclose(pose(), self.poses[k][i])
        call = workspace.gravity_force
        del workspace, calls
        self.same(k, 'gravity_force', call(), i)
        if rng.random() < 0.3:
            shared_mass_matrix = self.shared[k].bind().mass_matrix
            shared_mass_matrix()
            Holder(call, pose, shared_mass_matrix)

    def do_replace(self, rng):
        k = rng.randrange(2)
        robot = self.robot(k)
        if rng.random() < 0.5:
            call = robot.bind().gravity_force
            call()
            Holder(call)
            robot = rng.choice([robot.copy, lambda: pickle.loads(pickle.dumps(robot))])()
        self.shared[k] = robot

    def do_exceptions(self, rng):
        k = rng.randrange(2)
        n = 3
        robot = self.shared[k]
        workspace = self.shared[k].bind()
        workspace.q[:] = np.nan
        for call in (lambda: robot.gravity_force(np.full(n, np.nan)),
                     lambda: robot.gravity_force(np.zeros((2, 3, n))),
                     lambda: robot.mass_matrix(np.full((9, n), np.inf)),
                     lambda: robot.inverse_dynamics(*np.full((3, n), 1e308)),
                     lambda: robot.gravity_force(np.zeros(n), out=np.zeros(1)),
                     workspace.gravity_force, workspace.mass_matrix,
                     lambda: workspace.mass_matrix(1)):
            try:
                call()
            except InputError:
                continue
            raise AssertionError('no InputError')
        for call in (object.__new__(type(workspace)).mass_matrix,
                     lambda: pickle.dumps(workspace.gravity_force)):
            with suppress(TypeError):
                call()
                raise AssertionError('no TypeError')

    def do_pickle(self, rng):
        k = rng.randrange(2)
        i = rng.randrange(STATES)
        call = pickle.loads(pickle.dumps(self.shared[k].gravity_force))
        self.same(k, 'gravity_force', call(self.states[k][0, i]), i)

    def do_simulate(self, rng):
        k = rng.randrange(2)
        self.simulated(self.shared[k], k, rng.choice([1, 9]))

    def simulated(self, robot, k, count):
        with suppress(InputError):  # random states may diverge
            simulate(robot, *self.states[k][:2, :count], 0.02, step=1e-3)

    def do_collect(self, rng):
        gc.collect(rng.randrange(3))

    def work(self, seed):
        """Do random work, for ever."""
        rng = random.Random(seed)
        works = self.works()
        while True:
            name = rng.choice([*works])
            try:
                works[name](rng)
            except BaseException as error:
                self.failures.append(f'{name}: {error!r}')
                raise
            self.counts[name] += 1

    def main(self, seconds):
        """Interrupt batches, and fork, while the other threads work."""
        rng = random.Random(0)
        for seed in range(1, THREADS + 1):
            threading.Thread(target=self.work, args=(seed,), daemon=True).start()
        end = time.monotonic() + seconds
        while time.monotonic() < end and not self.failures:
            self.interrupted(rng)
            self.forked(rng)
        assert not self.failures, self.failures
        assert all(self.counts.values()), self.counts

    def interrupted(self, rng):
        """Interrupt batches on memory that is freed at once."""
        with suppress(Interrupt):
            signal.setitimer(signal.ITIMER_REAL, 0.01)
            while True:
                rows = np.arange(rng.choice([500, 20_000])) % STATES
                self.same(0, 'forward_dynamics',
                          self.batch(self.kept[0], 'forward_dynamics',
                                     self.states[0][:, rows]), rows)

    def forked(self, rng):
        """Compute in a forked child."""
        child = os.fork()
        if not child:
            signal.alarm(60)
            code = 1
            try:
                signal.signal(signal.SIGALRM, signal.SIG_DFL)
                self.do_batch(rng)
                self.do_single(rng)
                code = 0
            finally:
                os._exit(code)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def interrupt(number, frame):
    """Raise Interrupt."""
    raise Interrupt


if __name__ == '__main__':
    faulthandler.enable()
    # Forks beside threads; random states need short steps.
    warnings.simplefilter('ignore')
    os.environ[threads.VARIABLE] = '3'
    threads.THREAD_WORK = 1e-6
    signal.signal(signal.SIGALRM, interrupt)
    # Else the interrupted thread collects: llvmlite's lock survives no interrupt.
    gc.disable()
    stress = Stress()
    stress.main(float(sys.argv[1]))
    print(stress.counts, flush=True)
