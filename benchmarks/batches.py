"""
Large batches: ours in SIMD lanes, Pinocchio's C++ state by state; two threads, one.

Two threads are also compared with what two processors gain in pure arithmetic: a
function of one number with 800 multiplications and additions, in the same lanes, started
and joined in the same way, in a batch that takes as long, in the same interleaved run.
If the second processor is half of a core, shared with other machines, or has to be
woken, that function gains as little.

Prints a table for the registers that our code may use: `KANE_DYNAMICS_SIMD=avx2` leaves
AVX-512 out. Pinocchio is compiled for the processor as it is.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
import os
import sys
from unittest.mock import patch
import warnings

from interleaved_timing import interleaved, Timing
from kane_dynamics import Robot
from kane_dynamics.native.runtime.kernel import batch_kernel, Kernel
from native_loop import ARMS, CPP, cpp_races, Race, race, random_states, TOLERANCE
import numpy as np
from pinocchio_native import builds, depth_first, Unavailable
from report import AS_ARITHMETIC, batch_name, ONE_THREAD, simd, STATES

THREADS = 'KANE_DYNAMICS_THREADS'
TURNS = 15
# Enough chains of `arithmetic` to keep two units of products busy.
CHAINS = 8
LENGTH = 100


def peer_races(robot: Robot, what: str) -> list[Race]:
    """Time a large batch of a quantity, one thread each."""
    states = random_states(robot, STATES[what])
    kernel, rows = kernel_and_rows(robot, what, states)
    ours = np.empty((len(rows[0]), *kernel.shape))
    contenders = {'ours': partial(kernel, *rows, out=ours)}
    results = {}
    for name, peer in builds(robot).items():
        permuted = [peer.permuted(x) for x in states]
        results[name] = np.empty_like(ours)
        contenders[f'{name}: {what}'] = partial(peer.batch, what, *permuted,
                                                results[name])
    with threads(1):
        timing = interleaved(contenders, turns=TURNS)
    for axis, size in enumerate(kernel.shape, 1):
        if size == robot.n:
            ours = np.take(ours, peer.columns, axis=axis)
    for theirs in results.values():
        theirs = in_our_layout(what, theirs, kernel.shape)
        np.testing.assert_allclose(ours, theirs, rtol=0.0,
                                   atol=TOLERANCE * np.abs(theirs).max())
    return cpp_races(robot, batch_name(what), timing, STATES[what])


def in_our_layout(what: str, theirs: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return the peer's matrices, which are written column by column, as ours are."""
    if len(shape) == 1:
        return theirs
    columns = theirs.reshape(-1, *shape[:-2], shape[-1], shape[-2])
    matrices = np.swapaxes(columns, -1, -2).copy()
    # Of dtau/dudot = M only the upper triangle.
    if what == 'inverse_dynamics_derivatives':
        upper = np.triu(matrices[:, 2])
        matrices[:, 2] = upper + np.swapaxes(np.triu(upper, 1), -1, -2)
    return matrices


def kernel_and_rows(robot: Robot, what: str,
                    states: np.ndarray) -> tuple[Kernel, list[np.ndarray]]:
    """Return a quantity's kernel, Jacobians at the last joint, and its arguments."""
    if what == 'partial_velocities':
        last = robot.model.bodies[depth_first(robot.model)[-1]].name
        kernel = robot.kernels.kernel(what, last)
    else:
        kernel = robot.kernels.kernel(what)
    by_name = dict(zip(('q', 'u', 'udot'), states)) | {'tau': states[2]}
    return kernel, [by_name[argument.name] for argument in kernel.arguments]


