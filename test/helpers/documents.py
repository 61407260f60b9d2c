"""
The blocks of README and docs, and how they are run.

A page is worked through as a reader would, in one folder: `python` blocks share their
names, `console` blocks run in bash where a line begins with `$ `, and a block whose
first line is a comment with nothing but a file's name is that file. What a console block
shows below a command, or a `text` block below a python block, is what must come out;
`...` stands for anything. `sh` blocks are not run and say why, in a comment above them.
"""

from contextlib import redirect_stdout, suppress
from dataclasses import dataclass
import io
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import warnings

from kane_dynamics.errors import ModelWarning

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').rglob('*.md'))]
FENCE = re.compile(r'(?:<!-- not run: (?P<reason>.*?) -->\n+)?'
                   r'^```(?P<language>\S*)[^\n]*\n(?P<text>.*?)^```$',
                   re.DOTALL | re.MULTILINE)
FILE = re.compile(r'(?:#|<!--|//) ([\w.-]+\.\w+)(?: -->)?\n')
PROMPT = '$ '
MARK = '@@ command '


@dataclass(frozen=True)
class Block:
    """A block of code between two fences."""

    language: str
    text: str
    line: int  # where it stands in its page
    reason: str  # why it is not run; empty where it is

    @property
    def file(self):
        """Name of the file that the block is, or None."""
        match = FILE.match(self.text)
        return match and match[1]


def blocks(page):
    """Return the blocks of a page, but those that are directives of the site."""
    text = page.read_text(encoding='utf-8')
    return [Block(match['language'], match['text'],
                  text.count('\n', 0, match.start('text')), match['reason'] or '')
            for match in FENCE.finditer(text) if not match['language'].startswith('{')]


def path_in_checkout(page):
    """Return a page's path within the checkout."""
    return str(page.relative_to(ROOT))


def starts_nodes(page):
    """Return whether a page's commands start nodes, which take the processors."""
    return any(block.language == 'console' and '_node --ros-args' in block.text
               for block in blocks(page))


def work_through(page, folder):
    """Run a page's blocks in a folder, and compare what they show."""
    install(folder)
    names = {'__name__': page.name}
    printed = None
    former_folder = os.getcwd()
    os.chdir(folder)
    try:
        for block in blocks(page):
            if block.file:
                (folder / block.file).write_text(block.text, encoding='utf-8')
                if block.language == 'python':
                    compile(block.text, block.file, 'exec')
            elif block.language == 'python':
                printed = io.StringIO()
                code = compile('\n' * block.line + block.text, str(page), 'exec')
                with redirect_stdout(printed), warnings.catch_warnings():
                    # A reader sees them and goes on.
                    warnings.simplefilter('ignore', ModelWarning)
                    exec(code, names)
                continue
            elif block.language == 'console':
                run_console(block.text, folder)
            elif block.language == 'text' and printed is not None:
                compare(block.text, printed.getvalue(), 'the python block above')
            printed = None
    finally:
        os.chdir(former_folder)


def install(folder):
    """Lay out what a reader has: the checkout's folders, and a set of commands."""
    for name in ('urdf', 'config', 'examples'):
        (folder / name).symlink_to(ROOT / name)
    binary = folder / '.venv' / 'bin'
    binary.mkdir(parents=True)
    (folder / '.venv' / 'lib').symlink_to(Path(sys.prefix) / 'lib')
    setup = (ROOT / 'setup.py').read_text(encoding='utf-8')
    for name, module in re.findall(r"'([\w-]+) = ([\w.]+):main'", setup):
        write_program(binary / name,
                      f'-c "from {module} import main; raise SystemExit(main())"')
    write_program(binary / 'python', '')


def write_program(path, arguments):
    """Write a command that Python runs, from the checkout."""
    path.write_text(f'#!/bin/sh\nexec {sys.executable} -W ignore {arguments} "$@"\n')
    path.chmod(0o755)


def run_console(text, folder):
    """Run the commands of a block in one shell, and compare what it shows below each."""
    text = text.replace('\\\n', '')  # commands of several lines
    commands = []
    for part in re.split(rf'^{re.escape(PROMPT)}', text, flags=re.MULTILINE)[1:]:
        commands.append((part.splitlines() + [''])[:1] + [part.partition('\n')[2]])
    assert commands, f'no line begins with {PROMPT!r}:\n{text}'
    script = ''.join(f'echo "{MARK}"\n{command}\n' for command, _ in commands)
    path = os.pathsep.join([str(folder / '.venv' / 'bin'), os.environ['PATH']])
    # Another domain than that of the test run, whose own client publishes joint states.
    domain = int(os.environ.get('ROS_DOMAIN_ID', '0')) % 100 + 1
    with subprocess.Popen(
            ['bash', '-euo', 'pipefail', '-c', script], cwd=folder, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
            env={**os.environ, 'PATH': path, 'PYTHONUNBUFFERED': '1',
                 'ROS_DOMAIN_ID': str(domain),
                 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                 'AMENT_PREFIX_PATH': os.environ.get('AMENT_PREFIX_PATH', sys.prefix),
                 'PYTHONPATH': os.pathsep.join(
                     [str(ROOT), os.environ.get('PYTHONPATH', '')])}) as shell:
        try:
            output, _ = shell.communicate(timeout=240)
        finally:
            with suppress(ProcessLookupError):  # what a command left in the background
                os.killpg(shell.pid, signal.SIGKILL)
    assert shell.returncode == 0, f'{text}\ngave {shell.returncode}:\n{output}'
    # Progress that only a slow machine reports.
    output = re.sub(r'^kane-dynamics: compil(?:ing|ed) .*\n', '', output,
                    flags=re.MULTILINE)
    answers = output.split(f'{MARK}\n')[1:]
    for (command, shown), answer in zip(commands, answers, strict=True):
        if shown.strip():
            compare(shown, answer, command)


def compare(shown, answer, what):
    """Raise AssertionError unless what is shown came out, but for blanks and `...`."""
    parts = []
    for part in shown.split('...'):
        words = [re.escape(word) for word in part.split()]
        parts.append(r'\s+'.join(words))
    pattern = '.*'.join(parts)
    pattern = re.sub(r'(?<=\.\*)|(?=\.\*)', r'\\s*', pattern)
    assert re.fullmatch(rf'\s*{pattern}\s*', answer, re.DOTALL), (
        f'{what}\nshows:\n{shown}\nbut gives:\n{answer}')
