"""Cache of machine code: safe for concurrent use, rebuilt when damaged or untrusted."""

from functools import partial
import multiprocessing
import os
from pathlib import Path
import shutil
import subprocess
import sys

import kane_dynamics
from kane_dynamics import Robot
from kane_dynamics._util import disk_cache
from kane_dynamics.native.tracing.program import origin
from kane_dynamics.robot import kernel_set
import mechanisms
from mechanisms import random_model, random_state
import numpy as np
import pytest

MODEL = random_model(8, 3)
STATE = random_state(MODEL, 0)
HELPERS = Path(mechanisms.__file__).parent


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Use an empty cache of the test's own, for the code of robots alone."""
    # The first robot of a process also stores code that the process then keeps in
    # memory.
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', str(tmp_path / 'of_the_process'))
    torque()
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', str(tmp_path / 'kept'))
    return tmp_path / 'kept'


def torque(_=None):
    """Return what a fresh robot says."""
    return Robot(MODEL).inverse_dynamics(*STATE)


def test_cache_hit_traces_nothing(place, monkeypatch):
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
    assert all(disk_cache.load(file.name) is not None for file in place.iterdir())


def test_file_with_another_files_content_is_rebuilt(place):
    Robot(MODEL).compile()
    files = sorted(place.iterdir())
    assert len(files) > 1
    contents = [file.read_bytes() for file in files]
    for file, content in zip(files, contents[1:] + contents[:1]):
        file.write_bytes(content)
    assert all(disk_cache.load(file.name) is None for file in files)


def test_a_directory_that_others_may_write_to_is_not_used(place):
    place.mkdir(mode=0o700)
    place.chmod(0o777)
    torque()
    assert not list(place.iterdir())


def test_cache_off_stores_nothing(monkeypatch, tmp_path):
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', 'off')
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    torque()
    assert not list(tmp_path.iterdir())


def test_directory_that_cannot_be_created_is_no_error(monkeypatch, tmp_path):
    (tmp_path / 'file').write_text('')
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', str(tmp_path / 'file' / 'below'))
    assert torque().shape == (3,)


def test_every_option_has_its_own_code(place):
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
    with multiprocessing.get_context('spawn').Pool(3) as pool:
        for result in pool.map(torque, range(6)):
            assert np.array_equal(result, expected)
    assert not [name for name in os.listdir(place) if name.startswith('tmp')]


def test_a_file_that_others_may_write_to_is_not_trusted(place):
    disk_cache.store('name', b'code')
    assert disk_cache.load('name') == b'code'
    (place / 'name').chmod(0o620)
    assert disk_cache.load('name') is None


def test_least_recently_used_files_are_removed_first(place, monkeypatch):
    monkeypatch.setattr(disk_cache, 'MOST_BYTES', 10_000)
    body = bytes(900)
    for k in range(10):
        disk_cache.store(f'file{k}', body)
        os.utime(place / f'file{k}', (k, k))
    assert len(os.listdir(place)) == 10
    assert disk_cache.load('file0') == body
    disk_cache.store('one more', body)
    left = set(os.listdir(place))
    assert left == {'file0', 'one more', *(f'file{k}' for k in range(5, 10))}
    assert sum((place / name).stat().st_size for name in left) <= 7500


def test_all_files_are_looked_at_some_64_times_while_the_cache_fills(place, monkeypatch):
    looks = []
    monkeypatch.setattr(disk_cache, 'MOST_BYTES', 100_000)
    monkeypatch.setattr(disk_cache, '_prune', looks.append)
    for k in range(1000):
        disk_cache.store(f'file{k}', bytes(100))
    assert 40 <= len(looks) <= 90


def test_kernels_compile_again_after_their_files_were_removed(place, monkeypatch):
    expected = torque()
    monkeypatch.setattr(disk_cache, 'MOST_BYTES', 0)
    disk_cache.store('another', b'')
    assert not os.listdir(place)
    assert np.array_equal(torque(), expected)


