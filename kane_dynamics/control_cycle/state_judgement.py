"""
Judge joint states by what the arm can do, as functions over any scalar.

A state is impossible if it is not finite, if a joint lies far outside its position
limits, is faster than it can be, or is farther from its last accepted position than it
can have moved since then. A joint that has jumped stays impossible until it jumps back
or, within the grace time, its measured speeds explain where it is: an offset of an encoder
does not become possible as time passes.

Speeds that contradict the positions are no reason to refuse a state, because its positions
still say where the arm is: the laws use speeds from the positions then. They do so for a
joint whose speed is NaN, too: it counts as absent.
"""

import math
from typing import NamedTuple

from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.control.torque_limiter import clipped
from kane_dynamics.control_cycle.cycle_results import (ACCEPTED, FIRST, JUMP, NANO, NEVER,
                                                       NOT_FINITE, OUTSIDE, TOO_FAST,
                                                       UNEXPLAINED)
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.flags import branch, either, finite, flag
from kane_dynamics.mechanics.algebra.vector import is_zero
import numpy as np

UNLIMITED = float(np.finfo(np.float64).max)  # stands for an infinite bound
# Time over which speeds are compared with positions, s: longer than the filters of drivers,
# shorter than a false speed needs to move an arm far.
SPEED_WINDOW = 0.2
# Share of the speed limit times state_check.speed_factor: by more, one speed alone differs
# neither from the positions nor from the speed before.
SPEED_NOISE = 0.05
# Between two states, rad or m, of a joint without a speed limit: more is no measurement.
FARTHEST = 1e9
COMPARISONS = 3.0  # of speeds in that time, so that one state alone never contradicts
DERIVED_WITHIN = 0.01  # time constant of speeds that are derived from positions, s
# Speeds by a constant factor: over a longer time, differences in the direction of motion may
# be a share of the path and a time by which speeds are late, s. A filter adds nothing to them.
FACTOR_WINDOW = 10.0
FACTOR_SHARE = 0.25
LATEST = 0.1
LATE_SHARE = 0.5  # of the distance by the measured speeds, by which a stamp may be wrong


class StateMemory(NamedTuple):
    """
    The memory of `judged`: the last accepted state, or a first one.

    Attributes
    ----------
    known : Scalar
        Whether there is a state to compare the next one with.
    stamp : Scalar
        Its stamp, ns.
    frozen_at : Scalar
        After a fault that lasts: the time up to which a joint can have moved, ns, because
        a fault must not become possible as time passes; else `NEVER`.
    confirmed : Scalar
        Whether it is accepted; a first state is not.
    elapsed : Scalar
        Time in which the joints can have moved until the state judged last, s.
    jumped_at : Scalar
        Stamp of the last state that was refused with a joint that had jumped, ns.
    compared_at : Scalar
        Stamp of `compared`, ns.
    comparisons : Scalar
        How many states were compared in the last `SPEED_WINDOW`.
    accepted : (2 n,) array
        Its positions and velocities.
    jumped : (n,) array
        Whether each joint had jumped in that refused state; zeros after an accepted one.
    refused : (n,) array
        The positions in that refused state.
    compared : (2 n,) array
        The last state whose speeds were compared with its positions.
    deviation, path : (n,) arrays
        By how much the positions moved farther than the speeds say, and how far they moved
        by the larger of both, in the last `SPEED_WINDOW`, rad or m.
    excess, travel : (n,) arrays
        By how much the positions moved farther in the direction of the speeds than these
        say, and how far they moved by these, in the last `FACTOR_WINDOW`, rad or m.
    wrong : (n,) array
        Whether the speeds of each joint have contradicted its positions since the start.
    derived : (n,) array
        Speeds from the positions alone, rad/s or m/s.
    trusted : (n,) array
        The speeds of `compared`, or derived ones where these are wrong, or one of them is
        alone: those that laws use, and from which a stop begins.

    """

    known: Scalar
    stamp: Scalar
    frozen_at: Scalar
    confirmed: Scalar
    elapsed: Scalar
    jumped_at: Scalar
    compared_at: Scalar
    comparisons: Scalar
    accepted: Vector
    jumped: Vector
    refused: Vector
    compared: Vector
    deviation: Vector
    path: Vector
    excess: Vector
    travel: Vector
    wrong: Vector
    derived: Vector
    trusted: Vector

    @classmethod
    def of(cls, array: Vector) -> 'StateMemory':
        """Return the memory of an array, as `packed` makes it."""
        n = (len(array) - ACCEPTED_AT) // sum(SIZES)
        ends = np.cumsum([size * n for size in SIZES])
        return cls(*array[:ACCEPTED_AT], *np.split(array[ACCEPTED_AT:], ends[:-1]))

    @classmethod
    def empty(cls, n: int) -> 'StateMemory':
        """Return the memory of n joints that knows no state."""
        return cls(0.0, NEVER, NEVER, 0.0, 0.0, NEVER, NEVER, 0.0,
                   *[np.zeros(size * n) for size in SIZES])

    def forgotten(self) -> 'StateMemory':
        """Return the memory that compares the next state with no earlier one."""
        still = 0.0 * self.jumped
        return self._replace(known=0.0, stamp=NEVER, frozen_at=NEVER, confirmed=0.0,
                             jumped=still, compared_at=NEVER, comparisons=0.0,
                             deviation=still, path=still, excess=still, travel=still,
                             wrong=still)

    def kept(self, moment: Scalar, state: Vector) -> 'StateMemory':
        """Return the memory with a state, and its stamp, ns."""
        q, u = np.split(state, 2)
        is_compared = flag(self.compared_at < moment + 0.5) * flag(
            moment < self.compared_at + 0.5)
        stated = []
        for j, speed in enumerate(u):
            stated.append(either(is_number(speed), speed, self.derived[j]))
        accepted = np.concatenate([q, either(is_compared, self.trusted, np.array(stated))])
        return self._replace(known=1.0, stamp=moment, frozen_at=NEVER, accepted=accepted,
                             jumped=0.0 * self.jumped)


