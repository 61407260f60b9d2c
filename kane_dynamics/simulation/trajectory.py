"""`Trajectory`: the result of a simulation."""

from __future__ import annotations

from collections.abc import Sequence
import csv
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import partial
import os
from typing import Any, NamedTuple

from kane_dynamics._util.checks import increasing
from kane_dynamics._util.notebook import html_table
from kane_dynamics._util.npz import npz_arrays
from kane_dynamics._util.optional_imports import extra
from kane_dynamics._util.text import short
from kane_dynamics._util.typing import Array
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
import numpy as np

Path = str | os.PathLike[str]
OF_CONSTRAINTS = ('constraint_forces', 'constraint_residual',
                  'constraint_velocity_residual')
ARRAYS = ('t', 'q', 'u', 'udot', 'tau', 'energy', 'stop_forces', *OF_CONSTRAINTS, 'sticking',
          'bristles', 'contact_forces', 'contact_points', 'contact_modes')
NOT_IN_CSV = 'sticking', 'bristles', 'contact_forces', 'contact_points', 'contact_modes'
NAMES = ('joint_names', 'speed_names', 'constraint_names', 'coordinate_names',
         'bristle_names', 'contact_names')


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
        quantity = 'speed' if self.limit == 'velocity' else 'position'
        which = '' if self.state is None else f'simulation {self.state}: '
        return (f"{which}at {self.t:.4g} s joint '{self.joint}' passes its {self.limit} "
                f'limit: {quantity} {self.value:.4g}, limit {self.bound:.4g}')


