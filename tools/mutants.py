"""
Mutants: small defects in files changed since a commit, each against its nearest tests.

A mutant that no test finds is printed with its line: a test is missing there. The tests
run in a worktree of their own, in a time that a developer would wait for.
"""

import argparse
import ast
from collections.abc import Iterator
from pathlib import Path
import random
import re
import subprocess
import sys
import tempfile
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
OPERATORS = {
    ast.Add: ('+', '-'), ast.Sub: ('-', '+'), ast.Mult: ('*', '/'), ast.Div: ('/', '*'),
    ast.Lt: ('<', '>'), ast.Gt: ('>', '<'), ast.LtE: ('<=', '>'), ast.GtE: ('>=', '<'),
    ast.Eq: ('==', '!='), ast.NotEq: ('!=', '=='), ast.And: ('and', 'or'),
    ast.Or: ('or', 'and'), ast.Is: ('is', 'is not'), ast.IsNot: ('is not', 'is'),
    ast.In: ('in', 'not in'), ast.NotIn: ('not in', 'in')}
NEAREST = 4  # test files


class Mutant(NamedTuple):
    """A replacement of source text between two offsets, inside a function."""

    path: Path
    begin: int
    end: int
    text: str
    line: int
    function: str


def changed_files(commit: str) -> list[Path]:
    """Return the modules of the package that changed since a commit."""
    command = ['git', 'diff', '--name-only', '--diff-filter=d', commit, '--',
               'kane_dynamics/*.py']
    done = subprocess.run(command, cwd=ROOT, check=True, text=True, capture_output=True)
    return [ROOT / name for name in done.stdout.split()]


class Source:
    """A module's text, and the places of its syntax tree in it."""

    def __init__(self, path: Path) -> None:
        self.text = path.read_bytes()
        self.starts = [0]
        for line in self.text.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))

    def begin(self, node: ast.expr | ast.stmt) -> int:
        """Return the offset at which a node begins."""
        return self.starts[node.lineno - 1] + node.col_offset

    def end(self, node: ast.expr | ast.stmt) -> int:
        """Return the offset at which a node ends."""
        assert node.end_lineno and node.end_col_offset
        return self.starts[node.end_lineno - 1] + node.end_col_offset

    def replaced(self, left: ast.expr, operator: ast.AST, right: ast.expr
                 ) -> tuple[int, int, str]:
        """Return the text between two operands with another operator."""
        begin, end = self.end(left), self.begin(right)
        gap = self.text[begin:end].decode()
        return begin, end, gap.replace(*OPERATORS[type(operator)], 1)

    def replacement(self, node: ast.AST) -> tuple[int, int, str] | None:
        """Return offsets and text of a defect: a sign, factor, index or check."""
        if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
            return self.replaced(node.left, node.op, node.right)
        if isinstance(node, ast.Compare):
            return self.replaced(node.left, node.ops[0], node.comparators[0])
        if isinstance(node, ast.BoolOp):
            return self.replaced(node.values[0], node.op, node.values[1])
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
            return self.begin(node), self.begin(node.operand), ''
        if isinstance(node, ast.Constant) and type(node.value) is int:
            return self.begin(node), self.end(node), repr(node.value + 1)
        if isinstance(node, ast.Constant) and type(node.value) is float:
            return self.begin(node), self.end(node), repr(3.0 * node.value + 0.5)
        if isinstance(node, ast.Raise):
            return self.begin(node), self.end(node), 'pass'
        return None


def mutants(path: Path) -> Iterator[Mutant]:
    """Yield the mutants of the functions of a file."""
    source = Source(path)
    for function in ast.walk(ast.parse(source.text)):
        if not isinstance(function, ast.FunctionDef) or function.name == '__repr__':
            continue
        for node in (node for part in function.body for node in ast.walk(part)):
            found = source.replacement(node)
            if found:
                assert isinstance(node, ast.expr | ast.stmt)
                yield Mutant(path, *found, node.lineno, function.name)


def nearest_tests(mutant: Mutant) -> list[str]:
    """Return the tests that name the module, its function or its classes most often."""
    stem = mutant.path.stem.removesuffix('_command')  # test_cli_identify
    names = re.findall(r'^class (\w+)', mutant.path.read_text(), re.MULTILINE)
    words = re.compile(rf'\b({"|".join([stem, mutant.function, *names])})\b')
    scores = []
    for test in (ROOT / 'test').rglob('test_*.py'):
        if test.parent.name not in ('docs', 'installation') and 'node' not in test.stem:
            text = test.read_text()
            score = len(words.findall(text)) + 20 * (stem in test.stem)
            score += 5 * len(re.findall(rf'\b{stem} import', text))
            scores.append((score * 1000.0 / (len(text) + 10000), test))
    scores.sort(reverse=True)
    return [str(test.relative_to(ROOT)) for score, test in scores[:NEAREST] if score]


def result_of(mutant: Mutant, folder: Path, seconds: float) -> str:
    """Return 'killed', 'survived' or 'not found in time' of a mutant."""
    target = folder / mutant.path.relative_to(ROOT)
    original = target.read_bytes()
    target.write_bytes(original[:mutant.begin] + mutant.text.encode()
                       + original[mutant.end:])
    command = [sys.executable, '-m', 'pytest', '-q', '-x', *nearest_tests(mutant)]
    try:
        done = subprocess.run(command, cwd=folder, timeout=seconds, capture_output=True)
        return 'survived' if done.returncode in (0, 5) else 'killed'
    except subprocess.TimeoutExpired:
        return 'not found in time'
    finally:
        target.write_bytes(original)


def main() -> int:
    """Draw mutants, run their tests, and print what survives."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--since', default='HEAD~50', help='a commit')
    parser.add_argument('--count', type=int, default=12)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--seconds', type=float, default=60.0, help='for each mutant')
    options = parser.parse_args()
    rng = random.Random(options.seed)
    files = [path for path in changed_files(options.since) if any(mutants(path))]
    survivors = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / 'tree'
        git = ['git', '-C', str(ROOT), 'worktree']
        subprocess.run([*git, 'add', '--quiet', '--detach', str(folder)], check=True)
        try:
            # One file each, as long as there are enough.
            for path in rng.sample(files, min(options.count, len(files))):
                mutant = rng.choice(list(mutants(path)))
                result = result_of(mutant, folder, options.seconds)
                survivors += result != 'killed'
                line = path.read_text().splitlines()[mutant.line - 1].strip()
                print(f'{result}: {path.relative_to(ROOT)}:{mutant.line}: {line}\n'
                      f'    with {mutant.text.strip()!r}, in {mutant.function}',
                      flush=True)
        finally:
            subprocess.run([*git, 'remove', '--force', str(folder)], check=True)
    print(f'{survivors} of {min(options.count, len(files))} were not found')
    return 0


if __name__ == '__main__':
    sys.exit(main())
