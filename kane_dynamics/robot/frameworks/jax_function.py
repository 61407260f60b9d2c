"""
A robot's quantities as functions of JAX arrays.

One JAX primitive evaluates every quantity and every derivative; its parameter is an
`Operation`. Its tangent is the primitive of the operation's Jacobian-vector product,
which is linear in the tangents; that is transposed to the vector-Jacobian product, and
back. So forward and reverse mode apply, to any order, and all derivatives are compiled
kernels.
"""

from collections.abc import Sequence
import logging
import math
from typing import Any

import jax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
import jax.numpy as jnp
from kane_dynamics.errors import CompileError, InputError
from kane_dynamics.robot.frameworks import xla_target
from kane_dynamics.robot.frameworks.batch_function import BatchFunction
from kane_dynamics.robot.frameworks.quantity_function import QuantityFunction
import numpy as np


evaluate = Primitive('kane_dynamics')


class JaxOperation:
    """
    A function that the primitive evaluates, with its derivatives.

    Attributes
    ----------
    function : BatchFunction
    compiled : bool
        XLA calls machine code; otherwise Python.
    of : Operation or None
        The operation whose derivative this is.

    """

    def __init__(self, function: BatchFunction, compiled: bool,
                 of: 'JaxOperation | None' = None) -> None:
        """Store the function."""
        self.function, self.compiled, self.of = function, compiled, of
        self._derived: dict[tuple[str, ...], JaxOperation] = {}

    def __repr__(self) -> str:
        """Return the name, which expressions of JAX show."""
        return self.function.name

    def derived(self, mode: str, by: Sequence[str]) -> 'JaxOperation':
        """Return the operation of a 'vjp' or 'jvp' with respect to some arguments."""
        key = (mode, *by)
        if key not in self._derived:
            function = getattr(self.function, mode)(by)
            # Another thread may have been faster: all use the first one.
            self._derived.setdefault(key, JaxOperation(function, self.compiled, self))
        return self._derived[key]


def _evaluated(*arrays: Any, operation: JaxOperation) -> Any:
    """Evaluate outside of a traced function, with all checks."""
    result = operation.function([np.asarray(x) for x in arrays])
    return jnp.asarray(result, dtype=arrays[0].dtype)


def _shaped(*arrays: Any, operation: JaxOperation) -> Any:
    """Return the shape of the result."""
    function = operation.function
    shape = (*function.batch([x.shape for x in arrays]), *function.shape)
    return jax.core.ShapedArray(shape, arrays[0].dtype)


def _lowered(*arrays: Any, operation: JaxOperation) -> Any:
    """Return the call of machine code, or of Python, in a compiled function."""
    function = operation.function
    batch = function.batch([x.shape for x in arrays])
    # One state for all, or one for each state of the batch.
    rows = []
    for argument, x in zip(function.arguments, arrays):
        leading = x.shape[:x.ndim - len(argument.shape)]
        if math.prod(leading) == 1:
            rows.append(jnp.reshape(x, argument.shape))
        else:
            rows.append(jnp.broadcast_to(x, (*batch, *argument.shape)))
    result = jax.ShapeDtypeStruct((*batch, *function.shape), arrays[0].dtype)
    # Machine code reads the present parameters from a block that is an operand.
    if operation.compiled:
        block = jnp.asarray(function.parameters.view(np.uint32))  # float64 may be off
        return jax.ffi.ffi_call(xla_target.registered(function), result)(*rows, block)

    def called(*values: Any) -> Any:
        results = function([np.asarray(x) for x in values], checked=False)
        return results.reshape(result.shape).astype(result.dtype)
    return jax.pure_callback(called, result, *rows)


def _refused(context: Any, *arrays: Any, operation: JaxOperation) -> Any:
    """Raise InputError for a function that is compiled for another device."""
    raise InputError(f'{operation}: compiled for {context.module_context.platforms}; '
                     'expected the CPU, where the kernels run: '
                     "jax.default_device(jax.devices('cpu')[0])")


def _rate(primals: Sequence[Any], tangents: Sequence[Any], *,
          operation: JaxOperation) -> Any:
    """Return the value and its tangent."""
    value = evaluate.bind(*primals, operation=operation)
    # Only tangents that are not zero by structure take part.
    names = []
    nonzero = []
    for argument, tangent in zip(operation.function.arguments, tangents):
        if not isinstance(tangent, ad.Zero):
            names.append(argument.name)
            nonzero.append(tangent)
    # J times the tangents is a kernel of its own, which JAX differentiates in turn.
    derived = operation.derived('jvp', names)
    return value, evaluate.bind(*nonzero, *primals, operation=derived)


