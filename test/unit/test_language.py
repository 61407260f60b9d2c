"""The words of the repository: standard terms, summaries that say what a thing is."""

import ast
from functools import cache
import io
from pathlib import Path
import re
import subprocess
import tokenize

import pytest

ROOT = Path(__file__).resolve().parents[2]
# Each word that is not used, and the term of the field that is.
TERMS = {
    r'mass[ -]cent(?:re|er)s?': 'center of mass', r'cent(?:re|res|red)': 'center',
    # 'posture' is the term of the field for what a redundant arm does in the null space.
    r'matter': 'mass, inertial properties', r'roads?': 'formulation, algorithm',
    r'doubt\w*': 'warning', r'freedoms': 'degrees of freedom',
    r'push(?:es)?': 'external wrench', r'gaps?': 'constraint residual',
    r'of no account': 'ignored', r'fore(?:tell|tells|told)': 'predicted',
    r'anew': 'again', r'whoever': 'a caller, a subscriber',
    r'nobody': 'no one: name who', r'parted by': 'separated by',
    r'opened by': 'constraint residual', r'left the (?:finite )?numbers': 'diverged',
    r'tremble\w*': 'oscillate', r"compiler's business": 'left to the compiler',
    r'companion': 'bias force', '(?:derivatives?|slopes?|gradients?) by '
    '(?:the|its|their|q|u|x|time)': 'with respect to',
    r'whole numbers? (?:from|of at least)': 'integer',
    r'hardly believed': 'a weak prior', r'carries besides': 'its derivative',
    r'(?:last|former) name (?:this|that) is': 'the former name of ...',
    r'(?:row|rows|entry|number|point) a (?:step|joint|sample|state|row)': 'per step, '
    'per joint', r'takes? it for': 'treats it as',
}
# Public names, and places where a word has its ordinary meaning. Each has its reason.
NAMES = re.compile(
    r'`[^`]*`'  # code in text
    r'|closed_configuration'  # a public name of the library
    r'|\{GAP|\'nobody\'|\'pushes\''  # names in code
    r'|^  push:'  # an event of the workflow file
    r'|gravitational|git push|no matter (?:how|what|which|where)|does not matter'
    r'|do not matter')
SUMMARY = re.compile(r'(?:What|How|Where|Who|Whoever|Tell|Tells|Take|Takes|Whether'
                     r'|Return (?:what|how far))\b')
WORDS = re.compile(r'(?<![\w/.-])(?:' + '|'.join(f'(?:{term})' for term in TERMS)
                   + r')(?![\w/])', re.IGNORECASE)


def tracked(*endings):
    """Return the paths of files that git tracks, of some endings."""
    listed = subprocess.run(['git', 'ls-files'],
                            cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip('this is no checkout')
    return [ROOT / name for name in listed.stdout.splitlines()
            if name.endswith(endings) and (ROOT / name).exists()]


def prose(path):
    """Return numbered lines that a person reads: all, or comments and strings."""
    text = path.read_text(encoding='utf-8')
    if path.suffix != '.py':
        return list(enumerate(text.splitlines(), 1))
    numbered = []
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in TEXT:
            numbered += enumerate(token.string.split('\n'), token.start[0])
    return numbered


# An f-string is one token before Python 3.12 and several from there on.
TEXT = {tokenize.COMMENT, tokenize.STRING,
        getattr(tokenize, 'FSTRING_MIDDLE', tokenize.STRING)}
FILES = [path
         for path in tracked('.py', '.md', '.rst', '.yaml', '.msg', '.srv', '.action')
         if path.name != 'test_language.py']


@pytest.mark.parametrize('folder',
                         sorted({path.relative_to(ROOT).parts[0] for path in FILES}))
def test_the_terms_are_those_of_the_field(folder):
    misuses = []
    for path in FILES:
        if path.relative_to(ROOT).parts[0] == folder:
            misuses += [f'{path.relative_to(ROOT)}:{number}: {match[0]}'
                        for number, line in prose(path)
                        for match in WORDS.finditer(NAMES.sub('', line))]
    assert misuses == []


@cache
def summaries_and_errors():
    """Return first lines of docstrings, and messages of errors, with places."""
    summaries = []
    errors = []
    for path in FILES:
        place = path.relative_to(ROOT)
        if path.suffix != '.py' or place.parts[0] not in ('kane_dynamics', 'examples'):
            continue
        # A file is parsed once for both.
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, DOCUMENTED):
                text = ast.get_docstring(node) or ''
                summaries.append((place, text.partition('\n')[0]))
            elif (isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)
                    and node.exc.args and place.parts[0] == 'kane_dynamics'):
                text = error_text(node.exc.args[0])
                if 'expected' in text:
                    errors.append((f'{place}:{node.lineno}', text))
    return summaries, errors


DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def test_summaries_say_what_a_thing_is_or_does():
    summaries, _ = summaries_and_errors()
    assert [summary for summary in summaries if SUMMARY.match(summary[1])] == []


def test_errors_read_thing_given_expected():
    """`<thing>: <given>; expected <valid>` in every error that has both."""
    _, errors = summaries_and_errors()
    assert len(errors) > 300
    assert [error for error in errors if GIVEN.match(error[1])
            or not re.search('[:;,] ?(?:\\S.*)?expected', error[1])] == []


# A thing and its value as a clause: "q is {}", "tau has shape {}".
GIVEN = re.compile(r"[\w{}.\[\]']+(?: of joint '\{\}')? (?:is|are|has|takes) ")


def error_text(node):
    """Return a message with {} for its values; empty for no string."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return ''.join(part.value if isinstance(part, ast.Constant) else '{}'
                       for part in node.values)
    return ''
