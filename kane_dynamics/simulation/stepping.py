"""
The stepping loop of a simulation, and the steps that it computes.

`run` computes steps in chunks and shows the states to observers (`observers`). Native
code computes a chunk in a few milliseconds without the GIL, so progress is reported in
time.

Each kind of `Steps` computes states in its own way: `Steps` in native code with the
impulses of joint stops, `speed_switching.SwitchingSteps` with a change of independent
speeds before a singularity, and `CallableSteps` with a torque function in Python before
every step of these.
"""

from collections.abc import Callable, Sequence
import time
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.simulation.energy_balance import energies
from kane_dynamics.simulation.observers import (Chunk, diverged, Extremes, Impact,
                                                Observer, Power)
from kane_dynamics.simulation.presliding import bristle_friction
from kane_dynamics.simulation.step_kernels import accelerations
from kane_dynamics.simulation.sticking.sticking_steps import Sticking
from kane_dynamics.simulation.stops.contact_forces import with_stop_forces
from kane_dynamics.simulation.stops.joint_stops import JointStops
from kane_dynamics.simulation.torque_input import (evaluated_torque, TorqueFunction,
                                                   TorqueInput)
from kane_dynamics.simulation.trajectory import SpeedChange
import numpy as np

CHUNK_SECONDS = 0.01  # of steps between two progress reports: half of the documented bound
CHUNK_BYTES = 2**27  # of states in one chunk, unless a single step of all takes more
FIRST_CHUNK = 256  # steps of one simulation
GROWTH = 16  # largest ratio of two chunks in succession
LEAST_CHUNK = 8  # steps of many simulations, so that checks take less time than the steps

Progress = Callable[[float], bool | None]


class Samples(NamedTuple):
    """Numbers of sampled steps, (K,), and the states after them, (N, K, size)."""

    steps: Array
    states: Array


class Steps:
    """
    The steps of N simulations of one robot.

    Parameters
    ----------
    source : TorqueInput
        The native step.
    stops : JointStops or Sticking, optional
        Stops whose impulses act after each step, or set-valued friction and stops.

    Attributes
    ----------
    changes : list of SpeedChange
        Changes of the independent speeds so far.

    """

    def __init__(self, source: TorqueInput,
                 stops: JointStops | Sticking | None = None) -> None:
        """Store the native step and the stops."""
        self.source, self.stops = source, stops
        self.robot, self.step, self.start = source.robot, source.step, source.start
        # Computes the states of a native step, with the stops.
        self._advance = TorqueInput.advance if stops is None else stops.advance
        self.changes: list[SpeedChange] = []

    def compute(self, starts: Array, done: int, count: int) -> Chunk:
        """Return the next steps from states, (N, size), after `done` steps: at most `count`."""
        buffer = np.empty((len(starts), count + 1, starts.shape[1]))
        buffer[:, 0] = starts
        extremes = self.advance(buffer, done)
        times = self.start + (done + np.arange(count + 1)) * np.float64(self.step)
        return Chunk(done, times, buffer, extremes, self)

    def advance(self, buffer: Array, done: int) -> Extremes | None:
        """Compute the states of a buffer; arguments and result as of `TorqueInput.advance`."""
        return self._advance(self.source, buffer, done)

    def user_state(self,
                   simulation: int, state: Array, done: int) -> tuple[Array, Array]:
        """Return q and u, in the user's speeds, of a simulation's state after `done` steps."""
        n_q, n = self.robot.n_q, self.robot.n
        return state[:n_q], state[n_q:n_q + n]

    def in_user_speeds(self, states: Array, done: int) -> Array:
        """Return states of a chunk, (N, K + 1, size), in the user's speeds."""
        return states

    def acting(self, states: Array, done: int) -> Array | Power:
        """Return the torques that act in the steps of a chunk; see `TorqueInput.acting`."""
        return self.source.acting(states, done)

    def impacts(self, done: int) -> Sequence[Impact]:
        """Return the energies that the stops took in the steps after `done`, all computed."""
        return () if self.stops is None else self.stops.settle(done)

    def torques(self, samples: Samples, q: Array, u: Array) -> Array:
        """Return the torques that acted at samples, with q, (N, K, n_q), and u, (N, K, n)."""
        return self.source.torques(samples.steps, q, u)

    def results(self, samples: Samples, tau: Array) -> dict[str, Array]:
        """Return u and derived quantities of samples under torques, (N, K, n)."""
        robot, shape = self.robot, samples.states.shape[:2]
        n_q, n = robot.n_q, robot.n
        q = np.ascontiguousarray(samples.states[..., :n_q]).reshape(-1, n_q)
        u = np.ascontiguousarray(samples.states[..., n_q:n_q + n]).reshape(-1, n)
        # The quantities of all samples of all simulations are computed as one batch.
        times = np.tile(self.start + samples.steps * np.float64(self.step), shape[0])
        states = samples.states.reshape(-1, samples.states.shape[2])
        torques = tau.reshape(u.shape)
        sticks = isinstance(self.stops, Sticking)
        rows: dict[str, Array] = {'u': u, 'energy': energies(robot, states, sticks)}
        if isinstance(self.stops, Sticking):
            at_samples = self.stops.state_of(self.source).at_samples(states, torques,
                                                                     times)
            rows |= at_samples._asdict()
            del rows['friction']  # of the constraint forces of other robots
        elif robot.equations.tree.bristles:
            friction = bristle_friction(robot, self.stops is not None)
            at_samples = friction.at_samples(states, torques, times)
            rows['udot'], rows['stop_forces'] = at_samples[:2]
        else:
            rows['udot'] = accelerations(robot, q, u, torques, times)
            rows['stop_forces'] = np.zeros((len(q), robot.equations.tree.n))
            if self.stops is not None:
                at = {'t': times} if robot.equations.timed else {}
                rows['udot'], rows['stop_forces'] = with_stop_forces(
                    robot, q, u, rows['udot'], robot.limits.lower, robot.limits.upper,
                    **at)
        return {name: x.reshape(*shape, *x.shape[1:]) for name, x in rows.items()}


