"""
Sphinx extension: pages that are generated from the code that they describe.

`command-line` shows the help of every command, `parameters` the table of a node's
parameters, `arms` the table of arms, `interfaces` the messages, services and actions.
`public-names` lists the functions and classes of a package, `modules` the contents of
its modules. Each public class has a page in `api/classes`, which is written when the
build begins.
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
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics.analysis.known_arms import known_arms, TABLE, UNCONFIRMED, words
from kane_dynamics.cli.examples import EXAMPLES
from kane_dynamics.cli.parser import main
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).resolve().parents[2]
HELP_COLUMNS = 96
PUBLIC = re.compile(r'^\.\. public-names:: (\S+)$', re.MULTILINE)
BACKLINK = re.compile(r'<a class="viewcode-back".*?</a>', re.DOTALL)


class Generated(SphinxDirective):
    """A directive that inserts the text that `text` returns, headings included."""

    optional_arguments = 1

    def run(self):
        """Return the nodes of the text, in the language of the page."""
        return self.parse_text_to_nodes(self.text(*self.arguments),
                                        allow_section_headings=True)


class CommandLine(Generated):
    """The help of every command of `kane-dynamics`; Markdown."""

    def text(self):
        """Return one section a command."""
        os.environ['COLUMNS'] = str(HELP_COLUMNS)
        return '\n\n'.join(f'## {name}\n\n```text\n{help_of(name)}\n```'
                           for name in EXAMPLES)


def help_of(command):
    """Return the output of `kane-dynamics COMMAND --help`."""
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
        rows = ['| parameter | default | live | meaning | valid |',
                '|---|---|---|---|---|']
        for spec in importlib.import_module(module).SPECS:
            cells = (f'`{spec.name}`', f'`{spec.default!r}`', 'yes' if spec.live else '',
                     spec.description, spec.constraint)
            rows.append(
                '| ' + ' | '.join(cell.replace('|', r'\|') for cell in cells) + ' |')
        return '\n'.join(rows)


class Arms(Generated):
    """The table of arms; Markdown."""

    def text(self):
        """Return a table, and its sources below."""
        self.env.note_dependency(str(TABLE))
        rows = ['| arm | interface | it adds | reported efforts | notes |',
                '|---|---|---|---|---|']
        sources = []
        for arm in known_arms():
            added = words(arm.compensates) if arm.compensates else (
                'unconfirmed' if arm.commandable else 'efforts cannot be commanded')
            cells = (f'{arm.vendor} {arm.arm}', f'{arm.interface}; {arm.versions}',
                     f'**{added}**', '; '.join(map(reported, arm.efforts)), arm.note)
            rows.append(
                '| ' + ' | '.join(cell.replace('|', r'\|') for cell in cells) + ' |')
            sources += [f'- {arm.vendor} {arm.arm}: {"; ".join(arm.sources)}']
        return '\n'.join([*rows, '', 'Sources:', '', *sources])


def reported(effort):
    """Return what an effort in the joint states is, in words."""
    if effort.kind == UNCONFIRMED:
        return UNCONFIRMED
    gravity = 'with' if effort.gravity else 'without'
    return f'{effort.kind.replace("_", " ")} {gravity} gravity ({effort.versions})'


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
    """
    The names in `__all__` of a package, one section a module; reStructuredText.

    Functions are documented here. A class has a line in a table, and a page of its own.
    """

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
        """Return a key that sorts what most programs begin with first, errors last."""
        first = ('urdf', 'model', 'robot', 'kinematics', 'simulation', 'motion',
                 'control')
        name = source.split('.')[1]
        return (first.index(name) if name in first else len(first) + (name == 'errors'),
                source)

    @staticmethod
    def section(package, source, names):
        """Return the section of one module's names."""
        module = importlib.import_module(source)
        title = source.removeprefix('kane_dynamics.')
        lines = [title, '-' * len(title), '', inspect.getdoc(module).splitlines()[0], '']
        classes = [name for name in names if has_page(getattr(module, name))]
        if classes:
            lines += summary([f'{package}.{name}' for name in classes])
        for name in names:
            if name in classes:
                continue
            thing = getattr(module, name)
            kind = ('autoexception' if inspect.isclass(thing)
                    else 'autofunction' if callable(thing) else 'autodata')
            lines += [f'.. {kind}:: {package}.{name}', '']
        return '\n'.join(lines) + '\n'


def has_page(thing):
    """Return True for a class that is no exception."""
    return inspect.isclass(thing) and not issubclass(thing, Exception)


def summary(names):
    """Return the lines of a table of names, each with its docstring's first sentence."""
    return ['.. autosummary::', '   :nosignatures:', '',
            *(f'   ~{name}' for name in names), '']


