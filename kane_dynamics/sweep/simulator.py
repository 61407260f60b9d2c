"""
Simulate chunks of trials in SIMD lanes, grouped by controller.

The result of a lane does not depend on the other lanes (`native.runtime.batch_loop`), so a row
does not depend on chunks, threads or workers.
"""

from collections.abc import Callable
from functools import lru_cache
import pickle
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.control.controller import Mode
from kane_dynamics.errors import InputError, SweepError
from kane_dynamics.mechanics.integrators import INTEGRATORS
from kane_dynamics.native.runtime.batch_loop import run_batch, Strided
from kane_dynamics.simulation.discontinuities import JumpWatch
from kane_dynamics.simulation.energy_balance import RELATIVE, ROUNDING
from kane_dynamics.simulation.step_size import step_warning
from kane_dynamics.sweep.constrained_trial import ConstrainedTrial
from kane_dynamics.sweep.description import Sweep
from kane_dynamics.sweep.sampling import controllers, drawn, of_joints, plant, Values
from kane_dynamics.sweep.trial import CONTROLLERS, Trial
import numpy as np

BLOCKS = 100  # checks per trial for a diverged state
TINY = 1e-300  # J: no motion
LOOKED = 10_000  # steps at once in which functions of time are examined
Columns = dict[str, Any]


