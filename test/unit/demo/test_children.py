"""The demo waits for processes while they make progress, and says why not."""

import sys
import time

from kane_dynamics.demo import children as demo
from kane_dynamics.demo.children import Child, DemoError, Waiting
import pytest

BUSY = 'while True: sum(range(10**5))'
TALKING = ('import time\nfor k in range(100): print("line", k, flush=True); '
           'time.sleep(0.1)')
IDLE = 'import time; time.sleep(60)'
FAILING = 'print("no such robot"); raise SystemExit(3)'


@pytest.fixture
def child():
    started = []

    def start(program):
        started.append(Child('arm', [sys.executable, '-u', '-c', program]))
        return started[-1]
    yield start
    for process in started:
        process.process.kill()
        process.end()


def wait(child, seconds):
    waiting = Waiting('the arm', [child])
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        waiting.check()
        time.sleep(0.05)


@pytest.mark.parametrize('program', [BUSY, TALKING])
def test_the_demonstration_waits_while_a_child_makes_progress(
        program, child, monkeypatch):
    busy = child(program)
    monkeypatch.setattr(demo, 'PATIENCE', 1.5)
    wait(busy, 3.0)
    monkeypatch.setattr(demo, 'MOST', 0.5)
    with pytest.raises(DemoError, match='the arm: no progress for'):
        wait(busy, 3.0)


def test_the_demonstration_ends_when_no_child_makes_progress(child, monkeypatch):
    idle = child(IDLE)
    time.sleep(1.0)  # its start is progress
    monkeypatch.setattr(demo, 'PATIENCE', 0.5)
    with pytest.raises(DemoError, match='the arm: no progress for'):
        wait(idle, 10.0)


def test_a_child_that_ended_is_named_with_its_code_and_its_last_lines(child, capfd):
    with pytest.raises(DemoError,
                       match=r'arm ended with exit code 3\n  arm: no such robot'):
        wait(child(FAILING), 10.0)
    assert 'arm: no such robot' in capfd.readouterr().err


def test_the_demonstration_names_the_child_that_it_waits_for(child, monkeypatch, capfd):
    monkeypatch.setattr(demo, 'SAY', 0.2)
    wait(child(BUSY), 1.0)
    assert ('waiting for 1 s: the arm; processor time: arm'
            in capfd.readouterr().err.replace('for 0 s', 'for 1 s'))
