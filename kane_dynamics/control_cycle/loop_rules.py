"""
The rules of closed loops in a torque path, as functions over any scalar.

The measured joints of an accepted state determine all others: a search (`SearchRules`)
follows them, call by call, and so does a second search for the desired configuration of
a motion, where the law needs it. Both are part of the state of the path.
"""

from typing import NamedTuple

from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.control.stopping import reached_state, stopping_motion
from kane_dynamics.control.terms import Terms
from kane_dynamics.control.traced_laws import (Actuation, commanded_torques, Desired,
                                               followed_feedforward, TracedLaw)
from kane_dynamics.control_cycle.cycle_results import (ACCEPTED, CONTRADICTORY, NANO,
                                                       NEAR_SINGULAR, NEVER, NO_MODE,
                                                       OFF_BRANCH, REFUSED)
from kane_dynamics.control_cycle.cycle_rules import (begun_stop, CycleSettings,
                                                     desired_motion, Event, LOOP_LIMITS,
                                                     PathState, torques_within_limits)
from kane_dynamics.loop_tracking.loop_tracker import (DEVIATING, ILL_CONDITIONED,
                                                      largest_square, LoopSearch,
                                                      MeasuredJoints, search_places,
                                                      search_size, SearchRules,
                                                      UNKNOWN_MODE, unpacked_search)
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.flags import branch, either, flag, packed
from kane_dynamics.robot.robot import Robot
import numpy as np

REACH = 2.0  # times its last speed, an arm moves until the next state at most
STANDSTILL = 1e-3  # rad, or lengths of the mechanism: noise of positions at rest


class LoopMemory(NamedTuple):
    """
    Memory of the path for closed loops, in `PathState.loops`.

    Attributes
    ----------
    measured, desired : arrays
        The searches for the measured and the desired configuration.
    before : (n_q,) array
        The accepted configuration before the last.
    earlier, latest : Scalar
        Stamps of both, ns; `NEVER` without one.
    singular : Scalar
        Whether the last refused state was near a singular configuration.
    tracking : Scalar
        Whether the desired configuration goes on from that of the cycle before.
    target : (2 n,) array
        Desired positions and rates of the joints that follow.

    """

    measured: Vector
    desired: Vector
    before: Vector
    earlier: Scalar
    latest: Scalar
    singular: Scalar
    tracking: Scalar
    target: Vector


def loop_size(n_q: int, n: int) -> int:
    """Return the number of entries of a `LoopMemory` as an array."""
    return 2 * search_size(n_q, n) + n_q + 4 + 2 * n


def unpacked_loops(array: Vector, n_q: int, n: int) -> LoopMemory:
    """Return the `LoopMemory` of an array."""
    search = search_size(n_q, n)
    parts = np.split(array, np.cumsum([search, search, n_q, 4]))
    measured, desired, before, (earlier, latest, singular, tracking), target = parts
    return LoopMemory(measured, desired, before, earlier, latest, singular, tracking,
                      target)


def initial_loops(search: Vector, n_q: int, n: int) -> Vector:
    """Return the memory of a path that starts with a search, of a `LoopTracker`."""
    q = search[search_places(n_q, n).q]
    return packed(LoopMemory(search, 0.0 * search, q, NEVER, NEVER, 0.0, 0.0,
                             np.zeros(2 * n)))


