"""Derivatives of a robot's quantities, by passes over their traced programs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.tracing.differentiation import forward, jacobian, reverse
from kane_dynamics.native.tracing.program import Shape, size_of, trace_program
from kane_dynamics.native.tracing.subroutine import inlined, Subroutines
from kane_dynamics.robot.quantities import Quantity
import numpy as np

PARAMETERS = {'gravity': slice(0, 3), 'payload': slice(3, 13)}  # in the block of parameters


@dataclass(frozen=True)
class Derivative:
    """
    A derivative of a quantity, or of another derivative of it.

    Attributes
    ----------
    mode : str
        'vjp', of a cotangent: the gradients of its product with the quantity, one after the other;
        'jvp', of a tangent for each input: the directional derivative;
        'derivative': the Jacobian, with one more axis, the inputs one after the other;
        'value': the quantity itself.
    by : tuple of str
        Names of the inputs; cotangents and tangents of `of` are inputs, too.
    of : Derivative, optional
        What is differentiated; by default the quantity.
    own : tuple of str
        Run-time parameters that are arguments of each state, of the innermost derivative.

    """

    mode: str
    by: tuple[str, ...] = ()
    of: 'Derivative | None' = None
    own: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the run-time parameters that are arguments of each state."""
        return self.own if self.of is None else self.of.parameters

    @property
    def _end(self) -> str:
        """Return the end of the names of cotangents and tangents, which counts the order."""
        order, inner = 1, self.of
        while inner is not None and inner.mode != 'value':
            order, inner = order + 1, inner.of
        return '' if order == 1 else f'_{order}'

    def label(self, name: str) -> str:
        """Return the name of the kernel."""
        if self.of is not None:
            name = self.of.label(name)
        if self.mode != 'value':
            return f'{self.mode} of {name} by {", ".join(self.by)}'
        return f'{name} of {", ".join(self.own)}' if self.own else name

    def seeds(self, shapes: Mapping[str, Shape], result: Shape) -> list[Argument]:
        """Return the cotangent, or the tangents, of this derivative and of those within."""
        inner = [] if self.of is None else self.of.seeds(shapes, result)
        shapes, result = self._of(shapes, result)
        if self.mode == 'vjp':
            return [Argument(f'cotangent{self._end}', result), *inner]
        if self.mode == 'jvp':
            return [*(Argument(f'd{name}{self._end}', shapes[name]) for name in self.by), *inner]
        return inner

    def shape(self, shapes: Mapping[str, Shape], result: Shape) -> Shape:
        """Return the shape of the kernel's result."""
        shapes, result = self._of(shapes, result)
        if self.mode in ('jvp', 'value'):
            return result
        count = sum(size_of(shapes[name]) for name in self.by)
        return (count,) if self.mode == 'vjp' else (*result, count)

    def _of(self, shapes: Mapping[str, Shape],
            result: Shape) -> tuple[Mapping[str, Shape], Shape]:
        """Return the shapes of the inputs and of the result of what is differentiated."""
        if self.of is None:
            return shapes, result
        return ({**shapes, **{seed.name: seed.shape for seed in self.of.seeds(shapes, result)}},
                self.of.shape(shapes, result))

    def traced(self, result: Any, given: Mapping[str, Any]) -> Any:
        """Return the derivative of a traced result; `given` holds the inputs by name."""
        if self.of is not None:
            result = self.of.traced(result, given)
        inputs = [x for name in self.by for x in np.ravel(differentiable(given, name))]
        flat = np.ravel(np.asarray(result, dtype=object))
        if self.mode == 'vjp':
            return np.array(reverse(flat, np.ravel(given[f'cotangent{self._end}']), inputs,
                                    Subroutines()), dtype=object)
        if self.mode == 'jvp':
            tangents = [dx for name in self.by for dx in np.ravel(given[f'd{name}{self._end}'])]
            return np.array(forward(flat, inputs, tangents, Subroutines()),
                            dtype=object).reshape(np.shape(result))
        return result if self.mode == 'value' else jacobian(result, inputs, Subroutines())


