"""
Rules of who commands, the dynamics node or torque_guard, over any scalar.

The guard takes over after guard.lease without a command, and after two states without
one. Until a part of that time has passed, the node may command without asking; later,
and after each activation, it sends a request and is silent until the guard answers that
it is silent too. Without a living guard it commands after a short wait.

Times are nanoseconds of a steady clock, flags 1 or 0; 0 stands for a time that has not
come yet.
"""

from typing import NamedTuple

from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.control_cycle.cycle_results import NANO
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.flags import branch, either, flag

# A message of torque_guard: number of the request that it answers, whether it commanded
# until then, whether the last torques are its own, its identity; then the last torques.
FIELDS = 4
LOST = 0.5  # s without a message after which the guard counts as dead
STOPPED = 0.0  # request number of a node that commanded zeros
# Of the lease, after which the node may no longer command without a request.
SHARE = 0.75
PERIODS = 1.5  # the guard takes over after two periods of the states at the earliest
RELAX = 1.002  # growth of the estimated period for each state
REPEAT = 0.005 * NANO  # between two requests
ANSWER = 0.05 * NANO  # for the answer of a living guard
STALL = 0.02 * NANO  # of a longer time between two requests, this part was a wait
# After configure, for the first heartbeat: Fast DDS may need one of its own.
DISCOVERY = 3.5 * NANO
SILENCE = LOST * NANO  # without a heartbeat, after which the guard counts as dead


class Arbitration(NamedTuple):
    """
    The result of the last rule, and what the node knows of the guard.

    Attributes
    ----------
    permitted : Scalar
        Whether the node may command.
    sends : Scalar
        Whether it sends a request now.
    number : Scalar
        Of the last request.
    answered : Scalar
        Whether a message was the answer to the last request.
    retries : Scalar
        Whether the state that waits for the answer is answered now.
    resumes : Scalar
        Whether the last torques are those of the guard.
    silent : Scalar
        Duration of the last silence of the node.
    returns, unanswered : Scalar
        How often the guard handed the topic back, and how often it did not answer.
    shortest : Scalar
        Shortest silence after which the node asks; 0: there is no guard.
    opened : Scalar
        Time at which the topics were opened.
    seen, guard : Scalar
        Time of the last heartbeat, and identity of the guard.
    last : Scalar
        Time of the last command.
    arrived, period : Scalar
        Time of the last state, and estimate of their period.
    asked : Scalar
        Whether a request has no answer yet.
    sent, repeated : Scalar
        First and last time at which it was sent.
    waited : Scalar
        Time of waiting for the answer, without stalls of this process.

    """

    permitted: Scalar
    sends: Scalar
    number: Scalar
    answered: Scalar
    retries: Scalar
    resumes: Scalar
    silent: Scalar
    returns: Scalar
    unanswered: Scalar
    shortest: Scalar
    opened: Scalar
    seen: Scalar
    guard: Scalar
    last: Scalar
    arrived: Scalar
    period: Scalar
    asked: Scalar
    sent: Scalar
    repeated: Scalar
    waited: Scalar


SIZE = len(Arbitration._fields)
PERMITTED, UNANSWERED = map(Arbitration._fields.index, ('permitted', 'unanswered'))
# Without a guard every command is permitted.
UNGUARDED = Arbitration(1.0, *[0.0] * (SIZE - 1))


def begun(known: Arbitration, lease: float, now: float, number: float) -> Arbitration:
    """Return the state of a node that starts, and asks before its first command."""
    return UNGUARDED._replace(permitted=0.0, number=number, shortest=SHARE * lease,
                              opened=known.opened, seen=known.seen, guard=known.guard,
                              asked=1.0, repeated=now - REPEAT)


def before_command(last: Arbitration, now: Scalar) -> Arbitration:
    """Decide whether the node may command at a state that arrived now."""
    # Two states at once do not make the period unknown, which is 0.
    gap = now - last.arrived
    gap = select(gap < 1.0, 1.0, gap)
    relaxed = RELAX * last.period
    shrunk = select(gap < relaxed, gap, relaxed)
    period = either(flag(last.period > 0.0), shrunk, gap)
    period = either(flag(last.arrived > 0.0), period, last.period)
    decided = before_zeros(last._replace(arrived=now, period=period), now)
    return decided._replace(last=either(decided.permitted, now, decided.last))


