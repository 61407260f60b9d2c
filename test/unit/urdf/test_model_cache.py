"""Promises of the cache of models: what it returns, it returns as a first load would."""

import json
import os
from pathlib import Path
import subprocess
import sys
import warnings

from kane_dynamics import load_urdf, ModelError, ModelWarning
from kane_dynamics._util import disk_cache
from kane_dynamics._util.resources import resource_path
from kane_dynamics.errors import InputError, UrdfError
from kane_dynamics.urdf import model_reader
import numpy as np
import pytest

SHIPPED = sorted(resource_path('urdf', 'fr3.urdf').parent.glob('*.urdf'))
SUPPLEMENTS = {'fr3': 'fr3.supplement.yaml', 'two_link': 'two_link.bending.yaml'}
DOUBTFUL = """<robot name="arm"><link name="base"/>
<link name="one"><inertial><mass value="2"/>
  <inertia ixx="1" iyy="1" izz="5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="a" type="revolute"><parent link="base"/><child link="one"/>
  <axis xyz="0 0 2"/><limit effort="0" velocity="1" lower="-1" upper="1"/></joint></robot>"""  # noqa: E501


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Use an empty cache of the test's own."""
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', str(tmp_path / 'kept'))
    return tmp_path / 'kept'


@pytest.fixture
def reads(monkeypatch):
    """Return a list that grows by one whenever a URDF is parsed."""
    reported = []
    read = model_reader.read_model

    def counted(*arguments, **options):
        reported.append(arguments)
        return read(*arguments, **options)
    monkeypatch.setattr(model_reader, 'read_model', counted)
    return reported