class Simulator:
    """
    Simulator of a sweep: runs the kernels and collects the rows of the table.

    Parameters
    ----------
    sweep : Sweep

    """

    def __init__(self, sweep: Sweep) -> None:
        """Create the simulator; kernels compile at the first use."""
        self.sweep = sweep
        joints, given = sweep.joints, (sweep.robot, sweep.payload_frame, sweep.integrator,
                                       sweep.joints.tracked)
        controlled = Mode.COMPUTED_TORQUE in self._controllers
        self.trial = Trial(*given) if not joints.constrained else ConstrainedTrial(
            *given, joints.followed if controlled else ())
        # Without computed torque gains are not read, but there is room for them.
        self._gains = joints.followed_names if controlled else sweep.robot.speed_names
        self._shared = self.trial.shared(sweep.step)

    @property
    def _controllers(self) -> set[str]:
        """Return the controllers of all trials."""
        choice = next(value for value in self.sweep.values if value.name == 'controller')
        return {CONTROLLERS[int(place)] for place in choice.numbers}

    def compile(self) -> None:  # noqa: A003
        """Compile all kernels of the sweep, or load them from the cache."""
        for controller in sorted(self._controllers):
            self.trial.step(controller).compile_lanes()
        self.trial.energy().compile_lanes()

    def check_functions(self) -> None:
        """Raise ConstraintError if a function of time jumps during the sweep."""
        sweep, (start, _) = self.sweep, self._start(drawn(self.sweep, range(1)))
        watch = JumpWatch(self.trial.robot, start, sweep.t0, sweep.step, sweep.steps, True)
        for done in range(0, sweep.steps, LOOKED):
            watch.look_ahead(done, min(LOOKED, sweep.steps - done))

    def step_warning(self) -> str | None:
        """Return a warning if the step is too large at the first trial's initial state."""
        start, (error,) = self._start(drawn(self.sweep, range(1)))
        return step_warning(self.trial.robot, start[0, self.trial.parts.q], self.sweep.step,
                            self.sweep.integrator, self.sweep.t0) if error is None else None

    def columns(self, chunk: int) -> Columns:
        """
        Return the rows of a chunk as arrays or lists of texts by column name.

        A trial without a closed start, or that diverges, or whose constraints or independent
        speeds fail, has NaN outcomes and a message in `error`.
        """
        rows = self.sweep.rows(chunk)
        values = drawn(self.sweep, rows)
        start, errors = self._start(values)
        plants = plant(values, self.sweep.robot.joint_names, self._gains).rows
        ends, low, high = start.copy(), np.empty_like(start), np.empty_like(start)
        kinds, lost = np.array(controllers(values)), np.zeros(len(rows), dtype=np.int64)
        apart = np.zeros(len(rows), dtype=bool)
        balances = np.empty((2, len(rows)))
        for kind in np.unique(kinds).tolist():
            chosen = np.flatnonzero(kinds == kind)
            own = ends[chosen]
            (low[chosen], high[chosen], lost[chosen], apart[chosen],
             balances[:, chosen]) = self._run(kind, own, plants[chosen])
            ends[chosen] = own
        failed = lost > 0
        errors = [given or self._error(*each) for given, *each in zip(
            errors, lost.tolist(), apart.tolist())]
        drift, worst = balances
        for array in (ends, low, high, drift):
            array[failed] = np.nan
        drawn_values: Columns = {**values, 'controller': kinds.tolist()}
        return {'index': np.asarray(rows), 'seed': np.full(len(rows), self.sweep.seed),
                **drawn_values, 'ok': ~failed, 'error': errors,
                **self._outcomes(ends, low, high, drift),
                'energy_closes': (worst <= 1.0) & ~failed}

    def _start(self, values: Values) -> tuple[Array, list[str | None]]:
        """Return the initial states in the layout of `trial`, and why a row has none."""
        at, robot, sweep = self.trial.parts, self.sweep.robot, self.sweep
        q0, errors = sweep.joints.closed(of_joints(values, 'q0', robot.coordinate_names), sweep.t0)
        start = np.zeros((len(q0), at.size))
        start[:, at.q], start[:, at.u] = q0, of_joints(values, 'u0', robot.speed_names)
        start[:, at.time], start[:, at.margin] = sweep.t0, 1.0
        return start, errors

    def _error(self, steps: int, apart: bool) -> str | None:
        """Return the message of a trial that failed within these steps; None for 0."""
        if not steps:
            return None
        before = f'before {steps * self.sweep.step:.6g} s'
        if apart:
            names = ', '.join(self.sweep.robot.speed_names)
            return (f'{before}: the independent speeds {names} become ill-conditioned, a loop '
                    f'opens within a step of {self.sweep.step:g} s, or the motion is singular; '
                    'expected other speeds, a shorter step, or `simulate`, which changes speeds')
        return (f'diverged (non-finite state) {before}: unstable, '
                f'or the step of {self.sweep.step:g} s is too large')

    def _run(self, controller: str, states: Array, plants: Array
             ) -> tuple[Array, Array, Any, Any, Array]:
        """
        Integrate the states to the end, in place.

        Returns
        -------
        (N, size) arrays
            Minimum and maximum of every entry of the states.
        (N,) array of int
            Step by which a state was found diverged or not acceptable; 0 if neither.
        (N,) array of bool
            Whether it was not acceptable: its margin was not positive.
        (2, N) array
            Change of energy minus the work done, J; and its largest ratio, at any check, to the
            error of the step.

        """
        at, steps = self.trial.parts, self.sweep.steps
        kernel = self.trial.step(controller).lane_address
        desired, lane, stride = self._desired(states[:, at.q])
        low, high = states.copy(), states.copy()
        low[:, at.tau], high[:, at.tau] = np.inf, -np.inf
        lost, apart = np.zeros(len(states), dtype=np.int64), np.zeros(len(states), dtype=bool)
        balance = self._balance(plants)
        balance(states)
        cuts = np.linspace(0, steps, min(steps, BLOCKS) + 1).astype(int)
        for begin, end in zip(cuts.tolist(), cuts[1:].tolist()):
            place = Strided(states.ctypes.data, states.strides[0])
            run_batch(kernel, [
                place, Strided(desired.ctypes.data + begin * stride, lane, stride),
                Strided(plants.ctypes.data, plants.strides[0]),
                Strided(self._shared.ctypes.data), place,
            ], len(states), steps=end - begin, extremes=(low, high))
            bad = (lost == 0) & (low[:, at.margin] <= 0.0).any(axis=1)
            lost[bad], apart[bad] = end, True
            lost[(lost == 0) & ~np.isfinite(states).all(axis=1)] = end
            found = balance(states)
        return low, high, lost, apart, found

    def _desired(self, q0: Array) -> tuple[Array, int, int]:
        """Return rows of the desired motion, and the bytes between trials and between steps."""
        motion = self.sweep.desired
        if motion is not None:
            return motion, 0, 2 * motion.strides[0]
        tracked = self.trial.tracked
        rest = np.zeros((len(q0), 3, 3 * len(tracked)))
        rest[:, :, :len(tracked)] = q0[:, None, tracked]
        return rest, rest.strides[0], 0

    def _balance(self, plants: Array) -> Callable[[Array], Array]:
        """
        Return a function that updates the energy balance of the trials from their states.

        It returns the balance as `_run` does. The work is integrated with the motion, so its error
        is that of the integrator: of second order for the implicit one.
        """
        relative = (10.0 if INTEGRATORS[self.sweep.integrator].damps else 1.0) * RELATIVE
        work = self.trial.parts.work
        seen: list[Array] = []

        def look(states: Array) -> Array:
            with np.errstate(all='ignore'):
                kinetic, potential = self._energies(states, plants)
                now = np.array([kinetic, potential, states[:, work]])
                if not seen:
                    seen.extend([now, now, now, np.zeros(len(states))])
                start, low, high, worst = seen
                seen[1:3] = np.minimum(low, now), np.maximum(high, now)
                gained = (now - start).T @ [1.0, 1.0, -1.0]
                turned = seen[2][0] + (seen[2] - seen[1])[1:].sum(axis=0)
                share = np.abs(gained) / (relative * turned + TINY + ROUNDING * np.abs(
                    seen[2]).max(axis=0))
                seen[3] = np.maximum(worst, np.where(np.isfinite(share), share, np.inf))
            return np.array([gained, seen[3]])
        return look

    def _energies(self, states: Array, plants: Array) -> Array:
        """Return kinetic and potential energy of each trial, (2, N), J."""
        energies = np.empty((len(states), 2))
        run_batch(self.trial.energy().lane_address, [
            Strided(states.ctypes.data, states.strides[0]),
            Strided(plants.ctypes.data, plants.strides[0]),
            Strided(self._shared.ctypes.data),
            Strided(energies.ctypes.data, energies.strides[0])], len(states))
        return energies.T

    def _outcomes(self, ends: Array, low: Array, high: Array, drift: Array) -> Columns:
        """Return the outcome columns of all trials."""
        at = self.trial.parts
        robot = self.sweep.robot
        peak = np.maximum(-low[:, at.tau], high[:, at.tau])
        rms = np.sqrt(ends[:, at.squared_error] / self.sweep.duration)
        found: Columns = {}
        for name, of, joints in (
                ('q', ends[:, at.q], robot.coordinate_names),
                ('u', ends[:, at.u], robot.speed_names),
                ('peak_torque', peak, robot.speed_names),
                ('rms_error', rms, self.sweep.joints.tracked_names)):
            found |= {f'{name}.{joint}': of[:, k] for k, joint in enumerate(joints)}
        passed, words = self._limits_passed(low, high, peak)
        return {**found, 'energy_drift': drift, 'limit_events': passed.sum(axis=1),
                'limits': ['; '.join(words[k] for k in np.flatnonzero(row)) for row in passed]}

    def _limits_passed(self, low: Array, high: Array, peak: Array) -> tuple[Any, list[str]]:
        """
        Return the exceeded limits of all trials, (N, limits), and these: '<joint> <limit>'.

        Limits of velocity and effort are those of joints whose rates are the speeds. Efforts have
        none if other joints have the actuators, which share the torques.
        """
        at, robot = self.trial.parts, self.trial.robot
        limits, speeds = robot.limits, robot.speed_names
        own = dict(zip(robot.joint_names, np.transpose([limits.velocity, limits.effort])))
        velocity, effort = np.array([own.get(name, (np.inf, np.inf)) for name in speeds]).reshape(
            -1, 2).T
        if getattr(robot.equations, 'actuated', None) is not None and (
                set(robot.actuated_names) != set(speeds)):
            effort = np.full(robot.n, np.inf)
        passed = np.concatenate([
            low[:, at.q] < limits.lower, high[:, at.q] > limits.upper,
            np.maximum(-low[:, at.u], high[:, at.u]) > velocity, peak > effort], axis=1)
        return passed, [f'{joint} {limit}' for limit, joints in (
            ('lower', robot.coordinate_names), ('upper', robot.coordinate_names),
            ('velocity', speeds), ('effort', speeds)) for joint in joints]


def task(sweep: Sweep) -> bytes:
    """Return the pickled description of a sweep for workers; InputError if it has lambdas."""
    try:
        return pickle.dumps((sweep.digest, sweep))
    except (pickle.PicklingError, AttributeError) as error:
        raise InputError(f'model: {error}; expected speeds and constraints with functions of a '
                         'module, which other processes can import') from None


def compute(work: bytes, chunk: int) -> Columns:
    """Return the rows of a chunk, in a worker; SweepError if its code has another version."""
    return _simulator(work).columns(chunk)


@lru_cache(maxsize=2)
def _simulator(work: bytes) -> Simulator:
    """Return the simulator of a task; workers cache it for the next chunk."""
    digest, sweep = pickle.loads(work)
    if sweep.digest != digest:
        raise SweepError(f'worker: runs kane_dynamics {sweep.description["version"]}; expected '
                         'the version that started the sweep')
    return Simulator(sweep)
