"""CasADi functions of a robot's quantities, from the traced programs."""

from collections.abc import Callable, Sequence
import logging
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
from kane_dynamics.native.tracing.program import OPERATORS, Program, Shape, size_of
from kane_dynamics.robot.derivative_kernels import PARAMETERS
import numpy as np

# The operations whose names differ from CasADi's.
CASADI = {'arctan': 'atan', 'less': 'lt', 'select': 'if_else'}
LONG = 100_000  # operations of a Jacobian: above, by calls of the derivative for each argument


def casadi_function(robot: Any, quantity: str, at: str, parameters: Sequence[str],
                    compiled: bool | None) -> Any:
    """Return a casadi.Function; see `Robot.casadi`."""
    casadi = extra('casadi', 'casadi', 'robot.casadi')
    source = Source(robot, quantity, at, parameters)
    if compiled is False:
        return graph(casadi, source.function())
    linker = shared_library.linker()
    try:
        if linker is None:
            raise CompileError('no linker on the PATH; expected one of '
                               f'{", ".join(shared_library.LINKERS)}')
        return external(casadi, source, linker)
    except CompileError as error:
        if compiled:
            raise
        logging.getLogger(__name__).warning(
            'robot.casadi: %s; the function of %s is an expression graph, which is slower',
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

    def __init__(self, robot: Any, quantity: str, at: str, parameters: Sequence[str]) -> None:
        """Check the names."""
        self._kernels, self._quantity, self._at = robot.kernels, quantity, at
        known = robot.kernels.differentiable(quantity)
        possible = [name for name in PARAMETERS if name in known]
        given = [parameters] if isinstance(parameters, str) else list(parameters)
        wrong = [name for name in given if name not in possible]
        if wrong:
            raise InputError(f'parameters: {wrong[0]!r}; expected for {quantity} of this robot '
                             f'some of {", ".join(possible) or "none"}')
        self._shapes = {name: as_matrix(shape) for name, shape in known.items()
                        if name in given or name not in PARAMETERS}
        block: list[Any] = list(robot.parameters.block)
        for name in given:
            part = PARAMETERS[name]
            block[part] = [(name, k) for k in range(part.stop - part.start)]
        self._parts = {'parameters': block}

    def function(self) -> MatrixFunction:
        """Return the quantity itself."""
        program = self._kernels.program(self._quantity, self._at)
        shape = as_matrix(program.shape)
        return MatrixFunction(
            identifier(f'{self._quantity}_{self._at}'), self._arguments(),
            (full(self._quantity, shape),),
            self._traced(program, lambda values: values.reshape(shape).ravel(order='F')))

    def jacobian(self, function: MatrixFunction) -> MatrixFunction:
        """Return its derivative: in closed form if there is one, else by passes."""
        closed = f'{self._quantity}_derivatives'
        if closed in self._kernels.names and set(self._shapes) <= {'q', 'u', 'udot', 'tau'}:
            return function.jacobian(self._traced(
                self._kernels.program(closed),
                lambda values: np.concatenate(list(values), axis=1) if values.ndim == 3
                else values))
        count = function.program.operation_count()
        operations = count.multiplications + count.additions
        passes = min(len(function.program.outputs), sum(
            size_of(shape) for _, shape in function.program.inputs))
        return (function.jacobian_by_columns() if operations * passes > LONG
                else function.jacobian())

    def _arguments(self) -> tuple[Any, ...]:
        return tuple(full(name, shape) for name, shape in self._shapes.items())

    def _traced(self, program: Program, arranged: Callable[[Any], Any]) -> Program:
        return retraced(program, self._arguments(), self._parts, arranged)


def external(casadi: Any, source: Source, linker: str) -> Any:
    """
    Return a function in machine code with its derivatives, a casadi.Function.

    They are the first derivative, forward and reverse mode, and those of reverse mode, for second
    derivatives. The library is cached on disk by its function, from which the others follow.
    """
    function = source.function()
    text = casadi_text(function)

    def made() -> bytes:
        with logged(f'the CasADi function of {function.name}'):
            return linked()

    def linked() -> bytes:
        gradient = function.reverse()
        others = [function.forward(), gradient, source.jacobian(function), gradient.forward(),
                  gradient.jacobian_by_columns()]
        texts = [text, *map(casadi_text, others)]
        return shared_library.linked(linker, [llvm.assemble_long(each) for each in texts])
    library = llvm.cached(made, 'casadi', text)
    # By CasADi's rules, one direction by forward or reverse mode, more by the Jacobian.
    fewest = min(sum(len(x.places) for x in function.inputs), len(function.program.outputs))
    options = {'jac_penalty': 1.0 / max(fewest, 1), 'ad_weight': 0.5}
    with tempfile.TemporaryDirectory() as folder:  # CasADi opens the file once
        path = Path(folder, f'{function.name}.so')
        path.write_bytes(library)
        try:
            return casadi.external(function.name, str(path), options)
        except RuntimeError as error:
            raise CompileError(f"library of {function.name} in '{folder}': {error}; expected a "
                               'folder from which code may be loaded (TMPDIR)') from None


def graph(casadi: Any, function: MatrixFunction) -> Any:
    """Return a function as a graph of SX expressions, a casadi.Function."""
    arguments = [casadi.SX.sym(block.name, *block.shape) for block in function.inputs]
    values = iter(_evaluated(casadi, function.program, [
        x.nz[k] for x in arguments for k in range(x.nnz())]))
    results = [casadi.reshape(casadi.vertcat(*(next(values) for _ in block.places)), *block.shape)
               for block in function.outputs]
    return casadi.Function(function.name, arguments, results,
                           [block.name for block in function.inputs],
                           [block.name for block in function.outputs])


def _evaluated(casadi: Any, program: Program, values: Sequence[Any]) -> list[Any]:
    """Return the outputs of a program for SX scalars; subroutines are expanded in place."""
    rest = iter(values)
    given = {name: [next(rest) for _ in range(size_of(shape))] for name, shape in program.inputs}
    known: dict[int, Any] = {}  # of a call: the list of its results

    def of(x: Any) -> Any:
        return known[x.index] if isinstance(x, Expr) else casadi.SX(x)

    for node in program.schedule():
        if node.op == 'input':
            found = given[node.args[0]][node.args[1]]
        elif node.op == 'output':
            found = known[node.args[0].index][node.args[1]]
        elif node.op == 'call':
            found = _evaluated(casadi, node.args[0], [of(x) for x in node.args[1:]])
        else:
            operation = OPERATORS.get(node.op) or getattr(casadi, CASADI.get(node.op, node.op))
            found = operation(*map(of, node.args))
        known[node.index] = found
    return [of(x) for x in program.outputs]


def as_matrix(shape: Shape) -> tuple[int, int]:
    """Return the shape of an array as a matrix: more axes are stacked in rows."""
    if len(shape) < 2:
        return size_of(shape), 1
    return size_of(shape[:-1]), shape[-1]


def identifier(text: str) -> str:
    """Return a name that CasADi accepts, of letters, digits and single underscores."""
    return re.sub(r'[^A-Za-z0-9]+', '_', text).strip('_')
