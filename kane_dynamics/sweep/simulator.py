"""
Simulate chunks of trials in SIMD lanes, grouped by controller.

The result of a lane does not depend on the other lanes (`native.runtime.loops`), so
a row does not depend on chunks, threads or workers.
"""

from functools import lru_cache
from itertools import compress, pairwise
import pickle
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.control.controller import Mode
from kane_dynamics.errors import InputError, SweepError
from kane_dynamics.simulation.discontinuities import JumpWatch
from kane_dynamics.simulation.energy_balance import RELATIVE, ROUNDING
from kane_dynamics.simulation.step_size import stable_integrator
from kane_dynamics.sweep.description import Sweep
from kane_dynamics.sweep.sampling import controllers, drawn, of_joints, plant, Values
from kane_dynamics.sweep.trial import CONTROLLERS, Trial
import numpy as np

BLOCKS = 100  # checks per trial for a diverged state
TINY = 1e-300  # J: no motion
LOOKED = 10_000  # steps at once in which functions of time are examined
Columns = dict[str, Any]


class Results(NamedTuple):
    """
    Results of N trials.

    Attributes
    ----------
    ends, low, high : (N, size) arrays
        Last states, and minimum and maximum of every entry of the states.
    failed_by : (N,) array of int
        Step by which a state was found diverged or not acceptable; 0 if neither.
    refused : (N,) array of bool
        Whether it was not acceptable: its margin was not positive.
    drift : (N,) array
        Change of energy minus the work done, J.
    worst : (N,) array
        Largest ratio of that drift, at any check, to the error of the step.

    """

    ends: Array
    low: Array
    high: Array
    failed_by: Any
    refused: Any
    drift: Array
    worst: Array


