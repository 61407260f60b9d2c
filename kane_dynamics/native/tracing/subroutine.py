"""Parts of a traced function as subroutines that its other parts share."""

from collections.abc import Callable
from typing import Any

from kane_dynamics.native.tracing.expression import call, Expr
from kane_dynamics.native.tracing.program import Program, trace_program
import numpy as np


class Subroutines:
    """
    Calls a function as a subroutine, traced once for each name.

    Straight-line code repeats a part wherever it is used; where that part is used more often than
    the instruction cache can bear, it is called instead. What is constant in the arguments stays
    constant in the subroutine, one for each such pattern.
    """

    def __init__(self) -> None:
        """Hold no subroutines yet."""
        self._programs: dict[tuple[Any, ...], Program] = {}

    def __call__(self, name: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """
        Return ``function(*arguments)``.

        Parameters
        ----------
        name : str
            A C identifier, the same wherever `function` computes the same.
        function : callable
            Takes arrays and returns one; it may refer to nothing traced but its arguments.
        *arguments : arrays
            Of one dimension.

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
    """Return an argument's entries, the constant and the traced ones, in their places."""
    rest = iter(traced)
    return np.array([next(rest) if x is None else x for x in pattern], dtype=object)
