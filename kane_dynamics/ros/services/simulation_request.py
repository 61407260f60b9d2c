"""What a simulation request asks for, checked; shared by the service and the action."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math
import time
from typing import Any

from kane_dynamics._util.checks import positive_time
from kane_dynamics.control.computed_torque import ComputedTorque
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import (Array, doubles, Index, motion_from_message, order,
                                                 trajectory_message, vector)
from kane_dynamics.ros.parameters.parameter_checks import per_joint
from kane_dynamics.ros.torque_path.gravity_payload import GravityAndPayload
from kane_dynamics.ros.torque_path.wrench_input import WrenchFrames
from kane_dynamics.simulation.simulate import simulate
from kane_dynamics.simulation.step_size import step_warning
import numpy as np

STEP = 1e-3  # s, where a request leaves it open
GAP = 0.01   # m or rad, by which encoders and tolerances may miss a closed loop
ROWS = 100   # points of the answer, about, where a request leaves the sample period open


@dataclass(frozen=True)
class Order:
    """
    Which entry of a request is which.

    Attributes
    ----------
    joint_names, speed_names : list of str
        All joints, and the independent ones, in the order of the request: positions are of all,
        all else of the independent. Without constraints they are the same.
    joints, speeds : (n_q,) and (n,) arrays of int, or None
        Where each of the robot's stands in the request; None where the orders are the same.

    """

    joint_names: list[str]
    speed_names: list[str]
    joints: Index | None
    speeds: Index | None

    @classmethod
    def of(cls, robot: Robot, names: Sequence[str]) -> 'Order':
        """Read the names of a request; none: the node's own order."""
        index = order(names, robot.joint_names, 'joint_names')
        every = list(names) or list(robot.joint_names)
        free = [name for name in every if name in robot.speed_names]
        return cls(every, free, index, order(free, robot.speed_names, 'joint_names'))


def closed(robot: Robot, q: Array) -> Array:
    """
    Return the posture near q at which closed loops are closed; q itself without any.

    Raises
    ------
    InputError
        It is further from closed than measuring explains.

    """
    if not robot.constraint_names:
        return q
    gap = np.nan_to_num(np.abs(robot.constraint_gap(q)))
    if gap.max() > GAP:
        raise InputError(f"position misses '{robot.constraint_names[int(gap.argmax())]}' by "
                         f'{gap.max():.3g} m or rad; valid: at most {GAP:g}')
    return robot.closed_posture(q, fixed=robot.speed_names)


@dataclass(frozen=True)
class Bounds:
    """The largest requests that are served; the parameters simulation.* and trajectory.*."""

    max_duration: float
    max_steps: int
    max_points: int
    max_reference: int


@dataclass(frozen=True)
class ServedRobot:
    """
    What requests are answered with.

    Attributes
    ----------
    robot, simulated : Robot
        For requests that are answered at once, and for simulations: each belongs to one thread.
    loads : GravityAndPayload
        Put into a robot before it answers.
    kp, kd : (n,) arrays
        The node's gains.
    bounds : Bounds
    frames : WrenchFrames
        Those of `robot` at which a request may put wrenches.
    integrator : str
        Of simulations; the parameter simulation.integrator.

    """

    robot: Robot
    simulated: Robot
    loads: GravityAndPayload
    kp: Array
    kd: Array
    bounds: Bounds
    frames: WrenchFrames
    integrator: str

    @classmethod
    def from_values(cls, robot: Robot, simulated: Robot, loads: GravityAndPayload,
                    values: Mapping[str, Any], frames: WrenchFrames) -> 'ServedRobot':
        """Take gains and bounds from the node's parameters."""
        kp, kd = (per_joint(values, name, robot.joint_names, 0.0)
                  for name in ('gains.kp', 'gains.kd'))
        return cls(robot, simulated, loads, kp, kd, Bounds(
            values['simulation.max_duration'], values['simulation.max_steps'],
            values['simulation.max_points'], values['trajectory.max_points']), frames,
            values['simulation.integrator'])


