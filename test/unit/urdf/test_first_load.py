"""The first load of a URDF executes no mesh library; threads and forks may."""

import subprocess
import sys

from kane_dynamics._util.resources import resource_path
import pytest

FIRST_LOAD = """
import sys, warnings
warnings.simplefilter('ignore')
from kane_dynamics import load_urdf
path = sys.argv[1]
load_urdf(path)
print(*sorted({'trimesh.base', 'scipy', 'networkx', 'shapely'} & set(sys.modules)))
"""
DEFERRED_USE = """
import sys
from kane_dynamics._util.deferred_import import import_deferring
reader = import_deferring('yourdfpy.urdf', 'trimesh')
print('trimesh.base' in sys.modules)
scene = reader.URDF.load(sys.argv[1], load_meshes=False).scene
import trimesh, yourdfpy
print(type(scene) is trimesh.Scene, yourdfpy.urdf.trimesh is trimesh)
"""
VERSION_AFTER_LOAD = FIRST_LOAD + """
import trimesh
print(trimesh.__version__ == trimesh.version.__version__)
"""
SLOW_IMPORT = """
import os, sys, threading, time, warnings
warnings.simplefilter('ignore')
from kane_dynamics import load_urdf

class SlowImport:
    def find_spec(self, name, path=None, target=None):
        if name == slow:
            entered.set()
            time.sleep(0.5)

entered, models = threading.Event(), []
slow = sys.argv[2]
sys.meta_path.insert(0, SlowImport())
path = sys.argv[1]
thread = threading.Thread(target=lambda: models.append(load_urdf(path)))
thread.start()
assert entered.wait(20.0)
"""
THREADS = SLOW_IMPORT + """
import trimesh.version
models.append(load_urdf(path))
thread.join()
digests = {model.digest() for model in models}
print(hasattr(trimesh.Trimesh, 'vertices'), len(models), len(digests))
"""
FORK = SLOW_IMPORT + """
if os.fork() == 0:
    import signal
    signal.alarm(20)  # ends a child that waits for ever
    load_urdf(path)
    os._exit(7)
thread.join()
print(os.waitstatus_to_exitcode(os.wait()[1]))
"""


def run(code, tmp_path, monkeypatch, slow='six'):  # the parser imports it
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', str(tmp_path / 'cache'))
    done = subprocess.run(
        [sys.executable, '-c', code, str(resource_path('urdf', 'fr3.urdf')), slow],
        check=True, capture_output=True, text=True, timeout=40.0)
    return done.stdout.split('\n')[:-1]


def test_the_first_load_of_a_urdf_executes_no_mesh_library(tmp_path, monkeypatch):
    assert run(FIRST_LOAD, tmp_path, monkeypatch) == ['']


def test_the_deferred_package_is_executed_when_it_is_used(tmp_path, monkeypatch):
    assert run(DEFERRED_USE, tmp_path, monkeypatch) == ['False', 'True True']


def test_a_program_reads_the_version_of_the_deferred_package(tmp_path, monkeypatch):
    assert run(VERSION_AFTER_LOAD, tmp_path, monkeypatch) == ['', 'True']


def test_a_thread_may_load_a_urdf_and_use_meshes_during_the_first_load(
        tmp_path, monkeypatch):
    assert run(THREADS, tmp_path, monkeypatch) == ['True 2 1']


# The last one comes between logging, whose lock a fork takes, and the first logger.
@pytest.mark.parametrize('slow', ['kane_dynamics.urdf.model_reader', 'six', 'uuid'])
def test_a_process_forked_during_the_first_load_can_load(tmp_path, monkeypatch, slow):
    assert run(FORK, tmp_path, monkeypatch, slow) == ['7']
