"""CasADi functions of a robot's quantities, from the traced programs."""

from collections.abc import Sequence
import math
import re
from typing import Any

from kane_dynamics._util.optional_imports import extra
from kane_dynamics.errors import InputError
from kane_dynamics.native.tracing.expression import Expr
from kane_dynamics.native.tracing.program import OPERATORS, Program, Shape
from kane_dynamics.robot.derivative_kernels import PARAMETERS

# The operations whose names differ from CasADi's.
CASADI = {'arctan': 'atan', 'less': 'lt', 'select': 'if_else'}


def casadi_function(robot: Any, quantity: str, at: str, parameters: Sequence[str]) -> Any:
    """Return a graph of SX expressions, a casadi.Function; see `Robot.casadi`."""
    casadi = extra('casadi', 'casadi', 'robot.casadi')
    kernels = robot.kernels
    # Parameters by which it can be differentiated may be arguments.
    differentiable = kernels.differentiable(quantity)
    possible = [name for name in PARAMETERS if name in differentiable]
    names = [parameters] if isinstance(parameters, str) else list(parameters)
    for name in names:
        if name not in possible:
            valid = ', '.join(possible) or 'none'
            raise InputError(f'parameters: {name!r}; expected for {quantity} of '
                             f'this robot some of {valid}')
    # Arguments as matrices of symbols, and their entries in the order of programs, by rows.
    arguments = {}
    entries: dict[str, list[Any]] = {}
    for name, shape in differentiable.items():
        if name in names or name not in PARAMETERS:
            arguments[name] = casadi.SX.sym(name, *matrix_shape(shape))
            entries[name] = casadi.vertsplit(casadi.vec(arguments[name].T))
    # Each entry of the block is an entry of an argument, or the present number.
    block: list[Any] = list(robot.parameters.block)
    for name in names:
        block[PARAMETERS[name]] = entries[name]
    entries['parameters'] = block
    program = kernels.program(quantity, at)
    scalars = [x for name, _ in program.inputs for x in entries[name]]
    # Of the result, which a program computes by rows too.
    rows, columns = matrix_shape(program.shape)
    values = casadi.vertcat(*_evaluated(casadi, program, scalars))
    result = casadi.reshape(values, columns, rows).T
    return casadi.Function(casadi_name(f'{quantity}_{at}'), list(arguments.values()),
                           [result], list(arguments), [quantity])


def _evaluated(casadi: Any, program: Program, values: Sequence[Any]) -> list[Any]:
    """Return a program's outputs for SX scalars; subroutines are expanded in place."""
    inputs: dict[str, Sequence[Any]] = {}
    # The scalars of all inputs, in the order of the program.
    begin = 0
    for name, shape in program.inputs:
        end = begin + math.prod(shape)
        inputs[name] = values[begin:end]
        begin = end
    by_index: dict[int, Any] = {}  # of a call: the list of its results

    def value_of(x: Any) -> Any:
        return by_index[x.index] if isinstance(x, Expr) else casadi.SX(x)

    # In the order of the program each node finds its arguments computed.
    for node in program.schedule():
        if node.op == 'input':
            name, k = node.args
            value = inputs[name][k]
        elif node.op == 'output':
            called, k = node.args
            value = by_index[called.index][k]
        elif node.op == 'call':
            # A subroutine has no counterpart in a graph: its operations are repeated
            # here.
            subroutine, *arguments = node.args
            value = _evaluated(casadi, subroutine, [value_of(x) for x in arguments])
        else:
            operation = OPERATORS.get(node.op)
            if operation is None:
                operation = getattr(casadi, CASADI.get(node.op, node.op))
            value = operation(*map(value_of, node.args))
        by_index[node.index] = value
    return [value_of(x) for x in program.outputs]


def matrix_shape(shape: Shape) -> tuple[int, int]:
    """Return the shape of an array as a matrix: more axes are stacked in rows."""
    if len(shape) < 2:
        return math.prod(shape), 1
    return math.prod(shape[:-1]), shape[-1]


def casadi_name(text: str) -> str:
    """Return a name that CasADi accepts, of letters, digits and single underscores."""
    return re.sub(r'[^A-Za-z0-9]+', '_', text).strip('_')
