"""
Simulations of constrained robots with a change of independent speeds before singularities.

Every native step computes a margin, which is positive for an accepted state
(`mechanics.constraints.conditioning`; where, says `step_kernels.watches_stages`). For a
non-positive margin, Python code finds the reason: ill-conditioned speeds or rows are
replaced, and the simulation continues from the last accepted state; any other reason is
an error. Near a singularity of all choices, and in other speeds than those that the user
named, the states are checked for a singularity between two steps.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque import ComputedTorque, require_following
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.ball_joints import joint_speeds
from kane_dynamics.mechanics.constraints.conditioning import (best_choice,
                                                              constraints_at_fault,
                                                              described, EXCESS, figure,
                                                              in_lengths, LIMITS,
                                                              limits_of, loosened, SHARE,
                                                              SINGULAR, singular_error,
                                                              Stack, stacked,
                                                              WELL_CHOSEN)
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.integrators import integrator_of
from kane_dynamics.mechanics.integrators.interface import StageRates
from kane_dynamics.mechanics.integrators.rosenbrock import ImplicitStep
from kane_dynamics.native.backends.llvm_math import size_limit
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import in_choice, Robot
from kane_dynamics.robot.speed_sets import left_out_error
from kane_dynamics.simulation.observers import diverged_error, Exchange, Extremes
from kane_dynamics.simulation.step_kernels import (deflections_of, presliding_rates,
                                                   state_layout, step_kernel, StepChoice,
                                                   tau_from, watches_stages)
from kane_dynamics.simulation.stepping import Samples, Steps
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
TURN = 0.5  # largest change of S in a step, relative to S, near a singularity


@dataclass(frozen=True)
class Phase:
    """Current speeds of a simulation: its robot, and the largest conditioning figure allowed."""

    robot: Robot
    limit: float


class _Watched(NamedTuple):
    """A place where a step computes its margin: figure, system, q, (n_q,), and time, s."""

    figure: float
    stack: Stack
    q: Array
    t: float


class SwitchingSteps(Steps):
    """
    Steps that change the independent speeds where those in use become singular.

    Parameters
    ----------
    source : TorqueInput
        The native step of the user's robot; torques stay dual to its speeds.
    rows : RowSteps or None
        Rows with modes.
    count : int
        Number of simulations.

    """

    def __init__(self, source: TorqueInput, rows: Any, count: int) -> None:
        """Start all simulations in the robot's own speeds."""
        super().__init__(source, rows)
        self._law: ComputedTorque | None = source.torque if source.follows else None
        self._single = source.single
        mechanism = source.robot.mechanism
        # Limits of the margin: residuals after a step, excess of rows left out,
        # conditioning.
        self._open = loosened(mechanism, STEP_RESIDUAL)
        self._excess = loosened(mechanism, EXCESS)
        self._usual = WELL_CHOSEN * float(np.sqrt(mechanism.model.n))
        # All simulations begin in the user's speeds; those that change have a history.
        self._phases = [Phase(source.robot, self._usual)] * count
        self._switched: set[int] = set()  # simulations that left their first phase
        self._sources: dict[tuple[Robot, float], TorqueInput] = {}
        self._history: list[list[tuple[int, Robot]]] = [[(-1, source.robot)]
                                                        for _ in range(count)]
        self._user = UserSpeeds(source.robot, rows)
        self._watch = SingularityWatch(source.robot, source.step)

    def advance(self, buffer: Array, done: int) -> Extremes | None:
        """Compute the states after each step; as `TorqueInput.advance`."""
        extremes = None
        # Simulations in the same speeds are computed together, in SIMD lanes.
        for simulations in self._groups(len(buffer)):
            if len(simulations) == len(buffer):
                extremes = self._advance(self._source_of(simulations), buffer, done)
            else:
                part = np.ascontiguousarray(buffer[simulations])
                self._advance(self._source_of(simulations), part, done)
                buffer[simulations] = part
        # States with a margin that is not positive end the phase; others may need a
        # closer look.
        accepted = all_trusted(buffer)
        for i in sorted(self._switched):
            if accepted[i]:
                self._look_closely(i, buffer[i], done)
        for i in np.flatnonzero(~accepted).tolist():
            self._resume(i, buffer[i], int(np.argmin(trusted(buffer[i]))), done)
        if self._single:
            return None
        if extremes is None or not accepted.all():
            extremes = buffer[:, 1:].min(axis=1), buffer[:, 1:].max(axis=1)
        return extremes

    def _groups(self, count: int) -> list[list[int]]:
        """Return the simulations in groups of the same phase."""
        if count and not self._switched:
            return [list(range(count))]
        groups: dict[tuple[Robot, float], list[int]] = {}
        for i, phase in enumerate(self._phases[:count]):
            groups.setdefault((phase.robot, phase.limit), []).append(i)
        return list(groups.values())

    def _source_of(self, simulations: Sequence[int]) -> TorqueInput:
        """Return the native step of simulations in the same phase."""
        phase = self._phases[simulations[0]]
        key = phase.robot, phase.limit
        if key not in self._sources:
            # The kernel of the same step in the speeds of the phase, with its limits of
            # the margin.
            constants = self.source.constants.copy()
            residual = in_lengths(self.robot.mechanism, self._open)
            constants[-LIMITS:] = limits_of(phase.limit, residual, self._excess)
            choice = self.source.choice
            if self._law is None:
                choice = StepChoice(False, choice.integrator, self.robot.speed_names)
            self._sources[key] = replace(
                self.source, robot=phase.robot, kernel=step_kernel(phase.robot, *choice),
                choice=choice, constants=constants)
        torque = self.source.torque
        if self._law is None and torque.shape[0] > 1 and len(simulations) < torque.shape[0]:
            torque = np.ascontiguousarray(torque[simulations])
        return replace(self._sources[key], torque=torque, simulations=list(simulations))

    def _resume(self, i: int, rows: Array, rejected: int, done: int) -> None:
        """Continue simulation i from the state before the first rejected row to the last row."""
        # States before the rejected one are accepted after the closer look.
        self._look_closely(i, rows[:rejected], done)
        start, last, piece, tries = rejected - 1, len(rows) - 1, PIECE, 0
        state = rows[start].copy()
        while start < last:
            if tries == MOST_CHANGES:
                raise self._diverged(i, done + start + 1)
            # A new phase from the last accepted state.
            state = self._decided(i, state, done + start)
            tries += 1
            # Steps in the new phase, in growing pieces, until one is rejected.
            while start < last:
                local = np.empty((1, min(piece, last - start) + 1, rows.shape[1]))
                local[0, 0] = state
                source = replace(self._source_of([i]), single=True)
                self._advance(source, local, done + start)
                # Up to the first rejected state, this piece counts.
                good = trusted(local[0])
                reached = len(good) - 1 if good.all() else int(np.argmin(good)) - 1
                self._look_closely(i, local[0, :reached + 1], done + start)
                rows[start + 1:start + reached + 1] = local[0, 1:reached + 1]
                start += reached
                state = local[0, reached].copy()
                if reached:
                    tries = 0
                if not good.all():
                    piece = PIECE
                    break
                piece = 4 * piece

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
        mechanism = phase.robot.mechanism
        t = self._time(done)
        q, u = self._parts(state)
        where = self._where(i, done)
        if not (np.abs(q) <= size_limit('q')).all():
            raise self._diverged(i, done)
        self._require_short_step(phase.robot, q, u, t, where)
        # The speeds at the state itself.
        stack = stacked(mechanism, q, t)
        current = figure(mechanism, stack, mechanism.free, mechanism.kept)
        best = self._preferred(stack)
        # Singular in every choice of speeds: the mechanism itself is.
        if max(current, best.figure) >= SINGULAR:
            raise singular_error(mechanism, stack, q, t, where, u)
        # Other speeds only where they are better by a factor, so that phases do not
        # alternate.
        if GAIN * best.figure < current:
            return self._changed(i, state, best, done)
        # The speeds where the next step computes its margin.
        watched = self._watched(i, state, done)
        if self._law is not None:
            for place in watched:
                require_following(phase.robot, self._law.followed, place.q, place.t,
                                  where, NEARLY)
        worst = max(watched, key=attrgetter('figure'))
        # Beyond the limit of the phase: better speeds, or a limit with room for what is
        # watched.
        if worst.figure > SHARE * phase.limit:
            best = self._preferred(worst.stack)
            if best.figure >= SINGULAR:
                raise singular_error(mechanism, worst.stack, worst.q, worst.t, where, u)
            if GAIN * best.figure < worst.figure:
                return self._changed(i, state, best, done)
            self._enter(i, Phase(phase.robot, ROOM * worst.figure))
            return state
        # The speeds are not at fault: the constraints are, or the motion diverges.
        for place in watched:
            at = q, t, self._open, where, self.step
            residual_error(mechanism, place.stack, True, *at)
            left_out_error(mechanism, place.stack, place.q, place.t,
                           SHARE * self._excess, where)
            residual_error(mechanism, place.stack, False, *at)
        raise self._diverged(i, done + 1)

    def _require_short_step(self, robot: Robot, q: Array, u: Array, t: float,
                            where: str) -> None:
        """Raise InputError if a joint moves so far in one step that the step cannot be right."""
        try:
            speeds = joint_speeds(robot.model, q, robot.joint_rates(q, u, t=t))
        except (ConstraintError, InputError):
            return  # singular, which is another reason
        # The rows may move by at most a part of the mechanism's size in one step.
        moved = np.abs(speeds) * self.step
        in_units = moved / robot.mechanism.units
        worst = int(np.argmax(in_units))
        if in_units[worst] > FARTHEST:
            name = robot.joint_names[worst]
            raise InputError(f"{where}the state diverged: joint '{name}' moves by "
                             f'{moved[worst]:.3g} rad or m in one step of {self.step:g} '
                             's; expected at most '
                             f'{FARTHEST * robot.mechanism.units[worst]:.3g}, as with a '
                             'shorter step')

    def _preferred(self, stack: Stack) -> Any:
        """Return the user's speeds if they are well conditioned, else the best choice."""
        mechanism = self.robot.mechanism
        of_user = best_choice(mechanism, stack, mechanism.free)
        if of_user.figure < self._usual / GAIN:
            return of_user
        return best_choice(mechanism, stack)

    def _changed(self, i: int, state: Array, choice: Any, done: int) -> Array:
        """Change simulation i to another choice; return the state in its speeds."""
        old = self._phases[i].robot
        new = in_choice(self.robot, choice.free, choice.kept)
        t = self._time(done)
        q, u = self._parts(state)

        # The joint rates in the old speeds give the new ones: u = Y q' + Z.
        rates = joint_speeds(old.model, q, old.joint_rates(q, u, t=t))
        Y, Z = new.mechanism.state(q, t).speed_rows(new.speed_names)
        state = state.copy()
        state[old.n_q:old.n_q + old.n] = np.asarray(Y @ rates + Z, dtype=np.float64)
        # A new choice gets the usual limit, or room above its own figure.
        self._enter(i, Phase(new, max(self._usual, ROOM * choice.figure)))
        self._history[i].append((done, new))
        if new.speed_names != old.speed_names:
            self.changes.append(SpeedChange(t, old.speed_names, new.speed_names,
                                            None if self._single else i))
        return state

    def _enter(self, i: int, phase: Phase) -> None:
        """Continue simulation i in a phase."""
        self._phases[i] = phase
        self._switched.add(i)

    def _watched(self, i: int, state: Array, done: int) -> list[_Watched]:
        """Return the places where the next step computes its margin."""
        robot = self._phases[i].robot
        mechanism = robot.mechanism
        # A law computes forces dual to the speeds of this phase, a table those of the
        # simulation.
        source = self._source_of([i])
        dual_to = (self.robot if self._law is None else robot).speed_names
        try:
            stages = watched_configurations(robot, state, source.torque_at(state, done),
                                            dual_to, self.step, source.choice.integrator)
        except (ConstraintError, ZeroDivisionError):
            raise self._diverged(i, done + 1) from None
        result = []
        # The figure at each stage of the next step: the margin would be negative at the
        # worst.
        for seconds, q in stages:
            t = self._time(done) + seconds
            stack = stacked(mechanism, q, t)
            if not np.isfinite(stack.J).all():
                raise self._diverged(i, done + 1)
            conditioning = figure(mechanism, stack, mechanism.free, mechanism.kept)
            result.append(_Watched(conditioning, stack, q, t))
        return result

    def user_state(self,
                   simulation: int, state: Array, done: int) -> tuple[Array, Array]:
        """Return q and the user's own speeds of a simulation at one of its states."""
        q, u = self._parts(state)
        robot = self._phases[simulation].robot
        if robot.speed_names == self.robot.speed_names:
            return q, u
        return q, self._user.speeds(robot, q, u, np.zeros(robot.n), self._time(done))[0]

    def in_user_speeds(self, states: Array, done: int) -> Array:
        """Return a chunk's states in the user's own speeds."""
        return self._user.states(self._history, states, self.start, self.step, done)

    def exchange(self, states: Array, done: int) -> Exchange:
        """Return the torques that exchange energy in a chunk, in the user's own speeds."""
        exchange = super().exchange(states, done)
        torques = exchange.torques
        if self._law is not None:
            # The law computes forces dual to the speeds of each phase.
            torques = partial(law_power, self._history, self.source, states, done)
        return exchange._replace(states=self.in_user_speeds(states, done), torques=torques)

    def results(self, samples: Samples, tau: Array | None = None) -> dict[str, Array]:
        """Return quantities of samples, in the user's speeds; see `UserSpeeds`."""
        parts = [np.ascontiguousarray(part) for part in self._parts(samples.states)]
        # Torques of a table are those of the samples; a law is evaluated in each
        # phase's speeds.
        if tau is None and self._law is None:
            tau = self.source.torques(samples.steps, *parts)
        elif tau is None:  # of each phase
            tau = self._user.law_torques(self._history, self.source, samples.steps,
                                         samples.states)
        times = self.start + samples.steps * np.float64(self.step)
        derived = self._user.results(self._history, samples.steps, times, samples.states,
                                     tau)
        return {'q': parts[0], 'tau': tau, **derived}

    def _look_closely(self, i: int, rows: Array, done: int) -> None:
        """Raise ConstraintError where a singularity lies between two rows of states."""
        phase = self._phases[i]
        # The rows follow each other in whole steps.
        times = self.start + (done + np.arange(len(rows))) * np.float64(self.step)

        def where(k: int) -> str:
            return self._where(i, done + k)

        def speeds(k: int) -> Array:
            return self.user_state(i, rows[k], done + k)[1]
        # Singularities are looked for where the figure is above its usual size.
        near = phase.limit > ROOM * self._usual
        self._watch.look(phase.robot, near, self._parts(rows)[0], times, where, speeds)

    def _parts(self, state: Array) -> tuple[Array, Array]:
        """Return q and u of states, (..., size)."""
        n_q, n = self.robot.n_q, self.robot.n
        return state[..., :n_q], state[..., n_q:n_q + n]

    def _time(self, done: int) -> float:
        """Return the time after `done` steps, s."""
        return self.start + done * self.step

    def _where(self, i: int, done: int) -> str:
        """Return the begin of a message."""
        which = 'simulation' if self._single else f'simulation {i}'
        return f'{which}, {self._time(done):.6g} s: '

    def _diverged(self, i: int, done: int) -> InputError:
        """Return the error for a motion that diverges."""
        which = 'the simulation' if self._single else f'simulation {i}'
        return diverged_error(which, self._time(done), self.step)


