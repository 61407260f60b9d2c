"""
Simulations of constrained robots: their conditioning is watched, and other speeds taken in time.

Every native step ends in a margin, which is positive where its state may be trusted
(`mechanics.constraints.conditioning`). Where it is not, what is wrong is found out in Python:
independent speeds or rows that come to depend on each other are replaced by the best ones, and the
simulation goes on from the last good state; anything else is an error that says what happened.
Near a singularity of all choices every step is looked at.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.constraints.conditioning import (best_choice, constraints_at_fault,
                                                              described, EXCESS, figure, LIMITS,
                                                              SHARE, SINGULAR, singular_error,
                                                              stacked, WELL_CHOSEN)
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.integrators.runge_kutta import runge_kutta_4
from kane_dynamics.native.runtime.kernel import Argument, Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.speed_sets import left_out_error, limits_of
from kane_dynamics.simulation.step_kernels import step_kernel
from kane_dynamics.simulation.torque_input import TorqueInput
from kane_dynamics.simulation.trajectory import SpeedChange
import numpy as np

STEP_RESIDUAL = 1e-3  # m or rad: what one step may open a loop by before it is closed again
GAIN = 2.0  # so much better others must be to be taken
ROOM = 4.0  # a choice is kept until its figure is so much larger than when it was taken
TURN = 0.5  # largest change of S in a step, relative to S, near a singularity
PIECE = 256  # steps after a change before the states are looked at again
MOST_CHANGES = 20  # at one state


@dataclass(frozen=True)
class Phase:
    """The choice that a simulation uses: a robot in it, and the largest figure allowed."""

    robot: Robot
    limit: float


def trusted(states: Array) -> Any:
    """Tell which states, (..., size), are finite and end in a positive margin; the first is."""
    good = np.isfinite(states).all(axis=-1) & (states[..., -1] > 0.0)
    good[..., 0] = True
    return good


class SwitchingInput:
    """
    A torque input that goes on in other independent speeds where those in use become singular.

    Parameters
    ----------
    source : TorqueInput
        Of the robot as the user made it; its torques stay dual to that robot's speeds.
    count : int
        Number of simulations.
    integrator : str
        One of `step_kernels.INTEGRATORS`.

    Attributes
    ----------
    changes : list of SpeedChange
        In the order of the simulations' steps, each simulation by itself.

    """

    def __init__(self, source: TorqueInput, count: int, integrator: str, single: bool) -> None:
        """Begin in the robot's own speeds."""
        self.robot, self.step = source.robot, source.step
        self.torque = source.torque
        self._source, self._integrator, self._single = source, integrator, single
        mechanism = self._mechanism(source.robot)
        self._usual = WELL_CHOSEN * float(np.sqrt(mechanism.model.n))
        self._phases = [Phase(source.robot, self._usual)] * count
        self._elsewhere: set[int] = set()  # simulations in another phase than the first
        self._sources: dict[tuple[int, float], TorqueInput] = {}
        self._history: list[list[tuple[int, Robot]]] = [[(-1, source.robot)]
                                                        for _ in range(count)]
        self.changes: list[SpeedChange] = []

    @staticmethod
    def _mechanism(robot: Robot) -> Mechanism:
        return robot.mechanism

    @staticmethod
    def _equations(robot: Robot) -> ConstrainedEquations:
        assert isinstance(robot.equations, ConstrainedEquations)
        return robot.equations

    def advance(self, buffer: Array, done: int, single: bool) -> tuple[Array, Array] | None:
        """Fill in the states after each step; as `TorqueInput.advance`."""
        every = list(range(len(buffer)))
        groups: dict[tuple[int, float], list[int]] = {}
        for i in every if self._elsewhere else []:
            groups.setdefault((id(self._phases[i].robot), self._phases[i].limit), []).append(i)
        extremes = None
        for places in list(groups.values()) or [every]:
            source = self._source_of(places)
            if len(places) == len(buffer):
                extremes = source.advance(buffer, done, single)
            else:
                part = np.ascontiguousarray(buffer[places])
                source.advance(part, done, False)
                buffer[places] = part
        good = trusted(buffer)
        whole = good.all(axis=1)
        for i in sorted(self._elsewhere):
            if whole[i]:
                self._look_closely(i, buffer[i], done)
        for i in np.flatnonzero(~whole).tolist():
            self._resume(i, buffer[i], int(np.argmin(good[i])), done)
        if single:
            return None
        if extremes is None or not whole.all():
            extremes = buffer[:, 1:].min(axis=1), buffer[:, 1:].max(axis=1)
        return extremes

    def _source_of(self, places: Sequence[int]) -> TorqueInput:
        """Return the native step of these simulations, which are in one phase."""
        phase = self._phases[places[0]]
        key = id(phase.robot), phase.limit
        if key not in self._sources:
            constants = self._source.constants.copy()
            constants[-LIMITS:] = limits_of(phase.limit, STEP_RESIDUAL)
            kernel = step_kernel(phase.robot, False, self._integrator, self.robot.speed_names)
            self._sources[key] = TorqueInput(phase.robot, kernel, self.step, constants, None,
                                             self._source.start)
        torque = self.torque
        if torque.shape[0] > 1 and len(places) < torque.shape[0]:
            torque = np.ascontiguousarray(torque[places])
        return replace(self._sources[key], torque=torque)

    def _resume(self, i: int, rows: Array, bad: int, done: int) -> None:
        """Go on with simulation i from the state before the first bad row, to the last one."""
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
        Choose how simulation i goes on from a state whose next step is not to be trusted.

        Returns
        -------
        (size,) array
            The state in the speeds that are independent from now on.

        Raises
        ------
        ConstraintError
            A kinematic singularity; a loop that opens; rows that contradict each other.
        InputError
            The motion diverges.

        """
        phase = self._phases[i]
        mechanism, t = self._mechanism(phase.robot), self._time(done)
        q, u = self._parts(state)
        where = self._where(i, done)
        stack = stacked(mechanism, q, t)
        now = figure(mechanism, stack, mechanism.free, mechanism.kept)
        best = self._preferred(stack)
        if max(now, best.figure) >= SINGULAR:
            raise singular_error(mechanism, stack, q, t, where, u)
        if GAIN * best.figure < now:
            return self._changed(i, state, best, done)
        q_next = self._next(i, state, done)
        t_next = self._time(done + 1)
        stack = stacked(mechanism, q_next, t_next)
        if not np.isfinite(stack.J).all():
            raise self._diverged(i, done + 1)
        now = figure(mechanism, stack, mechanism.free, mechanism.kept)
        if now > SHARE * phase.limit:
            best = self._preferred(stack)
            if best.figure >= SINGULAR:
                raise singular_error(mechanism, stack, q_next, t_next, where, u)
            if GAIN * best.figure < now:
                return self._changed(i, state, best, done)
            self._enter(i, Phase(phase.robot, ROOM * now))
            return state
        worst = int(np.argmax(np.abs(stack.gap)))
        if np.linalg.norm(stack.gap) > SHARE * STEP_RESIDUAL and worst in mechanism.kept:
            raise ConstraintError(
                f"{where}constraint '{mechanism.labels[worst]}' opens by "
                f'{abs(stack.gap[worst]):.3g} (m or rad) within one step of {self.step:g} s at '
                f'{described(mechanism, q)}; expected at most {STEP_RESIDUAL:g}: shorten the step')
        left_out_error(mechanism, stack, q_next, t_next, SHARE * EXCESS, where)
        if np.linalg.norm(stack.gap) > SHARE * STEP_RESIDUAL:
            raise ConstraintError(
                f"{where}constraint '{mechanism.labels[worst]}' contradicts the others at "
                f'{described(mechanism, q)}, t = {t:.6g} s: its residual is '
                f'{abs(stack.gap[worst]):.3g} (m or rad) where they hold')
        raise self._diverged(i, done + 1)

    def _preferred(self, stack: Any) -> Any:
        """Return the user's speeds where they are well conditioned, else the best choice."""
        asked = self._mechanism(self.robot)
        own = best_choice(asked, stack, asked.free)
        return own if own.figure < self._usual / GAIN else best_choice(asked, stack)

    def _changed(self, i: int, state: Array, choice: Any, done: int) -> Array:
        """Return a state in the speeds of another choice, which simulation i uses from now on."""
        old, t = self._phases[i].robot, self._time(done)
        q, u = self._parts(state)
        new = self.robot.in_choice(choice.free, choice.kept)
        at: dict[str, Any] = {'t': t} if old.equations.timed else {}
        Y, Z = (np.array(x, dtype=np.float64) for x in self._mechanism(new).posture(
            q, t).speed_rows(new.speed_names))
        state = state.copy()
        state[old.n_q:old.n_q + old.n] = Y @ old.joint_rates(q, u, **at) + Z
        self._enter(i, Phase(new, max(self._usual, ROOM * choice.figure)))
        self._history[i].append((done, new))
        if new.speed_names != old.speed_names:
            self.changes.append(SpeedChange(t, old.speed_names, new.speed_names,
                                            None if self._single else i))
        return state

    def _enter(self, i: int, phase: Phase) -> None:
        self._phases[i] = phase
        self._elsewhere.add(i)

    def _next(self, i: int, state: Array, done: int) -> Array:
        """Return the configuration one step on, before loops are closed, in plain numbers."""
        robot = self._phases[i].robot
        equations: Any = robot.equations
        n_q, n = robot.n_q, robot.n
        block = robot.parameters.block[:robot.parameters.physical]
        wrench = robot.kernels.no_wrench if len(robot.kernels.no_wrench) else None
        table = self.torque[min(i, len(self.torque) - 1)]
        tau = table[min(done, len(table) - 1)]

        def rates(x: Any, given: Any) -> Any:
            time = x[n_q + n:-1]
            found = equations.state_rates(x[:n_q], x[n_q:n_q + n], tau, wrench, block,
                                          time[0] if len(time) else 0.0, self.robot.speed_names)
            return np.array([*found, *(1.0 for _ in time), 0.0],
                            dtype=np.float64)
        with np.errstate(all='ignore'):
            try:
                after = runge_kutta_4(rates, state, (tau, tau, tau), self.step)
            except (ConstraintError, ZeroDivisionError):
                raise self._diverged(i, done + 1) from None
        return np.asarray(after[:n_q], dtype=np.float64)

    def _look_closely(self, i: int, rows: Array, done: int) -> None:
        """
        Raise ConstraintError where a row of states and the next are on two sides of a singularity.

        Looked at where the choice in use is close to singular, and where the speeds that the user
        fixed are not those in use.
        """
        phase = self._phases[i]
        mechanism, asked = self._mechanism(phase.robot), self._mechanism(self.robot)
        near = phase.limit > ROOM * self._usual
        fixed = self.robot.speeds_are_given and mechanism.free != asked.free
        if len(rows) < 2 or not (near or fixed):
            return
        times = [self._time(done + k) for k in range(len(rows))]
        every = self._rows_kernel()(np.ascontiguousarray(rows[:, :self.robot.n_q]),
                                    *([np.array(times)] if self.robot.equations.timed else []))
        n = len(mechanism.speeds.names)
        kept = [n + k for k in mechanism.kept]
        if fixed:
            side = np.sign(np.linalg.det(every[:, [*asked.free, *kept]]))
            crossed = np.flatnonzero(side[1:] * side[:-1] <= 0.0)
            if len(crossed):
                k = int(crossed[0])
                raise self._fixed_error(i, rows[k], done + k)
        if near:
            S = every[:, [*mechanism.free, *kept]]
            turn = np.linalg.solve(S[:-1], S[1:]) - np.eye(n)
            far = np.flatnonzero(np.linalg.norm(turn, axis=(1, 2)) > TURN)
            if len(far):
                k = int(far[0])
                q = rows[k, :self.robot.n_q]
                loop = constraints_at_fault(mechanism, stacked(mechanism, q, times[k]),
                                            mechanism.free, mechanism.kept)
                raise ConstraintError(
                    f'{self._where(i, done + k)}a kinematic singularity (dead point) of {loop} '
                    f'is passed, or so near that a step of {self.step:g} s is too long, at '
                    f'{described(mechanism, q)}: the rows depend on each other there, and the '
                    'motion beyond is not determined, or takes shorter steps')

    def _fixed_error(self, i: int, state: Array, done: int) -> ConstraintError:
        asked, t = self._mechanism(self.robot), self._time(done)
        q, _ = self._parts(state)
        stack = stacked(asked, q, t)
        best = best_choice(asked, stack, asked.free)
        loop = constraints_at_fault(asked, stack, asked.free, best.kept)
        u = self.asked_state(i, state, done)[1]
        return ConstraintError(
            f'{self._where(i, done)}the independent speeds {", ".join(asked.speed_names)} become '
            f'singular within the next step under {loop}, at {described(asked, q)}, '
            f'u = {np.round(u, 9).tolist()}: they do not determine the joint rates there; take '
            'others, or independent=None, which changes them on the way')

    def _rows_kernel(self) -> Kernel:
        """Return the kernel of all rows of speeds and constraints, (n_q + m, n_q), by q and t."""
        robot = self.robot
        mechanism, equations = self._mechanism(robot), self._equations(robot)
        inputs: Any = [('q', (robot.n_q,)), *([('t', ())] if equations.timed else [])]
        shape = robot.n_q + len(mechanism.labels), robot.n_q

        def rows(q: Any, *rest: Any) -> Any:
            here = mechanism.posture(q, rest[0][()] if equations.timed else 0.0,
                                     equations.tree.geometry)
            return np.concatenate([here.speed_rows(mechanism.speeds.names)[0] * mechanism.units,
                                   mechanism.rows(here).J * mechanism.units
                                   / np.array(mechanism.sizes)[:, None]])
        block = robot.parameters.block
        return robot.kernels.extra(
            'stacked_rows', lambda: trace_program('stacked_rows', rows, [
                *inputs, ('parameters', block.shape)]),
            [Argument(*x) for x in inputs], block, shape)

    def asked_state(self, i: int, state: Array, done: int) -> tuple[Array, Array]:
        """Return q and the user's own speeds of simulation i at a state that it is in."""
        q, u = self._parts(state)
        robot = self._phases[i].robot
        if robot.speed_names == self.robot.speed_names:
            return q, u
        return q, self._in_asked(robot, q, u, np.zeros(robot.n), self._time(done))[0]

    def _in_asked(self, robot: Robot, q: Array, u: Array, udot: Array, t: Any) -> Array:
        """Return the user's own speeds and their rates, (2, n) or (K, 2, n)."""
        names, equations = self.robot.speed_names, self._equations(robot)
        arguments = [Argument('q', (robot.n_q,)), Argument('u', (robot.n,)),
                     Argument('udot', (robot.n,))]
        return self._extra(robot, 'other_speeds', arguments, (2, len(names)), lambda q, u, udot, t:
                           equations.other_speeds(names, q, u, udot, t), (q, u, udot), t)

    def _tau_from(self, robot: Robot, q: Array, tau: Array, t: Any) -> Array:
        """Return what amounts to forces dual to the user's own speeds."""
        names, equations = self.robot.speed_names, self._equations(robot)
        return self._extra(robot, 'tau_from', [Argument('q', (robot.n_q,)),
                                               Argument('tau', (len(names),))], (robot.n,),
                           lambda q, tau, t: equations.tau_from(names, q, tau, t), (q, tau), t)

    def _extra(self, robot: Robot, name: str, arguments: list[Argument], shape: Any,
               function: Any, values: tuple[Array, ...], t: Any) -> Array:
        timed = robot.equations.timed
        arguments = [*arguments, *([Argument('t', ())] if timed else [])]
        block, count = robot.parameters.block, len(values)
        places = '_'.join(map(str, self._mechanism(self.robot).free))
        kernel = robot.kernels.extra(f'{name}_{places}', lambda: trace_program(
            name, lambda *x: function(*x[:count], x[count][()] if timed else 0.0),
            [*((a.name, a.shape) for a in arguments), ('parameters', block.shape)]),
            arguments, block, shape)
        result: Array = kernel(*values, *([t] if timed else []))
        return result

    def results(self, kept: Array, states: Array, tau: Array) -> dict[str, Array]:
        """
        Return what follows from kept states, in the user's own speeds.

        Parameters
        ----------
        kept : (K,) array of int
            Numbers of the steps after which the states were.
        states, tau : (N, K, size), (N, K, n) arrays
            As they were simulated, and torques dual to the user's own speeds.

        Returns
        -------
        dict of (N, K, ...) arrays
            u, udot, energy, forces and residuals of constraints.

        """
        groups: dict[int, tuple[Robot, list[tuple[int, slice]]]] = {}
        for i, history in enumerate(self._history):
            begins = np.searchsorted(kept, [step for step, _ in history], side='right')
            for (_, robot), first, last in zip(history, begins, [*begins[1:], len(kept)]):
                if last > first:
                    groups.setdefault(id(robot), (robot, []))[1].append((i, slice(first, last)))
        result: dict[str, Array] = {}
        for robot, places in groups.values():
            rows = np.concatenate([states[i, part] for i, part in places])
            forces = np.concatenate([tau[i, part] for i, part in places])
            times = np.concatenate([self._source.start + kept[part] * np.float64(self.step)
                                    for _, part in places])
            found = self._derived(robot, rows, forces, times)
            for name, values in found.items():
                if name not in result:
                    result[name] = np.empty((*states.shape[:2], *values.shape[1:]))
                begin = 0
                for i, part in places:
                    count = part.stop - part.start
                    result[name][i, part] = values[begin:begin + count]
                    begin += count
        return result

    def _derived(self, robot: Robot, rows: Array, tau: Array, times: Array) -> dict[str, Array]:
        at: dict[str, Any] = {'t': times} if robot.equations.timed else {}
        q, u = (np.ascontiguousarray(x) for x in self._parts(rows))
        same = robot.speed_names == self.robot.speed_names
        own = tau if same else self._tau_from(robot, q, tau, times)
        udot = robot.forward_dynamics(q, u, own, **at)
        pair = np.stack([u, udot], axis=1) if same else self._in_asked(robot, q, u, udot, times)
        return {'u': pair[:, 0], 'udot': pair[:, 1],
                'energy': np.stack([robot.kinetic_energy(q, u, **at), robot.potential_energy(q)],
                                   axis=1),
                'constraint_forces': robot.constraint_forces(q, u, own, **at),
                'constraint_residual': robot.constraint_residual(q, **at),
                'constraint_velocity_residual': robot.constraint_velocity_residual(q, u, **at)}

    def _parts(self, state: Array) -> tuple[Array, Array]:
        n_q, n = self.robot.n_q, self.robot.n
        return state[..., :n_q], state[..., n_q:n_q + n]

    def _time(self, done: int) -> float:
        return self._source.start + done * self.step

    def _where(self, i: int, done: int) -> str:
        which = 'simulation' if self._single else f'simulation {i}'
        return f'{which}, {self._time(done):.6g} s: '

    def _diverged(self, i: int, done: int) -> InputError:
        which = 'the simulation' if self._single else f'simulation {i}'
        return InputError(f'{which} leaves the finite numbers at {self._time(done):.6g} s: is the '
                          f'mass matrix singular there, or the step of {self.step} s too long?')
