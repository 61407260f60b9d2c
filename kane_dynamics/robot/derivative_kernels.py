"""Derivatives of a robot's quantities, by passes over their traced programs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.native.runtime.kernel import Argument
from kane_dynamics.native.tracing.differentiation import forward, jacobian, reverse
from kane_dynamics.native.tracing.program import Shape, trace_program
from kane_dynamics.native.tracing.subroutine import inlined, Subroutines
import numpy as np

# Places in the block of parameters.
PARAMETERS = {'gravity': slice(0, 3), 'payload': slice(3, 13)}


@dataclass(frozen=True)
class Derivative:
    """
    A derivative of a quantity, or of another derivative of it.

    Attributes
    ----------
    mode : str
        'vjp', of a cotangent: the gradients of its product with the quantity, one after
        the other; 'jvp', of a tangent for each input: the directional derivative;
        'derivative': the Jacobian, with one more axis, the inputs one after the other;
        'value': the quantity itself.
    by : tuple of str
        Names of the inputs; cotangents and tangents of `of` are inputs, too.
    of : Derivative, optional
        What is differentiated; by default the quantity.
    run_time : tuple of str
        Run-time parameters that are arguments of each state, of the innermost
        derivative.

    """

    mode: str
    by: tuple[str, ...] = ()
    of: 'Derivative | None' = None
    run_time: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the run-time parameters that are arguments of each state."""
        return self.run_time if self.of is None else self.of.parameters

    @property
    def _end(self) -> str:
        """Return the end of names of cotangents and tangents, which counts the order."""
        order = 1
        inner = self.of
        while inner is not None and inner.mode != 'value':
            order += 1
            inner = inner.of
        return '' if order == 1 else f'_{order}'

    def label(self, name: str) -> str:
        """Return the name of the kernel."""
        if self.of is not None:
            name = self.of.label(name)
        if self.mode != 'value':
            return f'{self.mode} of {name} by {", ".join(self.by)}'
        return f'{name} of {", ".join(self.run_time)}' if self.run_time else name

    def seeds(self, shapes: Mapping[str, Shape], result: Shape) -> list[Argument]:
        """Return the cotangent or tangents of this derivative and of those within."""
        # Derivatives of derivatives: the seeds of the outer one come first.
        inner_seeds = [] if self.of is None else self.of.seeds(shapes, result)
        shapes, result = self._differentiated(shapes, result)
        seeds = []
        if self.mode == 'vjp':
            seeds.append(Argument(f'cotangent{self._end}', result))
        elif self.mode == 'jvp':
            for name in self.by:
                seeds.append(Argument(f'd{name}{self._end}', shapes[name]))
        return [*seeds, *inner_seeds]

    def shape(self, shapes: Mapping[str, Shape], result: Shape) -> Shape:
        """Return the shape of the kernel's result."""
        shapes, result = self._differentiated(shapes, result)
        if self.mode in ('jvp', 'value'):
            return result
        count = sum(math.prod(shapes[name]) for name in self.by)
        return (count,) if self.mode == 'vjp' else (*result, count)

    def _differentiated(self, shapes: Mapping[str, Shape],
                        result: Shape) -> tuple[Mapping[str, Shape], Shape]:
        """Return the shapes of inputs and result of what is differentiated."""
        if self.of is None:
            return shapes, result
        all_shapes = dict(shapes)
        for seed in self.of.seeds(shapes, result):
            all_shapes[seed.name] = seed.shape
        return all_shapes, self.of.shape(shapes, result)

    def traced(self, result: Any, arrays: Mapping[str, Any]) -> Any:
        """Return the derivative of a traced result; `arrays` are inputs by name."""
        if self.of is not None:
            result = self.of.traced(result, arrays)
        if self.mode == 'value':
            return result
        # The scalars by which the result is differentiated, in the order of `by`.
        inputs: list[Scalar] = []
        for name in self.by:
            # An argument of the kernel, or a part of its block of parameters.
            if name in arrays:
                inputs.extend(np.ravel(arrays[name]))
            else:
                inputs.extend(arrays['parameters'][PARAMETERS[name]])
        # All of the Jacobian; or J^T times a cotangent; or J times tangents.
        if self.mode == 'derivative':
            return jacobian(result, inputs, Subroutines())
        outputs = np.ravel(np.asarray(result, dtype=object))
        if self.mode == 'vjp':
            cotangent = np.ravel(arrays[f'cotangent{self._end}'])
            gradients = reverse(outputs, cotangent, inputs, Subroutines())
            return np.array(gradients, dtype=object)
        tangents: list[Scalar] = []
        for name in self.by:
            tangents.extend(np.ravel(arrays[f'd{name}{self._end}']))
        rates = forward(outputs, inputs, tangents, Subroutines())
        return np.array(rates, dtype=object).reshape(np.shape(result))


