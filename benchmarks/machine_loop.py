"""
Closed loops and a free-flying arm in a native loop: our kernels and Pinocchio's C++.

Pinocchio joins points by contacts of three rows and solves by a proximal method; ours
closes the planar loops of the four-bar and the palletizer without their out-of-plane
rows. Of Pinocchio's compilers, of its two conventions of aba and of the settings with
which the proximal method agrees with ours, the fastest counts.
"""

from collections.abc import Callable
import ctypes
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
import sys
import weakref

from compilers import Compiler, compilers
from interleaved_timing import interleaved
from machines import closed_loops, free_arm, Machine, SAME, SETTINGS
from native_loop import cpp_races, kernel_loop, Race, STATES
import numpy as np
from pinocchio_native import built, Unavailable, versions

SOURCE = Path(__file__).with_name('pinocchio_machines.cpp')
INVERSE, FORWARD, FORWARD_WORLD, CONSTRAINED = range(4)  # as in the source
Settings = tuple[float, float]
CHECKED = 64  # states


@cache
def library(compiler: Compiler) -> ctypes.CDLL:
    """Return the loop; compile it first if needed (minutes)."""
    loop = ctypes.CDLL(str(built(SOURCE, compiler)))
    place = ctypes.c_void_p
    loop.make.restype = place
    loop.make.argtypes = [ctypes.c_int, place, place, ctypes.c_int, place,
                          ctypes.c_double, ctypes.c_double]
    loop.destroy.argtypes = [place]
    loop.keep.argtypes = [place, ctypes.c_int, place, place, place]
    loop.run.argtypes = [place, ctypes.c_int]
    loop.answer.argtypes = [place, ctypes.c_int, ctypes.c_int, place]
    return loop


class Peer:
    """Pinocchio's model of a machine, with its states."""

    def __init__(self, machine: Machine, x: np.ndarray, compiler: Compiler,
                 settings: Settings) -> None:
        """Build it; x is tau or all joints' accelerations, in Pinocchio's order."""
        q, v, _ = machine.peer_states
        rows = machine.joints
        contacts = machine.contacts
        gravity = np.array(machine.robot.parameters.gravity)
        self.loop = library(compiler)
        self.size = v.shape[1]
        self.handle = self.loop.make(len(rows), rows.ctypes.data, gravity.ctypes.data,
                                     len(contacts), contacts.ctypes.data, *settings)
        weakref.finalize(self, self.loop.destroy, self.handle)
        arrays = [np.ascontiguousarray(part) for part in (q, v, x)]
        self.loop.keep(self.handle, len(q), *(part.ctypes.data for part in arrays))

    def run(self, what: int) -> None:
        """Evaluate a quantity once at every state."""
        self.loop.run(self.handle, what)

    def answer(self, what: int, i: int) -> np.ndarray:
        """Return a quantity at a state."""
        out = np.empty(self.size)
        self.loop.answer(self.handle, what, i, out.ctypes.data)
        return out


def compare(name: str, machine: Machine, quantity: str, what: str) -> list[Race]:
    """Race a quantity of a machine, after both gave the same numbers."""
    robot = machine.robot
    closed = len(machine.contacts) > 0
    inverse = quantity == 'inverse_dynamics'
    rivals = ((CONSTRAINED,) if closed else
              (INVERSE,) if inverse else (FORWARD, FORWARD_WORLD))
    x = machine.accelerations(machine.x) if inverse else machine.peer_states[2]
    expected = getattr(robot, quantity)(machine.q, machine.u, machine.x)
    if inverse:
        expected = machine.as_peer(machine.q, expected)
    else:
        expected = machine.accelerations(expected)
    rows = {'q': machine.q, 'u': machine.u, 'udot': machine.x, 'tau': machine.x}
    loops: dict[str, Callable[[], object]] = {
        'ours': kernel_loop(robot.kernels.kernel(quantity), rows)}
    for compiler in compilers():
        for settings in SETTINGS if closed else SETTINGS[:1]:
            peer = Peer(machine, x, compiler, settings)
            for rival in rivals:
                if largest_error(peer, rival, expected) < SAME:
                    contender = f'{compiler.name}: {rival} {settings}'
                    loops[contender] = partial(peer.run, rival)
    if len(loops) == 1:
        raise AssertionError(f'{name}: {quantity} of Pinocchio differs by more than '
                             f'{SAME:g} of its size with all settings')
    return [replace(line, robot=name)
            for line in cpp_races(robot, what, interleaved(loops), STATES)]


def largest_error(peer: Peer, rival: int, expected: np.ndarray) -> float:
    """Return the largest error of the first states, relative to the largest entry."""
    errors = []
    for i, right in enumerate(expected[:CHECKED]):
        error = np.abs(peer.answer(rival, i) - right).max() / np.abs(right).max()
        errors.append(float(error))
    return max(errors)


def races() -> list[Race]:
    """Return all races; Unavailable says why there are none."""
    versions()
    lines = []
    for name, machine in closed_loops().items():
        lines += compare(name, machine, 'forward_dynamics',
                         'native loop: constraint dynamics')
    arm = free_arm()
    for quantity in ('inverse_dynamics', 'forward_dynamics'):
        lines += compare('free-flying fr3', arm, quantity, f'native loop: {quantity}')
    return lines


def main() -> int:
    """Print the races."""
    try:
        print(*races(), sep='\n')
    except Unavailable as error:
        print(f'machines left out: {error}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
