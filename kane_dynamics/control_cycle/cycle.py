"""
The cycle of a torque path: its rules as kernels over one array, and that array.

The kernels are those of `cycle_rules`, and of `loop_rules` for closed loops. A loop calls
them in the order judge, close, permit, aim, answer; or refuse, hold; and elapse without a
state.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from inspect import signature
from typing import Any

from kane_dynamics._util.typing import Array, Flags, Vector
from kane_dynamics.control.terms import Mode, Terms
from kane_dynamics.control.traced_laws import TracedLaw
from kane_dynamics.control_cycle import cycle_rules
from kane_dynamics.control_cycle.arbitration import FIELDS
from kane_dynamics.control_cycle.cycle_rules import (Event, EVENT_SIZE,
                                                     ModelStop, path_size, PathShape,
                                                     PathState, SCALARS, settings_size,
                                                     unpacked_path, unpacked_settings)
from kane_dynamics.control_cycle.loop_rules import LoopRules, unpacked_loops
from kane_dynamics.control_cycle.state_judgement import CONFIRMED, StateMemory
from kane_dynamics.errors import InputError
from kane_dynamics.loop_tracking.loop_tracker import search_places
from kane_dynamics.mechanics.algebra.flags import packed
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.threads import run_concurrently
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.robot_function import identifier
import numpy as np

OF_ROBOT = ('refuse', 'hold')  # programs with its dynamics, beside answers
OF_GUARD = ('permit', 'confirm', 'hear')  # only with torque_guard
ARRAYS = ('path', 'event', 'state', 'row', 'numbers', 'torque', 'settings', 'begin')
(REASON, PUBLISH, SENT_AT, REQUEST, PERIOD, COMMANDED_AT, LAST_HEARD, LAST_STAMP,
 REFUSING, FAULT, TIMED_OUT, COMMANDING, DROPS, STOP_BEGAN, STOPS, LAW_KNOWN, LOOKED_AT,
 LAST_LOOK) = map(
     PathState._fields.index, (
         'reason', 'publish', 'sent_at', 'request', 'period', 'commanded_at', 'last_heard',
         'last_stamp', 'refusing', 'fault', 'timed_out', 'commanding', 'drops',
         'stop_began', 'stops', 'law_known', 'looked_at', 'last_look'))


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
    tau, limited, pose, accepted, trusted, wrong, arbitration : arrays
        The last torques; flags of joints that were clamped or limited in their rate; the
        pose that is held; the last accepted state; the speeds that laws use, and flags of
        joints whose measured ones contradict their positions; an `Arbitration`: views of
        the array.
    q, u : (n_q,), (n,) arrays
        All positions and speeds of the last accepted state; views of the array.

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
        self.pose: Array = parts.pose
        self._check: Array = parts.check
        # The configuration of closed loops is that of their search.
        n = shape.n
        self.q: Array = self.accepted[:n]
        self.u: Array = self.accepted[n:]
        if shape.loops:
            search = unpacked_loops(parts.loops, shape.joints, n).measured
            places = search_places(shape.joints, n)
            self.q, self.u = search[places.q], search[places.u]
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


class Cycle:
    """
    The rules of a cycle as kernels that move the state of a path.

    Parameters
    ----------
    robot : Robot
    terms : Terms
        Terms of the command.
    laws : mapping of Mode to TracedLaw
        Without laws, the caller gives torques and where a stop begins, in the arrays
        `torque` and `begin`.
    loops : LoopRules, optional
        With closed loops.
    commanded : sequence of int, optional
        The joints with actuators. Default: all.
    is_told : bool
        Whether the caller says, in the state of the path, if this process may command.

    Raises
    ------
    InputError
        Joint states do not determine the state of the robot.

    Attributes
    ----------
    shape : PathShape
    by_name : dict of str to Kernel
        Each moves the state of the path; the keys are those of a plan. Kernels compile
        at their first use, or by `compile`.
    inputs : dict of str to list of str
        The arrays that each of them reads, by name.
    answers, aims : dict of Mode to Kernel
        The command of each mode; where its law needs it, the begin of the search for the
        desired configuration.
    further : array of int
        With closed loops: the joints that need not be measured.

    """

    def __init__(self, robot: Robot, terms: Terms, laws: Mapping[Mode, TracedLaw],
                 loops: LoopRules | None = None,
                 commanded: Sequence[int] | None = None, *, is_told: bool = False) -> None:
        equations = robot.equations
        if equations.timed or robot.model.balls or (
                laws and loops is None and not equations.in_joint_rates):
            raise InputError('robot: ball joints, chosen speeds, or constraints that depend '
                             'on time; expected one whose joint states are its state')
        self._robot = robot
        if commanded is None:
            commanded = range(robot.n_q)
        most_settings = max((law.settings for law in laws.values()), default=0)
        most_memory = max((law.memory for law in laws.values()), default=0)
        self.shape = PathShape(
            robot.n, len(commanded), robot.n_q,
            len(robot.equations.wrench_frames), most_settings, most_memory,
            loops.size if loops else 0)

        measured: Sequence[int] = range(robot.n_q)
        if loops is not None:
            measured = loops.joints.followed
        # Joints beside those that follow, whose measured positions are compared.
        further = sorted(set(range(robot.n_q)) - set(measured))

        # Names distinguish kernels, so that terms, sizes and joints are part of them.
        words = [terms.label]
        words += map(str, self.shape)
        if len(commanded) < robot.n_q:
            words += map(str, commanded)
        if loops is not None:
            words += map(str, measured)
        self._label = '_'.join(words)

        # A kernel for each rule of the cycle; answers and aims depend on the mode.
        self.inputs: dict[str, list[str]] = {}
        self.by_name: dict[str, Kernel] = {}
        self.answers: dict[Mode, Kernel] = {}
        self.aims: dict[Mode, Kernel] = {}
        turning = turning_joints(robot, [robot.joint_names[k] for k in measured])
        self._make_rules(turning, is_told)
        self.further = np.array(further, dtype=np.int64)
        if laws:
            stop = loops or ModelStop(robot, terms, tuple(commanded))
            self._make('refuse', partial(cycle_rules.refuse, stop))
        else:
            for name, rule in (('answer', cycle_rules.answer_given),
                               ('refuse', partial(cycle_rules.refuse_given, loops=loops)),
                               ('hold', cycle_rules.hold_given)):
                self.by_name[name] = self._kernel(name, rule, '_given')
        for mode, law in laws.items():
            # A law of another frame or other axes must not be found in the cache.
            self.answers[mode] = self._kernel(
                'answer', partial(cycle_rules.answer, robot, law, loops=loops),
                identifier(f'_{mode}', *law.variant))
        if loops is not None:
            self._make_of_loops(loops, laws)

    def _make_rules(self, turning: Flags, is_told: bool) -> None:
        """Make the rules of every arm; some of its joints turn without limits."""
        elapse: Callable[..., PathState]
        permit: Callable[..., PathState]
        elapse, permit = cycle_rules.elapse, cycle_rules.permit
        label = '_told' * is_told
        if is_told:
            elapse = partial(elapse, decide=cycle_rules.as_stated)
            permit = partial(permit, decide=cycle_rules.as_stated)
        self.by_name['judge'] = self._kernel(
            'judge', partial(cycle_rules.judge, turning=turning),
            '_' + ''.join(map(str, turning.astype(int))))
        self.by_name['elapse'] = self._kernel('elapse', elapse, label)
        self.by_name['permit'] = self._kernel('permit', permit, label)
        self._make('confirm', cycle_rules.confirm)
        self._make('hear', cycle_rules.hear)

    def _make_of_loops(self, loops: LoopRules, laws: Mapping[Mode, TracedLaw]) -> None:
        """Make what arms with closed loops need in addition."""
        # Closing the loops takes several cycles of the search: at a state, and along a
        # motion.
        self._make('close', loops.close)
        self._make('closing', loops.go_on_closing)
        if laws:
            self._make('aiming', loops.go_on_aiming)
            self._make('hold', loops.hold)
        for mode, law in laws.items():
            if law.closes:
                aim = partial(loops.aim, law=law)
                self.aims[mode] = self._kernel('aim', aim, f'_{mode}')

    def compile(self, modes: Collection[Mode], with_guard: bool) -> None:  # noqa: A003
        """Compile the commands of some modes, and the rules, on all processors."""
        # Programs of the robot are the longest: first, so that they do not end last.
        rules = sorted(self.by_name, key=lambda name: name not in OF_ROBOT)
        kernels = [self.answers[mode] for mode in modes if mode in self.answers]
        kernels += [self.aims[mode] for mode in modes if mode in self.aims]
        kernels += [self.by_name[name] for name in rules
                    if with_guard or name not in OF_GUARD]
        run_concurrently([kernel.compile for kernel in kernels])

    def _make(self, name: str, rule: Callable[..., PathState]) -> None:
        """Make the kernel of a rule by its name."""
        self.by_name[name] = self._kernel(name, rule)

    def _kernel(self, name: str, rule: Callable[..., PathState], variant: str = ''
                ) -> Kernel:
        """Make the kernel of a rule."""
        self.inputs[name] = inputs_of(rule)
        return rule_kernel(self._robot, self.shape, name, rule, self._label + variant)


def turning_joints(robot: Robot, joints: Sequence[str]) -> Flags:
    """
    Return which of n joints are continuous, (n,).

    A driver may publish their angles between -pi and pi.
    """
    places = list(map(robot.coordinate_names.index, joints))
    unlimited = np.isinf(robot.limits.lower[places]) & np.isinf(robot.limits.upper[places])
    sliding = [name in robot.model.sliding for name in joints]
    turning: Flags = unlimited & ~np.array(sliding, dtype=bool)
    return turning
