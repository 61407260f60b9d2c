"""A robot's quantity, or a derivative of any order, as a function of arrays."""

from collections.abc import Sequence
import math
import sys
from typing import Any

from kane_dynamics._util import disk_cache
from kane_dynamics._util.fork_safety import ForkSafeLock
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.native.backends.llvm_math import size_limit
from kane_dynamics.native.backends.llvm_simd import lane_text, width
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.runtime.kernel import Argument, Kernel, require_finite
from kane_dynamics.native.runtime.loops import BAD_INPUT, POINTER_SLOTS
from kane_dynamics.native.tracing.program import Shape
from kane_dynamics.robot.derivative_kernels import Derivative, PARAMETERS
from kane_dynamics.robot.kernel_set import KernelSet
import numpy as np

MOST = POINTER_SLOTS - 2  # arguments of a kernel, besides its parameters and result


def batch_function(robot: Any, quantity: str, at: str,
                   parameters: str | Sequence[str]) -> 'BatchFunction':
    """
    Return the function of a quantity with these run-time parameters as arguments.

    The parameters of the robot must not change while it is in use.
    """
    # Only what the quantity depends on, each once.
    differentiable = robot.kernels.differentiable(quantity)
    possible = [name for name in PARAMETERS if name in differentiable]
    possible += robot.kernels.constants(quantity)
    names = (parameters,) if isinstance(parameters, str) else tuple(parameters)
    for k, name in enumerate(names):
        if name not in possible or name in names[:k]:
            valid = ', '.join(possible) or 'none'
            raise InputError(f'parameters: {name!r}; expected for {quantity} of this '
                             f'robot some of {valid}, each once')
    return BatchFunction(robot.kernels, quantity, at,
                         Derivative('value', run_time=names))


