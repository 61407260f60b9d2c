"""`Trajectory`: the result of a simulation."""

from __future__ import annotations

from collections.abc import Sequence
import csv
from dataclasses import dataclass, field, replace
from functools import partial
import os
from typing import Any, NamedTuple

from kane_dynamics._util.attribute_hints import fixed
from kane_dynamics._util.checks import increasing
from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.notebook import html_table
from kane_dynamics._util.npz import npz_arrays
from kane_dynamics._util.optional_imports import extra
from kane_dynamics._util.text import short
from kane_dynamics._util.typing import Array
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.user_speeds import constraint_rows
import numpy as np

Path = str | os.PathLike[str]
OF_CONSTRAINTS = ('constraint_forces', 'constraint_residual', 'constraint_velocity_residual')
ARRAYS = ('t', 'q', 'u', 'udot', 'tau', 'energy', 'stop_forces', *OF_CONSTRAINTS)
FORMER = {'constraint_residual': 'constraint_gap'}  # names of arrays in older files
NAMES = ('joint_names', 'speed_names', 'constraint_names', 'coordinate_names')


class LimitEvent(NamedTuple):
    """A joint's crossing of one of its limits."""

    t: float
    joint: str
    limit: str  # 'lower', 'upper' or 'velocity'
    value: float
    bound: float
    state: int | None = None  # which of many simulations

    def __str__(self) -> str:
        """Return the event as text."""
        what = 'speed' if self.limit == 'velocity' else 'position'
        which = '' if self.state is None else f'simulation {self.state}: '
        return (f"{which}at {self.t:.4g} s joint '{self.joint}' passes its {self.limit} limit: "
                f'{what} {self.value:.4g}, limit {self.bound:.4g}')


class StopEvent(NamedTuple):
    """
    The impact of a joint on one of its stops, in a simulation with stops.

    The speed is that into the stop; the loss is the energy lost in all stops at that time, J.
    """

    t: float
    joint: str
    limit: str  # 'lower' or 'upper'
    speed: float
    loss: float
    state: int | None = None  # which of many simulations

    def __str__(self) -> str:
        """Return the event as text."""
        which = '' if self.state is None else f'simulation {self.state}: '
        return (f"{which}at {self.t:.4g} s joint '{self.joint}' hits its {self.limit} stop: speed "
                f'{self.speed:.4g}, {self.loss:.3g} J lost')


class SpeedChange(NamedTuple):
    """
    A change of the independent speeds of a simulation before a singularity.

    The trajectory's u, udot and tau stay those of its own `speed_names`.
    """

    t: float
    before: tuple[str, ...]
    after: tuple[str, ...]
    state: int | None = None  # which of many simulations

    def __str__(self) -> str:
        """Return the event as text."""
        which = '' if self.state is None else f'simulation {self.state}: '
        return (f'{which}at {self.t:.4g} s the independent speeds {", ".join(self.before)} change '
                f'to {", ".join(self.after)}')