class CallableSteps(Steps):
    """
    The steps of one simulation with a torque function, whose value is held during each step.

    Parameters
    ----------
    steps : Steps
        The steps under held torques; with a table of one row, which is written to.
    torque : callable
    every : int
        Number of steps between two samples.
    in_time : bool
        End a chunk early for a report of progress.

    """

    def __init__(self, steps: Steps, torque: TorqueFunction, every: int,
                 in_time: bool) -> None:
        """Begin without samples."""
        super().__init__(steps.source, steps.stops)
        self.changes = steps.changes
        self._steps, self._torque = steps, torque
        self._every, self._in_time = every, in_time
        self._samples: list[Array] = []

    def compute(self, starts: Array, done: int, count: int) -> Chunk:
        """Return the next steps; fewer if time is up or the motion diverges."""
        count = min(count, FIRST_CHUNK)
        buffer = np.empty((1, count + 1, starts.shape[1]))
        buffer[:, 0] = starts
        self._held = np.empty((1, count, self.robot.n))
        began = time.perf_counter()
        for k in range(count):
            tau = self._evaluated(buffer[0, k], done + k)
            self._held[0, k] = tau
            if (done + k) % self._every == 0:
                self._samples.append(tau.copy())
            self.source.torque[0, 0] = tau
            self._steps.advance(buffer[:, k:k + 2], done + k)
            # A torque function need not expect a state that is not finite.
            if diverged(self.robot, buffer[:, k + 1]).any():
                break
            if self._in_time and time.perf_counter() - began > CHUNK_SECONDS:
                break
        times = self.start + (done + np.arange(k + 2)) * np.float64(self.step)
        return Chunk(done, times, buffer[:, :k + 2], None, self)

    def _evaluated(self, state: Array, done: int) -> Array:
        """Return the torque at a state after `done` steps."""
        q, u = self._steps.user_state(0, state, done)
        return evaluated_torque(self.robot, self._torque, self.start + done * self.step,
                                q.copy(), u.copy())

    def in_user_speeds(self, states: Array, done: int) -> Array:
        """Return states of a chunk in the user's speeds."""
        return self._steps.in_user_speeds(states, done)

    def acting(self, states: Array, done: int) -> Array | Power:
        """Return the torques held during each step of the last chunk, (1, K, n)."""
        return self._held[:, :states.shape[1] - 1]

    def torques(self, samples: Samples, q: Array, u: Array) -> Array:
        """Return the torques at the samples; that of the last state is evaluated now."""
        last = self._evaluated(samples.states[0, -1], int(samples.steps[-1]))
        return np.array([[*self._samples, last]])

    def results(self, samples: Samples, tau: Array) -> dict[str, Array]:
        """Return u and derived quantities of samples."""
        return self._steps.results(samples, tau)


def run(steps: Steps, starts: Array, count: int, every: int,
        observers: Sequence[Observer],
        progress: Progress | None = None) -> Samples:
    """
    Compute a simulation and return its samples, with the first and the last state.

    Parameters
    ----------
    steps : Steps
        The steps to compute.
    starts : (N, size) array
        Initial states.
    count, every : int
        Numbers of steps, and of steps between two samples.
    observers : sequence of Observer
        What watches the states, in this order.
    progress : callable, optional
        Called with the simulated time after each chunk; returning False ends the
        simulation.

    """
    sampled = np.append(np.arange(0, count, every), count)
    states = np.empty((len(starts), len(sampled), starts.shape[1]))
    # One simulation begins with single steps; many share the cost of a chunk from the
    # start.
    states[:, 0] = starts
    least, length = 1, FIRST_CHUNK
    if not steps.source.single:
        least = length = LEAST_CHUNK
    longest = max(1, CHUNK_BYTES // starts.nbytes) if len(starts) else count
    done = 0
    while done < count:
        length = min(length, longest, count - done)
        for observer in observers:
            observer.look_ahead(done, length)
        began = time.perf_counter()
        chunk = steps.compute(starts, done, length)
        seconds = time.perf_counter() - began
        for observer in observers:
            observer.look(chunk)
        computed = chunk.states.shape[1] - 1
        # The samples among the states of this chunk.
        rows = slice(*np.searchsorted(sampled, [done + 1, done + computed + 1]))
        states[:, rows] = chunk.states[:, sampled[rows] - done]
        starts = chunk.states[:, -1].copy()
        done += computed
        if progress is not None and progress(steps.start + done * steps.step) is False:
            break
        # The next chunk is to take the time between two reports; a short one may have
        # been measured badly.
        in_time = int(computed * CHUNK_SECONDS / max(seconds, 1e-9))
        length = max(least, min(GROWTH * computed, in_time))
    # A simulation that ends early has its last state as an additional sample.
    rows_done = int(np.searchsorted(sampled, done, side='right'))
    if sampled[rows_done - 1] < done:
        sampled[rows_done] = done
        states[:, rows_done] = starts
        rows_done += 1
    return Samples(sampled[:rows_done], states[:, :rows_done])
