"""
The rules of one cycle of a torque path, as functions over any scalar.

A cycle judges a state, then answers or refuses it. Between states the path may time out.
Each rule returns a new `PathState` for the last one, without a branch on a value, so
that it is traced and compiled (`cycle`).

Times are nanoseconds since the start of the path, which a double holds exactly for 104
days, and to 1 us for 280 years. Flags are 1 or 0.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple, Protocol

from kane_dynamics._util.typing import Flags, Scalar, Vector
from kane_dynamics.control.stopping import reached_state, stopping_torque
from kane_dynamics.control.terms import Terms
from kane_dynamics.control.torque_blend import share_left
from kane_dynamics.control.torque_limiter import within_effort, within_rates
from kane_dynamics.control.traced_laws import Desired, LawInput, TracedLaw
from kane_dynamics.control_cycle.arbitration import (after_computing, Arbitration,
                                                     before_command, before_zeros,
                                                     FIELDS, heard, SIZE, STOPPED)
from kane_dynamics.control_cycle.cycle_results import (ACCEPTED, FUTURE, NANO, NEVER,
                                                       NO_CLOCK, NO_TORQUE, NOT_FINITE,
                                                       OFF_BRANCH, OUT_OF_ORDER, REFUSED,
                                                       STALE, WAITING)
from kane_dynamics.control_cycle.state_judgement import (CheckSettings, judged,
                                                         state_memory_size, StateMemory)
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.flags import (branch, changed_if, either, finite,
                                                   flag, packed)
from kane_dynamics.robot.robot import Robot
import numpy as np

NO_REQUEST = -1.0  # to torque_guard
# Why a motion was dropped last.
NOT_DROPPED, BY_CLOCK, BY_TIMEOUT, BY_REFUSAL, BY_GUARD, BY_LOOPS, BY_STALL = range(7)
# Of state_timeout, without a look at the clock: longer than the period of these looks.
STALL = 0.5
SHORTEST_STALL = 0.02 * NANO  # whatever the timeout is; longer than ordinary delays
# The measured period of the states follows the latest one by this share, and one state lets
# it grow by at most as much.
PERIOD_GAIN = 0.125
# The limit of the rate acts over at most two periods, as they were measured before the
# state: after a silence, one state alone must not change the torque by more.
MOST_PERIODS = 2.0 / (1.0 + PERIOD_GAIN)


class PathState(NamedTuple):
    """
    The memory of the path from one cycle to the next, with the result of a cycle.

    `message_loop.c` reads the numbers up to `drops`.

    Attributes
    ----------
    reason : Scalar
        `ACCEPTED`, or why the state is dropped.
    publish : Scalar
        Whether the cycle publishes `tau`.
    sent_at : Scalar
        Stamp of `tau`.
    request : Scalar
        Number of the request that the cycle sends to torque_guard; `NO_REQUEST`: none.
    retries : Scalar
        Whether the state that waits for torque_guard is answered next.
    searching : Scalar
        Whether the search for a configuration of closed loops needs another call.
    drops, dropped_by : Scalar
        How often the path dropped the desired motion, and why the last time.
    commanded_at : Scalar
        Steady time of the last command; 0: none yet.
    last_now, last_heard, last_stamp : Scalar
        The clock of the last cycle; time and stamp of the last state in time, and of
        the last accepted one.
    period : Scalar
        Mean time between two states in time, ns; 0: not measured yet.
    looked_at, last_look : Scalar
        Steady time of the last look at the clock, `elapse`, 0: none yet; and the clock then,
        which may be simulated.
    excused : Scalar
        Whether the silence has begun again after a stop of the process, since the last
        command: it does so once.
    refusing, refused_since, fault : Scalar
        Whether and since when states are refused; whether for longer than the grace.
    timed_out, commanding : Scalar
        As attributes of `TorquePath`.
    clock_jumps : Scalar
        How many of the drops were jumps of the clock: another one may follow at once.
    limit_known, limit_stamp : Scalar
        Of the last command of the rate limit.
    blending, blend_known, blend_began : Scalar
        Of the blend, as in `TorqueBlend`.
    restarts, blends : Scalar
        Those of the settings that were answered.
    jumps, silences : Scalar
        Those of the settings that were answered.
    stop_began : Scalar
        When the stop in a fault began; `NEVER` without one.
    stops : Scalar
        Whether the torque of that stop follows, once it is computed.
    untracked : Scalar
        Whether the next desired configuration begins at the measured one.
    holding : Scalar
        Whether `pose` is held.
    law_known : Scalar
        Whether `memory` is of the present law.
    tau, clamped, rate_limited : (c,) arrays
        The last published torques, of the commanded joints, and flags of their limits.
    last, difference : (c,) arrays
        Last command of the rate limit, and difference of the blend.
    pose : (n,) array
        Pose that is held.
    check : (k,) array
        A `StateMemory` of `state_check`.
    stop : (2 n,) array
        Positions and speeds at which the stop in a fault began.
    arbitration : (k,) array
        An `Arbitration`.
    loops : (l,) array
        A `LoopMemory` of `loop_rules`; empty without closed loops.
    memory : (m,) array
        Of the law; that of the largest memory has m entries.

    """

    reason: Scalar
    publish: Scalar
    sent_at: Scalar
    request: Scalar
    retries: Scalar
    searching: Scalar
    drops: Scalar
    dropped_by: Scalar
    commanded_at: Scalar
    last_now: Scalar
    last_heard: Scalar
    last_stamp: Scalar
    period: Scalar
    looked_at: Scalar
    last_look: Scalar
    excused: Scalar
    refusing: Scalar
    refused_since: Scalar
    fault: Scalar
    timed_out: Scalar
    commanding: Scalar
    clock_jumps: Scalar
    limit_known: Scalar
    limit_stamp: Scalar
    blending: Scalar
    blend_known: Scalar
    blend_began: Scalar
    restarts: Scalar
    blends: Scalar
    jumps: Scalar
    silences: Scalar
    stop_began: Scalar
    stops: Scalar
    untracked: Scalar
    holding: Scalar
    law_known: Scalar
    tau: Vector
    clamped: Vector
    rate_limited: Vector
    last: Vector
    difference: Vector
    pose: Vector
    check: Vector
    stop: Vector
    arbitration: Vector
    loops: Vector
    memory: Vector

    @property
    def states(self) -> StateMemory:
        """Return the record with which states are compared."""
        return StateMemory.of(self.check)

    def with_states(self, memory: StateMemory) -> 'PathState':
        """Return the path that compares states with others."""
        return self._replace(check=packed(memory))


class PathShape(NamedTuple):
    """
    Sizes of the arrays of a path.

    Attributes
    ----------
    n : int
        Joints that are measured and follow motions.
    commanded : int
        Joints with actuators.
    joints : int
        All joints, n_q.
    frames : int
        Frames with measured wrenches.
    law, memory : int
        Settings and memory of the laws.
    loops : int
        Of the memory of closed loops; 0 without.

    """

    n: int
    commanded: int
    joints: int
    frames: int = 0
    law: int = 0
    memory: int = 0
    loops: int = 0

    @property
    def state(self) -> int:
        """
        Return the length of a measured state.

        With closed loops, positions of all joints and their weights follow positions
        and speeds of those that are measured.
        """
        return 2 * self.n + (2 * self.joints if self.loops else 0)


class CycleSettings(NamedTuple):
    """
    The numbers that Python may change between two cycles.

    Attributes
    ----------
    timeout, grace : Scalar
        ns.
    holds, stop_time : Scalar
        Whether the arm is brought to rest in a lasting fault; in which time, ns.
    compares, compares_speeds : Scalar
        Whether a first state needs a second one that agrees, and whether speeds are
        compared with positions.
    blend_time : Scalar
        ns.
    restarts, blends : Scalar
        How often the law restarted, and how often it changed.
    jumps, silences : Scalar
        How often Python saw the clock jump, and asked for zeros until the next state.
    drops : Scalar
        `PathState.drops` when the motion was scheduled.
    bounds : (5 n,) array
        Of `CheckSettings`.
    turned : (n,) array
        Whether a joint may jump by whole turns.
    effort, slope, free : (c,) arrays
        Of the commanded joints: effort limits; rate limits, N m/s or N/s, 0 where there
        is none; and the change beyond the rate, `UNLIMITED` where there is none, else 0.
    wrench_timeout : Scalar
        Age after which a measured wrench counts no more, ns.
    wrenches : (7 k,) array
        Stamp, force and torque in the axes of its frame, of the k frames with wrenches.
    loop_limits : (6,) array
        Squares of the largest residual, deviation and figure, of measured and of desired
        closed loops; empty without closed loops.
    law : (k,) array
        Of the law; those of the law with most settings have k entries.

    """

    timeout: Scalar
    grace: Scalar
    holds: Scalar
    stop_time: Scalar
    compares: Scalar
    compares_speeds: Scalar
    blend_time: Scalar
    restarts: Scalar
    blends: Scalar
    jumps: Scalar
    silences: Scalar
    drops: Scalar
    wrench_timeout: Scalar
    bounds: Vector
    turned: Vector
    effort: Vector
    slope: Vector
    free: Vector
    wrenches: Vector
    loop_limits: Vector
    law: Vector


class Event(NamedTuple):
    """
    The times of a cycle, and the place on the motion.

    Attributes
    ----------
    now, stamp : Scalar
        The clock, and the stamp of the state.
    moving : Scalar
        Whether a motion is scheduled at the time of the state, `moment_of`.
    x : Scalar
        Fraction of the time of the segment, 0 to 1.
    ticking : Scalar
        Whether the clock runs: simulated time is zero before its first message.
    steady : Scalar
        Steady time, ns.

    """

    now: Scalar
    stamp: Scalar
    moving: Scalar
    x: Scalar
    ticking: Scalar
    steady: Scalar


def moment_of(event: Event) -> Scalar:
    """Return the time of a state: its stamp, but not later than now."""
    return select(event.now < event.stamp, event.now, event.stamp)


class StopRules(Protocol):
    """Rules of the stop of an arm whose states are refused."""

    def given_up(self, path: PathState) -> PathState:
        """Return the path whose states are refused for longer than the grace time."""

    def reached(self, path: PathState, elapsed: Scalar, parameters: Vector) -> Vector:
        """
        Return where the joints that are measured are some time after the last state, s.

        The result is positions and rates, (2 n,), under the torque that acts.
        """

    def begin_hold(self, path: PathState, settings: CycleSettings, parameters: Vector
                   ) -> PathState:
        """Command the torque of the stop, or begin the search for its configuration."""


class ClosedLoopRules(StopRules, Protocol):
    """The rules of closed loops, `LoopRules`."""

    def measured(self, path: PathState) -> tuple[Vector, Vector]:
        """Return the measured configuration and its speeds."""

    def whole(self, path: PathState, desired: Desired) -> Desired:
        """Return a desired motion with the configuration that was found for it."""


EVENT_SIZE = len(Event._fields)
SCALARS = PathState._fields.index('tau')
SCALAR_SETTINGS = CycleSettings._fields.index('bounds')
WRENCH = 7  # entries of a measured wrench: stamp, force, torque
LOOP_LIMITS = 3  # of one search for a configuration


def path_size(shape: PathShape) -> int:
    """Return the number of entries of a `PathState` as an array."""
    return SCALARS + sum(_path_parts(shape)) + shape.memory


def settings_size(shape: PathShape) -> int:
    """Return the number of entries of `CycleSettings` as an array."""
    return SCALAR_SETTINGS + sum(_settings_parts(shape)) + shape.law


def unpacked_path(array: Vector, shape: PathShape) -> PathState:
    """Return the `PathState` of an array."""
    return PathState(*array[:SCALARS], *_parts(array[SCALARS:], _path_parts(shape)))


def unpacked_settings(array: Vector, shape: PathShape) -> CycleSettings:
    """Return the `CycleSettings` of an array."""
    parts = _parts(array[SCALAR_SETTINGS:], _settings_parts(shape))
    return CycleSettings(*array[:SCALAR_SETTINGS], *parts)


def _path_parts(shape: PathShape) -> list[int]:
    """Return the lengths of the arrays of a `PathState`, but the last one."""
    check = state_memory_size(shape.n)
    return [*[shape.commanded] * 5, shape.n, check, 2 * shape.n, SIZE, shape.loops]


def _settings_parts(shape: PathShape) -> list[int]:
    """Return the lengths of the arrays of `CycleSettings`, but the last one."""
    limits = 2 * LOOP_LIMITS if shape.loops else 0
    return [5 * shape.n, shape.n, *[shape.commanded] * 3, WRENCH * shape.frames, limits]


def _parts(array: Vector, sizes: list[int]) -> list[Vector]:
    """Return parts of these sizes, and the rest."""
    return np.split(array, np.cumsum(sizes))


def initial_path(shape: PathShape, now: float, arbitration: Arbitration) -> PathState:
    """Return the state of a path that starts."""
    # No state was accepted, nothing commanded, and no request is known.
    zeros = np.zeros(shape.commanded)
    at_rest = np.zeros(2 * shape.n)
    states = StateMemory.empty(shape.n)
    scalars = dict.fromkeys(PathState._fields[:SCALARS], 0.0)
    scalars |= {'sent_at': now, 'last_now': now, 'last_heard': now, 'last_stamp': NEVER,
                'request': NO_REQUEST, 'dropped_by': float(NOT_DROPPED),
                'limit_stamp': NEVER, 'stop_began': NEVER}
    return PathState(**scalars, tau=zeros, clamped=zeros, rate_limited=zeros, last=zeros,
                     difference=zeros, pose=np.zeros(shape.n), check=packed(states),
                     stop=at_rest, arbitration=np.array(arbitration),
                     loops=np.zeros(shape.loops), memory=np.zeros(shape.memory))


# The clock.

def at_time(path: PathState, now: Scalar, settings: CycleSettings) -> PathState:
    """
    Return the path at a time, with new settings.

    After a backward jump of the clock, motions and stamps are of another time. The
    torque that acts stays: from zero the limit of its rate would let the arm fall.
    """
    path = _with_new_law(path, settings)
    backward = flag(now < path.last_now)
    has_jumped = select(path.jumps < settings.jumps, 1.0, backward)
    path = changed_if(has_jumped, path, partial(_after_jump, now=now))
    return path._replace(last_now=now, jumps=settings.jumps, publish=0.0,
                         reason=float(ACCEPTED), request=NO_REQUEST, retries=0.0,
                         searching=0.0, stops=0.0)


def _after_jump(path: PathState, now: Scalar) -> PathState:
    """Return the path for which stamps and motion of the time before mean nothing."""
    jumped = forgotten(resumed(dropped(path, BY_CLOCK), 0.0, NEVER))
    return jumped._replace(last_heard=now, last_stamp=NEVER,
                           clock_jumps=path.clock_jumps + 1.0)


def _with_new_law(path: PathState, settings: CycleSettings) -> PathState:
    """Return the path whose law begins or changes, if the settings say so."""
    begins = flag(path.restarts < settings.restarts)
    path = changed_if(begins, path, restarted)
    changes = flag(path.blends < settings.blends) * flag(settings.blend_time > 0.0)
    path = branch(changes, path._replace(blending=1.0, blend_known=0.0), path)
    return path._replace(restarts=settings.restarts, blends=settings.blends)


def dropped(path: PathState, reason: int) -> PathState:
    """Return the path without its desired motion."""
    return path._replace(drops=path.drops + 1.0, dropped_by=float(reason))


def forgotten(path: PathState) -> PathState:
    """Return the path that compares the next state with no earlier one."""
    path = path.with_states(path.states.forgotten())
    return path._replace(refusing=0.0, fault=0.0, stop_began=NEVER)


def restarted(path: PathState) -> PathState:
    """Return the path whose law begins at the next state."""
    return path._replace(holding=0.0, law_known=0.0, blending=0.0, blend_known=0.0,
                         untracked=1.0)


def resumed(path: PathState, known: Scalar, stamp: Scalar) -> PathState:
    """Return the path that goes on from the torque that acts, with its stamp."""
    acting = path.commanding * path.tau
    return restarted(path)._replace(last=acting, limit_known=known, limit_stamp=stamp)


def with_zeros(path: PathState, now: Scalar) -> PathState:
    """Return the path that commands zeros, without the limit of the rate."""
    zeros = 0.0 * path.tau
    return restarted(path)._replace(tau=zeros, last=zeros, clamped=zeros,
                                    rate_limited=zeros, limit_known=0.0, commanding=0.0,
                                    publish=1.0, sent_at=now, request=STOPPED)


def elapse(path: PathState, event: Event, settings: CycleSettings,
           decide: Callable[[Arbitration, Scalar], Arbitration] = before_zeros
           ) -> PathState:
    """
    Command zeros, once, if the last state in time has timed out, or if asked to.

    States may wait in the queue of a process that was stopped: the time begins again then.
    `decide` says whether the node may command zeros at a steady time.
    """
    now = event.now
    path = at_time(path, now, settings)
    stall = _stall(path, event, settings)
    silence = now - path.last_heard
    late = flag(settings.timeout < silence - stall) * (1.0 - path.timed_out)
    late = select(path.silences < settings.silences, 1.0, late)
    stalled = _stalled(path, event, settings) * (1.0 - late)
    path = changed_if(stalled, path, partial(_after_stall, now=now))
    path = path._replace(looked_at=event.steady, last_look=now)

    # torque_guard may hold the arm by now; after its answer, the next look decides.
    def asked(path: PathState) -> PathState:
        return _decided(path, decide(Arbitration(*path.arbitration), event.steady))
    path = changed_if(late * path.commanding, path, asked)
    permitted = Arbitration(*path.arbitration).permitted
    late = late * either(path.commanding, permitted, 1.0)
    return changed_if(late, path, partial(_silent, now=now, settings=settings))


def _silent(path: PathState, now: Scalar, settings: CycleSettings) -> PathState:
    """Return the path whose states have timed out."""
    silent = forgotten(dropped(path, BY_TIMEOUT))._replace(
        timed_out=1.0, silences=settings.silences)
    return changed_if(path.commanding, silent, partial(with_zeros, now=now))


def _stall(path: PathState, event: Event, settings: CycleSettings) -> Scalar:
    """Return for how long a process that commands was stopped until now, ns; mostly 0."""
    # A simulated clock may be slow, and with it the looks.
    steady_gap = event.steady - path.looked_at
    gap = event.now - path.last_look
    gap = select(gap < steady_gap, gap, steady_gap)
    is_long = flag(STALL * settings.timeout < gap) * flag(gap > SHORTEST_STALL)
    is_long = is_long * flag(path.looked_at > 0.0)
    counts = is_long * path.commanding * (1.0 - path.excused)
    return either(counts, gap, 0.0)


def _stalled(path: PathState, event: Event, settings: CycleSettings) -> Scalar:
    """Return whether the last state is older than the timeout, after a stop of the process."""
    silent = flag(settings.timeout < event.now - path.last_heard) * (1.0 - path.timed_out)
    return silent * flag(_stall(path, event, settings) > 0.0)


def _after_stall(path: PathState, now: Scalar) -> PathState:
    """Return the path of a process that was stopped: the torque acts, the motion is over."""
    path = forgotten(resumed(dropped(path, BY_STALL), 1.0, now))
    return path._replace(last_heard=now, excused=1.0)


# Who commands.

def permit(path: PathState, event: Event, state: Vector,
           decide: Callable[[Arbitration, Scalar], Arbitration] = before_command
           ) -> PathState:
    """
    Decide whether the node may command at a state that was judged.

    An accepted state waits for the answer of torque_guard, if the node has to ask.
    """
    decided = decide(Arbitration(*path.arbitration), event.steady)
    asked = _decided(path, decided)
    accepted = flag(path.reason < 0.5)
    waits = accepted * (1.0 - decided.permitted)
    asked = branch(waits, waiting(asked, event, state), asked)
    # Only refused states of an arm that is commanded lead to a command.
    refused = flag(path.reason > NOT_FINITE - 0.5) * path.commanding
    return branch(either(accepted, 1.0, refused), asked, path)


def as_stated(known: Arbitration, steady: Scalar) -> Arbitration:
    """Return the state of a process whose caller has decided whether it may command."""
    return known._replace(sends=0.0)


def confirm(path: PathState, event: Event, state: Vector) -> PathState:
    """Keep a state for later whose command was late, so that the guard is asked again."""
    decided = after_computing(Arbitration(*path.arbitration), event.steady)
    asked = _decided(path, decided)
    return branch(decided.permitted, asked, waiting(asked, event, state))


def hear(path: PathState, event: Event, numbers: Vector, settings: CycleSettings) -> PathState:
    """Note a message of torque_guard; go on from its torques if it handed them over."""
    path = at_time(path, event.now, settings)
    known = heard(Arbitration(*path.arbitration), numbers, event.steady)
    noted = _decided(path, known)._replace(retries=known.retries)
    noted = changed_if(known.answered * known.resumes, noted, partial(
        taken_back, event=event, tau=numbers[FIELDS:], settings=settings))
    return branch(finite(numbers), noted, path)


def taken_back(path: PathState, event: Event, tau: Vector, settings: CycleSettings
               ) -> PathState:
    """Return the path that goes on from torques of another process, of now."""
    # Zeros that were asked for while the other process commanded are of that time.
    acting = path._replace(last_heard=event.now, commanding=1.0, tau=tau,
                           silences=settings.silences)
    stamped = flag(path.last_stamp > NEVER)
    continued = resumed(acting, stamped, path.last_stamp)
    # As after a pause of the states, a motion ends with a silence that was too long.
    silent = flag(settings.timeout < event.steady - path.commanded_at)
    silent = silent * flag(path.commanded_at > 0.0)
    return branch(silent, dropped(continued, BY_GUARD), continued)


def _decided(path: PathState, decided: Arbitration) -> PathState:
    """Return the path after a decision, with the request that it sends."""
    request = either(decided.sends, decided.number, NO_REQUEST)
    return path._replace(arbitration=np.array(decided), request=request)


def waiting(path: PathState, event: Event, state: Vector) -> PathState:
    """Return the path whose accepted state waits for torque_guard."""
    moment = moment_of(event)
    path = _kept(path, moment, state)
    return path._replace(reason=float(WAITING), last_stamp=moment, refusing=0.0, fault=0.0,
                         stop_began=NEVER)


# A state.

def judge(path: PathState, event: Event, state: Vector, settings: CycleSettings,
          turning: Flags) -> PathState:
    """
    Compare a state with the clock, the limits and the last state.

    `state` is as long as `PathShape.state`. Only joints that are `turning`, (n,), may
    jump by whole turns: others need no comparison on the circle.
    """
    now = event.now
    stamp = event.stamp
    # The clock first: what it drops must not be judged.
    path = at_time(path, now, settings)
    # Faults of the stamp say nothing about the arm, not even that it is heard.
    reason = select(stamp < path.last_stamp, float(OUT_OF_ORDER), float(ACCEPTED))
    reason = select(settings.timeout < stamp - now, float(FUTURE), reason)
    reason = select(settings.timeout < now - stamp, float(STALE), reason)
    reason = either(event.ticking, reason, float(NO_CLOCK))
    in_time = flag(reason < 0.5)
    # The state may be read before the clock is looked at.
    stalled = in_time * _stalled(path, event, settings)
    path = changed_if(stalled, path, partial(_after_stall, now=now))
    moment = moment_of(event)
    check = _check_settings(path, settings, turning)
    result, states = judged(path.states, moment, state, check)
    heard = path.with_states(states)._replace(last_heard=moment, reason=result,
                                              period=_period(path, moment))
    return branch(in_time, heard, path._replace(reason=reason))


def _check_settings(path: PathState, settings: CycleSettings, turning: Flags
                    ) -> CheckSettings:
    """Return the settings by which a state is judged."""
    turned = np.where(turning, settings.turned, 0.0)
    longest_gap = MOST_PERIODS * path.period + 1.0
    longest_gap = select(longest_gap < settings.grace, longest_gap, settings.grace)
    return CheckSettings(settings.timeout, settings.grace, longest_gap, settings.compares,
                         settings.compares_speeds, turned, settings.bounds)


def _period(path: PathState, moment: Scalar) -> Scalar:
    """Return the mean time between two states, with one that comes now, ns."""
    gap = moment - path.last_heard
    longest = 2.0 * path.period
    counted = select(gap < longest, gap, longest)
    followed = path.period + PERIOD_GAIN * (counted - path.period)
    period = either(flag(path.period > 0.0), followed, gap)
    # Two states of one time, as of a clock that stands still, say nothing.
    follows = path.states.known * flag(gap > 0.0)
    return either(follows, period, path.period)


def _measured(path: PathState, state: Vector) -> Vector:
    """Return positions and velocities of the measured joints."""
    return state[:len(path.stop)]


def _kept(path: PathState, moment: Scalar, state: Vector) -> PathState:
    """Return the path with a state to compare the next one with."""
    return path.with_states(path.states.kept(moment, _measured(path, state)))


# The command.

def answer(robot: Robot, law: TracedLaw, path: PathState, event: Event, state: Vector,
           row: Vector, settings: CycleSettings, parameters: Vector, limits: Vector,
           loops: ClosedLoopRules | None = None) -> PathState:
    """
    Command the torque of a law at an accepted state.

    `row` has the polynomials of q, u and udot of the motion's segment, (6, 3 n). Where a
    torque is not finite, the path stays, with the reason `NO_TORQUE`, or `REFUSED` where
    closed loops do not determine it.
    """
    # The measured state; with closed loops that of the whole mechanism.
    q, _ = np.split(_measured(path, state), 2)
    u = path.states.trusted
    desired = desired_motion(path, event, row, settings, q, law.holds)
    if loops is not None:
        q, u = loops.measured(path)
        desired = loops.whole(path, desired)
    torque, memory = law.torque(LawInput(
        q, u, moment_of(event), desired, 1.0 - path.law_known, path.memory[:law.memory],
        settings.law[:law.settings], parameters, limits,
        _external(robot, q, event.now, settings)))
    commanded = answered(path, event, state, torque, settings)
    commanded = commanded._replace(
        memory=np.concatenate([memory, path.memory[law.memory:]]))
    if law.holds:
        # The first state without a motion is the pose that is held next.
        commanded = commanded._replace(holding=1.0 - desired.moving, pose=desired.q)
    reason: Scalar = float(NO_TORQUE)
    if loops is not None:
        # The first torque alone says that they are not determined.
        reason = either(finite(torque[1:]), float(REFUSED), reason)
    return branch(finite(torque), commanded, path._replace(reason=reason))


def answer_given(path: PathState, event: Event, state: Vector, row: Vector,
                 torque: Vector, settings: CycleSettings) -> PathState:
    """Command a torque that Python has computed, as `answer`."""
    commanded = answered(path, event, state, torque, settings)
    return branch(finite(torque), commanded, path._replace(reason=float(NO_TORQUE)))


def answered(path: PathState, event: Event, state: Vector, torque: Vector,
             settings: CycleSettings) -> PathState:
    """Command a finite torque of the law at an accepted state."""
    moment = moment_of(event)
    # Blended from the last command after a change, then limited in effort and in rate.
    blended, path_then = _blended(path, moment, torque, settings)
    clamped, tau = _limited(path_then, moment, blended, settings)
    # Faults end with a command, and its stamp is that of the last one.
    return _kept(path_then, moment, state)._replace(
        reason=float(ACCEPTED), publish=1.0, sent_at=event.stamp, last_stamp=moment,
        refusing=0.0, fault=0.0, stop_began=NEVER, timed_out=0.0, excused=0.0,
        commanding=1.0, commanded_at=event.steady, limit_known=1.0,
        limit_stamp=moment, tau=tau, last=tau, clamped=_differ(clamped, blended),
        rate_limited=_differ(tau, clamped), law_known=1.0)


def _external(robot: Robot, q: Vector, now: Scalar, settings: CycleSettings
              ) -> Vector | None:
    """Return the torques of the measured wrenches that are in time; None without frames."""
    frames = robot.equations.wrench_frames
    if not len(settings.wrenches):
        return None
    in_world = []
    for frame, row in zip(frames, settings.wrenches.reshape(-1, WRENCH)):
        age = now - row[0]
        acts = flag(age < settings.wrench_timeout + 1.0)
        # Before a jump of the clock the stamps were of another time.
        acts = acts * flag(-age < settings.wrench_timeout + 1.0)
        R = robot.equations.frame_pose(frame, q)[:3, :3]
        wrench = np.concatenate([R @ row[1:4], R @ row[4:]])
        in_world.append(either(acts, wrench, 0.0 * wrench))
    external: Vector = robot.equations.external_force(q, np.array(in_world))
    return external


def desired_motion(path: PathState, event: Event, row: Vector, settings: CycleSettings,
                   q: Vector, holds: bool) -> Desired:
    """Return the desired motion; that which was scheduled before a drop counts no more."""
    moving = event.moving * (1.0 - flag(settings.drops < path.drops))
    x = event.x
    # q, u and udot of the segment, from its coefficients in x from 0 to 1.
    powers = np.array([1.0, x, x * x, x * x * x, x * x * x * x, x * x * x * x * x])
    q_d, u_d, udot_d = np.split(powers @ row, 3)
    if holds:
        pose = either(path.holding, path.pose, q)
        q_d = either(moving, q_d, pose)
        u_d = either(moving, u_d, 0.0 * u_d)
        udot_d = either(moving, udot_d, 0.0 * udot_d)
    return Desired(q_d, u_d, udot_d, moving)


def _blended(path: PathState, t: Scalar, tau: Vector, settings: CycleSettings
             ) -> tuple[Vector, PathState]:
    """Return the torque that goes on from the last one, and the path, as `TorqueBlend`."""
    # The difference between the last command and the law's torque fades out.
    blending = path.blending * path.limit_known
    difference = either(path.blend_known, path.difference, path.last - tau)
    began = either(path.blend_known, path.blend_began, t)
    began = select(t < began, t, began)
    # Without a duration, x is past 1 at once.
    duration = select(settings.blend_time > 0.0, settings.blend_time, 1.0)
    x = (t - began) / duration
    blending = blending * flag(x < 1.0)
    blended = either(blending, tau + share_left(x) * difference, tau)
    return blended, path._replace(blending=blending, blend_known=blending,
                                  blend_began=began, difference=difference)


def _limited(path: PathState, t: Scalar, tau: Vector, settings: CycleSettings
             ) -> tuple[Vector, Vector]:
    """Return the torque within the effort, then also within the rate."""
    # The rate counts since the last command, but not over a silence; a stamp that does not
    # increase allows no change.
    elapsed = select(path.limit_stamp < t, t - path.limit_stamp, 0.0)
    longest = MOST_PERIODS * path.period
    elapsed = select(elapsed < longest, elapsed, longest)
    elapsed = either(path.limit_known, elapsed / NANO, 0.0)
    change = settings.slope * elapsed + settings.free
    # An effort limit that became smaller holds for the last command too, as in
    # `TorqueLimiter`.
    last = within_effort(path.last, settings.effort)
    clamped = within_effort(tau, settings.effort)
    limited = within_rates(clamped, last, change)
    return np.array(clamped), np.array(limited)


def _differ(x: Vector, y: Vector) -> Vector:
    """Return a flag for each entry that differs."""
    return np.array([select(a < b, 1.0, flag(b < a)) for a, b in zip(x, y)])


# A refused state.

def refuse(stop: StopRules, path: PathState, event: Event, settings: CycleSettings,
           parameters: Vector) -> PathState:
    """
    Command what follows a state that is not answered; `path.reason` says why.

    The last command goes on during the grace time. After it the torques are zero, or
    bring the arm to rest.
    """
    now = event.now
    reason = path.reason
    # Refused states are bridged for the grace period; longer ones end the motion.
    since = either(path.refusing, path.refused_since, now)
    refused = path._replace(refusing=1.0, refused_since=since)
    # A motion without a torque, as one that the loops cannot follow, ends at once.
    ends = flag(reason > REFUSED - 0.5)
    refused = changed_if(ends, refused, partial(dropped, reason=BY_LOOPS))
    lasts = flag(settings.grace < now - since) * (1.0 - path.fault)
    refused = changed_if(lasts, refused, partial(_given_up, stop=stop, settings=settings,
                                                 parameters=parameters))

    # Without the guard's permission nothing is commanded; states that are no refusal
    # change nothing.
    commands = refused.commanding * Arbitration(*path.arbitration).permitted
    refused = changed_if(commands, refused,
                         partial(_commanded, stop=stop, now=now, settings=settings,
                                 parameters=parameters))
    return branch(flag(reason > NOT_FINITE - 0.5), refused, path)


def refuse_given(path: PathState, event: Event, settings: CycleSettings, begin: Vector,
                 loops: StopRules | None) -> PathState:
    """Command what follows a refused state, as `refuse`; a stop begins where it is given."""
    return refuse(GivenStop(begin, loops), path, event, settings, np.zeros(0))


def hold_given(path: PathState, torque: Vector, settings: CycleSettings) -> PathState:
    """Command the torque of a stop that Python has computed."""
    return torques_within_limits(path, torque, settings)


def _given_up(path: PathState, stop: StopRules, settings: CycleSettings,
              parameters: Vector) -> PathState:
    """Return the path when states are refused for longer than the grace."""
    faulty = dropped(path, BY_REFUSAL)._replace(fault=1.0)
    # A false state must not become possible because time passes.
    is_false = flag(path.reason < OFF_BRANCH + 0.5)
    states = path.states
    faulty = faulty.with_states(states._replace(frozen_at=either(
        is_false, states.stamp + settings.grace, states.frozen_at)))
    # The torque goes on, but the pose that was held is left: meanwhile the arm can have
    # moved, and the position gain would throw it back.
    holds = path.commanding * settings.holds
    faulty = branch(holds, resumed(faulty, 1.0, path.last_heard), faulty)
    stops = settings.holds * states.confirmed
    faulty = changed_if(stops, faulty, partial(stopping, stop=stop, settings=settings,
                                               parameters=parameters))
    return stop.given_up(faulty)


def stopping(path: PathState, stop: StopRules, settings: CycleSettings, parameters: Vector
             ) -> PathState:
    """Return the path whose arm begins to stop, from where the model says that it is."""
    # Where the arm is by now, if it followed the last command since the last state.
    states = path.states
    q, u = np.split(states.accepted, 2)
    elapsed = (path.last_heard - states.stamp) / NANO
    reached = stop.reached(path, elapsed, parameters)
    # Without a finite prediction it is taken to stay.
    rest = np.concatenate([q, 0.0 * u])
    begin = either(finite(reached), reached, rest)
    began, speeds = np.split(begin, 2)
    # The next accepted state is near where the arm comes to rest.
    end = began + 0.5 * settings.stop_time / NANO * speeds
    is_false = flag(path.reason < OFF_BRANCH + 0.5)
    expected = either(is_false, np.concatenate([end, 0.0 * u]), states.accepted)
    path = path.with_states(states._replace(accepted=expected))
    return path._replace(stop=begin, stop_began=path.last_heard)


def _commanded(path: PathState, stop: StopRules, now: Scalar, settings: CycleSettings,
               parameters: Vector) -> PathState:
    """Return the path with the command at a refused state."""
    # The last one within the grace period, then that of the stop or zeros. The model
    # holds the arm only from a state that is accepted.
    repeated = _repeated(path, settings)
    can_hold = settings.holds * path.states.confirmed
    held = changed_if(path.fault * can_hold, repeated, partial(
        stop.begin_hold, settings=settings, parameters=parameters))
    ends = path.fault * (1.0 - can_hold)
    return changed_if(ends, held, lambda _: with_zeros(path, now))


def _repeated(path: PathState, settings: CycleSettings) -> PathState:
    """Return the path that publishes its last torque again."""
    # The limit of the rate counts from here on: the torque did not change until now.
    def counted(path: PathState) -> PathState:
        _, last = _limited(path, path.last_heard, path.tau, settings)
        return path._replace(last=last, limit_known=1.0, limit_stamp=path.last_heard)
    return changed_if(1.0 - path.fault, path, counted)._replace(publish=1.0)


class GivenStop:
    """
    The stop of an arm whose controller says where it begins, and its torque afterwards.

    Parameters
    ----------
    begin : (2 n,) array
        Positions and rates of the joints that are measured, at the begin of the stop.
    loops : StopRules, optional
        Those of closed loops, which may lose their assembly mode.

    """

    def __init__(self, begin: Vector, loops: StopRules | None = None) -> None:
        self._begin = begin
        self._loops = loops

    def given_up(self, path: PathState) -> PathState:
        """Return the path whose closed loops are lost, if they may be."""
        return path if self._loops is None else self._loops.given_up(path)

    def reached(self, path: PathState, elapsed: Scalar, parameters: Vector) -> Vector:
        """Return the positions and rates at the begin of the stop."""
        return self._begin

    def begin_hold(self, path: PathState, settings: CycleSettings, parameters: Vector
                   ) -> PathState:
        """Let the torque of the stop follow."""
        return path._replace(stops=1.0)


class ModelStop:
    """
    The stop of an arm in joint rates, by its model.

    Parameters
    ----------
    robot : Robot
    terms : Terms
        Terms of the commands.
    commanded : sequence of int
        The joints with actuators.

    """

    def __init__(self, robot: Robot, terms: Terms, commanded: Sequence[int]) -> None:
        self._robot = robot
        self._terms = terms
        self._commanded = list(commanded)

    def given_up(self, path: PathState) -> PathState:
        """Return the same path."""
        return path

    def reached(self, path: PathState, elapsed: Scalar, parameters: Vector) -> Vector:
        """Return positions and rates of the joints, some time after the last state."""
        q, u = np.split(path.states.accepted, 2)
        tau = np.zeros(len(q), dtype=object)
        tau[self._commanded] = path.tau
        return np.concatenate(reached_state(self._robot, self._terms, range(len(q)), q, u,
                                            tau, elapsed, parameters))

    def begin_hold(self, path: PathState, settings: CycleSettings, parameters: Vector
                   ) -> PathState:
        """Command the torque that brings the arm to rest."""
        torque = stopping_torque(self._robot, self._terms, *begun_stop(path, settings),
                                 parameters)
        return torques_within_limits(path, torque[self._commanded], settings)


def begun_stop(path: PathState, settings: CycleSettings
               ) -> tuple[Vector, Vector, Scalar, Scalar]:
    """Return the stop: positions and speeds at its begin, time since then, duration, s."""
    q, u = np.split(path.states.accepted, 2)
    begun, speeds = np.split(path.stop, 2)
    # Without a stop, as where the settings have changed since, the arm is at rest.
    is_stopping = flag(path.stop_began > NEVER)
    elapsed = (path.last_heard - path.stop_began) / NANO
    return (either(is_stopping, begun, q), either(is_stopping, speeds, 0.0 * u), elapsed,
            settings.stop_time / NANO)


def torques_within_limits(path: PathState, torque: Vector, settings: CycleSettings
                          ) -> PathState:
    """Return the path that commands torques in a fault; the same path if not finite."""
    clamped, tau = _limited(path, path.last_heard, torque, settings)
    held = path._replace(tau=tau, last=tau, clamped=_differ(clamped, torque),
                         rate_limited=_differ(tau, clamped), limit_known=1.0,
                         limit_stamp=path.last_heard, sent_at=path.last_heard)
    return branch(finite(torque), held, path)
