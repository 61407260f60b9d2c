"""
Trees and mechanisms with constraints share their code: few places tell them apart.

A mechanism without constraints has no rows: its residual is empty, every configuration is closed,
and all joints drive. Code that serves any number of rows serves trees, too.
"""

import ast
from collections import Counter
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / 'kane_dynamics'

# Modules that ask whether a robot has constraints, how often, and why no general rule serves both.
ASKS_FOR_CONSTRAINTS = {
    # Faster without rows.
    'robot/methods/configuration_methods.py': (1, 'closing compiles nothing'),
    'loop_tracking/driven_mechanism.py': (1, 'without rows no kernel tracks loops'),
    'kinematics/damped_least_squares.py': (1, 'a step that closes a tree takes 1.4 times as long'),
    'ros/monitors/applied_torque.py': (1, 'in each cycle: 4 us of conversion more'),
    'ros/plant/simulated_arm.py': (1, 'in each step: 15 us in place of 7'),
    # Torques of actuators are shared; without rows each link has its own motor.
    'control/elastic_feedforward.py': (1, 'the choice of actuators'),
    # Assembly modes: only loops have them.
    'task_space/frame_task.py': (1, 'loops stay near the stated configuration'),
    'ros/torque_path/closed_loop_reader.py': (1, 'joint states close the loops'),
    # Checked before a command uses it.
    'cli/commands/identify_command.py': (1, 'recordings are examined joint by joint'),
}
# Everywhere in the package, at most: questions that could stand in for the one above, and those
# for the time, which callers pass always and `Equations.time_inputs` leaves out.
MOST = {'timed': 15, 'in_joint_rates': 82, 'watched': 39}


def nodes_of(path):
    return ast.walk(ast.parse(path.read_text()))


def is_attribute(node, name):
    return isinstance(node, ast.Attribute) and node.attr == name


def conditions(node):
    """Return the expressions of a node that count as true or false."""
    if isinstance(node, ast.If | ast.IfExp | ast.While | ast.Assert):
        return [node.test]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return [node.operand]
    if isinstance(node, ast.BoolOp):
        return node.values
    if isinstance(node, ast.comprehension):
        return node.ifs
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == 'bool':
        return node.args
    return []


def test_modules_that_ask_whether_a_robot_has_constraints_are_listed_with_a_reason():
    counts = Counter()
    for path in PACKAGE.rglob('*.py'):
        for node in nodes_of(path):
            asked = [is_attribute(condition, 'constraint_names') for condition in conditions(node)]
            if any(asked):
                counts[path.relative_to(PACKAGE).as_posix()] += sum(asked)
    listed = {module: count for module, (count, _) in ASKS_FOR_CONSTRAINTS.items()}
    assert dict(counts) == listed


def test_no_further_places_ask_for_joint_rates_rows_or_the_time():
    counts = Counter()
    for path in PACKAGE.rglob('*.py'):
        for node in nodes_of(path):
            if isinstance(node, ast.Attribute) and node.attr in MOST:
                counts[node.attr] += 1
    assert all(counts[name] <= most for name, most in MOST.items()), counts


def test_no_place_asks_for_the_class_of_the_equations():
    for path in PACKAGE.rglob('*.py'):
        for node in nodes_of(path):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == 'isinstance':
                assert 'Equations' not in ast.unparse(node.args[1]), f'{path}:{node.lineno}'
