"""
Steps of constrained robots: in which independent speeds, and up to which singularity.

A state has the joint rates, so that each step can be computed in whichever independent
speeds are well conditioned there. Every native step computes a margin, which is positive
for an accepted state (`mechanics.constraints.conditioning`; where, says
`step_kernels.watches_stages`). For a non-positive margin, Python code finds the reason:
ill-conditioned speeds or rows are replaced, and the steps go on from the last accepted
state; any other reason is an error. Near a singularity of all choices, the states are
checked for a singularity between two steps.
"""

from collections.abc import Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque import ComputedTorque, require_following
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints.conditioning import (best_choice,
                                                              constraints_at_fault,
                                                              described, EXCESS, figure,
                                                              in_lengths, LIMITS,
                                                              limits_of, loosened, SHARE,
                                                              SINGULAR, singular_error,
                                                              Stack, stacked,
                                                              WELL_CHOSEN)
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.native.backends.llvm_math import size_limit
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.kernel_set import kernel_per_robot
from kane_dynamics.robot.robot import in_choice, Robot
from kane_dynamics.robot.speed_sets import left_out_error
from kane_dynamics.simulation.motion_samples import dual_forces, speeds_in, state_parts
from kane_dynamics.simulation.observers import diverged_error, Exchange
from kane_dynamics.simulation.step_kernels import step_kernel, StepChoice, watches_stages
from kane_dynamics.simulation.stepping import Samples, Steps
from kane_dynamics.simulation.torque_input import TorqueInput
import numpy as np

STEP_RESIDUAL = 1e-3  # rad or lengths: largest residual after a step, before the correction
GAIN = 2.0  # smallest ratio of the old figure to that of a new choice
ROOM = 4.0  # a choice is kept until its figure has grown by this factor
FAR = 3.0  # of the motion of a step, and of the size of the mechanism
FARTHEST = 3.0  # rad, or lengths of the mechanism: largest motion of a joint in one step
PIECE = 256  # steps after a change before the next check of the states
MOST_CHANGES = 20  # at one state
NEARLY = 0.65  # of the largest transmission: its limit holds for the sum of two squares
TURN = 0.5  # largest change of S in a step, relative to S, near a singularity


class Phase(NamedTuple):
    """Current speeds of a simulation: its robot, and the largest conditioning figure allowed."""

    robot: Robot
    limit: float


class _Watched(NamedTuple):
    """A place where a step computes its margin: figure, system, q, (n_q,), and time, s."""

    figure: float
    stack: Stack
    q: Array
    t: float