class LoopRules:
    """
    The rules of an arm with closed loops.

    Parameters
    ----------
    robot : Robot
        With constraints on positions that do not depend on time.
    terms : Terms
        Terms of the command.
    joints : Actuation

    """

    def __init__(self, robot: Robot, terms: Terms, joints: Actuation) -> None:
        self.robot = robot
        self.joints = joints
        self.size = loop_size(robot.n_q, robot.n)
        self._terms = terms
        self._search = SearchRules(robot, joints.followed)
        self._units = robot.mechanism.units

    def memory(self, path: PathState) -> LoopMemory:
        """Return the memory of the loops in a path."""
        return unpacked_loops(path.loops, self.robot.n_q, self.robot.n)

    def search(self, array: Vector) -> LoopSearch:
        """Return a search of the memory."""
        return unpacked_search(array, self.robot.n_q, self.robot.n)

    # The measured configuration.

    def measured(self, path: PathState) -> tuple[Vector, Vector]:
        """Return the measured configuration and its speeds."""
        search = self.search(self.memory(path).measured)
        return search.q, search.u

    def close(self, path: PathState, event: Event, state: Vector,
              settings: CycleSettings) -> PathState:
        """Close the loops at a state that was judged; mostly this one call is enough."""
        before = self.search(self.memory(path).measured)
        limits = settings.loop_limits[:LOOP_LIMITS]
        after = self._search.begun(before, self._measurement(path, state), limits, 0.0)
        return self._after(path, before, after)

    def go_on_closing(self, path: PathState, event: Event, state: Vector,
                      settings: CycleSettings) -> PathState:
        """Return the path after one more call of the search."""
        before = self.search(self.memory(path).measured)
        limits = settings.loop_limits[:LOOP_LIMITS]
        after = self._search.continued(before, self._measurement(path, state), limits,
                                       0.0)
        return self._after(path, before, after)

    def _measurement(self, path: PathState, state: Vector) -> MeasuredJoints:
        """Return the measurement of a state, with speeds that its positions confirm."""
        n, n_q = self.robot.n, self.robot.n_q
        positions, _, seen, weights = np.split(state, np.cumsum([n, n, n_q]))
        return MeasuredJoints(positions, path.states.trusted, seen, weights)

    def _after(self, path: PathState, before: LoopSearch, after: LoopSearch) -> PathState:
        """Return the path after a call, with the reason if the state is refused."""
        memory = self.memory(path)
        moment = path.last_heard
        # A search may need several calls; only its last one changes the memory.
        ended = 1.0 - after.searching
        reached = ended * flag(after.outcome < 0.5)
        lost = ended * before.known * (1.0 - after.known)
        # A false state near a singular configuration does not change the assembly mode.
        since_before = memory.latest - memory.earlier
        is_known = flag(memory.earlier > NEVER)
        may_be = may_be_singular(before, memory.before, self._units,
                                 either(is_known, since_before, NANO),
                                 moment - memory.latest)
        may_be = either(is_known, may_be, 1.0)
        # The assembly mode is known only as long as no state could have been singular.
        after = after._replace(known=either(lost, 1.0 - may_be, after.known))
        kept = memory._replace(
            measured=packed(after),
            before=either(reached, before.q, memory.before),
            earlier=either(reached, memory.latest, memory.earlier),
            latest=either(reached, moment, memory.latest),
            singular=either(lost, 1.0, memory.singular * (1.0 - reached)))
        reason = either(ended, result_of(after), float(ACCEPTED))
        return path._replace(loops=packed(kept), searching=after.searching, reason=reason)

    def given_up(self, path: PathState) -> PathState:
        """Return the path whose states are refused for long, maybe near a singularity."""
        memory = self.memory(path)
        measured = self.search(memory.measured)
        known = measured.known * (1.0 - memory.singular)
        kept = memory._replace(measured=packed(measured._replace(known=known)))
        return path._replace(loops=packed(kept))

    # The desired configuration.

    def aim(self, path: PathState, event: Event, state: Vector, row: Vector,
            settings: CycleSettings, law: TracedLaw) -> PathState:
        """Begin the search for the configuration of the desired motion, if there is one."""
        q = state[:self.robot.n]
        desired = desired_motion(path, event, row, settings, q, law.holds)
        aimed = self._aimed(path, desired, settings)
        return branch(desired.moving, aimed, path)

    def go_on_aiming(self, path: PathState, settings: CycleSettings) -> PathState:
        """Return the path after one more call of the search."""
        memory = self.memory(path)
        before = self.search(memory.desired)
        limits = settings.loop_limits[LOOP_LIMITS:]
        after = self._search.continued(before, self._target(memory), limits, 0.0)
        return self._after_aiming(path, memory, after)

    def _aimed(self, path: PathState, desired: Desired, settings: CycleSettings
               ) -> PathState:
        """Return the path after the first call of the search for a desired motion."""
        memory = self.memory(path)
        # The first one goes on from the measured configuration, on its branch.
        tracking = memory.tracking * (1.0 - path.untracked)
        begin = self.search(either(tracking, memory.desired, memory.measured))
        target = np.concatenate([desired.q, desired.u])
        memory = memory._replace(target=target)
        limits = settings.loop_limits[LOOP_LIMITS:]
        after = self._search.begun(begin, self._target(memory), limits, 0.0)
        return self._after_aiming(path._replace(untracked=0.0), memory, after)

    def _target(self, memory: LoopMemory) -> MeasuredJoints:
        """Return the desired positions and rates, as if they were measured."""
        positions, rates = np.split(memory.target, 2)
        nothing = np.zeros(self.robot.n_q)
        return MeasuredJoints(positions, rates, nothing, nothing)

    def _after_aiming(self, path: PathState, memory: LoopMemory, after: LoopSearch
                      ) -> PathState:
        """Return the path after a call of the search for a desired configuration."""
        ended = 1.0 - after.searching
        refused = ended * flag(after.outcome > 0.5)
        kept = memory._replace(desired=packed(after), tracking=1.0 - refused)
        # During a stop the reason is that of the refused state.
        reason = either(refused * (1.0 - path.stops), float(REFUSED), path.reason)
        return path._replace(loops=packed(kept), searching=after.searching, reason=reason)

    def whole(self, path: PathState, desired: Desired) -> Desired:
        """Return a desired motion with the configuration that was found for it."""
        found = self.search(self.memory(path).desired)
        q, u = self.measured(path)
        return desired._replace(configuration=either(desired.moving, found.q, q),
                                speeds=either(desired.moving, found.u, u))

    # The stop in a fault.

    def reached(self, path: PathState, elapsed: Scalar, parameters: Vector) -> Vector:
        """Return positions and rates of the joints that follow, some time later."""
        tau = np.zeros(self.robot.n_q, dtype=object)
        tau[list(self.joints.commanded)] = path.tau
        places = list(self.joints.followed)
        return np.concatenate(reached_state(self.robot, self._terms, places,
                                            *self.measured(path), tau, elapsed, parameters))

    def begin_hold(self, path: PathState, settings: CycleSettings, parameters: Vector
                   ) -> PathState:
        """Begin the search for the configuration of the stop."""
        desired = self._stop(path, settings)
        return self._aimed(path._replace(stops=1.0), desired, settings)

    def hold(self, path: PathState, settings: CycleSettings, parameters: Vector,
             limits: Vector) -> PathState:
        """Command the torque of the stop, or the last one where there is none."""
        # The desired state of the stop, with all joints by its closed loops.
        desired = self.whole(path, self._stop(path, settings))
        force = followed_feedforward(self.robot, self._terms, self.joints, desired,
                                     parameters)
        assert desired.configuration is not None
        if self._terms.arm is not None:
            force = force - self._terms.arm.force(self.robot, desired.configuration,
                                                  parameters)
        torque = commanded_torques(self.robot, self.joints, force, desired.configuration,
                                   limits)
        # Loops that do not close along the stop leave the last torque.
        search = self.search(self.memory(path).desired)
        held = torques_within_limits(path, torque, settings)
        found = path.stops * flag(search.outcome < 0.5)
        return branch(found, held, path)

    def _stop(self, path: PathState, settings: CycleSettings) -> Desired:
        """Return the motion of the stop at the time of the last state."""
        q_d, u_d, udot_d = stopping_motion(*begun_stop(path, settings))
        return Desired(q_d, u_d, udot_d, 1.0)


