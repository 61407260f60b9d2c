"""Detection of deflections of beams beyond the admissible one in a simulation."""

from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.model.beam import Beam
from kane_dynamics.robot.robot import Robot
import numpy as np


class Excess(NamedTuple):
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


class DeflectionWatch:
    """
    Detects the first time at which a beam bends further than its equations are meant for.

    Parameters
    ----------
    robot : Robot
    states : (N, size) array
        Initial states, q first.
    start : float
        Their time, s.

    """

    def __init__(self, robot: Robot, states: Array, start: float) -> None:
        """Look at the initial states."""
        model = robot.model
        self._beams: list[tuple[str, Beam, list[int], Array]] = []
        for body in model.bodies:
            if body.beam is not None:
                # Places in q; those of ball joints, which have none, are not among them.
                places = [int(model.places[k] or 0) for k in body.beam.coordinates]
                largest = np.linalg.norm(body.beam.shapes, axis=2).max(axis=0)
                self._beams.append((body.name, body.beam, places, largest))
        self._first: dict[int, Excess] = {}  # by simulation
        self.look(states[:, None], np.array([start]))

    def look(self, states: Array, t: Array, extremes: tuple[Array, Array] | None = None) -> None:
        """
        Look at further states.

        Parameters
        ----------
        states : (N, K, size) array
            States of every simulation at further times.
        t : (K,) array
            Their times, s.
        extremes : (N, size) arrays, optional
            Minimum and maximum of each entry over the K times, if known already.

        """
        for name, beam, places, largest in self._beams:
            # A bound of the deflection from the peaks of the modes decides in most cases, unless
            # the motion diverges.
            if extremes is None:
                peaks = np.abs(states[:, :, places]).max(axis=1, initial=0.0)
            else:
                peaks = np.maximum(*(np.abs(extreme[:, places]) for extreme in extremes))
            for i in np.flatnonzero(~(peaks @ largest <= beam.admissible_deflection)).tolist():
                if i not in self._first:
                    self._look_at(name, beam, i, states[i][:, places], t)

    def _look_at(self, name: str, beam: Beam, simulation: int, eta: Array, t: Array) -> None:
        """Store the first excess among the modal coordinates eta, (K, m), of a simulation."""
        with np.errstate(over='ignore', invalid='ignore'):
            along = np.einsum('gmk,tm->tgk', beam.shapes, eta)
            deflection = np.linalg.norm(along, axis=2).max(axis=1)
        beyond = np.flatnonzero(deflection > beam.admissible_deflection)
        if len(beyond):
            k = beyond[0]
            self._first[simulation] = Excess(float(t[k]), simulation, name,
                                             float(deflection[k]), beam.admissible_deflection)

    def warning(self, single: bool) -> str | None:
        """Return the warning for the first excess, or None; `single` omits the simulation."""
        if not self._first:
            return None
        first = min(self._first.values())
        which = '' if single else f' of simulation {first.simulation}'
        count = len(self._first)
        others = f' ({count} simulations)' if count > 1 else ''
        return (f"beam '{first.beam}'{which}: a deflection of {first.deflection:.3g} m at "
                f'{first.t:.6g} s{others}; expected at most {first.bound:.3g} m, a tenth of its '
                'length. The motion is inaccurate from there on. Use several shorter beams in '
                'series for this link')
