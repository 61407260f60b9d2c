"""Check and run a simulation request, for the service and the action."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math
import time
from typing import Any

from kane_dynamics._util.checks import positive_time
from kane_dynamics.control.computed_torque import ComputedTorque, joints_that_follow
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import (Array, doubles, Index,
                                                 motion_from_message,
                                                 trajectory_message, vector)
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload
from kane_dynamics.ros.parameters.parameter_checks import (integrator_of_simulations,
                                                           per_joint)
from kane_dynamics.ros.services.joint_order import close_loops, JointOrder
from kane_dynamics.ros.services.request_kernels import SIMULATIONS
from kane_dynamics.ros.services.served_robot import RIGID, ServedRobot
from kane_dynamics.simulation.contact import Contact
from kane_dynamics.simulation.simulate import simulate
from kane_dynamics.simulation.step_size import step_warning
import numpy as np

DEFAULT_STEP = 1e-3   # s
MOST_CHANGES = 20     # impacts on stops and of contacts in an answer
DEFAULT_POINTS = 100  # approximate number of points of a trajectory


@dataclass(frozen=True)
class SimulationRequest:
    """A checked request: arguments of `simulate`, and the response's joint order."""

    robot: Robot
    loads: GravityAndPayload
    order: JointOrder
    q0: Array
    u0: Array
    duration: float
    step: float
    sample: float
    torque: Array | ComputedTorque | None
    integrator: str | None
    stops: bool
    sticking: bool
    contacts: Sequence[Contact]
    assumption: str
    require_kernels: Callable[..., bool]

    @classmethod
    def from_request(cls, request: Any, served: ServedRobot) -> 'SimulationRequest':
        """
        Check a Simulate request or a SimulateMotion goal.

        Raise InputError that names an invalid field.
        """
        robot = served.robot
        n = served.robot.n
        values = served.values
        # Requests may name the joints in any order.
        names = JointOrder.of(robot, request.joint_names)
        index = names.speeds
        duration, step, sample = _times(request, values)
        torque: Array | ComputedTorque | None = None
        # The source of the torques: a table, a law that follows a reference, or none.
        if request.torque_source == request.TABLE:
            torque = _torque_table(request, index, n, duration, step)
        elif request.torque_source == request.COMPUTED_TORQUE:
            follow = list(joints_that_follow(robot))
            motion = motion_from_message(request.reference,
                                         [robot.joint_names[k] for k in follow],
                                         values['trajectory.max_points'])
            # Gains of the request, or those of the node for the joints that follow.
            gains = []
            for name in ('kp', 'kd'):
                of_node = per_joint(values, f'gains.{name}', robot.joint_names, 0.0)
                gains.append(vector(getattr(request, name), index, n, name,
                                    of_node[follow]))
            torque = ComputedTorque(served.simulated, motion, *gains)
        elif request.torque_source != request.ZERO:
            raise InputError(f'torque_source: {request.torque_source}; expected ZERO '
                             f'{request.ZERO}, TABLE {request.TABLE} or COMPUTED_TORQUE '
                             f'{request.COMPUTED_TORQUE}')
        q0 = vector(request.position, names.joints, robot.n_q, 'position')
        return cls(served.simulated, served.loads, names, close_loops(robot, q0),
                   vector(request.velocity, index, n, 'velocity', 0.0), duration, step,
                   sample, torque,
                   integrator_of_simulations(values, 'simulation.integrator'),
                   values['simulation.stops'], values['simulation.sticking'],
                   served.contacts, RIGID * (served.bending is not None), served.require_kernels)

    def run(self, response: Any, proceed: Callable[[float], bool]) -> None:
        """
        Simulate and fill in the response.

        Wait for the kernels, if they are not compiled yet. End early when `proceed(t)`
        returns False.
        """
        if not self.require_kernels(SIMULATIONS, lambda: proceed(0.0)):
            return
        # The payload and gravity of the node at the time of the request.
        self.loads.apply(self.robot)
        began = time.perf_counter()
        try:
            trajectory = simulate(self.robot, self.q0, self.u0, self.duration,
                                  step=self.step, torque=self.torque, sample=self.sample,
                                  progress=proceed, integrator=self.integrator,
                                  stops=self.stops, sticking=self.sticking,
                                  contacts=self.contacts)
        except InputError as error:
            # A request that chose the integrator is answered with the reason why the
            # step is too long.
            if self.integrator is None:  # chosen so that the step is stable
                raise
            warning = step_warning(self.robot, self.q0, self.step, self.integrator)
            if warning is None:
                raise
            raise InputError(f'{error}: {warning}') from None
        wall_time = time.perf_counter() - began
        # Events beyond the first ones would hide what else the message says.
        impacts = sorted([*trajectory.stop_events, *trajectory.contact_events])
        changes = map(str, impacts[:MOST_CHANGES])
        response.message = '\n'.join([*filter(None, [self.assumption]),
                                      *trajectory.warnings, *changes])
        response.wall_time = wall_time
        response.trajectory = trajectory_message(trajectory, self.robot,
                                                 self.order.joint_names)
        response.constraint_names = list(trajectory.constraint_names)
        response.constraint_forces = doubles(trajectory.constraint_forces)
        response.kinetic_energy = doubles(trajectory.energy[:, 0])
        response.potential_energy = doubles(trajectory.energy[:, 1])
        response.limit_events = [str(event) for event in trajectory.limit_events]


