"""
Pinocchio's C++ in this process: pinocchio_loop.cpp, compiled if needed, through ctypes.

The library is built against the headers of the `pin` wheel and of cmeel-eigen, for this
very processor, by every compiler here (`compilers`): the faster build counts. It is kept
in build/bench under a name that its source, compiler and versions determine. The module
`pinocchio` must not be imported beside it: both carry Boost's and Eigen's symbols.
"""

import ctypes
from functools import cache
import hashlib
from importlib import metadata
from pathlib import Path
import subprocess
import sysconfig
import weakref

from compilers import Compiler, compilers, target

from kane_dynamics import Model, Robot
from kane_dynamics.model.model import WORLD
import numpy as np

SOURCE = Path(__file__).with_name('pinocchio_loop.cpp')
FOLDER = Path(__file__).resolve().parents[1] / 'build' / 'bench'
PACKAGES = ('pin', 'libpinocchio', 'cmeel-boost', 'cmeel-eigen')
FLAGS = ['-O3', '-march=native', '-std=c++17', '-fPIC', '-shared', '-DNDEBUG', '-w',
         # two builds in one process each call their own functions
         '-g0', '-Wl,-Bsymbolic',
         # Pinocchio's variant of joint types is longer than Boost's lists are made for
         '-DBOOST_MPL_LIMIT_LIST_SIZE=30', '-DBOOST_MPL_LIMIT_VECTOR_SIZE=30',
         '-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS', '-DBOOST_FUSION_INVOKE_MAX_ARITY=12']
DOUBLES = ctypes.c_void_p
MOST_SECONDS = 1800  # of compilation, on a slow machine


class Unavailable(Exception):
    """The C++ loop cannot be built on this machine; the message gives the reason."""


def versions() -> dict[str, str]:
    """Return the versions of the loop's dependencies; Unavailable names one missing."""
    version_by_name = {}
    for package in PACKAGES:
        try:
            version_by_name[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            raise Unavailable(f"the package '{package}' is not installed "
                              "(pip install 'kane_dynamics[bench]')") from None
    if not compilers():
        raise Unavailable('there is neither g++ nor the package ziglang')
    return version_by_name


def built(source: Path, compiler: Compiler) -> Path:
    """Return the library of a source; compile it first if needed (minutes)."""
    text = repr((source.read_bytes(), FLAGS, versions(), compiler.name,
                 target(compiler)))
    path = FOLDER / f'{source.stem}_{hashlib.sha256(text.encode()).hexdigest()[:16]}.so'
    if not path.exists():
        _compile(source, compiler, path)
    return path


@cache
def library(compiler: Compiler) -> ctypes.CDLL:
    """Return the loop; compile it first if needed (minutes)."""
    loop = ctypes.CDLL(str(built(SOURCE, compiler)))
    loop.make.restype = ctypes.c_void_p
    loop.make.argtypes = [ctypes.c_int, DOUBLES, DOUBLES]
    loop.destroy.argtypes = [ctypes.c_void_p]
    loop.answer.argtypes = [ctypes.c_void_p, ctypes.c_char_p, *[DOUBLES] * 4]
    loop.keep.argtypes = [ctypes.c_void_p, ctypes.c_int, *[DOUBLES] * 3]
    loop.run.argtypes = [ctypes.c_void_p, ctypes.c_char_p]
    loop.batch.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_int,
                           *[DOUBLES] * 4]
    loop.simulate.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_double,
                              *[DOUBLES] * 2]
    return loop


def _compile(source: Path, compiler: Compiler, path: Path) -> None:
    """Build the library; a failure leaves no file."""
    print(f'compiling {source.name} against Pinocchio by {compiler.name} (minutes, '
          'once)', flush=True)
    prefix = Path(sysconfig.get_path('purelib')) / 'cmeel.prefix'
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_suffix('.new')
    try:
        done = subprocess.run(
            [*compiler.cpp, *FLAGS, f'-I{prefix}/include', f'-I{prefix}/include/eigen3',
             str(source), '-o', str(new), f'-L{prefix}/lib', '-lboost_serialization',
             f'-Wl,-rpath,{prefix}/lib'],
            capture_output=True, text=True, check=False, timeout=MOST_SECONDS)
    except subprocess.TimeoutExpired:
        raise Unavailable(
            f'{compiler.name} took more than {MOST_SECONDS} s for '
            f'{source.name}') from None
    if done.returncode:
        raise Unavailable(f'{compiler.name} failed: {done.stderr[-2000:]}')
    new.replace(path)


