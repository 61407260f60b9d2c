"""
Trials run: a chunk of them goes through the lanes together, each controller's apart.

A lane's numbers do not depend on its neighbours (`native.march`), so a row does not depend on how
trials are cut into chunks, on threads, or on who computes it.
"""

from functools import lru_cache
import pickle
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import SweepError
from kane_dynamics.native.runtime.batch_loop import run_batch, Strided
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_size import step_warning
from kane_dynamics.sweep.description import Sweep
from kane_dynamics.sweep.sampling import controllers, drawn, of_joints, plant, Values
from kane_dynamics.sweep.trial import CONTROLLERS, Trial
import numpy as np

BLOCKS = 100  # looks at the states in a trial: so finely is told when one left the numbers
Columns = dict[str, Any]


class Simulator:
    """
    The kernels of a sweep's trials, and the way from their numbers to rows of its table.

    Parameters
    ----------
    sweep : Sweep

    """

    def __init__(self, sweep: Sweep) -> None:
        """Compile nothing yet."""
        self.sweep = sweep
        self.trial = Trial(sweep.model, sweep.payload_frame, sweep.integrator)
        self.joints = sweep.model.joint_names
        self._shared = self.trial.shared(sweep.step)

    def compile(self) -> None:  # noqa: A003
        """Compile, or load, every kernel that the sweep needs."""
        choice = next(value for value in self.sweep.values if value.name == 'controller')
        for place in set(choice.numbers):
            self.trial.step(CONTROLLERS[int(place)]).compile_lanes()
        self.trial.energy().compile_lanes()

    def doubt(self) -> str | None:
        """Return what to say of a step too long for the model where the first trial starts."""
        start = self._start(drawn(self.sweep, range(1)))
        return step_warning(Robot(self.sweep.model), start[0, self.trial.parts.q],
                            self.sweep.step, self.sweep.integrator)

    def columns(self, chunk: int) -> Columns:
        """
        Return the rows of a chunk by column: arrays, or lists of texts.

        A trial that leaves the finite numbers has NaN for outcomes and says so in `error`.
        """
        rows = self.sweep.rows(chunk)
        values = drawn(self.sweep, rows)
        start = self._start(values)
        plants = plant(values, self.joints).rows
        ends, low, high = start.copy(), np.empty_like(start), np.empty_like(start)
        kinds, lost = np.array(controllers(values)), np.zeros(len(rows), dtype=np.int64)
        energy = self._energy(start, plants)
        for kind in np.unique(kinds).tolist():
            chosen = np.flatnonzero(kinds == kind)
            own = ends[chosen]
            low[chosen], high[chosen], lost[chosen] = self._run(kind, own, plants[chosen])
            ends[chosen] = own
        failed = lost > 0
        drift = self._energy(np.where(failed[:, None], start, ends), plants) - energy
        for array in (ends, low, high, drift):
            array[failed] = np.nan
        drawn_values: Columns = {**values, 'controller': kinds.tolist()}
        return {'index': np.asarray(rows), 'seed': np.full(len(rows), self.sweep.seed),
                **drawn_values, 'ok': ~failed, 'error': [self._error(k) for k in lost.tolist()],
                **self._outcomes(ends, low, high, drift)}

    def _start(self, values: Values) -> Array:
        """Return the states at time 0, as `trial` lays them out."""
        at, q0 = self.trial.parts, of_joints(values, 'q0', self.joints)
        start = np.zeros((len(q0), at.size))
        start[:, at.q], start[:, at.u] = q0, of_joints(values, 'u0', self.joints)
        return start

    def _error(self, steps: int) -> str | None:
        """Return what to say of a trial that was lost within so many steps; None if it was not."""
        return (f'leaves the finite numbers before {steps * self.sweep.step:.6g} s: unstable, or '
                f'the step of {self.sweep.step:g} s too long') if steps else None

    def _run(self, controller: str, states: Array, plants: Array) -> tuple[Array, Array, Any]:
        """
        Step states to the end, in place.

        Returns
        -------
        (N, size) arrays
            Least and largest of every entry of the states.
        (N,) array of int
            By which step a state was seen to have left the finite numbers; 0 if it has not.

        """
        at, steps = self.trial.parts, self.sweep.steps
        kernel = self.trial.step(controller).lane_address
        desired, lane, stride = self._desired(states[:, at.q])
        low, high = states.copy(), states.copy()
        low[:, at.tau], high[:, at.tau] = np.inf, -np.inf
        lost = np.zeros(len(states), dtype=np.int64)
        cuts = np.linspace(0, steps, min(steps, BLOCKS) + 1).astype(int)
        for begin, end in zip(cuts.tolist(), cuts[1:].tolist()):
            place = Strided(states.ctypes.data, states.strides[0])
            run_batch(kernel, [
                place, Strided(desired.ctypes.data + begin * stride, lane, stride),
                Strided(plants.ctypes.data, plants.strides[0]),
                Strided(self._shared.ctypes.data), place,
            ], len(states), steps=end - begin, extremes=(low, high))
            lost[(lost == 0) & ~np.isfinite(states).all(axis=1)] = end
        return low, high, lost

    def _desired(self, q0: Array) -> tuple[Array, int, int]:
        """Return rows of what is desired; bytes between trials and between steps."""
        motion = self.sweep.desired
        if motion is not None:
            return motion, 0, 2 * motion.strides[0]
        rest = np.zeros((len(q0), 3, 3 * len(self.joints)))
        rest[:, :, :len(self.joints)] = q0[:, None]
        return rest, rest.strides[0], 0

    def _energy(self, states: Array, plants: Array) -> Array:
        """Return the total energy of each trial without the work that was done on it, J."""
        energy = np.empty(len(states))
        run_batch(self.trial.energy().lane_address, [
            Strided(states.ctypes.data, states.strides[0]),
            Strided(plants.ctypes.data, plants.strides[0]),
            Strided(self._shared.ctypes.data),
            Strided(energy.ctypes.data, energy.strides[0])], len(states))
        return energy - states[:, self.trial.parts.work]

    def _outcomes(self, ends: Array, low: Array, high: Array, drift: Array) -> Columns:
        """Return what is told of each trial."""
        at = self.trial.parts
        peak = np.maximum(-low[:, at.tau], high[:, at.tau])
        rms = np.sqrt(ends[:, at.squared_error] / self.sweep.duration)
        found: Columns = {}
        for name, of in (('q', ends[:, at.q]), ('u', ends[:, at.u]), ('peak_torque', peak),
                         ('rms_error', rms)):
            found |= {f'{name}.{joint}': of[:, k] for k, joint in enumerate(self.joints)}
        passed = self._limits_passed(low, high, peak)
        return {**found, 'energy_drift': drift, 'limit_events': passed.sum(axis=(1, 2)),
                'limits': self._in_words(passed)}

    def _limits_passed(self, low: Array, high: Array, peak: Array) -> Any:
        """Tell which limits each trial passed, (N, 4, n): lower, upper, velocity, effort."""
        at, limits = self.trial.parts, self.trial.robot.limits
        return np.stack([low[:, at.q] < limits.lower, high[:, at.q] > limits.upper,
                         np.maximum(-low[:, at.u], high[:, at.u]) > limits.velocity,
                         peak > limits.effort], axis=1)

    def _in_words(self, passed: Any) -> list[str]:
        """Return the limits that each trial passed as joint and limit, joined by semicolons."""
        words = [[f'{joint} {limit}' for joint in self.joints]
                 for limit in ('lower', 'upper', 'velocity', 'effort')]
        found: list[list[str]] = [[] for _ in passed]
        for i, limit, joint in np.argwhere(passed).tolist():
            found[i].append(words[limit][joint])
        return ['; '.join(each) for each in found]


def task(sweep: Sweep) -> bytes:
    """Return what a worker needs to know of a sweep."""
    return pickle.dumps((sweep.digest, sweep))


def compute(work: bytes, chunk: int) -> Columns:
    """
    Return the rows of a chunk: what workers run.

    Raises
    ------
    SweepError
        This worker is of another version of the package.

    """
    return _simulator(work).columns(chunk)


@lru_cache(maxsize=2)
def _simulator(work: bytes) -> Simulator:
    """Return the simulator of a task, which a worker keeps for the next chunk."""
    digest, sweep = pickle.loads(work)
    if sweep.digest != digest:
        raise SweepError(f'a worker runs kane_dynamics {sweep.description["version"]}, not the '
                         'version that started the sweep: install the same everywhere')
    return Simulator(sweep)
