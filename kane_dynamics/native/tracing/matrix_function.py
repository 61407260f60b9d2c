"""Functions of matrices with derivatives: traced programs with sparse results."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from kane_dynamics.native.tracing.differentiation import forward, jacobian, reverse
from kane_dynamics.native.tracing.expression import Expr, operands
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.native.tracing.subroutine import call, inlined, Subroutines
import numpy as np


@dataclass(frozen=True)
class Block:
    """
    A matrix: an argument or a result of a function.

    Attributes
    ----------
    name : str
    shape : (int, int)
        Rows and columns.
    places : tuple of int
        Its structural nonzeros, row + rows * column, ascending: column by column.

    """

    name: str
    shape: tuple[int, int]
    places: tuple[int, ...]

    @property
    def size(self) -> int:
        """Return the number of entries, zeros included."""
        return math.prod(self.shape)


def full(name: str, shape: tuple[int, int]) -> Block:
    """Return a matrix without structural zeros."""
    return Block(name, shape, tuple(range(math.prod(shape))))


def unused(name: str, block: Block) -> Block:
    """Return an argument that a function does not read, of the shape of a block."""
    return Block(name, block.shape, ())


@dataclass(frozen=True, eq=False)
class MatrixFunction:
    """
    A function of matrices, column by column, as a program.

    The derivatives have the names, arguments and results by which CasADi looks for them.
    Results of the function itself are arguments of its derivatives there; they are not
    read here.

    Attributes
    ----------
    name : str
        A C identifier.
    inputs, outputs : tuple of Block
        Arguments and results.
    program : Program
        Of the nonzeros of each argument that has some, to the nonzeros of all results.

    """

    name: str
    inputs: tuple[Block, ...]
    outputs: tuple[Block, ...]
    program: Program

    @property
    def read(self) -> list[Block]:
        """Return the arguments that have entries."""
        return [block for block in self.inputs if block.places]

    def forward(self) -> 'MatrixFunction':
        """Return the rates of the results for given rates of the arguments."""
        # CasADi's names: of the seeds fwd_x, and of the results fwd_y.
        seeds = [Block(f'fwd_{x.name}', x.shape, x.places) for x in self.inputs]
        rates = [Block(f'fwd_{y.name}', y.shape, y.places) for y in self.outputs]
        count = len(self.read)

        def function(*arrays: Any) -> Any:
            x = _joined(arrays[:count])
            tangents = _joined(arrays[count:])
            return forward(inlined(self.program, x), x, tangents, Subroutines())
        return _traced(f'fwd1_{self.name}', [*self._nominal(), *seeds], rates, function)

    def reverse(self) -> 'MatrixFunction':
        """Return the gradients of the results' weighted sum, for given weights."""
        # Weights adj_y of the results give gradients adj_x of the arguments.
        seeds = [Block(f'adj_{y.name}', y.shape, y.places) for y in self.outputs]
        gradients = [Block(f'adj_{x.name}', x.shape, x.places) for x in self.inputs]
        count = len(self.read)

        def function(*arrays: Any) -> Any:
            x = _joined(arrays[:count])
            weights = _joined(arrays[count:])
            return reverse(inlined(self.program, x), weights, x, Subroutines())
        return _traced(f'adj1_{self.name}', [*self._nominal(), *seeds], gradients,
                       function)

    def jacobian(self, program: Program | None = None) -> 'MatrixFunction':
        """
        Return the derivative of results by arguments, with its structural zeros.

        `program`, if given, computes the entries, a row of all arguments for each entry
        of the results. By default passes over the function do.
        """
        def dense_function(*arrays: Any) -> Any:
            x = _joined(arrays)
            if program is not None:
                return inlined(program, x)
            values = np.array(inlined(self.program, x), dtype=object)
            return jacobian(values, x, Subroutines())
        n = sum(len(x.places) for x in self.read)
        size = len(self.program.outputs) * n
        dense = _traced('', self.read, [full('', (1, size))], dense_function)

        # Which entries are always zero is known from the traced values.
        values = np.array(dense.program.outputs, dtype=object)
        depends = []
        # Row by row, a bit for each argument entry that a result depends on.
        for row in np.reshape(values, (-1, n)):
            bits = (1 << k for k, x in enumerate(row) if not _is_zero(x))
            depends.append(sum(bits))
        blocks, entries = self._slopes(depends)

        def nonzeros(*arrays: Any) -> Any:
            values = inlined(dense.program, _joined(arrays))
            return [values[row * n + column] for row, column in entries]
        return _traced(f'jac_{self.name}', self._nominal(), blocks, nonzeros)

    def jacobian_by_columns(self) -> 'MatrixFunction':
        """
        Return the same as `jacobian`, by calls of the forward derivative.

        The program is short where that of `jacobian` is long, as for second derivatives.
        """
        rates = self.forward().program
        blocks, entries = self._slopes(dependence(self.program))

        def function(*arrays: Any) -> Any:
            # One forward pass for every column that has entries.
            x = _joined(arrays)
            numbers = sorted({column for _, column in entries})
            columns = {k: _rates_by(rates, x, k) for k in numbers}
            return [columns[column][row] for row, column in entries]
        return _traced(f'jac_{self.name}', self._nominal(), blocks, function)

    def _nominal(self) -> list[Block]:
        """Return the arguments of derivatives: the function's, and its results."""
        return [*self.inputs, *(unused(f'out_{y.name}', y) for y in self.outputs)]

    def _slopes(self, depends: Sequence[int]
                ) -> tuple[list[Block], list[tuple[int, int]]]:
        """
        Return the blocks of the Jacobian, and row and column of their nonzeros.

        `depends` has a number for every nonzero of the results; its bit k is set if that
        depends on nonzero k of the arguments.
        """
        blocks = []
        entries = []
        first_row = 0
        # A block for each pair of result and argument; its nonzeros column by column.
        for y in self.outputs:
            first_column = 0
            for x in self.inputs:
                places = []
                for column, x_place in enumerate(x.places):
                    # `depends` has a bit for each argument's entry: zeros of the
                    # Jacobian are left out.
                    bit = 1 << (first_column + column)
                    for row, y_place in enumerate(y.places):
                        if depends[first_row + row] & bit:
                            places.append(y_place + y.size * x_place)
                            entries.append((first_row + row, first_column + column))
                name = f'jac_{y.name}_{x.name}'
                blocks.append(Block(name, (y.size, x.size), tuple(places)))
                first_column += len(x.places)
            first_row += len(y.places)
        return blocks, entries