class Simulator:
    """
    Simulator of a sweep: runs the kernels and collects the rows of the table.

    Parameters
    ----------
    sweep : Sweep

    Attributes
    ----------
    integrator : str
        That of the sweep, or the one that `simulate` chooses at the first trial's
        initial state.
    step_text : str or None
        Warning about the step, or about the choice of the integrator.

    """

    def __init__(self, sweep: Sweep) -> None:
        """Choose the integrator; kernels compile at the first use."""
        self.sweep = sweep
        # Stability is judged at the first trial that closes.
        q0, errors = self._closed(drawn(sweep, range(1)))
        first = q0[:1] if errors[0] is None else q0[:0]
        self.integrator, self.step_text = stable_integrator(
            sweep.robot, first, sweep.step, sweep.integrator, sweep.t0)
        joints = sweep.joints
        # Without computed torque gains are not read, but there is room for them.
        followed: tuple[int, ...] = ()
        self._gains = sweep.robot.speed_names
        if Mode.COMPUTED_TORQUE in self._controllers:
            followed, self._gains = joints.followed, joints.followed_names
        self.trial = Trial(sweep.robot, sweep.payload_frame, self.integrator,
                           joints.tracked, followed)
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
        sweep = self.sweep
        start, _ = self._start(drawn(sweep, range(1)))
        watch = JumpWatch(self.trial.robot, start, sweep.t0, sweep.step, sweep.steps,
                          True)
        for done in range(0, sweep.steps, LOOKED):
            watch.look_ahead(done, min(LOOKED, sweep.steps - done))

    def columns(self, chunk: int) -> Columns:
        """
        Return the rows of a chunk as arrays or lists of texts by column name.

        A trial without a closed start, or that diverges, or whose constraints or
        independent speeds fail, has NaN outcomes and a message in `error`.
        """
        # Values of the rows, from which plant and initial state follow.
        rows = self.sweep.rows(chunk)
        values = drawn(self.sweep, rows)
        start, errors = self._start(values)
        plants = plant(values, self.sweep.robot.joint_names, self._gains).rows
        kinds = np.array(controllers(values))
        results = self._results(kinds, start, plants)
        # Numbers of a failed trial have no meaning: its error says why.
        failed = results.failed_by > 0
        for array in (results.ends, results.low, results.high, results.drift):
            array[failed] = np.nan
        for k in np.flatnonzero(failed).tolist():
            if errors[k] is None:
                errors[k] = self._error(int(results.failed_by[k]),
                                        bool(results.refused[k]))
        closes = (results.worst <= 1.0) & ~failed
        return {'index': np.asarray(rows), 'seed': np.full(len(rows), self.sweep.seed),
                **values, 'controller': kinds.tolist(), 'ok': ~failed, 'error': errors,
                **self._outcomes(results), 'energy_closes': closes}

    def _closed(self, values: Values) -> tuple[Array, list[str | None]]:
        """Return closed initial configurations, (N, n_q), and why a row has none."""
        names = self.sweep.robot.coordinate_names
        return self.sweep.joints.closed(of_joints(values, 'q0', names), self.sweep.t0)

    def _start(self, values: Values) -> tuple[Array, list[str | None]]:
        """Return the initial states in the layout of `trial`, and why a row has none."""
        at = self.trial.parts
        q0, errors = self._closed(values)
        start = np.zeros((len(q0), at.size))
        start[:, at.q] = q0
        start[:, at.u] = of_joints(values, 'u0', self.sweep.robot.speed_names)
        start[:, at.time] = self.sweep.t0
        start[:, at.margin] = 1.0
        return start, errors

    def _error(self, steps: int, refused: bool) -> str:
        """Return the message of a trial that failed within these steps."""
        by_time = f'before {steps * self.sweep.step:.6g} s'
        if refused:
            names = ', '.join(self.sweep.robot.speed_names)
            return (f'{by_time}: the independent speeds {names} become ill-conditioned, '
                    f'a loop opens within a step of {self.sweep.step:g} s, or the '
                    'motion is singular; expected other speeds, a shorter step, or '
                    '`simulate`, which changes speeds')
        return (f'diverged (non-finite state) {by_time}: unstable, '
                f'or the step of {self.sweep.step:g} s is too large')

    def _results(self, kinds: Any, start: Array, plants: Array) -> Results:
        """Return the results of all trials, whose controllers are `kinds`, (N,)."""
        N = len(start)
        results = Results(start.copy(), np.empty_like(start), np.empty_like(start),
                          np.zeros(N, dtype=np.int64), np.zeros(N, dtype=bool),
                          np.empty(N), np.empty(N))
        for kind in np.unique(kinds).tolist():
            chosen = np.flatnonzero(kinds == kind)
            of_kind = self._run(kind, start[chosen], plants[chosen])
            for array, part in zip(results, of_kind):
                array[chosen] = part
        return results

    def _run(self, controller: str, states: Array, plants: Array) -> Results:
        """Return the results of trials with one controller; `states` are overwritten."""
        at, steps = self.trial.parts, self.sweep.steps
        kernel = self.trial.step(controller)
        desired = self._desired(states[:, at.q])
        low, high = states.copy(), states.copy()
        low[:, at.tau] = np.inf  # the state has no torque before the first step
        high[:, at.tau] = -np.inf
        failed_by = np.zeros(len(states), dtype=np.int64)
        refused = np.zeros(len(states), dtype=bool)
        balance = _WorkBalance(self, plants, states)
        cuts = np.linspace(0, steps, min(steps, BLOCKS) + 1).astype(int).tolist()
        for begin, end in pairwise(cuts):
            inputs = desired if desired.shape[1] == 1 else desired[:, begin:end]
            in_place = states[:, None]
            kernel.rollout([in_place, inputs, plants[:, None]], in_place, end - begin,
                           constants=self._shared, extremes=(low, high))
            # The first reason counts: a state after a refused one may be of any value.
            no_margin = (failed_by == 0) & (low[:, at.margin] <= 0.0).any(axis=1)
            failed_by[no_margin] = end
            refused[no_margin] = True
            failed_by[(failed_by == 0) & ~np.isfinite(states).all(axis=1)] = end
            balance.look(states)
        return Results(states, low, high, failed_by, refused, balance.drift,
                       balance.worst)

    def _desired(self, q0: Array) -> Array:
        """Return the desired motion of each step, (1 or N, 1 or steps, 3, 3 m)."""
        motion = self.sweep.desired
        if motion is not None:
            return motion[None]
        tracked = self.trial.tracked
        rest = np.zeros((len(q0), 3, 3 * len(tracked)))
        rest[:, :, :len(tracked)] = q0[:, None, tracked]
        return rest[:, None]

    def energies(self, states: Array, plants: Array) -> Array:
        """Return kinetic and potential energy of each trial, (2, N), J."""
        energies = np.empty((len(states), 2))
        self.trial.energy().run([states, plants], energies, len(states),
                                constants=self._shared)
        return energies.T

    def _outcomes(self, results: Results) -> Columns:
        """Return the outcome columns of all trials."""
        at, robot = self.trial.parts, self.sweep.robot
        # The largest torque in either direction, from extremes over all steps.
        peak = np.maximum(-results.low[:, at.tau], results.high[:, at.tau])
        rms = np.sqrt(results.ends[:, at.squared_error] / self.sweep.duration)
        tables = (('q', results.ends[:, at.q], robot.coordinate_names),
                  ('u', results.ends[:, at.u], robot.speed_names),
                  ('peak_torque', peak, robot.speed_names),
                  ('rms_error', rms, self.sweep.joints.tracked_names))
        # A column for each joint of each quantity.
        columns: Columns = {}
        for name, values, joints in tables:
            for joint, column in zip(joints, values.T):
                columns[f'{name}.{joint}'] = column

        # The limits that each trial exceeded, by name.
        passed, names = self._limits_passed(results.low, results.high, peak)
        columns['energy_drift'] = results.drift
        columns['limit_events'] = passed.sum(axis=1)
        listed = []
        for row in passed:
            listed.append('; '.join(compress(names, row)))
        columns['limits'] = listed
        return columns

    def _limits_passed(self,
                       low: Array, high: Array, peak: Array) -> tuple[Any, list[str]]:
        """
        Return the exceeded limits of all trials, (N, limits), and these: '<joint> <limit>'.

        Limits of velocity and effort are those of joints whose rates are the speeds.
        Efforts have none if other joints have the actuators, which share the torques.
        """
        at, robot = self.trial.parts, self.trial.robot
        limits, speeds = robot.limits, robot.speed_names
        velocity, effort = np.full((2, robot.n), np.inf)
        for k, name in enumerate(speeds):
            if name in robot.joint_names:
                joint = robot.joint_names.index(name)
                velocity[k] = limits.velocity[joint]
                effort[k] = limits.effort[joint]
        # Limits of effort are those of joints, which tau is only if each speed has its
        # own actuator.
        actuated = getattr(robot.equations, 'actuated', None)
        if actuated is not None and set(robot.actuated_names) != set(speeds):
            effort = np.full(robot.n, np.inf)
        # From the smallest and largest states of each trial.
        fastest = np.maximum(-low[:, at.u], high[:, at.u])
        passed = np.concatenate([low[:, at.q] < limits.lower,
                                 high[:, at.q] > limits.upper,
                                 fastest > velocity, peak > effort], axis=1)
        names = []
        for limit, joints in (('lower', robot.coordinate_names),
                              ('upper', robot.coordinate_names),
                              ('velocity', speeds), ('effort', speeds)):
            names += [f'{joint} {limit}' for joint in joints]
        return passed, names


