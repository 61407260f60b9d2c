"""What a release is made of: versions agree, a branch has both packages."""

from pathlib import Path
import re
import subprocess
import sys
from xml.etree import ElementTree

import pytest
import yaml

CHECKOUT = Path(__file__).resolve().parents[2]
PACKAGES = ('kane_dynamics', 'kane_dynamics_interfaces')

sys.path.insert(0, str(CHECKOUT / 'tools'))
import release_branch  # noqa: E402, I100


def git(folder, *arguments):
    """Return what a git command prints."""
    return subprocess.run(['git', '-C', folder, *arguments],
                          capture_output=True, text=True, check=True).stdout


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """Return a clone of the last commit, in which release_branch works."""
    if not (CHECKOUT / '.git').exists():
        pytest.skip('the checkout is no git repository')
    git(CHECKOUT, 'clone', '--quiet', '--no-checkout', CHECKOUT, tmp_path / 'clone')
    for name in ('GIT_AUTHOR_NAME', 'GIT_COMMITTER_NAME'):
        monkeypatch.setenv(name, 'test')
    for name in ('GIT_AUTHOR_EMAIL', 'GIT_COMMITTER_EMAIL'):
        monkeypatch.setenv(name, 'test@localhost')
    monkeypatch.setattr(release_branch, 'ROOT', tmp_path / 'clone')
    return tmp_path / 'clone'


def test_versions_agree_everywhere():
    versions = {ElementTree.parse(CHECKOUT / path).getroot().findtext('version')
                for path in ('package.xml', 'kane_dynamics_interfaces/package.xml')}
    citation = yaml.safe_load((CHECKOUT / 'CITATION.cff').read_text('utf-8'))
    assert versions == {citation['version']}
    assert f'## {citation["version"]} (' in (CHECKOUT / 'CHANGELOG.md').read_text(
        'utf-8')


def test_the_page_on_installing_names_every_extra_of_users():
    statement = re.search(r'extras_require=\{(.*?)\}',
                          (CHECKOUT / 'setup.py').read_text('utf-8'), re.DOTALL)
    extras = set(re.findall(r"'(\w+)':", statement[1])) - {
        'test', 'lint', 'bench', 'docs'}
    page = (CHECKOUT / 'docs/how_to/installing.md').read_text('utf-8')
    assert extras == {name for row in re.findall(r'^\| (`.*?) \|', page, re.MULTILINE)
                      for name in re.findall(r'`(\w+)`', row)}


def test_release_branch_holds_both_packages_side_by_side(clone):
    for _ in range(2):
        release_branch.main(['--allow-example-addresses', '--branch', 'release/trial'])
    files = git(clone, 'ls-tree', '-r', '--name-only', 'release/trial').split('\n')
    assert {path.partition('/')[0] for path in files if path} == set(PACKAGES)
    for package in PACKAGES:
        assert f'{package}/package.xml' in files
        assert f'{package}/CHANGELOG.rst' in files
    # The second run adds a commit on top of the first.
    assert git(clone, 'rev-list', '--count', 'release/trial').strip() == '2'
    # The working tree, which is empty here, and the index are untouched.
    assert not (clone / 'package.xml').exists()


def test_release_branch_refuses_addresses_that_do_not_exist(clone):
    with pytest.raises(SystemExit, match=r'\.example.*expected an address that exists'):
        release_branch.main([])


def test_changelog_of_a_package_is_valid_restructured_text():
    docutils = pytest.importorskip('docutils.core')
    markdown = (CHECKOUT / 'CHANGELOG.md').read_text('utf-8')
    text = release_branch.changelog_rst(markdown, 'kane_dynamics')
    assert markdown.count('\n- ') == text.count('\n  * ')
    docutils.publish_doctree(text,
                             settings_overrides={'halt_level': 2, 'report_level': 2})
