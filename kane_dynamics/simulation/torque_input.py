"""The torques of a simulation in the layout of the native step."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque import (ComputedTorque, law_kernel,
                                                   require_rigid)
from kane_dynamics.errors import InputError
from kane_dynamics.native.runtime.kernel import Argument, checked
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.energy_balance import load_friction_kernel
from kane_dynamics.simulation.motion_samples import speeds_in
from kane_dynamics.simulation.observers import Power
from kane_dynamics.simulation.step_kernels import step_kernel, StepChoice
import numpy as np

# How far inside a step its ends are: relative to the step, and at least in roundings of
# times.
INSET, ROUNDINGS = 1e-9, 4.0
# Torques as a user gives them as a function of t, q and u.
TorqueFunction = Callable[[float, Array, Array], Any]


@dataclass(frozen=True)
class TorqueInput:
    """
    A native step with its inputs; returned by `torque_input`.

    Attributes
    ----------
    robot : Robot
    kernel : Kernel or None
        Of one step with the smooth law of friction.
    choice : StepChoice
        Of the kernel.
    step : float
        s.
    constants : array
        Gains and step, then the robot's parameters.
    torque : ComputedTorque, or (1 or N, 1 or steps, n) array
    start : float
        Initial time, s.
    single : bool
        Use the kernel for one state: N is 1.
    simulations : sequence of int, optional
        Numbers of the simulations in a buffer. None: all, in order.

    """

    robot: Robot
    kernel: Any
    choice: StepChoice
    step: float
    constants: Array
    torque: Any
    start: float = 0.0
    single: bool = True
    simulations: Sequence[int] | None = None

    def advance(self, buffer: Array, done: int) -> None:
        """
        Compute the states after each step, without the GIL.

        Parameters
        ----------
        buffer : (N, K + 1, size) array
            The N states after `done` steps, and space for the next K of each.
        done : int
            Number of earlier steps.

        """
        steps = buffer.shape[1] - 1
        inputs = self.inputs(done, steps)
        # One simulation is a scan, many share the lanes of a rollout.
        if self.single:
            states = buffer[0]
            row = inputs[0, 0] if inputs.shape[1] == 1 else inputs[0]
            self.kernel.scan([states[:-1], row], states[1:], constants=self.constants)
        else:
            self.kernel.rollout([buffer[:, :-1], inputs], buffer[:, 1:], steps,
                                constants=self.constants)

    @property
    def follows(self) -> bool:
        """Return whether the torque is computed at each stage, instead of held."""
        return isinstance(self.torque, ComputedTorque)

    def alone(self, row: int) -> 'TorqueInput':
        """Return the input of one simulation of the buffer."""
        table = self.torque
        if not isinstance(table, ComputedTorque) and len(table) > 1:
            table = table[row:row + 1]
        return replace(self, torque=table, single=True, simulations=None)

    def inputs(self, done: int, count: int) -> Array:
        """
        Return the inputs of `count` steps after `done`: views, (1 or N, 1 or count, ...).

        An axis of length 1 is of what all simulations, or all steps, share.
        """
        if isinstance(self.torque, ComputedTorque):
            begins = self.start + np.arange(done, done + count) * np.float64(self.step)
            return self._desired(begins, self.step)
        shared = self.torque.shape[1] == 1
        table: Array = self.torque if shared else self.torque[:, done:done + count]
        return table[:, :, None]

    def inputs_within(self, done: int, passed: Any, lengths: Array) -> Array:
        """
        Return the inputs of parts of a step, of K lengths: one for all, or K of them.

        They begin `passed` s after its beginning, a number or (K,).
        """
        if not isinstance(self.torque, ComputedTorque):
            return np.asarray(self.inputs(done, 1)[0, 0])
        begin = self.start + done * np.float64(self.step) + passed
        return np.asarray(self._desired(np.broadcast_to(begin, lengths.shape), lengths)[0])

    def _desired(self, begins: Array, length: Any) -> Array:
        """
        Return the desired motion of K steps, (1, K, 3, 3 n): beginning, middle and end.

        At `stage_times`.
        """
        times = stage_times(begins, length)
        rows = np.concatenate(self.torque.desired(times.ravel()), axis=1)
        stages = rows.reshape(1, *times.shape, rows.shape[1])
        return np.ascontiguousarray(stages)

    def acting(self, buffer: Array, done: int) -> Array | Power:
        """
        Return the torques of the steps of a buffer from `advance`.

        Returns
        -------
        (1 or N, 1 or K, n) array, or callable
            Torques held during each step; or, for computed torque, a function that
            returns the power of the torques, (N, rows), W, at row numbers of the buffer.

        """
        if isinstance(self.torque, ComputedTorque):
            # The power of a law is computed only at rows that are looked at.
            def power_at(rows: Array) -> Array:
                tau = self.torques(done + rows, buffer[:, rows])
                power: Array = np.einsum('nkj,nkj->nk', tau,
                                         speeds_in(self.robot, buffer[:, rows]))
                if self.robot.equations.carries_loads:
                    power = power - self._load_friction_power(buffer[:, rows], tau)
                return power
            return power_at
        # A constant torque is one row, which stands for all steps.
        table: Array = self.torque
        if table.shape[1] == 1:
            return table
        return table[:, done:done + buffer.shape[1] - 1]

    def _load_friction_power(self, states: Array, tau: Array) -> Array:
        """Return the power of load friction, (N, rows), W, at states, (N, rows, size)."""
        kernel = load_friction_kernel(self.robot)
        size = kernel.arguments[0].shape[0]
        power: Array = kernel(states[..., :size].reshape(-1, size),
                              tau.reshape(-1, tau.shape[-1]))
        return power.reshape(tau.shape[:-1])

    def torque_at(self, state: Array, done: int, passed: float = 0.0) -> Array:
        """Return the torque, (n,), of one state, `passed` s after the beginning of a step."""
        if not isinstance(self.torque, ComputedTorque):
            held: Array = self.torque[0][min(done, self.torque.shape[1] - 1)]
            return held
        torque: Array = self.torques(np.array([done + passed / self.step]),
                                     state[None, None])[0, 0]
        return torque

    def torques(self, sampled: Array, states: Array) -> Array:
        """Return the torques, (N, K, n), at the sampled steps, (K,), and states, (N, K, size)."""
        torque = self.torque
        if not isinstance(torque, ComputedTorque):
            rows = torque[:, np.minimum(sampled, torque.shape[1] - 1)]
            shape = *states.shape[:2], self.robot.n
            return np.ascontiguousarray(np.broadcast_to(rows, shape))
        q = np.ascontiguousarray(states[..., :self.robot.n_q])
        u = speeds_in(self.robot, states)
        # The law at the samples of all simulations, as rows of one batch.
        moments = self.start + sampled * np.float64(self.step)
        t = moments.copy()
        end = torque.motion.duration
        if abs(t[-1] - end) <= 1e-6 * self.step:
            t[-1] = np.nextafter(end, -np.inf)  # the torque that acted until the end
        arguments = [q.reshape(-1, q.shape[-1]), u.reshape(-1, u.shape[-1])]
        for desired in torque.desired(t):
            of_all = np.broadcast_to(desired, u.shape)
            arguments.append(of_all.reshape(-1, u.shape[-1]))
        gains = np.concatenate([torque.kp, torque.kd])
        arguments.append(np.tile(gains, (len(arguments[0]), 1)))
        kernel = law_kernel(self.robot, torque.followed)
        no_wrench = (None,) if len(self.robot.kernels.no_wrench) else ()
        times = self.robot.equations.time_inputs(np.tile(moments, len(states)))
        tau: Array = kernel(*arguments, *no_wrench, *times)
        return tau.reshape(u.shape)


def stage_times(begins: Array, length: Any) -> Array:
    """
    Return the times of the beginning, middle and end of K steps, (K, 3), s.

    The ends are in the inside of the step. Where the desired acceleration jumps between
    two steps, each has its own value, which keeps the integrator's order.
    """
    ends = begins + length
    rounding = np.spacing(np.maximum(np.abs(begins), np.abs(ends)))
    # By as much at the beginning as at the end: what both are off by cancels.
    inset = np.maximum(INSET * length, ROUNDINGS * rounding)
    stages = [begins + inset, begins + 0.5 * length, ends - inset]
    return np.stack(stages, axis=1)


def torque_input(robot: Robot, step: float, count: int, torque: Any,
                 states: int | None, integrator: str, start: float = 0.0,
                 smooth: bool = True) -> TorqueInput:
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
    torque : None, array_like, callable or ComputedTorque
        As in `simulate`; for a function, a table of one row of zeros to write to.
    states : int or None
        Number of simulations; None for a single one.
    integrator : str
        One of `mechanics.integrators.INTEGRATORS`.
    start : float
        Time at the first step's beginning, s.
    smooth : bool
        Compile the step with the smooth law of friction.

    Raises
    ------
    InputError
        Names the invalid torque or integrator.

    """
    block = robot.parameters.block
    # Constants of a step in the order of its kernel: gains, the step, the parameters.
    if isinstance(torque, ComputedTorque):
        _require_same_robot(torque, robot)
        choice = StepChoice(True, integrator, followed=torque.followed)
        constants = np.concatenate([torque.kp, torque.kd, [step], block])
    else:
        choice = StepChoice(False, integrator)
        constants = np.concatenate([[step], block])
        torque = _table(robot, None if callable(torque) else torque, count, states)

    # Where joints stick, the steps have kernels of their own.
    kernel = step_kernel(robot, *choice) if smooth else None
    return TorqueInput(robot, kernel, choice, step, constants,
                       torque, start,
                       single=states is None)


