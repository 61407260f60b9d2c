"""Imports point up the table of CONTRIBUTING.md; each peer has one door."""

import ast
from functools import cache
from importlib import import_module
from pathlib import Path
import subprocess
import sys
from typing import NamedTuple

from kane_dynamics._util import disk_cache
import pytest

PACKAGE = Path(__file__).resolve().parents[2] / 'kane_dynamics'

# A package may import, while it is being imported, only packages in a line above its
# own.
CORE = """
errors
_util
model
urdf
mechanics
native
mjcf motion
robot
loop_tracking
kinematics
control
control_cycle
task_space
simulation
analysis
"""
APPLICATIONS = """
closed_forms feasibility identification optimal_control sweep
plot view
"""
PROGRAMS = """
ros cli
demo
"""
TABLE = CORE + APPLICATIONS + PROGRAMS
# The parts of a package that is large enough to need an order of its own.
PARTS = {
    'mechanics': """
        algebra
        ball_joints friction
        definition
        recursive
        joint_lanes
        constraints
        equations
        energy_form
        integrators
        """,
    'native': """
        tracing
        machine_code
        backends
        python_call
        runtime
        """,
    'identification': """
        solvers
        recordings
        regression
        base_regressor physical_consistency
        standard_deviations
        fit excitation payload result_files
        """,
    'ros': """
        common
        parameters
        loads
        modes
        torque_path
        inputs
        services
        monitors
        guard
        plant monitor_node
        dynamics_node doctor
        """,
}


def ranks(table):
    """Return the line number of each unit of a table."""
    return {unit: rank for rank, line in enumerate(table.split('\n'))
            for unit in line.split()}


RANK = ranks(TABLE)

# Who may import these at all, even inside a function.
DOORS = {
    'ament_index_python': ('ros',),
    'casadi': (),  # by name only, when a function for it is asked for
    'control_msgs': (),  # by name only, where a parameter asks for it
    'example_robot_data': (),
    'jax': ('robot/frameworks',),
    'kane_dynamics_interfaces': ('demo', 'ros'),
    'launch': (),
    'llvmlite': ('native/machine_code/llvm.py',),
    'matplotlib': ('plot',),
    'mujoco': ('demo', 'mjcf.py'),
    'pinocchio': ('cli/commands/inspect_command.py',),
    'pyarrow': ('sweep',),
    'rclpy': ('demo', 'ros'),
    'rich': ('demo', '_util/progress.py'),
    'scipy': ('identification',),
    'sympy': ('closed_forms',),
    'torch': ('robot/frameworks/torch_function.py',),
    'trimesh': ('urdf/link_shapes.py', 'view'),
    'viser': ('view',),
    'xacro': ('urdf/xacro_file.py',),
    'yourdfpy': ('urdf/model_reader.py',),
}
# Never while being imported, but in demo/ and in modules that are themselves loaded on
# use.
LAZY = ('matplotlib', 'pinocchio', 'rich', 'sympy', 'viser')


class Import(NamedTuple):
    """One name of an import statement."""

    importer: str  # path in the package
    target: str  # dotted
    lazy: bool  # in a function, or for type checkers only

    @property
    def unit(self) -> str:
        return self.importer.split('/')[0].removesuffix('.py')


def for_type_checkers(condition):
    """Return whether a condition is TYPE_CHECKING, or contains it."""
    return any('TYPE_CHECKING' in (getattr(node, 'id', ''), getattr(node, 'attr', ''))
               for node in ast.walk(condition))


