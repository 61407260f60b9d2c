"""The torques of a simulation in the layout of the native step."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque import ComputedTorque
from kane_dynamics.control.computed_torque_law import law_kernel
from kane_dynamics.control.constrained_law import constrained_law_kernel
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.native.runtime.argument import Argument, checked
from kane_dynamics.native.runtime.batch_loop import run_batch, Strided
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.loop_support import repeat
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.step_kernels import step_kernel, StepChoice
from kane_dynamics.simulation.stops.joint_stops import JointStops
from kane_dynamics.simulation.user_speeds import actual_accelerations
import numpy as np


@dataclass(frozen=True)
class TorqueInput:
    """A native step with its inputs; returned by `torque_input`."""

    robot: Robot
    kernel: Kernel
    choice: StepChoice  # of the kernel
    step: float
    constants: Array  # gains and step, then the robot's parameters
    torque: Any  # ComputedTorque, or (1 or N, 1 or steps, n) torques
    start: float = 0.0  # s
    stops: JointStops | None = None
    places: Sequence[int] | None = None  # the simulations of the buffer; None: all, in order

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
        extremes = self._native(buffer, done, single)
        if self.stops is not None:
            for row in self.stops.apply(self, buffer, done):
                for least, part in zip(extremes or (), (buffer[row, 1:].min(axis=0),
                                                        buffer[row, 1:].max(axis=0))):
                    least[row] = part
        return extremes

    @property
    def follows(self) -> bool:
        """Return whether the torque is that of computed torque, not held."""
        return isinstance(self.torque, ComputedTorque)

    def alone(self, row: int) -> 'TorqueInput':
        """Return the input of one simulation of the buffer, without stops."""
        table = self.torque
        if not isinstance(table, ComputedTorque) and len(table) > 1:
            table = table[row:row + 1]
        return replace(self, torque=table, stops=None, places=None)

    def _native(self, buffer: Array, done: int, single: bool) -> tuple[Array, Array] | None:
        """Compute the states as `advance`, without stops."""
        steps = buffer.shape[1] - 1
        inputs, lane, stride = self.inputs(done, steps)
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

    def inputs(self, done: int, count: int) -> tuple[Array, int, int]:
        """Return the inputs of `count` steps after `done`; strides of states and steps, bytes."""
        if isinstance(self.torque, ComputedTorque):
            halves: Array = self.start + np.arange(
                2 * done, 2 * (done + count) + 1) * np.float64(0.5 * self.step)
            rows = np.concatenate(self.torque.desired(halves), axis=1)
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
        udot, stop_forces = actual_accelerations(robot, q, u, tau.reshape(u.shape),
                                                 self.stops is not None, **at)
        found = {'udot': udot, 'stop_forces': stop_forces,
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
            power of the torques, (N, rows), W, at row numbers of the buffer.

        """
        if isinstance(self.torque, ComputedTorque):
            n_q, n = self.robot.n_q, self.robot.n

            def at(rows: Array) -> Array:
                q, u = (np.ascontiguousarray(buffer[:, rows, part])
                        for part in (slice(0, n_q), slice(n_q, n_q + n)))
                power: Array = np.einsum('nkj,nkj->nk', self.torques(done + rows, q, u), u)
                return power
            return at
        steps = buffer.shape[1] - 1
        table: Array = self.torque
        return table if table.shape[1] == 1 else table[:, done:done + steps]

    def torque_at(self, state: Array, done: int) -> Array:
        """Return the torque, (n,), at the state (size,) of the first simulation after steps."""
        if not isinstance(self.torque, ComputedTorque):
            held: Array = self.torque[0][min(done, self.torque.shape[1] - 1)]
            return held
        n_q, n = self.robot.n_q, self.robot.n
        q, u = state[None, None, :n_q], state[None, None, n_q:n_q + n]
        found: Array = self.torques(np.array([done]), q, u)[0, 0]
        return found

    def torques(self, kept: Array, q: Array, u: Array) -> Array:
        """Return the torques that acted at the kept steps (K,) and states (N, K, n)."""
        torque = self.torque
        if not isinstance(torque, ComputedTorque):
            rows = torque[:, np.minimum(kept, torque.shape[1] - 1)]
            return np.ascontiguousarray(np.broadcast_to(rows, u.shape))
        t, end = self.start + kept * np.float64(self.step), torque.motion.duration
        if abs(t[-1] - end) <= 1e-6 * self.step:
            t[-1] = np.nextafter(end, -np.inf)  # the torque that acted until the end
        gains = np.concatenate([torque.kp, torque.kd])
        desired = [np.broadcast_to(x, u.shape) for x in torque.desired(t)]
        rows = [x.reshape(-1, x.shape[-1]) for x in (q, u, *desired)]
        rows.append(np.tile(gains, (len(rows[0]), 1)))
        tree = isinstance(self.robot.equations, TreeEquations)
        kernel = law_kernel(self.robot) if tree else constrained_law_kernel(
            self.robot, torque.followed)
        more: list[Any] = [None] if len(self.robot.kernels.no_wrench) else []
        if self.robot.equations.timed:
            moments = self.start + kept * np.float64(self.step)
            more.append(np.tile(moments, len(q)))
        tau: Array = kernel(*rows, *more)
        return tau.reshape(u.shape)


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
        if torque.robot is None and torque.motion.joint_names != robot.joint_names:
            raise InputError(f'motion: of the joints {list(torque.motion.joint_names)}; '
                             f'expected {list(robot.joint_names)}')
        if torque.robot is None and not isinstance(robot.equations, TreeEquations):
            raise InputError('torque: ComputedTorque(motion, kp, kd), with chosen speeds or '
                             'constraints; expected ComputedTorque(robot, motion, kp, kd)')
        if torque.robot is not None and not torque.robot.equals(robot):
            raise InputError('torque: computed torque of another robot (model, options, gravity '
                             'or payload) than the simulated one; expected the same, or a '
                             'function that returns the torques of the other')
        choice = StepChoice(True, integrator, followed=torque.followed)
        constants = np.concatenate([torque.kp, torque.kd, [step], block])
    else:
        choice, constants = StepChoice(False, integrator), np.concatenate([[step], block])
        torque = _table(robot, torque, count, states)
    return TorqueInput(robot, step_kernel(robot, *choice), choice, step, constants, torque, start)


def _table(robot: Robot, torque: Any, count: int, states: int | None) -> Array:
    """Return a torque given as None, (n,), (K, n) or (N, K, n), with three axes."""
    n = robot.n
    if torque is None:
        return np.zeros((1, 1, n))
    if states is not None and np.ndim(torque) == 3:
        rows = np.shape(torque)[1]
        table = checked(Argument('torque', (rows, n), robot.speed_names), torque)
        if len(table) != states:
            raise InputError(f'torque: shape {table.shape}; expected a table for each of the '
                             f'{states} states, or one (K, {n}) for all')
    else:
        table = checked(Argument('torque', (n,), robot.speed_names), torque)
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
