"""Long machine code is loaded several times, the fastest copy kept."""

import time

from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.machine_code.llvm import faster_copy
import numpy as np
import pytest

TEXT = """
define void @kernel(ptr %args) {
  ret void
}
"""
DELAY = 2e-3  # s


@pytest.fixture
def objects():
    """Return the object file of a function that does nothing."""
    return llvm.assemble(TEXT)


def trial_with_slow_copies(slow, seen):
    """Return a trial that takes longer for these copies, in order of time."""
    def trial(address):
        if address not in seen:
            seen.append(address)
        if seen.index(address) in slow:
            time.sleep(DELAY)
    return trial


@pytest.mark.parametrize(('slow', 'kept'), [((0,), 1), ((1,), 0)])
def test_the_faster_of_two_copies_is_kept(objects, monkeypatch, slow, kept):
    monkeypatch.setattr(llvm, 'LONG_CODE', len(objects))
    tried = []
    code = faster_copy(objects, 'kernel', trial_with_slow_copies(slow, tried))
    assert len(tried) == 2
    assert code.address('kernel') == tried[kept]


def test_longer_code_has_more_copies_and_a_bounded_number(objects, monkeypatch):
    for size, copies in ((len(objects) // 2, 3), (1, llvm.MOST_COPIES)):
        monkeypatch.setattr(llvm, 'LONG_CODE', size)
        tried = []
        slow = range(copies - 1)
        code = faster_copy(objects, 'kernel', trial_with_slow_copies(slow, tried))
        assert len(tried) == copies
        assert code.address('kernel') == tried[-1]


def test_short_code_is_loaded_once_and_not_timed(objects):
    def trial(address):
        raise AssertionError('timed')
    assert len(objects) < llvm.LONG_CODE
    assert faster_copy(objects, 'kernel', trial).address('kernel')


@pytest.mark.parametrize('kind', ['single', 'batch'])
def test_results_are_those_of_either_copy(monkeypatch, kind):
    # A kernel of 22 axes is long, as a function of one state and of a batch.
    trials = []

    def counted(objects, symbol, run):
        trials.append(len(objects))
        return faster_copy(objects, symbol, run)
    monkeypatch.setattr(llvm, 'faster_copy', counted)
    robot = Robot(load_urdf(resource_path('urdf', 'human_hand.urdf')))
    q, u, udot = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 4, robot.n))
    if kind == 'single':
        tau = [robot.inverse_dynamics(*state) for state in zip(q, u, udot)]
    else:
        tau = robot.inverse_dynamics(q, u, udot)
    assert max(trials) > llvm.LONG_CODE
    for k in range(4):
        back = robot.forward_dynamics(q[k], u[k], tau[k])
        np.testing.assert_allclose(back, udot[k], atol=1e-6)
