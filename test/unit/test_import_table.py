"""Imports point down the table of CONTRIBUTING.md only, and each peer has its one door."""

import ast
from pathlib import Path
import subprocess
import sys
from typing import NamedTuple

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / 'kane_dynamics'

# A module or subpackage may import, while it is being imported, only what stands in a line above
# its own. A module that does not exist yet may be listed; one that exists must be.
TABLE = (
    'errors',
    'extras inertial progress resources',
    'mode_shapes',
    'beam',
    'flexible_link model shapes',
    'flexing spline',
    'limiter mechanics motion urdf',
    'build_checks constraint_file native',
    'build',
    'explanation parameters quantities verification',
    'kernel_set',
    'calls workspace',
    'constrained dynamics frame_motion',
    'export',
    'robot',
    'energy_balance quasi_static',
    'contact control observer power stability stepping trajectory',
    'limit_watch torque_source',
    'examination feasibility identification simulation sweep vibration view',
    'plot',
    'cli demo ros',
)
RANK = {unit: rank for rank, line in enumerate(TABLE) for unit in line.split()}

# Who may import these at all, even inside a function.
DOORS = {
    'ament_index_python': ('ros',),
    'distributed': ('sweep',),
    'example_robot_data': (),
    'kane_dynamics_interfaces': ('demo', 'ros'),
    'launch': (),
    'llvmlite': ('native/llvm.py',),
    'matplotlib': ('plot',),
    'mujoco': ('demo',),
    'pinocchio': ('cli/benchmark.py', 'cli/inspection.py'),
    'pyarrow': ('sweep',),
    'rclpy': ('demo', 'ros'),
    'rich': ('demo', 'progress.py'),
    'scipy': ('identification',),
    'sympy': ('cli',),
    'trimesh': ('view',),
    'viser': ('view',),
    'yourdfpy': ('urdf/load.py',),
}
# Never while being imported, but in demo/ and in modules that are themselves loaded on use.
LAZY = ('matplotlib', 'pinocchio', 'rich', 'sympy', 'viser')


class Import(NamedTuple):
    """One name of an import statement."""

    importer: str  # path in the package
    target: str  # dotted
    lazy: bool  # in a function, or for type checkers only

    @property
    def unit(self) -> str:
        return self.importer.split('/')[0].removesuffix('.py')


def _imports(path):
    """Return the imports of a source file."""
    importer = path.relative_to(PACKAGE).as_posix()
    found = []

    def visit(node, lazy):
        if isinstance(node, ast.Import):
            found.extend(Import(importer, name.name, lazy) for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = '.' * node.level + (node.module or '')
            found.extend(Import(importer, f'{base}.{name.name}', lazy) for name in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child, lazy or isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
                  or (isinstance(node, ast.If) and 'TYPE_CHECKING' in ast.unparse(node.test)))

    visit(ast.parse(path.read_text('utf-8')), False)
    return found


IMPORTS = [found for path in sorted(PACKAGE.rglob('*.py')) for found in _imports(path)]


def test_imports_are_absolute():
    assert [found for found in IMPORTS if found.target.startswith('.')] == []


def test_every_module_has_its_place_in_the_table():
    units = {path.name.removesuffix('.py') for path in PACKAGE.iterdir()
             if path.suffix == '.py' or (path / '__init__.py').exists()} - {'__init__'}
    assert sorted(units - set(RANK)) == []


def test_imports_point_down_the_table():
    upward = []
    for found in IMPORTS:
        parts = found.target.split('.')
        if parts[0] != 'kane_dynamics' or found.lazy or found.unit == '__init__':
            continue
        target = parts[1]  # a public name, taken from the package itself, has no rank
        if target != found.unit and RANK.get(target, len(TABLE)) >= RANK[found.unit]:
            upward.append(found)
    assert upward == []


@pytest.mark.parametrize('library', DOORS)
def test_library_is_imported_only_where_it_may_be(library):
    intruders = [found for found in IMPORTS if found.target.split('.')[0] == library
                 and not any(found.importer == door or found.importer.startswith(f'{door}/')
                             for door in DOORS[library])]
    assert intruders == []


@pytest.mark.parametrize('library', LAZY)
def test_optional_library_is_imported_only_when_used(library):
    eager = [found for found in IMPORTS if found.target.split('.')[0] == library
             and not found.lazy and found.unit not in ('demo', 'plot', 'view')
             and found.importer not in {f'cli/{name}.py' for name in (
                 'equations', 'polynomials', 'symbolic')}]
    assert eager == []


def test_importing_the_library_imports_no_peer_and_no_ros():
    code = f'import sys, kane_dynamics; print(sorted(set(sys.modules) & {set(DOORS)!r}))'
    done = subprocess.run([sys.executable, '-c', code], cwd=PACKAGE.parent, check=True,
                          capture_output=True, text=True)
    assert set(ast.literal_eval(done.stdout)) <= {'llvmlite', 'yourdfpy', 'scipy'}
