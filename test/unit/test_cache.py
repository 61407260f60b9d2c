"""Promises of the cache of machine code: safe to share, never trusted blindly."""

import multiprocessing
import os

from kane_dynamics import kernel_set, Robot
from kane_dynamics.native import cache
from mechanisms import random_model, random_state
import numpy as np
import pytest

MODEL = random_model(8, 3)
STATE = random_state(MODEL, 0)


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Use an empty cache of the test's own."""
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', str(tmp_path / 'kept'))
    return tmp_path / 'kept'


def torque(_=None):
    """Return what a fresh robot says."""
    return Robot(MODEL).inverse_dynamics(*STATE)


def test_a_hit_traces_nothing(place, monkeypatch):
    expected = torque()

    def refuse(*arguments):
        raise AssertionError('traced in spite of the cache')
    monkeypatch.setattr(kernel_set, 'trace_program', refuse)
    assert np.array_equal(torque(), expected)


def test_the_directory_is_private(place):
    torque()
    assert place.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize('damage', [
    lambda b: b[:len(b) // 2], lambda b: b'', lambda b: b[:-1] + bytes([b[-1] ^ 1]),
    lambda b: b'something else entirely', lambda b: b[:40] + b'\0' * (len(b) - 40)])
def test_a_damaged_file_is_rebuilt(place, damage):
    expected = torque()
    for file in place.iterdir():
        file.write_bytes(damage(file.read_bytes()))
    assert np.array_equal(torque(), expected)
    assert cache.load(next(iter(os.listdir(place)))) is not None


def test_a_file_under_anothers_name_is_not_trusted(place):
    Robot(MODEL).compile()
    files = sorted(place.iterdir())
    contents = [file.read_bytes() for file in files]
    for file, content in zip(files, contents[1:] + contents[:1]):
        file.write_bytes(content)
    assert all(cache.load(file.name) is None for file in files)


def test_a_directory_that_others_may_write_to_is_not_used(place):
    place.mkdir(mode=0o700)
    place.chmod(0o777)
    torque()
    assert not list(place.iterdir())


def test_off_keeps_nothing(monkeypatch, tmp_path):
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', 'off')
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    torque()
    assert not list(tmp_path.iterdir())


def test_a_place_that_cannot_be_made_is_no_error(monkeypatch, tmp_path):
    (tmp_path / 'file').write_text('')
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', str(tmp_path / 'file' / 'below'))
    assert torque().shape == (3,)


def test_every_option_has_code_of_its_own(place):
    def files(robot):
        robot.inverse_dynamics(*STATE)
        return set(os.listdir(place))
    first = files(Robot(MODEL))
    second = files(Robot(MODEL, friction=False))
    third = files(Robot(random_model(9, 3)))
    assert len(first) < len(second) < len(third)
    assert files(Robot(MODEL)) == third


def test_processes_that_start_together_do_not_disturb_each_other(place):
    expected = torque()
    for file in place.iterdir():
        file.unlink()
    with multiprocessing.get_context('spawn').Pool(4) as pool:
        for result in pool.map(torque, range(8)):
            assert np.array_equal(result, expected)
    assert not [name for name in os.listdir(place) if name.startswith('tmp')]
