"""Files are written whole or not at all."""

import errno
import os
from pathlib import Path
import re

from kane_dynamics import load_urdf, Robot, simulate
from kane_dynamics._util.resources import resource_path
from kane_dynamics._util.whole_files import whole_file
import numpy as np
import pytest

LIBRARY = Path(__file__).resolve().parents[3] / 'kane_dynamics'
WRITES = re.compile(
    r"""\bopen\([^)]*['"][wax]b?\+?['"]|\.write_(text|bytes)\(|\bnp\.save"""
    r"""|\.savefig\(|\bfdopen\(|\bO_CREAT\b|\bwrite_table\(""")
# What writes files without `whole_file`, and why no part of one is left.
OTHER_WRITERS = {
    '_util/whole_files.py': '`whole_file` itself',
    '_util/disk_cache.py': 'under another name first: checked in the tests of the cache',
    'cli/parser.py': 'to the null device',
    'robot/export_c.py': 'under another name first: several files together',
    'sweep/table.py': 'under another name first, and synchronized: sweeps resume'}


def full(*_):
    """Raise the error of a full disk."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_leaves_the_former_file_and_nothing_else(tmp_path):
    path = tmp_path / 'result.csv'
    path.write_text('former')
    with pytest.raises(OSError,
                       match='No space left') as caught, whole_file(path) as stream:
        stream.write('half')
        full()
    assert caught.value.filename == str(path)
    assert path.read_text() == 'former' and os.listdir(tmp_path) == ['result.csv']


def test_any_error_leaves_no_part_of_a_file(tmp_path):
    with pytest.raises(RuntimeError), whole_file(tmp_path / 'x', binary=True) as stream:
        stream.write(b'half')
        raise RuntimeError
    assert os.listdir(tmp_path) == []


def test_links_stay_links_and_pipes_are_written_directly(tmp_path):
    target = tmp_path / 'target'
    link = tmp_path / 'link'
    target.write_text('')
    link.symlink_to(target)
    with whole_file(link) as stream:
        stream.write('new')
    assert link.is_symlink() and target.read_text() == 'new'
    with whole_file('/dev/null') as stream:
        stream.write('x')
    with pytest.raises(OSError,
                       match='No space') as caught, whole_file('/dev/full') as stream:
        stream.write('x')
    assert caught.value.filename == '/dev/full'


def test_a_folder_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(FileNotFoundError) as caught, whole_file(
            tmp_path / 'no' / 'x.csv'):
        pass
    assert caught.value.filename == str(tmp_path / 'no' / 'x.csv')


@pytest.mark.parametrize('name', ['run.npz', 'run.csv', 'run.png'])
def test_trajectories_and_pictures_are_whole(name, tmp_path, monkeypatch):
    pytest.importorskip('matplotlib')
    robot = Robot(load_urdf(resource_path('urdf', 'two_link.urdf')))
    run = simulate(robot, [0.1, 0.2], [0.0, 0.0], 0.01)
    save = {
        '.npz': run.save_npz, '.csv': run.save_csv, '.png': run.plot}[Path(name).suffix]
    save(tmp_path / name)
    content = (tmp_path / name).read_bytes()
    replace = os.replace
    monkeypatch.setattr(os, 'replace', full)
    with pytest.raises(OSError, match='No space left') as caught:
        save(tmp_path / name)
    monkeypatch.setattr(os, 'replace', replace)
    assert caught.value.filename.endswith(name)
    assert (tmp_path / name).read_bytes() == content and os.listdir(tmp_path) == [name]
    assert np.isfinite(run.q).all()


def test_every_module_that_writes_files_writes_whole_ones():
    others = set()
    for path in LIBRARY.rglob('*.py'):
        lines = path.read_text().splitlines()
        places = [k for k, line in enumerate(lines) if WRITES.search(line)]
        if any('whole_file(' not in ''.join(lines[max(0, k - 2):k + 1]) for k in places):
            others.add(str(path.relative_to(LIBRARY)))
    assert others == set(OTHER_WRITERS)
