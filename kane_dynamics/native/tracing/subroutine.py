"""Subroutines: parts of a traced function that are compiled once and called repeatedly."""

from collections.abc import Callable, Iterable, Sequence
from itertools import count
from typing import Any

from kane_dynamics.native.tracing.expression import Expr, Scalar
from kane_dynamics.native.tracing.program import (applied, Program, Shape, size_of,
                                                  trace_program)
import numpy as np


class Subroutines:
    """
    Registry of subroutines; calling it evaluates a function through a subroutine.

    Inlined code repeats a part at every use, which can exceed the instruction cache; a
    subroutine avoids that. Constant entries of the arguments are folded into the subroutine, so
    each pattern of constants has its own.
    """

    def __init__(self) -> None:
        """Create an empty registry."""
        self._programs: dict[tuple[Any, ...], Program] = {}
        self._numbers = count()

    def __call__(self, name: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """
        Return ``function(*arguments)``, computed by a subroutine.

        Parameters
        ----------
        name : str
            A C identifier that identifies what `function` computes.
        function : callable
            Takes arrays and returns one. It must not use traced values other than its
            arguments.
        *arguments : arrays
            One-dimensional.

        """
        pattern = tuple(tuple(None if isinstance(x, Expr) else float(x) for x in argument)
                        for argument in arguments)
        given = [[x for x in argument if isinstance(x, Expr)] for argument in arguments]
        if not any(given):
            return function(*arguments)
        program = self._programs.get((name, pattern))
        if program is None:
            def traced(*rows: Any) -> Any:
                rest = iter(rows)
                return function(*(_filled(kept, next(rest)) if None in kept else np.array(kept)
                                  for kept in pattern))
            program = self._programs[name, pattern] = self.trace(
                name, traced, [(f'x{k}', (len(row),)) for k, row in enumerate(given) if row])
        results = call(program, *(row for row in given if row))
        return np.array([result if isinstance(x, Expr) else x
                         for result, x in zip(results, program.outputs)]).reshape(program.shape)

    def trace(self, name: str, function: Callable[..., Any],
              inputs: Sequence[tuple[str, Shape]]) -> Program:
        """Return a traced subroutine, for `call`; its name differs from all others."""
        return trace_program(f'{name}_{next(self._numbers)}', function, inputs)


def _filled(pattern: tuple[float | None, ...], traced: Any) -> Any:
    """Return an argument's entries: the pattern's constants and the traced values."""
    rest = iter(traced)
    return np.array([next(rest) if x is None else x for x in pattern], dtype=object)


def call(program: Any, *arguments: Iterable[Any]) -> list[Expr]:
    """
    Call a traced program as a subroutine and return its outputs as a flat list.

    Parameters
    ----------
    program : Program
        The subroutine; it becomes a separate function of the compiled module.
    arguments : iterables of scalars
        The entries of each of its inputs, in order.

    """
    flat: list[Scalar] = [x for argument in arguments for x in np.ravel(np.asarray(argument))]
    trace = next(x.trace for x in flat if isinstance(x, Expr))
    node = trace.node('call', program, *flat)
    return [trace.node('output', node, k) for k in range(program.n_outputs)]


def inlined(program: Program, values: Sequence[Any]) -> list[Any]:
    """
    Return the outputs of a program as a flat list, computed in place instead of by a call.

    Parameters
    ----------
    program : Program
        The program to trace again.
    values : sequence of scalars
        The entries of all of its inputs, in order: traced values of another program, or numbers.

    """
    rest = iter(values)
    given = {name: [next(rest) for _ in range(size_of(shape))] for name, shape in program.inputs}
    return replayed(program, lambda node: given[node.args[0]][node.args[1]])


def replayed(program: Program, leaf: Callable[[Expr], Any]) -> list[Any]:
    """Return the outputs of a program as a flat list, with `leaf(node)` for its input nodes."""
    new: dict[int, Any] = {}  # of a call: the list of its results

    def of(x: Any) -> Any:
        return new[x.index] if isinstance(x, Expr) else x

    for node in program.schedule():
        if node.op == 'input':
            found = leaf(node)
        elif node.op == 'output':
            found = of(node.args[0])[node.args[1]]
        elif node.op == 'call':
            callee, *flat = node.args
            arguments = [of(x) for x in flat]
            found = (call(callee, arguments) if any(isinstance(x, Expr) for x in arguments)
                     else inlined(callee, arguments))
        else:
            found = applied(node.op, [of(x) for x in node.args])
        new[node.index] = found
    return [of(x) for x in program.outputs]
