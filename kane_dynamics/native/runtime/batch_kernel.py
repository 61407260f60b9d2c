"""Kernels of functions of arrays alone, for batches."""

from collections.abc import Callable, Sequence
from typing import Any

from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
import numpy as np


def batch_kernel(name: str, function: Callable[..., Any], inputs: Sequence[tuple[str, Shape]],
                 shape: Shape) -> Kernel:
    """
    Return the kernel of a function without parameters.

    Parameters
    ----------
    name : str
        A C identifier.
    function : callable
        Takes traced arrays; `program_origin.origin` must tell it from others.
    inputs : sequence of (str, shape)
        Names and shapes of the arrays.
    shape : tuple of int
        Shape of the result.

    """
    def program() -> Program:
        return trace_program(name, lambda *given: function(*given[:-1]), [
            *inputs, ('parameters', (0,))])
    return Kernel(name, program, f'{name} {inputs}', [Argument(*each) for each in inputs],
                  np.zeros(0), shape)