ACCEPTED_AT = StateMemory._fields.index('accepted')
CONFIRMED = StateMemory._fields.index('confirmed')
SIZES = (2, 1, 1, 2, 1, 1, 1, 1, 1, 1, 1)  # of the arrays, in joints


def state_memory_size(n: int) -> int:
    """Return the number of entries of a `StateMemory` of n joints as an array."""
    return ACCEPTED_AT + sum(SIZES) * n


class CheckSettings(NamedTuple):
    """
    Settings by which a joint state is judged.

    Attributes
    ----------
    timeout : Scalar
        Age, ns, above which a first state confirms no other.
    grace : Scalar
        Time without states, ns, after which a position needs speeds that explain it, or a
        second state.
    longest_gap : Scalar
        Time between two states, ns, above which speeds are not compared with positions.
    compares : Scalar
        Whether a first state needs a second one that agrees.
    compares_speeds : Scalar
        Whether speeds are compared with positions, as for laws that use them.
    turned : (n,) array
        Whether a joint may jump by whole turns.
    bounds : (5 n,) array
        Lower and upper positions, speeds, and the largest change of a position as slope
        and constant.

    """

    timeout: Scalar
    grace: Scalar
    longest_gap: Scalar
    compares: Scalar
    compares_speeds: Scalar
    turned: Vector
    bounds: Vector


def state_fault(state: Vector, bounds: Vector, jumped: Vector, wrong: Vector) -> Scalar:
    """
    Return `ACCEPTED`, or the first fault of a finite state, over any scalar.

    Parameters
    ----------
    state : (2 n,) array
        Positions and velocities.
    bounds : (5 n,) array
        As of `CheckSettings`.
    jumped : (n,) array
        Whether the joints have jumped.
    wrong : (n,) array
        Whether their speeds are known as wrong, so that these are no reason.

    """
    q, u = np.split(state, 2)
    lower, upper, fastest, _, _ = np.split(bounds, 5)
    inside: Scalar = 1.0
    slow: Scalar = 1.0
    near: Scalar = 1.0
    for j in range(len(q)):
        inside = select(between(lower[j], q[j], upper[j]) > 0.5, inside, 0.0)
        is_slow = either(wrong[j], 1.0, between(-fastest[j], u[j], fastest[j]))
        slow = select(is_slow > 0.5, slow, 0.0)
        near = select(jumped[j] > 0.5, 0.0, near)
    # The most basic fault counts: outside the limits, then too fast, then a jump.
    fault = select(near > 0.5, float(ACCEPTED), float(JUMP))
    fault = select(slow > 0.5, fault, float(TOO_FAST))
    return select(inside > 0.5, fault, float(OUTSIDE))