class StopEvent(NamedTuple):
    """
    The impact of a joint on one of its stops, in a simulation with stops.

    The speed is that into the stop; the loss is the energy lost in all stops at that
    time, J.
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
        return (f"{which}at {self.t:.4g} s joint '{self.joint}' hits its {self.limit} "
                f'stop: speed {self.speed:.4g}, {self.loss:.3g} J lost')


class ContactMode(IntEnum):
    """Motion of a contact: apart, without slip, or with slip."""

    OPEN = 0
    STICKING = 1
    SLIDING = 2


class ContactEvent(NamedTuple):
    """
    The impact of a contact.

    `speed` is that at which the bodies approached, m/s; `impulse` that along the normal,
    N s; `loss` the energy lost in all impacts at that time, J. `rests` says that the
    contact has restitution, but its next bounce would be too short to follow.
    """

    t: float
    contact: str
    speed: float
    impulse: float
    loss: float
    rests: bool = False
    state: int | None = None  # which of many simulations

    def __str__(self) -> str:
        """Return the event as text."""
        which = '' if self.state is None else f'simulation {self.state}: '
        end = '; its bounces end' if self.rests else ''
        return (f"{which}at {self.t:.4g} s contact '{self.contact}' hits: speed "
                f'{self.speed:.4g} m/s, impulse {self.impulse:.4g} N s, {self.loss:.3g} J '
                f'lost{end}')


EVENTS: dict[str, Any] = {'limit_events': LimitEvent, 'stop_events': StopEvent,
                          'contact_events': ContactEvent}


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
        Kinetic and potential energy, J; the latter with that of bristles.
    joint_names : tuple of str
    limit_events : sequence of LimitEvent
        Checked at every step, not only at the samples. Without `stops` the simulation
        continues past a limit. Speed limits are checked for robots in joint rates.
    speed_names, constraint_names : tuple of str
        Of the entries of u, udot and tau, and of the rows of the constraints.
    constraint_forces : (K, m) or (N, K, m) array
        Forces of the constraints under the torques and the forces of the stops, N or N
        m; without stops as `Robot.constraint_forces`.
    constraint_residual, constraint_velocity_residual : (K, m) or (N, K, m) arrays
        Residuals of positions, m or rad, and of velocities, m/s or rad/s; as the methods
        of `Robot` of these names.
    warnings : tuple of str
        Warnings of the simulation.
    stop_events : sequence of StopEvent
        Impacts on joint stops, in order of time; the contact that follows is no event.
    stop_forces : (K, n_j) or (N, K, n_j) array
        Forces of the stops on the joints of `joint_names`, N m or N: positive at lower
        stops, zero of joints that do not press against a stop. They act on udot and on
        the constraints.
    sticking : (K, n_j) or (N, K, n_j) array of bool
        Which joints friction holds, in a simulation with `sticking`; not in CSV files.
    bristles : (K, n_b) or (N, K, n_b) array
        Deflections of the bristles of joints with `presliding_stiffness`, rad or m; not
        in CSV files.
    bristle_names : tuple of str
        The joints of `bristles`.
    contact_forces : (K, c, 3) or (N, K, c, 3) array
        Forces of the contacts of `contact_names` on the links of their frames, N, in
        world axes; not in CSV files.
    contact_points : (K, c, 3) or (N, K, c, 3) array
        Where they touch, or would, m, in the world; not in CSV files.
    contact_modes : (K, c) or (N, K, c) array of int
        How they move from each sample on, as `ContactMode`; not in CSV files.
    contact_names : tuple of str
    contact_events : sequence of ContactEvent
        Impacts of contacts, in order of time.
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
    warnings: tuple[str, ...] = ()
    stop_events: Sequence[StopEvent] = ()
    coordinate_names: tuple[str, ...] = ()
    stop_forces: Array = field(default_factory=partial(np.zeros, 0))
    sticking: Any = field(default_factory=partial(np.zeros, 0, dtype=bool))
    bristles: Array = field(default_factory=partial(np.zeros, 0))
    bristle_names: tuple[str, ...] = ()
    contact_forces: Array = field(default_factory=partial(np.zeros, 0))
    contact_points: Array = field(default_factory=partial(np.zeros, 0))
    contact_modes: Any = field(default_factory=partial(np.zeros, 0, dtype=int))
    contact_names: tuple[str, ...] = ()
    contact_events: Sequence[ContactEvent] = ()

    def __post_init__(self) -> None:
        """Set the defaults of names and constraint arrays."""
        # Fields that a robot does not have are empty arrays of the right shape.
        shape = self.q.shape[:-1]
        defaults: dict[str, Any] = {}
        if not self.speed_names:
            defaults['speed_names'] = self.joint_names
        if not self.coordinate_names:
            defaults['coordinate_names'] = self.joint_names
        for name in OF_CONSTRAINTS:
            if getattr(self, name).shape[:-1] != shape:  # not given
                defaults[name] = np.zeros((*shape, 0))
        if not self.stop_forces.size:
            defaults['stop_forces'] = np.zeros((*shape, len(self.joint_names)))
        if not self.sticking.size:
            defaults['sticking'] = np.zeros((*shape, len(self.joint_names)), dtype=bool)
        if not self.bristles.size:
            defaults['bristles'] = np.zeros((*shape, len(self.bristle_names)))
        c = len(self.contact_names)
        if not self.contact_forces.size:
            defaults['contact_forces'] = np.zeros((*shape, c, 3))
            defaults['contact_points'] = np.zeros((*shape, c, 3))
            defaults['contact_modes'] = np.zeros((*shape, c), dtype=int)
        self.__dict__.update(defaults)  # of a frozen record

    def __repr__(self) -> str:
        """Return size and joints on one line."""
        motions = f'{len(self.q)} motions, ' if self.q.ndim == 3 else ''
        span = f'{self.t[0]:g} to {self.t[-1]:g} s' if len(self.t) else 'empty'
        return (f'<Trajectory: {motions}{len(self.t)} samples, {span}, of '
                f'{short(self.joint_names)}>')

    def _repr_html_(self) -> str:
        """Return the ranges of positions, speeds and torques as a table for notebooks."""
        # The range of each quantity by the name of its joint or speed, in one row.
        ranges: dict[str, dict[str, str]] = {}
        for quantity, names, values in (('q', self.coordinate_names, self.q),
                                        ('u', self.speed_names, self.u),
                                        ('tau', self.speed_names, self.tau)):
            rows = values.reshape(-1, values.shape[-1])
            for k, name in enumerate(names):
                text = ''
                if len(rows):
                    text = f'{rows[:, k].min():.4g} to {rows[:, k].max():.4g}'
                ranges.setdefault(name, {})[quantity] = text
        # Names of coordinates, speeds and torques may differ: cells then stay empty.
        table = []
        for name, texts in ranges.items():
            table.append([name, texts.get('q', ''), texts.get('u', ''),
                          texts.get('tau', '')])
        return html_table(repr(self)[1:-1], ['joint', 'q', 'u', 'tau'], table)

    @classmethod
    def along(cls, robot: Robot, t: Array, q: Array, u: Array,
              udot: Array) -> Trajectory:
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
        q = np.asarray(q)
        if q.ndim != 2:
            raise InputError(f'q: shape {q.shape}; expected (K, {robot.n_q})')
        t = increasing(t, len(q), 't')
        tau = robot.inverse_dynamics(q, u, udot, t=t)
        # Kinetic and potential energy, as columns.
        energy = np.stack([robot.kinetic_energy(q, u, t=t), robot.potential_energy(q)],
                          axis=-1)
        of_rows: dict[str, Any] = constraint_residuals(robot, q, u, t)
        return cls(t, q, u, udot, tau, energy, robot.joint_names,
                   speed_names=robot.speed_names,
                   constraint_names=robot.constraint_names,
                   constraint_forces=robot.constraint_forces(q, u, tau, t=t), **of_rows,
                   coordinate_names=robot.coordinate_names)

    @property
    def drift(self) -> float:
        """
        Return the largest constraint residual.

        Over all rows, of positions, m or rad, and of velocities, m/s or rad/s.
        """
        largest = [np.abs(self.constraint_residual).max(initial=0.0),
                   np.abs(self.constraint_velocity_residual).max(initial=0.0)]
        return float(max(largest))

    def state(self, k: int) -> Trajectory:
        """Return the motion from initial state k of N; InputError if k is out of range."""
        if self.q.ndim != 3 or not -len(self.q) <= k < len(self.q):
            count = f'{len(self.q)} motions' if self.q.ndim == 3 else 'a single motion'
            raise InputError(f'state: {k}, of {count}; expected the number of a motion, '
                             'from 0')
        number = k % len(self.q)

        # Events name their simulation; those of one motion need not.
        def of_state(events: Any) -> tuple[Any, ...]:
            return tuple(event._replace(state=None) for event in events if event.state == number)
        rows = {name: getattr(self, name)[k] for name in ARRAYS if name != 't'}
        return replace(self, **rows, limit_events=of_state(self.limit_events),
                       stop_events=of_state(self.stop_events),
                       contact_events=of_state(self.contact_events))

    def save_npz(self, path: Path) -> None:
        """Write all arrays and the joint names to a compressed npz file."""
        # Names and events become arrays of text and numbers: a file of plain arrays.
        arrays: dict[str, Any] = {name: getattr(self, name) for name in ARRAYS}
        for name in (*NAMES, 'warnings'):
            arrays[name] = np.array(getattr(self, name), dtype=str)
        for name in EVENTS:
            arrays[name] = _event_table(name, getattr(self, name))
        file_name = os.fspath(path)
        if not file_name.endswith('.npz'):
            file_name += '.npz'
        with whole_file(file_name, binary=True) as file:
            np.savez_compressed(file, **arrays)

    @classmethod
    def load_npz(cls, path: Path) -> Trajectory:
        """Read a file of `save_npz`; InputError for any other file."""
        file = npz_arrays(path)
        try:
            content: dict[str, Any] = {name: file[name] for name in ARRAYS}
            for name in (*NAMES, 'warnings'):
                content[name] = tuple(map(str, file[name]))
            for name in EVENTS:
                content[name] = _events(name, file[name])
            return cls(**content)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f'{os.fspath(path)}: {error}; expected a file of '
                             'save_npz') from None

    def save_csv(self, path: Path) -> None:
        """
        Write one row per sample; the header names quantity and joint, such as ``q.elbow``.

        For a single motion; of N motions, save ``trajectory.state(k)``.
        """
        self._require_single('save_csv')
        with whole_file(path) as file:
            writer = csv.writer(file)
            writer.writerow(self._columns())
            columns = [getattr(self, name) for name in ARRAYS
                       if name not in NOT_IN_CSV]
            for row in np.column_stack(columns).tolist():
                writer.writerow(map(repr, row))  # all digits

    def plot(self, path: Path | None = None) -> Any:
        """Draw a single motion's positions, speeds, torques and energy; needs matplotlib."""
        self._require_single('plot')
        return extra('kane_dynamics.plot', 'plot', 'plot').plot_trajectory(self, path)

    def require(self, robot: Robot, what: str) -> None:
        """Raise InputError unless this is one motion of a robot; `what` names the caller."""
        self._require_single(what)
        if (self.joint_names, self.speed_names) != (robot.joint_names,
                                                    robot.speed_names):
            raise InputError(f'{what}: trajectory of the joints '
                             f'{list(self.joint_names)} and speeds '
                             f'{list(self.speed_names)}; expected '
                             f'{list(robot.joint_names)} and {list(robot.speed_names)}')

    def _require_single(self, what: str) -> None:
        """Raise InputError for several motions; `what` names the caller."""
        if self.q.ndim == 3:
            raise InputError(f'{what}: trajectory of {len(self.q)} motions; expected '
                             'one, as from trajectory.state(k)')

    def _columns(self) -> list[str]:
        """Return the header of a table of all arrays."""
        columns = ['t']

        def add(quantity: str, names: Sequence[str]) -> None:
            columns.extend(f'{quantity}.{name}' for name in names)

        # The order is that of `ARRAYS`.
        add('q', self.coordinate_names)
        for quantity in ('u', 'udot', 'tau'):
            add(quantity, self.speed_names)
        columns += ['kinetic_energy', 'potential_energy']
        add('stop_force', self.joint_names)
        for quantity in ('constraint_force', 'constraint_residual',
                         'constraint_velocity_residual'):
            add(quantity, self.constraint_names)
        return columns


