"""A robot's motion over many steps, of a batch of states in the memory of a GPU."""

from collections.abc import Sequence
from ctypes import c_int64
import math
from typing import Any

from kane_dynamics._util.attribute_hints import hinting
from kane_dynamics._util.checks import constant, integer, positive_time
from kane_dynamics.errors import InputError
from kane_dynamics.gpu.kernel_call import (array_layout, KernelCall, ptx_text, REALS,
                                           require_dtype)
from kane_dynamics.mechanics.integrators import integrator_of
from kane_dynamics.native.backends.gpu_rollout import rollout_text, StepLayout
from kane_dynamics.native.runtime.kernel import Argument
from kane_dynamics.robot.derivative_kernels import PARAMETERS
from kane_dynamics.robot.frameworks.batch_function import batch_function
from kane_dynamics.robot.frameworks.quantity_function import require_shape
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.presliding import require_no_bristles
from kane_dynamics.simulation.step_kernels import step_program, StepChoice

MOST_STEPS = 2**31


@hinting
class DeviceRollout:
    """Motions of a batch of states on a GPU; see `rollout`."""

    def __init__(self, robot: Robot, parameters: str | Sequence[str], dtype: str,
                 integrator: str) -> None:
        """Check the names; the kernel is made at the first use."""
        self.dtype = require_dtype(dtype)
        integrator_of(integrator)
        # A copy, so that later changes of the robot's parameters do not change the
        # kernel.
        self._robot = robot.copy()
        self._integrator = integrator
        self._made_of = self._robot, parameters, dtype, integrator
        # This call checks the parameters.
        batch_function(self._robot, 'forward_dynamics', '', parameters)
        names = (parameters,) if isinstance(parameters, str) else tuple(parameters)
        parts = {name: PARAMETERS[name] for name in names}
        require_no_bristles(robot, 'rollout')
        self._layout = StepLayout(robot.n_q, robot.n,
                                  robot.equations.time_inputs('%time'),
                                  robot.equations.watched, parts)
        self._arguments = [Argument('q', (robot.n_q,)), Argument('u', (robot.n,)),
                           Argument('tau', (robot.n,))]
        for name, part in parts.items():
            self._arguments.append(Argument(name, (part.stop - part.start,)))
        self._ptx: str | None = None

    def __repr__(self) -> str:
        """Return the names of the arguments."""
        return f'<DeviceRollout ({", ".join(a.name for a in self._arguments)}, h)>'

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the robot and the names."""
        return type(self), self._made_of

    @property
    def ptx(self) -> str:
        """Return the kernel in PTX, the assembly language that the driver compiles."""
        if self._ptx is None:
            def text() -> str:
                choice = StepChoice(False, self._integrator)
                step = step_program(self._robot, 'rollout', choice)
                return rollout_text(step, self._layout, REALS[self.dtype])
            name = f'rollout {self._integrator} {tuple(self._layout.parameters)}'
            self._ptx = ptx_text(name, self._robot.kernels.key, self.dtype, text)
        return self._ptx

    def __call__(self, q: Any, u: Any, tau: Any, *parameters: Any, h: float,
                 steps: int | None = None, t: float = 0.0, every_step: bool = True,
                 out: Any = None, stream: int | None = None) -> Any:
        """Return the states after the steps; see `rollout`."""
        arguments = self._arguments
        size = self._layout.n_q + self._layout.n
        # A parameter for each name of the constructor, after q, u and tau.
        if len(parameters) != len(arguments) - 3:
            names = ', '.join(a.name for a in arguments[3:])
            raise InputError(f'rollout: {len(parameters)} parameters; expected '
                             f'{names or "none"}')
        h = positive_time(h, 'h')
        t = float(constant(t, (), 't (s)', InputError))
        call = KernelCall('rollout', [(a.name, a.shape) for a in arguments],
                          [q, u, tau, *parameters], self.dtype, stream)
        for argument, x in zip(arguments, call.views):
            require_shape(argument, x)
        # With one more axis than the states, tau has a row for each step.
        q_view, u_view, tau_view = call.views[:3]
        axes = max(q_view.ndim, u_view.ndim) - 1
        of_steps = tau_view.ndim == axes + 2
        # Batch axes of each argument; tau may have one more axis, that of the steps.
        batches = []
        for x in call.views:
            of_one_state = 2 if of_steps and x is tau_view else 1
            batches.append(x.shape[:x.ndim - of_one_state])
        batch = call.batch(batches)
        steps = self._steps(steps, tau_view.shape[-2] if of_steps else None)
        rows = (steps,) if every_step else ()
        with call.on_device():
            result_view, result = call.result(out, batch, (*rows, size))
            # In the order of the kernel's parameters; no steps are apart by 0 numbers.
            count = math.prod(batch)
            values = [c_int64(count), c_int64(steps)]
            for argument, x in zip(arguments, call.views):
                is_tau = x is tau_view
                values += array_layout(x, argument.shape, batch,
                                       steps=of_steps and is_tau)
                if is_tau and not of_steps:
                    values.append(c_int64(0))
            values += array_layout(result_view, (size,), batch, steps=every_step)
            if not every_step:
                values.append(c_int64(0))
            values += call.numbers([h, t, *self._robot.kernels.parameters])
            return call.run(self.ptx, values, count, result)

    def _steps(self, steps: Any, torques: int | None) -> int:
        """Return the number of steps: `steps`, or that of the torques if each step has one."""
        if steps is None:
            steps = torques
        if steps is None:
            raise InputError('steps: missing; expected their number, since tau has no '
                             'axis of steps')
        count = integer(steps, 'steps', 1, MOST_STEPS)
        if torques is not None and torques != count:
            raise InputError(f'steps: {count}; expected {torques}, the number of '
                             'torques in tau')
        return count


@hinting
def rollout(robot: Robot, *, parameters: str | Sequence[str] = (),
            dtype: str = 'float64', integrator: str = 'rk4') -> DeviceRollout:
    """
    Return the motion over many steps as a function of arrays on an NVIDIA GPU.

    It is called as ``motion(q, u, tau, *parameters, h=..., steps=...)``. One thread
    takes all steps of one state; the steps are those of `simulate` with torques that are
    held for a step. External wrenches are zero.

    - q, (..., n_q), and u, (..., n): states at the beginning.
    - tau: (..., steps, n), torques of each step, or (..., n), held over all steps.
    - the `parameters`, of each state, or one for all.
    - h: length of a step, s. steps: their number, where tau does not state it. t: time
      at the beginning, s, if the equations depend on it.
    - every_step: return the states after each step, (..., steps, n_q + n), else those
      after the last one, (..., n_q + n). Positions come first.
    - out, stream: as of `function`, and so are the arrays.

    From where a state is not finite, a position is too large, a step ends with loops
    that are open by more than ``robot.parameters.closure_tolerance``, before it closes
    them, or independent speeds are singular, its results are NaN; `simulate` raises
    errors, or continues with other speeds.

    Parameters
    ----------
    robot : Robot
        The function keeps a copy, with the present gravity and payload.
    parameters : sequence of str
        Run-time parameters that are arguments: 'gravity', (3,), 'payload', (10,).
    dtype : {'float64', 'float32'}
        Of all numbers, also inside of the kernel.
    integrator : str
        As of `simulate`.

    Raises
    ------
    InputError
        An unknown parameter, type or integrator; at a call, a wrong array, which is
        named.
    DeviceError
        At a call: there is no GPU or no driver, or it reports an error.

    """
    return DeviceRollout(robot, parameters, dtype, integrator)