def _seconds(request: Any, field: str, default: float | None = None) -> float:
    """
    Return a positive, finite time of the request, s.

    Zero means `default`, if given.
    """
    value = float(getattr(request, field))
    if value == 0.0 and default is not None:
        return default
    return positive_time(value, field, '' if default is None
                         else ', or 0 for the default')


def _times(request: Any, values: Mapping[str, Any]) -> tuple[float, float, float]:
    """Return duration, step and sample period, s, checked against the parameters."""
    max_duration, max_steps, max_points = (values[f'simulation.max_{name}']
                                           for name in ('duration', 'steps', 'points'))
    duration = _seconds(request, 'duration')
    if duration > max_duration:
        raise InputError(f'duration: {duration:g} s; expected at most {max_duration:g} s')
    step = _seconds(request, 'step', DEFAULT_STEP)
    if step > duration:
        raise InputError(f'step: {step:g} s; expected at most the duration, '
                         f'{duration:g} s')
    if duration / step > max_steps * (1.0 + 1e-9):
        raise InputError(f'duration {duration:g} s with step {step:g} s: '
                         f'{duration / step:.0f} steps; expected at most {max_steps}')
    # A multiple of the step that gives about DEFAULT_POINTS points: the conversion of
    # more points would block the torque path for too long.
    default = step * max(1, math.ceil(duration / step / DEFAULT_POINTS - 1e-9))
    sample = _seconds(request, 'sample_period', default)
    if duration / sample + 1.0 > max_points * (1.0 + 1e-9):
        raise InputError(f'duration {duration:g} s with sample_period {sample:g} s: '
                         f'{duration / sample + 1.0:.0f} points; expected at most '
                         f'{max_points}')
    return duration, step, sample


def _torque_table(request: Any, index: Index | None, n: int, duration: float,
                  step: float) -> Array:
    """Return the torques of a request with one row for each step, (steps, n)."""
    period = _seconds(request, 'torque_period', step)
    if len(request.torques) == 0 or len(request.torques) % n:
        raise InputError(f'torques: {len(request.torques)} entries; expected a positive '
                         f'multiple of the number of joints, {n}')
    table = np.array(request.torques, dtype=np.float64).reshape(-1, n)
    if not np.isfinite(table).all():
        row = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        raise InputError(f'row {row} of torques: {table[row].tolist()}; expected finite '
                         'numbers')
    # The row that holds in each step; rounding of step over period must not choose the
    # one before.
    steps = math.ceil(duration / step - 1e-9)
    last = (steps - 1) * step / period + 1e-9  # infinite for a denormal period
    if not last < len(table):
        raise InputError(f'torques: {len(table)} rows of {period:g} s; expected at '
                         f'least {np.floor(last) + 1.0:.0f} for a duration of '
                         f'{duration:g} s')
    row_of_step = np.floor(np.arange(steps) * (step / period) + 1e-9).astype(np.intp)
    row_of_step = np.minimum(row_of_step, len(table) - 1)
    held: Array = table[row_of_step]
    return held if index is None else held[:, index]