def class_page(path, thing):
    """Return the page of a class: a summary of its methods, then each of them."""
    title = path.rpartition('.')[2]
    bases = []
    for base in thing.__mro__:
        if base.__module__.startswith('kane_dynamics'):
            bases.append(base)
    source = (f'Import: ``from {path.rpartition(".")[0]} import {title}``. '
              f'Defined in ``{thing.__module__}``.')
    lines = [title, '=' * len(title), '', source, '']
    for heading, belongs in (('Methods', is_method), ('Attributes', is_attribute)):
        names = documented_names(bases, belongs)
        if names:
            lines += [f'.. rubric:: {heading}', '',
                      *summary([f'{path}.{n}' for n in names])]
    options = ['   :members:'] + ['   :inherited-members:'] * (len(bases) > 1)
    return '\n'.join([*lines, f'.. autoclass:: {path}', *options, ''])


def is_attribute(value):
    """Return True for a property of a class."""
    return inspect.isdatadescriptor(value) or isinstance(value, lazy_property)


def is_method(value):
    """Return True for a function of a class, also for one compiled at its first call."""
    function = getattr(value, '__func__', value)  # of a class method
    return callable(function) or (hasattr(function, '__get__')
                                  and not is_attribute(function))


def documented_names(bases, belongs):
    """Return the public names of classes with a docstring, the first class's last."""
    names = []
    for base in (*bases[1:], bases[0]):
        for name, value in vars(base).items():
            documented = getattr(getattr(value, '__func__', value), '__doc__', None)
            if not name.startswith('_') and name not in names and belongs(
                    value) and documented:
                names.append(name)
    return names


def write_class_pages(app):
    """Write a page for each public class of the packages that have a reference page."""
    folder = Path(app.srcdir) / 'api' / 'classes'
    folder.mkdir(exist_ok=True)
    pages = {}
    for source in sorted((Path(app.srcdir) / 'api').glob('*.rst')):
        for package in PUBLIC.findall(source.read_text(encoding='utf-8')):
            module = importlib.import_module(package)
            for name in module.__all__:
                thing = getattr(module, name)
                if has_page(thing) and f'{name}.rst' not in pages:
                    pages[f'{name}.rst'] = class_page(f'{package}.{name}', thing)
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding='utf-8') != text:
            path.write_text(text, encoding='utf-8')
    for path in folder.glob('*.rst'):
        if path.name not in pages:
            path.unlink()


class Modules(Generated):
    """
    Every module of a package with all that is public in it; reStructuredText.

    A second argument names a module that is documented on another page.
    """

    required_arguments = 1

    def text(self, package, documented=''):
        """Return one section a module."""
        root = importlib.import_module(package)
        names = [package] + [found.name for found in pkgutil.walk_packages(
            getattr(root, '__path__', ()), f'{package}.')]
        return '\n'.join(self.section(name) for name in names if name != documented)

    @staticmethod
    def section(name):
        """Return the section of one module, without names documented on other pages."""
        module = importlib.import_module(name)
        elsewhere = []
        for each in kane_dynamics.__all__:
            if getattr(kane_dynamics, each).__module__ == name:
                elsewhere.append(each)
        elsewhere += [each for each in getattr(module, '__all__', ())
                      if getattr(getattr(module, each), '__module__', name) != name]
        title = name.removeprefix('kane_dynamics.')
        return (f'{title}\n{"-" * len(title)}\n\n.. automodule:: {name}\n   :members:\n'
                f'   :exclude-members: {", ".join(elsewhere)}\n' * bool(module.__doc__))


def with_formulas(app, what, name, thing, options, lines):
    """Mark indented formulas in docstrings as literal blocks, which keep their lines."""
    indented = [line.startswith('    ') for line in lines]
    for k in reversed(range(1, len(lines))):
        if indented[k] and not lines[k - 1]:
            before = next((line for line in reversed(lines[:k]) if line), '')
            if not before.startswith('    ') and not before.endswith(
                    '::') and what == 'module':
                lines[k:k] = ['::', '']


def without_backlinks(app, page, template, context, tree):
    """Remove links from source pages to the reference: viewcode mixes them up."""
    if page.startswith('_modules/'):
        context['body'] = BACKLINK.sub('', context['body'])


def setup(app):
    """Register the directives."""
    for name, directive in (('arms', Arms), ('command-line', CommandLine),
                            ('parameters', Parameters), ('interfaces', Interfaces),
                            ('public-names', PublicNames), ('modules', Modules)):
        app.add_directive(name, directive)
    app.connect('builder-inited', write_class_pages)
    app.connect('autodoc-process-docstring', with_formulas)
    app.connect('html-page-context', without_backlinks)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
