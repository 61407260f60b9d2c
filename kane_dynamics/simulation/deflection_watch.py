"""Detection of deflections of beams beyond the admissible one in a simulation."""

from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.model.beam import Beam
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.observers import Chunk, Extremes, Observer
import numpy as np


class DeflectionExcess(NamedTuple):
    """
    The first deflection of a simulation beyond the admissible one.

    Attributes
    ----------
    t : float
        Time, s.
    simulation : int
    beam : str
    deflection, bound : float
        m.

    """

    t: float
    simulation: int
    beam: str
    deflection: float
    bound: float


class _WatchedBeam(NamedTuple):
    """A beam, the places of its modal coordinates in q, and the peaks of its modes, m."""

    name: str
    beam: Beam
    places: list[int]
    peaks: Array


class DeflectionWatch(Observer):
    """
    Detects the first time at which a beam bends further than its equations are meant for.

    Parameters
    ----------
    robot : Robot
    states : (N, size) array
        Initial states, q first.
    start : float
        Their time, s.
    single : bool
        Leave out the number of the simulation.

    """

    def __init__(self, robot: Robot, states: Array, start: float, single: bool) -> None:
        """Look at the initial states."""
        self._single = single
        self._beams: list[_WatchedBeam] = []
        self._first: dict[int, DeflectionExcess] = {}  # by simulation
        for body in robot.model.bodies:
            if body.beam is not None:
                # Modal coordinates have places in q; those of ball joints have none.
                places = [int(robot.model.places[k] or 0) for k in body.beam.coordinates]
                self._beams.append(_WatchedBeam(body.name, body.beam, places,
                                                body.beam.peaks))
        self._look(states[:, None], np.array([start]), (states, states))

    def look(self, chunk: Chunk) -> None:
        """Look at further states."""
        if self._beams:
            self._look(chunk.states[:, 1:], chunk.times[1:], chunk.extremes)

    def _look(self, states: Array, t: Array, extremes: Extremes) -> None:
        """Look at states, (N, K, size), at times t, (K,)."""
        low, high = extremes
        magnitudes = np.maximum(-low, high)
        for watched in self._beams:
            # The peaks of the modes bound the deflection. The bound decides in most
            # cases, unless the motion diverges.
            largest = magnitudes[:, watched.places]
            within = largest @ watched.peaks <= watched.beam.admissible_deflection
            for i in np.flatnonzero(~within).tolist():
                if i not in self._first:
                    self._look_closely(watched, i, states[i][:, watched.places], t)

    def _look_closely(self, watched: _WatchedBeam, simulation: int, eta: Array,
                      t: Array) -> None:
        """Store the first excess among modal coordinates eta, (K, m), of a simulation."""
        beam = watched.beam
        with np.errstate(over='ignore', invalid='ignore'):
            # Deflection vectors at the points along the beam, then the largest of each
            # row.
            along_beam = np.einsum('gmk,tm->tgk', beam.shapes, eta)
            deflection = np.linalg.norm(along_beam, axis=2).max(axis=1)
        excesses = np.flatnonzero(deflection > beam.admissible_deflection)
        if len(excesses):
            k = excesses[0]
            self._first[simulation] = DeflectionExcess(float(t[k]), simulation,
                                                       watched.name,
                                                       float(deflection[k]),
                                                       beam.admissible_deflection)

    def warning(self) -> str | None:
        """Return the warning for the first excess, or None."""
        if not self._first:
            return None
        # Records are ordered by their time.
        first = min(self._first.values())
        which = '' if self._single else f' of simulation {first.simulation}'
        count = len(self._first)
        count_text = f' ({count} simulations)' if count > 1 else ''
        return (f"beam '{first.beam}'{which}: a deflection of {first.deflection:.3g} m "
                f'at {first.t:.6g} s{count_text}; expected at most {first.bound:.3g} m, '
                'a tenth of its length. The motion is inaccurate from there on. Use '
                'several shorter beams in series for this link')
