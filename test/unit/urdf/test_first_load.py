"""The first load of a URDF: nothing is imported that only scenes need."""

import subprocess
import sys

from kane_dynamics._util.resources import resource_path

FIRST_LOAD = """
import sys, warnings
warnings.simplefilter('ignore')
from kane_dynamics import load_urdf
path = sys.argv[1]
load_urdf(path)
print(*sorted({name.partition('.')[0] for name in sys.modules}
              & {'yourdfpy', 'trimesh', 'scipy', 'networkx'}))
"""
SCENE = """
import yourdfpy
scene = yourdfpy.URDF.load(path, load_meshes=False).scene
import trimesh
print(type(scene) is trimesh.Scene, yourdfpy.urdf.trimesh.Trimesh is trimesh.Trimesh)
"""


def run(code, tmp_path, monkeypatch):
    monkeypatch.setenv('KANE_DYNAMICS_CACHE', str(tmp_path))
    done = subprocess.run([sys.executable, '-c', code, str(resource_path('urdf', 'fr3.urdf'))],
                          check=True, capture_output=True, text=True)
    return done.stdout.split('\n')[:-1]


def test_the_first_load_of_a_urdf_imports_no_mesh_library(tmp_path, monkeypatch):
    assert run(FIRST_LOAD, tmp_path, monkeypatch) == ['yourdfpy']


def test_scenes_of_yourdfpy_work_after_a_urdf_was_loaded(tmp_path, monkeypatch):
    assert run(FIRST_LOAD + SCENE, tmp_path, monkeypatch)[1:] == ['True True']
