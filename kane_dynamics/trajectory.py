"""`Trajectory`: what a simulation returns."""

from collections.abc import Sequence
import csv
from dataclasses import dataclass
import os
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.model import Array
from kane_dynamics.parameters import JointLimits
import numpy as np

Path = str | os.PathLike[str]
ARRAYS = ('t', 'q', 'u', 'udot', 'tau', 'energy')


@dataclass(frozen=True)
class LimitEvent:
    """A joint's first crossing of one of its limits since it last kept it."""

    t: float
    joint: str
    limit: str  # 'lower', 'upper' or 'velocity'
    value: float
    bound: float

    def __str__(self) -> str:
        """Say it in words."""
        what = 'speed' if self.limit == 'velocity' else 'position'
        return (f"at {self.t:.4g} s joint '{self.joint}' passes its {self.limit} limit: {what} "
                f'{self.value:.4g}, limit {self.bound:.4g}')


@dataclass(frozen=True, eq=False)
class Trajectory:
    """
    A simulated motion, sampled.

    Attributes
    ----------
    t : (K,) array
        s.
    q, u, udot : (K, n) arrays
        rad or m, and s.
    tau : (K, n) array
        Torques of the actuators, N m or N.
    energy : (K, 2) array
        Kinetic and potential energy, J.
    joint_names : tuple of str
    limit_events : tuple of LimitEvent
        Found at every step, not only at the samples. The simulation goes on past a limit: a stop
        would be a contact, which is not modelled.

    """

    t: Array
    q: Array
    u: Array
    udot: Array
    tau: Array
    energy: Array
    joint_names: tuple[str, ...]
    limit_events: tuple[LimitEvent, ...] = ()

    def save_npz(self, path: Path) -> None:
        """Write all arrays and the joint names to a compressed npz file."""
        events = [(e.t, e.joint, e.limit, e.value, e.bound) for e in self.limit_events]
        np.savez_compressed(path, joint_names=np.array(self.joint_names),
                            limit_events=np.array(events, dtype=str).reshape(-1, 5),
                            **{name: getattr(self, name) for name in ARRAYS})

    @classmethod
    def load_npz(cls, path: Path) -> 'Trajectory':
        """Read what `save_npz` wrote; InputError if it is something else."""
        try:
            with np.load(path, allow_pickle=False) as file:
                events = tuple(LimitEvent(float(t), str(joint), str(limit), float(v), float(b))
                               for t, joint, limit, v, b in file['limit_events'])
                return cls(**{name: file[name] for name in ARRAYS}, limit_events=events,
                           joint_names=tuple(map(str, file['joint_names'])))
        except (KeyError, ValueError) as error:
            raise InputError(f'{os.fspath(path)} is no trajectory of save_npz: {error}') from None

    def save_csv(self, path: Path) -> None:
        """Write one row a sample; the header names quantity and joint, as ``q.elbow``."""
        with open(path, 'w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file)
            writer.writerow(['t', *_columns(self.joint_names), 'kinetic_energy',
                             'potential_energy'])
            table = np.column_stack([getattr(self, name) for name in ARRAYS])
            writer.writerows([repr(x) for x in row] for row in table.tolist())

    def plot(self, path: Path | None = None) -> Any:
        """Draw positions, speeds, torques and energy; needs matplotlib. See `plot`."""
        from kane_dynamics.plot import plot_trajectory
        return plot_trajectory(self, path)


class LimitWatch:
    """Finds the steps at which a joint passes a limit that it kept before."""

    def __init__(self, joint_names: Sequence[str], limits: JointLimits, state: Array) -> None:
        """Begin at a state (2 n,): what is beyond a limit there is an event at time 0."""
        self.events: list[LimitEvent] = []
        self._names, n = joint_names, len(joint_names)
        self._bounds = {
            'lower': (slice(0, n), limits.lower, -1.0),
            'upper': (slice(0, n), limits.upper, 1.0),
            'velocity': (slice(n, 2 * n), limits.velocity, 0.0)}
        self._beyond = {name: np.zeros(n, dtype=bool) for name in self._bounds}
        self.look(state[None], np.zeros(1))

    def look(self, states: Array, t: Array) -> None:
        """Add the crossings among further states (K, 2 n) at times t (K,)."""
        found = []
        for name, (part, bound, sign) in self._bounds.items():
            x = states[:, part]
            beyond = (np.abs(x) if sign == 0.0 else sign * x) > (bound if sign == 0.0
                                                                 else sign * bound)
            before = np.concatenate([self._beyond[name][None], beyond[:-1]])
            found += [LimitEvent(float(t[k]), self._names[j], name, float(x[k, j]),
                                 float(bound[j])) for k, j in np.argwhere(beyond & ~before)]
            self._beyond[name] = beyond[-1]
        self.events += sorted(found, key=lambda event: event.t)


def _columns(joint_names: Sequence[str]) -> list[str]:
    return [f'{what}.{joint}' for what in ('q', 'u', 'udot', 'tau') for joint in joint_names]
