"""
Sphinx extension: pages that are made from the code that they describe.

`command-line` shows the help of every command, `parameters` the table of a node's parameters,
`interfaces` the messages, services and actions. `public-names` and `modules` list what a package
offers, and what its modules hold.
"""

from contextlib import redirect_stdout
import importlib
import inspect
import io
import os
from pathlib import Path
import pkgutil
import re

import kane_dynamics
from kane_dynamics.cli.examples import EXAMPLES
from kane_dynamics.cli.parser import main
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).resolve().parents[2]
HELP_COLUMNS = 96
BACKLINK = re.compile(r'<a class="viewcode-back".*?</a>', re.DOTALL)


class Generated(SphinxDirective):
    """A directive that stands for the text that `text` returns, headings included."""

    optional_arguments = 1

    def run(self):
        """Return the nodes of the text, in the language of the page."""
        return self.parse_text_to_nodes(self.text(*self.arguments), allow_section_headings=True)


class CommandLine(Generated):
    """The help of every command of `kane-dynamics`; Markdown."""

    def text(self):
        """Return one section a command."""
        os.environ['COLUMNS'] = str(HELP_COLUMNS)
        return '\n\n'.join(f'## {name}\n\n```text\n{help_of(name)}\n```' for name in EXAMPLES)


def help_of(command):
    """Return what `kane-dynamics COMMAND --help` prints."""
    words = io.StringIO()
    try:
        with redirect_stdout(words):
            main([command, '--help'])
    except SystemExit:
        return words.getvalue().rstrip()
    raise RuntimeError(f'kane-dynamics {command} --help did not end by itself')


class Parameters(Generated):
    """The parameters in the `SPECS` of a module; Markdown."""

    required_arguments = 1

    def text(self, module):
        """Return a table."""
        rows = ['| parameter | default | live | meaning | valid |', '|---|---|---|---|---|']
        for spec in importlib.import_module(module).SPECS:
            cells = (f'`{spec.name}`', f'`{spec.default!r}`', 'yes' if spec.live else '',
                     spec.description, spec.constraint)
            rows.append('| ' + ' | '.join(cell.replace('|', r'\|') for cell in cells) + ' |')
        return '\n'.join(rows)


class Interfaces(Generated):
    """The files of kane_dynamics_interfaces as they stand; Markdown."""

    def text(self):
        """Return one section a file."""
        folder = ROOT / 'kane_dynamics_interfaces'
        parts = []
        for kind in ('srv', 'action', 'msg'):
            for path in sorted((folder / kind).iterdir()):
                self.env.note_dependency(str(path))
                words = path.read_text(encoding='utf-8').rstrip()
                parts.append(f'## {kind}/{path.stem}\n\n```text\n{words}\n```')
        return '\n\n'.join(parts)


class PublicNames(Generated):
    """The names in `__all__` of a package by the module that they come from; reStructuredText."""

    required_arguments = 1

    def text(self, package):
        """Return one section a module."""
        module = importlib.import_module(package)
        sections = {}
        for name in module.__all__:
            sections.setdefault(getattr(module, name).__module__, []).append(name)
        return ''.join(self.section(package, source, sections[source])
                       for source in sorted(sections, key=self.order))

    @staticmethod
    def order(source):
        """Sort errors last; what most programs begin with first."""
        first = ('urdf', 'model', 'build', 'shapes', 'robot', 'simulation', 'trajectory')
        name = source.split('.')[1]
        return first.index(name) if name in first else len(first) + (name == 'errors'), source

    @staticmethod
    def section(package, source, names):
        """Return the section of one module's names."""
        module = importlib.import_module(source)
        title = source.removeprefix('kane_dynamics.')
        lines = [title, '-' * len(title), '', inspect.getdoc(module).splitlines()[0], '']
        for name in names:
            thing = getattr(importlib.import_module(package), name)
            kind = ('autoexception' if inspect.isclass(thing) and issubclass(thing, Exception)
                    else 'autoclass' if inspect.isclass(thing)
                    else 'autofunction' if callable(thing) else 'autodata')
            lines += [f'.. {kind}:: {package}.{name}']
            if kind == 'autoclass':
                lines += ['   :members:', *inherited(thing)]
            lines += ['']
        return '\n'.join(lines) + '\n'


def inherited(thing):
    """Return the option that shows what a class has from others of ours."""
    ours = any(base.__module__.startswith('kane_dynamics') for base in thing.__mro__[1:])
    return ['   :inherited-members:'] if ours else []


class Modules(Generated):
    """Every module of a package with all that is public in it; reStructuredText."""

    required_arguments = 1

    def text(self, package):
        """Return one section a module."""
        root = importlib.import_module(package)
        names = [package] + [found.name for found in pkgutil.walk_packages(
            getattr(root, '__path__', ()), f'{package}.')]
        return '\n'.join(self.section(name) for name in names)

    @staticmethod
    def section(name):
        """Return the section of one module, but for what stands on other pages."""
        module = importlib.import_module(name)
        elsewhere = [each for each in kane_dynamics.__all__
                     if getattr(kane_dynamics, each).__module__ == name]
        elsewhere += [each for each in getattr(module, '__all__', ())
                      if getattr(module, each).__module__ != name]
        title = name.removeprefix('kane_dynamics.')
        return (f'{title}\n{"-" * len(title)}\n\n.. automodule:: {name}\n   :members:\n'
                f'   :exclude-members: {", ".join(elsewhere)}\n' * bool(module.__doc__))


def with_formulas(app, what, name, thing, options, lines):
    """Keep the lines of formulas, which docstrings indent, apart from each other."""
    indented = [line.startswith('    ') for line in lines]
    for k in reversed(range(1, len(lines))):
        if indented[k] and not lines[k - 1]:
            before = next((line for line in reversed(lines[:k]) if line), '')
            if not before.startswith('    ') and not before.endswith('::') and what == 'module':
                lines[k:k] = ['::', '']


def without_backlinks(app, page, template, context, tree):
    """Take the links back out of pages of source: viewcode cannot tell which page has a name."""
    if page.startswith('_modules/'):
        context['body'] = BACKLINK.sub('', context['body'])


def setup(app):
    """Register the directives."""
    for name, directive in (('command-line', CommandLine), ('parameters', Parameters),
                            ('interfaces', Interfaces), ('public-names', PublicNames),
                            ('modules', Modules)):
        app.add_directive(name, directive)
    app.connect('autodoc-process-docstring', with_formulas)
    app.connect('html-page-context', without_backlinks)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