def require_known(name: str, by: Sequence[str], shapes: Mapping[str, Shape]) -> None:
    """Raise InputError if a quantity cannot be differentiated by one of these names."""
    unknown = [key for key in by if key not in shapes]
    if unknown or not by or len(set(by)) < len(by):
        stated = ', '.join(map(repr, by)) or 'none'
        raise InputError(f'by: {stated}; expected for {name} some of '
                         f'{", ".join(shapes)}, each once')


class SlopesOfDynamics:
    """
    The derivatives of dynamics for equations without a recursion of their own for them.

    Those are chosen speeds, constraints and beams.
    """

    def __init__(self, equations: Equations) -> None:
        """Store the equations."""
        self._equations: Any = equations

    def inverse_dynamics_derivatives(self, q: Vector, u: Vector, udot: Vector,
                                     parameters: Vector, **time: Scalar) -> Matrix:
        """Return dtau/dq, dtau/du and M side by side, (n, n_q + 2 n), no wrenches."""
        if self._equations.carries_loads:
            tau = self._equations.inverse_dynamics(q, u, udot, None, parameters, **time)
            return jacobian(tau, [*q, *u, *udot], Subroutines())
        M = self._square(self._equations.mass_matrix(q, parameters, **time))
        return np.concatenate([self._slopes(q, u, udot, parameters, **time), M], axis=1)

    def forward_dynamics_derivatives(self, q: Vector, u: Vector, tau: Vector,
                                     parameters: Vector, **time: Scalar) -> Matrix:
        """
        Return dudot/dq, dudot/du and M^-1 side by side, (n, n_q + 2 n), no wrenches.

        From tau = M udot + h: dudot = -M^-1 dtau, with the dtau of inverse dynamics at
        udot.
        """
        # dtau at any udot is a program of its own: udot must not be differentiated,
        # although it depends on q and u.
        inputs = {'q': q, 'u': u, 'udot': u, 'parameters': parameters}
        for name, value in time.items():
            inputs[name] = np.asarray(value, dtype=object)

        def slopes_of(q: Vector, u: Vector, udot: Vector, parameters: Vector,
                      *times: Vector) -> Matrix:
            scalars = {name: value[()] for name, value in zip(time, times)}
            return self._slopes(q, u, udot, parameters, **scalars)
        shapes = [(name, np.shape(value)) for name, value in inputs.items()]
        program = trace_program('slopes', slopes_of, shapes)

        inputs['udot'] = self._equations.forward_dynamics(q, u, tau, None, parameters,
                                                          **time)
        scalars: list[Scalar] = []
        for value in inputs.values():
            scalars.extend(np.ravel(value))
        entries = np.array(inlined(program, scalars), dtype=object)
        slopes = entries.reshape(program.shape)
        W = self._square(self._equations.inverse_mass_matrix(q, parameters, **time))
        if self._equations.carries_loads:
            # dudot/dx = -W dtau/dx needs the derivative of tau by udot in place of M.
            W = self._by_torque(q, u, tau, parameters, **time)
        return np.concatenate([-(W @ slopes), W], axis=1)

    def _slopes(self, q: Vector, u: Vector, udot: Vector, parameters: Vector,
                **time: Scalar) -> Matrix:
        """Return dtau/dq and dtau/du side by side, (n, n_q + n)."""
        tau = self._equations.inverse_dynamics(q, u, udot, None, parameters, **time)
        return jacobian(tau, [*q, *u], Subroutines())

    def _by_torque(self, q: Vector, u: Vector, tau: Vector, parameters: Vector,
                   **time: Scalar) -> Matrix:
        """Return dudot/dtau, (n, n), of a robot whose friction depends on the torque."""
        udot = self._equations.forward_dynamics(q, u, tau, None, parameters, **time)
        return self._square(jacobian(udot, [*tau], Subroutines()))

    def _square(self, matrix: Matrix) -> Matrix:
        """Return an (n, n) matrix, also of a fully driven mechanism: (0, 0)."""
        n = self._equations.n
        return np.asarray(matrix, dtype=object).reshape(n, n)