class SingularityWatch:
    """
    Detects singularities between successive rows of states.

    Parameters
    ----------
    user_robot : Robot
        The user's robot; independent speeds that the user named must stay regular.
    step : float
        Time between two rows, s.

    """

    def __init__(self, user_robot: Robot, step: float) -> None:
        """Store the robot; kernels compile on first use."""
        self._user_robot, self._step = user_robot, step

    def look(self, robot: Robot, near: bool, q: Array, times: Array,
             where: Callable[[int], str],
             speeds: Callable[[int], Array]) -> None:
        """
        Raise ConstraintError for a singularity between a row and the next.

        Parameters
        ----------
        robot : Robot
            The robot in the current choice of the simulation.
        near : bool
            Whether that choice is nearly singular and no other is better.
        q, times : (K, n_q), (K,) arrays
            Configurations, rad or m, and their times, s.
        where, speeds : callable
            Return the begin of a message, and the user's speeds, for the number of a
            row.

        """
        mechanism, of_user = robot.mechanism, self._user_robot.mechanism
        chosen_by_user = self._user_robot.options['independent'] is not None
        fixed = chosen_by_user and mechanism.free != of_user.free
        if len(q) < 2 or not (near or fixed):
            return
        # The rows of all speeds and constraints, of which a choice of speeds has some.
        time = self._user_robot.equations.time_inputs(times)
        rows = self._rows()(np.ascontiguousarray(q), *time)
        n = len(mechanism.speeds.names)
        constraint_rows = [n + k for k in mechanism.kept]
        if fixed:
            # The determinant of speeds that become singular changes its sign.
            side = np.sign(np.linalg.det(rows[:, [*of_user.free, *constraint_rows]]))
            changes = np.flatnonzero(side[1:] * side[:-1] <= 0.0)
            if len(changes):
                k = int(changes[0])
                raise _singular_choice(of_user, q[k], times[k], where(k), speeds(k))
        if near:
            S = rows[:, [*mechanism.free, *constraint_rows]]
            # From row to row S changes little, unless a singularity lies between them.
            change = np.linalg.solve(S[:-1], S[1:]) - np.eye(n)
            passed = np.flatnonzero(np.linalg.norm(change, axis=(1, 2)) > TURN)
            if len(passed):
                k = int(passed[0])
                raise _dead_point(mechanism, q[k], times[k], where(k), self._step)

    def _rows(self) -> Kernel:
        """Return the kernel of all rows of speeds and constraints, (n_j + m, n_j), by q and t."""
        robot = self._user_robot
        equations = robot.equations
        mechanism = equations.mechanism
        geometry = equations.tree.geometry

        def rows(q: Any, t: Any) -> Any:
            state = mechanism.state(q, t, geometry)
            speed_rows, _ = state.speed_rows(mechanism.speeds.names)
            sizes = np.array(mechanism.sizes)[:, None]
            # In units of the joints and of the rows, as `conditioning` compares them.
            return np.concatenate([speed_rows * mechanism.units,
                                   mechanism.rows(state).J * mechanism.units / sizes])
        return robot.compiled(rows, name='stacked_rows', q=(robot.n_q,),
                              shape=(robot.model.n + len(mechanism.labels),
                                     robot.model.n))