def test_concurrent_interpreters_with_an_empty_cache_agree_and_leave_complete_files(
        place):
    """Four interpreters race for an empty cache, pruned to almost nothing."""
    program = """
import sys
from kane_dynamics import Robot
from kane_dynamics._util import disk_cache
from kane_dynamics.native.tracing.program import origin
from mechanisms import random_model, random_state
disk_cache.MOST_BYTES = int(sys.argv[1])
model = random_model(8, 3)
sys.stdout.write(Robot(model).inverse_dynamics(*random_state(model, 0)).tobytes().hex())
"""
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)}
    running = []
    for size_limit in (0, 2**20, 2**20, 2**20):
        running.append(
            subprocess.Popen([sys.executable, '-c', program, str(size_limit)],
                             env=environment, stdout=subprocess.PIPE, text=True))
    results = {process.communicate(timeout=60)[0] for process in running}
    assert [process.returncode for process in running] == [0] * 4
    assert results == {torque().tobytes().hex()}
    assert all(disk_cache.load(name) is not None for name in os.listdir(place))


def test_an_edit_of_a_source_at_any_depth_compiles_afresh(place, tmp_path):
    copy = tmp_path / 'checkout' / 'kane_dynamics'
    shutil.copytree(Path(kane_dynamics.__file__).parent, copy,
                    ignore=shutil.ignore_patterns('__pycache__'))
    program = """
import numpy as np
from kane_dynamics import Coupling, Robot
from mechanisms import random_model
coupling = Coupling('joint2', {'joint0': 1.0})
Robot(random_model(8, 3), constraints=[coupling]).mass_matrix(np.zeros(3))
"""

    def kept():
        subprocess.run([sys.executable, '-c', program],
                       cwd=copy.parent, check=True, timeout=60,
                       env={**os.environ, 'PYTHONPATH': f'{copy.parent}:{HELPERS}',
                            'PYTHONDONTWRITEBYTECODE': '1'})
        return set(os.listdir(place))
    first = kept()
    files_before = kept()
    assert files_before == first
    for name in ('mechanics/constraints/constraint_types/position_constraints.py',
                 'native/backends/llvm_scalar.py', 'robot/kernel_set.py'):
        source = copy / name
        status = source.stat()
        text = source.read_text('utf-8')
        source.write_text(text.replace('.', ',', 1), 'utf-8')  # in its docstring
        os.utime(source, ns=(status.st_atime_ns, status.st_mtime_ns))
        files_after = kept()
        assert len(files_after - files_before) >= len(first), name
        files_before = files_after


def test_a_key_depends_on_the_code_of_the_rooms_that_it_names(monkeypatch):
    versions = ['CORE_VERSION', 'APPLICATIONS_VERSION', 'PACKAGE_VERSION']

    def changes(part):
        """Return the versions on which the key of a part depends."""
        depends = []
        for version in versions:
            with monkeypatch.context() as patch:
                before = disk_cache.key(part)
                patch.setattr(disk_cache, version, 'changed')
                if disk_cache.key(part) != before:
                    depends.append(version)
        return depends
    assert changes('kane_dynamics.mechanics.equations.Equations.bias') == versions[:1]
    assert changes('kane_dynamics.control_cycle.cycle_rules.judge:7') == versions[1:2]
    assert changes('kane_dynamics.simulation.x kane_dynamics.ros.y') == versions[2:]


def test_an_edit_of_a_command_compiles_no_kernel_again(tmp_path):
    for name in ('mechanics', 'control', 'cli'):
        (tmp_path / name).mkdir()
        (tmp_path / name / 'module.py').write_text('')

    def digests():
        return [disk_cache.source_digest(tmp_path, left_out) for left_out in (
            disk_cache.APPLICATIONS | disk_cache.PROGRAMS, disk_cache.PROGRAMS,
            frozenset())]
    before = digests()
    (tmp_path / 'cli' / 'module.py').write_text('changed = 1')
    assert [new == old for new, old in zip(digests(), before)] == [True, True, False]
    before = digests()
    (tmp_path / 'control' / 'module.py').write_text('changed = 1')
    assert [new == old for new, old in zip(digests(), before)] == [True, False, False]
    before = digests()
    (tmp_path / 'mechanics' / 'module.py').write_text('changed = 1')
    assert [new == old for new, old in zip(digests(), before)] == [False, False, False]


def test_functions_of_objects_name_the_class_in_the_key():
    # A subclass may override what the function calls.
    class Law:

        def torque(self, q):
            return self.gain() * q

        def gain(self):
            return 1.0

    class Stiffer(Law):

        def gain(self):
            return 2.0
    assert origin(Law().torque) != origin(Stiffer().torque)
    assert origin(partial(Law.torque, Law())) != origin(partial(Law.torque, Stiffer()))
