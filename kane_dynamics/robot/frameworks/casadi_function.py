"""CasADi functions of a robot's quantities, from the traced programs."""

from collections.abc import Callable, Sequence
import logging
import math
from pathlib import Path
import re
import tempfile
from typing import Any

from kane_dynamics._util.optional_imports import extra
from kane_dynamics.errors import CompileError, InputError
from kane_dynamics.native.backends.casadi_library import casadi_text
from kane_dynamics.native.machine_code import llvm, shared_library
from kane_dynamics.native.machine_code.compiling import logged
from kane_dynamics.native.tracing.expression import Expr
from kane_dynamics.native.tracing.matrix_function import full, MatrixFunction, retraced
from kane_dynamics.native.tracing.program import OPERATORS, Program, Shape
from kane_dynamics.robot.derivative_kernels import PARAMETERS
import numpy as np

# The operations whose names differ from CasADi's.
CASADI = {'arctan': 'atan', 'less': 'lt', 'select': 'if_else'}
# Operations of a Jacobian: above, by calls of the derivative for each argument.
LONG = 100_000


def casadi_function(robot: Any, quantity: str, at: str, parameters: Sequence[str],
                    compiled: bool | None) -> Any:
    """Return a casadi.Function; see `Robot.casadi`."""
    casadi = extra('casadi', 'casadi', 'robot.casadi')
    source = Source(robot, quantity, at, parameters)
    # Compiled if there is a linker; otherwise, unless asked for, an expression graph.
    if compiled is False:
        return graph(casadi, source.function())
    linker = shared_library.linker()
    try:
        if linker is None:
            raise CompileError('no linker on the PATH; expected one of '
                               f'{", ".join(shared_library.LINKERS)}')
        return external(casadi, source, linker)
    except CompileError as error:
        # Only a stated choice is an error; else the slower function serves as well.
        if compiled:
            raise
        logging.getLogger(__name__).warning(
            'robot.casadi: %s; the function of %s is an expression graph, which is '
            'slower',
            error, quantity)
        return graph(casadi, source.function())


class Source:
    """
    Programs of a quantity and of its derivatives, with matrices as arguments and result.

    Parameters
    ----------
    robot : Robot
    quantity, at : str
        A quantity, and its frame or joint or ''.
    parameters : sequence of str
        The run-time parameters that are arguments; the others keep their present values.

    """

    def __init__(self, robot: Any, quantity: str, at: str,
                 parameters: Sequence[str]) -> None:
        """Check the names."""
        self._kernels = robot.kernels
        self._quantity = quantity
        self._at = at
        # Parameters by which it can be differentiated may be arguments.
        differentiable = robot.kernels.differentiable(quantity)
        possible = [name for name in PARAMETERS if name in differentiable]
        names = [parameters] if isinstance(parameters, str) else list(parameters)
        for name in names:
            if name not in possible:
                valid = ', '.join(possible) or 'none'
                raise InputError(f'parameters: {name!r}; expected for {quantity} of '
                                 f'this robot some of {valid}')
        # Arguments as matrices, as CasADi has them.
        self._shapes = {}
        for name, shape in differentiable.items():
            if name in names or name not in PARAMETERS:
                self._shapes[name] = matrix_shape(shape)
        # Each entry of the block is an entry of an argument, or the present number.
        block: list[Any] = list(robot.parameters.block)
        for name in names:
            part = PARAMETERS[name]
            block[part] = [(name, k) for k in range(part.stop - part.start)]
        self._parts = {'parameters': block}

    def function(self) -> MatrixFunction:
        """Return the quantity itself."""
        program = self._kernels.program(self._quantity, self._at)
        shape = matrix_shape(program.shape)

        def by_columns(values: Any) -> Any:
            return values.reshape(shape).ravel(order='F')
        return MatrixFunction(
            casadi_name(f'{self._quantity}_{self._at}'), self._arguments(),
            (full(self._quantity, shape),), self._traced(program, by_columns))

    def jacobian(self, function: MatrixFunction) -> MatrixFunction:
        """Return its derivative: in closed form if there is one, else by passes."""
        closed_form = f'{self._quantity}_derivatives'
        # Closed forms of the derivatives take fewer operations than passes.
        if (closed_form in self._kernels.names
                and set(self._shapes) <= {'q', 'u', 'udot', 'tau'}):
            def side_by_side(values: Any) -> Any:
                return np.concatenate(list(values),
                                      axis=1) if values.ndim == 3 else values
            program = self._kernels.program(closed_form)
            return function.jacobian(self._traced(program, side_by_side))
        # One pass for each entry of the result or of the arguments, whichever are fewer.
        program = function.program
        count = program.operation_count()
        operations = count.multiplications + count.additions
        entries = sum(math.prod(shape) for _, shape in program.inputs)
        passes = min(len(program.outputs), entries)
        if operations * passes > LONG:
            return function.jacobian_by_columns()
        return function.jacobian()

    def _arguments(self) -> tuple[Any, ...]:
        return tuple(full(name, shape) for name, shape in self._shapes.items())

    def _traced(self, program: Program, arranged: Callable[[Any], Any]) -> Program:
        return retraced(program, self._arguments(), self._parts, arranged)