def may_be_singular(search: LoopSearch, before: Vector, units: Vector,
                    between: Scalar, since: Scalar) -> Scalar:
    """
    Return whether an arm can be at a singular configuration by now, over any scalar.

    The distance is one over the conditioning figure of the last state. The arm moves at
    most `REACH` times as fast as there: as measured, or as from the state before.

    Parameters
    ----------
    search : LoopSearch
        With the last accepted state, whose speeds are rates of the measured joints.
    before : (n_q,) array
        The accepted configuration before it.
    units : (n_q,) array
        Of the coordinates: 1 rad, or the length of the mechanism.
    between, since : Scalar
        Time between both states, and since the last, ns.

    """
    rates = search.T.reshape(-1, len(search.u)) @ search.u
    # Both states may have one stamp, or the clock may have jumped backward between them.
    between = select(between > 1.0, between, 1.0)
    change = (search.q - before) * (NANO / between)
    speed_2 = largest_square(np.concatenate([rates / units, change / units]))
    reached = REACH * np.sqrt(speed_2) * since / NANO + STANDSTILL
    # 1 / figure <= reached
    return flag(reached * reached * search.figure > 1.0)


def result_of(search: LoopSearch) -> Scalar:
    """Return the result of a cycle for the outcome of its search."""
    # The outcomes are numbered by reason: see `REASONS` of the tracker.
    outcome = search.outcome
    reason = either(flag(outcome < ILL_CONDITIONED + 0.5), float(NEAR_SINGULAR),
                    float(OFF_BRANCH))
    reason = either(flag(outcome > DEVIATING - 0.5), float(CONTRADICTORY), reason)
    reason = either(flag(outcome > UNKNOWN_MODE - 0.5), float(NO_MODE), reason)
    return either(flag(outcome < 0.5), float(ACCEPTED), reason)