def loaded(*arguments, **options):
    """Return a model and the warnings of loading it, with where they point."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        model = load_urdf(*arguments, **options)
    return model, [(w.category, str(w.message), w.filename, w.lineno) for w in caught]


@pytest.mark.parametrize('path', SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_robot_comes_back_to_the_last_bit(place, reads, path):
    supplement = SUPPLEMENTS.get(path.stem) and path.parent / SUPPLEMENTS[path.stem]
    first, warned = loaded(path, supplement=supplement)
    again, told_again = loaded(path, supplement=supplement)
    assert len(reads) == 1
    assert again.digest() == first.digest() and told_again == warned
    for one, read_again in zip(first.bodies, again.bodies):
        assert one.joint.limits == read_again.joint.limits
        assert np.array_equal(one.joint.rotation, read_again.joint.rotation)
        assert not read_again.inertial.inertia.flags.writeable
        assert (one.beam is None) == (read_again.beam is None)
        if one.beam is not None:
            assert np.array_equal(one.beam.axial, read_again.beam.axial)


def test_a_hit_warns_as_the_first_load_did(place, reads):
    _, first = loaded(DOUBTFUL)
    _, again = loaded(DOUBTFUL)
    assert len(reads) == 1
    assert len(first) == 3 and again == first
    assert {(category, file) for category, _, file, _ in again} == {
        (ModelWarning, __file__)}
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        with pytest.raises(ModelWarning):
            load_urdf(DOUBTFUL)


def test_path_text_and_bytes_of_the_same_urdf_share_an_entry(place, reads, tmp_path):
    file = tmp_path / 'arm.urdf'
    file.write_text(DOUBTFUL)
    for source in (DOUBTFUL, DOUBTFUL.encode(), file, str(file),
                   DOUBTFUL.encode('utf-16')):
        loaded(source)
    assert len(reads) == 1


@pytest.mark.parametrize('change', [
    {'strict': False}, {'gravity': (0.0, 0.0, -1.62)}, {'joints': ['a']}, {'locked': {}},
    {'drop': ['one']}, {'base': 'base'}, {'tip': 'one'},
    {'supplement': {'joints': {'a': {'armature': 0.5}}}}],
                         ids=lambda change: next(iter(change)))
def test_every_argument_has_an_entry_of_its_own(place, reads, change):
    plain, _ = loaded(DOUBTFUL)
    expected, _ = loaded(DOUBTFUL, **change)
    assert len(reads) == 2
    assert loaded(DOUBTFUL, **change)[0].digest() == expected.digest()
    assert loaded(DOUBTFUL)[0].digest() == plain.digest()
    assert len(reads) == 2


def test_an_edited_urdf_or_supplement_is_read_again(place, reads, tmp_path):
    supplement = tmp_path / 'arm.yaml'
    supplement.write_text('joints: {a: {armature: 0.1}}')
    loaded(DOUBTFUL, supplement=supplement)
    supplement.write_text('joints: {a: {armature: 0.2}}')
    model, _ = loaded(DOUBTFUL, supplement=supplement)
    assert model.bodies[0].joint.armature == 0.2
    model, _ = loaded(DOUBTFUL.replace('value="2"', 'value="3"'), supplement=supplement)
    assert model.bodies[0].inertial.mass == 3.0
    assert len(reads) == 3


def test_an_invalid_input_is_an_error_every_time(place):
    loaded(DOUBTFUL)
    for _ in range(2):
        with pytest.raises(InputError):
            load_urdf(DOUBTFUL, joints=['b'])
        with pytest.raises(InputError):
            load_urdf(DOUBTFUL, joints='a')  # not the list that holds the same letters
        with pytest.raises(UrdfError):
            load_urdf(DOUBTFUL, supplement='nowhere.yaml')
        with pytest.raises(ModelError):
            load_urdf(DOUBTFUL, gravity=(0.0, 0.0, float('nan')))


@pytest.mark.parametrize('damage', [
    lambda b: b[:len(b) // 2], lambda b: b'', lambda b: b[:-1] + bytes([b[-1] ^ 1]),
    lambda b: b'something else entirely'], ids=['cut', 'empty', 'one bit', 'foreign'])
def test_a_damaged_entry_is_computed_again(place, reads, damage):
    expected, warned = loaded(DOUBTFUL)
    file, = place.iterdir()
    file.write_bytes(damage(file.read_bytes()))
    model, again = loaded(DOUBTFUL)
    assert model.digest() == expected.digest() and again == warned
    assert len(reads) == 2
    loaded(DOUBTFUL)
    assert len(reads) == 2


@pytest.mark.parametrize('content', [
    b'', b'null', b'[1, 2, 3]', b'{"Model": []}', b'[{"Robot": []}, []]',
    b'[{"array": [[2], [1.0]]}, []]', b'\xff\xfe', b'{', b'[[], []]', b'["Model", []]'])
def test_an_entry_that_holds_no_model_is_computed_again(place, reads, content):
    expected, _ = loaded(DOUBTFUL)
    file, = place.iterdir()
    disk_cache.store(file.name, content)
    assert loaded(DOUBTFUL)[0].digest() == expected.digest()
    assert len(reads) == 2


def test_an_entry_of_another_owner_or_an_open_directory_is_not_read(place, reads):
    loaded(DOUBTFUL)
    file, = place.iterdir()
    assert place.stat().st_mode & 0o777 == 0o700
    file.chmod(0o620)
    loaded(DOUBTFUL)
    assert len(reads) == 2
    place.chmod(0o777)
    loaded(DOUBTFUL)
    assert len(reads) == 3


def test_a_switched_off_cache_stores_no_model(monkeypatch, tmp_path, reads):
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', 'off')
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    loaded(DOUBTFUL)
    loaded(DOUBTFUL)
    assert len(reads) == 2 and not list(tmp_path.iterdir())


def test_models_of_arguments_that_are_no_plain_data_are_not_cached(place, reads):
    class Base(str):
        __slots__ = ()
    for _ in range(2):
        loaded(DOUBTFUL, base=Base('base'))
    assert len(reads) == 2 and not place.exists()


def test_an_entry_is_json_without_code(place):
    loaded(DOUBTFUL)
    file, = place.iterdir()
    data = json.loads(disk_cache.load(file.name))
    assert list(data[0]) == ['Model'] and len(data[1]) == 3


def test_a_known_urdf_is_loaded_without_parser_and_libraries_of_meshes(place):
    program = """
import sys
from kane_dynamics import load_urdf
load_urdf(sys.argv[1])
print(*(set(sys.modules) & {'lxml', 'trimesh', 'scipy', 'yaml'}))
"""
    path = resource_path('urdf', 'fr3.urdf')

    def run():
        done = subprocess.run(
            [sys.executable, '-c', program, str(path)], check=True, timeout=60,
            capture_output=True, text=True, cwd=Path(__file__).parents[3],
            env={**os.environ, 'KANE_DYNAMICS_CACHE': str(place)})
        return done.stdout.split()
    assert 'lxml' in run()  # the parser's
    assert run() == []


def test_deeply_nested_entry_is_ignored_and_written_again(place, reads):
    first, _ = loaded(SHIPPED[0])
    entry, = (path for path in place.rglob('*') if path.is_file())
    stored = entry.read_bytes()
    entry.write_bytes(b'[' * 200_000)
    assert loaded(SHIPPED[0])[0].digest() == first.digest() and len(reads) == 2
    assert entry.read_bytes() == stored
