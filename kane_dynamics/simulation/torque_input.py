"""The torques of a simulation in the layout of the native step."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque import ComputedTorque
from kane_dynamics.control.computed_torque_law import law_kernel
from kane_dynamics.errors import InputError
from kane_dynamics.native.runtime.argument import Argument, checked
from kane_dynamics.native.runtime.batch_loop import run_batch, Strided
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.loop_support import repeat
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import step_kernel
import numpy as np


@dataclass(frozen=True)
class TorqueInput:
    """A native step with its inputs; returned by `torque_input`."""

    robot: Robot
    kernel: Kernel
    step: float
    constants: Array  # gains and step, then the robot's parameters
    torque: Any  # ComputedTorque, or (1 or N, 1 or steps, n) torques
    start: float = 0.0  # s

    def advance(self, buffer: Array, done: int, single: bool) -> tuple[Array, Array] | None:
        """
        Compute the states after each step, without the GIL.

        Parameters
        ----------
        buffer : (N, K + 1, size) array
            The N states after `done` steps, and space for the next K of each.
        done : int
            Number of earlier steps.
        single : bool
            Use the kernel for one state; N is 1.

        Returns
        -------
        (N, size) arrays, or None where `single`
            Least and largest of each entry of the K states.

        """
        steps = buffer.shape[1] - 1
        inputs, lane, stride = self._inputs(done, steps)
        rows = [Strided(buffer.ctypes.data, *buffer.strides[:2]),
                Strided(inputs.ctypes.data, lane, stride), Strided(self.constants.ctypes.data),
                Strided(buffer[:, 1:].ctypes.data, *buffer.strides[:2])]
        if single:
            repeat(self.kernel.address, [row.address for row in rows],
                   [row.step for row in rows], steps)
            return None
        extremes = np.full_like(buffer[:, 0], np.inf), np.full_like(buffer[:, 0], -np.inf)
        run_batch(self.kernel.lane_address, rows, len(buffer), steps=steps, extremes=extremes)
        return extremes

    def _inputs(self, done: int, count: int) -> tuple[Array, int, int]:
        """Return the inputs of `count` steps after `done`; strides of states and steps, bytes."""
        if isinstance(self.torque, ComputedTorque):
            halves: Array = self.start + np.arange(
                2 * done, 2 * (done + count) + 1) * np.float64(0.5 * self.step)
            rows = np.concatenate(self.torque.motion.sample(halves), axis=1)
            return rows, 0, 2 * rows.strides[0]
        states, steps = (length > 1 for length in self.torque.shape[:2])
        table = self.torque[:, done:] if steps else self.torque
        return table, table.strides[0] * states, table.strides[1] * steps

    def in_own_speeds(self, buffer: Array, done: int) -> Array:
        """Return the buffer, which is in the robot's own speeds."""
        return buffer

    def results(self, kept: Array, states: Array, tau: Array) -> dict[str, Array]:
        """Return derived quantities of kept states (N, K, size) and torques (N, K, n)."""
        robot, shape = self.robot, states.shape[:2]
        q, u = (np.ascontiguousarray(x).reshape(-1, x.shape[2]) for x in np.split(
            states, [robot.n_q, robot.n_q + robot.n], axis=2)[:2])
        times = np.tile(self.start + kept * np.float64(self.step), shape[0])
        at: dict[str, Any] = {'t': times} if robot.equations.timed else {}
        found = {'udot': robot.forward_dynamics(q, u, tau.reshape(u.shape), **at),
                 'energy': np.stack([robot.kinetic_energy(q, u, **at),
                                     robot.potential_energy(q)], axis=1)}
        return {name: x.reshape(*shape, *x.shape[1:]) for name, x in found.items()}

    def acting(self, buffer: Array, done: int) -> Array | Callable[[Array], Array]:
        """
        Return the torques of the steps of a buffer from `advance`.

        Returns
        -------
        (1 or N, 1 or K, n) array, or callable
            Torques held during each step; or, for computed torque, a function that returns the
            torques at row numbers of the buffer.

        """
        if isinstance(self.torque, ComputedTorque):
            n = self.robot.n

            def at(rows: Array) -> Array:
                q, u = (np.ascontiguousarray(buffer[:, rows, part])
                        for part in (slice(0, n), slice(n, 2 * n)))
                return self.torques(done + rows, q, u)
            return at
        steps = buffer.shape[1] - 1
        table: Array = self.torque
        return table if table.shape[1] == 1 else table[:, done:done + steps]

    def torques(self, kept: Array, q: Array, u: Array) -> Array:
        """Return the torques that acted at the kept steps (K,) and states (N, K, n)."""
        torque = self.torque
        if not isinstance(torque, ComputedTorque):
            rows = torque[:, np.minimum(kept, torque.shape[1] - 1)]
            return np.ascontiguousarray(np.broadcast_to(rows, u.shape))
        t, end = self.start + kept * np.float64(self.step), torque.motion.duration
        if abs(t[-1] - end) <= 1e-6 * self.step:
            t[-1] = np.nextafter(end, -np.inf)  # the torque that acted until the end
        q_d, u_d, udot_d = torque.motion.sample(t)
        gains = np.concatenate([torque.kp, torque.kd])
        desired = [np.broadcast_to(x, q.shape) for x in (q_d, u_d, udot_d)]
        rows = [x.reshape(-1, self.robot.n) for x in (q, u, *desired)]
        rows.append(np.tile(gains, (len(rows[0]), 1)))
        no_wrench = [None] if self.robot.equations.wrench_frames else []
        tau: Array = law_kernel(self.robot)(*rows, *no_wrench)
        return tau.reshape(q.shape)