def _transposed(cotangent: Any, *arrays: Any, operation: JaxOperation) -> Any:
    """Return the cotangents of the linear arguments of a 'jvp' or 'vjp'."""
    linear = [k for k, x in enumerate(arrays) if ad.is_undefined_primal(x)]
    cotangents: list[Any] = [None] * len(arrays)
    if isinstance(cotangent, ad.Zero):
        return cotangents
    function = operation.function
    of = operation.of
    assert of is not None  # a quantity itself is linear in nothing
    assert max(linear) < function.seeds
    state = arrays[function.seeds:]
    if function.derivative.mode == 'jvp':
        # Linear in the tangents: J v is transposed to J^T w.
        names = [function.derivative.by[k] for k in linear]
        gradient = of.derived('vjp', names)
        flat = evaluate.bind(cotangent, *state, operation=gradient)
        parts = gradient.function.parts(flat)
    else:
        # Linear in the cotangent: J^T w is transposed to J v.
        rate = of.derived('jvp', function.derivative.by)
        parts = [evaluate.bind(*function.parts(cotangent), *state, operation=rate)]
    for k, part in zip(linear, parts, strict=True):
        cotangents[k] = _summed(part, arrays[k].aval.shape)
    return cotangents


def _summed(x: Any, shape: tuple[int, ...]) -> Any:
    """Return an array summed over the axes by which a shape was broadcast."""
    x = jnp.sum(x, axis=tuple(range(x.ndim - len(shape))))
    axes = tuple(k for k, size in enumerate(shape) if size == 1 != x.shape[k])
    return jnp.sum(x, axis=axes, keepdims=True)


def _mapped(arrays: Sequence[Any], axes: Sequence[Any], *,
            operation: JaxOperation) -> Any:
    """Evaluate with a further batch axis, which becomes the first axis."""
    ranks = []  # numbers of batch axes, without the further one
    for argument, x, axis in zip(operation.function.arguments, arrays, axes):
        ranks.append(x.ndim - len(argument.shape) - (axis is not None))
    values = []
    for x, rank, axis in zip(arrays, ranks, axes):
        if axis is not None:
            # The further axis first; then axes that the batches of other arguments have.
            missing_axes = tuple(range(1, 1 + max(ranks) - rank))
            x = jnp.expand_dims(jnp.moveaxis(x, axis, 0), missing_axes)
        values.append(x)
    return evaluate.bind(*values, operation=operation), 0


evaluate.def_impl(_evaluated)
evaluate.def_abstract_eval(_shaped)
ad.primitive_jvps[evaluate] = _rate
ad.primitive_transposes[evaluate] = _transposed
batching.primitive_batchers[evaluate] = _mapped
mlir.register_lowering(evaluate, _refused)
mlir.register_lowering(evaluate, mlir.lower_fun(_lowered, multiple_results=False),
                       platform='cpu')


class JaxFunction(QuantityFunction):
    """A quantity as a function of JAX arrays; see `Robot.jax`."""

    def __init__(self, robot: Any, quantity: str, at: str,
                 parameters: str | Sequence[str],
                 compiled: bool | None) -> None:
        """Check the names; the kernel compiles at the first call."""
        super().__init__(robot, quantity, at, parameters)
        self._made_of = (*self._made_of, compiled)
        # By default, Python is called where this JAX lacks the interface for machine
        # code.
        if compiled is None:
            try:
                xla_target.require_interface()
            except CompileError as error:
                logging.getLogger(__name__).warning(
                    'robot.jax: %s; compiled functions call Python for %s, which is '
                    'slower',
                    error, quantity)
                compiled = False
        elif compiled:
            xla_target.require_interface()
        self.compiled = compiled is not False
        self._operation = JaxOperation(self.function, self.compiled)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Return the quantity, by position or by name; see `Robot.jax`."""
        values = self._given(arguments, named)
        arrays = [readable(name, x) for name, x in zip(self.names, values)]
        self._require_batches(arrays, np.broadcast_shapes)
        dtype = jnp.result_type(*arrays)
        return evaluate.bind(*(x.astype(dtype) for x in arrays),
                             operation=self._operation)


def readable(name: str, x: Any) -> Any:
    """Return an array that the kernels can read; raise InputError otherwise."""
    try:
        array = jnp.asarray(x)
    except (TypeError, ValueError):
        raise InputError(f'{name}: a {type(x).__name__}; expected an array') from None
    if array.dtype not in (np.float64, np.float32):
        raise InputError(f'{name}: dtype {array.dtype}; expected float32 or float64')
    return array
