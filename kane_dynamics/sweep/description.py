"""`Sweep`: what is simulated, which settles every row of its table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
import hashlib
import json
import math
from typing import Any

from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.resources import package_version
from kane_dynamics._util.typing import Array
from kane_dynamics.control.controller import Mode
from kane_dynamics.errors import InputError
from kane_dynamics.model.model import Model
from kane_dynamics.motion.motion import Motion
from kane_dynamics.simulation.step_kernels import INTEGRATORS
from kane_dynamics.sweep.trial import CONTROLLERS, NONE
from kane_dynamics.sweep.variation import number_of, SHORT, Value, value_of, values_of
import numpy as np

MOST_SAMPLES = 10**9
MOST_CHUNK = 100_000  # trials that are in memory at once
MOST_STEPS = 100_000_000
PAYLOAD_KEYS = ('frame', 'mass', 'com', 'gyration')
CONTROLLER_KEYS = ('kind', 'kp', 'kd', 'known_payload')


@dataclass(frozen=True, eq=False)
class Sweep:
    """
    Many simulations of one robot, each with values of its own.

    Trial i is settled by `seed` and i alone: it draws from
    ``numpy.random.SeedSequence(seed, spawn_key=(i,))``. `variation` says how values are given.

    Parameters
    ----------
    model : Model
    samples : int
        Number of trials.
    seed : int
        Not negative, below 2^63.
    duration, step : float
        s; the duration is a whole number of steps.
    q0, u0 : value of every joint
        State at the start, rad or m, and s. Default: the motion's beginning, else zeros.
    payload : mapping, optional
        `frame`, in whose axes it is given; `mass`, kg; `com`, three values, m; `gyration`, the
        radius of gyration about its mass centre, m: its inertia is m k^2 about every axis.
    friction : value of every joint
        Factor on the damping and friction of the plant; the controller's model has factor 1.
    controller : str or mapping
        `kind`: computed_torque, gravity_compensation or none; `kp`, 1/s^2, and `kd`, 1/s, values
        of every joint (100 and 20); `known_payload`, the share of the payload that the
        controller takes into account (0).
    motion : Motion, optional
        The desired motion. Default: to stay at q0.
    chunk : int
        Trials that are computed and written together; no number depends on it.
    integrator : {'rk4', 'implicit'}
        As in `simulate`.

    Raises
    ------
    InputError
        Names the entry, what was given and what is valid.

    """

    model: Model
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
    integrator: str = 'rk4'
    payload_frame: str | None = field(init=False, default=None)
    values: tuple[Value, ...] = field(init=False, default=())

    def __post_init__(self) -> None:
        """Check everything and name the values, in the order in which they are drawn."""
        for name, least, most in (('samples', 1, MOST_SAMPLES), ('seed', 0, 2**63 - 1),
                                  ('chunk', 1, MOST_CHUNK)):
            freeze(self, name, _whole(name, getattr(self, name), least, most))
        for name in ('duration', 'step'):
            freeze(self, name, number_of(name, getattr(self, name)))
            if not getattr(self, name) > 0.0:
                raise InputError(f'{name} is 0 s; expected a positive time')
        count = self.duration / self.step
        if not 1 <= round(count) <= MOST_STEPS or abs(count - round(count)) > 1e-6 * count:
            raise InputError(f'duration is {self.duration} s, {count:.6g} steps of {self.step} s; '
                             f'expected a whole number of steps, at most {MOST_STEPS}')
        if self.integrator not in INTEGRATORS:
            raise InputError(f'integrator is {self.integrator!r}; valid: {", ".join(INTEGRATORS)}')
        if self.motion is not None and self.motion.joint_names != self.model.joint_names:
            raise InputError(f'the motion is of the joints {list(self.motion.joint_names)}; '
                             f'expected {list(self.model.joint_names)}')
        freeze(self, 'values', self._values())

    def __getstate__(self) -> dict[str, Any]:
        """Pickle what was given: workers tell their own version, and tables are long."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    @property
    def steps(self) -> int:
        """Return the number of steps of a trial."""
        return round(self.duration / self.step)

    @property
    def chunks(self) -> int:
        """Return the number of chunks."""
        return -(-self.samples // self.chunk)

    def rows(self, chunk: int) -> range:
        """Return the numbers of a chunk's trials."""
        return range(self.samples)[chunk * self.chunk:(chunk + 1) * self.chunk]

    @cached_property
    def desired(self) -> Array | None:
        """Return q, u, udot of the motion at every half step, (2 steps + 1, 3 n); None at rest."""
        if self.motion is None:
            return None
        halves: Array = np.arange(2 * self.steps + 1) * np.float64(0.5 * self.step)
        return np.concatenate(self.motion.sample(halves), axis=1)

    @cached_property
    def description(self) -> dict[str, Any]:
        """Return as plain data what the table depends on."""
        desired = self.desired
        return {
            'version': package_version(), 'model': self.model.digest(), 'samples': self.samples,
            'seed': self.seed, 'duration': self.duration, 'step': self.step,
            'integrator': self.integrator,
            'payload_frame': self.payload_frame, 'chunk': self.chunk,
            'motion': None if desired is None else hashlib.sha256(desired.tobytes()).hexdigest(),
            'values': {value.name: [value.kind, *value.numbers] for value in self.values}}

    @property
    def digest(self) -> str:
        """Return a hash of the description."""
        return hashlib.sha256(json.dumps(self.description).encode()).hexdigest()

    def _values(self) -> tuple[Value, ...]:
        """Return everything that may differ from trial to trial."""
        joints, n = self.model.joint_names, self.model.n
        payload, controller = self.payload, self.controller
        q0, u0 = [0.0] * n, [0.0] * n
        if self.motion is not None:
            q0, u0 = (x.tolist() for x in self.motion.sample(0.0)[:2])
        if not isinstance(controller, Mapping):
            controller = {'kind': controller}
        elif not set(controller) & set(CONTROLLER_KEYS):
            controller = {'kind': controller}  # {choice: [...]}
        controller = _entries('controller', controller, CONTROLLER_KEYS)
        kind = value_of('controller', controller.get('kind', NONE), names=CONTROLLERS)
        kinds = {CONTROLLERS[int(place)] for place in kind.numbers}
        found = [*values_of('q0', self.q0, joints, q0, signed=True),
                 *values_of('u0', self.u0, joints, u0, signed=True),
                 *(() if payload is None else self._payload(payload)),
                 *values_of('friction', self.friction, joints, [1.0] * n), kind]
        used = {'kind'}
        if Mode.COMPUTED_TORQUE in kinds:
            used |= {'kp', 'kd'}
            for name, usual in (('kp', 100.0), ('kd', 20.0)):
                found += values_of(name, controller.get(name, usual), joints, [usual] * n)
        if payload is not None and kinds != {NONE}:
            used |= {'known_payload'}
            found.append(value_of('known_payload', controller.get('known_payload', 0.0)))
        for name in controller:
            if name not in used:
                raise InputError(f'controller: {name} is given, but no trial uses it: the kind is '
                                 f'{", ".join(sorted(kinds))}, and there is '
                                 f'{"no" if payload is None else "a"} payload')
        grids = math.prod(len(value.numbers) for value in found if value.kind == 'grid')
        if self.samples % grids:
            raise InputError(f'the grids have {grids} combinations and samples is '
                             f'{self.samples}; expected a multiple of {grids}')
        return tuple(found)

    def _payload(self, payload: Any) -> list[Value]:
        """Return the values of the payload."""
        given = _entries('payload', payload, PAYLOAD_KEYS)
        if 'frame' not in given or 'mass' not in given:
            raise InputError(f'payload is {SHORT.repr(payload)}; expected frame and mass, and '
                             'perhaps com and gyration')
        freeze(self, 'payload_frame', self.model.frame(given['frame']).name)
        com = given.get('com', (0.0, 0.0, 0.0))
        if not isinstance(com, Sequence) or isinstance(com, str) or len(com) != 3:
            raise InputError(f'payload.com is {SHORT.repr(com)}; expected three values, m')
        return [value_of('payload.mass', given['mass']),
                *(value_of(f'payload.com_{axis}', x, signed=True) for axis, x in zip('xyz', com)),
                value_of('payload.gyration', given.get('gyration', 0.0))]


def _entries(name: str, data: Any, valid: Sequence[str]) -> Mapping[str, Any]:
    """Return a mapping whose keys are all valid."""
    if not isinstance(data, Mapping):
        raise InputError(f'{name} is {SHORT.repr(data)}; expected a mapping of '
                         f'{", ".join(valid)}')
    for key in data:
        if key not in valid:
            raise InputError(f'{name}: unknown key {SHORT.repr(key)}; valid: {", ".join(valid)}')
    return data


def _whole(name: str, value: Any, least: int, most: int) -> int:
    """Return a whole number within bounds."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or (
            not least <= value <= most):
        raise InputError(f'{name} is {SHORT.repr(value)}; expected a whole number from {least} to '
                         f'{most}')
    return int(value)