def jumped_joints(memory: StateMemory, moment: Scalar, state: Vector, last: Vector,
                  elapsed: Scalar, settings: CheckSettings) -> Vector:
    """
    Return a flag for each joint that has jumped since the last accepted state, (n,).

    A joint jumps if it moves farther than its speed limit allows. Then it counts as
    jumped for as long as its positions go on from there without another jump, unless its
    mean speed explains where it is. So an offset that stays does not become possible
    when enough time has passed, and a joint that returns is accepted at once. Positions
    that were late and have caught up are explained. After the grace time nothing is: an
    arm that falls or stops may bring a false position to the last accepted one.

    Parameters
    ----------
    memory : StateMemory
        Of the states before.
    moment : Scalar
        Stamp of the state, ns.
    state, last : (2 n,) arrays
        Positions and velocities of the state, and of the one that it is compared with.
    elapsed : Scalar
        Time between both, s.
    settings : CheckSettings
        Of the parameters.

    """
    q, u = np.split(state, 2)
    q_last, u_last = np.split(last, 2)
    _, _, _, slope, step = np.split(settings.bounds, 5)
    since = (moment - memory.jumped_at) / NANO
    since = select(since > 0.0, since, 0.0)
    in_grace = 1.0 - flag(memory.frozen_at > NEVER)
    jumped = []
    for j, turned in enumerate(settings.turned):
        moved = q[j] - q_last[j]
        is_near = within(moved, step[j] + slope[j] * elapsed, turned)
        continues = within(q[j] - memory.refused[j], step[j] + slope[j] * since, turned)
        is_explained = explained(moved, u_last[j] + u[j], elapsed, step[j], turned)
        stays = memory.jumped[j] * continues * (1.0 - in_grace * is_explained)
        jumped.append(either(is_near, stays, 1.0))
    return np.array(jumped)


def is_number(x: Scalar) -> Scalar:
    """Return 0 for NaN, else 1; infinite numbers are numbers."""
    return select(x < 1.0, 1.0, flag(x > 0.0))


def with_absent_speeds(memory: StateMemory, moment: Scalar, state: Vector,
                       settings: CheckSettings) -> tuple[Vector, Vector]:
    """Return the state with speeds from positions for those that are NaN, and where, (n,)."""
    q, u = np.split(state, 2)
    q_last, _ = np.split(memory.compared, 2)
    _, _, fastest, _, _ = np.split(settings.bounds, 5)
    gap = (moment - memory.compared_at) / NANO
    counts = flag(gap > 0.0) * flag(NANO * gap < settings.longest_gap)
    present = np.array([is_number(speed) for speed in u])
    speeds = []
    for j, turned in enumerate(settings.turned):
        rate = _moved(q[j], q_last[j], turned) / either(counts, gap, 1.0)
        smooth = memory.derived[j] + gap / (gap + DERIVED_WITHIN) * (rate - memory.derived[j])
        derived = clipped(either(counts, smooth, 0.0), -fastest[j], fastest[j])
        speeds.append(either(present[j], u[j], derived))
    return np.concatenate([q, speeds]), 1.0 - present


def _moved(q: Scalar, q_last: Scalar, turned: Scalar) -> Scalar:
    """Return the motion of a joint without a whole turn that its angle jumped by."""
    moved = q - q_last
    if is_zero(turned):
        return moved
    whole = select(moved > math.pi, 2.0 * math.pi,
                   select(moved < -math.pi, -2.0 * math.pi, 0.0))
    return moved - turned * whole


