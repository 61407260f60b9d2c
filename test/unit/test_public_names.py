"""`import kane_dynamics` is quick, and every public name is there at its first use."""

import ast
from importlib import import_module
import os
from pathlib import Path
import subprocess
import sys

import kane_dynamics
import pytest

SOURCE = Path(kane_dynamics.__file__).read_text('utf-8')
PACKAGE = Path(kane_dynamics.__file__).parent
# Functions of modules that have one name in several modules, because they mean the same.
FORMULATIONS = {'forward_dynamics', 'frame_motion', 'frame_pose',
                'inverse_dynamics', 'inverse_dynamics_derivatives', 'mass_matrix',
                'partial_velocities', 'position', 'regressor'}
OPERATIONS = {'evaluate', 'factorize', 'inverse', 'literal', 'main', 'rms', 'skew',
              'transpose'}
SETTINGS = {'per_joint', 'stated_efforts'}  # of arguments, options and parameters
LAWS = {'law_kernel', 'wall_slopes'}


def fresh(program):
    """Return what a new interpreter prints."""
    return subprocess.run(
        [sys.executable, '-c', program], check=True, capture_output=True,
        text=True, timeout=60, cwd=Path(kane_dynamics.__file__).parents[1]
    ).stdout.split()


@pytest.mark.parametrize('name', kane_dynamics.__all__)
def test_public_name_is_imported_at_its_first_use(name):
    assert getattr(kane_dynamics, name) is vars(kane_dynamics)[name]
    assert name in dir(kane_dynamics)


def test_type_checkers_see_the_names_that_are_imported():
    block, = (node for node in ast.parse(SOURCE).body
              if isinstance(node, ast.If) and ast.unparse(node.test) == 'TYPE_CHECKING')
    stated = {name.name: node.module for node in block.body for name in node.names}
    assert sorted(stated) == sorted(kane_dynamics.__all__)
    for name, module in stated.items():
        assert getattr(import_module(module), name) is getattr(kane_dynamics, name)


def test_from_import_and_star_and_subpackages_work_in_a_fresh_interpreter():
    assert fresh(
        'from kane_dynamics import *; print(Robot.__name__, load_urdf.__name__)') == [
            'Robot', 'load_urdf']
    assert fresh('import kane_dynamics as k; print(k.errors.InputError is k.InputError, '
                 'k.feasibility.demand.__name__)') == ['True', 'demand']


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError,
                       match="'kane_dynamics' has no attribute 'Robott'"):
        _ = kane_dynamics.Robott
    with pytest.raises(ImportError):
        exec('from kane_dynamics import Robott')


def test_importing_the_package_alone_imports_no_library():
    """Not even numpy: its import is most of what a start costs."""
    assert fresh("""
import sys
import kane_dynamics
print(*({'numpy', 'llvmlite', 'yaml', 'yourdfpy'} & set(sys.modules)))""") == []


def test_a_robot_of_a_known_urdf_imports_only_what_it_uses(tmp_path):
    program = """
import sys
from kane_dynamics import load_urdf, Robot
robot = Robot(load_urdf('urdf/two_link.urdf'))
robot.gravity_force([0.0] * robot.n)
print(*(set(sys.modules) & {'yourdfpy', 'trimesh', 'scipy', 'networkx', 'lxml', 'yaml'}))
"""
    done = []
    for _ in range(2):
        done.append(subprocess.run(
            [sys.executable, '-c', program], check=True, capture_output=True, text=True,
            timeout=60, cwd=Path(kane_dynamics.__file__).parents[1],
            env={**os.environ, 'KANE_DYNAMICS_CACHE': str(tmp_path / 'kept')}))
    assert 'lxml' in done[0].stdout and done[1].stdout.split() == []


def classes_by_name():
    """Return the library's modules that define a class, by its name."""
    modules = {}
    folder = Path(kane_dynamics.__file__).parent
    for path in sorted(folder.rglob('*.py')):
        for node in ast.parse(path.read_text('utf-8')).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith('_'):
                modules.setdefault(node.name, []).append(str(path.relative_to(folder)))
    return modules


def test_no_class_has_the_name_of_another():
    shared = {name: modules for name, modules in classes_by_name().items()
              if len(modules) > 1}
    assert shared == {}


def test_functions_of_one_name_mean_the_same():
    modules_by_name = {}
    for path in PACKAGE.rglob('*.py'):
        for node in ast.parse(path.read_text('utf-8')).body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith('_'):
                modules_by_name.setdefault(node.name, []).append(path)
    repeated = {name for name, modules in modules_by_name.items() if len(modules) > 1}
    assert repeated == FORMULATIONS | OPERATIONS | SETTINGS | LAWS
