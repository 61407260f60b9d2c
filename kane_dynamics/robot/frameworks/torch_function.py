"""
A robot's quantities as functions of PyTorch tensors; the only module that imports torch.

A custom operator, one for each number of tensors, evaluates every quantity and every
derivative. Its first argument names an `Operation`; its backward pass evaluates the
vector-Jacobian product of that operation. So derivatives of any order are compiled
kernels, and `torch.compile` sees a single opaque operator. (An operator of a list of
tensors would do, but `is_grads_batched` of `torch.autograd.grad` refuses it.)
"""

from collections.abc import Sequence
from typing import Any
from uuid import uuid4
from weakref import WeakValueDictionary

from kane_dynamics.errors import InputError
from kane_dynamics.robot.frameworks.batch_function import BatchFunction, MOST
from kane_dynamics.robot.frameworks.quantity_function import QuantityFunction
import torch

DTYPES = (torch.float64, torch.float32)
STEP = ' -> '  # in a handle, before each derivative
_operations: 'WeakValueDictionary[str, TorchOperation]' = WeakValueDictionary()


class TorchOperation:
    """
    A function that the operator evaluates, with its derivatives.

    Attributes
    ----------
    handle : str
        Name of the operation. That of a function is its own in all processes, since
        `torch.compile` keeps graphs with handles on disk. That of a derivative says how
        it follows from the function, for a graph that is found there before the
        derivative exists.

    """

    def __init__(self, function: BatchFunction, handle: str = '') -> None:
        """Register the function."""
        self.function = function
        self.handle = handle or f'{function.name} {uuid4().hex}'
        self._derived: dict[tuple[str, ...], TorchOperation] = {}
        _operations[self.handle] = self

    def vjp(self, *by: str) -> 'TorchOperation':
        """Return the operation of the gradients with respect to some arguments."""
        return self._of('vjp', *by)

    def jvp(self, *by: str) -> 'TorchOperation':
        """Return the operation from tangents of arguments to that of the result."""
        return self._of('jvp', *by)

    def _of(self, mode: str, *by: str) -> 'TorchOperation':
        key = (mode, *by)
        if key not in self._derived:
            function = getattr(self.function, mode)(by)
            handle = f'{self.handle}{STEP}{mode} {" ".join(by)}'
            # Another thread may have been faster: all use the first one.
            self._derived.setdefault(key, TorchOperation(function, handle))
        return self._derived[key]


def _operation_of(handle: str) -> TorchOperation:
    """Return an operation by its handle."""
    operation = _operations.get(handle)
    # A handle names its operation and the derivatives that lead to it, step by step.
    if operation is None:
        root, _, derivative = handle.rpartition(STEP)
        mode, *by = derivative.split(' ')
        if root and mode in ('vjp', 'jvp'):
            derived: TorchOperation = getattr(_operation_of(root), mode)(*by)
            return derived
        raise InputError(f"function: '{handle}'; expected one that robot.torch returned "
                         'in this process and that still exists')
    return operation


def _evaluated(handle: str, *tensors: Any) -> Any:
    """Evaluate an operation; float64 tensors are read where they are."""
    arrays = [x.detach().resolve_neg().numpy() for x in tensors]
    result = _operation_of(handle).function(arrays)
    return torch.from_numpy(result).to(tensors[0].dtype)


def _shaped(handle: str, *tensors: Any) -> Any:
    """Return an empty tensor like the result."""
    function = _operation_of(handle).function
    batches = []
    for argument, x in zip(function.arguments, tensors):
        batches.append(x.shape[:x.ndim - len(argument.shape)])
    batch = torch.broadcast_shapes(*batches)
    return tensors[0].new_empty((*batch, *function.shape))


def _keep(ctx: Any, inputs: Any, output: Any) -> None:
    """Keep what the backward pass needs."""
    handle, *tensors = inputs
    ctx.operation = _operation_of(handle)
    ctx.set_materialize_grads(False)  # zeros would be computed with
    ctx.save_for_backward(*tensors)
    ctx.save_for_forward(*tensors)


def _backward(ctx: Any, cotangent: Any) -> Any:
    """Return the gradients of the tensors that require them, by one kernel."""
    tensors = ctx.saved_tensors
    arguments = ctx.operation.function.arguments
    # One gradient for each tensor; PyTorch expects None for those that need none.
    required = [k for k, needed in enumerate(ctx.needs_input_grad[1:]) if needed]
    gradients: list[Any] = [None] * len(tensors)
    if cotangent is None or not required:
        return None, *gradients
    operation = ctx.operation.vjp(*(arguments[k].name for k in required))
    flat = evaluate(operation.handle, cotangent, *tensors)
    for k, part in zip(required, operation.function.parts(flat), strict=True):
        gradients[k] = part.sum_to_size(tensors[k].shape)  # over broadcast axes
    return None, *gradients