def trusted(states: Array) -> Any:
    """Return which states, (K, size), are finite with a positive margin; first always true."""
    good = np.isfinite(states).all(axis=-1) & (states[:, -1] > 0.0)
    good[0] = True
    return good


def all_trusted(buffer: Array) -> Any:
    """Return for which simulations, (N, K, size), every state is `trusted`."""
    with np.errstate(over='ignore', invalid='ignore'):  # a finite sum has finite terms
        finite = np.isfinite(buffer.sum(axis=(1, 2)))
    good = finite & (buffer[:, 1:, -1] > 0.0).all(axis=1)
    good[~good] = [trusted(states).all() for states in buffer[~good]]
    return good


def _singular_choice(mechanism: Mechanism, q: Array, t: float, where: str,
                     u: Array) -> ConstraintError:
    """Return the error for independent speeds that the user chose and the motion leaves."""
    # The loop whose rows, with the chosen speeds, depend on each other.
    stack = stacked(mechanism, q, t)
    kept = best_choice(mechanism, stack, mechanism.free).kept
    loop = constraints_at_fault(mechanism, stack, mechanism.free, kept)
    return ConstraintError(
        f'{where}the independent speeds {", ".join(mechanism.speed_names)} become '
        f'singular within the next step under {loop}, at {described(mechanism, q)}, u = '
        f'{np.round(u, 9).tolist()}: they do not determine the joint rates there; '
        'expected others, or independent=None, which changes them')


