"""An exception raised by a signal leaves nothing running: batches, compiling."""

from pathlib import Path
import signal
import threading
import time

from kane_dynamics import CompileError, Robot, simulate
from kane_dynamics.native.runtime import threads
from kane_dynamics.native.runtime.loops import run_batch, Strided
from mechanisms import random_model
import numpy as np
import pytest

N = 5
MODEL = random_model(3, N)
TASKS = Path('/proc/self/task')
BATCHES = ('forward_dynamics', 'kinetic_energy', 'potential_energy')


def tasks():
    """Return the number of threads, without those that are just ending."""
    time.sleep(0.02)
    return len([*TASKS.iterdir()])


class Interrupt(KeyboardInterrupt):
    """Raised by the handler of the timer."""


@pytest.fixture(scope='module')
def robot():
    robot = Robot(MODEL)
    robot.compile(*BATCHES, batches=True)
    return robot


@pytest.fixture(autouse=True)
def many_threads(monkeypatch):
    """More threads than processors: the caller's share ends before the others."""
    monkeypatch.setenv(threads.VARIABLE, '8')


def interrupt(call, first, interval=0.0):
    """Call until interrupts have ended it."""
    ended = False

    def handler(number, frame):
        if not ended:  # else the exception would reach whatever runs next
            raise Interrupt
    former_handler = signal.signal(signal.SIGALRM, handler)
    try:
        with pytest.raises(Interrupt):
            try:
                signal.setitimer(signal.ITIMER_REAL, first, interval)
                call()
            finally:
                ended = True
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, former_handler)


def repeated_batch(robot, out, steps):
    """Compute forward dynamics of random states many times, as a batch of long work."""
    kernel = robot.kernels.kernel('forward_dynamics')
    inputs = np.random.default_rng(0).normal(size=(3, len(out), N))
    parameters = robot.parameters.block.copy()
    rows = [*(Strided(x.ctypes.data, x.strides[0]) for x in inputs),
            Strided(parameters.ctypes.data), Strided(out.ctypes.data, out.strides[0])]
    run_batch(kernel.compile_lanes(), rows, len(out), steps=steps)
    return inputs


@pytest.mark.parametrize('interval', [0.0, 0.001], ids=['one', 'many'])
def test_no_thread_writes_after_an_interrupted_batch(robot, interval):
    out = np.empty((20_000, N))
    threads_before = tasks()
    for first in (0.02, 0.13):
        out.fill(np.nan)
        interrupt(lambda: repeated_batch(robot, out, 2000), first, interval)
        assert tasks() <= threads_before
        left = out.copy()
        assert np.isnan(left).any(), 'the batch was complete'
        time.sleep(0.1)
        assert np.array_equal(out, left, equal_nan=True)
    inputs = repeated_batch(robot, out, 1)
    assert np.array_equal(out, robot.forward_dynamics(*inputs))


def test_an_interrupt_ends_a_long_batch_with_little_of_its_work_done(robot):
    out = np.full((20_000, N), np.nan)
    interrupt(lambda: repeated_batch(robot, out, 5000), 0.2)
    assert np.isnan(out).mean() > 0.7


@pytest.mark.parametrize('states, step', [(None, 1e-4), (50, 1e-3)],
                         ids=['single', 'many'])
def test_no_thread_survives_an_interrupted_simulation(robot, states, step):
    threads_before = tasks()
    q0 = np.ones(N) if states is None else np.ones((states, N))

    def run():
        simulate(robot, q0, np.zeros_like(q0), 100.0, step=step)
    run_once = simulate(robot, q0, np.zeros_like(q0), 0.01, step=1e-3)  # compiles
    assert np.isfinite(run_once.q).all()
    interrupt(run, 0.05, 0.01)
    assert tasks() <= threads_before


def test_interrupted_compiling_ends_when_its_threads_have_ended(monkeypatch):
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', 'off')
    robot = Robot(MODEL)
    interrupt(robot.compile, 0.1, 0.005)
    tasks()
    assert not [thread for thread in threading.enumerate()
                if thread.is_alive() and thread.name.startswith('kane_dynamics')]
    assert robot.verify() < 1e-9


def test_waiting_for_jobs_survives_interrupts_and_starts_no_more():
    started = []
    ended = []

    def job():
        started.append(0)
        time.sleep(0.1)
        ended.append(0)
    interrupt(lambda: threads.run_concurrently([job] * 100), 0.05, 0.001)
    assert 0 < len(started) < 100
    assert len(started) - len(ended) <= 1, 'only the job of the interrupted thread'


def test_an_exception_of_a_job_is_raised_when_all_have_ended():
    ended = []

    def late():
        time.sleep(0.1)
        ended.append(0)

    def fail():
        raise CompileError('of a job')
    with pytest.raises(CompileError, match='of a job'):
        threads.run_concurrently([fail, *[late] * 5])
    assert len(ended) == 5
