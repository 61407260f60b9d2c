"""
A robot's quantities as functions of JAX arrays; the only module that imports jax.

One JAX primitive evaluates every quantity and every derivative; its parameter is an `Operation`.
Its tangent is the primitive of the operation's Jacobian-vector product, which is linear in the
tangents; that is transposed to the vector-Jacobian product, and back. So forward and reverse mode
apply, to any order, and all derivatives are compiled kernels.
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
        found = self._derived.get((mode, *by))
        return found or self._derived.setdefault((mode, *by), JaxOperation(
            getattr(self.function, mode)(by), self.compiled, self))


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
    rows = [jnp.reshape(x, a.shape) if math.prod(own) == 1 else
            jnp.broadcast_to(x, (*batch, *a.shape))
            for a, x in zip(function.arguments, arrays)
            for own in [x.shape[:x.ndim - len(a.shape)]]]
    result = jax.ShapeDtypeStruct((*batch, *function.shape), arrays[0].dtype)
    if operation.compiled:
        block = jnp.asarray(function.parameters.view(np.uint32))  # float64 may be switched off
        return jax.ffi.ffi_call(xla_target.registered(function), result)(*rows, block)

    def called(*given: Any) -> Any:
        found = function([np.asarray(x) for x in given], checked=False)
        return found.reshape(result.shape).astype(result.dtype)
    return jax.pure_callback(called, result, *rows)


def _refused(context: Any, *arrays: Any, operation: JaxOperation) -> Any:
    """Raise InputError for a function that is compiled for another device."""
    raise InputError(f'{operation}: compiled for {context.module_context.platforms}; expected '
                     "the CPU, where the kernels run: jax.default_device(jax.devices('cpu')[0])")


def _rate(primals: Sequence[Any], tangents: Sequence[Any], *, operation: JaxOperation) -> Any:
    """Return the value and its tangent."""
    value = evaluate.bind(*primals, operation=operation)
    moving = [k for k, x in enumerate(tangents) if not isinstance(x, ad.Zero)]
    names = [operation.function.arguments[k].name for k in moving]
    return value, evaluate.bind(*(tangents[k] for k in moving), *primals,
                                operation=operation.derived('jvp', names))


def _transposed(cotangent: Any, *arrays: Any, operation: JaxOperation) -> Any:
    """Return the cotangents of the tangents of a 'jvp', or of the cotangent of a 'vjp'."""
    wanted = [k for k, x in enumerate(arrays) if ad.is_undefined_primal(x)]
    found: list[Any] = [None] * len(arrays)
    if isinstance(cotangent, ad.Zero):
        return found
    function, of = operation.function, operation.of
    assert of is not None  # a quantity itself is linear in nothing
    assert max(wanted) < function.seeds
    state = arrays[function.seeds:]
    if function.derivative.mode == 'jvp':
        names = [function.derivative.by[k] for k in wanted]
        gradient = of.derived('vjp', names)
        parts = gradient.function.parts(evaluate.bind(cotangent, *state, operation=gradient))
    else:
        rate = of.derived('jvp', function.derivative.by)
        parts = [evaluate.bind(*function.parts(cotangent), *state, operation=rate)]
    for k, part in zip(wanted, parts, strict=True):
        found[k] = _summed(part, arrays[k].aval.shape)
    return found


def _summed(x: Any, shape: tuple[int, ...]) -> Any:
    """Return an array summed over the axes by which a shape was broadcast."""
    x = jnp.sum(x, axis=tuple(range(x.ndim - len(shape))))
    axes = tuple(k for k, size in enumerate(shape) if size == 1 != x.shape[k])
    return jnp.sum(x, axis=axes, keepdims=True)


def _mapped(arrays: Sequence[Any], axes: Sequence[Any], *, operation: JaxOperation) -> Any:
    """Evaluate for a further batch axis, as the first one."""
    ranks = [x.ndim - len(a.shape) - (axis is not None)
             for a, x, axis in zip(operation.function.arguments, arrays, axes)]
    given = [x if axis is None else jnp.expand_dims(
        jnp.moveaxis(x, axis, 0), tuple(range(1, 1 + max(ranks) - rank)))
        for x, rank, axis in zip(arrays, ranks, axes)]
    return evaluate.bind(*given, operation=operation), 0


evaluate.def_impl(_evaluated)
evaluate.def_abstract_eval(_shaped)
ad.primitive_jvps[evaluate] = _rate
ad.primitive_transposes[evaluate] = _transposed
batching.primitive_batchers[evaluate] = _mapped
mlir.register_lowering(evaluate, _refused)
mlir.register_lowering(evaluate, mlir.lower_fun(_lowered, multiple_results=False), platform='cpu')


class JaxFunction(QuantityFunction):
    """A quantity as a function of JAX arrays; see `Robot.jax`."""

    def __init__(self, robot: Any, quantity: str, at: str, parameters: str | Sequence[str],
                 compiled: bool | None) -> None:
        """Check the names; the kernel compiles at the first call."""
        super().__init__(robot, quantity, at, parameters)
        self._made_of = (*self._made_of, compiled)
        if compiled is None:
            try:
                xla_target.require_interface()
            except CompileError as error:
                logging.getLogger(__name__).warning(
                    'robot.jax: %s; compiled functions call Python for %s, which is slower',
                    error, quantity)
                compiled = False
        elif compiled:
            xla_target.require_interface()
        self.compiled = compiled is not False
        self._operation = JaxOperation(self.function, self.compiled)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Return the quantity, by position or by name; see `Robot.jax`."""
        arrays = [_readable(name, x) for name, x in zip(
            self.names, self._given(arguments, named))]
        self._require_batches(arrays, np.broadcast_shapes)
        dtype = jnp.result_type(*arrays)
        return evaluate.bind(*(x.astype(dtype) for x in arrays), operation=self._operation)


def _readable(name: str, x: Any) -> Any:
    """Return an array that the kernels can read; raise InputError otherwise."""
    try:
        array = jnp.asarray(x)
    except (TypeError, ValueError):
        raise InputError(f'{name}: a {type(x).__name__}; expected an array') from None
    if array.dtype not in (np.float64, np.float32):
        raise InputError(f'{name}: dtype {array.dtype}; expected float32 or float64')
    return array