def _imports(path):
    """Return the imports of a source file."""
    importer = path.relative_to(PACKAGE).as_posix()
    imports_of_file = []

    def visit(node, lazy):
        if isinstance(node, ast.Import):
            imports_of_file.extend(Import(importer, name.name, lazy)
                                   for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = '.' * node.level + (node.module or '')
            imports_of_file.extend(Import(importer, f'{base}.{name.name}', lazy)
                                   for name in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child,
                  lazy or isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
                  or (isinstance(node, ast.If) and for_type_checkers(node.test)))

    visit(ast.parse(path.read_text('utf-8')), False)
    return imports_of_file


@cache
def imports():
    """Return the imports of the library; parsing it takes seconds, so only tests do."""
    return [one_import for path in sorted(PACKAGE.rglob('*.py'))
            for one_import in _imports(path)]


def test_imports_are_absolute():
    assert [one_import
            for one_import in imports() if one_import.target.startswith('.')] == []


def test_every_module_has_its_place_in_the_table():
    units = {path.name.removesuffix('.py') for path in PACKAGE.iterdir()
             if path.suffix == '.py' or (path / '__init__.py').exists()} - {'__init__'}
    assert sorted(units - set(RANK)) == []


def upward(rank, unit_of):
    """Return imports at load time whose target is beside or below."""
    intruders = []
    for one_import in imports():
        parts = one_import.target.split('.')
        if parts[0] != 'kane_dynamics' or one_import.lazy:
            continue
        importing = unit_of(one_import.importer.removesuffix('.py').split('/'))
        imported = unit_of(parts[1:])
        # A public name, taken from a package itself, has no rank.
        both_ranked = importing in rank and imported in rank
        if both_ranked and importing != imported and rank[imported] >= rank[importing]:
            intruders.append(one_import)
    return intruders


def test_imports_point_up_the_table():
    assert upward(RANK, lambda parts: parts[0]) == []


@pytest.mark.parametrize('package', PARTS)
def test_imports_point_up_inside_a_package(package):
    def unit_of(parts):
        return parts[1] if parts[0] == package and len(parts) > 1 else None
    assert upward(ranks(PARTS[package]), unit_of) == []


@pytest.mark.parametrize('layer, outer', [
    (CORE, APPLICATIONS + PROGRAMS), (APPLICATIONS, PROGRAMS)],
                         ids=['core', 'applications'])
def test_inner_layer_knows_no_outer_one(layer, outer):
    """The core imports no application, an application no program, even when called."""
    outward = []
    for one_import in imports():
        if one_import.unit in layer.split() and one_import.target.startswith(
                'kane_dynamics.') and one_import.target.split('.')[1] in outer.split():
            outward.append(one_import)
    assert outward == []


def test_contributing_lists_the_packages_in_this_order():
    """The list has a heading per layer, and the parts of a package behind its name."""
    text = (PACKAGE.parent / 'CONTRIBUTING.md').read_text('utf-8')
    block = text.partition('above its own in this list:\n\n')[2].partition('\n\n')[0]
    lines = []
    for line in block.split('\n'):
        if line.startswith(6 * ' '):
            lines.append(line.partition(':')[0].replace(',', ' ').split())
    assert lines == [line.split() for line in TABLE.split('\n') if line]


def test_packages_do_not_import_each_other_in_a_circle():
    upward_at_all = []
    for one_import in imports():
        if one_import.target.startswith('kane_dynamics.') and RANK.get(
                one_import.target.split('.')[1], -1) > RANK.get(
                    one_import.unit, len(RANK)):
            upward_at_all.append(one_import)
    assert upward_at_all == []


@pytest.mark.parametrize('library', DOORS)
def test_library_is_imported_only_where_it_may_be(library):
    intruders = []
    for one_import in imports():
        if one_import.target.split('.')[0] == library and not any(
                one_import.importer == door or one_import.importer.startswith(f'{door}/')
                for door in DOORS[library]):
            intruders.append(one_import)
    assert intruders == []


@pytest.mark.parametrize('library', LAZY)
def test_optional_library_is_imported_only_when_used(library):
    eager = []
    for one_import in imports():
        of_library = one_import.target.split('.')[0] == library
        may_import = one_import.unit in ('closed_forms', 'demo', 'plot', 'view')
        if of_library and not one_import.lazy and not may_import:
            eager.append(one_import)
    assert eager == []


def test_importing_the_library_imports_no_peer_and_no_ros():
    code = f'import sys, kane_dynamics; print(sorted(set(sys.modules) & {set(DOORS)!r}))'
    done = subprocess.run([sys.executable, '-c', code], cwd=PACKAGE.parent, check=True,
                          capture_output=True, text=True)
    assert set(ast.literal_eval(done.stdout)) <= {'llvmlite', 'yourdfpy', 'scipy'}


def test_cache_keys_know_the_rooms_of_the_table():
    # A room that a key takes for one of the core would not count in the keys of laws.
    rooms = CORE.split()
    first_law = rooms.index('control')
    applications = {*rooms[first_law:], *APPLICATIONS.split('\nplot')[0].split()}
    assert applications == disk_cache.APPLICATIONS
    assert {'plot', 'view', *PROGRAMS.split()} == disk_cache.PROGRAMS


@pytest.mark.parametrize('folder', ['benchmarks', 'docs', 'examples', 'tools'])
def test_programs_of_the_repository_import_names_that_exist(folder):
    missing = []
    for path in sorted((PACKAGE.parent / folder).glob('*.py')):
        for node in ast.walk(ast.parse(path.read_text())):
            module = getattr(node, 'module', None) or ''
            if module.split('.')[0] != PACKAGE.name:
                continue
            try:
                names = dir(import_module(module))
            except ImportError as error:
                # A peer or ROS may be absent, but not a module of ours.
                if (error.name or '').split('.')[0] == PACKAGE.name:
                    missing.append(f'{path.name}: {module}')
                continue
            place = PACKAGE.parent / module.replace('.', '/')
            missing += [f'{path.name}: {module}.{alias.name}' for alias in node.names
                        if alias.name not in names
                        and not (place / f'{alias.name}.py').exists()]
    assert not missing