class _WorkBalance:
    """
    The energy balance of trials, whose work is integrated with the motion.

    The error of the work is that of the integrator: of second order for the implicit
    one.

    Attributes
    ----------
    drift, worst : (N,) arrays
        As of `Results`.

    """

    def __init__(self, simulator: Simulator, plants: Array, states: Array) -> None:
        """Begin at the initial states."""
        self._simulator, self._plants = simulator, plants
        self._relative = RELATIVE
        if simulator.trial.integrator.damps:
            self._relative = 10.0 * RELATIVE
        self._start = self._low = self._high = self._terms(states)
        self.drift = np.zeros(len(states))
        self.worst = np.zeros(len(states))
        self.look(states)

    def _terms(self, states: Array) -> Array:
        """Return kinetic energy, potential energy and work, (3, N), J."""
        with np.errstate(all='ignore'):
            energies = self._simulator.energies(states, self._plants)
        return np.array([*energies, states[:, self._simulator.trial.parts.work]])

    def look(self, states: Array) -> None:
        """Update the balance at later states."""
        with np.errstate(all='ignore'):
            terms = self._terms(states)
            self._low = np.minimum(self._low, terms)
            self._high = np.maximum(self._high, terms)
            self.drift = (terms - self._start).T @ [1.0, 1.0, -1.0]
            # The drift is compared with the energy that was exchanged so far.
            ranges = self._high - self._low
            exchanged = self._high[0] + ranges[1:].sum(axis=0)
            largest = np.abs(self._high).max(axis=0)
            ratio = np.abs(self.drift) / (self._relative * exchanged + TINY + ROUNDING * largest)
            ratio = np.where(np.isfinite(ratio), ratio, np.inf)
            self.worst = np.maximum(self.worst, ratio)


def task(sweep: Sweep) -> bytes:
    """Return the pickled description of a sweep for workers; InputError if it has lambdas."""
    try:
        return pickle.dumps((sweep.digest, sweep))
    except (pickle.PicklingError, AttributeError) as error:
        raise InputError(f'model: {error}; expected speeds and constraints with '
                         'functions of a module, which other processes can import') from None


def compute(work: bytes, chunk: int) -> Columns:
    """Return the rows of a chunk, in a worker; SweepError if its code has another version."""
    return _simulator(work).columns(chunk)


@lru_cache(maxsize=2)
def _simulator(work: bytes) -> Simulator:
    """Return the simulator of a task; workers cache it for the next chunk."""
    digest, sweep = pickle.loads(work)
    if sweep.digest != digest:
        raise SweepError(f'worker: runs kane_dynamics {sweep.description["version"]}; '
                         'expected the version that started the sweep')
    return Simulator(sweep)
