"""Real-time settings: asked for, made or refused in one line, and never for the other threads."""

import gc
import os
import re
import resource
import threading

from kane_dynamics.ros.common import realtime
import pytest

OFF = {'realtime.priority': 0, 'realtime.cpus': (), 'realtime.lock_memory': False,
       'realtime.collect_rarely': False}


@pytest.fixture(autouse=True)
def _collecting():
    yield
    gc.enable()


def refuse(*arguments):
    raise PermissionError(1, 'Operation not permitted')


def test_nothing_is_touched_unless_it_is_asked_for(monkeypatch):
    for name in ('sched_setscheduler', 'sched_setaffinity'):
        monkeypatch.setattr(os, name, refuse)
    monkeypatch.setattr(realtime, 'lock_memory', refuse)
    warnings = []
    realtime.apply(OFF, warnings.append)
    assert not warnings
    assert gc.isenabled()


def test_each_refusal_is_one_warning_that_says_what_would_help(monkeypatch):
    for name in ('sched_setscheduler', 'sched_setaffinity'):
        monkeypatch.setattr(os, name, refuse)
    monkeypatch.setattr(realtime, '_capable', lambda number: False)
    monkeypatch.setattr(resource, 'getrlimit', lambda kind: (65536, 65536))
    warnings = []
    realtime.apply({'realtime.priority': 40, 'realtime.cpus': (0,), 'realtime.lock_memory': True,
                    'realtime.collect_rarely': True}, warnings.append)
    assert len(warnings) == 3
    for words, warning in zip(('realtime.priority 40 .*rtprio', 'realtime.cpus', 'only 65536'),
                              warnings):
        assert 'goes on without it' in warning
        assert re.search(words, warning)
    assert not gc.isenabled()


def test_a_processor_that_is_not_there_is_refused_with_those_that_are():
    warnings = []
    realtime.apply({**OFF, 'realtime.cpus': (4000,)}, warnings.append)
    assert len(warnings) == 1
    assert str(sorted(os.sched_getaffinity(0))) in warnings[0]


def test_only_the_main_thread_and_those_of_dds_are_scheduled():
    release = threading.Event()
    thread = threading.Thread(target=release.wait)
    thread.start()
    try:
        assert thread.native_id not in realtime.path_threads()
        assert realtime.path_threads()[0] == os.getpid()
    finally:
        release.set()
        thread.join()


def test_garbage_is_collected_by_hand_only_while_the_interpreter_does_not(monkeypatch):
    collected = []
    monkeypatch.setattr(gc, 'collect', lambda: collected.append(True))
    realtime.collect()
    assert not collected
    realtime.collect_when_asked(True)
    realtime.collect()
    assert collected
    realtime.collect_when_asked(False)
    assert gc.isenabled()