def external(casadi: Any, source: Source, linker: str) -> Any:
    """
    Return a function in machine code with its derivatives, a casadi.Function.

    They are the first derivative, forward and reverse mode, and those of reverse mode,
    for second derivatives. The library is cached on disk by its function, from which the
    others follow.
    """
    function = source.function()
    text = casadi_text(function)

    # The value alone is the key of the cache: its derivatives follow from it.
    def linked() -> bytes:
        gradient = function.reverse()
        derivatives = [function.forward(), gradient, source.jacobian(function),
                       gradient.forward(), gradient.jacobian_by_columns()]
        texts = [text, *map(casadi_text, derivatives)]
        objects = [llvm.assemble_long(llvm_text) for llvm_text in texts]
        return shared_library.linked(linker, objects)

    def linked_and_logged() -> bytes:
        with logged(f'the CasADi function of {function.name}'):
            return linked()
    library = llvm.cached(linked_and_logged, 'casadi', text)
    # By CasADi's rules, one direction by forward or reverse mode, more by the Jacobian.
    entries = sum(len(block.places) for block in function.inputs)
    fewest = min(entries, len(function.program.outputs))
    options = {'jac_penalty': 1.0 / max(fewest, 1), 'ad_weight': 0.5}
    with tempfile.TemporaryDirectory() as folder:  # CasADi opens the file once
        path = Path(folder, f'{function.name}.so')
        path.write_bytes(library)
        try:
            return casadi.external(function.name, str(path), options)
        except RuntimeError as error:
            raise CompileError(f"library of {function.name} in '{folder}': {error}; "
                               'expected a folder from which code may be loaded '
                               '(TMPDIR)') from None


def graph(casadi: Any, function: MatrixFunction) -> Any:
    """Return a function as a graph of SX expressions, a casadi.Function."""
    # Arguments as matrices of symbols, and all their entries in one list.
    arguments = []
    scalars = []
    for block in function.inputs:
        argument = casadi.SX.sym(block.name, *block.shape)
        arguments.append(argument)
        scalars += [argument.nz[k] for k in range(argument.nnz())]
    # The operations of the program on SX scalars, cut into the results.
    values = _evaluated(casadi, function.program, scalars)
    results = []
    begin = 0
    for block in function.outputs:
        end = begin + len(block.places)
        column = casadi.vertcat(*values[begin:end])
        results.append(casadi.reshape(column, *block.shape))
        begin = end
    return casadi.Function(function.name, arguments, results,
                           [block.name for block in function.inputs],
                           [block.name for block in function.outputs])


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
