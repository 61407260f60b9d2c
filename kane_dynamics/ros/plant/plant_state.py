"""The plant without ROS: arm, sensors, motors and communication delays."""

from collections import deque
from collections.abc import Collection, Iterator, Mapping
from typing import Any, Generic, NamedTuple, TypeVar

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.configuration_files import stated_contacts
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.loads.gravity_payload import parameter_loads
from kane_dynamics.ros.loads.wrench_input import check_frames
from kane_dynamics.ros.parameters.command_form import CommandForm
from kane_dynamics.ros.parameters.parameter_checks import (integrator_of_simulations,
                                                           per_joint)
from kane_dynamics.ros.plant.simulated_arm import added_terms, joint_count, SimulatedArm
import numpy as np

T = TypeVar('T')
# In transit: ten seconds at 10 kHz; none arrives while time is paused
MAX_ITEMS = 100_000


class Measurement(NamedTuple):
    """A measured state: stamp in ns; position, velocity and effort, (n,) each."""

    stamp: int
    q: Array
    u: Array
    effort: Array


class PlantState:
    """
    An arm with sensors, motors and communication lines.

    Each tick measures and sends the state, then advances the arm by one period under the
    command that has arrived.

    Parameters
    ----------
    robot : Robot
    values : mapping
        The node's parameters.

    Attributes
    ----------
    braked : bool
        Whether brakes hold the arm, until the first command.
    timed_out : bool
        Whether the last command is older than command_timeout.
    timeouts : int
        Number of command timeouts.
    ticks : int
        Number of ticks since the start.

    Raises
    ------
    InputError
        A parameter does not fit the robot.

    """

    def __init__(self, robot: Robot, values: Mapping[str, Any],
                 actuated: Collection[str] = ()) -> None:
        self.check(robot, values)
        self.robot = robot
        self._values = values
        self.period: float = NANO / values['rate']  # ns
        self.arm = SimulatedArm(robot, 1.0 / (values['rate'] * values['substeps']),
                                integrator_of_simulations(values, 'integrator'),
                                values['arm_compensates'], values['sticking'],
                                values['drives.sensor_side'],
                                stated_contacts('contacts', values))
        self.states: DelayLine[Measurement] = DelayLine()
        self.commands: DelayLine[Array] = DelayLine()
        self.timeouts = self.ticks = 0
        self._zero = np.zeros(len(self.arm.joint_names))
        self._commanded = list(self.arm.commanded(actuated))
        self.form = CommandForm(robot, self._commanded, values)
        self._wrench_until: dict[str, int] = {}
        self.update(values)
        self.reset()

    @staticmethod
    def check(robot: Robot, values: Mapping[str, Any]) -> None:
        """Raise InputError unless the parameters fit the robot and each other."""
        n = joint_count(robot)
        limits = robot.limits
        names = robot.joint_names[:n]
        for name in ('noise.position', 'noise.velocity', 'noise.effort',
                     'limits.effort'):
            per_joint(values, name, names, 0.0)
        parameter_loads(robot.model, values)
        added_terms(values['arm_compensates'])
        check_frames(robot.model, values['wrench.frames'])
        # An initial position must be within the limits, from which nothing would return
        # it.
        if values['initial.position'].shape != (0,):
            initial = per_joint(values, 'initial.position', names, 0.0)
            for name, q, low, high in zip(names, initial, limits.lower[:n],
                                          limits.upper[:n], strict=True):
                if not low <= q <= high:
                    raise InputError(f"parameter 'initial.position' of joint '{name}': "
                                     f'{q:g}; expected {low:g} to {high:g}')
        if values['rate_factor'] != 1.0 and not values['publish_clock']:
            raise InputError(f"parameter 'rate_factor': {values['rate_factor']:g}; "
                             'expected 1 unless publish_clock is true')

    def update(self, values: Mapping[str, Any]) -> None:
        """
        Use checked parameters from the next tick on.

        The initial positions are used at the next reset.
        """
        previous = self._values
        self._values = values
        names = self.arm.joint_names
        self._noise = [per_joint(values, f'noise.{what}', names, 0.0)
                       for what in ('position', 'velocity', 'effort')]
        self._noisy = any(size.any() for size in self._noise)
        # The stricter limit of the robot and the parameter.
        self.arm.limit[:] = np.minimum(self.arm.effort_limit,
                                       per_joint(values, 'limits.effort', names, np.inf))
        # Measurements and commands may be late or lost, as on a real bus.
        for what, line in (('states', self.states), ('commands', self.commands)):
            line.configure(values[f'delay.{what}'], values[f'dropout.{what}'])
        self._timeout = round(values['command_timeout'] * NANO)
        parameter_loads(self.robot.model, values).apply(self.robot)
        self.arm.use_parameters()
        # A new seed begins a new sequence of noise; other changes continue it.
        if previous['seed'] != values['seed']:
            self._reset_generators()

    def reset(self) -> None:
        """Put the arm at rest at its initial position; keep the time."""
        arm = self.arm
        # Empty stands for a configuration within the limits, of loops that of the file.
        if self._values['initial.position'].shape == (0,):
            arm.reset(None)
        else:
            initial = per_joint(self._values, 'initial.position', arm.joint_names, 0.0)
            arm.reset(np.clip(initial, arm.lower, arm.upper))
        # Nothing of the time before acts any more.
        self._wrench_until.clear()
        self._command: Array | None = None
        self._last_command: int | None = None
        self.braked = bool(self._values['hold_until_command'])
        self.timed_out = False
        self.states.clear()
        self.commands.clear()
        self._reset_generators()

    def _reset_generators(self) -> None:
        """Restart the random generators; noise and each line have independent ones."""
        noise, states, commands = np.random.SeedSequence(self._values['seed']).spawn(3)
        self._random = np.random.default_rng(noise)
        self.states.set_generator(np.random.default_rng(states))
        self.commands.set_generator(np.random.default_rng(commands))

    @property
    def time(self) -> int:
        """Return the time since the start, ns."""
        return round(self.ticks * self.period)

    @property
    def command_age(self) -> float:
        """Return the age of the last command, s; infinite before the first."""
        return (np.inf if self._last_command is None
                else (self.time - self._last_command) / NANO)

    def reset_time(self) -> None:
        """Reset arm and time."""
        self.ticks = 0
        self.reset()

    def command(self, numbers: Array) -> None:
        """Send a command in its form to the motors."""
        self.commands.send(self.time, numbers)

    def apply_wrench(self, frame: str, wrench: Array) -> None:
        """
        Apply a wrench at a frame, for wrench.timeout or until the next one there.

        Parameters
        ----------
        frame : str
            One of parameter wrench.frames.
        wrench : (6,) array
            Force, then moment of the environment on the arm, at the origin and in the
            axes of the frame, N and N m.

        Raises
        ------
        InputError
            The frame is not in wrench.frames, or the wrench is not finite or too large.

        """
        self.arm.frames.row(frame)
        max_force = self._values['wrench.max_force']
        max_moment = self._values['wrench.max_moment']
        bounds = np.repeat([max_force, max_moment], 3)
        if not (np.abs(wrench) <= bounds).all():  # NaN too
            raise InputError(f'wrench: {wrench.tolist()}; expected finite numbers, at '
                             f'most {max_force:g} N and {max_moment:g} N m (parameters '
                             'wrench.max_force and wrench.max_moment)')
        self.arm.wrenches[frame] = wrench
        duration = round(self._values['wrench.timeout'] * NANO)
        self._wrench_until[frame] = self.time + duration

    def tick(self, stamp: int) -> Iterator[Measurement]:
        """
        Measure the state, advance by one period, and return what arrives now.

        Parameters
        ----------
        stamp : int
            Present time of the published clock or the system clock, ns.

        Raises
        ------
        InputError
            The motion diverged (non-finite state); the arm keeps its last state.

        """
        now = self.time
        # The state is measured before the torque that answers an earlier one acts.
        self.states.send(now, self._measured(stamp))
        command = self._present_command(now)
        for frame, end in list(self._wrench_until.items()):
            if end <= now:
                del self.arm.wrenches[frame], self._wrench_until[frame]
        if not self.braked:
            for _ in range(self._values['substeps']):
                self.arm.step(self._torque(command))
        self.ticks += 1
        return self.states.receive(now)

    def _torque(self, command: Array | None) -> Array:
        """Return the torques of the drives, (n,), with a command at the present state."""
        if command is None:
            return self._zero
        q, u = self.arm.measured
        torque = self._zero.copy()
        torque[self._commanded] = self.form.torque(command, q[self._commanded],
                                                   u[self._commanded])
        return torque

    def _present_command(self, now: int) -> Array | None:
        """Return the command after arrivals and timeout; None without one."""
        for numbers in self.commands.receive(now):
            self._command = numbers
            self._last_command = now
            self.braked = False
        # As a drive does, the arm stops or keeps the last torque when commands stay
        # out.
        timed_out = (self._last_command is not None
                     and now - self._last_command > self._timeout)
        self.timeouts += timed_out and not self.timed_out
        self.timed_out = timed_out
        zero = timed_out and self._values['after_timeout'] == 'zero'
        return None if zero else self._command

    def _measured(self, stamp: int) -> Measurement:
        """Return the present state with noise."""
        effort = self.arm.effort.copy()
        effort[self._commanded] /= self.form.scale
        values = [*self.arm.measured, effort]
        if self._noisy:
            values = [value + size * self._random.standard_normal(len(value))
                      for value, size in zip(values, self._noise, strict=True)]
        return Measurement(stamp, *values)