@fixed
@dataclass(frozen=True, eq=False)
class Trajectory:
    """
    A sampled simulated motion, or N motions of one robot at the same times.

    Attributes
    ----------
    t : (K,) array
        s.
    q, u, udot : (K, n) or (N, K, n) arrays
        rad or m, and s.
    tau : (K, n) or (N, K, n) array
        Torques of the actuators, N m or N; where speeds are chosen, dual to them.
    energy : (K, 2) or (N, K, 2) array
        Kinetic and potential energy, J.
    joint_names : tuple of str
    limit_events : sequence of LimitEvent
        Checked at every step, not only at the samples. Without `stops` the simulation continues
        past a limit. Speed limits are checked for robots in joint rates.
    speed_names, constraint_names : tuple of str
        Of the entries of u, udot and tau, and of the rows of the constraints.
    constraint_forces : (K, m) or (N, K, m) array
        Forces of the constraints under the torques and the forces of the stops, N or N m; without
        stops as `Robot.constraint_forces`.
    constraint_residual, constraint_velocity_residual : (K, m) or (N, K, m) arrays
        Residuals of positions, m or rad, and of velocities, m/s or rad/s; as the methods of
        `Robot` of these names.
    speed_changes : sequence of SpeedChange
        Changes of the independent speeds.
    warnings : tuple of str
        Warnings of the simulation.
    stop_events : sequence of StopEvent
        Impacts on joint stops, in order of time; the contact that follows is no event.
    stop_forces : (K, n_j) or (N, K, n_j) array
        Forces of the stops on the joints of `joint_names`, N m or N: positive at lower stops, zero
        of joints that do not press against a stop. They act on udot and on the constraints.
    coordinate_names : tuple of str
        Of the entries of q: `joint_names`, but four for the quaternion of a ball joint.

    """

    t: Array
    q: Array
    u: Array
    udot: Array
    tau: Array
    energy: Array
    joint_names: tuple[str, ...]
    limit_events: Sequence[LimitEvent] = ()
    speed_names: tuple[str, ...] = ()
    constraint_names: tuple[str, ...] = ()
    constraint_forces: Array = field(default_factory=partial(np.zeros, 0))
    constraint_residual: Array = field(default_factory=partial(np.zeros, 0))
    constraint_velocity_residual: Array = field(default_factory=partial(np.zeros, 0))
    speed_changes: Sequence[SpeedChange] = ()
    warnings: tuple[str, ...] = ()
    stop_events: Sequence[StopEvent] = ()
    coordinate_names: tuple[str, ...] = ()
    stop_forces: Array = field(default_factory=partial(np.zeros, 0))

    def __post_init__(self) -> None:
        """Set the defaults of names and constraint arrays."""
        if not self.speed_names:
            freeze(self, 'speed_names', self.joint_names)
        if not self.coordinate_names:
            freeze(self, 'coordinate_names', self.joint_names)
        if not self.constraint_names:
            for name in OF_CONSTRAINTS:
                freeze(self, name, np.zeros((*self.q.shape[:-1], 0)))
        if not self.stop_forces.size:
            freeze(self, 'stop_forces', np.zeros((*self.q.shape[:-1], len(self.joint_names))))

    def __repr__(self) -> str:
        """Return size and joints on one line."""
        many = f'{len(self.q)} motions, ' if self.q.ndim == 3 else ''
        span = f'{self.t[0]:g} to {self.t[-1]:g} s' if len(self.t) else 'empty'
        return (f'<Trajectory: {many}{len(self.t)} samples, {span}, of '
                f'{short(self.joint_names)}>')

    def _repr_html_(self) -> str:
        """Return the ranges of positions, speeds and torques as a table for notebooks."""
        names = dict.fromkeys((*self.coordinate_names, *self.speed_names))
        columns: dict[str, list[str]] = {}
        for of, values in ((self.coordinate_names, self.q), (self.speed_names, self.u),
                           (self.speed_names, self.tau)):
            flat = values.reshape(-1, values.shape[-1])
            for k, name in enumerate(of):
                columns.setdefault(name, []).append(
                    f'{flat[:, k].min():.4g} to {flat[:, k].max():.4g}' if len(flat) else '')
        rows = []
        for name in names:
            cells = columns[name]
            if name not in self.speed_names:
                cells = [*cells, '', '']
            elif name not in self.coordinate_names:
                cells = ['', *cells]
            rows.append([name, *cells])
        return html_table(repr(self)[1:-1], ['joint', 'q', 'u', 'tau'], rows)

    @classmethod
    def along(cls, robot: Robot, t: Array, q: Array, u: Array, udot: Array) -> Trajectory:
        """
        Return a given motion with its torques (inverse dynamics) and energies.

        Parameters
        ----------
        robot : Robot
            Of any kind.
        t : (K,) array
            s; increases from row to row.
        q, u, udot : (K, n_q), (K, n) arrays
            rad or m, and s; configurations that satisfy the constraints.

        Raises
        ------
        InputError
            Names the argument, what was given and what is expected.

        """
        if (q := np.asarray(q)).ndim != 2:
            raise InputError(f'q: shape {q.shape}; expected (K, {robot.n_q})')
        t = increasing(t, len(q), 't')
        tau = robot.inverse_dynamics(q, u, udot, t=t)
        energy = np.stack([robot.kinetic_energy(q, u, t=t), robot.potential_energy(q)], axis=-1)
        rows: Any = constraint_rows(robot, q, u, tau, t=t) if robot.constraint_names else {}
        return cls(t, q, u, udot, tau, energy, robot.joint_names, speed_names=robot.speed_names,
                   constraint_names=robot.constraint_names, **rows,
                   coordinate_names=robot.coordinate_names)

    @property
    def constraint_gap(self) -> Array:
        """Return `constraint_residual`; the former name of that attribute."""
        return self.constraint_residual

    @property
    def drift(self) -> float:
        """
        Return the largest constraint residual.

        Over all rows, of positions, m or rad, and of velocities, m/s or rad/s.
        """
        return max(float(np.abs(residual).max(initial=0.0)) for residual in (
            self.constraint_residual, self.constraint_velocity_residual))

    def state(self, k: int) -> Trajectory:
        """Return the motion from initial state k of N; InputError if k is out of range."""
        if self.q.ndim != 3 or not -len(self.q) <= k < len(self.q):
            count = f'{len(self.q)} motions' if self.q.ndim == 3 else 'a single motion'
            raise InputError(f'state: {k}, of {count}; expected the number of a motion, from 0')
        events = (e._replace(state=None) for e in self.limit_events if e.state == k % len(self.q))
        changes = (c._replace(state=None) for c in self.speed_changes
                   if c.state == k % len(self.q))
        stops = (s._replace(state=None) for s in self.stop_events if s.state == k % len(self.q))
        rows = {name: getattr(self, name)[k] for name in ARRAYS if name != 't'}
        return replace(self, **rows, limit_events=tuple(events), speed_changes=tuple(changes),
                       stop_events=tuple(stops))

    def save_npz(self, path: Path) -> None:
        """Write all arrays and the joint names to a compressed npz file."""
        events = [(e.t, e.joint, e.limit, e.value, e.bound, '' if e.state is None else e.state)
                  for e in self.limit_events]
        arrays: dict[str, Any] = {
            **{name: getattr(self, name) for name in ARRAYS},
            **{name: np.array(getattr(self, name), dtype=str) for name in (*NAMES, 'warnings')}}
        changes = [(c.t, '\n'.join(c.before), '\n'.join(c.after),
                    '' if c.state is None else c.state) for c in self.speed_changes]
        stops = [(*s[:5], '' if s.state is None else s.state) for s in self.stop_events]
        name = os.fspath(path)
        with whole_file(name if name.endswith('.npz') else f'{name}.npz', binary=True) as file:
            np.savez_compressed(file, stop_events=np.array(stops, dtype=str).reshape(-1, 6),
                                limit_events=np.array(events, dtype=str).reshape(-1, 6),
                                speed_changes=np.array(changes, dtype=str).reshape(-1, 4),
                                **arrays)

    @classmethod
    def load_npz(cls, path: Path) -> Trajectory:
        """Read a file of `save_npz`; InputError for any other file."""
        file = npz_arrays(path)
        try:
            events = tuple(LimitEvent(float(t), str(joint), str(limit), float(v), float(b),
                                      int(state) if state else None)
                           for t, joint, limit, v, b, state in file['limit_events'])
            changes = tuple(SpeedChange(float(t), tuple(str(a).split('\n')),
                                        tuple(str(b).split('\n')), int(state) if state else None)
                            for t, a, b, state in file.get('speed_changes', ()))
            stops = tuple(StopEvent(float(t), str(joint), str(limit), float(v), float(loss),
                                    int(state) if state else None)
                          for t, joint, limit, v, loss, state in file.get('stop_events', ()))
            content: dict[str, Any] = {
                **{name: file[name] for name in ARRAYS
                   if name not in (*OF_CONSTRAINTS, 'stop_forces')},
                **{name: file[key] for name in OF_CONSTRAINTS
                   if (key := name if name in file else FORMER.get(name)) in file},
                **{name: tuple(map(str, file[name])) for name in NAMES[:3]},
                'coordinate_names': tuple(map(str, file.get('coordinate_names', ()))),
                'warnings': tuple(map(str, file.get('warnings', ())))}
            if 'stop_forces' in file:  # files of earlier versions have none
                content['stop_forces'] = file['stop_forces']
            content.setdefault('constraint_velocity_residual',
                               np.zeros_like(content['constraint_residual']))
            return cls(**content, limit_events=events, speed_changes=changes,
                       stop_events=stops)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f'{os.fspath(path)}: {error}; expected a file of save_npz') from None

    def save_csv(self, path: Path) -> None:
        """
        Write one row per sample; the header names quantity and joint, as ``q.elbow``.

        For a single motion; of N motions, save ``trajectory.state(k)``.
        """
        self._require_single('save_csv')
        with whole_file(path) as file:
            writer = csv.writer(file)
            writer.writerow(self._columns())
            table = np.column_stack([getattr(self, name) for name in ARRAYS])
            writer.writerows([repr(x) for x in row] for row in table.tolist())

    def plot(self, path: Path | None = None) -> Any:
        """Draw a single motion's positions, speeds, torques and energy; needs matplotlib."""
        self._require_single('plot')
        return extra('kane_dynamics.plot', 'plot', 'plot').plot_trajectory(self, path)

    def require(self, robot: Robot, what: str) -> None:
        """Raise InputError unless this is one motion of a robot; `what` names the caller."""
        self._require_single(what)
        names = (robot.joint_names, robot.speed_names)
        if (self.joint_names, self.speed_names) != names:
            raise InputError(f'{what}: trajectory of the joints {list(self.joint_names)} and '
                             f'speeds {list(self.speed_names)}; expected {list(names[0])} and '
                             f'{list(names[1])}')

    def _require_single(self, what: str) -> None:
        if self.q.ndim == 3:
            raise InputError(f'{what}: trajectory of {len(self.q)} motions; expected one, as from '
                             'trajectory.state(k)')

    def _columns(self) -> list[str]:
        of_speeds = [f'{what}.{speed}' for what in ('u', 'udot', 'tau')
                     for speed in self.speed_names]
        of_constraints = [f'{what}.{row}' for what in ('constraint_force', 'constraint_residual',
                                                       'constraint_velocity_residual')
                          for row in self.constraint_names]
        of_q = (f'q.{name}' for name in self.coordinate_names)
        of_stops = (f'stop_force.{name}' for name in self.joint_names)
        return ['t', *of_q, *of_speeds, 'kinetic_energy', 'potential_energy', *of_stops,
                *of_constraints]
