"""
Simulations of constrained robots with a change of independent speeds before singularities.

Every native step computes a margin, which is positive for an accepted state
(`mechanics.constraints.conditioning`). For a non-positive margin, Python code finds the reason:
ill-conditioned speeds or rows are replaced, and the simulation continues from the last accepted
state; any other reason is an error. Near a singularity of all choices every step is checked.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import itemgetter
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque import ComputedTorque
from kane_dynamics.control.constrained_law import require_following
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.ball_joints import joint_speeds
from kane_dynamics.mechanics.constraints.conditioning import (best_choice, EXCESS, figure,
                                                              in_lengths, LIMITS, loosened,
                                                              SHARE, SINGULAR, singular_error,
                                                              stacked, WELL_CHOSEN)
from kane_dynamics.native.backends.real_types import size_limit
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.speed_sets import left_out_error, limits_of
from kane_dynamics.simulation.singularity_watch import (all_trusted, residual_error,
                                                        SingularityWatch, trusted,
                                                        watched_configurations)
from kane_dynamics.simulation.step_kernels import step_kernel, StepChoice
from kane_dynamics.simulation.step_size import diverged_error
from kane_dynamics.simulation.torque_input import TorqueInput
from kane_dynamics.simulation.trajectory import SpeedChange
from kane_dynamics.simulation.user_speeds import law_power, UserSpeeds
import numpy as np

STEP_RESIDUAL = 1e-3  # rad or lengths: largest residual after a step, before the correction
GAIN = 2.0  # smallest ratio of the old figure to that of a new choice
ROOM = 4.0  # a choice is kept until its figure has grown by this factor
FARTHEST = 3.0  # rad, or lengths of the mechanism: largest motion of a joint in one step
PIECE = 256  # steps after a change before the next check of the states
MOST_CHANGES = 20  # at one state
NEARLY = 0.65  # of the largest transmission: its limit holds for the sum of two squares


@dataclass(frozen=True)
class Phase:
    """Current speeds of a simulation: its robot, and the largest conditioning figure allowed."""

    robot: Robot
    limit: float


class SwitchingInput:
    """
    A torque input that changes the independent speeds where those in use become singular.

    Parameters
    ----------
    source : TorqueInput
        The torque input of the user's robot; torques stay dual to its speeds.
    count : int
        Number of simulations.
    integrator : str
        One of `mechanics.integrators.INTEGRATORS`.

    Attributes
    ----------
    changes : list of SpeedChange
        Changes of every simulation, in order of time.

    """

    def __init__(self, source: TorqueInput, count: int, integrator: str, single: bool) -> None:
        """Start all simulations in the robot's own speeds."""
        self.robot, self.step, self.torque = source.robot, source.step, source.torque
        self._law = source.torque if isinstance(source.torque, ComputedTorque) else None
        self._source, self._integrator, self._single = source, integrator, single
        self.stops = source.stops
        mechanism = source.robot.mechanism
        self._open = loosened(mechanism, STEP_RESIDUAL)
        self._excess = loosened(mechanism, EXCESS)
        self._usual = WELL_CHOSEN * float(np.sqrt(mechanism.model.n))
        self._phases = [Phase(source.robot, self._usual)] * count
        self._elsewhere: set[int] = set()  # simulations in another phase than the first
        self._sources: dict[tuple[int, float], TorqueInput] = {}
        self._history: list[list[tuple[int, Robot]]] = [[(-1, source.robot)]
                                                        for _ in range(count)]
        self._asked = UserSpeeds(source.robot, source.stops is not None)
        self._watch = SingularityWatch(source.robot, source.step)
        self.changes: list[SpeedChange] = []

    def advance(self, buffer: Array, done: int, single: bool) -> tuple[Array, Array] | None:
        """Compute the states after each step; as `TorqueInput.advance`."""
        groups: dict[tuple[int, float], list[int]] = {}
        for i in range(len(buffer)) if self._elsewhere else ():
            groups.setdefault((id(self._phases[i].robot), self._phases[i].limit), []).append(i)
        extremes = None
        for places in list(groups.values()) or [list(range(len(buffer)))]:
            source = self._source_of(places)
            if len(places) == len(buffer):
                extremes = source.advance(buffer, done, single)
            else:
                part = np.ascontiguousarray(buffer[places])
                source.advance(part, done, False)
                buffer[places] = part
        whole = all_trusted(buffer)
        for i in sorted(self._elsewhere):
            if whole[i]:
                self._look_closely(i, buffer[i], done)
        for i in np.flatnonzero(~whole).tolist():
            self._resume(i, buffer[i], int(np.argmin(trusted(buffer[i]))), done)
        if single:
            return None
        if extremes is None or not whole.all():
            extremes = buffer[:, 1:].min(axis=1), buffer[:, 1:].max(axis=1)
        return extremes

    def _source_of(self, places: Sequence[int]) -> TorqueInput:
        """Return the native step of simulations in the same phase."""
        phase = self._phases[places[0]]
        key = id(phase.robot), phase.limit
        if key not in self._sources:
            constants = self._source.constants.copy()
            opened = in_lengths(self.robot.mechanism, self._open)
            constants[-LIMITS:] = limits_of(phase.limit, opened, self._excess)
            choice = self._source.choice if self._law else StepChoice(
                False, self._integrator, self.robot.speed_names)
            self._sources[key] = replace(
                self._source, robot=phase.robot, kernel=step_kernel(phase.robot, *choice),
                choice=choice, constants=constants)
        torque = self.torque
        if self._law is None and torque.shape[0] > 1 and len(places) < torque.shape[0]:
            torque = np.ascontiguousarray(torque[places])
        return replace(self._sources[key], torque=torque, places=list(places))

    def _resume(self, i: int, rows: Array, bad: int, done: int) -> None:
        """Continue simulation i from the state before the first rejected row to the last row."""
        state, tries = rows[bad - 1].copy(), 0
        self._look_closely(i, rows[:bad], done)
        start, last, piece = bad - 1, len(rows) - 1, PIECE
        while start < last:
            if tries == MOST_CHANGES:
                raise self._diverged(i, done + start + 1)
            state, tries = self._decided(i, state, done + start), tries + 1
            while start < last:
                local = np.empty((1, min(piece, last - start) + 1, rows.shape[1]))
                local[0, 0] = state
                self._source_of([i]).advance(local, done + start, True)
                good = trusted(local[0])
                reached = len(good) - 1 if good.all() else int(np.argmin(good)) - 1
                self._look_closely(i, local[0, :reached + 1], done + start)
                rows[start + 1:start + reached + 1] = local[0, 1:reached + 1]
                start, state, piece = start + reached, local[0, reached].copy(), 4 * piece
                tries = 0 if reached else tries
                if not good.all():
                    piece = PIECE
                    break

    def _decided(self, i: int, state: Array, done: int) -> Array:
        """
        Choose the phase in which simulation i continues from a state with a rejected step.

        Returns
        -------
        (size,) array
            The state in the independent speeds of the new phase.

        Raises
        ------
        ConstraintError
            A kinematic singularity; a loop's residual; rows that contradict each other.
        InputError
            The motion diverges, or a joint moves too far in one step.

        """
        phase = self._phases[i]
        mechanism, t = phase.robot.mechanism, self._time(done)
        q, u = self._parts(state)
        where = self._where(i, done)
        if not (np.abs(q) <= size_limit('q')).all():
            raise self._diverged(i, done)
        self._require_short_step(phase.robot, q, u, t, where)
        stack = stacked(mechanism, q, t)
        now = figure(mechanism, stack, mechanism.free, mechanism.kept)
        best = self._preferred(stack)
        if max(now, best.figure) >= SINGULAR:
            raise singular_error(mechanism, stack, q, t, where, u)
        if GAIN * best.figure < now:
            return self._changed(i, state, best, done)
        watched = self._watched(i, state, done)
        if self._law is not None:
            for _, _, q_next, t_next in watched:
                require_following(phase.robot, self._law.followed, q_next, t_next, where, NEARLY)
        now, stack, q_next, t_next = max(watched, key=itemgetter(0))
        if now > SHARE * phase.limit:
            best = self._preferred(stack)
            if best.figure >= SINGULAR:
                raise singular_error(mechanism, stack, q_next, t_next, where, u)
            if GAIN * best.figure < now:
                return self._changed(i, state, best, done)
            self._enter(i, Phase(phase.robot, ROOM * now))
            return state
        for _, stack, q_next, t_next in watched:
            at = q, t, self._open, where, self.step
            residual_error(mechanism, stack, True, *at)
            left_out_error(mechanism, stack, q_next, t_next, SHARE * self._excess, where)
            residual_error(mechanism, stack, False, *at)
        raise self._diverged(i, done + 1)

    def _require_short_step(self, robot: Robot, q: Array, u: Array, t: float,
                            where: str) -> None:
        """Raise InputError if a joint moves so far in one step that the step cannot be right."""
        at: dict[str, Any] = {'t': t} if robot.equations.timed else {}
        try:
            speeds = joint_speeds(robot.model, q, robot.joint_rates(q, u, **at))
        except (ConstraintError, InputError):
            return  # singular, which is another reason
        moved = np.abs(speeds) * self.step
        in_units = moved / robot.mechanism.units
        worst = int(np.argmax(in_units))
        if in_units[worst] > FARTHEST:
            name = robot.joint_names[worst]
            raise InputError(f"{where}the state diverged: joint '{name}' moves by "
                             f'{moved[worst]:.3g} rad or m in one step of {self.step:g} s; '
                             f'expected at most {FARTHEST * robot.mechanism.units[worst]:.3g}, '
                             'as with a shorter step')

    def _preferred(self, stack: Any) -> Any:
        """Return the user's speeds if they are well conditioned, else the best choice."""
        asked = self.robot.mechanism
        own = best_choice(asked, stack, asked.free)
        return own if own.figure < self._usual / GAIN else best_choice(asked, stack)

    def _changed(self, i: int, state: Array, choice: Any, done: int) -> Array:
        """Change simulation i to another choice; return the state in its speeds."""
        old, t = self._phases[i].robot, self._time(done)
        q, u = self._parts(state)
        new = self.robot.in_choice(choice.free, choice.kept)
        at: dict[str, Any] = {'t': t} if old.equations.timed else {}
        Y, Z = (np.array(x, dtype=np.float64) for x in new.mechanism.state(
            q, t).speed_rows(new.speed_names))
        state = state.copy()
        state[old.n_q:old.n_q + old.n] = Y @ joint_speeds(
            old.model, q, old.joint_rates(q, u, **at)) + Z
        self._enter(i, Phase(new, max(self._usual, ROOM * choice.figure)))
        self._history[i].append((done, new))
        if new.speed_names != old.speed_names:
            self.changes.append(SpeedChange(t, old.speed_names, new.speed_names,
                                            None if self._single else i))
        return state

    def _enter(self, i: int, phase: Phase) -> None:
        self._phases[i] = phase
        self._elsewhere.add(i)

    def _watched(self, i: int, state: Array,
                 done: int) -> list[tuple[float, Any, Array, float]]:
        """Return figure, system, q and time where the next step computes its margin."""
        mechanism = (robot := self._phases[i].robot).mechanism
        tau = self._source_of([i]).torque_at(state, done)
        dual_to = (robot if self._law else self.robot).speed_names
        try:
            stages = watched_configurations(robot, state, tau, dual_to, self.step,
                                            self._integrator)
        except (ConstraintError, ZeroDivisionError):
            raise self._diverged(i, done + 1) from None
        result = []
        for after, q in stages:
            t = self._time(done) + after
            stack = stacked(mechanism, q, t)
            if not np.isfinite(stack.J).all():
                raise self._diverged(i, done + 1)
            result.append((figure(mechanism, stack, mechanism.free, mechanism.kept), stack, q, t))
        return result

    def user_state(self, i: int, state: Array, done: int) -> tuple[Array, Array]:
        """Return q and the user's own speeds of simulation i at one of its states."""
        q, u = self._parts(state)
        robot = self._phases[i].robot
        if robot.speed_names == self.robot.speed_names:
            return q, u
        return q, self._asked.speeds(robot, q, u, np.zeros(robot.n), self._time(done))[0]

    def acting(self, buffer: Array, done: int) -> Any:
        """Return the torques of the steps of a buffer; as `TorqueInput.acting`."""
        if self._law is None:
            return self._source.acting(buffer, done)
        return partial(law_power, self._history, self._source, buffer, done)

    def in_own_speeds(self, buffer: Array, done: int) -> Array:
        """Return a buffer's states in the user's own speeds."""
        return self._asked.states(self._history, buffer, self._source.start, self.step, done)

    def torques(self, kept: Array, q: Array, u: Array) -> Array:
        """Return the torques that acted; as `TorqueInput.torques`."""
        return self._source.torques(kept, q, u)

    def results(self, kept: Array, states: Array, tau: Array) -> dict[str, Array]:
        """Return derived quantities of kept states, in the user's speeds; see `UserSpeeds`."""
        times = self._source.start + kept * np.float64(self.step)
        return self._asked.results(self._history, kept, times, states, tau)

    def _look_closely(self, i: int, rows: Array, done: int) -> None:
        """Raise ConstraintError where a singularity lies between two rows of states."""
        phase = self._phases[i]
        times = self._source.start + (done + np.arange(len(rows))) * np.float64(self.step)
        self._watch.look(phase.robot, phase.limit > ROOM * self._usual, self._parts(rows)[0],
                         times, lambda k: self._where(i, done + k),
                         lambda k: self.user_state(i, rows[k], done + k)[1])

    def _parts(self, state: Array) -> tuple[Array, Array]:
        n_q, n = self.robot.n_q, self.robot.n
        return state[..., :n_q], state[..., n_q:n_q + n]

    def _time(self, done: int) -> float:
        return self._source.start + done * self.step

    def _where(self, i: int, done: int) -> str:
        which = 'simulation' if self._single else f'simulation {i}'
        return f'{which}, {self._time(done):.6g} s: '

    def _diverged(self, i: int, done: int) -> InputError:
        return diverged_error('the simulation' if self._single else f'simulation {i}',
                              self._time(done), self.step)