class DelayLine(Generic[T]):
    """
    A queue whose items arrive in order after a delay, or are dropped at random.

    When the queue is full, the oldest item is dropped.

    Attributes
    ----------
    dropped : int
        Number of items dropped at random.

    """

    def __init__(self) -> None:
        self.dropped = 0
        self._delay = 0
        self._dropout = 0.0
        self._waiting: deque[tuple[int, T]] = deque(maxlen=MAX_ITEMS)
        self._random = np.random.default_rng(0)

    def configure(self, delay: float, dropout: float) -> None:
        """Set the delay, s, and the probability of dropouts for further items."""
        self._delay = round(delay * NANO)
        self._dropout = dropout

    def set_generator(self, random: np.random.Generator) -> None:
        """Draw dropouts from this generator."""
        self._random = random

    def clear(self) -> None:
        """Remove all items in transit."""
        self._waiting.clear()

    def send(self, now: int, item: T) -> None:
        """Send an item at a time, ns."""
        if self._dropout > 0.0 and self._random.random() < self._dropout:
            self.dropped += 1
        else:
            self._waiting.append((now + self._delay, item))

    def receive(self, now: int) -> Iterator[T]:
        """Yield the items that have arrived at a time, ns, in the order of `send`."""
        while self._waiting and self._waiting[0][0] <= now:
            yield self._waiting.popleft()[1]
