"""What the plant node does in each of its ticks; it knows time, commands and states, no ROS."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.parameters.parameter_checks import per_joint
from kane_dynamics.ros.plant.delay_line import DelayLine
from kane_dynamics.ros.plant.simulated_arm import joint_count, SimulatedArm
from kane_dynamics.ros.torque_path.gravity_payload import start_loads
from kane_dynamics.ros.torque_path.wrench_input import check_frames
import numpy as np


class Measurement(NamedTuple):
    """A state as sensors tell it: stamp in ns; position, velocity, effort, (n,) each."""

    stamp: int
    q: Array
    u: Array
    effort: Array


class PlantState:
    """
    An arm with its sensors, its motors, and the lines to and from them.

    Its time goes on by one period a tick. In a tick the state is measured and sent, and then the
    arm moves on for one period under the command that has arrived by then.

    Parameters
    ----------
    robot : Robot
    values : mapping
        The node's parameters.

    Attributes
    ----------
    held : bool
        Whether brakes hold the arm, since no command has come yet.
    late : bool
        Whether the last command is older than command_timeout.
    timeouts : int
        How often that happened.
    ticks : int
        Since the start.

    Raises
    ------
    InputError
        A parameter does not fit the robot.

    """

    def __init__(self, robot: Robot, values: Mapping[str, Any]) -> None:
        self.check(robot, values)
        self.robot, self._values = robot, values
        self.period: float = NANO / values['rate']  # ns
        self.arm = SimulatedArm(robot, 1.0 / (values['rate'] * values['substeps']),
                                values['integrator'])
        self.states: DelayLine[Measurement] = DelayLine()
        self.commands: DelayLine[Array] = DelayLine()
        self.timeouts = self.ticks = 0
        self._zero = np.zeros(len(self.arm.joint_names))
        self._pushed_until: dict[str, int] = {}
        self.update(values)
        self.reset()

    @staticmethod
    def check(robot: Robot, values: Mapping[str, Any]) -> None:
        """Raise InputError if these parameters do not fit the robot or each other."""
        n, limits = joint_count(robot), robot.limits
        names = robot.joint_names[:n]
        for name in ('noise.position', 'noise.velocity', 'noise.effort', 'limits.effort'):
            per_joint(values, name, names, 0.0)
        start_loads(robot.model, values)
        check_frames(robot.model, values['wrench.frames'])
        if values['initial.position'].shape != (0,):
            initial = per_joint(values, 'initial.position', names, 0.0)
            for name, q, low, high in zip(names, initial, limits.lower[:n], limits.upper[:n],
                                          strict=True):
                if not low <= q <= high:
                    raise InputError(f"parameter 'initial.position' of joint '{name}' is {q:g}; "
                                     f'valid: {low:g} to {high:g}')
        if values['rate_factor'] != 1.0 and not values['publish_clock']:
            raise InputError(f"parameter 'rate_factor' is {values['rate_factor']:g}; valid: 1, "
                             'unless publish_clock tells everyone the time')

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next tick on; the initial position from a reset on."""
        before, self._values = self._values, values
        names = self.arm.joint_names
        self._noise = [per_joint(values, f'noise.{what}', names, 0.0)
                       for what in ('position', 'velocity', 'effort')]
        self._noisy = any(size.any() for size in self._noise)
        self.arm.limit[:] = np.minimum(self.robot.limits.effort[:len(names)],
                                       per_joint(values, 'limits.effort', names, np.inf))
        for what, channel in (('states', self.states), ('commands', self.commands)):
            channel.settle(values[f'delay.{what}'], values[f'dropout.{what}'])
        self._timeout = round(values['command_timeout'] * NANO)
        start_loads(self.robot.model, values).apply(self.robot)
        self.arm.use_parameters()
        if before['seed'] != values['seed']:
            self._draw_anew()

    def reset(self) -> None:
        """Put the arm at rest at its initial position, as at the start; its time goes on."""
        arm = self.arm
        initial = per_joint(self._values, 'initial.position', arm.joint_names, 0.0)
        arm.put(np.clip(initial, arm.lower, arm.upper))
        self._pushed_until.clear()
        self._torque = self._zero
        self._heard: int | None = None
        self.held, self.late = bool(self._values['hold_until_command']), False
        self.states.clear()
        self.commands.clear()
        self._draw_anew()

    def _draw_anew(self) -> None:
        """Begin the random numbers again; each purpose has its own, so that none shifts others."""
        draws = [np.random.default_rng(each) for each in np.random.SeedSequence(
            self._values['seed']).spawn(3)]
        self._random = draws[0]
        self.states.draw_from(draws[1])
        self.commands.draw_from(draws[2])

    @property
    def time(self) -> int:
        """Return the time since the start, ns."""
        return round(self.ticks * self.period)

    @property
    def silence(self) -> float:
        """Return the age of the last command, s; infinite before the first."""
        return np.inf if self._heard is None else (self.time - self._heard) / NANO

    def rewind(self) -> None:
        """Reset, and begin with time zero again."""
        self.ticks = 0
        self.reset()

    def command(self, tau: Array) -> None:
        """Send torques, (n,) N m or N, to the motors."""
        self.commands.put(self.time, tau)

    def push(self, frame: str, wrench: Array) -> None:
        """
        Push on a frame for the time of wrench.timeout, or until the next push on it.

        Parameters
        ----------
        frame : str
            One of parameter wrench.frames.
        wrench : (6,) array
            Force, then moment at the frame's origin, in the frame's axes, N and N m, of the
            environment on the arm.

        Raises
        ------
        InputError
            Nothing can push there, or the wrench is not finite or too large.

        """
        self.arm.frames.row(frame)
        most = np.repeat([self._values['wrench.max_force'], self._values['wrench.max_moment']], 3)
        if not (np.abs(wrench) <= most).all():
            raise InputError(f'the wrench is {wrench.tolist()}; valid: finite numbers, at most '
                             f'{most[0]:g} N and {most[3]:g} N m (parameters wrench.max_force and '
                             'wrench.max_moment)')
        self.arm.wrenches[frame] = wrench
        self._pushed_until[frame] = self.time + round(self._values['wrench.timeout'] * NANO)

    def tick(self, stamp: int) -> Iterator[Measurement]:
        """
        Measure, and move on by one period; return the measurements that arrive now.

        Parameters
        ----------
        stamp : int
            Of this moment on the clock that everyone has, ns.

        Raises
        ------
        InputError
            The motion would leave the finite numbers; the arm stays where it was.

        """
        now = self.time
        self.states.put(now, self._measured(stamp))
        torque = self._asked(now)
        for frame in [frame for frame, end in self._pushed_until.items() if end <= now]:
            del self.arm.wrenches[frame], self._pushed_until[frame]
        if not self.held:
            for _ in range(self._values['substeps']):
                self.arm.step(torque)
        self.ticks += 1
        return self.states.take(now)

    def _asked(self, now: int) -> Array:
        """Return the torque that the motors are asked for from now on, (n,)."""
        for tau in self.commands.take(now):
            self._torque, self._heard, self.held = tau, now, False
        late = self._heard is not None and now - self._heard > self._timeout
        self.timeouts += late and not self.late
        self.late = late
        return self._zero if late and self._values['after_timeout'] == 'zero' else self._torque

    def _measured(self, stamp: int) -> Measurement:
        values = [self.arm.q.copy(), self.arm.u.copy(), self.arm.effort.copy()]
        if self._noisy:
            values = [value + size * self._random.standard_normal(len(value))
                      for value, size in zip(values, self._noise, strict=True)]
        return Measurement(stamp, *values)
