"""A robot's quantity as a function of arrays in the memory of a GPU."""

from collections.abc import Sequence
from ctypes import c_int64
import math
from typing import Any

from kane_dynamics._util.attribute_hints import hinting
from kane_dynamics.gpu.kernel_call import (array_layout, KernelCall, ptx_text, REALS,
                                           require_dtype)
from kane_dynamics.native.backends.gpu_kernel import kernel_text
from kane_dynamics.robot.derivative_kernels import Derivative
from kane_dynamics.robot.frameworks.quantity_function import (QuantityFunction,
                                                              require_shape)
from kane_dynamics.robot.methods.dynamics_methods import place_of
from kane_dynamics.robot.robot import Robot


@hinting
class DeviceFunction(QuantityFunction):
    """A quantity as a function of arrays of a GPU; see `function`."""

    def __init__(self, robot: Robot, quantity: str, at: str,
                 parameters: str | Sequence[str], dtype: str) -> None:
        """Check the names; the kernel is made at the first use."""
        super().__init__(robot, quantity, at, parameters)
        self.dtype = require_dtype(dtype)
        self._made_of = (*self._made_of, dtype)
        self._ptx: str | None = None

    @property
    def ptx(self) -> str:
        """Return the kernel in PTX, the assembly language that the driver compiles."""
        if self._ptx is None:
            robot, quantity, at, parameters, _ = self._made_of
            names = (parameters,) if isinstance(parameters, str) else tuple(parameters)
            value = Derivative('value', run_time=names)

            def text() -> str:
                program = robot.kernels.program(quantity, at, value)
                return kernel_text(program, REALS[self.dtype])
            self._ptx = ptx_text(f'{quantity}:{at} {names}', robot.kernels.key,
                                 self.dtype, text)
        return self._ptx

    def __call__(self, *arguments: Any, out: Any = None, stream: int | None = None,
                 **named: Any) -> Any:
        """Return the quantity, by position or by name; see `function`."""
        function = self.function
        arrays = self._given(arguments, named)
        shapes = [(a.name, a.shape) for a in function.arguments]
        call = KernelCall(function.name, shapes, arrays, self.dtype, stream)
        # The batch is what stands before the shape of each argument.
        for argument, x in zip(function.arguments, call.views):
            require_shape(argument, x)
        batches = []
        for argument, x in zip(function.arguments, call.views):
            batches.append(x.shape[:x.ndim - len(argument.shape)])
        batch = call.batch(batches)
        with call.on_device():
            result_view, result = call.result(out, batch, function.shape)
            count = math.prod(batch)
            # The number of states, then the place and the strides of each array, then
            # the parameters.
            values = [c_int64(count)]
            for argument, x in zip(function.arguments, call.views):
                values += array_layout(x, argument.shape, batch)
            values += array_layout(result_view, function.shape, batch)
            values += call.numbers(function.parameters)
            return call.run(self.ptx, values, count, result)


@hinting
def function(robot: Robot, name: str, *, parameters: str | Sequence[str] = (),
             dtype: str = 'float64') -> DeviceFunction:
    """
    Return a quantity as a function of arrays in the memory of an NVIDIA GPU.

    Its arguments are those of the quantity's method, in its order or by their names;
    then 'wrench', (k, 6), if the robot declares wrench frames and the quantity depends
    on them, and 't' if the equations depend on time; then the `parameters`. Each has the
    same batch axes in front, or is one state for all.

    Arrays are of PyTorch, CuPy, JAX or any library with `__cuda_array_interface__` or
    DLPack, all of one device and of `dtype`, and are read where they are. Accesses
    coalesce where neighboring states are neighbors in memory, as in ``torch.empty(n,
    N).T``; the result is then alike. Any other strides will do if states, and entries,
    are at equal distances.

    Where a state has an argument that is not finite or a position that is too large, or
    where the robot's method raises an error that depends on the state, its result is
    NaN.

    Parameters
    ----------
    robot : Robot
        The function keeps a copy, with the present gravity and payload.
    name : str
        A quantity, as in `Robot.vjp`: ``'inverse_dynamics'``, ``'frame_pose:<frame>'``.
    parameters : sequence of str
        Run-time parameters that are arguments: 'gravity', (3,), 'payload', (10,), as in
        `Robot.vjp`; of each state, or one for all.
    dtype : {'float64', 'float32'}
        Of all numbers, also inside of the kernel.

    Returns
    -------
    DeviceFunction
        Called with arrays. ``out=`` is an array for the result; by default it is a new
        one of PyTorch, CuPy or JAX, or else a `DeviceMemory`. ``stream=`` is the handle
        of a CUDA stream, by default the current one of PyTorch or CuPy, on which the
        call does not wait; with other libraries, and with a new `DeviceMemory`, the call
        returns when the result is there. ``ptx`` is the kernel as text.

    Raises
    ------
    InputError
        An unknown quantity, frame, joint, parameter or type; at a call, a wrong array,
        which is named.
    DeviceError
        At a call: there is no GPU or no driver, or it reports an error.

    """
    quantity, at = place_of(name)
    return DeviceFunction(robot, quantity, at, parameters, dtype)