def with_compared_speeds(memory: StateMemory, moment: Scalar, state: Vector,
                         settings: CheckSettings, absent: Vector) -> StateMemory:
    """
    Return the memory that has compared the speeds of a state with its positions.

    The mean of two speeds times the time between them is the distance between both
    positions, but for noise, and for a filter that lets speeds come late. Sums over a window
    have neither: speeds that are always zero, of the wrong sign or in another unit differ
    from the positions by half of the path and more. A constant factor between 0.5 and 2 shows
    over a longer time, in the direction of the speeds: a filter of first order leaves this sum
    at zero, because it makes speeds smaller by as much as it makes them late.
    """
    q, u = np.split(state, 2)
    q_last, u_last = np.split(memory.compared, 2)
    _, _, _, slope, step = np.split(settings.bounds, 5)
    gap = (moment - memory.compared_at) / NANO
    left = SPEED_WINDOW / (SPEED_WINDOW + gap)
    left_long = FACTOR_WINDOW / (FACTOR_WINDOW + gap)
    # After a pause the speeds between are not known.
    counts = flag(gap > 0.0) * flag(NANO * gap < settings.longest_gap)
    comparisons = left * (memory.comparisons + counts)
    enough = flag(comparisons > COMPARISONS)
    rows = []
    for j, turned in enumerate(settings.turned):
        moved = _moved(q[j], q_last[j], turned)
        predicted = 0.5 * (u[j] + u_last[j]) * gap
        farther = select(_size(moved) < _size(predicted), _size(predicted), _size(moved))
        # One false speed counts twice, with the one before and after, and must not suffice.
        most = 0.5 * step[j]
        away = clipped(moved - predicted, -most, most)
        # A jump is another fault, or it was accepted as the second of two states.
        reach = step[j] + slope[j] * gap
        reach = select(reach < FARTHEST, reach, FARTHEST)
        near = counts * between(-reach, moved, reach)
        compared = near * (1.0 - absent[j])
        deviation = left * (memory.deviation[j] + either(compared, away, 0.0))
        path = left * (memory.path[j] + either(near, clipped(farther, 0.0, most), 0.0))
        # The same over a longer time, of speeds above the noise.
        moves = compared * flag(SPEED_NOISE * slope[j] * gap < _size(predicted))
        along = select(predicted < 0.0, -away, away)
        excess = left_long * (memory.excess[j] + either(moves, along, 0.0))
        travel = left_long * (memory.travel[j] + either(moves, _size(predicted), 0.0))
        largest = step[j] + LATEST * slope[j] + FACTOR_SHARE * travel
        wrong = either(flag(step[j] + LATE_SHARE * path < _size(deviation)), 1.0,
                       flag(largest < _size(excess)))
        wrong = either(memory.wrong[j], 1.0, wrong * enough * settings.compares_speeds)
        # Speeds from the positions, smoothed, from the first of them on.
        share = gap / (gap + DERIVED_WITHIN)
        rate = moved / either(near, gap, 1.0)
        smooth = memory.derived[j] + share * (rate - memory.derived[j])
        derived = either(near, smooth, either(flag(gap > 0.0), u[j], memory.derived[j]))
        noise = either(flag(slope[j] > 0.0), SPEED_NOISE * slope[j], UNLIMITED)
        is_alone = enough * settings.compares_speeds * flag(
            noise < _size(u[j] - derived)) * flag(noise < _size(u[j] - memory.trusted[j]))
        # Derived speeds are late while an arm accelerates; the mean of two is not.
        mean = 0.5 * (u[j] + u_last[j])
        is_alone = is_alone * flag(0.5 * noise < _size(rate - mean))
        trusted = either(either(wrong, 1.0, is_alone), derived, u[j])
        rows.append([deviation, path, excess, travel, wrong, derived, trusted])
    deviations, paths, excesses, travels, wrong, derived, trusted = np.array(rows).T
    return memory._replace(compared_at=moment, comparisons=comparisons, compared=state,
                           deviation=deviations, path=paths, excess=excesses,
                           travel=travels, wrong=wrong, derived=derived, trusted=trusted)


def _size(x: Scalar) -> Scalar:
    """Return the absolute value."""
    return select(x < 0.0, -x, x)


def explained(moved: Scalar, speeds: Scalar, elapsed: Scalar, step: Scalar,
              turned: Scalar) -> Scalar:
    """Return whether two measured speeds, by their sum, explain how far a joint moved."""
    # The trapezoidal rule: the torque is constant while no state is answered, so the
    # acceleration nearly is.
    predicted = 0.5 * speeds * elapsed
    late = LATE_SHARE * _size(predicted)
    return within(moved - predicted, step + late, turned)


def all_explained(state: Vector, last: Vector, elapsed: Scalar, settings: CheckSettings
                  ) -> Scalar:
    """Return whether measured speeds explain how far each joint moved between two states."""
    q, u = np.split(state, 2)
    q_last, u_last = np.split(last, 2)
    _, _, _, _, step = np.split(settings.bounds, 5)
    every: Scalar = 1.0
    for j, turned in enumerate(settings.turned):
        every = every * explained(q[j] - q_last[j], u_last[j] + u[j], elapsed, step[j],
                                  turned)
    return every


