"""
Joint stops of `simulate`: rigid, inelastic and frictionless, at the position limits.

After a native step that ends past a stop, the joints are moved back and the impulses of
the stops end the motion into them (`contact_forces`). While joints press against their
stops, the forces of these hold them within the steps, which are native too
(`pressed_steps`). If another joint passes its stop in such a step, the impulses of these
forces count in that contact.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints import Constraint
from kane_dynamics.mechanics.constraints.row_units import coordinate_units
from kane_dynamics.mechanics.joint_stops import nearest_stops
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.energy_balance import driven_kernel, energy_kernel
from kane_dynamics.simulation.observers import Extremes, Impact
from kane_dynamics.simulation.step_kernels import state_layout
from kane_dynamics.simulation.stops.contact_forces import (resolved_state, resting_sides,
                                                           ROUNDING, TOUCHING)
from kane_dynamics.simulation.stops.pressed_steps import pressed_steps, PressedSteps
from kane_dynamics.simulation.torque_input import TorqueInput
from kane_dynamics.simulation.trajectory import StopEvent
from kane_dynamics.simulation.user_speeds import UserSpeeds
import numpy as np

RESTING = 1e-4  # rad or lengths, per s: speed into a stop of a joint that already rests there
NEGLIGIBLE = 1e-9  # acceleration into a stop, relative to those without forces of stops
MOST_SETS = 64  # of stops that hold, tried at the beginning of a step
PRESSED = 16  # pressed steps in the first native piece
GROWTH = 4  # ratio of the lengths of successive pieces without contact
BENT = 1e-6  # uncertain part of the energy that a joint gains on its way into a stop


class StopContact(NamedTuple):
    """The contacts at the end of one step of a simulation."""

    hits: dict[int, tuple[str, float]]  # joints that did not rest there: stop, and speed into it
    loss: float  # J
    balance: float  # J: loss, less changes of the work of that step
    unresolved: float  # J: uncertainty of the work of that step


class _Pressure(NamedTuple):
    """Steps in which stops press: their numbers, (K,); loss, balance, uncertainty, (K, 3), J."""

    steps: Any
    energies: Array


def require_stops(robot: Robot, q: Array) -> None:
    """
    Check the stops of a robot, and that its initial configurations, (N, n_q), are between them.

    Raises
    ------
    InputError
        The limits of a joint leave it no range, or a joint starts past its stop.

    """
    lower, upper = robot.limits.lower, robot.limits.upper
    constrained = bool(_constraints(robot))
    for name, low, high in zip(robot.coordinate_names, lower, upper):
        # A loop may hold a joint at one position, but a free joint needs a range.
        if not (low < high or (low == high and constrained)):
            raise InputError(f"limits: of joint '{name}' {low:g} to {high:g}; expected "
                             'a range, between its stops; a joint that cannot move is '
                             'fixed')

    # Rounding may put a configuration at a stop just behind it.
    touching = TOUCHING * coordinate_units(robot.model, _constraints(robot))
    past = (q < lower - touching) | (q > upper + touching)
    if past.any():
        i, j = (int(x) for x in np.argwhere(past)[0])
        raise InputError(f"q0: joint '{robot.coordinate_names[j]}' at {q[i, j]:.6g}; "
                         f'expected {lower[j]:.6g} to {upper[j]:.6g}, between its stops')


def _constraints(robot: Robot) -> Sequence[Constraint]:
    """Return the constraints of a robot, none of a tree."""
    return robot.equations.mechanism.constraints


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
        self._constrained = not robot.equations.in_joint_rates
        self._units = coordinate_units(robot.model, _constraints(robot))
        self._slack = ROUNDING * self._units if self._constrained else np.zeros(robot.n_q)
        self._contacts: dict[int, dict[int, StopContact]] = {}  # by simulation, then steps done
        self._pressures: dict[int, list[_Pressure]] = {}  # by simulation
        self._events: list[StopEvent] = []

    def advance(self, source: TorqueInput, buffer: Array, done: int) -> Extremes | None:
        """
        Compute the states after each step, with the stops; as `TorqueInput.advance`.

        Steps after a contact are computed again. Contacts after `done` steps of an
        earlier call are forgotten: their steps are computed again.

        Parameters
        ----------
        source : TorqueInput
            With the native step; its `simulations` are those of the buffer.
        buffer : (N, K + 1, size) array
            The states after `done` steps, and space for each of K more.
        done : int
            Number of earlier steps.

        """
        extremes = source.advance(buffer, done)
        simulations = source.simulations
        if simulations is None:
            simulations = range(len(buffer))

        # Only simulations that crossed a stop are repeated, one by one, with the stops.
        rows = buffer[:, 1:]
        past = (self._past(rows) | self._refused(rows)).any(axis=1)
        for row, i in enumerate(simulations):
            self._forget(i, done)
            if past[row]:
                self._follow(source.alone(row), i, buffer[row], done)
                # The repeated states replace the extremes of the first computation.
                if extremes is not None:
                    low, high = extremes
                    low[row] = buffer[row, 1:].min(axis=0)
                    high[row] = buffer[row, 1:].max(axis=0)
        return extremes

    def _forget(self, i: int, done: int) -> None:
        """Forget the contacts of simulation i after `done` steps."""
        if i in self._contacts:
            contacts = self._contacts[i].items()
            self._contacts[i] = {step: contact for step, contact in contacts if step <= done}
        if i in self._pressures:
            self._pressures[i] = [_Pressure(steps[steps <= done],
                                            energies[steps <= done])
                                  for steps, energies in self._pressures[i]]

    def settle(self, done: int) -> list[Impact]:
        """
        Close the contacts so far and return their effects on the energy balance.

        The steps after `done` steps, counted from 0, are not computed again.
        """
        # Impacts within steps: their energy, and an event for each joint that hit.
        impacts = []
        for i, contacts in self._contacts.items():
            for step, contact in contacts.items():
                impacts.append(Impact(step - done - 1, i, contact.balance,
                                      contact.unresolved))
                for j, (limit, speed) in contact.hits.items():
                    name = self._robot.coordinate_names[j]
                    self._events.append(StopEvent(self._start + step * self._step, name,
                                                  limit, speed, contact.loss, i))
        # Work at stops that stay pressed, by steps.
        for i, pressures in self._pressures.items():
            for steps, energies in pressures:
                impacts.append(Impact(steps - done - 1, i, energies[:, 1],
                                      energies[:, 2]))
        self._contacts.clear()
        self._pressures.clear()
        return impacts

    def events(self, single: bool) -> tuple[StopEvent, ...]:
        """Return the impacts so far, in order of time."""
        events = sorted(self._events)
        if single:
            events = [event._replace(state=None) for event in events]
        return tuple(events)

    def _past(self, rows: Array) -> Any:
        """Return which states, (..., size), have a joint past its stop."""
        q = rows[..., :self._robot.n_q]
        return ((q < self._lower - self._slack) | (q > self._upper + self._slack)).any(axis=-1)

    def _refused(self, rows: Array) -> Any:
        """Return which states, (..., size), have no positive margin (`step_kernels`)."""
        margin = rows[..., state_layout(self._robot).without_margin:]
        return ~(margin > 0.0).all(axis=-1)

    def _follow(self, source: TorqueInput, i: int, rows: Array, done: int) -> None:
        """
        Apply the stops to the states of simulation i, (K + 1, size).

        Free steps are computed in pieces, which grow as long as no joint passes a stop.
        A piece counts up to its first state past a stop; from there, pressed steps
        follow as long as they are valid, and a step with an impulse where they are not.
        """
        end = len(rows) - 1
        at = 0  # steps that count
        computed = end  # computed steps
        piece = 1  # length of the next piece
        pressed = PRESSED
        while at < end:
            # Steps without stops, in pieces that grow while no stop is hit.
            if computed == at:
                computed = min(at + piece, end)
                piece = GROWTH * piece
                local = np.empty((1, computed - at + 1, rows.shape[1]))
                local[0, 0] = rows[at]
                source.advance(local, done + at)
                rows[at + 1:computed + 1] = local[0, 1:]
            # The steps before the first one past a stop, or refused, count.
            free = rows[at + 1:computed + 1]
            ends = self._past(free) | self._refused(free)
            valid = int(np.argmax(ends)) if ends.any() else len(free)
            if valid:
                at += valid
                if valid < len(free):
                    piece = 1
                continue
            # That step again, with the joints at rest at their stops held there.
            held, one = self._held_step(source, rows[at], done + at)
            if one is not None:
                rows[at + 1] = one.before[0]
            if self._refused(rows[at + 1]):
                return  # the simulation continues from there in other speeds, or ends
            # A stop is hit: its impulses end the step. Otherwise several pressed steps
            # at once.
            if one is None or self._past(one.after[0]):
                self._stopped(source, i, rows[at:at + 2], done + at + 1, held, one)
                count = 1
            else:
                tried = min(pressed, end - at)
                count = self._pressed(source, i, rows[at:at + tried + 1], done + at,
                                      held)
                pressed = GROWTH * pressed if count == tried else PRESSED
                if not count:
                    count = self._keep(source, i, rows[at:at + 2], done + at, one, 1)
            at += count
            piece = 1
            computed = at

    def step_end(self, source: TorqueInput, state: Array, free: Array) -> Array:
        """
        Return the state at the end of the first step with stops; `free` is without stops.

        Parameters
        ----------
        source : TorqueInput
            Of one simulation.
        state, free : (size,) arrays
            States at the begin and, without stops, at the end of the step.

        """
        held, one = self._held_step(source, state, 0)
        if one is not None and not self._past(one.after[0]):
            return np.asarray(one.after[0])
        end: Array = free if one is None else one.before[0]
        return self._resolved(source.robot, end, self._start + self._step, held, one)[0]

    def _resolved(self, robot: Robot, state: Array, t: float, held: Array,
                  one: PressedSteps | None) -> tuple[Array, Array]:
        """Return the end of a step after the impulses of the stops, and the speeds removed."""
        force = None if one is None else one.force[:, 0].mean(axis=0)
        return resolved_state(robot, state, t, self._lower, self._upper, held, force,
                              self._step)

    def _resting(self, robot: Robot, state: Array, done: int) -> Array:
        """Return the sides of the stops, (n_q,), at which joints rest; 0 of other joints."""
        n_q, n = self._robot.n_q, self._robot.n
        q, u, t = state[:n_q], state[n_q:n_q + n], self._start + done * self._step
        return resting_sides(robot, q, u, self._lower, self._upper, t=t)

    def _held_step(self, source: TorqueInput, state: Array,
                   done: int) -> tuple[Array, PressedSteps | None]:
        """
        Return the sides of the stops that hold joints during a step, (n_q,), and that step.

        At the beginning forces f and accelerations a into the stops of the joints that
        rest solve the complementarity problem f >= 0, a <= 0, f . a = 0 of
        `stop_impulses`, by the same method. Joints whose small accelerations lead past
        their stops are held too, and a stop that pulls later in the step does not hold
        in this step. What is left of the motion into stops, also if that method does not
        end, the impulses at the end of the step take away.
        """
        side = self._resting(source.robot, state, done)
        held = np.zeros(len(side))

        def step() -> PressedSteps:
            return pressed_steps(source, state, done, 1, held, self._lower, self._upper)
        if not side.any():
            return held, None
        # First guess: all joints that accelerate into their stops without the stops'
        # forces.
        into = side * step().acceleration[0]
        negligible = NEGLIGIBLE * float(np.abs(into).max())
        held = np.where(into > negligible, side, 0.0)
        one = step()
        # Exchange one joint at a time whose force or acceleration has the wrong sign.
        for _ in range(MOST_SETS):
            pulls, penetrates = one.first[0] > 0.0, side * one.acceleration[0] > negligible
            wrong = np.where(held != 0.0, pulls, penetrates)
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

    def _pressed(self, source: TorqueInput, i: int, rows: Array, done: int,
                 held: Array) -> int:
        """Compute steps in which stops hold joints, and no others act; return their number."""
        steps = pressed_steps(source, rows[0], done, len(rows) - 1, held, self._lower,
                              self._upper)
        count = len(steps.valid) if steps.valid.all() else int(np.argmin(steps.valid))
        return self._keep(source, i, rows, done, steps, count)

    def _keep(self, source: TorqueInput, i: int, rows: Array, done: int,
              pressed: PressedSteps,
              count: int) -> int:
        """Record pressed steps, as many as `count`, which is returned, and their states."""
        rows[1:count + 1] = pressed.after[:count]
        steps = done + np.arange(1, count + 1)
        if count and self._constrained:  # the joints of trees do not move at all
            energies = contact_energies(source, self._robot, pressed.before[:count],
                                        pressed.after[:count], steps)
            energies[:, 2] += np.abs(energies[:, 1])  # rounding errors, times large torques
            energies[:, 1] -= work_through_constraints(source.robot, rows[:count + 1],
                                                       pressed.force[:, :count],
                                                       self._step)
            self._pressures.setdefault(i, []).append(_Pressure(steps, energies))
        return count

    def _stopped(self, source: TorqueInput, i: int, rows: Array, step: int, held: Array,
                 one: PressedSteps | None) -> None:
        """Apply the impulses of the stops to the end of a step, (2, size), and record them."""
        begin, end = rows.copy()
        robot = source.robot
        n_q = self._robot.n_q
        n = self._robot.n
        t = self._start + step * self._step
        rows[1], speeds = self._resolved(robot, end, t, held, one)
        # A joint that rested at its stop before the step does not hit it.
        side, away = nearest_stops(begin[:n_q], self._lower, self._upper)
        rates = robot.joint_rates(begin[:n_q], begin[n_q:n_q + n], t=t - self._step)
        touches = np.abs(away) < TOUCHING * self._units
        rested = touches & (side * rates < RESTING * self._units)
        side_after, _ = nearest_stops(rows[1, :n_q], self._lower, self._upper)
        # Joints that the impulses stopped, with the rates that they had.
        hits = {}
        for j in np.flatnonzero((speeds > 0.0) & ~rested).tolist():
            hits[j] = 'upper' if side_after[j] > 0.0 else 'lower', float(speeds[j])
        energies = contact_energies(source, self._robot, end[None], rows[1:],
                                    np.array([step]))
        if one is not None and self._constrained:
            energies[:, 1] -= work_through_constraints(robot, np.stack([begin, end]),
                                                       one.force, self._step)
        self._contacts.setdefault(i, {})[step] = StopContact(hits, *energies[0].tolist())


def contact_energies(source: TorqueInput, user_robot: Robot, begin: Array, end: Array,
                     steps: Any) -> Array:
    """
    Return loss, balance and uncertainty of the contacts at the end of K steps, (K, 3).

    See `StopContact`.

    Parameters
    ----------
    source : TorqueInput
        Of one simulation.
    user_robot : Robot
        The user's robot; held torques are dual to its speeds.
    begin, end : (K, size) arrays
        States before and after the impulses of the stops.
    steps : (K,) array
        Numbers of the steps, from 1.

    """
    robot = source.robot
    n_q = user_robot.n_q
    n = user_robot.n
    h = source.step
    size = state_layout(robot).without_margin
    K = len(steps)
    u_begin = begin[:, n_q:n_q + n]
    u_end = end[:, n_q:n_q + n]
    # Energies before and after the contact, of which the work of the torque is no loss.
    terms = energy_kernel(robot)(np.concatenate([begin[:, :size], end[:, :size]]))
    kinetic, potential, friction = terms[:K].T
    kinetic_end, potential_end, friction_end = terms[K:].T
    lost = kinetic - kinetic_end + potential - potential_end
    power = friction_end - friction
    unresolved = BENT * np.abs(kinetic - kinetic_end)
    if source.follows:
        power_begin = _law_power(source, steps, begin[:, :n_q], u_begin)
        power_end = _law_power(source, steps, end[:, :n_q], u_end)
        work = 0.5 * h * (power_begin - power_end)
        # Feedback of the speed bends the power within the step by this fraction.
        bent = min(1.0, 0.5 * h * float(np.max(source.torque.kd, initial=0.0)))
        unresolved += bent * np.abs(work)
    else:
        table = source.torque[0]
        tau = table[np.minimum(steps - 1, len(table) - 1)]
        if robot.speed_names != user_robot.speed_names:  # tau is dual to the user's speeds
            t = source.start + steps * h
            user = UserSpeeds(user_robot)
            u_begin = user.speeds(robot, begin[:, :n_q], u_begin, 0.0 * u_begin, t)[:, 0]
            u_end = user.speeds(robot, end[:, :n_q], u_end, 0.0 * u_end, t)[:, 0]
        if not robot.equations.in_joint_rates:
            moved = 0.5 * h * (u_begin - u_end)
        else:
            moved = begin[:, :n_q] - end[:, :n_q]
        work = np.sum(tau * moved, axis=1)
    return np.stack([lost, lost - work - 0.5 * h * power, unresolved], axis=1)


def _law_power(source: TorqueInput, steps: Any, q: Array, u: Array) -> Array:
    """Return the power of a law's torques at the end of K steps, (K,), W."""
    tau = source.torques(steps, q[None], u[None])[0]
    power: Array = np.sum(tau * u, axis=1)
    return power


def work_through_constraints(robot: Robot, states: Array, force: Array,
                             step: float) -> Any:
    """
    Return the work that forces of stops do through moving constraints in K steps, (K,), J.

    A held joint does not move, so a stop does no work. But the constraints that
    prescribe a motion react to it, and the balance counts their work without the forces
    of stops.

    Parameters
    ----------
    robot : Robot
        In the speeds of the states.
    states : (K + 1, size) array
        At the ends of the steps.
    force : (2, K, n) array
        The generalized forces of the stops at the beginning and at the end of each step.
    step : float
        s.

    """
    driven = driven_kernel(robot)
    n_q = robot.n_q
    n = robot.n
    if driven is None:
        return 0.0
    work: Any = 0.0
    # The power with the forces less that without them, at both ends of each step.
    for rows, f in zip((states[:-1], states[1:]), force):
        state = rows[:, :state_layout(robot).without_margin]
        u = rows[:, n_q:n_q + n]
        power = driven(state, f) - driven(state, 0.0 * f) + np.sum(f * u, axis=1)
        work = work + 0.5 * step * power
    return work
