"""
Large batches: ours in SIMD lanes, and Pinocchio's C++ state by state; two threads and one.

Prints a table for the registers that our code may use: `KANE_DYNAMICS_SIMD=avx2` leaves AVX-512
out. Pinocchio is compiled for the processor as it is.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
import os
import sys
from unittest.mock import patch
import warnings

from kane_dynamics import Robot
from kane_dynamics.cli.commands.interleaved_timing import interleaved
from kane_dynamics.native.runtime.kernel import Kernel
from native_loop import ARMS, Race, race, random_states, TOLERANCE
import numpy as np
from pinocchio_native import depth_first, library, Pinocchio, Unavailable
from report import batch_name, ONE_THREAD, simd, STATES

PEER = 'Pinocchio C++'
THREADS = 'KANE_DYNAMICS_THREADS'
TURNS = 15


def peer_race(robot: Robot, what: str) -> Race:
    """Time a large batch of a quantity, one thread each."""
    states, peer = random_states(robot, STATES[what]), Pinocchio(robot)
    permuted = [peer.permuted(x) for x in states]
    kernel, rows = kernel_and_rows(robot, what, states)
    ours = np.empty((len(rows[0]), *kernel.shape))
    theirs = np.empty_like(ours)
    with threads(1):
        timing = interleaved({'ours': lambda: kernel(*rows, out=ours),
                              'theirs': lambda: peer.batch(what, *permuted, theirs)},
                             turns=TURNS)
    theirs = in_our_layout(what, theirs, kernel.shape)
    for axis, size in enumerate(kernel.shape, 1):
        if size == robot.n:
            ours = np.take(ours, peer.columns, axis=axis)
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=TOLERANCE * np.abs(theirs).max())
    return race(robot, batch_name(what), PEER, timing, STATES[what], ('theirs',))


def in_our_layout(what: str, theirs: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return the peer's matrices, which are written column by column, as ours are."""
    if len(shape) == 1:
        return theirs
    columns = theirs.reshape(-1, *shape[:-2], shape[-1], shape[-2])
    matrices = np.swapaxes(columns, -1, -2).copy()
    if what == 'inverse_dynamics_derivatives':  # of dtau/dudot = M only the upper triangle
        upper = np.triu(matrices[:, 2])
        matrices[:, 2] = upper + np.swapaxes(np.triu(upper, 1), -1, -2)
    return matrices


def kernel_and_rows(robot: Robot, what: str,
                    states: np.ndarray) -> tuple[Kernel, list[np.ndarray]]:
    """Return the kernel of a quantity, Jacobians at the last joint, and its arguments."""
    if what == 'partial_velocities':
        last = robot.model.bodies[depth_first(robot.model)[-1]].name
        kernel = robot.kernels.at_frame(what, last)
    else:
        kernel = robot.kernels.quantity(what)
    by_name = dict(zip(('q', 'u', 'udot'), states)) | {'tau': states[2]}
    return kernel, [by_name[argument.name] for argument in kernel.arguments]


def threads_race(robot: Robot, what: str) -> Race:
    """Time a large batch of a quantity in two threads and in one."""
    kernel, rows = kernel_and_rows(robot, what, random_states(robot, STATES[what]))
    result = np.empty((len(rows[0]), *kernel.shape))

    def run(count: int) -> None:
        with threads(count):
            kernel(*rows, out=result)
    timing = interleaved({'ours': partial(run, 2), 'theirs': partial(run, 1)}, turns=TURNS)
    return race(robot, batch_name(what, 'two threads'), ONE_THREAD, timing, STATES[what],
                ('theirs',))


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Let batches use a number of threads."""
    with patch.dict(os.environ, {THREADS: str(count)}):
        yield


def races() -> list[Race]:
    """Return all races; Unavailable says why there are none."""
    library()
    results = []
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        for make in ARMS.values():
            robot = Robot(make(), friction=False)  # which Pinocchio does not know
            for what in STATES:
                results += [peer_race(robot, what), threads_race(robot, what)]
    return results


def table(results: list[Race]) -> str:
    """Return the races as a Markdown table."""
    two_threads = {}
    for result in results:
        if result.peer == ONE_THREAD:
            name = result.what.replace('two threads', ONE_THREAD)
            two_threads[result.robot, name] = result.ratio[0]
    head = f'| widest registers: {simd()} | states | ours, ns a state | Pinocchio C++, ns '
    lines = [f'{head}| ratio | two threads / one |', '|---|---|---|---|---|---|']
    for r in results:
        if r.peer == ONE_THREAD:
            continue
        count, what = r.what.removeprefix('batch of ').removesuffix(f', {ONE_THREAD}').split(': ')
        middle, low, high = r.ratio
        lines.append(f'| {r.robot}: {what.replace("_", " ")} | {count} | {1e9 * r.ours:.1f} '
                     f'| {1e9 * r.theirs:.0f} | {middle:.1f} ({low:.1f} to {high:.1f}) '
                     f'| {two_threads[r.robot, r.what]:.2f} |')
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
