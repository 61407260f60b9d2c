"""A robot's quantities as functions of CasADi."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics.robot.methods.derivative_methods import DerivativeMethods


class FrameworkMethods(DerivativeMethods):
    """The method of `Robot` for CasADi, an optional library."""

    def casadi(self, name: str, *, parameters: Sequence[str] = (),
               compiled: bool | None = None) -> Any:
        """
        Return a quantity as a casadi.Function with exact derivatives, for Opti and solvers.

        It comes from the program of the compiled quantity. Its arguments are those of the
        quantity's method by their names, one state; then 'wrench', (k, 6), if the robot declares
        wrench frames and the quantity depends on them, and 't' if the equations depend on time;
        then the `parameters`. Vectors are columns; of a result with three axes, the matrices are
        stacked. Batches: ``function.map(N)``, with a state in each column.

        A function in machine code (``function.class_name()`` is 'External') calls compiled code
        for first and second derivatives. It needs a linker, such as binutils, but no compiler.
        An expression graph ('SXFunction') needs neither, is slower, and is differentiated by
        CasADi; it can be serialized and CasADi can generate C code of it.

        CasADi checks names and shapes of arguments, not their values: where an argument is NaN or
        a position beyond 1e12, or where `Robot` raises an error that depends on the state (open
        loops, singular independent speeds), results are NaN. Solvers then take shorter steps.

        Parameters
        ----------
        name : str
            A quantity, as in `vjp`: ``'inverse_dynamics'``, ``'frame_pose:<frame>'``.
        parameters : sequence of str
            Run-time parameters that are arguments: 'gravity', 'payload' (see `vjp`). The others
            keep the values that they have now.
        compiled : bool, optional
            True: machine code, or an error; False: an expression graph. By default machine code
            if it can be linked, else an expression graph, with a line in the log.

        Returns
        -------
        casadi.Function
            Its result is named like the quantity.

        Raises
        ------
        InputError
            An unknown quantity, frame, joint or parameter; or CasADi is not installed.
        CompileError
            `compiled` is True and there is no linker, or it fails.

        """
        from kane_dynamics.robot.frameworks.casadi_function import casadi_function  # few programs need it
        quantity, at = self._place(name)
        return casadi_function(self, quantity, at, parameters, compiled)
