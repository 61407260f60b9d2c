"""Derivatives of a robot's quantities: of dynamics as matrices, of any quantity by any input."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.native.tracing.program import size_of
from kane_dynamics.robot.derivative_kernels import Derivative, require_known
from kane_dynamics.robot.methods.dispatch import Dispatch
import numpy as np
from numpy.typing import ArrayLike

Matrices = tuple[Array, Array, Array]
OTHER_NAMES = {'jacobian': 'partial_velocities', 'jacobian_rate': 'partial_velocity_rates',
               'forward_kinematics': 'frame_pose', 'constraint_gap': 'constraint_residual'}


def place_of(name: str) -> tuple[str, str]:
    """Return a quantity and its frame or joint, of 'quantity' or 'quantity:frame'."""
    if not isinstance(name, str):
        raise InputError(f'name: a {type(name).__name__}; expected the name of a quantity, '
                         "such as 'inverse_dynamics'")
    quantity, _, at = name.partition(':')
    return OTHER_NAMES.get(quantity, quantity), at


class DerivativeMethods(Dispatch):
    """
    The methods of `Robot` for derivatives, for every kind of robot.

    `vjp`, `jvp` and `derivative` differentiate the compiled program of any quantity, in reverse or
    forward mode, exactly (see `native.tracing.differentiation`). With chosen speeds, u is held
    fixed where q varies. Under constraints all n_q entries of q vary independently; for the
    change along an admissible motion, multiply by dq'/du: ``derivative(name, q, ..., by='q') @
    derivative('joint_rates', q, u, by='u')``. Where a user-defined function is not smooth (abs,
    minimum, maximum, where, sign, floor), the derivative is that of the branch that gives the
    value: of abs(x) it is 1 at 0, of minimum(x, y) and maximum(x, y) at x = y that of x.
    """

    def inverse_dynamics_derivatives(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                                     wrench: ArrayLike | None = None,
                                     t: ArrayLike = 0.0) -> Matrices:
        """
        Return dtau/dq, (n, n_q), dtau/du and M = dtau/dudot, (n, n) each, analytically.

        Friction (smoothed) and springs included; arguments as `inverse_dynamics`.
        """
        by_q, by_u, M = self._matrices('inverse_dynamics_derivatives', (q, u, udot), t)
        if wrench is not None:
            by_q = by_q - self.derivative('external_force', q, by='q', wrench=wrench, t=t)
        return by_q, by_u, M

    def forward_dynamics_derivatives(self, q: ArrayLike, u: ArrayLike, tau: ArrayLike, *,
                                     wrench: ArrayLike | None = None,
                                     t: ArrayLike = 0.0) -> Matrices:
        """
        Return dudot/dq, (n, n_q), dudot/du and M^-1 = dudot/dtau, (n, n) each.

        Arguments as `forward_dynamics`. One kernel; with wrenches, or more than 16 degrees of
        freedom, three kernels and NumPy products.
        """
        if wrench is None and 'forward_dynamics_derivatives' in self.kernels.names:
            return self._matrices('forward_dynamics_derivatives', (q, u, tau), t)
        robot: Any = self
        udot = robot.forward_dynamics(q, u, tau, wrench=wrench, t=t)
        by_q, by_u, _ = self.inverse_dynamics_derivatives(q, u, udot, wrench=wrench, t=t)
        inverse = robot.inverse_mass_matrix(q, t=t)
        return -(inverse @ by_q), -(inverse @ by_u), inverse

    def vjp(self, name: str, cotangent: ArrayLike, *arguments: ArrayLike,
            by: str | Sequence[str] | None = None, wrench: ArrayLike | None = None,
            t: ArrayLike = 0.0) -> Any:
        """
        Return the vector-Jacobian product: the gradients of sum(cotangent * quantity).

        By reverse mode: for all inputs together about 2 to 3 times the operations of the quantity.

        Parameters
        ----------
        name : str
            A quantity, as `operation_count` lists them; of a frame or joint
            ``'frame_pose:<frame>'``, ``'jacobian:<frame>'``, ``'joint_reaction:<joint>'`` and the
            like.
        cotangent : array_like
            The weight of each entry of the quantity, of its shape; (N, ...) for a batch.
        *arguments : array_like
            Those of the quantity's method, in its order, without frame and joint; one state or a
            batch.
        by : str or sequence of str, optional
            Inputs to differentiate by: arguments of the quantity, 'wrench', 't' (if the equations
            depend on time), 'gravity', 'payload' (its ten parameters: mass, mass times center of
            mass, and the integrals of xx, xy, xz, yy, yz, zz over the mass, in the payload frame).
            All of `arguments` by default.
        wrench, t
            As in `inverse_dynamics`.

        Returns
        -------
        array or tuple of arrays
            The gradient of each input, of the shape of the input. One array if `by` is a str.

        Raises
        ------
        InputError
            Names the argument, what was given and what is expected.

        """
        names, single = self._by(name, by)
        flat = self._derived(name, Derivative('vjp', names), (cotangent,), arguments, wrench, t)
        return self._split(name, flat, names, single)

    def jvp(self, name: str, tangents: Mapping[str, ArrayLike], *arguments: ArrayLike,
            wrench: ArrayLike | None = None, t: ArrayLike = 0.0) -> Array:
        """
        Return the Jacobian-vector product: the rate of a quantity for given rates of its inputs.

        By forward mode: about 2 to 3 times the operations of the quantity.

        Parameters
        ----------
        name, arguments, wrench, t
            As in `vjp`.
        tangents : mapping from str to array_like
            The rate of each input that varies, by the names of `by` in `vjp`, of the input's
            shape.

        Returns
        -------
        array
            Of the shape of the quantity.

        Raises
        ------
        InputError
            Names the argument, what was given and what is expected.

        """
        if not isinstance(tangents, Mapping):
            raise InputError(f'tangents: a {type(tangents).__name__}; expected a dictionary from '
                             "names of inputs to their rates, such as {'q': dq}")
        names, _ = self._by(name, tuple(tangents))
        result: Array = self._derived(name, Derivative('jvp', names), tuple(tangents.values()),
                                      arguments, wrench, t)
        return result

    def derivative(self, name: str, *arguments: ArrayLike,
                   by: str | Sequence[str] | None = None, wrench: ArrayLike | None = None,
                   t: ArrayLike = 0.0) -> Any:
        """
        Return the Jacobian of a quantity by its inputs, exact to rounding.

        Forward mode for each input or reverse mode for each entry of the quantity, in one kernel.
        `inverse_dynamics_derivatives` and `forward_dynamics_derivatives` are faster for those two.

        Parameters
        ----------
        name, arguments, by, wrench, t
            As in `vjp`.

        Returns
        -------
        array or tuple of arrays
            For each input the derivative, of the quantity's shape followed by the input's, so
            that ``derivative('inverse_dynamics', q, u, udot, by='q')[i, j]`` is dtau_i/dq_j. One
            array if `by` is a str.

        Raises
        ------
        InputError
            Names the argument, what was given and what is expected.

        """
        names, single = self._by(name, by)
        flat = self._derived(name, Derivative('derivative', names), (), arguments, wrench, t)
        return self._split(name, flat, names, single)

    def _by(self, name: str, by: str | Sequence[str] | None) -> tuple[tuple[str, ...], bool]:
        """Return the inputs to differentiate by, and whether a single one was given."""
        quantity, _ = place_of(name)
        shapes = self.kernels.differentiable(quantity)
        names = (self.kernels.arguments(quantity) if by is None else
                 (by,) if isinstance(by, str) else tuple(by))
        require_known(name, names, shapes)
        return names, isinstance(by, str)

    def _derived(self, name: str, derivative: Derivative, leading: tuple[Any, ...],
                 arguments: tuple[Any, ...], wrench: Any, t: Any) -> Array:
        """Call the kernel of a derivative, whose `leading` arguments precede those of `name`."""
        if isinstance(wrench, Mapping):
            robot, rows = self._under(wrench)
            of_frames: Array = robot._derived(  # type: ignore[attr-defined]
                name, derivative, leading, arguments, rows, t)
            return of_frames
        quantity, at = place_of(name)
        expected = self.kernels.arguments(quantity)
        if len(arguments) != len(expected):
            raise InputError(f'{name}: {len(arguments)} arguments; expected {len(expected)}: '
                             f'{", ".join(expected)}')
        kernel = self.kernels.kernel(quantity, at, derivative)
        given = self._at_time(arguments, t)
        if any(argument.name == 'wrench' for argument in kernel.arguments):
            given = (*arguments, wrench, *given[len(arguments):])
        elif wrench is not None:
            raise InputError(f'wrench: given to {name} of this robot; expected a quantity that '
                             'depends on it, and Robot(..., wrench_frames=[...])')
        result: Array = kernel(*leading, *given)
        return result

    def _split(self, name: str, flat: Array, names: Sequence[str], single: bool) -> Any:
        """Return the parts of the last axis for the inputs, each with the input's shape."""
        shapes = self.kernels.differentiable(place_of(name)[0])
        leading = flat.shape[:flat.ndim - 1]
        ends = np.cumsum([size_of(shapes[each]) for each in names])
        parts = tuple(part.reshape((*leading, *shapes[each]))[()] for each, part in zip(
            names, np.split(flat, ends[:-1], axis=-1)))
        return parts[0] if single else parts

    def _matrices(self, name: str, arguments: tuple[Any, ...], t: Any) -> Matrices:
        """Return the three matrices of a kernel that has all of them."""
        kernel = self.kernels.quantity(name)
        entry = self._entry(name, '', lambda _: kernel)
        result = entry(*self._at_time(arguments, t))
        if len(kernel.shape) == 3:
            return result[..., 0, :, :], result[..., 1, :, :], result[..., 2, :, :]
        n_q, n = self.n_q, self.n
        return result[..., :n_q], result[..., n_q:n_q + n], result[..., n_q + n:]
