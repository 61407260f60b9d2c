"""Every public function and method has a test that goes on after the call."""

import ast
from collections import Counter
from functools import cache
from pathlib import Path

from public_surface import public_classes, public_functions, public_methods

TESTS = Path(__file__).resolve().parents[1]
# Of tests that a plain `make test` runs; helpers belong to them.
FOLDERS = 'unit', 'property', 'peer', 'helpers'

# Its rows are compared, kept or rotated, as constraints of each mechanism that rolls.
INDIRECT = {'Rolling.surface_rows'}


class _Uses(ast.NodeVisitor):
    """
    The names that a file uses where no error is expected.

    Names are those of calls and attributes, and texts, as `getattr` takes them. Tests
    that are marked as slow do not count, nor does what is in `with pytest.raises`.
    """

    def __init__(self):
        self.names = set()

    def visit_FunctionDef(self, node):  # noqa: N802
        marks = [ast.unparse(mark) for mark in node.decorator_list]
        if not any(mark.startswith('pytest.mark.slow') for mark in marks):
            self.generic_visit(node)

    def visit_With(self, node):  # noqa: N802
        if not any('pytest.raises' in ast.unparse(item) for item in node.items):
            self.generic_visit(node)

    def visit_Name(self, node):  # noqa: N802
        self.names.add(node.id)

    def visit_Attribute(self, node):  # noqa: N802
        self.names.add(node.attr)
        self.generic_visit(node)

    def visit_Constant(self, node):  # noqa: N802
        if isinstance(node.value, str):
            self.names.add(node.value)


@cache
def uses():
    """Return the used names of each file, and all names that it mentions."""
    files = []
    for folder in FOLDERS:
        for path in (TESTS / folder).rglob('*.py'):
            if path.name in ('degenerate_input.py', Path(__file__).name):
                continue
            text = path.read_text(encoding='utf-8')
            visitor = _Uses()
            visitor.visit(ast.parse(text))
            files.append((visitor.names, text))
    return files


def is_used(name, beside=''):
    """Return whether a file that mentions another name uses a name."""
    return any(name in names and beside in text for names, text in uses())


def test_every_public_function_is_called_where_no_error_is_expected():
    names = [name.rpartition('.')[2] for name in public_functions()]
    assert len(names) > 50
    assert not [name for name in names if not is_used(name)]


def test_every_public_method_is_called_where_no_error_is_expected():
    # A name that several classes have counts in files that mention the class.
    count = Counter(method for cls in public_classes().values()
                    for method in public_methods(cls))
    missing = set()
    for name, cls in public_classes().items():
        for method in public_methods(cls):
            if not is_used(method, cls.__name__ if count[method] > 1 else ''):
                missing.add(f'{name}.{method}')
    assert missing == INDIRECT


def test_a_call_inside_an_expected_error_does_not_count():
    visitor = _Uses()
    visitor.visit(ast.parse('with pytest.raises(ValueError):\n    robot.shift(1)\n'
                            'robot.solve(2)'))
    assert 'solve' in visitor.names and 'shift' not in visitor.names
