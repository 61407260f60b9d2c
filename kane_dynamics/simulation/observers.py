"""
The protocol of what watches a simulation.

The stepping loop (`stepping.run`) computes a simulation in chunks of successive steps.
For each chunk

1. every observer looks ahead (`look_ahead`), at what is known before the steps are computed;
2. the steps are computed;
3. every observer looks at the `Chunk` of states (`look`), in the order of the list.

An observer records what it sees and changes nothing. An error that it raises ends the
simulation; the observers after it do not look at that chunk. After the last chunk,
`warning` returns a text for the user, or None.

What changes states is no observer but a part of the steps (`stepping.Steps`), such as the
impulses of joint stops.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
from typing import Any, NamedTuple, Protocol

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.native.backends.llvm_math import size_limit
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import state_names
import numpy as np

# The power of the torques, (N, rows), W, at row numbers of the states of a chunk.
Power = Callable[[Array], Array]


class Impact(NamedTuple):
    """
    Energy that stops take at the end of one of several steps, or arrays of several steps.

    The uncertainty is that of the work of the step, J. A step in which a joint sticks or
    breaks away has an uncertainty alone.
    """

    step: Any
    simulation: int
    energy: Any
    unresolved: Any


class Exchange(NamedTuple):
    """
    The exchange of energy between the robot and its surroundings in the steps of a chunk.

    Attributes
    ----------
    torques : (1 or N, 1 or K, n) array, or callable
        Torques held during each step, or the power of a continuous law.
    impacts : sequence of Impact
        Effects of stops.

    """

    torques: Array | Power
    impacts: Sequence[Impact]


class Energetics(Protocol):
    """The steps of a chunk as observers see them; states are those of the chunk."""

    def exchange(self, states: Array, done: int) -> Exchange:
        """Return the torques that exchange energy in the steps after `done`, once a chunk."""


@dataclass(frozen=True, eq=False)
class Chunk:
    """
    The states of N simulations during K successive steps.

    Attributes
    ----------
    done : int
        Number of earlier steps.
    times : (K + 1,) array
        Times of the states, s.
    states : (N, K + 1, size) array
        After `done` steps and after each of the K next ones; entries as
        `step_kernels.state_names`.
    energetics : Energetics
        The steps.

    """

    done: int
    times: Array
    states: Array
    energetics: Energetics


class Observer:
    """An observer that sees nothing; subclasses replace what they need."""

    def look_ahead(self, done: int, steps: int) -> None:
        """Look at what is known of the next steps, after `done` steps."""

    def look(self, chunk: Chunk) -> None:
        """Look at the states of a chunk."""

    def warning(self) -> str | None:
        """Return the text of a warning about the whole simulation, or None."""
        return None


class DivergenceWatch(Observer):
    """
    Raises InputError for a motion that diverges: not finite, or positions too large.

    Parameters
    ----------
    robot : Robot
    step : float
        s.
    single : bool
        Leave out the number of the simulation.
    earlier : Observer, optional
        An observer before it, whose warning may explain the divergence.

    """

    def __init__(self, robot: Robot, step: float, single: bool,
                 earlier: Observer | None = None) -> None:
        """Store the arguments."""
        self._robot, self._step = robot, step
        self._single, self._earlier = single, earlier

    def look(self, chunk: Chunk) -> None:
        """Raise InputError if states diverged, which remain so until the end of the chunk."""
        # A state that diverged stays so: the last row of the chunk shows it.
        if not diverged(self._robot, chunk.states[:, -1]).any():
            return
        # The first row with such an entry, and its first simulation and entry there.
        entries = diverged(self._robot, chunk.states)
        k = int(np.argmax(entries.any(axis=(0, 2))))
        i, j = np.argwhere(entries[:, k])[0].tolist()
        reason = None
        if self._earlier is not None:
            reason = self._earlier.warning()
        which = 'the simulation' if self._single else f'simulation {i}'
        raise diverged_error(which, chunk.times[k], self._step,
                             state_names(self._robot)[j],
                             float(chunk.states[i, k, j]), reason)


def diverged(robot: Robot, states: Array) -> Any:
    """Return which entries of states are not finite, or positions that are too large."""
    largest = np.full(states.shape[-1], np.finfo(float).max)
    largest[:robot.n_q] = size_limit('q')
    return ~(np.abs(states) <= largest)


def diverged_error(which: str, t: float, step: float, entry: str = '',
                   value: float = math.nan, earlier: str | None = None) -> InputError:
    """
    Return the error for a simulation whose state is not finite, or too large, at t, s.

    `earlier` is an earlier warning of the simulation.
    """
    # Parts of the message that may be missing.
    entry_text = ''
    if entry:
        entry_text = f" ('{entry}' first)"
    state_text = 'is not finite'
    if math.isfinite(value):
        state_text = f'is {value:.3g}'
    earlier_text = ''
    if earlier:
        earlier_text = f'. Earlier, {earlier}'
    return InputError(f'{which}: the state diverged ({state_text}) at {t:.6g} '
                      f's{entry_text} with a step of {step} s; expected a regular mass '
                      "matrix and a shorter step, or integrator='implicit' if friction, "
                      f'springs or bending are stiff{earlier_text}')