def threads_races(robot: Robot, what: str) -> list[Race]:
    """Time a large batch in two threads and in one, and relative to arithmetic alone."""
    kernel, rows = kernel_and_rows(robot, what, random_states(robot, STATES[what]))
    calls = {
        'quantity': partial(kernel, *rows, out=np.empty((len(rows[0]), *kernel.shape))),
        'arithmetic': arithmetic_call(kernel, rows)}

    def run(name: str, count: int) -> None:
        with threads(count):
            calls[name]()
    timing = interleaved({f'{name} {count}': partial(run, name, count)
                          for name in calls for count in (1, 2)}, turns=TURNS)
    # The time in two threads if the quantity gained as much as arithmetic, turn by turn.
    seconds = timing.seconds
    gain = seconds['arithmetic 1'] / seconds['arithmetic 2']
    timing = Timing({'ours': seconds['quantity 2'], 'one': seconds['quantity 1'],
                     'ideal': seconds['quantity 1'] / gain})
    name = batch_name(what, 'two threads')
    return [race(robot, name, ONE_THREAD, timing, STATES[what], ('one',)),
            race(robot, name, AS_ARITHMETIC, timing, STATES[what], ('ideal',))]


def arithmetic_call(kernel: Kernel, rows: list[np.ndarray]) -> Callable[[], object]:
    """Return a batch call of `arithmetic` that takes as long as a kernel's, to 10 %."""
    count = 1000
    function = arithmetic()

    def seconds(call: Callable[[], object]) -> float:
        return float(np.median(interleaved({'call': call}, turns=5).seconds['call']))
    with threads(1):
        kernel_time = seconds(partial(kernel, *rows))
        numbers = np.linspace(-1.0, 1.0, count)[:, None]
        count = max(count,
                    round(count * kernel_time / seconds(partial(function, numbers))))
    numbers = np.linspace(-1.0, 1.0, count)[:, None]
    return partial(function, numbers, out=np.empty((count, 1)))


@cache
def arithmetic() -> Kernel:
    """Return the kernel of a sum of `CHAINS` recursions y' = x y + c, `LENGTH` steps."""
    def function(x: np.ndarray) -> np.ndarray:
        chains = [0.1 * k for k in range(CHAINS)]
        for step in range(LENGTH):
            chains = [x[0] * y + 1.0 / (1.0 + step + k) for k, y in enumerate(chains)]
        return np.array([sum(chains)])
    return batch_kernel('arithmetic', function, [('x', (1,))], (1,), ahead=False)


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Let batches use a number of threads."""
    with patch.dict(os.environ, {THREADS: str(count)}):
        yield


def races() -> list[Race]:
    """Return all races; Unavailable says why there are none."""
    results = []
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        for make in ARMS.values():
            robot = Robot(make(), friction=False)  # which Pinocchio does not know
            for what in STATES:
                results += [*peer_races(robot, what), *threads_races(robot, what)]
    return results


def table(results: list[Race]) -> str:
    """Return the races as a Markdown table."""
    two_threads = {}
    for result in results:
        if result.peer in (ONE_THREAD, AS_ARITHMETIC):
            name = result.what.replace('two threads', ONE_THREAD)
            two_threads[result.robot, name, result.peer] = result.ratio[0]
    head = (
        f'| widest registers: {simd()} | states | ours, ns a state | Pinocchio C++, ns ')
    lines = [f'{head}| ratio | two threads / one | / arithmetic |',
             '|---|---|---|---|---|---|---|']
    for r in results:
        if r.peer != CPP:
            continue
        count, what = r.what.removeprefix('batch of ').removesuffix(
            f', {ONE_THREAD}').split(': ')
        middle, low, high = r.ratio
        lines.append(
            f'| {r.robot}: {what.replace("_", " ")} | {count} | {1e9 * r.ours:.1f} '
            f'| {1e9 * r.theirs:.0f} | {middle:.1f} ({low:.1f} to {high:.1f}) '
            f'| {two_threads[r.robot, r.what, ONE_THREAD]:.2f} '
            f'| {two_threads[r.robot, r.what, AS_ARITHMETIC]:.2f} |')
    return '\n'.join(lines)


def main() -> int:
    """Print the table."""
    try:
        print(table(races()))
    except Unavailable as error:
        print(f'batches left out: {error}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
