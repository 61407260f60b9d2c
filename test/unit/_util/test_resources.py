"""Files of the package are found in a checkout and in any installation prefix."""

from configparser import ConfigParser
from importlib import metadata
import json
from pathlib import Path
import sys
from xml.etree import ElementTree

from kane_dynamics._util import resources
from kane_dynamics.errors import KaneError
import pytest

ROOT = Path(__file__).resolve().parents[3]
FOLDERS = ('config', 'launch', 'urdf')


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Simulate a module in site-packages without other files, and without prefixes."""
    monkeypatch.setattr(resources, '__file__',
                        str(tmp_path / 'site/kane_dynamics/_util/resources.py'))
    monkeypatch.setattr(sys, 'prefix', str(tmp_path / 'prefix'))
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    return tmp_path


def _ship(prefix, name):
    path = prefix / 'share/kane_dynamics/urdf' / name
    path.parent.mkdir(parents=True)
    path.write_text('<robot/>')
    return path


@pytest.mark.parametrize('folder', FOLDERS)
def test_every_file_of_a_checkout_is_found_in_it(folder):
    for path in (ROOT / folder).glob('*.*'):
        assert resources.resource_path(folder, path.name) == path


def test_file_is_found_in_the_prefix_of_the_environment(installed):
    path = _ship(installed / 'prefix', 'arm.urdf')
    assert resources.resource_path('urdf', 'arm.urdf') == path


def test_file_is_found_in_every_ament_prefix(installed, monkeypatch):
    first = _ship(installed / 'a', 'one.urdf')
    second = _ship(installed / 'b', 'two.urdf')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{installed / "a"}:{installed / "b"}')
    assert resources.resource_path('urdf', 'one.urdf') == first
    assert resources.resource_path('urdf', 'two.urdf') == second


def test_unknown_file_is_refused_with_those_that_exist(installed):
    _ship(installed / 'prefix', 'arm.urdf')
    with pytest.raises(KaneError,
                       match=r"'leg\.urdf' in urdf; expected one of arm\.urdf"):
        resources.resource_path('urdf', 'leg.urdf')


def test_environment_of_make_install_has_every_file():
    if not (Path(sys.prefix) / '.project').exists():
        pytest.skip('not in the environment that make install builds')
    files = {str(path) for path in metadata.files('kane_dynamics')}
    modules = [path.relative_to(ROOT) for path in (ROOT / 'kane_dynamics').rglob('*.py')]
    missing = {str(path) for path in [*modules, Path('kane_dynamics/py.typed')]} - files
    assert missing == set()
    share = Path(sys.prefix) / 'share'
    assert (share / 'ament_index/resource_index/packages/kane_dynamics').exists()
    for path in [ROOT / 'package.xml',
                 *(p for f in FOLDERS for p in (ROOT / f).glob('*.*'))]:
        assert (share / 'kane_dynamics' / path.relative_to(ROOT)).exists(), path


def test_a_workspace_of_colcon_has_the_commands_on_its_path():
    """Colcon installs them in lib/kane_dynamics, which it does not put there itself."""
    setup = ConfigParser()
    setup.read(ROOT / 'setup.cfg')
    folder = setup['install']['install_scripts'].removeprefix('$base/')
    hook, = json.loads((ROOT / 'colcon.pkg').read_text())['hooks']
    assert hook == 'share/kane_dynamics/hook/path.dsv'
    lines = (ROOT / 'resource' / Path(hook).name).read_text()
    assert lines == f'prepend-non-duplicate;PATH;{folder}\n'
    if (Path(sys.prefix) / '.project').exists():
        assert (Path(sys.prefix) / hook).read_text() == lines


def test_the_version_is_that_of_the_checkout_or_of_the_installation(
        installed, monkeypatch):
    monkeypatch.setattr(metadata, 'version', {'kane_dynamics': '7.8.9'}.__getitem__)
    assert resources.package_version() == '7.8.9'
    monkeypatch.setattr(resources, '__file__',
                        str(ROOT / 'kane_dynamics/_util/resources.py'))
    described = ElementTree.parse(ROOT / 'package.xml').findtext('version')
    assert resources.package_version() == described
