"""Derivatives of a robot's quantities, by passes over their traced programs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.tracing.differentiation import forward, jacobian, reverse
from kane_dynamics.native.tracing.program import Shape, size_of, trace_program
from kane_dynamics.native.tracing.subroutine import inlined, Subroutines
from kane_dynamics.robot.quantities import Quantity
import numpy as np

Equations = TreeEquations | ConstrainedEquations
PARAMETERS = {'gravity': slice(0, 3), 'payload': slice(3, 13)}  # in the block of parameters


@dataclass(frozen=True)
class Derivative:
    """
    A derivative of a quantity.

    Attributes
    ----------
    mode : str
        'vjp', of a cotangent: the gradients of its product with the quantity, one after the other;
        'jvp', of a tangent for each input: the directional derivative;
        'derivative': the Jacobian, with one more axis, the inputs one after the other.
    by : tuple of str
        Names of the inputs.

    """

    mode: str
    by: tuple[str, ...]

    def label(self, name: str) -> str:
        """Return the name of the kernel."""
        return f'{self.mode} of {name} by {", ".join(self.by)}'

    def arguments(self, shapes: Mapping[str, Shape], result: Shape) -> list[Argument]:
        """Return the arguments that precede those of the quantity."""
        if self.mode == 'vjp':
            return [Argument('cotangent', result)]
        if self.mode == 'jvp':
            return [Argument(f'd{name}', shapes[name]) for name in self.by]
        return []

    def shape(self, shapes: Mapping[str, Shape], result: Shape) -> Shape:
        """Return the shape of the kernel's result."""
        if self.mode == 'jvp':
            return result
        count = sum(size_of(shapes[name]) for name in self.by)
        return (count,) if self.mode == 'vjp' else (*result, count)

    def traced(self, result: Any, given: Mapping[str, Any]) -> Any:
        """Return the derivative of a traced result; `given` holds the inputs by name."""
        inputs = [x for name in self.by for x in np.ravel(differentiable(given, name))]
        flat = np.ravel(np.asarray(result, dtype=object))
        if self.mode == 'vjp':
            return np.array(reverse(flat, np.ravel(given['cotangent']), inputs, Subroutines()),
                            dtype=object)
        if self.mode == 'jvp':
            tangents = [dx for name in self.by for dx in np.ravel(given[f'd{name}'])]
            return np.array(forward(flat, inputs, tangents, Subroutines()),
                            dtype=object).reshape(np.shape(result))
        return jacobian(result, inputs, Subroutines())


def differentiable(given: Mapping[str, Any], name: str) -> Any:
    """Return the inputs of a name: an argument of the kernel, or a part of its parameters."""
    return given['parameters'][PARAMETERS[name]] if name in PARAMETERS else given[name]


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
        M = self._equations.mass_matrix(q, parameters, **time)
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
        W = self._equations.inverse_mass_matrix(q, parameters, **time)
        return np.concatenate([-(W @ np.array(values, dtype=object).reshape(slopes.shape)), W],
                              axis=1)

    def _slopes(self, q: Any, u: Any, udot: Any, parameters: Any, **time: Any) -> Any:
        """Return dtau/dq and dtau/du side by side, (n, n_q + n)."""
        tau = self._equations.inverse_dynamics(q, u, udot, None, parameters, **time)
        return jacobian(tau, [*q, *u], Subroutines())