def _event_table(name: str, events: Sequence[Any]) -> Array:
    """Return events as text, one row each, for a file."""
    rows = []
    for event in events:
        *fields, state = event
        # Tuples of names are joined by line breaks, which no name contains.
        cells = ['\n'.join(x) if isinstance(x, tuple) else x for x in fields]
        rows.append([*cells, '' if state is None else state])
    return np.array(rows, dtype=str).reshape(-1, len(EVENTS[name]._fields))


def _events(name: str, table: Any) -> tuple[Any, ...]:
    """Return the events of a table of `_event_table`."""
    kind = EVENTS[name]
    events = []
    # The columns are those of the event's fields; the state is last and may be empty.
    for *cells, state in table:
        fields: list[Any] = []
        # Each field has the type of the event's record.
        for field_name, cell in zip(kind._fields, cells):
            if field_name in ('joint', 'limit', 'contact'):
                fields.append(str(cell))
            elif field_name == 'rests':
                fields.append(cell == 'True')
            else:
                fields.append(float(cell))
        events.append(kind(*fields, int(state) if state else None))
    return tuple(events)


def constraint_residuals(robot: Robot, q: Array, u: Array,
                         times: Array) -> dict[str, Array]:
    """Return the residuals of the constraints along a motion, (K, m) arrays."""
    kernel = robot.kernels.kernel
    time = robot.equations.time_inputs(times)
    residual = kernel('constraint_residual')(q, *time)
    of_velocities = kernel('constraint_velocity_residual')(q, u, *time)
    return {'constraint_residual': residual, 'constraint_velocity_residual': of_velocities}
