"""Subroutines: parts of a traced function that are compiled once and called repeatedly."""

from collections.abc import Callable
from typing import Any

from kane_dynamics.native.tracing.expression import call, Expr
from kane_dynamics.native.tracing.program import Program, trace_program
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
            program = self._programs[name, pattern] = trace_program(
                f'{name}_{len(self._programs)}', traced,
                [(f'x{k}', (len(row),)) for k, row in enumerate(given) if row])
        results = call(program, *(row for row in given if row))
        return np.array([result if isinstance(x, Expr) else x
                         for result, x in zip(results, program.outputs)]).reshape(program.shape)


def _filled(pattern: tuple[float | None, ...], traced: Any) -> Any:
    """Return an argument's entries: the pattern's constants and the traced values."""
    rest = iter(traced)
    return np.array([next(rest) if x is None else x for x in pattern], dtype=object)
