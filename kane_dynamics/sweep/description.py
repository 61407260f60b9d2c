"""Description of a sweep: everything that determines the rows of its table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import hashlib
import json
import math
from typing import Any

from kane_dynamics._util.checks import integer
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.resources import package_version
from kane_dynamics._util.text import SHORT
from kane_dynamics._util.typing import Array
from kane_dynamics._util.yaml_io import mapping
from kane_dynamics.control.controller import Mode
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.integrators import integrator_of
from kane_dynamics.model.model import Model
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.torque_input import stage_times
from kane_dynamics.sweep.swept_joints import robot_digest, SweptJoints
from kane_dynamics.sweep.trial import CONTROLLERS, NONE
from kane_dynamics.sweep.variation import number_of, parse_value, parse_values, Value
import numpy as np

MOST_SAMPLES = 10**9
MOST_CHUNK = 100_000  # trials in memory at once
FIRST_CHUNK = 32  # trials
MOST_STEPS = 100_000_000
PAYLOAD_KEYS = ('frame', 'mass', 'com', 'gyration')
CONTROLLER_KEYS = ('kind', 'kp', 'kd', 'known_payload')


@dataclass(frozen=True, eq=False)
class Sweep:
    """
    Many simulations of one robot with varying values.

    Trial i depends only on `seed` and i: it draws from ``numpy.random.SeedSequence(seed,
    spawn_key=(i,))``. `variation` documents how values are given.

    Parameters
    ----------
    model : Model or Robot
        A robot has its own speeds, constraints, gravity and limits, and no payload.
    samples : int
        Number of trials.
    seed : int
        Nonnegative, below 2^63.
    duration, step : float
        s; the duration is an integer multiple of the step.
    q0, u0 : value of every coordinate, of every (independent) speed
        Initial state, rad or m, and s. Default: the start of the motion, else that of
        the robot's `configuration`, else zeros. Loops are closed from q0: the joints
        whose rates are the independent speeds keep their values, and the others move, in
        the assembly mode of q0 if its residuals are at most 0.01 rad, or lengths of the
        mechanism, else in that of `configuration`. Quaternions are divided by their
        lengths, so that normal values are uniform rotations.
    payload : mapping, optional
        `frame`, in whose axes it is given; `mass`, kg; `com`, three values, m;
        `gyration`, the radius of gyration k about its center of mass, m: its inertia is
        m k^2 about every axis.
    friction : value of every joint
        Factor on the damping and friction of the plant; the controller's model uses 1.
    controller : str or mapping
        `kind`: computed_torque, gravity_compensation or none; `kp`, 1/s^2, and `kd`,
        1/s, values of every joint (100 and 20); `known_payload`, the fraction of the
        payload in the controller's model (0).
    motion : Motion, optional
        The desired motion; with constraints, of the joints that follow it (as in
        `ComputedTorque`). Default: rest at q0.
    chunk : int
        Number of trials that are computed and written together; does not affect the
        results. The first chunk is shorter, so that a refused case and the progress are
        seen early.
    integrator : {'rk4', 'implicit'}, optional
        As in `simulate`. By default the one that `simulate` chooses at the initial state
        of the first trial.
    t0 : float
        Initial time, s, for functions of time and for the motion.

    Raises
    ------
    InputError
        If an entry is invalid; the message names it.

    """

    model: Model | Robot
    samples: int
    seed: int = 0
    duration: float = 1.0
    step: float = 1e-3
    q0: Any = None
    u0: Any = None
    payload: Mapping[str, Any] | None = None
    friction: Any = 1.0
    controller: Any = NONE
    motion: Motion | None = None
    chunk: int = 1000
    integrator: str | None = None
    t0: float = 0.0
    payload_frame: str | None = field(init=False, default=None)
    values: tuple[Value, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        """Check all entries and collect the values in the order in which they are drawn."""
        for name, least, largest in (('samples', 1, MOST_SAMPLES),
                                     ('seed', 0, 2**63 - 1),
                                     ('chunk', 1, MOST_CHUNK)):
            freeze(self, name, integer(getattr(self, name), name, least, largest))
        for name in ('duration', 'step'):
            freeze(self, name, number_of(name, getattr(self, name)))
            if not getattr(self, name) > 0.0:
                raise InputError(f'{name}: 0 s; expected a positive time')
        # The steps fill the duration exactly.
        count = self.duration / self.step
        if not 1 <= round(count) <= MOST_STEPS or abs(count - round(count)) > 1e-6 * count:
            raise InputError(f'duration: {self.duration} s, {count:.6g} steps of '
                             f'{self.step} s; expected a whole number of steps, at most '
                             f'{MOST_STEPS}')
        if self.integrator is not None:
            # Methods are named as in `simulate`.
            integrator_of(self.integrator)
        freeze(self, 't0', number_of('t0', self.t0, signed=True))
        if not isinstance(self.model, Model | Robot):
            raise InputError(f'model: a {type(self.model).__name__}; expected a Model '
                             'or a Robot')
        if self.robot.parameters.payload is not None:
            raise InputError('model: a robot that carries a payload; expected one '
                             'without, and the payload of the sweep')
        self.joints.check_motion(self.motion)
        # Values that vary are collected last, when all else is valid.
        freeze(self, 'values', self._values())

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the given entries only; derived tables are large and versions differ."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    @lazy_property
    def robot(self) -> Robot:
        """Return the robot, with its speeds and constraints."""
        return self.model if isinstance(self.model, Robot) else Robot(self.model)

    @lazy_property
    def joints(self) -> SweptJoints:
        """Return the names of the values of a trial."""
        return SweptJoints(self.robot, self.motion)

    @property
    def steps(self) -> int:
        """Return the number of steps of a trial."""
        return round(self.duration / self.step)

    @property
    def chunks(self) -> int:
        """Return the number of chunks."""
        later = max(0, self.samples - self._first)
        return 1 + -(-later // self.chunk)

    @property
    def _first(self) -> int:
        """Return the largest number of trials in the first chunk."""
        return min(self.chunk, FIRST_CHUNK)

    def rows(self, chunk: int) -> range:
        """Return the indices of a chunk's trials."""
        end = self._first + chunk * self.chunk
        begin = max(0, end - self.chunk)
        return range(self.samples)[begin:end]

    @lazy_property
    def desired(self) -> Array | None:
        """Return the desired q, u, udot in each step, (steps, 3, 3 m); None at rest."""
        if self.motion is None:
            return None
        begins = self.t0 + np.arange(self.steps) * np.float64(self.step)
        times = stage_times(begins, self.step)
        columns = self.joints.columns(self.motion)
        parts = [x[:, columns] for x in self.motion.sample(times.ravel())]
        rows = np.concatenate(parts, axis=1)
        return np.ascontiguousarray(rows.reshape(*times.shape, rows.shape[1]))

    @lazy_property
    def description(self) -> dict[str, Any]:
        """Return everything that the table depends on as plain data."""
        motion = None
        if self.desired is not None:
            motion = hashlib.sha256(self.desired.tobytes()).hexdigest()
        values = {value.name: [value.kind, *value.numbers] for value in self.values}
        return {
            'version': package_version(), 'model': robot_digest(self.robot),
            'samples': self.samples, 'seed': self.seed, 'duration': self.duration,
            'step': self.step, 'integrator': self.integrator, 't0': self.t0,
            'payload_frame': self.payload_frame, 'chunk': self.chunk,
            'motion': motion, 'values': values}

    @property
    def digest(self) -> str:
        """Return a hash of the description."""
        return hashlib.sha256(json.dumps(self.description).encode()).hexdigest()

    def _values(self) -> tuple[Value, ...]:
        """Return all values that may vary between trials."""
        joints, payload, robot = self.joints, self.payload, self.robot
        q0, u0 = joints.start(self.motion, self.t0)
        controller = self.controller
        # A mapping without one of the keys is a choice of controllers, {choice: [...]}.
        has_keys = isinstance(controller, Mapping) and set(controller) & set(CONTROLLER_KEYS)
        if not has_keys:
            controller = {'kind': controller}
        controller = mapping(controller, 'controller', CONTROLLER_KEYS, InputError)
        kind = parse_value('controller', controller.get('kind', NONE), names=CONTROLLERS)
        kinds = {CONTROLLERS[int(place)] for place in kind.numbers}
        # Values in the order in which they are drawn: a new one at the end leaves the
        # others as they were.
        values = [*parse_values('q0', self.q0, robot.coordinate_names, q0, signed=True),
                  *parse_values('u0', self.u0, robot.speed_names, u0, signed=True)]
        if payload is not None:
            values += self._payload(payload)
        values += parse_values('friction', self.friction, robot.joint_names,
                               [1.0] * robot.model.n)
        values.append(kind)
        # Keys that no chosen controller uses are refused.
        used = {'kind'}
        if Mode.COMPUTED_TORQUE in kinds:
            used |= {'kp', 'kd'}
            followed = joints.followed_names
            for name, usual in (('kp', 100.0), ('kd', 20.0)):
                values += parse_values(name, controller.get(name, usual), followed,
                                       [usual] * len(followed))
        if payload is not None and kinds != {NONE}:
            used |= {'known_payload'}
            values.append(parse_value('known_payload',
                                      controller.get('known_payload', 0.0)))
        for name in controller:
            if name not in used:
                carries = 'without' if payload is None else 'with'
                raise InputError(f'controller: {name}, which {", ".join(sorted(kinds))} '
                                 f'{carries} a payload does not use; expected no such '
                                 'key')
        if self.motion is not None and kinds == {NONE}:
            raise InputError('motion: given without a controller; expected both, or q0 and '
                             'u0 as the start of arms that move freely')
        # Every combination of the grids has as many samples.
        grids = math.prod(len(value.numbers) for value in values if value.kind == 'grid')
        if self.samples % grids:
            raise InputError(f'samples: {self.samples} for {grids} combinations of the '
                             f'grids; expected a multiple of {grids}')
        return tuple(values)

    def _payload(self, payload: Any) -> list[Value]:
        """Return the varying values of the payload."""
        entries = mapping(payload, 'payload', PAYLOAD_KEYS, InputError)
        if 'frame' not in entries or 'mass' not in entries:
            raise InputError(f'payload: {SHORT.repr(payload)}; expected frame and mass, '
                             'and optionally com and gyration')
        freeze(self, 'payload_frame', self.robot.model.frame(entries['frame']).name)
        com = entries.get('com', (0.0, 0.0, 0.0))
        if not isinstance(com, Sequence) or isinstance(com, str) or len(com) != 3:
            raise InputError(f'payload.com: {SHORT.repr(com)}; expected three values, m')
        # In the order of the columns: mass, center of mass, radius of gyration.
        values = [parse_value('payload.mass', entries['mass'])]
        for axis, x in zip('xyz', com):
            values.append(parse_value(f'payload.com_{axis}', x, signed=True))
        values.append(parse_value('payload.gyration', entries.get('gyration', 0.0)))
        return values
