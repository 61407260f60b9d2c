"""
A robot's quantities as operations of JAX, for any device that XLA compiles for.

The traced program of a quantity is evaluated on JAX arrays, one operation a node. XLA
compiles the operations, and JAX differentiates them; no kernel of this library runs.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
from kane_dynamics.native.tracing.expression import Expr
from kane_dynamics.native.tracing.program import OPERATORS, Program
from kane_dynamics.robot.frameworks.jax_function import readable
from kane_dynamics.robot.frameworks.quantity_function import QuantityFunction
import numpy as np

OPERATIONS: dict[str, Callable[..., Any]] = {
    **OPERATORS, 'less': lambda a, b: a < b, 'select': jnp.where}


def outputs(program: Program, entries: dict[tuple[str, int], Any]) -> list[Any]:
    """
    Evaluate a program on JAX arrays, or numbers, by the name and place of an input.

    Returns
    -------
    list
        An array, or a constant number, for each entry of the result.

    """
    values: dict[int, Any] = {}

    def value_of(x: Any) -> Any:
        return values[x.index] if isinstance(x, Expr) else x

    # Operands are evaluated before the nodes that use them.
    for node in program.schedule():
        if node.op == 'input':
            values[node.index] = entries[node.args]
        elif node.op == 'call':
            values[node.index] = _called(node.args[0], map(value_of, node.args[1:]))
        elif node.op == 'output':
            results, k = node.args
            values[node.index] = values[results.index][k]
        else:
            operation = OPERATIONS.get(node.op) or getattr(jnp, node.op)
            values[node.index] = operation(*map(value_of, node.args))
    return [value_of(x) for x in program.outputs]


def _called(program: Program, arguments: Any) -> list[Any]:
    """Evaluate a subroutine, whose arguments are the entries of its inputs in order."""
    places = []
    for name, shape in program.inputs:
        places += [(name, k) for k in range(int(np.prod(shape)))]
    return outputs(program, dict(zip(places, arguments, strict=True)))


class JaxOperations(QuantityFunction):
    """A quantity as operations of JAX; see `Robot.jax`."""

    def __init__(self, robot: Any, quantity: str, at: str,
                 parameters: str | Sequence[str]) -> None:
        """Check the names; the program is traced at the first call."""
        super().__init__(robot, quantity, at, parameters)
        self._compiled = jax.jit(self._evaluated)

    @cached_property
    def _program(self) -> Program:
        robot, quantity, at, _ = self._made_of
        program: Program = robot.kernels.program(quantity, at, self.function.derivative)
        return program

    def _evaluated(self, *arrays: Any) -> tuple[Any, ...]:
        """Return each entry of the result, with the batch axes of the arguments."""
        function = self.function
        batch = function.batch([x.shape for x in arrays])
        entries: dict[tuple[str, int], Any] = {}
        for argument, x in zip(function.arguments, arrays):
            leading = x.shape[:x.ndim - len(argument.shape)]
            flat = jnp.reshape(x, (*leading, -1))
            for k in range(flat.shape[-1]):
                entries[argument.name, k] = flat[..., k]
        # The present parameters, such as gravity, are constants.
        for k, number in enumerate(function.parameters.tolist()):
            entries['parameters', k] = number
        dtype = jnp.result_type(*arrays)
        results = outputs(self._program, entries)
        return tuple(jnp.broadcast_to(jnp.asarray(x, dtype), batch) for x in results)

    def entries(self, *arguments: Any, **named: Any) -> tuple[Any, ...]:
        """
        Return the entries of the result, in C order, as arrays of their own.

        Functions compiled by `jax.jit` use them: XLA evaluates the program again for each
        entry of an array in which entries are stacked before the function returns.
        """
        values = self._given(arguments, named)
        arrays = [readable(name, x) for name, x in zip(self.names, values)]
        self._require_batches(arrays, np.broadcast_shapes)
        dtype = jnp.result_type(*arrays)
        results: tuple[Any, ...] = self._compiled(*(x.astype(dtype) for x in arrays))
        return results

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Return the quantity, by position or by name; see `Robot.jax`."""
        entries = self.entries(*arguments, **named)
        return jnp.stack(entries, axis=-1).reshape((*entries[0].shape,
                                                    *self.function.shape))
