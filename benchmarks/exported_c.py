"""Exported C, compiled by gcc -O3, and the native kernels, interleaved."""

from collections.abc import Callable
import ctypes
from pathlib import Path
import shutil
import subprocess
import sys
import tempfile
import time
import warnings

from gates import exit_status
from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.native.runtime.loops import repeat
from kane_dynamics.robot.export_c import DEFAULT_KERNELS
import numpy as np

TURNS = 400
STATES = 1024  # that fit the cache, so that the arithmetic is what is timed
# Times the native kernel's time.
ROBOTS = ('ur10e', 'fr3')
MOST = 1.3
FRAMES = {'ur10e': 'tool0', 'fr3': 'fr3_link8'}
# The same loop around both, in native code: a kernel reads a table of pointers, exported
# C takes them one by one.
LOOP = """
static void {name}_table(double **p) {{ {name}({arguments}); }}
void *{name}_kernel(void) {{ return (void *){name}_table; }}
"""


def races(folder: Path) -> list[tuple[str, str, list[float]]]:
    """Return robot, kernel, and seconds of a native call and one of exported C."""
    figures = []
    for name in ROBOTS:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            robot = Robot(load_urdf(resource_path('urdf', f'{name}.urdf')))
        frame = FRAMES[name]
        kernels = [*DEFAULT_KERNELS, f'jacobian:{frame}', f'frame_pose:{frame}']
        source, _ = robot.export_c(folder / f'{name}.c', kernels)
        symbols = {kernel: f'{name}_{kernel.replace(":", "_")}' for kernel in kernels}
        native = {kernel: robot.kernels.kernel(
            'partial_velocities' if kernel.startswith('jac') else 'frame_pose', frame)
            if ':' in kernel else robot.kernels.kernel(kernel) for kernel in kernels}
        loops = [LOOP.format(name=symbol, arguments=', '.join(
            f'p[{k}]' for k in range(len(native[kernel].arguments) + 2)))
            for kernel, symbol in symbols.items()]
        (folder / f'{name}_loops.c').write_text(
            f'#include "{source.name}"\n' + '\n'.join(loops), encoding='utf-8')
        library = folder / f'{name}.so'
        subprocess.run(
            ['gcc', '-O3', '-fPIC', '-shared', str(folder / f'{name}_loops.c'), '-o',
             str(library), '-lm'], check=True)
        exported = ctypes.CDLL(str(library))
        assert exported[f'{name}_self_test']() == 0
        rng = np.random.default_rng(0)
        for kernel, symbol in symbols.items():
            kernel_function = native[kernel]
            given = [rng.uniform(-2.0, 2.0, (STATES, *a.shape))
                     for a in kernel_function.arguments]
            results = [np.empty((STATES, *kernel_function.shape)) for _ in range(2)]
            address = exported[f'{symbol}_kernel']
            address.restype = ctypes.c_void_p

            def loop(code: object, result: np.ndarray, given: list[np.ndarray] = given,
                     parameters: np.ndarray = robot.parameters.block) -> Callable[[],
                                                                                  None]:
                blocks = [*given, parameters, result]
                rows = [x.ctypes.data for x in blocks]
                strides = [*(x.strides[0] for x in given), 0, result.strides[0]]
                return lambda: repeat(code, rows, strides, STATES)
            took = alternating(loop(kernel_function.address, results[0]),
                               loop(address(), results[1]))
            np.testing.assert_allclose(results[1], results[0], rtol=1e-7,
                                       atol=1e-7 * np.abs(results[0]).max())
            figures.append((name, kernel, took))
    return figures


def alternating(*loops: Callable[[], None]) -> list[float]:
    """
    Return the seconds of a call of each, in turns too short to be disturbed often.

    Of the turns the fastest fifth counts: what others do on the machine only adds.
    """
    seconds = np.empty((TURNS, len(loops)))
    for turn in range(TURNS):
        for k, loop in enumerate(loops):
            start = time.perf_counter()
            loop()
            seconds[turn, k] = time.perf_counter() - start
    fastest: list[float] = (np.quantile(seconds, 0.1, axis=0) / STATES).tolist()
    return fastest


def main() -> int:
    """Print the ratios; return 1 where one is above the gate."""
    if shutil.which('gcc') is None:
        print('no gcc')
        return 0
    with tempfile.TemporaryDirectory() as folder:
        figures = races(Path(folder))
    failures = 0
    for robot, kernel, (native, exported) in figures:
        late = exported > MOST * native
        failures += late
        print(f'{robot:6} {kernel:24} native {1e9 * native:5.0f} ns, exported '
              f'{1e9 * exported:5.0f} ns: '
              f'{exported / native:.2f}{"  MISSED" if late else ""}')
    print(f'{failures} of {len(figures)} above {MOST}')
    return exit_status(not failures)


if __name__ == '__main__':
    sys.exit(main())