def _require_same_robot(torque: ComputedTorque, robot: Robot) -> None:
    """Raise InputError for computed torque of another robot than the simulated one."""
    # A law without a robot is that of a tree; its joints must be those that move.
    if torque.robot is None:
        require_rigid(robot)
        if torque.motion.joint_names != robot.joint_names:
            raise InputError(f'motion: of the joints {list(torque.motion.joint_names)}; '
                             f'expected {list(robot.joint_names)}')
        if not robot.equations.in_joint_rates:
            raise InputError('torque: ComputedTorque(motion, kp, kd), with chosen '
                             'speeds or constraints; expected ComputedTorque(robot, '
                             'motion, kp, kd)')
    elif not torque.robot.equals(robot):
        raise InputError('torque: computed torque of another robot (model, options, '
                         'gravity or payload) than the simulated one; expected the '
                         'same, or a function that returns the torques of the other')


def _table(robot: Robot, torque: Any, count: int, states: int | None) -> Array:
    """Return a torque given as None, (n,), (K, n) or (N, K, n), with three axes."""
    n = robot.n
    # The axes are simulation, step and speed; an axis of length 1 stands for all.
    if torque is None:
        return np.zeros((1, 1, n))
    if states is not None and np.ndim(torque) == 3:
        rows = np.shape(torque)[1]
        table = checked(Argument('torque', (rows, n), robot.speed_names), torque)
        if len(table) != states:
            raise InputError(f'torque: shape {table.shape}; expected a table for each '
                             f'of the {states} states, or one (K, {n}) for all')
    else:
        table = checked(Argument('torque', (n,), robot.speed_names), torque)
        if table.ndim == 1:
            return table[None, None].copy()
        table = table[None]
    # A table ends before the simulation does: no torque is assumed after it.
    if table.shape[1] < count:
        raise InputError(f'torque: {table.shape[1]} rows; expected at least {count}, '
                         'one per step')
    return table


def evaluated_torque(robot: Robot, torque: TorqueFunction, t: float, q: Array,
                     u: Array) -> Array:
    """
    Return the value of a torque function, (n,).

    Raises
    ------
    InputError
        The function has a wrong signature, or returns something else than n finite
        numbers.

    """
    try:
        value = torque(t, q, u)
    except TypeError as error:
        if error.__traceback__ is None or error.__traceback__.tb_next is not None:
            raise  # raised inside the function, not by the call
        raise InputError(f'torque: {error}; expected a function torque(t, q, u)') from None
    name = f'torque at {t:.6g} s'
    if value is None:
        raise InputError(f'{name}: None; expected {len(u)} numbers')
    argument = Argument(name, (robot.n,), robot.speed_names)
    try:
        shape = np.shape(value)
    except ValueError:  # rows of several lengths
        return checked(argument, value)
    if shape != (robot.n,):
        raise InputError(f'{name}: shape {shape} of the value of the function; expected '
                         f'({robot.n},)')
    return checked(argument, value)
