"""
The stepping loop of a simulation, and the steps that it computes.

`run` computes steps in chunks and shows the states to observers (`observers`). Native
code computes a chunk in a few milliseconds without the GIL, so progress is reported in
time.

`Steps` computes states in native code, with rows that have modes. Two kinds of
steps extend it: `speed_choice.ConstrainedSteps` chooses the independent speeds, and
`callable_steps.CallableSteps` calls a torque function in Python before every step.
"""

from collections.abc import Callable, Sequence
import math
import time
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.kernel_set import kernel_per_robot
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.energy_balance import energy_kernel, TERMS
from kane_dynamics.simulation.motion_samples import (actuator_torques, admissible,
                                                     generalized_forces, motion_at,
                                                     speeds_in, speeds_of_motion,
                                                     state_parts)
from kane_dynamics.simulation.observers import Chunk, Exchange, Observer
from kane_dynamics.simulation.stepper import RowSteps
from kane_dynamics.simulation.torque_input import TorqueInput
from kane_dynamics.simulation.trajectory import constraint_residuals
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
    rows : RowSteps, optional
        Stops, set-valued friction and contacts.

    """

    def __init__(self, source: TorqueInput, rows: RowSteps | None = None) -> None:
        """Store the native step and the rows."""
        self.source = source
        self.rows = rows
        self.robot = source.robot
        self.step = source.step
        self.start = source.start
        # Computes the states of a native step, in the modes of the rows.
        self._advance = TorqueInput.advance if rows is None else rows.advance

    def compute(self, starts: Array, done: int, count: int) -> Chunk:
        """Return the next steps from states, (N, size), after `done` steps: at most `count`."""
        buffer = np.empty((len(starts), count + 1, starts.shape[1]))
        buffer[:, 0] = starts
        self.advance(buffer, done)
        times = self.start + (done + np.arange(count + 1)) * np.float64(self.step)
        return Chunk(done, times, buffer, self)

    def advance(self, buffer: Array, done: int) -> None:
        """Compute the states of a buffer; `TorqueInput.advance` describes the arguments."""
        self._advance(self.source, buffer, done)

    def user_state(self, state: Array) -> tuple[Array, Array]:
        """Return q and u, in the user's speeds, of a simulation's state."""
        return state[:self.robot.n_q], speeds_in(self.robot, state)

    def exchange(self, states: Array, done: int) -> Exchange:
        """Return the torques that exchange energy in a chunk, all of whose steps are computed."""
        impacts = () if self.rows is None else self.rows.settle(done)
        return Exchange(self.source.acting(states, done), impacts)

    def torques(self, samples: Samples) -> Array:
        """Return the torques of samples, (N, K, n), dual to the user's speeds."""
        return self.source.torques(samples.steps, samples.states)

    def best_choices(self, states: Array, times: Array) -> list[tuple[Robot, Any]]:
        """Return robots with the numbers of those of K states that are regular in their speeds."""
        return [(self.robot, np.arange(len(states)))]

    def results(self, samples: Samples, tau: Array | None = None) -> dict[str, Array]:
        """
        Return q, u, tau and derived quantities of samples, (N, K, ...) arrays.

        `tau`, (N, K, n), are the torques that acted; by default those of the source.
        """
        if tau is None:
            tau = self.torques(samples)
        # The quantities of all samples of all simulations are computed as one batch.
        shape = samples.states.shape[:2]
        times = np.tile(self.start + samples.steps * np.float64(self.step), shape[0])
        count = math.prod(shape)  # there may be no speeds
        states = samples.states.reshape(count, samples.states.shape[2])
        forces = tau.reshape(count, self.robot.n)
        results: dict[str, Array] = {}
        for robot, k in self.best_choices(states, times):
            part = sampled_quantities(self.robot, robot, states[k], forces[k], times[k],
                                      self.rows)
            for name, quantity in part.items():
                if name not in results:
                    results[name] = np.empty((len(states), *quantity.shape[1:]),
                                             dtype=quantity.dtype)
                results[name][k] = quantity
        of_samples = {name: x.reshape(*shape, *x.shape[1:]) for name, x in results.items()}
        return {'tau': tau, **of_samples}


def sampled_quantities(user_robot: Robot, robot: Robot, states: Array, tau: Array,
                       times: Array, rows: Any) -> dict[str, Array]:
    """
    Return the quantities of a trajectory at K states of a simulation.

    Parameters
    ----------
    user_robot, robot : Robot
        In the user's speeds, and in speeds that are regular at these states.
    states : (K, size) array
        Entries as `step_kernels.state_names`.
    tau, times : (K, n), (K,) arrays
        Torques dual to the user's speeds, and times, s.
    rows : stepper.RowSteps or None
        Rows with modes.

    """
    states = admissible(robot, states)
    q, v, _ = state_parts(robot, states)
    # Kinetic and potential energy, by the kernel of the simulation's energy balance.
    terms = np.empty((len(states), TERMS))
    exact = rows is not None and rows.sticking
    energy_kernel(robot, exact).run([np.ascontiguousarray(states)], terms, len(terms))
    generalized = generalized_forces(robot, user_robot, q, tau, times)
    motion = motion_at(robot, states, generalized, times, rows)
    of_user = speeds_of_motion(user_robot, q, v, motion.vdot, times)
    results = {'q': q, 'u': np.ascontiguousarray(of_user[:, 0]),
               'udot': np.ascontiguousarray(of_user[:, 1]), 'energy': terms[:, :2],
               **motion._asdict()}
    vdot, friction = results.pop('vdot'), results.pop('friction')
    if robot.equations.watched:
        # All forces on the joints but those of the constraints.
        motors = actuator_torques(robot, user_robot, q, generalized, tau, times)
        applied = results['stop_forces'] + motors - friction
        results['constraint_forces'] = _row_forces_kernel(robot)(
            q, v, vdot, applied, *robot.equations.time_inputs(times))
        results |= constraint_residuals(robot, q, speeds_in(robot, states), times)
    return results


@kernel_per_robot
def _row_forces_kernel(robot: Robot) -> Kernel:
    """Return the kernel of the forces of all rows, (m,), in a motion of the joints."""
    n_j = (robot.model.n,)
    return robot.compiled(robot.equations.row_forces_of_motion, name='constraint_forces_in_motion',
                          q=(robot.n_q,), v=n_j, vdot=n_j, applied=n_j,
                          shape=(len(robot.constraint_names),))


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
    states[:, 0] = starts
    # One simulation begins with few steps, unless an earlier one of the robot has shown how
    # long they take and no progress is reported; many share the cost of a chunk from the
    # start.
    least = 1
    length = FIRST_CHUNK
    paces = steps.robot.kernels.kept
    kind = 'seconds of a step', type(steps), steps.source.choice, steps.rows is None
    if not steps.source.single:
        least = length = LEAST_CHUNK
    elif progress is None and kind in paces:
        length = max(FIRST_CHUNK, int(CHUNK_SECONDS / paces[kind]))
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
        pace = max(seconds, 1e-9) / computed
        length = max(least, min(GROWTH * computed, int(CHUNK_SECONDS / pace)))
        if steps.source.single:
            paces[kind] = pace
    # A simulation that ends early has its last state as an additional sample.
    rows_done = int(np.searchsorted(sampled, done, side='right'))
    if sampled[rows_done - 1] < done:
        sampled[rows_done] = done
        states[:, rows_done] = starts
        rows_done += 1
    return Samples(sampled[:rows_done], states[:, :rows_done])
