"""Build a ROS package at test time, with the tools that build our interfaces."""

from contextlib import contextmanager
import ctypes
import hashlib
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import zipfile

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
INTERFACES = REPOSITORY / 'kane_dynamics_interfaces'
BUILT = REPOSITORY / 'build' / 'test_packages'


def build_package(package, sources, dependencies=()):
    """
    Build a package; return the paths for PYTHONPATH and AMENT_PREFIX_PATH.

    The wheel is unpacked in the folder `build`, so that no environment changes. A
    package of the same sources is built once.

    Parameters
    ----------
    package : str
        Its name.
    sources : dict
        Text of each interface by its path in the package, such as
        ``msg/JointCommand.msg``.
    dependencies : sequence of str
        Packages of messages that they use, besides those of our interfaces.

    """
    tools = []
    for name in ('CMakeLists.txt', 'pip_ros.cmake', 'package.xml', 'pyproject.toml'):
        tools.append((INTERFACES / name).read_text())
    content = repr((package, sorted(sources.items()), tools, sys.version, *dependencies))
    folder = BUILT / f'{package}_{hashlib.sha256(content.encode()).hexdigest()[:16]}'
    if not folder.exists():
        unfinished = folder.with_suffix('.unfinished')
        shutil.rmtree(unfinished, ignore_errors=True)
        _build(unfinished, package, sources, dependencies)
        unfinished.rename(folder)
    prefix, = folder.glob('*.data/data')
    packages, = prefix.glob('lib/python*/site-packages')
    return packages, prefix


def package_environment(package, sources, dependencies=()):
    """Build a package; return the environment variables of processes that import it."""
    packages, prefix = build_package(package, sources, dependencies)
    inherited = os.environ.get('PYTHONPATH', '')
    libraries = os.environ.get('LD_LIBRARY_PATH', '')
    return {'PYTHONPATH': f'{packages}:{inherited}',
            'AMENT_PREFIX_PATH': f'{prefix}:{os.environ["AMENT_PREFIX_PATH"]}',
            'LD_LIBRARY_PATH': f'{libraries}:{prefix}/lib'}


@contextmanager
def imported_package(package, sources, dependencies=()):
    """Let this process and those that it starts import a package while a block runs."""
    if package in sys.modules:  # of a block around this one, or installed
        yield
        return
    packages, prefix = build_package(package, sources, dependencies)
    # The linker finds libraries that are loaded already; each needs others of them.
    waiting = sorted(prefix.glob('lib/*.so'))
    while waiting:
        remaining = []
        for library in waiting:
            try:
                ctypes.CDLL(str(library), ctypes.RTLD_GLOBAL)
            except OSError:
                remaining.append(library)
        assert len(remaining) < len(waiting), remaining
        waiting = remaining
    with pytest.MonkeyPatch.context() as patch:
        for name, value in package_environment(package, sources, dependencies).items():
            patch.setenv(name, value)
        patch.syspath_prepend(str(packages))
        try:
            yield
        finally:
            for name in [name for name in sys.modules if name.split('.')[0] == package]:
                del sys.modules[name]


def _build(folder, package, sources, dependencies):
    """Build and unpack the wheel in a folder."""
    source = folder / 'source'
    for path, text in sources.items():
        (source / path).parent.mkdir(parents=True, exist_ok=True)
        (source / path).write_text(text)
    shutil.copy(INTERFACES / 'pip_ros.cmake', source)
    for file in ('package.xml', 'pyproject.toml'):
        text = (INTERFACES / file).read_text()
        text = text.replace('kane_dynamics_interfaces', package).replace(
            'kane-dynamics-interfaces', package.replace('_', '-'))
        for name in dependencies:
            text = text.replace(
                '  <depend>std_msgs</depend>\n',
                f'  <depend>{name}</depend>\n  <depend>std_msgs</depend>\n')
        (source / file).write_text(text)
    listed = ''.join(f'  "{path}"\n' for path in sources)
    text = (INTERFACES / 'CMakeLists.txt').read_text()
    for name in dependencies:
        text = text.replace(
            'find_package(std_msgs REQUIRED)',
            f'find_package({name} REQUIRED)\nfind_package(std_msgs REQUIRED)')
        text = text.replace('  DEPENDENCIES', f'  DEPENDENCIES {name}')
    text = re.sub(r'(?:  "(?:action|msg|srv)/\w+\.\w+"\n)+', listed, text)
    (source / 'CMakeLists.txt').write_text(
        text.replace('kane_dynamics_interfaces', package))
    subprocess.run([_uv(), 'build', '--python', sys.executable, '--quiet', '--wheel',
                    '--out-dir', str(source), str(source)], check=True, timeout=900)
    wheel, = source.glob('*.whl')
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)


def _uv():
    """Return the path of uv, which `make install` has and colcon may lack."""
    folders = [str(Path(sys.executable).parent), str(REPOSITORY / '.venv' / 'bin'),
               os.environ['PATH']]
    return shutil.which('uv', path=os.pathsep.join(folders))