class ConstrainedSteps(Steps):
    """
    Steps in independent speeds that change where those in use become singular.

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
        # All simulations begin in the user's speeds.
        self._phases = [Phase(source.robot, self._usual)] * count
        self._changed: set[int] = set()  # simulations that left their first phase
        self._sources: dict[tuple[Robot, float], TorqueInput] = {}

    def advance(self, buffer: Array, done: int) -> None:
        """Compute the states after each step; as `TorqueInput.advance`."""
        # Simulations in the same speeds are computed together, in SIMD lanes.
        for simulations in self._groups(len(buffer)):
            if len(simulations) == len(buffer):
                self._advance(self._source_of(simulations), buffer, done)
            else:
                part = np.ascontiguousarray(buffer[simulations])
                self._advance(self._source_of(simulations), part, done)
                buffer[simulations] = part
        # States with a margin that is not positive end the phase; others may need a
        # closer look.
        accepted = all_trusted(buffer)
        for i in sorted(self._changed):
            if accepted[i]:
                self._look_closely(i, buffer[i], done)
        for i in np.flatnonzero(~accepted).tolist():
            self._resume(i, buffer[i], int(np.argmin(trusted(buffer[i]))), done)

    def _groups(self, count: int) -> list[list[int]]:
        """Return the simulations in groups of the same phase."""
        if count and not self._changed:
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
        state, beyond = rows[start].copy(), rows[rejected].copy()
        while start < last:
            if tries == MOST_CHANGES:
                raise self._diverged(i, done + start + 1)
            # A new phase from the last accepted state.
            self._decide(i, state, beyond, done + start)
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
                    beyond, piece = local[0, reached + 1].copy(), PIECE
                    break
                piece = 4 * piece

    def _decide(self, i: int, state: Array, beyond: Array, done: int) -> None:
        """
        Choose the phase in which simulation i continues from a state with a rejected step.

        `beyond` is the rejected state, before loops are closed.

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
        (q, v, _), u = state_parts(self.robot, state), speeds_in(self.robot, state)
        where = self._where(i, done)
        if not (np.abs(q) <= size_limit('q')).all():
            raise self._diverged(i, done)
        self._require_short_step(v, where)
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
            self._change(i, best)
            return
        # The speeds where the next step computes its margin.
        watched = self._watched(i, state, beyond, done)
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
                self._change(i, best)
            else:
                self._enter(i, Phase(phase.robot, ROOM * worst.figure))
            return
        # The speeds are not at fault: the constraints are, or the motion diverges.
        for place in watched:
            at = q, t, self._open, where, self.step
            residual_error(mechanism, place.stack, True, *at)
            left_out_error(mechanism, place.stack, place.q, place.t,
                           SHARE * self._excess, where)
            residual_error(mechanism, place.stack, False, *at)
        raise self._diverged(i, done + 1)

    def _require_short_step(self, v: Array, where: str) -> None:
        """Raise InputError if a joint moves so far in one step that the step cannot be right."""
        # The rows may move by at most a part of the mechanism's size in one step.
        robot = self.robot
        moved = np.abs(v) * self.step
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

    def _change(self, i: int, choice: Any) -> None:
        """Continue simulation i in another choice of speeds and rows."""
        robot = in_choice(self.robot, choice.free, choice.kept)
        # A new choice gets the usual limit, or room above its own figure.
        self._enter(i, Phase(robot, max(self._usual, ROOM * choice.figure)))

    def _enter(self, i: int, phase: Phase) -> None:
        """Continue simulation i in a phase."""
        self._phases[i] = phase
        self._changed.add(i)

    def _watched(self, i: int, state: Array, beyond: Array, done: int) -> list[_Watched]:
        """Return the places where the next step computes its margin, by its rejected end."""
        mechanism = self._phases[i].robot.mechanism
        q, v, _ = state_parts(self.robot, state)
        travel = self.step * coordinate_rates(self.robot.model, q, v)
        end = beyond[:len(q)]
        # The dynamics of a singular state may have put the end anywhere.
        size = self.robot.mechanism.units.max()
        if not (np.abs(end - q) <= FAR * (np.abs(travel) + size)).all():
            end = q + travel
        t = self._time(done)
        places = [(end, t + self.step)]
        if watches_stages(self.robot, q, t):
            places += [(q, t), (0.5 * (q + end), t + 0.5 * self.step)]
        result = []
        for place, time in places:
            stack = stacked(mechanism, place, time)
            if not np.isfinite(stack.J).all():
                raise self._diverged(i, done + 1)
            conditioning = figure(mechanism, stack, mechanism.free, mechanism.kept)
            result.append(_Watched(conditioning, stack, place, time))
        return result

    def _choices(self) -> list[Robot]:
        """Return the robots in the choices of speeds so far, the user's first."""
        return list(dict.fromkeys([self.robot, *(robot for robot, _ in self._sources)]))

    def best_choices(self, states: Array, times: Array) -> list[tuple[Robot, Any]]:
        """Return robots with the numbers of those of K states that are regular in their speeds."""
        robots = self._choices()
        if len(robots) == 1 or not len(states):
            return super().best_choices(states, times)
        q, _, _ = state_parts(self.robot, states)
        rows = stacked_rows(self.robot)(q, *self.robot.equations.time_inputs(times))
        conditions = []
        for robot in robots:
            S = rows[:, system_places(robot.mechanism)]
            conditions.append(np.linalg.cond(S / np.linalg.norm(S, axis=2, keepdims=True)))
        best = np.argmin(conditions, axis=0)
        return [(robots[k], np.flatnonzero(best == k)) for k in np.unique(best)]

    def exchange(self, states: Array, done: int) -> Exchange:
        """Return the torques that exchange energy in a chunk."""
        exchange = super().exchange(states, done)
        if self._law is None or len(self._choices()) == 1:
            return exchange

        def power(rows: Array) -> Array:
            # The law computes forces dual to the speeds of each choice.
            result = np.empty((len(states), len(rows)))
            for i, of_one in enumerate(states[:, rows]):
                for robot, k in self.best_choices(of_one, self._time(done + rows)):
                    source = replace(self.source, robot=robot)
                    power_of_choice: Any = source.acting(states[i:i + 1], done)
                    result[i, k] = power_of_choice(rows[k])[0]
            return result
        return exchange._replace(torques=power)

    def torques(self, samples: Samples) -> Array:
        """Return the torques of samples, (N, K, n), dual to the user's speeds."""
        if self._law is None or len(self._choices()) == 1:
            return super().torques(samples)
        tau = np.empty((*samples.states.shape[:2], self.robot.n))
        times = self._time(samples.steps)
        for i, states in enumerate(samples.states):
            for robot, k in self.best_choices(states, times):
                source = replace(self.source, robot=robot)
                forces = source.torques(samples.steps[k], states[None, k])[0]
                q, _, _ = state_parts(robot, states[k])
                tau[i, k] = dual_forces(robot, self.robot, q, forces, times[k])
        return tau

    def _look_closely(self, i: int, rows: Array, done: int) -> None:
        """
        Raise ConstraintError where a singularity lies between two rows of states.

        They are looked for where the figure is above its usual size, and no other choice is
        better.
        """
        robot, limit = self._phases[i]
        if len(rows) < 2 or limit <= ROOM * self._usual:
            return
        times = self._time(done + np.arange(len(rows)))
        q, _, _ = state_parts(self.robot, rows)
        of_all = stacked_rows(self.robot)(q, *self.robot.equations.time_inputs(times))
        # From row to row S changes little, unless a singularity lies between them.
        S = of_all[:, system_places(robot.mechanism)]
        change = np.linalg.solve(S[:-1], S[1:]) - np.eye(robot.model.n)
        passed = np.flatnonzero(np.linalg.norm(change, axis=(1, 2)) > TURN)
        if len(passed):
            k = int(passed[0])
            raise _dead_point(robot.mechanism, q[k], times[k], self._where(i, done + k),
                              self.step)

    def _time(self, done: Any) -> Any:
        """Return the time after `done` steps, or several such numbers, s."""
        return self.start + done * np.float64(self.step)

    def _where(self, i: int, done: int) -> str:
        """Return the begin of a message."""
        which = 'simulation' if self._single else f'simulation {i}'
        return f'{which}, {self._time(done):.6g} s: '

    def _diverged(self, i: int, done: int) -> InputError:
        """Return the error for a motion that diverges."""
        which = 'the simulation' if self._single else f'simulation {i}'
        return diverged_error(which, self._time(done), self.step)


@kernel_per_robot
def stacked_rows(robot: Robot) -> Kernel:
    """Return the kernel of all rows of speeds and constraints, (n_j + m, n_j), by q and t."""
    equations = robot.equations
    mechanism = equations.mechanism

    def rows(q: Any, t: Any) -> Any:
        state = mechanism.state(q, t, equations.tree.geometry)
        speed_rows, _ = state.speed_rows(mechanism.speeds.names)
        sizes = np.array(mechanism.sizes)[:, None]
        # In units of the joints and of the rows, as `conditioning` compares them.
        return np.concatenate([speed_rows * mechanism.units,
                               mechanism.rows(state).J * mechanism.units / sizes])
    n_j = robot.model.n
    return robot.compiled(rows, name='stacked_rows', q=(robot.n_q,),
                          shape=(n_j + len(mechanism.labels), n_j))


def system_places(mechanism: Mechanism) -> list[int]:
    """Return the rows of `stacked_rows` that determine the motion in a choice."""
    n = len(mechanism.speeds.names)
    return [*mechanism.free, *(n + k for k in mechanism.kept)]


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
