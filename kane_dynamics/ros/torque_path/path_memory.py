"""The memory of a torque path, and the compiled rules of a cycle in the interpreter."""

from collections.abc import Callable, Sequence
from functools import partial
import struct
from typing import Any

from kane_dynamics._util.typing import Vector
from kane_dynamics.control_cycle import cycle_rules
from kane_dynamics.control_cycle.arbitration import FIELDS, PERMITTED
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

# The arguments of the rules, by the name of their kernel.
INPUTS = {
    'JUDGE': ('path', 'event', 'state', 'settings'),
    'ANSWER': ('path', 'event', 'state', 'row', 'settings'),
    'ANSWERED': ('path', 'event', 'state', 'torque', 'settings'),
    'WAIT': ('path', 'event', 'state'),
    'REFUSE': ('path', 'event', 'settings'),
    'REFUSED': ('path', 'event', 'settings', 'begin'),
    'STOP': ('path', 'torque', 'settings'),
    'ELAPSE': ('path', 'event', 'settings'),
    'PERMIT': ('path', 'event', 'state'),
    'CONFIRM': ('path', 'event', 'state'),
    'HEAR': ('path', 'event', 'numbers', 'settings'),
    'CLOSE': ('path', 'event', 'state', 'settings'),
    'CLOSING': ('path', 'event', 'state', 'settings'),
    'AIM': ('path', 'event', 'state', 'row', 'settings'),
    'AIMING': ('path', 'settings'),
    'HOLD': ('path', 'settings')}
WITH_PARAMETERS = ('ANSWER', 'REFUSE', 'HOLD')  # of the robot
EVENT = struct.Struct(f'{EVENT_SIZE}d')
(REASON, PUBLISH, SENT_AT, REQUEST, COMMANDED_AT, LAST_HEARD, LAST_STAMP, REFUSING, FAULT,
 TIMED_OUT, COMMANDING, DROPS, STOP_BEGAN, STOPS, LAW_KNOWN) = map(
     PathState._fields.index, (
         'reason', 'publish', 'sent_at', 'request', 'commanded_at', 'last_heard',
         'last_stamp', 'refusing', 'fault', 'timed_out', 'commanding', 'drops',
         'stop_began', 'stops', 'law_known'))


def rule_kernel(robot: Robot, shape: PathShape, name: str, rule: Callable[..., PathState],
                label: str) -> Kernel:
    """
    Return the kernel of a rule; it compiles at its first use.

    Its arguments and its result are arrays. `name` is a key of `INPUTS`; `label` is what
    distinguishes the kernel from others of this name and robot.

    """
    path_shape = (path_size(shape),)
    shapes = {'path': path_shape, 'event': (EVENT_SIZE,), 'state': (shape.state,),
              'row': (6, 3 * shape.n), 'numbers': (FIELDS + shape.commanded,),
              'torque': (shape.commanded,), 'settings': (settings_size(shape),),
              'begin': (2 * shape.n,)}
    inputs = INPUTS[name]

    def compiled(*arrays: Vector, parameters: Vector, limits: Vector) -> Vector:
        # Arrays become records, with which the rules are written.
        arguments: list[Any] = []
        for key, array in zip(inputs, arrays, strict=True):
            if key == 'path':
                arguments.append(unpacked_path(array, shape))
            elif key == 'settings':
                arguments.append(unpacked_settings(array, shape))
            elif key == 'event':
                arguments.append(Event(*array))
            else:
                arguments.append(array)
        if name in WITH_PARAMETERS:
            return packed(rule(*arguments, parameters=parameters, limits=limits))
        return packed(rule(*arguments))
    return robot.kernels.compiled(compiled, f'{name.lower()}_{label}',
                                  {key: shapes[key] for key in inputs}, path_shape,
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
    tau, limited, accepted, arbitration : arrays
        The last torques; flags of joints that were clamped or limited in their rate; the
        last accepted state; an `Arbitration`: views of the array.

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
        self.arbitration: Array = parts.arbitration
        self._check: Array = parts.check
        self._confirmed = memoryview(self._check[CONFIRMED:])

    @property
    def path(self) -> PathState:
        """Return the state as a record of floats and arrays, which does not change."""
        numbers = self.array.copy()
        return PathState(*numbers[:SCALARS].tolist(),
                         *[numbers[place] for place in self._slices])

    @path.setter
    def path(self, path: PathState) -> None:
        self.array[:SCALARS] = path[:SCALARS]
        for part, numbers in zip(self._parts, path[SCALARS:]):
            part[:] = numbers

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
        self.memory = memory
        # The arrays that the rules read and write, by the names in `INPUTS`.
        self.next = PathMemory(shape)
        self.settings: CycleSettings
        self._numbers = np.zeros(settings_size(shape))
        self._state = state
        self._event = np.zeros(EVENT_SIZE)
        self._torque = np.zeros(shape.commanded)
        self._begin = np.zeros(2 * shape.n)
        arrays = {'path': memory.array, 'event': self._event, 'state': state,
                  'settings': self._numbers, 'torque': self._torque,
                  'begin': self._begin}
        self._to = memory.entries
        self._from = self.next.entries
        self._turning = turning_joints(robot, joints)
        # One kernel for each rule, compiled on all processors.
        rules: dict[str, Callable[..., PathState]] = {
            'JUDGE': partial(cycle_rules.judge, turning=self._turning),
            'ANSWERED': cycle_rules.answered, 'WAIT': cycle_rules.waiting,
            'REFUSED': _refused, 'STOP': torques_within_limits}
        label = '_'.join(map(str, (*shape, *self._turning.astype(int))))
        kernels = {name: rule_kernel(robot, shape, name, rule, label)
                   for name, rule in rules.items()}
        run_concurrently([kernel.compile for kernel in kernels.values()])
        # Calls that read these arrays in place and write the next path.
        bound = {}
        for name, kernel in kernels.items():
            inputs = [arrays[key] for key in INPUTS[name]]
            bound[name] = kernel.bind(inputs, self.next.array, f'Rule {name}.')
        self._judge = bound['JUDGE']
        self._answer = bound['ANSWERED']
        self.wait = bound['WAIT']
        self._refuse = bound['REFUSED']
        self._stop = bound['STOP']

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
            try:
                self._judge()
            except InputError:  # kernels do not accept numbers that are not finite
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

    def refuse(self, reason: int, permitted: bool, begin: Array | None = None) -> None:
        """
        Refuse the state by `cycle_rules.refuse`, for a reason.

        Parameters
        ----------
        reason : int
            A result of a cycle.
        permitted : bool
            Whether this process may command.
        begin : (2 n,) array, optional
            Where a stop begins now, positions and rates of the measured joints. Without
            it the arm is taken to rest at its last accepted state.

        """
        self._to[REASON] = reason
        self.memory.arbitration[PERMITTED] = permitted
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
