"""
The stepper: joints with stops and set-valued friction, and contacts, as rows with modes.

Native steps in constant modes follow each other while all guards are positive. In the
step where one is not, the first zero of the guards is found by the same kernel; rows that
touch and approach get impulses, new modes are chosen, and the rest of the step
follows in the same way.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.contacts import ContactPair
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.energy_balance import energy_kernel, TERMS
from kane_dynamics.simulation.observers import Impact
from kane_dynamics.simulation.row_kernel import (Guards, HELD, ModeChoice, response_kernel,
                                                 row_kernel, RowMode, RowSet)
from kane_dynamics.simulation.row_modes import Impulses, row_set, RowModes, TOUCHING
from kane_dynamics.simulation.step_kernels import state_layout, StepChoice
from kane_dynamics.simulation.torque_input import TorqueInput
from kane_dynamics.simulation.trajectory import ContactEvent, StopEvent
import numpy as np

FIRST, GROWTH = 16, 4  # steps of the first native piece, and ratio of the next ones
MOST = 200  # transitions in one step
SHORT = 1e-9  # of a step: a part that is left out
EXACT = 1e-13  # of a step: width of the interval of a root
ROUNDS = 60  # of the search for a root
# Of the interval of a root: lengths of the first parts, and of those around the secant.
GRID = 2.0**-np.array([40.0, 20.0, 10.0, 5.0, 3.0, 2.0, 1.0])
NEAR = np.array([-1e-2, -1e-4, -1e-7, 1e-7, 1e-4, 1e-2])


class Contacts(NamedTuple):
    """The contacts of a simulation: c pairs, and their friction and restitution, (c,)."""

    pairs: tuple[ContactPair, ...] = ()
    friction: Any = ()
    restitution: Any = ()


NO_CONTACTS = Contacts()


class _Parts(NamedTuple):
    """
    Parts of a step, of K lengths.

    The states at their ends, (K, size); all guards there with those of the forces, (K, m);
    those of the forces at the beginning, and the power of contacts there.
    """

    states: Array
    guards: Array
    forces: Array
    power: float

    @property
    def valid(self) -> Any:
        """Return which parts have positive guards, (K,); NaN is not positive."""
        return (self.guards > 0.0).all(axis=1)


class _Loss(NamedTuple):
    """Energy that is lost in steps, by their numbers, and its uncertainty, (K,), J."""

    steps: Array
    loss: Array
    uncertain: Array

    def until(self, done: int) -> '_Loss':
        """Return the losses of the first `done` steps."""
        return _Loss(*(x[self.steps <= done] for x in self))


class RowSteps:
    """
    The steps of N simulations of one robot whose rows have modes.

    Parameters
    ----------
    robot : Robot
    step, start : float
        s.
    stops, sticking : bool
        Whether there are stops at the position limits, and set-valued friction.
    contacts : Contacts, optional

    """

    def __init__(self, robot: Robot, step: float, start: float, stops: bool,
                 sticking: bool, contacts: Contacts = NO_CONTACTS) -> None:
        """Begin without transitions."""
        self._robot, self._step, self._start = robot, step, start
        self.stops, self.sticking = stops, sticking
        self._contacts = contacts
        self._without_margin = state_layout(robot).without_margin
        self._modes_of: dict[tuple[str, ...], tuple[Robot, RowModes]] = {}
        self._losses: dict[int, list[_Loss]] = {}
        self._hits: dict[int, list[tuple[int, StopEvent | ContactEvent]]] = {}
        self._events: list[StopEvent | ContactEvent] = []
        # The modes after a step of a simulation: step, source's speeds, modes.
        self._known: dict[int, tuple[int, Array, ModeChoice]] = {}
        self._paths: dict[int, _Path] = {}
        self.changed = False

    @property
    def contact_names(self) -> tuple[str, ...]:
        """Return the names of the contacts."""
        return tuple(pair.name for pair in self._contacts.pairs)

    @property
    def any_rows(self) -> bool:
        """Return whether there is a joint with friction or stops, or a contact."""
        rows = self._row_set(self._robot, None)
        return bool(rows.joints or rows.pairs)

    def _row_set(self, robot: Robot, dual_to: tuple[str, ...] | None) -> RowSet:
        return row_set(robot, self.stops, self.sticking, self._contacts.pairs,
                       self._contacts.friction, self._contacts.restitution, dual_to)

    def rows(self, robot: Robot, dual_to: tuple[str, ...] | None = None) -> RowModes:
        """Return the choice of modes for the robot in one choice of speeds."""
        key = (*robot.speed_names, 'dual to', *(dual_to or ()))
        if key not in self._modes_of or self._modes_of[key][0] is not robot:
            self._modes_of[key] = robot, RowModes(self._row_set(robot, dual_to), self._step)
        return self._modes_of[key][1]

    def advance(self, source: TorqueInput, buffer: Array, done: int) -> None:
        """
        Compute the states after each step, as `TorqueInput.advance`.

        What happened after `done` steps of an earlier call is forgotten: it is computed
        again.
        """
        simulations = source.simulations
        if simulations is None:
            simulations = range(len(buffer))
        for row, i in enumerate(simulations):
            self._losses[i] = [loss.until(done) for loss in self._losses.get(i, [])]
            self._hits[i] = [x for x in self._hits.get(i, []) if x[0] <= done]
            self._follow(source.alone(row), i, buffer[row], done)

    def settle(self, done: int) -> list[Impact]:
        """Close what happened so far; return its energy in steps counted from `done`."""
        settled = []
        for i, losses in self._losses.items():
            for steps, loss, uncertain in losses:
                settled.append(Impact(steps - done - 1, i, loss, uncertain))
        for hits in self._hits.values():
            self._events += [event for _, event in hits]
        self._losses.clear()
        self._hits.clear()
        return settled

    def step_end(self, source: TorqueInput, state: Array) -> Array:
        """
        Return the state after the first step of one simulation.

        The modes at its end are those at the beginning of the next call, if that begins
        at the same state. `changed` says whether modes changed, or rows hit.
        """
        buffer = np.stack([state, state])
        self._follow(source, 0, buffer, 0)
        self.changed = bool(self.settle(0))
        if 0 in self._known:
            self._known[0] = (0, *self._known[0][1:])
        end: Array = buffer[1]
        return end

    def events(self, single: bool, kind: type = StopEvent) -> tuple[Any, ...]:
        """Return the impacts of one kind so far, in order of time."""
        events: list[Any] = sorted(x for x in self._events if isinstance(x, kind))
        if single:
            events = [event._replace(state=None) for event in events]
        return tuple(events)

    def _modes_at(self, i: int, done: int, state: Array) -> ModeChoice | None:
        """Return the modes of a simulation after `done` steps, None if they are not known."""
        if not done and self._contacts.pairs:
            # Contacts hold to rounding: the balance cannot be better than that.
            model = self._robot.model
            weight = sum(body.inertial.mass for body in model.bodies) * np.linalg.norm(
                self._robot.parameters.gravity)
            self.record(i, 0, 0.0, TOUCHING * float(weight))
        if i in self._known:
            step, known_state, modes = self._known[i]
            if step == done and np.array_equal(known_state, state):
                return modes
        return None

    # The steps of one simulation.

    def _follow(self, source: TorqueInput, i: int, rows: Array, done: int) -> None:
        """Compute the states of simulation i after each step, (K + 1, size)."""
        path = self._paths.get(i)
        if path is None or not path.continues(source):
            path = self._paths[i] = _Path(self, source, i)
        count_of_rows = len(rows) - 1
        modes = self._modes_at(i, done, rows[0])
        at, piece = 0, FIRST
        state = rows[0]  # from which the steps go on, after impacts
        while at < count_of_rows:
            if modes is None:
                state, modes = path.begun(state, done + at, 0.0)
            count = min(piece, count_of_rows - at)
            computed, guards, power = path.scanned(state, done + at, count, modes)
            good = ((guards.forces > 0.0).all(axis=1) & (guards.ends > 0.0).all(axis=1)
                    & self._accepted(computed))
            valid = count if good.all() else int(np.argmin(good))
            # The forces at the end of the last valid step are those of the same torque.
            ends = power[valid:valid + 1]
            if valid and path.watches_end(modes):
                end = path.parts(computed[valid - 1], done + at + valid - 1, self._step,
                                 np.zeros(1), modes)
                ends = np.array([end.power])
                if not (end.forces > 0.0).all():
                    valid -= 1
                    ends = power[valid:valid + 1]
            rows[at + 1:at + 1 + valid] = computed[:valid]
            path.dissipated(done + at, np.append(power[:valid], ends))
            at += valid
            if valid:
                state = rows[at]
            piece = GROWTH * piece if valid == count else FIRST
            if valid == count:
                continue
            if not self._accepted(computed[valid:valid + 1])[0]:
                rows[at + 1:] = computed[valid]  # diverged, or to go on in other speeds
                return
            if not (guards.forces[valid] > 0.0).all():
                modes = None  # the torque has changed
                state, modes = path.begun(state, done + at, 0.0)
            state, modes = path.through(state, done + at, modes)
            rows[at + 1] = state
            if not self._accepted(rows[at + 1:at + 2])[0]:
                rows[at + 1:] = state
                return
            at += 1
        if modes is not None:
            self._known[i] = done + count_of_rows, rows[-1].copy(), modes

    def _accepted(self, states: Array) -> Any:
        """Return which states, (K, size), are finite with a positive margin, if any."""
        margin = states[:, self._without_margin:]
        return np.isfinite(states).all(axis=1) & (margin > 0.0).all(axis=1)

    def record(self, i: int, steps: Any, loss: Any, uncertain: Any) -> None:
        """Record energy that is lost in steps, (K,) or one, and its uncertainty, J."""
        arrays = (np.atleast_1d(x) for x in (np.asarray(steps) + 1, loss, uncertain))
        self._losses.setdefault(i, []).append(_Loss(*arrays))

    def hit(self, i: int, step: int, t: float, impact: Impulses, rows: RowModes,
            state: Array) -> None:
        """Record the events of an impact."""
        events = self._hits.setdefault(i, [])
        of = rows.rows
        for joint, speed in impact.joints.items():
            place = of.places[joint]
            near_upper = abs(state[place] - of.upper[joint]) < abs(state[place]
                                                                   - of.lower[joint])
            events.append((step + 1, StopEvent(
                t, self._robot.coordinate_names[place], 'upper' if near_upper else 'lower',
                speed, impact.loss, i)))
        for contact, speed in impact.contacts.items():
            events.append((step + 1, ContactEvent(
                t, of.pairs[contact].name, speed, float(impact.impulses[contact, 0]),
                impact.loss, contact in impact.rests, i)))


def compile_rows(robot: Robot, choice: StepChoice, stops: bool, sticking: bool,
                 contacts: Contacts = NO_CONTACTS) -> None:
    """Compile the kernels of `RowSteps` for one choice of the step."""
    rows = row_set(robot, stops, sticking, *contacts, choice.needed(robot).dual_to)
    if rows.joints or rows.pairs:
        row_kernel(rows, choice).compile()
        response_kernel(rows).compile()
        response_kernel(rows).compile_lanes()
        energy_kernel(robot, sticking).compile()


def compile_row_steps(robot: Robot, integrator: str, followed: Sequence[int], stops: bool,
                      sticking: bool, contacts: Contacts = NO_CONTACTS) -> None:
    """Compile the kernels of `RowSteps` with and without feedback, as `step_kernel`."""
    for feedback in (False, True):
        compile_rows(robot, StepChoice(feedback, integrator, None, followed), stops, sticking,
                     contacts)


class _Path:
    """The motion of one simulation within and across steps."""

    def __init__(self, steps: RowSteps, source: TorqueInput, i: int) -> None:
        """Choose the kernels of the source's speeds."""
        self._steps, self._source, self._i = steps, source, i
        robot = source.robot
        dual_to = source.choice.needed(robot).dual_to
        self._rows = steps.rows(robot, dual_to)
        self._kernel = self._rows.step_kernel(source.choice)
        self._step = source.step
        self._place_of_step = 2 * robot.n if source.follows else 0
        self._modes: ModeChoice | None = None
        self._mode_numbers: Array = np.zeros(0)
        self._watches_end = False
        self._energies = energy_kernel(robot, steps.sticking)
        self._energy_entries = state_layout(robot).without_margin

    def continues(self, source: TorqueInput) -> bool:
        """Use the torques of a source, and return whether it has the speeds of this path."""
        before, self._source = self._source, source
        return source.robot is before.robot and source.choice == before.choice

    def scanned(self, state: Array, step: int, count: int,
                modes: ModeChoice) -> tuple[Array, Guards, Array]:
        """Return the states after each of `count` steps, their guards and powers."""
        rows = np.empty((count + 1, *self._kernel.shape))
        size = len(state)
        rows[0, :size] = state
        inputs = self._source.inputs(step, count)
        row = inputs[0, 0] if inputs.shape[1] == 1 else inputs[0]
        self._kernel.scan([rows[:-1, :size], row, self._numbers(modes)], rows[1:],
                          constants=self._source.constants)
        return rows[1:, :size], self._guards(rows[1:, size:-1]), rows[1:, -1]

    def _numbers(self, modes: ModeChoice) -> Array:
        """Return the input of the kernel for the modes, computed once for each choice."""
        if modes is not self._modes:
            self._modes, self._mode_numbers = modes, modes.numbers(self._rows.rows)
            of_joints = any(mode in HELD or locks
                            for mode, locks in zip(modes.joints, self._rows.rows.locks))
            self._watches_end = of_joints or any(mode != RowMode.OFF
                                                 for mode in modes.contacts)
        return self._mode_numbers

    def _guards(self, numbers: Array) -> Guards:
        of = self._rows.rows
        end = len(of.joints) + 2 * len(of.pairs)
        return Guards(numbers[..., :end], numbers[..., end:])

    def _computed(self, states: Array, step: int, passed: Any, lengths: Array,
                  modes: ModeChoice) -> Array:
        """
        Return the kernel's results of parts of a step, of K lengths, (K, ...).

        `states`, (size,) or (K, size), and `passed`, s, are at their beginnings.
        """
        source = self._source
        constants = np.repeat(source.constants[None], len(lengths), axis=0)
        constants[:, self._place_of_step] = lengths
        results = np.empty((len(lengths), *self._kernel.shape))
        self._kernel.scan([states, source.inputs_within(step, passed, lengths),
                           self._numbers(modes)], results, constants=constants)
        return results

    def parts(self, state: Array, step: int, passed: float, lengths: Array,
              modes: ModeChoice) -> _Parts:
        """Return parts of a step, from `passed` s after its beginning on."""
        of = self._rows.rows
        size = len(state)
        forces = slice(size, size + len(of.joints) + 2 * len(of.pairs))
        results = self._computed(state, step, passed, lengths, modes)
        guards = results[:, forces.stop:-1]
        if self.watches_end(modes):
            ends = self._computed(results[:, :size], step, passed + lengths, 0.0 * lengths,
                                  modes)
            guards = np.concatenate([guards, ends[:, forces]], axis=1)
        return _Parts(results[:, :size], guards, results[0, forces], float(results[0, -1]))

    def watches_end(self, modes: ModeChoice) -> bool:
        """Return whether a row has a force that ends at a bound."""
        self._numbers(modes)
        return self._watches_end

    def dissipated(self, step: int, power: Array) -> None:
        """Record the work of contacts in steps by the power at their ends, (K + 1,)."""
        count = len(power) - 1
        if count > 0 and power.any():
            self._steps.record(self._i, step + np.arange(count),
                               -0.5 * self._step * (power[:-1] + power[1:]),
                               self._step * np.abs(np.diff(power)))

    def begun(self, state: Array, step: int, passed: float,
              breaks: Sequence[int] = ()) -> tuple[Array, ModeChoice]:
        """Return the state after impacts, and its modes, `passed` s after a step's begin."""
        tau = self._source.torque_at(state, step, passed)
        t = self._source.start + step * self._step + passed
        after, impact = self._rows.impact(state, tau, t, breaks)
        if impact is not None:
            self._steps.hit(self._i, step, t, impact, self._rows, state)
            lost = self._kinetic_energy(state) - self._kinetic_energy(after)
            self._steps.record(self._i, step, lost, 0.0)
            breaks = [row for row in breaks if row not in impact.locked]
        modes, now, _ = self._rows.choose(after, tau, t, breaks)
        return self._rows.at_rest(after, modes, now), modes

    def _kinetic_energy(self, state: Array) -> float:
        """
        Return the kinetic energy, J.

        Its change is the loss of an impact, and the work that the impact does on
        prescribed motions.
        """
        return float(self._energy_terms(state)[0, 0])

    def _energy_terms(self, *states: Array) -> Array:
        """Return kinetic and potential energy and power of friction, (K, 3), of K states."""
        terms = np.empty((len(states), TERMS))
        self._energies.scan([np.array(states)[:, :self._energy_entries]], terms,
                            constants=self._source.robot.parameters.block)
        return terms

    def through(self, state: Array, step: int, modes: ModeChoice) -> tuple[Array, ModeChoice]:
        """Return the state after a step with transitions, and the modes there."""
        passed = 0.0
        begin = state
        breaks: list[int] = []
        for _ in range(MOST):
            left = self._step - passed
            if left <= SHORT * self._step:
                self._kinks_of_friction(step, begin, state)
                return state, modes
            whole = self.parts(state, step, passed, np.array([left]), modes)
            end = whole.states[0]
            if whole.valid[0]:
                self._kink(step, left, whole.power)
                self._kinks_of_friction(step, begin, end)
                return end.copy(), modes
            if not np.isfinite(end).all():
                return end, modes
            time, end, guards = self._root(state, step, passed, left, modes, whole)
            self._kink(step, time, whole.power)
            passed += time
            state = self._reached(end, guards)
            # Rows that share a force may reach their bounds at one instant, one after the
            # other: set free again, they would take turns without end.
            at_once = breaks if time <= SHORT * self._step else []
            breaks = [*at_once, *self._breaks(guards)]
            state, modes = self.begun(state, step, passed, breaks)
        t = self._source.start + step * self._step
        raise InputError(f'simulation: more than {MOST} transitions of stops, friction and '
                         f'contacts in the step at {t:.6g} s; expected a shorter step')

    def _kink(self, step: int, length: float, power: float) -> None:
        """Record the energy of contacts in a part of a step, and its uncertainty."""
        lost = -power * length
        self._steps.record(self._i, step, lost, abs(lost) + 0.0)

    def _kinks_of_friction(self, step: int, begin: Array, end: Array) -> None:
        """Record that the power of friction of joints has a kink within a step."""
        power = float(np.abs(self._energy_terms(begin, end)[:, 2]).sum())
        self._steps.record(self._i, step, 0.0, 0.5 * self._step * power)

    def _root(self, state: Array, step: int, passed: float, left: float, modes: ModeChoice,
              whole: _Parts) -> tuple[float, Array, Array]:
        """
        Return the first time at which a guard is not positive, just past it.

        `whole` is the part of the length `left`. The other results are the state and the
        guards there. A guard may be zero at the beginning, of a row that has just left its
        bound.
        """
        low, high = 0.0, left
        end, beyond = whole.states[0], whole.guards[0]
        shares = GRID
        for _ in range(ROUNDS):
            lengths = low + shares * (high - low)
            lengths = lengths[(lengths > low) & (lengths < high)]
            if high - low <= EXACT * self._step or not len(lengths):
                break
            parts = self.parts(state, step, passed, lengths, modes)
            valid = parts.valid
            if low == 0.0:  # a part that is short may fail by rounding: the longest counts
                first = max((k + 1 for k in np.flatnonzero(valid).tolist()), default=0)
            else:
                first = len(valid) if valid.all() else int(np.argmin(valid))
            if first < len(valid):
                high, end, beyond = lengths[first], parts.states[first], parts.guards[first]
            if first:
                low, inside = lengths[first - 1], parts.guards[first - 1]
            elif low == 0.0:
                break
            # Around the earliest secant of the guards that fail, and in the middle.
            fails = ~(beyond > 0.0)
            secant = 0.5
            if np.isfinite(beyond[fails]).all():
                secant = float((inside[fails] / (inside[fails] - beyond[fails])).min())
            shares = np.sort(np.append(secant + NEAR, 0.5))
        return high, end, beyond

    def _breaks(self, guards: Array) -> list[int]:
        """Return the rows whose forces have reached their bounds, as `RowModes.choose`."""
        of = self._rows.rows
        k, c = len(of.joints), len(of.pairs)
        forces = ~(guards[2 * (k + c):] > 0.0)
        return np.flatnonzero(forces[:k + c]).tolist()

    def _reached(self, state: Array, guards: Array) -> Array:
        """Return a state of a tree in which joints are exactly where their guards end."""
        of = self._rows.rows
        if not of.tree:
            return state
        state = state.copy()
        k = len(of.joints)
        distances, rates = np.split(~(guards[:2 * k] > 0.0), 2)
        for j in np.flatnonzero(distances).tolist():
            place = of.places[j]
            near_upper = abs(state[place] - of.upper[j]) < abs(state[place] - of.lower[j])
            state[place] = of.upper[j] if near_upper else of.lower[j]
        for j in np.flatnonzero(rates).tolist():
            state[of.robot.n_q + of.joints[j]] = 0.0
        return state