def within(moved: Scalar, distance: Scalar, turned: Scalar) -> Scalar:
    """Return 1 if a joint moved by less than a distance, or may turn and did so, else 0."""
    straight = between(-distance, moved, distance)
    if is_zero(turned):
        return straight
    # Modulo whole turns two angles are as near as their cosine says.
    widest = select(distance < math.pi, distance, math.pi)
    on_circle = turned * flag(np.cos(widest) < np.cos(moved))
    return select(straight > 0.5, 1.0, on_circle)


def between(low: Scalar, x: Scalar, high: Scalar) -> Scalar:
    """Return 1 if a number lies between two others, else 0."""
    return select(low < x, flag(x < high), 0.0)


def judged(memory: StateMemory, moment: Scalar, state: Vector, settings: CheckSettings
           ) -> tuple[Scalar, StateMemory]:
    """
    Judge a state; return the result of its cycle, and the next memory.

    The first state is compared with the next one: a command follows only from two states
    that agree, so that a false first state is not answered. A first state older than the
    timeout confirms no other: meanwhile the arm can have moved anywhere. `kept` makes a
    possible state the last accepted one, after its command.

    After a pause, a joint may be anywhere within its speed limit. A position that the
    measured speeds do not explain is then compared with the next one, as a first state is.

    Parameters
    ----------
    memory : StateMemory
        Of the states before.
    moment : Scalar
        Stamp of the state, ns.
    state : array
        Positions and velocities, (2 n,), then numbers that are only to be finite.
    settings : CheckSettings
        Of the parameters.

    """
    # A state without an earlier one that is recent enough is the first.
    recent = flag(moment - memory.stamp < settings.timeout + 1.0)
    has_earlier = memory.known * either(memory.confirmed, 1.0, recent)
    measured, absent = with_absent_speeds(memory, moment, state[:len(memory.accepted)],
                                          settings)
    last = either(has_earlier, memory.accepted, measured)
    # After a lasting fault, no more than the grace time counts.
    until = select(memory.frozen_at < moment, memory.frozen_at, moment)
    until = either(flag(memory.frozen_at > NEVER), until, moment)
    elapsed = (until - memory.stamp) / NANO
    elapsed = has_earlier * select(elapsed > 0.0, elapsed, 0.0)
    jumped = jumped_joints(memory, moment, measured, last, elapsed, settings)
    fault = state_fault(measured, settings.bounds, jumped, memory.wrong)
    is_finite = finite(measured) * finite(state[len(measured):])
    fault = either(is_finite, fault, float(NOT_FINITE))
    judged_memory = memory._replace(elapsed=elapsed)
    is_possible = flag(fault < 0.5)
    # Speeds beside positions, also where these speeds alone are the fault.
    compares = either(is_possible, 1.0, is_finite * flag(fault < TOO_FAST + 0.5) * flag(
        fault > TOO_FAST - 0.5))
    judged_memory = branch(compares, with_compared_speeds(
        judged_memory, moment, measured, settings, absent), judged_memory)
    with_state = judged_memory.kept(moment, measured)

    # The jump of a state that is not the first is remembered.
    with_jump = judged_memory._replace(jumped_at=moment, jumped=jumped,
                                       refused=measured[:len(jumped)])
    has_jumped = is_finite * has_earlier * flag(sum(jumped) > 0.5)
    refused_memory = branch(has_jumped, with_jump, judged_memory)

    # The second of two states that agree confirms both. Of two that disagree one is
    # false: the next one is compared with the later one.
    disagrees = flag(fault > JUMP - 0.5) * (1.0 - memory.confirmed)
    refused = branch(disagrees, with_state, refused_memory)
    compared = branch(is_possible, judged_memory._replace(confirmed=1.0), refused)
    begun = with_state._replace(confirmed=1.0 - settings.compares)
    first = branch(is_possible, begun, judged_memory)

    # After a pause, the memory begins with a state whose speeds do not explain it.
    after_pause = memory.confirmed * flag(settings.grace < NANO * elapsed)
    doubtful = after_pause * (1.0 - all_explained(measured, last, elapsed, settings))
    doubtful = doubtful * settings.compares * is_possible * has_earlier
    compared = branch(doubtful, begun, compared)

    waits = settings.compares * (1.0 - has_earlier)
    possible = either(waits, float(FIRST), float(ACCEPTED))
    possible = either(doubtful, float(UNEXPLAINED), possible)
    return either(is_possible, possible, fault), branch(has_earlier, compared, first)