@dataclass(frozen=True)
class SimulationRequest:
    """A checked request: the arguments of `simulate`, and the joints' order in the answer."""

    robot: Robot
    loads: GravityAndPayload
    order: Order
    q0: Array
    u0: Array
    duration: float
    step: float
    sample: float
    torque: Array | ComputedTorque | None
    integrator: str

    @classmethod
    def from_request(cls, request: Any, served: ServedRobot) -> 'SimulationRequest':
        """
        Check a Simulate request or a SimulateMotion goal.

        Raises
        ------
        InputError
            Names the field, its value, and what is valid.

        """
        robot, n = served.robot, served.robot.n
        names = Order.of(robot, request.joint_names)
        index = names.speeds
        duration, step, sample = _times(request, served.bounds)
        torque: Array | ComputedTorque | None = None
        if request.torque_source == request.TABLE:
            torque = _table(request, index, n, duration, step)
        elif request.torque_source == request.COMPUTED_TORQUE:
            if robot.constraint_names:
                raise InputError('torque_source is COMPUTED_TORQUE, which the node has for arms '
                                 'without constraints; valid: ZERO, TABLE')
            motion = motion_from_message(request.reference, robot.joint_names,
                                         served.bounds.max_reference)
            torque = ComputedTorque(served.simulated, motion,
                                    vector(request.kp, index, n, 'kp', served.kp),
                                    vector(request.kd, index, n, 'kd', served.kd))
        elif request.torque_source != request.ZERO:
            raise InputError(f'torque_source is {request.torque_source}; valid: ZERO '
                             f'{request.ZERO}, TABLE {request.TABLE}, COMPUTED_TORQUE '
                             f'{request.COMPUTED_TORQUE}')
        q0 = vector(request.position, names.joints, robot.n_q, 'position')
        return cls(served.simulated, served.loads, names, closed(robot, q0),
                   vector(request.velocity, index, n, 'velocity', 0.0), duration, step, sample,
                   torque, served.integrator)

    def run(self, response: Any, proceed: Callable[[float], bool]) -> None:
        """Simulate and fill in the response; `proceed(t)` returning False ends it early."""
        self.loads.apply(self.robot)
        doubt = step_warning(self.robot, self.q0, self.step, self.integrator)
        began = time.perf_counter()
        try:
            trajectory = simulate(self.robot, self.q0, self.u0, self.duration, step=self.step,
                                  torque=self.torque, sample=self.sample, progress=proceed,
                                  integrator=self.integrator)
        except InputError as error:
            raise error if doubt is None else InputError(f'{error}: {doubt}') from None
        wall_time = time.perf_counter() - began
        response.message = doubt or ''
        response.wall_time = wall_time
        response.trajectory = trajectory_message(trajectory, self.robot, self.order.joint_names)
        response.constraint_names = list(trajectory.constraint_names)
        response.constraint_forces = doubles(trajectory.constraint_forces)
        response.kinetic_energy = doubles(trajectory.energy[:, 0])
        response.potential_energy = doubles(trajectory.energy[:, 1])
        response.limit_events = [str(event) for event in trajectory.limit_events]


def _seconds(request: Any, field: str, default: float | None = None) -> float:
    """Return a positive, finite time of the request; zero means `default` if there is one."""
    value = float(getattr(request, field))
    if value == 0.0 and default is not None:
        return default
    return positive_time(value, field, '' if default is None else ', or 0 for a default')


def _times(request: Any, bounds: Bounds) -> tuple[float, float, float]:
    """Return duration, step and sample period, s, all within bounds."""
    duration = _seconds(request, 'duration')
    if duration > bounds.max_duration:
        raise InputError(f'duration is {duration:g} s; valid: at most {bounds.max_duration:g} s '
                         '(parameter simulation.max_duration)')
    step = _seconds(request, 'step', STEP)
    if step > duration:
        raise InputError(f'step is {step:g} s; valid: at most the duration, {duration:g} s')
    if duration / step > bounds.max_steps * (1.0 + 1e-9):
        raise InputError(f'duration {duration:g} s in steps of {step:g} s needs '
                         f'{duration / step:.0f} steps; valid: at most {bounds.max_steps} '
                         '(parameter simulation.max_steps)')
    # About ROWS points in whole steps: converting more would hold the interpreter for longer
    # than the torque path should wait.
    chosen = step * max(1, math.ceil(duration / step / ROWS - 1e-9))
    sample = _seconds(request, 'sample_period', chosen)
    if duration / sample + 1.0 > bounds.max_points * (1.0 + 1e-9):
        raise InputError(f'duration {duration:g} s sampled every {sample:g} s gives '
                         f'{duration / sample + 1.0:.0f} points; valid: at most '
                         f'{bounds.max_points} (parameter simulation.max_points)')
    return duration, step, sample


def _table(request: Any, index: Index | None, n: int, duration: float, step: float) -> Array:
    """Return the torques of a request as one row for each step."""
    period = _seconds(request, 'torque_period', step)
    if len(request.torques) == 0 or len(request.torques) % n:
        raise InputError(f'torques has {len(request.torques)} entries; valid: a multiple of the '
                         f'{n} joints, not zero')
    table = np.array(request.torques, dtype=np.float64).reshape(-1, n)
    if not np.isfinite(table).all():
        row = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        raise InputError(f'row {row} of torques is {table[row].tolist()}; valid: finite numbers')
    steps = math.ceil(duration / step - 1e-9)
    last = (steps - 1) * step / period + 1e-9  # infinite for the shortest of periods
    if not last < len(table):
        raise InputError(f'torques has {len(table)} rows of {period:g} s; valid: at least '
                         f'{np.floor(last) + 1.0:.0f} for a duration of {duration:g} s')
    row_of_step = np.floor(np.arange(steps) * (step / period) + 1e-9).astype(np.intp)
    row_of_step = np.minimum(row_of_step, len(table) - 1)
    held: Array = table[row_of_step]
    return held if index is None else held[:, index]
