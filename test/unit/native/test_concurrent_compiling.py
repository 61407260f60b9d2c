"""Kernels that compile at once are those that compile one after another."""

import threading

from kane_dynamics import CompileError, InputError, Robot
from kane_dynamics.native.runtime import threads
from kane_dynamics.simulation.simulate import compile_simulation
from mechanisms import random_model, random_state
import numpy as np
import pytest

MODEL = random_model(8, 4)


def test_kernels_that_compiled_at_once_are_verified_and_the_same(monkeypatch):
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', 'off')
    monkeypatch.setenv('KANE_DYNAMICS_THREADS', '4')
    together = Robot(MODEL)
    one_by_one = Robot(MODEL)
    compile_simulation(together, 'rk4', 'body_torques')
    assert together.verify() < 1e-9
    monkeypatch.setenv('KANE_DYNAMICS_THREADS', '1')
    compile_simulation(one_by_one, 'rk4', 'body_torques')
    q, u, udot = random_state(MODEL, 0)
    for name, arguments in (('inverse_dynamics', (q, u, udot)), ('mass_matrix', (q,)),
                            ('forward_dynamics', (q, u, udot)),
                            ('body_torques', (q, u, udot))):
        assert np.array_equal(getattr(together, name)(*arguments),
                              getattr(one_by_one, name)(*arguments))


def test_several_jobs_run_at_once_and_one_thread_runs_them_in_order(monkeypatch):
    monkeypatch.setenv('KANE_DYNAMICS_THREADS', '2')
    meeting = threading.Barrier(3)
    threads.run_concurrently([lambda: meeting.wait(30.0)] * 3)
    monkeypatch.setenv('KANE_DYNAMICS_THREADS', '1')
    done = []
    threads.run_concurrently([lambda k=k: done.append((k, threading.get_ident()))
                              for k in range(5)])
    assert done == [(k, threading.get_ident()) for k in range(5)]


def test_the_first_error_is_raised_when_all_have_ended(monkeypatch):
    monkeypatch.setenv('KANE_DYNAMICS_THREADS', '4')
    done = []

    def fail():
        raise CompileError('of a job')
    with pytest.raises(CompileError, match='of a job'):
        threads.run_concurrently([fail, *(lambda k=k: done.append(k) for k in range(6))])
    assert sorted(done) == list(range(6))
    with pytest.raises(InputError, match="no kernel 'nonsense'"):
        Robot(MODEL).compile('mass_matrix', 'nonsense')