def retraced(program: Program, arguments: Sequence[Block],
             parts: Mapping[str, Sequence[Any]],
             arranged: Callable[[Any], Any]) -> Program:
    """
    Return a program with matrices, column by column, as its arguments.

    Parameters
    ----------
    program : Program
        Its inputs are in C order.
    arguments : sequence of Block
        Arguments without structural zeros: inputs of the program, or named in `parts`.
    parts : mapping
        The entries of inputs that are no arguments: numbers, or (name, k) for entry k of
        an argument.
    arranged : callable
        Takes the result of the program, of its shape; returns the entries in the new
        order.

    """
    def function(*columns: Any) -> Any:
        arrays = {}
        for block, x in zip(arguments, columns):
            # CasADi stores columns one after the other, programs rows.
            arrays[block.name] = np.reshape(x, block.shape, order='F').ravel()
        # The program's inputs, from arguments, parts of blocks, or constants.
        values: list[Any] = []
        for key, _ in program.inputs:
            if key in arrays:
                values += list(arrays[key])
                continue
            for part in parts[key]:
                if isinstance(part, tuple):
                    name, k = part
                    values.append(arrays[name][k])
                else:
                    values.append(float(part))
        entries = np.array(inlined(program, values), dtype=object)
        return np.ravel(arranged(entries.reshape(program.shape)))
    return trace_program(program.name, function, _inputs(arguments))


def dependence(program: Program) -> list[int]:
    """Return a number for each output; bit k: it depends on input entry k."""
    # The number of the first entry of each input, among the entries of all.
    first = {}
    count = 0
    for name, shape in program.inputs:
        first[name] = count
        count += math.prod(shape)
    # Of a call: the dependence of its results on its arguments.
    of_results: dict[int, list[int]] = {}
    depends: dict[int, int] = {}
    for node in program.schedule():
        if node.op == 'input':
            name, k = node.args
            depends[node.index] = 1 << (first[name] + k)
        elif node.op == 'call':
            of_results[node.index] = dependence(node.args[0])
        elif node.op == 'output':
            source, place = node.args
            bits = of_results[source.index][place]
            # Of the results of a subroutine, the entry depends on the arguments that
            # this result has.
            arguments = [x for k, x in enumerate(source.args[1:]) if bits >> k & 1]
            depends[node.index] = _union(depends, arguments)
        else:
            depends[node.index] = _union(depends, operands(node))
    return [_union(depends, [x]) for x in program.outputs]


def _union(depends: Mapping[int, int], values: Iterable[Any]) -> int:
    """Return the union of the dependences, as bits, of some values."""
    bits = 0
    for x in values:
        if isinstance(x, Expr):
            bits |= depends[x.index]
    return bits


def _rates_by(rates: Program, x: list[Any], k: int) -> list[Any]:
    """Return the results of a forward derivative for the unit rate of entry k of x."""
    # Its rate is a column of the Jacobian.
    unit = [float(j == k) for j in range(len(x))]
    return call(rates, x, unit)


def _traced(name: str, inputs: Sequence[Block], outputs: Sequence[Block],
            function: Any) -> MatrixFunction:
    return MatrixFunction(name, tuple(inputs), tuple(outputs),
                          trace_program(name, function, _inputs(inputs)))


def _inputs(blocks: Sequence[Block]) -> list[tuple[str, Shape]]:
    return [(block.name, (len(block.places),)) for block in blocks if block.places]


def _joined(arrays: Iterable[Any]) -> list[Any]:
    return [x for array in arrays for x in array]


def _is_zero(x: Any) -> bool:
    return not isinstance(x, Expr) and x == 0.0