def _dead_point(mechanism: Mechanism, q: Array, t: float, where: str,
                step: float) -> ConstraintError:
    """Return the error for a kinematic singularity between two rows."""
    # The rows that depend on each other there name the loop.
    loop = constraints_at_fault(mechanism, stacked(mechanism, q, t), mechanism.free,
                                mechanism.kept)
    return ConstraintError(
        f'{where}a kinematic singularity (dead point) of {loop} is passed, or so near '
        f'that a step of {step:g} s is too long, at {described(mechanism, q)}: the rows '
        'depend on each other there, and the motion beyond is not determined, or takes '
        'shorter steps')


def residual_error(mechanism: Mechanism, stack: Stack, kept: bool, q: Array, t: float,
                   largest: float, where: str, step: float) -> None:
    """
    Raise ConstraintError if a step from q, t ends at residuals of positions over `largest`.

    With `kept`, if the largest is that of a kept row, else if it is that of another.
    """
    in_lengths_of_rows = stack.residual / mechanism.closure_units
    worst = int(np.argmax(np.abs(in_lengths_of_rows)))
    # The residual is within its share, or the worst row belongs to the other error.
    if np.linalg.norm(in_lengths_of_rows) <= SHARE * largest or kept != (worst in mechanism.kept):
        return
    # Rows that are kept open by drift; others contradict those that are kept.
    constraint = f"{where}constraint '{mechanism.labels[worst]}'"
    unit = 'rad' if mechanism.turning[worst] else 'm'
    residual = f'{abs(stack.residual[worst]):.3g} {unit}'
    if kept:
        raise ConstraintError(
            f'{constraint} opens by {residual} within one step of {step:g} s at '
            f'{described(mechanism, q)}; expected at most '
            f'{largest * mechanism.closure_units[worst]:.3g} {unit}, as with a shorter step')
    raise ConstraintError(
        f'{constraint} contradicts the others at {described(mechanism, q)}, t = {t:.6g} '
        f's: its residual is {residual} where the others hold; expected 0')


