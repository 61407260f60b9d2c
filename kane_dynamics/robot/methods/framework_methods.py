"""A robot's quantities as functions of other libraries: CasADi, PyTorch, JAX."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.optional_imports import extra
from kane_dynamics.errors import InputError
from kane_dynamics.robot.methods.dynamics_methods import place_of
from kane_dynamics.robot.methods.frame_methods import FrameMethods


class FrameworkMethods(FrameMethods):
    """The methods of `Robot` for CasADi, PyTorch and JAX, which are optional."""

    def casadi(self, name: str, *, parameters: Sequence[str] = ()) -> Any:
        """
        Return a quantity as a casadi.Function with exact derivatives.

        For Opti and solvers. It comes from the program of the compiled quantity. Its
        arguments are those of the quantity's method by their names, one state; then
        'wrench', (k, 6), if the robot declares wrench frames and the quantity depends on
        them, and 't' if the equations depend on time; then the `parameters`. Vectors are
        columns; of a result with three axes, the matrices are stacked. Batches:
        ``function.map(N)``, with a state in each column.

        It is a graph of expressions, which CasADi differentiates, serializes and turns
        into C code; with a compiler, CasADi's option ``jit`` makes it fast.

        CasADi checks names and shapes of arguments, not their values: where an argument
        is NaN, or where `Robot` raises an error that depends
        on the state (open loops, singular independent speeds) or selects other redundant
        rows, results are NaN. Solvers then take shorter steps.

        Parameters
        ----------
        name : str
            A quantity, as in `vjp`: ``'inverse_dynamics'``, ``'frame_pose:<frame>'``.
        parameters : sequence of str
            Run-time parameters that are arguments: 'gravity', 'payload' (see `vjp`). The
            others keep the values that they have now.

        Returns
        -------
        casadi.Function
            Its result is named like the quantity.

        Raises
        ------
        InputError
            An unknown quantity, frame, joint or parameter; or CasADi is not installed.

        """
        # Few programs need it.
        from kane_dynamics.robot.frameworks import casadi_function
        quantity, at = place_of(name)
        return casadi_function.casadi_function(self, quantity, at, parameters)

    def torch(self, name: str, *, parameters: Sequence[str] = ()) -> Any:
        """
        Return a quantity as a function of PyTorch tensors, differentiable to any order.

        Its arguments are those of the quantity's method, in its order or by their names;
        then 'wrench', (k, 6), if the robot declares wrench frames and the quantity
        depends on them, and 't' if the equations depend on time; then the `parameters`.
        Each has any number of batch axes in front; these broadcast. So one payload
        serves for a batch of states, and its gradient is the sum over them.

        Values and derivatives come from compiled kernels for batches. Backward passes,
        forward mode and the transforms of `torch.func` apply, and `torch.compile`, which
        sees one operator. Tensors are on the CPU, and float64, which is read in place,
        or float32: then the kernels compute in double and the result is rounded. A
        function can be pickled if the robot can.

        Parameters
        ----------
        name : str
            A quantity, as in `vjp`: ``'inverse_dynamics'``, ``'frame_pose:<frame>'``.
        parameters : sequence of str
            Parameters that are arguments: 'gravity', (3,), and 'payload', (10,), as in
            `vjp`; 'inertial_parameters' of all bodies, (10 n_bodies,), as in
            `regressor`; 'damping' and 'friction' of the joints, (n_j,). The others keep
            the values that they have now.

        Returns
        -------
        callable
            Raises InputError that names a wrong argument, or an entry that is not
            finite; or as the robot's method. Cotangents that are not finite give
            gradients that are not.

        Raises
        ------
        InputError
            An unknown quantity, frame, joint or parameter; or PyTorch is not installed.

        """
        quantity, at = place_of(name)
        module = extra('kane_dynamics.robot.frameworks.torch_function', 'torch',
                       'robot.torch')
        return module.TorchFunction(self, quantity, at, parameters)

    def jax(self, name: str, *, parameters: Sequence[str] = (),
            compiled: bool | None = None, operations: bool = False) -> Any:
        """
        Return a quantity as a function of JAX arrays, differentiable to any order.

        Its arguments are those of the quantity's method, in its order or by their names;
        then 'wrench', (k, 6), if the robot declares wrench frames and the quantity
        depends on them, and 't' if the equations depend on time; then the `parameters`.
        Each has any number of batch axes in front; these broadcast.

        `jit`, `vmap`, `grad`, `jvp`, `vjp`, `jacfwd`, `jacrev` and `hessian` apply; all
        values and derivatives come from compiled kernels for batches, on the CPU. Arrays
        are float64 (with ``jax_enable_x64``), or float32: then the kernels compute in
        double and the result is rounded. In a function compiled by `jit`, no error can
        be raised: a state with an argument that is not finite, a position beyond 1e12,
        or where the robot's method raises an error that depends on the state or selects
        other redundant rows, has NaN in all of its result. Elsewhere it is an error.

        Parameters
        ----------
        name : str
            A quantity, as in `vjp`: ``'inverse_dynamics'``, ``'frame_pose:<frame>'``.
        parameters : sequence of str
            Parameters that are arguments: 'gravity', (3,), and 'payload', (10,), as in
            `vjp`; 'inertial_parameters' of all bodies, (10 n_bodies,), as in
            `regressor`; 'damping' and 'friction' of the joints, (n_j,). The others keep
            the values that they have now.
        compiled : bool, optional
            True: functions compiled by `jit` call machine code by XLA's foreign function
            interface, or an error; False: they call Python (`jax.pure_callback`), which
            is slower. By default machine code if this version of JAX has the interface,
            else Python, with a line in the log.
        operations : bool
            Evaluate the quantity by operations of JAX, which XLA compiles for any of its
            devices and JAX differentiates, instead of by kernels on the CPU. Numbers
            have the type of the arguments; values are not checked. ``function.entries``
            returns the entries one by one, for use inside of `jit`.

        Returns
        -------
        callable
            Raises InputError that names a wrong argument.

        Raises
        ------
        InputError
            An unknown quantity, frame, joint or parameter; both `compiled` and
            `operations`; or JAX is not installed.
        CompileError
            `compiled` is True and JAX has another interface.

        """
        quantity, at = place_of(name)
        if operations:
            if compiled is not None:
                raise InputError(f'compiled: {compiled} with operations=True; expected '
                                 'None, since operations of JAX call no kernel')
            module = extra('kane_dynamics.robot.frameworks.jax_operations', 'jax',
                           'robot.jax')
            return module.JaxOperations(self, quantity, at, parameters)
        module = extra('kane_dynamics.robot.frameworks.jax_function', 'jax', 'robot.jax')
        return module.JaxFunction(self, quantity, at, parameters, compiled)