def _rate(ctx: Any, _: Any, *tangents: Any) -> Any:
    """Return the tangent of the result, by one kernel."""
    by_name = {}
    for argument, tangent in zip(ctx.operation.function.arguments, tangents):
        if tangent is not None:
            by_name[argument.name] = tangent
    operation = ctx.operation.jvp(*by_name)
    return evaluate(operation.handle, *by_name.values(), *ctx.saved_tensors)


def _mapped(info: Any, in_dims: Any, handle: str, *tensors: Any) -> Any:
    """Evaluate an operation with a further batch axis, which becomes the first axis."""
    axes = in_dims[1:]
    ranks = []  # numbers of batch axes, without the further one
    for argument, x, axis in zip(_operation_of(handle).function.arguments, tensors,
                                 axes):
        ranks.append(x.ndim - len(argument.shape) - (axis is not None))
    values = []
    for x, rank, axis in zip(tensors, ranks, axes):
        if axis is not None:
            # The further axis first; then axes that the batches of other arguments have.
            missing_axes = [None] * (max(ranks) - rank)
            x = x.movedim(axis, 0)[(slice(None), *missing_axes)]
        values.append(x)
    return evaluate(handle, *values), 0


def _operator(count: int) -> Any:
    """Return the registered operator of a number of tensors."""
    # The schema needs a fixed number of tensors: one operator for each number.
    names = ', '.join(f'Tensor x{k}' for k in range(count))
    operator: Any = torch.library.custom_op(
        f'kane_dynamics::evaluate_{count}', _evaluated, mutates_args=(),
        schema=f'(str function, {names}) -> Tensor')
    # Shapes for tracing, gradients, and `vmap`, each by functions of the handle.
    operator.register_fake(_shaped)
    operator.register_autograd(_backward, setup_context=_keep)
    operator.register_vmap(_mapped)
    return operator


OPERATORS = {count: _operator(count) for count in range(1, MOST + 1)}


class Evaluation(torch.autograd.Function):
    """The operator with its derivatives, as transforms of `torch.func` require it."""

    setup_context = staticmethod(_keep)
    backward = staticmethod(_backward)
    jvp = staticmethod(_rate)
    vmap = staticmethod(_mapped)

    @staticmethod
    def forward(handle: str, *tensors: Any) -> Any:
        """Evaluate the operation."""
        return OPERATORS[len(tensors)](handle, *tensors)


def evaluate(handle: str, *tensors: Any) -> Any:
    """Return the result of an operation, with its derivatives."""
    if torch.compiler.is_compiling():  # the graph holds the operator, differentiable
        return OPERATORS[len(tensors)](handle, *tensors)
    return Evaluation.apply(handle, *tensors)


class TorchFunction(QuantityFunction):
    """A quantity as a function of tensors; see `Robot.torch`."""

    def __init__(self, robot: Any, quantity: str, at: str,
                 parameters: str | Sequence[str]) -> None:
        """Check the names; the kernel compiles at the first call."""
        super().__init__(robot, quantity, at, parameters)
        self._operation = TorchOperation(self.function)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Return the quantity, by position or by name; see `Robot.torch`."""
        tensors = self._given(arguments, named)
        dtype = torch.float32
        for argument, x in zip(self.function.arguments, tensors):
            _require_readable(argument.name, x)
            dtype = torch.promote_types(dtype, x.dtype)
        self._require_batches(tensors, torch.broadcast_shapes)
        return evaluate(self._operation.handle, *(x.to(dtype) for x in tensors))


def _require_readable(name: str, x: Any) -> None:
    """Raise InputError unless the kernels can read a tensor."""
    # Machine code reads plain numbers in the memory of this process.
    if not isinstance(x, torch.Tensor):
        raise InputError(f'{name}: a {type(x).__name__}; expected a torch.Tensor')
    if x.device.type != 'cpu':
        raise InputError(f'{name}: a tensor on {x.device}; expected one on the CPU, '
                         'where the kernels run: x.cpu(), and result.to(x.device)')
    if x.dtype not in DTYPES or x.layout != torch.strided:
        raise InputError(f'{name}: {x.dtype}, {x.layout}; expected a dense tensor of '
                         'float64 or float32')