class _StagesInNumbers:
    """A robot during one step in NumPy, in the interface of the integrators (`System`)."""

    tree_terms = None  # robots whose speeds change have constraints

    def __init__(self, robot: Robot, state: Array, tau: Array, dual_to: tuple[str, ...],
                 step: float) -> None:
        """Store the arguments of `watched_configurations`."""
        self.equations: Any = robot.equations
        # Where the margin is computed, filled in by the step itself.
        self.stages: list[tuple[float, Array]] = []
        self._tau = tau
        self._dual_to = dual_to
        self._step = step
        self._split = [robot.n_q, robot.n_q + robot.n]
        self.bristles = len(robot.equations.tree.bristles)
        self._robot = robot
        self._time = state[state_layout(robot).time]
        self.start = self._time[0] if len(self._time) else 0.0
        self._block = robot.parameters.block[:robot.parameters.physical]
        no_wrench = robot.kernels.no_wrench
        self._wrench = no_wrench if len(no_wrench) else None

    def _stage(self, q: Array, moment: int) -> tuple[Array, float]:
        """Store the configuration of a stage; return the torque, (n,), and the time."""
        seconds = 0.5 * moment * self._step
        self.stages.append((seconds, np.asarray(q, dtype=np.float64)))
        t = self.start + seconds
        return tau_from(self.equations, self._dual_to, q, self._tau, t), t

    def rates(self, state: Any, moment: int) -> Any:
        """Return the rates of q, u, time, deflections and margin."""
        # The rates of the step's stages, by the same equations as its kernel.
        q, u, _ = np.split(state, self._split)
        tau, t = self._stage(q, moment)
        *time, margin = self.quadratures(q, u, moment)
        if not self.bristles:
            rates = self.equations.state_rates(q, u, tau, self._wrench, self._block, t)
            return np.array([*rates, *time, margin], dtype=np.float64)
        rates = presliding_rates(self._robot, q, u, tau, self._wrench, self._block, t,
                                 deflections_of(self._robot, state))
        end = len(rates) - self.bristles
        return np.array([*rates[:end], *time, *rates[end:], margin], dtype=np.float64)

    def torque(self, q: Any, u: Any, moment: int) -> Any:
        """Return the held torque."""
        return self._tau

    def implicit_stage(self, q: Any, u: Any, tau: Any, before: StageRates, g: Any,
                       moment: int, deflections: Any) -> StageRates:
        """Return the rates of a stage of the linearly implicit equations."""
        generalized, t = self._stage(q, moment)
        bent = deflections if self.bristles else None
        rates = ImplicitStep(self.equations).stage(q, u, generalized, before, g,
                                                   self._wrench, self._block, t,
                                                   deflections=bent)
        return StageRates(*(np.asarray(x, dtype=np.float64) for x in rates))

    def quadratures(self, q: Any, u: Any, moment: int) -> Any:
        """Return the rates of time and margin."""
        return np.array([*(1.0 for _ in self._time), 0.0])


def watched_configurations(robot: Robot, state: Array, tau: Array,
                           dual_to: tuple[str, ...],
                           step: float, integrator: str) -> list[tuple[float, Array]]:
    """
    Return where a step computes its margin: times after its start, s, and q, (n_q,).

    They are computed in NumPy, without the correction of closed loops.

    Parameters
    ----------
    robot : Robot
        With constraints.
    state : (size,) array
        Entries as `state_names`; rad or m, and s.
    tau : (n,) array
        Dual to the speeds named `dual_to`, held during the step; N m or N.
    dual_to : tuple of str
        Names of independent speeds.
    step : float
        s.
    integrator : str
        One of `mechanics.integrators.INTEGRATORS`.

    Raises
    ------
    ConstraintError, ZeroDivisionError
        The mass matrix, or the system of speeds and constraints, is singular.

    """
    # The step itself, in plain numbers, calls `motion` where the kernel computes its
    # margin.
    motion = _StagesInNumbers(robot, state, tau, dual_to, step)
    with np.errstate(all='ignore'):
        after = integrator_of(integrator).step(motion, state, step)
    if not watches_stages(robot, state[:robot.n_q], motion.start):
        return [(step, np.asarray(after[:robot.n_q], dtype=np.float64))]
    return motion.stages