def torque_input(robot: Robot, step: float, count: int, torque: Any,
                 states: int | None, integrator: str, start: float = 0.0) -> TorqueInput:
    """
    Compile the step for a torque source and lay out its inputs.

    Parameters
    ----------
    robot : Robot
        The simulated robot.
    step : float
        s.
    count : int
        Number of steps.
    torque : None, array_like or ComputedTorque
        As in `simulate`.
    states : int or None
        Number of simulations; None for a single one.
    integrator : str
        One of `mechanics.integrators.INTEGRATORS`.
    start : float
        Time at the first step's beginning, s.

    Raises
    ------
    InputError
        Names the invalid torque or integrator.

    """
    block = robot.parameters.block
    if isinstance(torque, ComputedTorque):
        if torque.motion.joint_names != robot.joint_names:
            raise InputError(f'motion: of the joints {list(torque.motion.joint_names)}; '
                             f'expected {list(robot.joint_names)}')
        if torque.robot is not None and not torque.robot.equals(robot):
            raise InputError('torque: computed torque of another robot (model, options, gravity '
                             'or payload) than the simulated one; expected the same, or a '
                             'function that returns the torques of the other')
        return TorqueInput(robot, step_kernel(robot, True, integrator), step,
                           np.concatenate([torque.kp, torque.kd, [step], block]), torque, start)
    return TorqueInput(robot, step_kernel(robot, False, integrator), step,
                       np.concatenate([[step], block]), _table(robot, torque, count, states),
                       start)


def _table(robot: Robot, torque: Any, count: int, states: int | None) -> Array:
    """Return a torque given as None, (n,), (K, n) or (N, K, n), with three axes."""
    n = robot.n
    if torque is None:
        return np.zeros((1, 1, n))
    if states is not None and np.ndim(torque) == 3:
        rows = np.shape(torque)[1]
        table = checked(Argument('torque', (rows, n), robot.coordinate_names), torque)
        if len(table) != states:
            raise InputError(f'torque: shape {table.shape}; expected a table for each of the '
                             f'{states} states, or one (K, {n}) for all')
    else:
        table = checked(Argument('torque', (n,), robot.coordinate_names), torque)
        if table.ndim == 1:
            return table[None, None].copy()
        table = table[None]
    if table.shape[1] < count:
        raise InputError(f'torque: {table.shape[1]} rows; expected at least {count}, one per '
                         'step')
    return table


def evaluated_torque(torque: Callable[[float, Array, Array], Any], t: float, q: Array,
                     u: Array) -> Any:
    """Return the value of a torque function; InputError for a wrong signature or None."""
    try:
        found = torque(t, q, u)
    except TypeError as error:
        if error.__traceback__ is None or error.__traceback__.tb_next is not None:
            raise  # raised inside the function, not by the call
        raise InputError(f'torque: {error}; expected a function torque(t, q, u)') from None
    if found is None:
        raise InputError(f'torque at {t:.6g} s: None; expected {len(u)} numbers')
    return found
