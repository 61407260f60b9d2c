"""
Joint stops of `simulate`: rigid, inelastic and frictionless, at the position limits.

After a native step that ends past a stop, the joints are moved back and the impulses of the stops
end the motion into them. With constraints or chosen speeds both act in the space of the admissible
motions: an impulse p of a stop at joint j changes the independent speeds by -M^-1 T_j^T s p. While
a joint presses against its stop, every step ends so; these steps are native (`pressed_steps`).
"""

from typing import Any, NamedTuple, TYPE_CHECKING

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.ball_joints import on_unit_quaternions
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.joint_stops import nearest_stops, stop_impulses, stopped_state
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.energy_balance import Impact
from kane_dynamics.simulation.stops.pressed_steps import pressed_steps, ROUNDING
from kane_dynamics.simulation.stops.stop_energies import energies
from kane_dynamics.simulation.trajectory import StopEvent
import numpy as np

if TYPE_CHECKING:
    from kane_dynamics.simulation.torque_input import TorqueInput

TOUCHING = 1e-9  # rad or m
REGULAR = 1e-12  # relative, added to impulses of stops that the constraints couple
DRIVEN = 1e-6  # relative: speed into a stop that its impulse cannot end
RESTING = 1e-4  # rad/s or m/s: speed into a stop of a joint that already rests there
ITERATIONS = 10  # of moving joints back and closing loops
PRESSED = 16  # pressed steps in the first native piece
MORE = 4  # ratio of the lengths of successive pieces without contact


class Contact(NamedTuple):
    """The contacts at the end of one step of a simulation."""

    hits: dict[int, tuple[str, float]]  # joints that did not rest there: stop, and speed into it
    loss: float  # J
    balance: float  # J: loss, less changes of the work of that step
    unresolved: float  # J: uncertainty of the work of that step


