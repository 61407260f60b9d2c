"""Steps of one simulation with a torque function, which Python code evaluates before each."""

import time

from kane_dynamics._util.typing import Array
from kane_dynamics.simulation.observers import Chunk, diverged, Exchange
from kane_dynamics.simulation.stepping import CHUNK_SECONDS, FIRST_CHUNK, Samples, Steps
from kane_dynamics.simulation.torque_input import evaluated_torque, TorqueFunction
import numpy as np


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
        super().__init__(steps.source, steps.rows)
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
        # The function is evaluated at the state before the step, and its value held in
        # it.
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
        # A chunk that ended early has fewer states.
        times = self.start + (done + np.arange(k + 2)) * np.float64(self.step)
        return Chunk(done, times, buffer[:, :k + 2], self)

    def _evaluated(self, state: Array, done: int) -> Array:
        """Return the torque at a state after `done` steps."""
        q, u = self._steps.user_state(state)
        return evaluated_torque(self.robot, self._torque, self.start + done * self.step,
                                q.copy(), u.copy())

    def exchange(self, states: Array, done: int) -> Exchange:
        """Return the torques that exchange energy, held during each step of the last chunk."""
        exchange = self._steps.exchange(states, done)
        return exchange._replace(torques=self._held[:, :states.shape[1] - 1])

    def results(self, samples: Samples, tau: Array | None = None) -> dict[str, Array]:
        """Return quantities of samples; the torque of the last state is evaluated now."""
        if tau is None:
            last = self._evaluated(samples.states[0, -1], int(samples.steps[-1]))
            tau = np.array([[*self._samples, last]])
        return self._steps.results(samples, tau)
