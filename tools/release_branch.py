"""
Make the branch from which bloom releases: both packages, with CHANGELOG.rst.

    tools/release_branch.py [--branch release/jazzy] [--commit HEAD]

In the repository, the interfaces lie inside the root package, where bloom does not look.
On the release branch, the packages lie in the folders `kane_dynamics` and
`kane_dynamics_interfaces`. The branch is made from a commit with git alone: working tree
and index stay as they are. Each run adds one commit to the branch.
"""

import argparse
import os
from pathlib import Path
import re
import subprocess
import sys
import tempfile
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
LIBRARY = 'kane_dynamics'
INTERFACES = 'kane_dynamics_interfaces'
VERSION = re.compile(r'^## (?P<version>\d+\.\d+\.\d+) \((?P<date>[^)]*)\)$')
# Underlines of reStructuredText headings, by Markdown level.
UNDERLINES = {2: '-', 3: '^'}


def git(*arguments: str, text: str | None = None, index: str | None = None) -> str:
    """Return what a git command prints; `index` is another index file."""
    environment = dict(os.environ)
    if index is not None:
        environment['GIT_INDEX_FILE'] = index
    process = subprocess.run(['git', '-C', str(ROOT), *arguments],
                             input=text, env=environment,
                             capture_output=True, text=True, check=False)
    if process.returncode != 0:
        raise SystemExit(f'git {" ".join(arguments)}: {process.stderr.strip()}')
    return process.stdout.strip()


def restructured(markdown: str) -> str:
    """Return inline Markdown as reStructuredText: code, and links."""
    text = re.sub(r'`([^`]+)`', r'``\1``', markdown)
    return re.sub(r'\[([^\]]+)\]\(([^)]+)\)', r'\1 (\2)', text)


def changelog_rst(markdown: str, package: str) -> str:
    """
    Return CHANGELOG.md as the changelog of a package that catkin_pkg reads.

    Parameters
    ----------
    markdown : str
        A text of Keep a Changelog: `## version (date)`, `### kind`, `- entry`.
    package : str
        Name of the package, for the title.

    """
    title = f'Changelog for package {package}'
    rule = '^' * len(title)
    lines = [rule, title, rule, '']
    in_versions = False
    for line in markdown.splitlines():
        version = VERSION.match(line)
        if version:
            in_versions = True
            date = version['date']
            heading = ('Forthcoming' if date == 'unreleased'
                       else f'{version["version"]} ({date})')
            lines += [heading, UNDERLINES[2] * len(heading)]
        elif not in_versions:
            continue
        elif line.startswith('### '):
            # A package's changelog has no headings inside a version: kinds become items.
            lines += ['', f'* {line[4:]}', '']
        elif line.startswith('- '):
            lines.append(f'  * {restructured(line[2:])}')
        elif line.strip():
            lines.append(f'    {restructured(line.strip())}')
    return '\n'.join(lines) + '\n'


def check_metadata(commit: str) -> str:
    """Return the version of both packages at a commit; stop at invented addresses."""
    versions = []
    for path in ('package.xml', f'{INTERFACES}/package.xml'):
        package = ElementTree.fromstring(git('show', f'{commit}:{path}'))
        versions.append(package.findtext('version', ''))
        addresses = [maintainer.get('email', '')
                     for maintainer in package.iter('maintainer')]
        addresses += [url.text or '' for url in package.iter('url')]
        for address in addresses:
            if re.search(r'\.example\b', address):
                raise SystemExit(f'{path}: {address}; expected an address that exists')
    if len(set(versions)) != 1:
        raise SystemExit(
            f'versions of the packages: {", ".join(versions)}; expected the same')
    return versions[0]


def release_tree(commit: str) -> str:
    """Return the tree of the release branch for a commit."""
    with tempfile.TemporaryDirectory() as folder:
        index = str(Path(folder) / 'index')
        git('read-tree', '--empty', index=index)
        git('read-tree', f'--prefix={LIBRARY}/', commit, index=index)
        git('rm', '-r', '-q', '--cached', f'{LIBRARY}/{INTERFACES}', index=index)
        git('read-tree', f'--prefix={INTERFACES}/', f'{commit}:{INTERFACES}',
            index=index)
        changelog = git('show', f'{commit}:CHANGELOG.md')
        for package in (LIBRARY, INTERFACES):
            blob = git('hash-object', '-w', '--stdin',
                       text=changelog_rst(changelog, package))
            git('update-index', '--add', '--cacheinfo',
                f'100644,{blob},{package}/CHANGELOG.rst', index=index)
        return git('write-tree', index=index)


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('--branch', default='release/jazzy',
                        help='the branch that gets a commit')
    parser.add_argument('--commit', default='HEAD', help='what is released')
    parser.add_argument('--allow-example-addresses', action='store_true',
                        help='for a trial: accept addresses that end in .example')
    options = parser.parse_args(arguments)
    if not options.allow_example_addresses:
        check_metadata(options.commit)
    reference = f'refs/heads/{options.branch}'
    known = git('for-each-ref', '--format=%(objectname)', reference)
    parents = ['-p', known] if known else []
    message = f'Packages side by side, of {git("rev-parse", options.commit)}'
    commit = git('commit-tree', release_tree(options.commit), *parents, '-m', message)
    git('update-ref', reference, commit)
    print(f'{options.branch}: {commit}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
