"""Loops of a traced function: a step compiled once, and called for each row of tables."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from kane_dynamics.native.tracing.expression import Expr
from kane_dynamics.native.tracing.program import Program
from kane_dynamics.native.tracing.subroutine import Subroutines
import numpy as np


@dataclass(frozen=True, eq=False)
class Loop:
    """
    Calls of a program one after the other.

    The first input of the program is the carry: the given one, then the first entries of
    the result before. All other inputs are rows of tables.

    Attributes
    ----------
    program : Program
    count : int
    reverse : bool
        From the last row to the first; results are in the order of the rows.

    """

    program: Program
    count: int
    reverse: bool

    @property
    def n_outputs(self) -> int:
        """Return the number of scalars in all results."""
        return self.count * len(self.program.outputs)


class Loops:
    """Registry of the steps of loops; calling it is `one_by_one`, recorded as a loop."""

    def __init__(self) -> None:
        """Create an empty registry."""
        self._subroutines = Subroutines()
        self._programs: dict[tuple[Any, ...], Program] = {}

    def __call__(self, name: str, step: Callable[..., Any], carry: Any, *tables: Any,
                 reverse: bool = False) -> Any:
        """Return the results of a step for each row of tables; see `one_by_one`."""
        inputs = [('carry', np.shape(carry))]
        for k, table in enumerate(tables):
            inputs.append((f'row_{k}', np.shape(table)[1:]))
        key = name, *inputs
        if key not in self._programs:
            self._programs[key] = self._subroutines.trace(name, step, inputs)
        program = self._programs[key]
        # The carry first, then the tables by columns of their rows.
        entries = list(carry)
        for table in tables:
            entries += list(np.ravel(table))
        trace = next(x.trace for x in entries if isinstance(x, Expr))
        loop = Loop(program, len(tables[0]), reverse)
        # One node for the whole loop; its results are nodes that read from it.
        node = trace.node('loop', loop, *entries)
        results = [trace.node('output', node, k) for k in range(loop.n_outputs)]
        return np.array(results).reshape(loop.count, len(program.outputs))
