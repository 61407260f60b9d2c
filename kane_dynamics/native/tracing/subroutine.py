"""Subroutines: parts of a traced function, compiled once and called repeatedly."""

from collections.abc import Callable, Iterable, Sequence
from itertools import count
import math
from typing import Any

from kane_dynamics.native.tracing.expression import Expr, Scalar
from kane_dynamics.native.tracing.program import applied, Program, Shape, trace_program
import numpy as np

Pattern = tuple[float | None, ...]


class Subroutines:
    """
    Registry of subroutines; calling it evaluates a function through a subroutine.

    Inlined code repeats a part at every use, which can exceed the instruction cache; a
    subroutine avoids that. Constant entries of the arguments are folded into the
    subroutine, so each pattern of constants has its own.
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
        # Constants are part of the subroutine, traced entries are its inputs.
        patterns = tuple(_constants(argument) for argument in arguments)
        traced_entries = []
        for argument in arguments:
            traced_entries.append([x for x in argument if isinstance(x, Expr)])
        inputs = [(f'x{k}', (len(entries),))
                  for k, entries in enumerate(traced_entries) if entries]
        if not inputs:
            return function(*arguments)
        program = self._programs.get((name, patterns))
        if program is None:
            # Traced with the constants in place, so that they fold.
            def with_constants(*entries: Any) -> Any:
                return function(*_filled_arguments(patterns, entries))

            program = self._programs[name, patterns] = self.trace(name, with_constants,
                                                                  inputs)
        results: list[Any] = list(call(program, *filter(None, traced_entries)))
        # Results that came out constant need no output of the call.
        for k, output in enumerate(program.outputs):
            if not isinstance(output, Expr):
                results[k] = output
        return np.array(results).reshape(program.shape)

    def trace(self, name: str, function: Callable[..., Any],
              inputs: Sequence[tuple[str, Shape]]) -> Program:
        """Return a traced subroutine, for `call`; its name differs from all others."""
        return trace_program(f'{name}_{next(self._numbers)}', function, inputs)


def is_first(program: Program, named: dict[str, Program]) -> bool:
    """
    Return whether a subroutine is not among those by name yet, and add it to them.

    Raises
    ------
    ValueError
        Another subroutine has this name, and would be called in place of this one.

    """
    if program.name not in named:
        named[program.name] = program
        return True
    if named[program.name] is not program:
        raise ValueError(f'subroutine {program.name}: two programs have this name; '
                         'expected a name of its own for each, as of one `Subroutines`')
    return False


def _constants(argument: Any) -> Pattern:
    """Return the constant entries of an argument, and None for its traced entries."""
    pattern: list[float | None] = []
    for entry in argument:
        is_traced = isinstance(entry, Expr)
        pattern.append(None if is_traced else float(entry))
    return tuple(pattern)


def _filled_arguments(patterns: tuple[Pattern, ...],
                      entries: Sequence[Any]) -> list[Any]:
    """Return arguments with the constants of the patterns and traced entries."""
    remaining = iter(entries)
    arguments: list[Any] = []
    for pattern in patterns:
        # A pattern has None where an entry is traced.
        if None in pattern:
            traced = iter(next(remaining))
            values = [next(traced) if x is None else x for x in pattern]
            arguments.append(np.array(values, dtype=object))
        else:
            arguments.append(np.array(pattern))
    return arguments


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
    entries: list[Scalar] = []
    for argument in arguments:
        entries += list(np.ravel(np.asarray(argument)))
    # Any traced entry has the graph in which the call is recorded.
    trace = next(x.trace for x in entries if isinstance(x, Expr))
    node = trace.node('call', program, *entries)
    outputs = []
    for k in range(len(program.outputs)):
        outputs.append(trace.node('output', node, k))
    return outputs


def inlined(program: Program, values: Sequence[Any]) -> list[Any]:
    """
    Return the outputs of a program as a list, computed in place, without a call.

    Parameters
    ----------
    program : Program
        The program to trace again.
    values : sequence of scalars
        The entries of all of its inputs, in order: traced values of another program, or
        numbers.

    """
    remaining = iter(values)
    # One traced value or number for each entry of each input.
    entries: dict[str, list[Any]] = {}
    for name, shape in program.inputs:
        entries[name] = [next(remaining) for _ in range(math.prod(shape))]

    def leaf(node: Expr) -> Any:
        name, k = node.args
        return entries[name][k]

    return replayed(program, leaf)


def replayed(program: Program, leaf: Callable[[Expr], Any]) -> list[Any]:
    """Return the outputs of a program as a list, with `leaf(node)` for inputs."""
    # Values by the index of their node; of a call the list of its results.
    values: dict[int, Any] = {}

    def value_of(x: Any) -> Any:
        return values[x.index] if isinstance(x, Expr) else x

    # In the order of the program, so that arguments have values before they are used.
    for node in program.schedule():
        if node.op == 'input':
            value = leaf(node)
        elif node.op == 'output':
            results, k = node.args
            value = value_of(results)[k]
        elif node.op == 'call':
            callee, *entries = node.args
            value = _called(callee, [value_of(x) for x in entries])
        else:
            value = applied(node.op, [value_of(x) for x in node.args])
        values[node.index] = value
    return [value_of(x) for x in program.outputs]


def _called(program: Program, arguments: list[Any]) -> list[Any]:
    """Return the outputs of a subroutine; without traced arguments they are numbers."""
    if any(isinstance(x, Expr) for x in arguments):
        return call(program, arguments)
    return inlined(program, arguments)