class JointStops:
    """
    The stops of N simulations of one robot.

    Parameters
    ----------
    robot : Robot
    starts : (N, size) array
        Initial states.
    step, start : float
        s.

    Raises
    ------
    InputError
        A joint starts past its stop, or the limits of a joint leave it no range.

    """

    def __init__(self, robot: Robot, starts: Array, step: float, start: float) -> None:
        """Check the initial states."""
        self._robot, self._step, self._start = robot, step, start
        self._lower, self._upper = robot.limits.lower, robot.limits.upper
        self._constrained = isinstance(robot.equations, ConstrainedEquations)
        self._most = ROUNDING if self._constrained else 0.0
        self._contacts: dict[int, dict[int, Contact]] = {}  # by simulation, then steps done
        self._events: list[StopEvent] = []
        for name, low, high in zip(robot.coordinate_names, self._lower, self._upper):
            if not (low < high or (low == high and self._constrained)):
                raise InputError(f"limits: of joint '{name}' {low:g} to {high:g}; expected a "
                                 'range, between its stops; a joint that cannot move is fixed')
        q = starts[:, :robot.n_q]
        past = (q < self._lower - TOUCHING) | (q > self._upper + TOUCHING)
        if past.any():
            i, j = (int(x) for x in np.argwhere(past)[0])
            raise InputError(f"q0: joint '{robot.coordinate_names[j]}' at {q[i, j]:.6g}; expected "
                             f'{self._lower[j]:.6g} to {self._upper[j]:.6g}, between its stops')

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
        past = self._past(buffer[:, 1:]).any(axis=1)
        changed = []
        for row, i in enumerate(places):
            if i in self._contacts:
                self._contacts[i] = {step: contact for step, contact in self._contacts[i].items()
                                     if step <= done}
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
        self._contacts.clear()
        return found

    def events(self, single: bool) -> tuple[StopEvent, ...]:
        """Return the impacts so far, in order of time."""
        return tuple(event._replace(state=None) if single else event
                     for event in sorted(self._events))

    def _past(self, rows: Array) -> Any:
        """Return which states, (..., size), have a joint past its stop."""
        q = rows[..., :self._robot.n_q]
        return ((q < self._lower - self._most) | (q > self._upper + self._most)).any(axis=-1)

    def _follow(self, source: 'TorqueInput', i: int, rows: Array, done: int) -> None:
        """Apply the stops to the states of simulation i, (K + 1, size)."""
        at, have, piece, end = 0, len(rows) - 1, 1, len(rows) - 1
        pressed = PRESSED
        watched = bool(self._robot.constraint_names)
        while at < end:
            if have == at:
                have, piece = min(at + piece, end), MORE * piece
                local = np.empty((1, have - at + 1, rows.shape[1]))
                local[0, 0] = rows[at]
                source.advance(local, done + at, True)
                rows[at + 1:have + 1] = local[0, 1:]
            new = rows[at + 1:have + 1]
            past = self._past(new)
            first = int(np.argmax(past)) if past.any() else len(new)
            if watched and not (new[:first + 1, -1] > 0.0).all():
                return  # the simulation continues from there in other speeds, or ends
            if first == len(new):
                at = have
                continue
            piece = 1 if first == 0 else MORE
            if first == 0:
                asked = min(pressed, end - at)
                done_here = self._pressed(source, i, rows[at:at + asked + 1], done + at)
                pressed = MORE * pressed if done_here == asked else PRESSED
                if done_here:
                    at += done_here
                    have = min(at + 1, end) if done_here < asked else at
                    continue
            at = have = at + 1 + first
            rows[at] = self._stopped(source, i, rows[at - 1], rows[at], done + at)

    def _pressed(self, source: 'TorqueInput', i: int, rows: Array, done: int) -> int:
        """
        Compute steps in which the joints at their stops press against them, and no others.

        Return their number. Unless all are such steps, the row after them is the end of the next
        step before the impulses of the stops.
        """
        n_q, n = self._robot.n_q, self._robot.n
        q, u, t = rows[0, :n_q], rows[0, n_q:n_q + n], self._start + done * self._step
        side, away = nearest_stops(q, self._lower, self._upper)
        side = side * ((np.abs(away) < TOUCHING)
                       & (np.abs(self._rates(source.robot, q, u, t)) < RESTING))
        if not side.any():
            return 0
        after, before, valid = pressed_steps(source, rows[0], done, len(rows) - 1, side,
                                             self._lower, self._upper)
        count = len(valid) if valid.all() else int(np.argmin(valid))
        if count:
            rows[1:count + 1] = after[:count]
            steps = done + np.arange(1, count + 1)
            lost = energies(source, self._robot, before[:count], after[:count], steps)
            self._contacts.setdefault(i, {}).update(
                (step, Contact({}, *each)) for step, each in zip(steps.tolist(), lost))
            if count < len(valid):
                rows[count + 1] = before[count]
        return count

    def _stopped(self, source: 'TorqueInput', i: int, last: Array, state: Array,
                 step: int) -> Array:
        """Return a state after the impulses of the stops, and record the contact."""
        robot, n_q, n = source.robot, self._robot.n_q, self._robot.n
        t = self._start + step * self._step
        q, u = state[:n_q].copy(), state[n_q:n_q + n].copy()
        after, qdot = state.copy(), self._rates(robot, q, u, t)
        side, away = nearest_stops(q, self._lower, self._upper)
        if self._constrained:
            after[:n_q], after[n_q:n_q + n] = self.admissible(robot, q, u, t)
        else:
            after[:n_q], after[n_q:n_q + n] = stopped_state(
                q, u, robot.inverse_mass_matrix(q), self._lower, self._upper)
        before = self._rates(robot, last[:n_q], last[n_q:n_q + n], t - self._step)
        near = np.abs(nearest_stops(last[:n_q], self._lower, self._upper)[1]) < TOUCHING
        rested = near & (side * before < RESTING)
        hits = {int(j): ('upper' if side[j] > 0.0 else 'lower', float(side[j] * qdot[j]))
                for j in np.flatnonzero((side * away > self._most) & ~rested)}
        self._contacts.setdefault(i, {})[step] = Contact(
            hits, *energies(source, self._robot, state[None], after[None], np.array([step]))[0])
        return after

    def _rates(self, robot: Robot, q: Array, u: Array, t: Any) -> Array:
        """Return q', (..., n_q)."""
        return robot.joint_rates(q, u, **({'t': t} if robot.equations.timed else {}))

    def admissible(self, robot: Robot, q: Array, u: Array, t: float) -> tuple[Array, Array]:
        """Return q and u after impulses in the space of the admissible motions."""
        at: dict[str, Any] = {'t': t} if robot.equations.timed else {}
        contact: Any = None  # indices of the joints that end at their stops
        for _ in range(ITERATIONS):
            T, X, inverse = self._partial_rates(robot, q, t, at)
            side, away = nearest_stops(q, self._lower, self._upper)
            past = np.flatnonzero(side * away > self._most)
            if contact is None:
                stops = np.flatnonzero(side)
                s, along, A = _response(side, stops, T, inverse)
                p, active = stop_impulses(s * away[stops], A)
                contact = stops[active]
            else:  # the loops are not linear: iterate to the stops, from either side
                contact = np.union1d(contact, past)
                if not len(past) and (np.abs(away[contact]) <= self._most).all():
                    break
                s, along, A = _response(side, contact, T, inverse)
                p = np.linalg.solve(A, s * away[contact])
            q = self._closed(robot, q - T @ (along @ p), t)
        else:
            raise self._driven(q, side * away, t)
        side = side * (np.abs(away) < TOUCHING)
        qdot, stops = T @ u + X, np.flatnonzero(side)
        s, along, A = _response(side, stops, T, inverse)
        u = u - along @ stop_impulses(s * qdot[stops], A)[0]
        into = side * (T @ u + X)
        if (into > DRIVEN * np.abs(qdot).max(initial=1e-6)).any():
            raise self._driven(q, into, t)
        return q, u

    def _partial_rates(self, robot: Robot, q: Array, t: float,
                       at: dict[str, Any]) -> tuple[Array, Array, Array]:
        """Return T (n_q, n), X (n_q,) of q' = T u + X, and M^-1 (n, n)."""
        n = robot.n
        rows = np.concatenate([np.zeros((1, n)), np.eye(n)])
        rates = self._rates(robot, np.tile(q, (n + 1, 1)), rows, t)
        return (rates[1:] - rates[0]).T, rates[0], robot.inverse_mass_matrix(q, **at)

    def _closed(self, robot: Robot, q: Array, t: float) -> Array:
        """Return q on unit quaternions after two Newton steps on the loops."""
        equations: Any = robot.equations
        if not equations.keeps_positions(q, t):
            return np.asarray(on_unit_quaternions(robot.model, q))
        arguments = [Argument('q', (robot.n_q,)), Argument('t', ())]
        block = robot.parameters.block
        kernel = robot.kernels.extra('closure_step', lambda: trace_program(
            'closure_step', lambda q, t, _: equations.closure_step(q, t[()]),
            [('q', (robot.n_q,)), ('t', ()), ('parameters', block.shape)]), arguments, block,
            (robot.n_q,))
        result: Array = on_unit_quaternions(robot.model, kernel(kernel(q, t), t))
        return result

    def _driven(self, q: Array, into: Array, t: float) -> ConstraintError:
        name = self._robot.coordinate_names[int(np.argmax(into))]
        return ConstraintError(f"{t:.6g} s: joint '{name}' is at its stop, and the constraints "
                               'drive it on; expected a motion between the stops')


def _response(side: Array, joints: Any, T: Array, inverse: Array) -> tuple[Array, Array, Array]:
    """
    Return the response to impulses of the stops of k joints, given by index.

    It is their sides (k,), the changes of the independent speeds (n, k), and the motion away from
    each stop (k, k), regular where the constraints couple stops.
    """
    s = side[joints]
    along = inverse @ (T[joints] * s[:, None]).T
    A = s[:, None] * T[joints] @ along
    return s, along, A + (REGULAR * np.diag(A).max(initial=0.0) or 1.0) * np.eye(len(A))