class BatchFunction:
    """
    A quantity or a derivative of it as a function of arrays with batch axes in front.

    Batch axes broadcast, as in NumPy. The derivatives are functions of the same kind, to
    any order; each compiles at its first call.

    Parameters
    ----------
    kernels : KernelSet
        The kernels of a robot whose parameters do not change.
    quantity, at : str
        A quantity, and its frame or joint or ''.
    derivative : Derivative

    Attributes
    ----------
    arguments : tuple of Argument
        In order: the cotangent or the tangents, if it is a derivative, then the
        arguments of the quantity, the wrench, the time, and the parameters that are
        arguments.
    shape : tuple of int
        Shape of the result of one state. Gradients of a 'vjp' are one after the other.

    """

    def __init__(self, kernels: KernelSet, quantity: str, at: str,
                 derivative: Derivative) -> None:
        """Look the names up; compile nothing."""
        self._kernels = kernels
        self._quantity = quantity
        self._at = at
        self.derivative = derivative
        self.arguments, self.shape = kernels.signature(quantity, at, derivative)
        self._result = Argument('', self.shape)
        # The cotangent or tangents of the last order come before all other arguments.
        self.seeds = 0
        if derivative.of is not None:
            inner_arguments, _ = kernels.signature(quantity, at, derivative.of)
            if inner_arguments:
                self.seeds = len(self.arguments) - len(inner_arguments)
        # Every order of differentiation adds arguments.
        if len(self.arguments) > MOST:
            raise InputError(f'{quantity}: a derivative with {len(self.arguments)} '
                             'arguments, cotangents and tangents; expected at most '
                             f'{MOST}: a lower order, or fewer arguments to '
                             'differentiate by')
        self.name = derivative.label(f'{quantity}:{at}' if at else quantity)
        self._derivatives: dict[Derivative, BatchFunction] = {}
        self._lock = ForkSafeLock()

    def __repr__(self) -> str:
        """Return the name with its arguments."""
        return f'{self.name} ({", ".join(a.name for a in self.arguments)})'

    def vjp(self, by: Sequence[str]) -> 'BatchFunction':
        """Return the gradients with respect to some arguments, for a given cotangent."""
        return self._derived(Derivative('vjp', tuple(by), self.derivative))

    def jvp(self, by: Sequence[str]) -> 'BatchFunction':
        """Return the directional derivative, for given tangents of some arguments."""
        return self._derived(Derivative('jvp', tuple(by), self.derivative))

    def of(self) -> 'BatchFunction':
        """Return the function of which this is a derivative."""
        assert self.derivative.of is not None
        return BatchFunction(self._kernels, self._quantity, self._at, self.derivative.of)

    def _derived(self, derivative: Derivative) -> 'BatchFunction':
        with self._lock.held():
            function = self._derivatives.get(derivative)
            if function is None:
                function = BatchFunction(self._kernels, self._quantity, self._at,
                                         derivative)
                self._derivatives[derivative] = function
            return function

    @property
    def kernel(self) -> Kernel:
        """Return the kernel, compiled at the first use."""
        with self._lock.held():
            return self._kernels.kernel(self._quantity, self._at, self.derivative)

    def batch(self, shapes: Sequence[Shape]) -> Shape:
        """Return the batch axes of the result for arguments of these shapes."""
        batches = []
        for argument, shape in zip(self.arguments, shapes):
            batches.append(shape[:len(shape) - len(argument.shape)])
        return np.broadcast_shapes(*batches)

    def parts(self, flat: Any) -> list[Any]:
        """Return the gradients of a 'vjp', split by input, with the inputs' shapes."""
        shapes = {argument.name: argument.shape for argument in self.arguments}
        gradients = []
        begin = 0
        for name in self.derivative.by:
            # The gradients lie one after the other, in the order of the inputs.
            end = begin + math.prod(shapes[name])
            gradient = flat[..., begin:end]
            gradients.append(gradient.reshape((*flat.shape[:-1], *shapes[name])))
            begin = end
        return gradients

    @property
    def identity(self) -> str:
        """Return a text that identifies the machine code, parameters aside."""
        kernels, kernel = self._kernels, self.kernel
        code = kernels.key or lane_text(kernel.traced(), 'kernel', width())
        return disk_cache.key('code', self.name, code, llvm.fingerprint())

    @property
    def parameters(self) -> Array:
        """Return the block of parameters, which the kernel reads after the arguments."""
        return self._kernels.parameters

    def __call__(self, arrays: Sequence[Array], *, checked: bool = True) -> Array:
        """
        Return the results for float arrays of the arguments' shapes and batch axes.

        Unless `checked`, a state with an argument or a result that is not finite has NaN
        in all of its result.

        Raises
        ------
        InputError
            An argument that is not finite, other than cotangents and tangents; it is
            named. Or the result is not finite though they are; as the robot's method.

        """
        batch = self.batch([x.shape for x in arrays])
        count = math.prod(batch)
        # Arguments without a batch axis are shared by all states.
        rows = [row(a, x, batch) for a, x in zip(self.arguments, arrays, strict=True)]
        result = np.empty((count, *self.shape))
        if count:
            kernel = self.kernel
            flags = kernel.run(rows, result, count)
            if flags and checked:
                self._explain(kernel, flags, arrays, rows, result)
            # Unchecked calls mark the results that are not valid.
            elif flags:
                for argument, x in zip(self.arguments, rows):
                    result[beyond(argument, x)] = np.nan
                result[beyond(self._result, result)] = np.nan
        return result.reshape((*batch, *self.shape))

    def _explain(self, kernel: Kernel, flags: int, arrays: Sequence[Array],
                 rows: Sequence[Array], result: Array) -> None:
        """Raise InputError for numbers that are not finite other than by seeds."""
        differentiable = self._kernels.inputs(self._quantity)
        # Rows with numbers that are not finite; those of seeds are the caller's choice.
        bad = beyond(self._result, result)
        for argument, array, x in zip(self.arguments, arrays, rows):
            if argument.name not in differentiable:  # a cotangent or tangent
                bad &= ~beyond(argument, x)
            elif flags & BAD_INPUT:
                require_finite(argument, array)
        if bad.any():
            kernel.answer(result, rows, len(result), np.flatnonzero(bad).tolist())


def beyond(argument: Argument, array: Array) -> Any:
    """Return for each state, or for all, whether an entry is not finite or too large."""
    limit = min(size_limit(argument.name), sys.float_info.max)
    axes_of_state = tuple(range(array.ndim - len(argument.shape), array.ndim))
    return ~(np.abs(array) <= limit).all(axis=axes_of_state)


def row(argument: Argument, array: Array, batch: Shape) -> Array:
    """Return an argument for kernels: of one state for all, or with a row for each."""
    leading = array.shape[:array.ndim - len(argument.shape)]
    # One state for the whole batch stays one row.
    if math.prod(leading) == 1:
        # `ascontiguousarray` would make a row of a number, of which each state reads its own.
        return np.asarray(array.reshape(argument.shape), dtype=np.float64, order='C')
    if leading != batch:
        array = np.broadcast_to(array, (*batch, *argument.shape))
    array = np.ascontiguousarray(array, dtype=np.float64)
    return array.reshape(math.prod(batch), *argument.shape)
