"""
Closed loops and a free-flying arm in a native loop: our kernels and Pinocchio's C++.

Pinocchio joins points by contacts of three rows and solves by a proximal method; ours
closes the planar loops of the four-bar and the palletizer without their out-of-plane
rows. Of Pinocchio's two conventions of aba the faster counts.
"""

from collections.abc import Callable
import ctypes
from functools import cache, partial
from pathlib import Path
import sys
import weakref

from interleaved_timing import interleaved
from machines import ACCURACY, closed_loops, free_arm, Machine
from native_loop import kernel_loop, Race, STATES
import numpy as np
from pinocchio_native import built, Unavailable

SOURCE = Path(__file__).with_name('pinocchio_machines.cpp')
INVERSE, FORWARD, FORWARD_WORLD, CONSTRAINED = range(4)  # as in the source
# relative; the proximal solver of the peer is not exact
PEER = 'Pinocchio C++'
SAME = 1e-6


@cache
def library() -> ctypes.CDLL:
    """Return the loop; compile it first if needed (minutes)."""
    loop = ctypes.CDLL(str(built(SOURCE)))
    place = ctypes.c_void_p
    loop.make.restype = place
    loop.make.argtypes = [ctypes.c_int, place, place, ctypes.c_int, place,
                          ctypes.c_double]
    loop.destroy.argtypes = [place]
    loop.keep.argtypes = [place, ctypes.c_int, place, place, place]
    loop.run.argtypes = [place, ctypes.c_int]
    loop.answer.argtypes = [place, ctypes.c_int, ctypes.c_int, place]
    return loop


class Peer:
    """Pinocchio's model of a machine, with its states."""

    def __init__(self, machine: Machine, x: np.ndarray) -> None:
        """Build it; x is tau or all joints' accelerations, in Pinocchio's order."""
        q, v, _ = machine.peer_states
        rows = machine.joints
        contacts = machine.contacts
        gravity = np.array(machine.robot.parameters.gravity)
        self.loop = library()
        self.size = v.shape[1]
        self.handle = self.loop.make(len(rows), rows.ctypes.data, gravity.ctypes.data,
                                     len(contacts), contacts.ctypes.data, ACCURACY)
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


def compare(name: str, machine: Machine, quantity: str, what: str) -> Race:
    """Race a quantity of a machine, after both gave the same numbers at a few states."""
    robot = machine.robot
    inverse = quantity == 'inverse_dynamics'
    rivals = ((CONSTRAINED,) if len(machine.contacts) else
              (INVERSE,) if inverse else (FORWARD, FORWARD_WORLD))
    peer = Peer(machine,
                machine.accelerations(machine.x) if inverse else machine.peer_states[2])
    ours = getattr(robot, quantity)(machine.q, machine.u, machine.x)
    ours = machine.as_peer(machine.q, ours) if inverse else machine.accelerations(ours)
    for i in range(5):
        theirs = peer.answer(rivals[-1], i)
        error = np.abs(ours[i] - theirs).max() / np.abs(theirs).max()
        if not error < SAME:
            raise AssertionError(
                f'{name}: {quantity} differs by {error:.2g} of its size from '
                f'Pinocchio; at most {SAME:g}')
    rows = {'q': machine.q, 'u': machine.u, 'udot': machine.x, 'tau': machine.x}
    loops: dict[str, Callable[[], object]] = {
        'ours': kernel_loop(robot.kernels.quantity(quantity), rows),
        **{f'theirs {rival}': partial(peer.run, rival) for rival in rivals}}
    timing = interleaved(loops)
    faster = min((f'theirs {rival}' for rival in rivals), key=timing.median)
    return Race(name, robot.n, what, PEER, timing.median('ours') / STATES,
                timing.median(faster) / STATES, timing.ratio(faster, 'ours'))


def races() -> list[Race]:
    """Return all races; Unavailable says why there are none."""
    library()
    loops = []
    for name, machine in closed_loops().items():
        loops.append(compare(name, machine, 'forward_dynamics',
                             'native loop: constraint dynamics'))
    arm = free_arm()
    return loops + [compare('free-flying fr3', arm, quantity, f'native loop: {quantity}')
                    for quantity in ('inverse_dynamics', 'forward_dynamics')]


def main() -> int:
    """Print the races."""
    try:
        print(*races(), sep='\n')
    except Unavailable as error:
        print(f'machines left out: {error}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
