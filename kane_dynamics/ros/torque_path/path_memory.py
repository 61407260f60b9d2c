"""The memory of a torque path, and the compiled rules of a cycle in the interpreter."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from inspect import signature
import struct
from typing import Any

from kane_dynamics._util.typing import Vector
from kane_dynamics.control_cycle import cycle_rules
from kane_dynamics.control_cycle.arbitration import FIELDS
from kane_dynamics.control_cycle.cycle_rules import (CycleSettings, Event, EVENT_SIZE,
                                                     GivenStop, path_size, PathShape,
                                                     PathState, SCALARS, settings_size,
                                                     torques_within_limits,
                                                     unpacked_path, unpacked_settings)
from kane_dynamics.control_cycle.state_judgement import CONFIRMED, StateMemory
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.flags import packed
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.threads import run_concurrently
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.torque_path.state_check import turning_joints
import numpy as np

ARRAYS = ('path', 'event', 'state', 'row', 'numbers', 'torque', 'settings', 'begin')
EVENT = struct.Struct(f'{EVENT_SIZE}d')
(REASON, PUBLISH, SENT_AT, REQUEST, PERIOD, COMMANDED_AT, LAST_HEARD, LAST_STAMP, REFUSING, FAULT,
 TIMED_OUT, COMMANDING, DROPS, STOP_BEGAN, STOPS, LAW_KNOWN, LOOKED_AT,
 LAST_LOOK) = map(
     PathState._fields.index, (
         'reason', 'publish', 'sent_at', 'request', 'period', 'commanded_at', 'last_heard',
         'last_stamp', 'refusing', 'fault', 'timed_out', 'commanding', 'drops',
         'stop_began', 'stops', 'law_known', 'looked_at',
         'last_look'))


def inputs_of(rule: Callable[..., PathState]) -> list[str]:
    """Return the names of the arrays that a rule reads: those of its arguments."""
    return [name for name in signature(rule).parameters if name in ARRAYS]


def rule_kernel(robot: Robot, shape: PathShape, name: str, rule: Callable[..., PathState],
                label: str) -> Kernel:
    """
    Return the kernel of a rule; it compiles at its first use.

    It reads the arrays that the arguments of the rule name; its result is a path as an
    array. `label` distinguishes it from others of this name and robot.
    """
    shapes = {'path': (path_size(shape),), 'event': (EVENT_SIZE,), 'state': (shape.state,),
              'row': (6, 3 * shape.n), 'numbers': (FIELDS + shape.commanded,),
              'torque': (shape.commanded,), 'settings': (settings_size(shape),),
              'begin': (2 * shape.n,)}
    arguments = signature(rule).parameters
    inputs = inputs_of(rule)

    def compiled(*arrays: Vector, parameters: Vector, limits: Vector) -> Vector:
        # Arrays become records, with which the rules are written.
        named: dict[str, Any] = dict(zip(inputs, arrays, strict=True))
        named['path'] = unpacked_path(named['path'], shape)
        if 'settings' in named:
            named['settings'] = unpacked_settings(named['settings'], shape)
        if 'event' in named:
            named['event'] = Event(*named['event'])
        named |= {'parameters': parameters, 'limits': limits}
        return packed(rule(**{key: named[key] for key in arguments if key in named}))
    return robot.kernels.compiled(compiled, f'{name.lower()}_{label}',
                                  {key: shapes[key] for key in inputs}, shapes['path'],
                                  ahead=False)


class PathMemory:
    """
    A `PathState` as an array, of which single numbers are read fast.

    Parameters
    ----------
    shape : PathShape

    Attributes
    ----------
    array : (k,) array
    entries : memoryview
        Of the array.
    tau, limited, accepted, trusted, wrong, arbitration : arrays
        The last torques; flags of joints that were clamped or limited in their rate; the
        last accepted state; the speeds that laws use, and flags of joints whose measured
        ones contradict their positions; an `Arbitration`: views of the array.

    """

    def __init__(self, shape: PathShape) -> None:
        self.shape = shape
        self.array = np.zeros(path_size(shape))
        # Views are read and copied several times as fast as the array.
        self.entries = memoryview(self.array)
        parts = unpacked_path(self.array, shape)
        self._parts = parts[SCALARS:]
        ends = SCALARS + np.cumsum([len(part) for part in self._parts])
        self._slices = [slice(end - len(part), end) for part, end in zip(self._parts, ends)]
        self.tau: Array = parts.tau
        self.limited: tuple[Array, Array] = (parts.clamped, parts.rate_limited)
        self.accepted: Array = parts.states.accepted
        self.trusted: Array = parts.states.trusted
        self.wrong: Array = parts.states.wrong
        self.arbitration: Array = parts.arbitration
        self._check: Array = parts.check
        self._confirmed = memoryview(self._check[CONFIRMED:])

    @property
    def path(self) -> PathState:
        """Return the state as a record of floats and arrays, which does not change."""
        return self.record(self.array.copy())

    @path.setter
    def path(self, path: PathState) -> None:
        self.array[:SCALARS] = path[:SCALARS]
        for part, numbers in zip(self._parts, path[SCALARS:]):
            part[:] = numbers

    def record(self, numbers: Array) -> PathState:
        """Return numbers of a path as a record; its arrays are views."""
        return PathState(*numbers[:SCALARS].tolist(),
                         *[numbers[place] for place in self._slices])

    @property
    def states(self) -> StateMemory:
        """Return the record with which states are compared; its arrays are views."""
        return StateMemory.of(self._check)

    @property
    def known(self) -> bool:
        """Return whether there is an accepted state."""
        return bool(self._confirmed[0])


def _refused(path: PathState, event: Event, settings: CycleSettings, begin: Vector
             ) -> PathState:
    """Return the path after a refused state; a stop begins where it is given."""
    return cycle_rules.refuse(GivenStop(begin), path, event, settings, np.zeros(0))


class CycleRules:
    """
    The rules of a path that the interpreter calls: in every cycle, compiled.

    Each computes the next state of the path, which `keep` makes the present one.

    Parameters
    ----------
    robot : Robot
    memory : PathMemory
    joints : sequence of n str
        The joints that are measured.
    state : (2 n,) array
        The measured state, overwritten by the caller.

    Attributes
    ----------
    next : PathMemory
        The next state.
    settings : CycleSettings

    """

    def __init__(self, robot: Robot, memory: PathMemory, joints: Sequence[str],
                 state: Array) -> None:
        shape = memory.shape
        self._robot = robot
        self.memory = memory
        # The arrays that the rules read and write, by the names of their arguments.
        self.next = PathMemory(shape)
        self.settings: CycleSettings
        self._numbers = np.zeros(settings_size(shape))
        self._state = state
        self._event = np.zeros(EVENT_SIZE)
        self._torque = np.zeros(shape.commanded)
        self._begin = np.zeros(2 * shape.n)
        self._arrays = {'path': memory.array, 'event': self._event, 'state': state,
                        'settings': self._numbers, 'torque': self._torque,
                        'begin': self._begin}
        self._to = memory.entries
        self._from = self.next.entries
        self._turning = turning_joints(robot, joints)
        self._judge, self._answer, self._refuse, self._stop = self.bound({
            'JUDGE': partial(cycle_rules.judge, turning=self._turning),
            'ANSWERED': cycle_rules.answered, 'REFUSED': _refused,
            'STOP': torques_within_limits})

    def bound(self, rules: Mapping[str, Callable[..., PathState]]
              ) -> list[Callable[[], object]]:
        """Compile rules; return calls that read the memory and write the next state."""
        shape = self.memory.shape
        label = '_'.join(map(str, (*shape, *self._turning.astype(int))))
        kernels = []
        for name, rule in rules.items():
            kernels.append(rule_kernel(self._robot, shape, name, rule, label))
        run_concurrently([kernel.compile for kernel in kernels])
        calls = []
        for kernel, (name, rule) in zip(kernels, rules.items()):
            inputs = [self._arrays[key] for key in inputs_of(rule)]
            calls.append(kernel.bind(inputs, self.next.array, f'Rule {name}.'))
        return calls

    def begin(self, now: int, stamp: int, ticking: bool, steady: float) -> None:
        """Begin a cycle: times since the epoch, ns; steady time, s."""
        EVENT.pack_into(self._event, 0, now, stamp, 0.0, 0.0, ticking, steady * NANO)

    @property
    def event(self) -> Event:
        """Return the times of the cycle."""
        return Event(*self._event.tolist())

    def use(self, settings: CycleSettings) -> None:
        """Use settings from now on."""
        self.settings = settings
        self._numbers[:] = packed(settings)

    def judge(self, is_finite: bool) -> int:
        """Judge the state by `cycle_rules.judge`; return the reason to refuse it."""
        if is_finite:
            state = self._state
            if np.isnan(state).any():  # kernels accept finite numbers only
                with np.errstate(invalid='ignore', over='ignore'):  # the kernel judges these
                    state[:] = cycle_rules.with_speeds(self.memory.path, self.event, state,
                                                       self.settings, self._turning)
            try:
                self._judge()
            except InputError:
                is_finite = False
        if not is_finite:
            state = np.full(len(self._state), np.nan)
            self.next.path = cycle_rules.judge(self.memory.path, self.event, state,
                                               self.settings, self._turning)
        return int(self._from[REASON])

    def answer(self, torque: Array) -> None:
        """Command a torque of the commanded joints; InputError if it is not finite."""
        self._torque[:] = torque
        self._answer()

    def refuse(self, reason: int, begin: Array | None = None) -> None:
        """
        Refuse the state by `cycle_rules.refuse`, for a reason.

        Parameters
        ----------
        reason : int
            A result of a cycle.
        begin : (2 n,) array, optional
            Where a stop begins now, positions and rates of the measured joints. Without
            it the arm is taken to rest at its last accepted state.

        """
        self._to[REASON] = reason
        rest = self.memory.accepted.copy()
        rest[len(rest) // 2:] = 0.0
        self._begin[:] = rest if begin is None else begin
        self._refuse()

    def stop(self, torque: Array) -> None:
        """Command a torque of a stop; InputError if it is not finite."""
        self._torque[:] = torque
        self._stop()

    def keep(self) -> None:
        """Make the next state the present one."""
        self._to[:] = self._from