def before_zeros(last: Arbitration, now: Scalar) -> Arbitration:
    """Decide whether the node may command zeros because states are stale."""
    # The guard may command after its lease and after two states without a command.
    gap = now - last.last
    may_have_taken_over = flag(last.shortest < gap) * flag(PERIODS * last.period < gap)
    must_ask = may_have_taken_over * _lived(last)
    free = last._replace(permitted=1.0, sends=0.0)
    decided = branch(must_ask, _asking(last, now), free)
    return branch(last.asked, _waiting(last, now), decided)


def after_computing(last: Arbitration, now: Scalar) -> Arbitration:
    """Decide whether computing the command was not interrupted for too long."""
    interrupted = flag(last.shortest < now - last.last) * _lived(last)
    free = last._replace(permitted=1.0, sends=0.0)
    return branch(interrupted, _asking(last, now), free)


def heard(last: Arbitration, numbers: Vector, now: Scalar) -> Arbitration:
    """Note a heartbeat, or the answer to the last request; `numbers` as ~/guard_state."""
    number, acting, commanded, guard = numbers[:FIELDS]
    last = last._replace(sends=0.0, answered=0.0, retries=0.0, resumes=0.0)
    is_first = 1.0 - flag(last.seen > 0.0)
    alive = last._replace(seen=now, guard=guard)

    # The answer: the topic is handed over. The guard counts its lease from the request.
    is_answer = last.asked * (1.0 - flag(number < last.number)) * (
        1.0 - flag(last.number < number))
    handed_over = alive._replace(
        asked=0.0, last=last.sent, answered=1.0, retries=1.0 - acting, resumes=commanded,
        silent=now - last.last, returns=last.returns + commanded * acting)
    # The state that was kept does not arrive a second time.
    handed_over = branch(handed_over.retries, handed_over._replace(arrived=0.0),
                         handed_over)
    # Only now an answer is sure to arrive.
    asks_again = last.asked * is_first
    noted = branch(is_answer, handed_over, branch(asks_again, _asking(alive, now), alive))

    # A second guard stops when it finds the first one.
    is_second = flag(guard > last.guard) * flag(last.guard > 0.0) * flag(
        now - last.seen < SILENCE)
    return branch(is_second, last, noted)


def _lived(last: Arbitration) -> Scalar:
    """Return whether a guard lived at the last command; one that was lost is silent."""
    return flag(last.shortest > 0.0) * flag(last.last - last.seen < SILENCE)


def _asking(last: Arbitration, now: Scalar) -> Arbitration:
    """Return the state of a node that asks a new question."""
    asking = last._replace(asked=1.0, number=last.number + 1.0, sent=0.0,
                           repeated=now - REPEAT, waited=0.0)
    return _sending(asking, now)


def _waiting(last: Arbitration, now: Scalar) -> Arbitration:
    """Return the state of a node that waits, or gives up waiting, for an answer."""
    # Discovery takes seconds; a guard that was heard answers at once.
    silent_for_long = flag(last.waited > ANSWER)
    not_discovered = flag(now - last.opened > DISCOVERY)
    gives_up = either(flag(last.seen > 0.0), silent_for_long, not_discovered)
    alone = last._replace(permitted=1.0, sends=0.0, asked=0.0, last=now,
                          unanswered=last.unanswered + 1.0)
    return branch(gives_up, alone, _sending(last, now))


def _sending(last: Arbitration, now: Scalar) -> Arbitration:
    """Return the state after a cycle, which sends a request every `REPEAT`."""
    since = now - last.repeated
    # To a guard that can answer.
    sends = flag(last.seen > 0.0) * (1.0 - flag(since < REPEAT))
    # A stall of this process is no silence of the guard.
    counted = select(since < STALL, since, STALL)
    sent = last._replace(permitted=0.0, sends=1.0, waited=last.waited + counted,
                         sent=either(flag(last.sent > 0.0), last.sent, now), repeated=now)
    return branch(sends, sent, last._replace(permitted=0.0, sends=0.0))