def _address(array: np.ndarray) -> int:
    return int(array.ctypes.data)


class Pinocchio:
    """Pinocchio's model of a robot of ours, joint by joint, without friction."""

    def __init__(self, robot: Robot, compiler: Compiler) -> None:
        """Pass the bodies depth first: Pinocchio needs contiguous subtrees."""
        self.loop = library(compiler)
        model = robot.model
        self.n, self.order = robot.n, depth_first(model)
        self.columns = [model.bodies[i].joint.coordinate for i in self.order]
        if sorted(self.columns) != list(range(self.n)):
            raise ValueError(
                f'{model.name}: mimic joints have no counterpart in the loop')
        place = {i: k for k, i in enumerate(self.order)} | {WORLD: -1}
        rows = []
        for i in self.order:
            body = model.bodies[i]
            joint = body.joint
            inertial = body.inertial
            rows.append(np.concatenate([
                [place[body.parent], joint.kind == 'prismatic'], joint.axis,
                joint.rotation.ravel(), joint.translation, [inertial.mass], inertial.com,
                inertial.inertia.ravel()]))
        bodies = np.array(rows)
        gravity = np.array(robot.parameters.gravity)
        self.handle = self.loop.make(self.n, _address(bodies), _address(gravity))
        weakref.finalize(self, self.loop.destroy, self.handle)

    def permuted(self, x: np.ndarray) -> np.ndarray:
        """Return our vectors in Pinocchio's order of joints."""
        return np.ascontiguousarray(x[..., self.columns])

    def answer(
            self, what: str, q: np.ndarray, u: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return a quantity at one state, in Pinocchio's order: flat, rows first."""
        out = np.empty(max(3 * self.n, 10 * self.n) * self.n)
        inputs = [self.permuted(v) for v in (q, u, x)]
        size = self.loop.answer(self.handle, what.encode(), *map(_address, inputs),
                                _address(out))
        if size < 0:
            raise KeyError(what)
        return out[:size]

    def keep(self, q: np.ndarray, u: np.ndarray, x: np.ndarray) -> None:
        """Choose the states of `run`."""
        inputs = [self.permuted(v) for v in (q, u, x)]
        self.loop.keep(self.handle, len(q), *map(_address, inputs))

    def run(self, what: str) -> None:
        """Evaluate a quantity once at every kept state."""
        self.loop.run(self.handle, what.encode())

    def batch(self, what: str, q: np.ndarray, u: np.ndarray, x: np.ndarray,
              out: np.ndarray) -> None:
        """
        Write a quantity of states in Pinocchio's order, C-contiguous rows.

        Jacobians and derivatives are written column by column: (N, n, 6) and (N, 3, n,
        n), with the columns of each matrix along the last axis but one; of derivatives
        by udot the upper triangle alone.
        """
        if self.loop.batch(self.handle, what.encode(), len(q),
                           *map(_address, (q, u, x, out))):
            raise KeyError(what)

    def simulate(self, steps: int, h: float, tau: np.ndarray, state: np.ndarray) -> None:
        """Take Runge-Kutta steps; torque and overwritten state in Pinocchio's order."""
        self.loop.simulate(self.handle, steps, h, _address(tau), _address(state))


def builds(robot: Robot) -> dict[str, Pinocchio]:
    """Return Pinocchio's model of a robot by each compiler; Unavailable without one."""
    versions()
    return {compiler.name: Pinocchio(robot, compiler) for compiler in compilers()}


def depth_first(model: Model) -> list[int]:
    """Return the bodies' numbers in an order with contiguous subtrees."""
    children: dict[int, list[int]] = {}
    for i, body in enumerate(model.bodies):
        children.setdefault(body.parent, []).append(i)
    order = []
    pending = children.get(WORLD, [])[::-1]
    while pending:
        i = pending.pop()
        order.append(i)
        pending += children.get(i, [])[::-1]
    return order
