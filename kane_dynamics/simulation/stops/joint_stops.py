"""
Joint stops of `simulate`: rigid, inelastic and frictionless, at the position limits.

After a native step that ends past a stop, the joints are moved back and the impulses of the stops
end the motion into them (`impulses`). While joints press against their stops, the forces of these
hold them within the steps, which are native too (`pressed_steps`). If another joint passes its
stop in such a step, the impulses of these forces count in that contact.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, TYPE_CHECKING

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints import Constraint
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.constraints.row_units import coordinate_units
from kane_dynamics.mechanics.joint_stops import nearest_stops
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.energy_balance import Impact
from kane_dynamics.simulation.stops.impulses import resolved_state
from kane_dynamics.simulation.stops.pressed_steps import (pressed_steps, PressedSteps,
                                                          ROUNDING)
from kane_dynamics.simulation.stops.stop_energies import energies, work_through_constraints
from kane_dynamics.simulation.stops.stop_forces import resting_sides, TOUCHING
from kane_dynamics.simulation.trajectory import StopEvent
import numpy as np

if TYPE_CHECKING:
    from kane_dynamics.simulation.torque_input import TorqueInput

RESTING = 1e-4  # rad or lengths, per s: speed into a stop of a joint that already rests there
NEGLIGIBLE = 1e-9  # acceleration into a stop, relative to those without forces of stops
MOST_SETS = 64  # of stops that hold, tried at the beginning of a step
PRESSED = 16  # pressed steps in the first native piece
MORE = 4  # ratio of the lengths of successive pieces without contact


class Contact(NamedTuple):
    """The contacts at the end of one step of a simulation."""

    hits: dict[int, tuple[str, float]]  # joints that did not rest there: stop, and speed into it
    loss: float  # J
    balance: float  # J: loss, less changes of the work of that step
    unresolved: float  # J: uncertainty of the work of that step


def require_stops(robot: Robot, q: Array) -> None:
    """
    Check the stops of a robot, and that its initial configurations, (N, n_q), are between them.

    Raises
    ------
    InputError
        The limits of a joint leave it no range, or a joint starts past its stop.

    """
    lower, upper = robot.limits.lower, robot.limits.upper
    constrained = isinstance(robot.equations, ConstrainedEquations)
    for name, low, high in zip(robot.coordinate_names, lower, upper):
        if not (low < high or (low == high and constrained)):
            raise InputError(f"limits: of joint '{name}' {low:g} to {high:g}; expected a "
                             'range, between its stops; a joint that cannot move is fixed')
    touching = TOUCHING * coordinate_units(robot.model, _constraints(robot))
    past = (q < lower - touching) | (q > upper + touching)
    if past.any():
        i, j = (int(x) for x in np.argwhere(past)[0])
        raise InputError(f"q0: joint '{robot.coordinate_names[j]}' at {q[i, j]:.6g}; expected "
                         f'{lower[j]:.6g} to {upper[j]:.6g}, between its stops')


def _constraints(robot: Robot) -> Sequence[Constraint]:
    """Return the constraints of a robot, none of a tree."""
    equations = robot.equations
    return equations.mechanism.constraints if isinstance(equations, ConstrainedEquations) else ()


class JointStops:
    """
    The stops of N simulations of one robot.

    Parameters
    ----------
    robot : Robot
    step, start : float
        s.

    """

    def __init__(self, robot: Robot, step: float, start: float) -> None:
        """Begin without contacts."""
        self._robot, self._step, self._start = robot, step, start
        self._lower, self._upper = robot.limits.lower, robot.limits.upper
        self._constrained = isinstance(robot.equations, ConstrainedEquations)
        self._units = coordinate_units(robot.model, _constraints(robot))
        self._most = ROUNDING * self._units if self._constrained else np.zeros(robot.n_q)
        self._contacts: dict[int, dict[int, Contact]] = {}  # by simulation, then steps done
        self._pressures: dict[int, list[tuple[Any, Array]]] = {}  # steps, (K,) and (K, 3)
        self._events: list[StopEvent] = []

    def apply(self, source: 'TorqueInput', buffer: Array, done: int) -> list[int]:
        """
        Apply the stops to states after each step; return the rows of the buffer that change.

        Steps after a contact are computed again. Contacts after `done` steps of an earlier call
        are forgotten: their steps are computed again.

        Parameters
        ----------
        source : TorqueInput
            With the native step; its `places` are the simulations of the buffer.
        buffer : (N, K + 1, size) array
            The states after `done` steps, and after each of K more.
        done : int
            Number of earlier steps.

        """
        places = range(len(buffer)) if source.places is None else source.places
        past = (self._past(buffer[:, 1:]) | self._refused(buffer[:, 1:])).any(axis=1)
        changed = []
        for row, i in enumerate(places):
            if i in self._contacts:
                self._contacts[i] = {step: contact for step, contact in self._contacts[i].items()
                                     if step <= done}
            if i in self._pressures:
                self._pressures[i] = [(steps[steps <= done], lost[steps <= done])
                                      for steps, lost in self._pressures[i]]
            if past[row]:
                self._follow(source.alone(row), i, buffer[row], done)
                changed.append(row)
        return changed

    def settle(self, done: int) -> list[Impact]:
        """
        Close the contacts so far and return their effects on the energy balance.

        The steps after `done` steps, counted from 0, are not computed again.
        """
        names, found = self._robot.coordinate_names, []
        for i, contacts in self._contacts.items():
            for step, contact in contacts.items():
                found.append(Impact(step - done - 1, i, contact.balance, contact.unresolved))
                self._events += [
                    StopEvent(self._start + step * self._step, names[j], limit, speed,
                              contact.loss, i) for j, (limit, speed) in contact.hits.items()]
        found += [Impact(steps - done - 1, i, lost[:, 1], lost[:, 2])
                  for i, held in self._pressures.items() for steps, lost in held]
        self._contacts.clear()
        self._pressures.clear()
        return found

    def events(self, single: bool) -> tuple[StopEvent, ...]:
        """Return the impacts so far, in order of time."""
        return tuple(event._replace(state=None) if single else event
                     for event in sorted(self._events))

    def _past(self, rows: Array) -> Any:
        """Return which states, (..., size), have a joint past its stop."""
        q = rows[..., :self._robot.n_q]
        return ((q < self._lower - self._most) | (q > self._upper + self._most)).any(axis=-1)

    def _refused(self, rows: Array) -> Any:
        """Return which states, (..., size), have no positive margin (`step_kernels`)."""
        return ~(rows[..., -1] > 0.0) & bool(self._robot.constraint_names)

    def _follow(self, source: 'TorqueInput', i: int, rows: Array, done: int) -> None:
        """Apply the stops to the states of simulation i, (K + 1, size)."""
        at, have, piece, end = 0, len(rows) - 1, 1, len(rows) - 1
        pressed = PRESSED
        while at < end:
            if have == at:
                have, piece = min(at + piece, end), MORE * piece
                local = np.empty((1, have - at + 1, rows.shape[1]))
                local[0, 0] = rows[at]
                source.advance(local, done + at, True)
                rows[at + 1:have + 1] = local[0, 1:]
            new = rows[at + 1:have + 1]
            ends = self._past(new) | self._refused(new)
            first = int(np.argmax(ends)) if ends.any() else len(new)
            if first:
                at, piece = at + first, piece if first == len(new) else 1
                continue
            held, one = self._held_step(source, rows[at], done + at)
            if one is not None:
                rows[at + 1] = one.before[0]
            if self._refused(rows[at + 1]):
                return  # the simulation continues from there in other speeds, or ends
            if one is None or self._past(one.after[0]):
                self._stopped(source, i, rows[at:at + 2], done + at + 1, held, one)
                count = 1
            else:
                asked = min(pressed, end - at)
                count = self._pressed(source, i, rows[at:at + asked + 1], done + at, held)
                pressed = MORE * pressed if count == asked else PRESSED
                if not count:
                    count = self._keep(source, i, rows[at:at + 2], done + at, one, 1)
            at, piece = at + count, 1
            have = at

    def step_end(self, source: 'TorqueInput', state: Array, free: Array) -> Array:
        """
        Return the state at the end of the first step, with stops; `free` is that without.

        Parameters
        ----------
        source : TorqueInput
            Of one simulation.
        state, free : (size,) arrays
            States at the begin and, without stops, at the end of the step.

        """
        held, one = self._held_step(source, state, 0)
        end: Array = free if one is None else one.before[0]
        if one is not None and not self._past(one.after[0]):
            return np.asarray(one.after[0])
        return resolved_state(source.robot, end, self._start + self._step, self._lower,
                              self._upper, held, one, self._step)[0]

    def _resting(self, robot: Robot, state: Array, done: int) -> Array:
        """Return the sides of the stops, (n_q,), at which joints rest; 0 of other joints."""
        n_q, n = self._robot.n_q, self._robot.n
        q, u, t = state[:n_q], state[n_q:n_q + n], self._start + done * self._step
        at = {'t': t} if robot.equations.timed else {}
        return resting_sides(robot, q, u, self._lower, self._upper, **at)

    def _held_step(self, source: 'TorqueInput', state: Array,
                   done: int) -> tuple[Array, PressedSteps | None]:
        """
        Return the sides of the stops that hold joints during a step, (n_q,), and that step.

        At the beginning forces f and accelerations a into the stops of the joints that rest solve
        the complementarity problem f >= 0, a <= 0, f . a = 0 of `stop_impulses`, by the same
        method. Joints whose small accelerations lead past their stops are held too, and a stop
        that pulls later in the step does not hold in this step. What is left of the motion into
        stops, also if that method does not end, the impulses at the end of the step take away.
        """
        side = self._resting(source.robot, state, done)
        held = np.zeros(len(side))

        def step() -> PressedSteps:
            return pressed_steps(source, state, done, 1, held, self._lower, self._upper)
        if not side.any():
            return held, None
        into = side * step().acceleration[0]
        scale = NEGLIGIBLE * float(np.abs(into).max())
        held = np.where(into > scale, side, 0.0)
        one = step()
        for _ in range(MOST_SETS):
            wrong = np.where(held != 0.0, one.first[0] > 0.0, side * one.acceleration[0] > scale)
            if not wrong.any():
                break
            k = int(np.argmax(wrong))
            held[k] = side[k] - held[k]
            one = step()
        q = one.after[0, :len(side)]
        late = (held == 0.0) & (side != 0.0) & ((q < self._lower) | (q > self._upper))
        if late.any():
            held[late] = side[late]
            one = step()
        while (pulled := (held != 0.0) & (one.pull[0] > 0.0)).any():
            held[pulled] = 0.0
            one = step()
        return held, one if held.any() else None

    def _pressed(self, source: 'TorqueInput', i: int, rows: Array, done: int,
                 held: Array) -> int:
        """Compute steps in which stops hold joints, and no others act; return their number."""
        found = pressed_steps(source, rows[0], done, len(rows) - 1, held, self._lower,
                              self._upper)
        valid = found.valid
        return self._keep(source, i, rows, done, found,
                          len(valid) if valid.all() else int(np.argmin(valid)))

    def _keep(self, source: 'TorqueInput', i: int, rows: Array, done: int, found: PressedSteps,
              count: int) -> int:
        """Record pressed steps, as many as `count`, which is returned, and their states."""
        rows[1:count + 1] = found.after[:count]
        steps = done + np.arange(1, count + 1)
        if count and self._constrained:  # the joints of trees do not move at all
            lost = energies(source, self._robot, found.before[:count], found.after[:count], steps)
            lost[:, 2] += np.abs(lost[:, 1])  # rounding errors, times large torques
            lost[:, 1] -= work_through_constraints(source.robot, rows[:count + 1],
                                                   found.force[:, :count], self._step)
            self._pressures.setdefault(i, []).append((steps, lost))
        return count

    def _stopped(self, source: 'TorqueInput', i: int, rows: Array, step: int, held: Array,
                 one: PressedSteps | None) -> None:
        """Apply the impulses of the stops to the end of a step, (2, size), and record them."""
        (last, state), n_q, h = rows.copy(), self._robot.n_q, self._step
        t = self._start + step * h
        rows[1], speeds = resolved_state(source.robot, state, t, self._lower, self._upper,
                                         held, one, h)
        side, away = nearest_stops(last[:n_q], self._lower, self._upper)
        rates = self._rates(source.robot, last[:n_q], last[n_q:n_q + self._robot.n], t - h)
        rested = ((np.abs(away) < TOUCHING * self._units)
                  & (side * rates < RESTING * self._units))
        at = nearest_stops(rows[1, :n_q], self._lower, self._upper)[0]
        hits = {int(j): ('upper' if at[j] > 0.0 else 'lower', float(speeds[j]))
                for j in np.flatnonzero((speeds > 0.0) & ~rested)}
        lost = energies(source, self._robot, state[None], rows[1:], np.array([step]))
        if one is not None and self._constrained:
            lost[:, 1] -= work_through_constraints(source.robot, np.stack([last, state]),
                                                   one.force, h)
        self._contacts.setdefault(i, {})[step] = Contact(hits, *lost[0].tolist())

    def _rates(self, robot: Robot, q: Array, u: Array, t: Any) -> Array:
        """Return q', (n_q,)."""
        return robot.joint_rates(q, u, **({'t': t} if robot.equations.timed else {}))
