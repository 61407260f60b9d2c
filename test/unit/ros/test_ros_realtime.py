"""Real-time settings: applied or refused with one warning, for the torque path only."""

import gc
import os
import re
import resource
import threading

from kane_dynamics.ros.common import realtime
import pytest

OFF = {'realtime.priority': 0, 'realtime.cpus': (), 'realtime.lock_memory': False,
       'realtime.keep_awake': False}


@pytest.fixture(autouse=True)
def _collecting():
    yield
    gc.enable()


def refuse(*arguments):
    raise PermissionError(1, 'Operation not permitted')


def test_default_parameters_change_nothing(monkeypatch):
    for name in ('sched_setscheduler', 'sched_setaffinity'):
        monkeypatch.setattr(os, name, refuse)
    monkeypatch.setattr(realtime, 'lock_memory', refuse)
    monkeypatch.setattr(realtime.Awake, 'hold', refuse)
    warnings = []
    realtime.apply_realtime_settings(OFF, warnings.append)
    assert not warnings
    assert gc.isenabled()


def test_each_refusal_is_one_warning_with_the_remedy(monkeypatch):
    for name in ('sched_setscheduler', 'sched_setaffinity'):
        monkeypatch.setattr(os, name, refuse)
    monkeypatch.setattr(realtime, '_capable', lambda number: False)
    monkeypatch.setattr(resource, 'getrlimit', lambda kind: (65536, 65536))
    monkeypatch.setattr(realtime, 'LATENCY', '/proc/version')  # cannot be written
    warnings = []
    realtime.apply_realtime_settings(
        {'realtime.priority': 40, 'realtime.cpus': (0,), 'realtime.lock_memory': True,
         'realtime.keep_awake': True}, warnings.append)
    assert len(warnings) == 4
    for words, warning in zip(('realtime.priority 40: .*rtprio', 'realtime.cpus',
                               'RLIMIT_MEMLOCK: 65536 bytes; expected no limit',
                               'realtime.keep_awake: .*write access'), warnings):
        assert 'the node runs without it' in warning
        assert re.search(words, warning)


def test_processors_are_kept_awake_until_release_or_the_next_settings(
        monkeypatch, tmp_path):
    device = tmp_path / 'latency'
    device.touch()
    monkeypatch.setattr(realtime, 'LATENCY', str(device))

    def requests():
        files = (f'/proc/self/fd/{file}' for file in os.listdir('/proc/self/fd'))
        return sum(os.path.realpath(file) == str(device) for file in files)

    for end in (realtime.release, lambda: realtime.apply_realtime_settings(OFF, None)):
        for _ in range(2):
            realtime.apply_realtime_settings({**OFF, 'realtime.keep_awake': True}, None)
            assert requests() == 1
        assert device.read_bytes() == bytes(4)  # wake at once
        end()
        assert requests() == 0


def test_an_unavailable_processor_is_refused_with_the_available_ones():
    warnings = []
    realtime.apply_realtime_settings({**OFF, 'realtime.cpus': (4000,)}, warnings.append)
    assert len(warnings) == 1
    assert str(sorted(os.sched_getaffinity(0))) in warnings[0]


def test_only_the_main_thread_and_dds_threads_are_scheduled():
    release = threading.Event()
    thread = threading.Thread(target=release.wait)
    thread.start()
    try:
        assert thread.native_id not in realtime.path_threads()
        assert realtime.path_threads()[0] == os.getpid()
    finally:
        release.set()
        thread.join()
