"""Detection of deflections of beams beyond the admissible one in a simulation."""

from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.model.beam import Beam
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.observers import Chunk, Observer
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


class DeflectionWatch(Observer):
    """
    Detects the first time at which a beam bends further than its equations are meant for.

    Parameters
    ----------
    robot : Robot
    single : bool
        Leave out the number of the simulation.

    """

    def __init__(self, robot: Robot, single: bool) -> None:
        """Find the beams and the places of their modal coordinates in q."""
        self._single = single
        self._beams: list[tuple[str, Beam, list[int]]] = []
        self._first: dict[int, DeflectionExcess] = {}  # by simulation
        for body in robot.model.bodies:
            if body.beam is not None:
                # Modal coordinates have places in q; those of ball joints have none.
                places = [int(robot.model.places[k] or 0) for k in body.beam.coordinates]
                self._beams.append((body.name, body.beam, places))

    def look(self, chunk: Chunk) -> None:
        """Look at the states of a chunk."""
        for name, beam, places in self._beams:
            eta = chunk.states[..., places]
            # The peaks of the modes bound the deflection, which decides in most cases.
            within = np.abs(eta) @ beam.peaks <= beam.admissible_deflection
            for i in np.flatnonzero(~within.all(axis=1)).tolist():
                if i not in self._first:
                    self._look_closely(name, beam, i, eta[i], chunk.times)

    def _look_closely(self, name: str, beam: Beam, simulation: int, eta: Array,
                      times: Array) -> None:
        """Store the first excess among modal coordinates eta, (K, m), of a simulation."""
        bound = beam.admissible_deflection
        with np.errstate(over='ignore', invalid='ignore'):
            # Deflection vectors at the points along the beam, then the largest of each
            # row.
            along_beam = np.einsum('gmk,tm->tgk', beam.shapes, eta)
            deflection = np.linalg.norm(along_beam, axis=2).max(axis=1)
        excesses = np.flatnonzero(deflection > bound)
        if len(excesses):
            k = excesses[0]
            self._first[simulation] = DeflectionExcess(float(times[k]), simulation, name,
                                                       float(deflection[k]), bound)

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
