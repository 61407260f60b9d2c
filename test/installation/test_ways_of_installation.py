"""Each way of installation gives a library that computes, in an empty environment."""

import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[2]
UV = shutil.which('uv', path=str(Path(sys.executable).parent))
LARGEST = 220e6  # bytes of a slim installation
NEWER = [f'python3.{minor}' for minor in (12, 13, 14)]
PROGRAM = """
import sys
import numpy as np
from kane_dynamics import load_urdf, Robot, simulate
robot = Robot(load_urdf(sys.argv[1]))
q, u, udot = np.array([0.3, 0.5]), np.array([0.1, -0.2]), np.array([1.0, 2.0])
tau = robot.inverse_dynamics(q, u, udot)
assert np.allclose(robot.forward_dynamics(q, u, tau), udot)
assert robot.verify() < 1e-9
fall = simulate(robot, q, u, 0.1)
assert np.isfinite(fall.q).all()
from kane_dynamics.analysis.known_arms import arms_named
assert arms_named('ur10e', ())
from kane_dynamics.native.runtime.message_loop import message_loop
assert message_loop().address('run')
print('computed')
"""
pytestmark = [pytest.mark.timeout(600),
              pytest.mark.skipif(UV is None, reason='no uv beside the interpreter')]


def run(*command, cwd=ROOT):
    """Run a command without the variables of other environments; return its output."""
    of_environments = ('PYTHON', 'AMENT', '_ROS', 'VIRTUAL_ENV', 'LD_LIBRARY')
    inherited = {name: value for name, value in os.environ.items()
                 if not name.startswith(of_environments)}
    done = subprocess.run([*map(str, command)],
                          cwd=cwd, env=inherited, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope='module')
def sources(tmp_path_factory):
    """Return a copy of the repository's files, in which a build leaves nothing."""
    folder = tmp_path_factory.mktemp('sources')
    for name in run('git', 'ls-files').splitlines():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, target)
    return folder


@pytest.fixture(scope='module')
def distributions(sources, tmp_path_factory):
    """Return the folder of the built wheel and source distribution."""
    folder = tmp_path_factory.mktemp('dist')
    run(UV, 'build', '--quiet', '--out-dir', folder, sources)
    return folder


def environment(folder, *requirements, python=sys.executable):
    """Return the interpreter of a new environment with the requirements."""
    run(UV, 'venv', '--quiet', '--python', python, folder)
    interpreter = folder / 'bin' / 'python'
    run(UV, 'pip', 'install', '--quiet', '--python', interpreter, *requirements)
    return interpreter


def interpreter_on_path(name):
    """Return the first interpreter on the PATH that runs; pyenv's stand-ins may not."""
    for folder in os.environ['PATH'].split(os.pathsep):
        path = Path(folder) / name
        if not path.is_file():
            continue
        tried = subprocess.run([path, '-c', ''], capture_output=True)
        if tried.returncode == 0:
            return path
    return None


def check_that_it_computes(interpreter, tmp_path):
    """Run a program with the installed library."""
    output = run(interpreter, '-c', PROGRAM, ROOT / 'urdf' / 'two_link.urdf',
                 cwd=tmp_path)
    assert output.split() == ['computed']


def slim(sources):
    """Return the arguments of a slim installation."""
    return '--no-deps', '-r', sources / 'requirements-slim.txt', sources


def test_a_slim_installation_computes_and_is_small(sources, tmp_path):
    interpreter = environment(tmp_path / 'env', *slim(sources))
    rows = []
    for path in (tmp_path / 'env' / 'lib').rglob('*'):
        if path.is_file() and not path.is_symlink():
            rows.append(path.stat().st_size)
    size = sum(rows)
    print(f'slim: {size / 1e6:.0f} MB')
    assert size < LARGEST
    check_that_it_computes(interpreter, tmp_path)


@pytest.mark.parametrize('kind', ['*.whl', '*.tar.gz'])
def test_wheel_and_source_distribution_compute(distributions, tmp_path, kind):
    package, = distributions.glob(kind)
    interpreter = environment(tmp_path / 'env', package)
    check_that_it_computes(interpreter, tmp_path)
    listed = run(tmp_path / 'env' / 'bin' / 'kane-dynamics', '--version', cwd=tmp_path)
    assert listed.startswith('kane-dynamics ')


@pytest.mark.skipif(sys.version_info[:2] != (3, 11),
                    reason='the oldest releases need Python 3.11')
def test_the_oldest_releases_of_the_dependencies_compute(sources, tmp_path):
    interpreter = environment(tmp_path / 'env', '--resolution', 'lowest-direct', sources)
    versions = run(interpreter, '-c', 'import llvmlite, numpy; '
                   'print(llvmlite.__version__, numpy.__version__)')
    assert versions.startswith('0.42.0 1.26.0')
    check_that_it_computes(interpreter, tmp_path)


@pytest.mark.parametrize('python', NEWER)
def test_newer_interpreters_compute(sources, tmp_path, python):
    path = interpreter_on_path(python)
    if path is None:
        pytest.skip(f'no {python} here')
    interpreter = environment(tmp_path / 'env', *slim(sources), python=path)
    check_that_it_computes(interpreter, tmp_path)
