"""
Exact Coulomb friction of `simulate`, with the times at which joints stick and break away.

Between two transitions the directions of sliding and the joints that stick are constant,
and native steps compute the motion (`sticking_kernel`). In a step with a transition, its
time is a root of a function along that step: the rate of a joint that slides, the margin
to breakaway of a joint that sticks, or the distance from a stop. There the complementarity
problem of `friction_state` says how the joints move on, and the rest of the step follows
in the same way.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.joint_stops import nearest_stops, resolve_stops
from kane_dynamics.native.runtime.event_loop import EVENT, EventKernels, follow
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.energy_balance import energy_kernel
from kane_dynamics.simulation.observers import Extremes, Impact
from kane_dynamics.simulation.step_kernels import state_layout, state_names, StepChoice
from kane_dynamics.simulation.sticking.friction_samples import exact_friction
from kane_dynamics.simulation.sticking.friction_state import (bounds, friction_state,
                                                              FrictionModes,
                                                              FrictionState)
from kane_dynamics.simulation.sticking.sticking_kernel import mode_rows, sticking_kernel
from kane_dynamics.simulation.sticking.transition_kernel import (BEGIN, CALLS,
                                                                 loop_places, MARGIN,
                                                                 MOST, phase_kernels,
                                                                 phase_places, ROOT,
                                                                 settled_modes, SHORT,
                                                                 START)
from kane_dynamics.simulation.stops.contact_forces import admissible_state
from kane_dynamics.simulation.torque_input import TorqueInput
from kane_dynamics.simulation.trajectory import StopEvent
import numpy as np

LEAST = 1e-300  # N m or N


class _Event(NamedTuple):
    """Functions that are negative past a transition, (k,) each; infinite where none is."""

    reversal: Array  # of the rate of a joint that slides
    forward: Array  # margin of a held joint to sliding forward, N m or N
    backward: Array
    stops: Array  # distance from the nearer stop, rad or m
    locking: Array  # torque that drives a self-locking joint which slides, N m or N

    def flat(self) -> Array:
        """Return all functions, (5 k,)."""
        return np.concatenate(self)


def _kernels(choice: StepChoice, contact: FrictionState) -> EventKernels:
    """Return the kernels of one choice of the step, which slides or also sticks."""
    # Kernels are kept with the robot: many simulations use the same.
    # The stops themselves are arguments.
    key = 'sticking', choice.needed(contact.robot), contact.stops, tuple(contact.joints)
    kept = contact.robot.kernels.kept
    if key not in kept:
        kept[key] = EventKernels(sticking_kernel(choice, contact, holds=False),
                                 sticking_kernel(choice, contact, holds=True),
                                 *phase_kernels(choice, contact))
    kernels: EventKernels = kept[key]
    return kernels


def compile_sticking_steps(robot: Robot, integrator: str, followed: Sequence[int],
                           stops: bool) -> None:
    """Compile the kernels of `Sticking` with and without feedback, as `step_kernel`."""
    for feedback in (False, True):
        compile_sticking(robot, StepChoice(feedback, integrator, None, followed), stops)


def compile_sticking(robot: Robot, choice: StepChoice, stops: bool) -> None:
    """Compile the kernels of `Sticking` for one choice of the step."""
    state = friction_state(robot, stops, choice.needed(robot).dual_to)
    if state.joints:
        exact_friction(robot, stops).compile_kernels()
        energy_kernel(robot, True)
        _kernels(choice, state)


class Sticking:
    """
    Set-valued friction, and the stops if they act, of N simulations of one robot.

    It has the interface of `stops.joint_stops.JointStops`.

    Parameters
    ----------
    robot : Robot
    step, start : float
        s.
    stops : bool
        Whether there are stops at the position limits.

    Attributes
    ----------
    changed : bool
        Whether joints began or ended to slide, or hit stops, in the last step of
        `step_end`.

    """

    def __init__(self, robot: Robot, step: float, start: float, stops: bool) -> None:
        """Begin without transitions."""
        self._robot, self._step, self._start = robot, step, start
        self.stops = stops
        self.changed = False
        self._states: dict[Robot, FrictionState] = {}
        self._kernels: dict[Robot, EventKernels] = {}
        self._impacts: dict[int, dict[int, list[tuple[float, float]]]] = {}
        self._hits: dict[int, list[tuple[int, StopEvent]]] = {}
        self._events: list[StopEvent] = []

    def state_of(self, source: TorqueInput) -> FrictionState:
        """Return the friction of the robot of a source, in its speeds."""
        key = source.robot
        if key not in self._states:
            dual_to = source.choice.needed(source.robot).dual_to
            self._states[key] = friction_state(source.robot, self.stops, dual_to)
        return self._states[key]

    def _kernels_of(self, source: TorqueInput) -> EventKernels:
        """Return the kernels of the steps of a source."""
        key = source.robot
        if key not in self._kernels:
            self._kernels[key] = _kernels(source.choice, self.state_of(source))
        return self._kernels[key]

    def advance(self, source: TorqueInput, buffer: Array, done: int) -> Extremes | None:
        """Compute the states after each step; arguments as of `JointStops.advance`."""
        simulations = source.simulations
        if simulations is None:
            simulations = range(len(buffer))
        # Each simulation has its own transitions, and is stepped by itself.
        for row, i in enumerate(simulations):
            self._forget(i, done)
            self._follow(source.alone(row), i, buffer[row], done)
        # A single simulation needs no extremes: its watchers read the rows.
        if source.single:
            return None
        return buffer[:, 1:].min(axis=1), buffer[:, 1:].max(axis=1)

    def _forget(self, i: int, done: int) -> None:
        """Forget the impacts of simulation i after `done` steps: they are computed again."""
        if i in self._impacts:
            self._impacts[i] = {step: impacts for step, impacts in self._impacts[i].items()
                                if step <= done}
            self._hits[i] = [hit for hit in self._hits[i] if hit[0] <= done]

    def settle(self, done: int) -> list[Impact]:
        """Close the impacts so far and return them; as `JointStops.settle`."""
        settled = []
        # Steps count from the begin of the simulation, impacts from that of the buffer.
        for i, steps in self._impacts.items():
            for step, impacts in steps.items():
                for loss, unresolved in impacts:
                    settled.append(Impact(step - done - 1, i, loss, unresolved))
            self._events += [event for _, event in self._hits[i]]
        self._impacts.clear()
        self._hits.clear()
        return settled

    def events(self, single: bool) -> tuple[StopEvent, ...]:
        """Return the impacts on stops so far, in order of time."""
        events = sorted(self._events)
        if single:
            events = [event._replace(state=None) for event in events]
        return tuple(events)

    def step_end(self, source: TorqueInput, state: Array, free: Array) -> Array:
        """Return the state after the first step of one simulation; `free` is not used."""
        buffer = np.stack([state, state])
        self._forget(0, 0)
        self._follow(source, 0, buffer, 0)
        self.changed = bool(self.settle(0))
        end: Array = buffer[1]
        return end

    # The steps of one simulation.

    def _follow(self, source: TorqueInput, i: int, rows: Array, done: int) -> None:
        """Compute the states of simulation i after each step, (K + 1, size)."""
        path = _Path(source, self.state_of(source), self._kernels_of(source), self._step,
                     self._start)
        at, end = 0, len(rows) - 1
        modes: FrictionModes | None = None
        while at < end:
            computed, refused, modes = path.follow(rows[at:], done + at, modes)
            size = rows.shape[1]
            events = np.flatnonzero(computed[1:, size + 1] == EVENT)
            for row in events.tolist():
                # The power of friction has a kink at each transition, which the energy
                # balance does not see between the ends of the step.
                power = float(computed[row + 1, size])
                self._record(path, i, done + at + row, self._step,
                             _Hit([], 0.0, 0.5 * self._step * power))
            rows[at + 1:at + len(computed)] = computed[1:, :size]
            at += len(computed) - 1
            if refused is not None:  # diverged, or continued in other speeds
                rows[at + 1:] = refused
                return
            if at < end:
                rows[at + 1], modes = self._through(path, i, rows[at], done + at, modes)
                at += 1

    def _through(self, path: '_Path', i: int, state: Array, step: int,
                 modes: FrictionModes | None) -> tuple[Array, FrictionModes]:
        """
        Return the state after a step with transitions, and the modes there.

        `modes` are those at its beginning, None if they are not known.
        """
        if modes is None:
            modes = path.modes(state, step)
        passed = 0.0  # of the step, s
        left = self._step
        power = path.friction_power(state, step, passed, modes)
        for _ in range(MOST):
            end = path.part(state, step, passed, left, modes)
            if not path.happens(end, step, passed + left, modes):
                # The power of friction has a kink at each transition, which the energy
                # balance does not see between the ends of the step.
                power = power + path.friction_power(end, step, self._step, modes)
                self._record(path, i, step, self._step,
                             _Hit([], 0.0, 0.5 * self._step * power))
                return end, modes
            time, which = path.first(state, step, passed, left, modes)
            state = path.part(state, step, passed, time, modes)
            passed += time
            state, modes, loss = path.transition(state, step, passed, modes, which,
                                                 at_once=time == 0.0)
            if loss is not None:
                self._record(path, i, step, passed, loss)
            left = self._step - passed
            if left <= SHORT * self._step:
                self._record(path, i, step, self._step,
                             _Hit([], 0.0, 0.5 * self._step * power))
                return state, modes
        t = self._start + step * self._step
        remedy = 'a shorter step'
        if time == 0.0:
            remedy = 'smooth friction, since the last ones are at one instant'
        raise InputError(f'sticking: more than {MOST} transitions of joints between sticking '
                         f'and sliding in the step at {t:.6g} s; expected {remedy}')

    def _record(self, path: '_Path', i: int, step: int, passed: float,
                hit: '_Hit') -> None:
        """Record an impact on stops within a step, or the kinks of the power there."""
        impacts = self._impacts.setdefault(i, {})
        impacts.setdefault(step + 1, []).append((hit.loss, hit.unresolved))
        events = self._hits.setdefault(i, [])
        t = self._start + step * self._step + passed
        for joint, limit, speed in hit.joints:
            events.append((step + 1, StopEvent(t, joint, limit, speed, hit.loss, i)))


class _Hit(NamedTuple):
    """An impact: joint, 'lower' or 'upper', and speed of each hit; energies, J."""

    joints: list[tuple[str, str, float]]
    loss: float
    unresolved: float


class _Path:
    """The motion of one simulation within and across steps, in given modes."""

    def __init__(self, source: TorqueInput, contact: FrictionState, kernels: EventKernels,
                 step: float, start: float) -> None:
        """Store the kernels of steps."""
        self.source = source
        self.contact = contact
        self._step = step
        self._start = start
        self._n_q = source.robot.n_q
        self._n = source.robot.n
        self._places = phase_places(len(state_names(source.robot)), len(contact.joints))
        # The length of the step is the constant after the gains.
        self._place_of_step = 2 * source.robot.n if source.follows else 0
        self._kernels = kernels

    def modes(self, state: Array, step: int, passed: float = 0.0,
              sliding: dict[int, float] | None = None) -> FrictionModes:
        """Return how the joints move from a state on, `passed` s after a step's beginning."""
        if not (self.contact.locks or passed or sliding):
            settled = self._settled(state, step)
            if settled is not None:
                return settled
        tau, t = self._torque(state, step, passed)
        return self.contact.modes(state, tau, t, sliding)

    def follow(self, states: Array, done: int, modes: FrictionModes | None
               ) -> tuple[Array, Array | None, FrictionModes | None]:
        """
        Compute steps and their transitions in native code, as far as it can.

        Parameters
        ----------
        states : (K + 1, size) array
            With the first state, after `done` steps.
        done : int
            Number of earlier steps.
        modes : FrictionModes or None
            At the first state, if they are known.

        Returns
        -------
        (1 to K + 1, size + 2) array
            As `event_loop.follow`.
        (size,) array or None
            The next state, if it is not accepted.
        FrictionModes or None
            At the last computed state, if they are known.

        """
        count = len(states) - 1
        size = states.shape[1]
        rows = np.empty((count + 1, size + 2))
        rows[0, :size] = states[0]

        # Searches in native code do not know self-locking joints: their modes are found
        # here, and the first step with a transition ends the loop.
        contact = self.contact
        calls = CALLS
        if contact.locks:
            calls = 0
            if modes is None:
                modes = self.modes(states[0], done)

        # The row of the search, from which the first step reads the modes.
        places = self._places
        search = np.zeros(places.end + 1)
        search[places.lower], search[places.upper] = contact.finite_stops
        if modes is not None:
            search[places.directions], search[places.sides] = modes
            search[places.holds] = modes.held.any()

        margin: int | None = None
        if self.source.robot.equations.watched:
            margin = size - 1
        computed, refused = follow(
            self._kernels, loop_places(places), search, rows,
            self.source.inputs(done, count)[0], self.source.constants,
            phases=(START, BEGIN), limit=calls, has_modes=modes is not None, margin=margin)
        refused_state: Array | None = None
        if refused:
            refused_state = rows[computed + 1, :size]

        # The begin of a step shows whether held joints broke away in the last one. After the
        # last step it is examined here.
        if computed == count and rows[count, size + 1] != EVENT and search[places.holds]:
            now = FrictionModes(search[places.directions], search[places.sides])
            if self.happens(rows[count, :size], done + count - 1, self._step, now):
                return rows[:count], None, now
        return rows[:computed + 1], refused_state, None

    def _settled(self, state: Array, step: int) -> FrictionModes | None:
        """Return the modes at the beginning of a step, or None without a solution."""
        # The search settles first: which joints stick, given the forces at the
        # beginning.
        # The inputs of the beginning of the step, at all of its moments.
        inputs = self.source.inputs(step, 1)[0, 0]
        at_begin = np.tile(inputs[:1], (len(inputs), 1))
        return settled_modes(self._kernels.early, self.contact, state, at_begin,
                             self.source.constants, self._step)

    def part(self, state: Array, step: int, passed: float, length: float,
             modes: FrictionModes) -> Array:
        """Return the state after a part of a step, `passed` s after its beginning."""
        constants = self.source.constants.copy()
        # The step's kernel, with a part's length and the inputs at its own moments.
        constants[self._place_of_step] = length
        inputs = self.source.inputs_within(step, passed, length)
        kernel = self._kernels.special if modes.held.any() else self._kernels.plain
        rows = np.empty((1, len(state) + 2))
        kernel.scan([state, inputs[0, 0], mode_rows(self.contact, modes)], rows,
                    constants=constants)
        end: Array = rows[0, :len(state)]
        return end

    def _torque(self, state: Array, step: int, passed: float) -> tuple[Array, float]:
        """Return the torque at a state, and the time, s."""
        t = self._start + step * self._step + passed
        return self.source.torque_within(state, step, passed), t

    def friction_power(self, state: Array, step: int, passed: float,
                       modes: FrictionModes) -> float:
        """Return the power of the friction of the joints that slide, W."""
        tau, t = self._torque(state, step, passed)
        forces = self.contact.forces(state, tau, modes.directions, t)
        of_joints = forces.friction[self.contact.joints] * forces.v
        return float(np.abs(of_joints[~modes.held]).sum())

    # Transitions.

    def _functions(self, state: Array, step: int, passed: float, modes: FrictionModes) -> Array:
        """Return the functions of `_Event` at a state, (5 k,)."""
        contact = self.contact
        k = len(contact.joints)
        # Functions that are not watched stay infinite.
        reversal, forward, backward, stops, locking = np.full((5, k), np.inf)
        tau, t = self._torque(state, step, passed)
        forces = contact.forces(state, tau, modes.directions, t)
        held = modes.held
        reversal[~held] = modes.directions[~held] * forces.v[~held] + contact.slow[~held]
        # A joint at its bound that begins to move slides from then on.
        still = np.abs(modes.directions) > 1.5
        reversal[still] = 2.0 * contact.slow[still] - np.abs(forces.v[still])
        # Held joints: how far their forces are from either bound.
        f = forces.holding(held)
        least, largest = bounds(forces, modes.sides)
        rounding = MARGIN * np.abs(f)
        forward[held] = (f - least + rounding)[held]
        backward[held] = (largest - f + rounding)[held]
        # Free joints: the distance to the nearer stop.
        if contact.stops:
            x = np.where(contact.places < 0, 0.0, state[contact.places])
            free = (modes.sides == 0.0) & (contact.places >= 0)
            distance = np.minimum(x - contact.lower, contact.upper - x)
            stops[free] = distance[free]
        if contact.locks:
            # Zero, as of a motor without torque, is past the transition.
            locking[~held] = forces.driving[~held] - LEAST
        return _Event(reversal, forward, backward, stops, locking).flat()

    def happens(self, state: Array, step: int, passed: float, modes: FrictionModes) -> bool:
        """Return whether a transition happened before a state."""
        return bool((self._functions(state, step, passed, modes) < 0.0).any())

    def first(self, state: Array, step: int, passed: float, left: float,
              modes: FrictionModes) -> tuple[float, Any]:
        """
        Return the time of the first transition in the rest of a step, s, and which it is.

        The transitions are numbers among the 5 k functions.
        """
        def functions(length: float) -> Array:
            end = self.part(state, step, passed, length, modes)
            return self._functions(end, step, passed + length, modes)
        # Each function is compared with its own size, since torques and distances have
        # different units.
        at_begin = self._functions(state, step, passed, modes)
        at_end = functions(left)
        finite = np.isfinite(at_end)
        size = np.where(finite, np.maximum(np.abs(at_begin), np.abs(at_end)), 1.0)
        size = np.where(size > 0.0, size, 1.0)

        # The first transition is where the least of all functions becomes negative.
        def least(length: float) -> float:
            return float((functions(length) / size).min())
        after = first_root(least, left, SHORT * self._step)
        return after, np.flatnonzero(functions(after) <= 0.0)

    def transition(self, state: Array, step: int, passed: float, modes: FrictionModes,
                   which: Array, at_once: bool
                   ) -> tuple[Array, FrictionModes, _Hit | None]:
        """
        Return state and modes after a transition, and the impact if it is one.

        `at_once` says that no time has passed since the last one.
        """
        contact = self.contact
        k = len(contact.joints)
        kinds, joints = np.divmod(which, k)
        state = state.copy()
        hit = None
        sliding: dict[int, float] = {}
        for kind, joint in zip(kinds.tolist(), joints.tolist()):
            if kind == 0:  # it stops
                self._stop(state, joint)
            elif kind in (1, 2):  # it breaks away
                sign = 1.0 if kind == 1 else -1.0
                sliding[joint] = sign * float(contact.at_bound[joint])
        at_stops = joints[kinds == 3]
        if len(at_stops):
            hit = self._impact(state, at_stops, self._start + step * self._step + passed)
        locked = joints[kinds == 4]
        if len(locked):
            hit = self._lock(state, step, passed, locked)
        if at_once and hit is None:
            # Joints that share the force which holds a loop may reach their bounds at one
            # instant, one after the other. Those that have stay there: set free again,
            # they would take turns without end.
            at_bounds = np.flatnonzero(~modes.held)
            for joint in np.setdiff1d(at_bounds, joints).tolist():
                sliding[joint] = float(modes.directions[joint])
        return state, self.modes(state, step, passed, sliding), hit

    def _stop(self, state: Array, joint: int) -> None:
        """End the rate of a joint of a tree, which is zero but for the root's error."""
        if not self.contact.constrained:
            state[self._n_q + self.contact.joints[joint]] = 0.0

    def _lock(self, state: Array, step: int, passed: float, joints: Array) -> '_Hit':
        """Stop self-locking joints at once, and return the energy that this takes."""
        n_q = self._n_q
        n = self._n
        before = state[n_q:n_q + n].copy()
        tau, t = self._torque(state, step, passed)
        forces = self.contact.forces(state, tau, np.zeros(len(self.contact.joints)), t)
        # Impulses p with v + A p = 0 end the rates of these joints; B p changes all
        # speeds.
        A = forces.regular[np.ix_(joints, joints)]
        impulses = np.linalg.solve(A, -forces.v[joints])
        state[n_q:n_q + n] += forces.B[:, joints] @ impulses
        for joint in joints.tolist():
            self._stop(state, joint)
        return self._hit([], state, before)

    def _hit(self, joints: list[tuple[str, str, float]], state: Array,
             before: Array) -> '_Hit':
        """Return an impact after which a state is; `before` are the speeds before, (n,)."""
        robot = self.source.robot
        n_q = self._n_q
        n = self._n
        size = state_layout(robot).without_margin
        former = state[:size].copy()
        former[n_q:n_q + n] = before
        # What the impact takes of the kinetic energy.
        terms = energy_kernel(robot, True)(np.stack([former, state[:size]]))
        loss = float(terms[0, 0] - terms[1, 0])
        unresolved = self._step * abs(float(terms[0, 2] - terms[1, 2]))
        return _Hit(joints, loss, unresolved)

    def _impact(self, state: Array, joints: Array, t: float) -> '_Hit':
        """Apply the impulses of stops to a state, and return the impact."""
        robot, contact = self.source.robot, self.contact
        n_q, n = self._n_q, self._n
        if contact.constrained:
            return self._admissible_impact(state, t)
        # Joints that hit are put on the nearer stop, whose side the impulse has.
        side = np.zeros(n)
        for joint in joints.tolist():
            place, column = contact.places[joint], contact.joints[joint]
            nearer = contact.upper[joint]
            side[column] = 1.0
            if abs(state[place] - contact.lower[joint]) < abs(state[place] - nearer):
                nearer = contact.lower[joint]
                side[column] = -1.0
            state[place] = nearer

        # Joints that rest at their stops feel the impulse of the others.
        resting = contact.sides_at(state[:n_q])
        side[contact.joints] = np.where(resting != 0.0, resting, side[contact.joints])
        before = state[n_q:n_q + n].copy()
        q = state[:n_q]
        state[n_q:n_q + n] = resolve_stops(before, side, robot.inverse_mass_matrix(q))

        # Only motion into a stop is an impact.
        hits = []
        for joint in joints.tolist():
            column = contact.joints[joint]
            speed = float(side[column] * before[column])
            if speed > 0.0:
                limit = 'upper' if side[column] > 0.0 else 'lower'
                hits.append((robot.coordinate_names[contact.places[joint]], limit, speed))
        return self._hit(hits, state, before)

    def _admissible_impact(self, state: Array, t: float) -> '_Hit':
        """As `_impact`, in the space of the motions that constraints admit."""
        robot = self.source.robot
        n_q, n = self._n_q, self._n
        lower, upper = robot.limits.lower, robot.limits.upper
        before = state[n_q:n_q + n].copy()
        # Positions back to the stops, speeds after the impulses, and the speeds that
        # ended.
        state[:n_q], state[n_q:n_q + n], speeds = admissible_state(
            robot, state[:n_q], before, t, lower, upper, np.zeros((2, n_q)))
        side, _ = nearest_stops(state[:n_q], lower, upper)
        hits = []
        for place in np.flatnonzero(speeds > 0.0).tolist():
            limit = 'upper' if side[place] > 0.0 else 'lower'
            hits.append((robot.coordinate_names[place], limit, float(speeds[place])))
        return self._hit(hits, state, before)


def first_root(function: Callable[[float], float], end: float, resolution: float) -> float:
    """
    Return where a function becomes negative between 0 and `end`, just after that place.

    The function is negative at `end`. The method of regula falsi (Illinois) and bisection
    alternate where it is slow.
    """
    low = 0.0
    high = end
    f_low = function(low)
    f_high = function(high)
    if f_low < 0.0:
        return 0.0
    last = 0
    # Regula falsi; an end that stays twice has half of its value (Illinois), and every
    # fourth time the interval is halved.
    for iteration in range(200):
        width = high - low
        if width <= resolution or f_high > -ROOT:
            break
        x = high - f_high * width / (f_high - f_low)
        if iteration % 4 == 3:
            x = 0.5 * (low + high)
        # Never closer to an end than what the result needs.
        x = min(max(x, low + 0.4 * resolution), high - 0.4 * resolution)
        f = function(x)
        if f < 0.0:
            high, f_high = x, f
            if last < 0:
                f_low *= 0.5
            last = -1
        else:
            low, f_low = x, f
            if last > 0:
                f_high *= 0.5
            last = 1
    return high