def differentiable(given: Mapping[str, Any], name: str) -> Any:
    """Return the inputs of a name: an argument of the kernel, or a part of its parameters."""
    return given[name] if name in given else given['parameters'][PARAMETERS[name]]


def block_of(given: Mapping[str, Any]) -> Any:
    """Return the block of parameters, with those that are arguments in their places."""
    block = np.array(given['parameters'], dtype=object)
    for name, part in PARAMETERS.items():
        if name in given:
            block[part] = given[name]
    return block


def shapes_by_name(arguments: Sequence[Argument], quantity: Quantity,
                   physical: int) -> dict[str, Shape]:
    """Return the shapes of all inputs by which a quantity can be differentiated."""
    shapes = {argument.name: argument.shape for argument in arguments}
    if quantity.parameters:
        shapes |= {name: (part.stop - part.start,) for name, part in PARAMETERS.items()
                   if part.stop <= physical}
    return shapes


def require_known(name: str, by: Sequence[str], shapes: Mapping[str, Shape]) -> None:
    """Raise InputError if a quantity cannot be differentiated by one of these names."""
    wrong = [each for each in by if each not in shapes]
    if wrong or not by or len(set(by)) < len(by):
        raise InputError(f'by: {", ".join(map(repr, by)) or "none"}; expected for {name} some of '
                         f'{", ".join(shapes)}, each once')


class SlopesOfDynamics:
    """
    The derivatives of dynamics for equations that have no recursion of their own for them.

    Those are chosen speeds, constraints and beams.
    """

    def __init__(self, equations: Equations) -> None:
        """Store the equations."""
        self._equations: Any = equations

    def inverse_dynamics_derivatives(self, q: Any, u: Any, udot: Any, parameters: Any,
                                     **time: Any) -> Any:
        """Return dtau/dq, dtau/du and M side by side, (n, n_q + 2 n), no external wrenches."""
        M = self._square(self._equations.mass_matrix(q, parameters, **time))
        return np.concatenate([self._slopes(q, u, udot, parameters, **time), M], axis=1)

    def forward_dynamics_derivatives(self, q: Any, u: Any, tau: Any, parameters: Any,
                                     **time: Any) -> Any:
        """
        Return dudot/dq, dudot/du and M^-1 side by side, (n, n_q + 2 n), no external wrenches.

        From tau = M udot + h: dudot = -M^-1 dtau, with the dtau of inverse dynamics at udot.
        """
        inputs = {'q': q, 'u': u, 'udot': u, 'parameters': parameters,
                  **{name: np.asarray(x, dtype=object) for name, x in time.items()}}
        slopes = trace_program('slopes', lambda *given: self._slopes(
            *given[:4], **{name: x[()] for name, x in zip(time, given[4:])}),
            [(name, np.shape(x)) for name, x in inputs.items()])
        inputs['udot'] = self._equations.forward_dynamics(q, u, tau, None, parameters, **time)
        values = inlined(slopes, [x for array in inputs.values() for x in np.ravel(array)])
        W = self._square(self._equations.inverse_mass_matrix(q, parameters, **time))
        return np.concatenate([-(W @ np.array(values, dtype=object).reshape(slopes.shape)), W],
                              axis=1)

    def _slopes(self, q: Any, u: Any, udot: Any, parameters: Any, **time: Any) -> Any:
        """Return dtau/dq and dtau/du side by side, (n, n_q + n)."""
        tau = self._equations.inverse_dynamics(q, u, udot, None, parameters, **time)
        return jacobian(tau, [*q, *u], Subroutines())

    def _square(self, matrix: Any) -> Any:
        """Return an (n, n) matrix, also of a fully driven mechanism: (0, 0)."""
        n = self._equations.n
        return np.asarray(matrix, dtype=object).reshape(n, n)
