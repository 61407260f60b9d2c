"""The dynamics of a robot: inverse and forward, mass matrix, derivatives, energies."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
import math
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.friction import holding_interval
from kane_dynamics.mechanics.recursive.regressor import inertial_parameters
from kane_dynamics.mechanics.recursive.tree_equations import TORQUE_TERMS
from kane_dynamics.native.runtime.kernel import Argument, converted
from kane_dynamics.robot.derivative_kernels import Derivative, require_known
from kane_dynamics.robot.methods.dispatch import (compiled, Dispatch, of_frame,
                                                  of_one_frame)
from kane_dynamics.robot.torque_breakdown import SOURCES, TorqueBreakdown
import numpy as np
from numpy.typing import ArrayLike


FRICTION_TERM = TORQUE_TERMS.index('friction')
Matrices = tuple[Array, Array, Array]
OTHER_NAMES = {'jacobian': 'partial_velocities',
               'jacobian_rate': 'partial_velocity_rates'}


def place_of(name: str) -> tuple[str, str]:
    """Return a quantity and its frame or joint, of 'quantity' or 'quantity:frame'."""
    if not isinstance(name, str):
        raise InputError(f'name: a {type(name).__name__}; expected the name of a '
                         "quantity, such as 'inverse_dynamics'")
    quantity, _, at = name.partition(':')
    return OTHER_NAMES.get(quantity, quantity), at


class DynamicsMethods(Dispatch):
    """
    The methods of `Robot` for dynamics, and for derivatives of any quantity.

    Every method accepts one state, (n,) arrays, or a batch, (N, n) arrays, and returns
    the same; q has n_q entries, more than n under constraints and with ball joints.

    `vjp`, `jvp` and `derivative` differentiate the compiled program of any quantity, in
    reverse or forward mode, exactly (see `native.tracing.differentiation`). With chosen
    speeds, u is held fixed where q varies. Under constraints all n_q entries of q vary
    independently; for the change along an admissible motion, multiply by dq'/du:
    ``derivative(name, q, ..., by='q') @ derivative('joint_rates', q, u, by='u')``. Where
    a user-defined function is not smooth (abs, minimum, maximum, where, sign, floor),
    the derivative is that of the branch that gives the value. For abs(x) at 0 it is 1. For
    minimum(x, y) and maximum(x, y) at x = y it is that of x.
    """

    @compiled
    def inverse_dynamics(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                         wrench: ArrayLike | None = None, t: ArrayLike = 0.0,
                         out: Array | None = None) -> Array:
        """
        Return tau = M udot + bias - external, (n,), N m or N.

        Parameters
        ----------
        q, u, udot : (n,) or (N, n) arrays
            Coordinates, speeds and their rates; rad or m, s.
        wrench : mapping of str to (6,) or (N, 6) arrays, or (k, 6) or (N, k, 6) array
            External wrenches by frame: force then moment, at the frame's origin, world
            axes, N and N m. An array has one row for each of the `wrench_frames`, and is
            the fastest; of a single frame it may be (6,). Other frames need a mapping;
            their kernels compile at the first call.
        t : float or (N,) array
            Time, s; ignored unless speeds or constraints depend on it.
        out : array, optional
            Written to and returned.

        Raises
        ------
        InputError
            Names the argument, what was given and what is expected.

        """
        return self._loaded('inverse_dynamics', (q, u, udot), wrench, out, t)

    @compiled
    def forward_dynamics(self, q: ArrayLike, u: ArrayLike, tau: ArrayLike, *,
                         wrench: ArrayLike | None = None, t: ArrayLike = 0.0,
                         out: Array | None = None) -> Array:
        """Return udot = M^-1 (tau + external - bias), (n,); see inverse_dynamics."""
        return self._loaded('forward_dynamics', (q, u, tau), wrench, out, t)

    @compiled
    def mass_matrix(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                    out: Array | None = None) -> Array:
        """Return M(q), (n, n), armature included, kg m^2, kg m or kg."""
        return self._call('mass_matrix', (q,), out, t)

    @compiled
    def inverse_mass_matrix(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                            out: Array | None = None) -> Array:
        """Return the inverse of M(q), (n, n)."""
        return self._call('inverse_mass_matrix', (q,), out, t)

    @compiled
    def bias_force(self, q: ArrayLike, u: ArrayLike, *, t: ArrayLike = 0.0,
                   out: Array | None = None) -> Array:
        """Return h(q, u), (n,): Coriolis, centrifugal, gravity, friction, springs."""
        return self._call('bias_force', (q, u), out, t)

    @compiled
    def coriolis_matrix(self, q: ArrayLike, u: ArrayLike, *, t: ArrayLike = 0.0,
                        out: Array | None = None) -> Array:
        """
        Return C(q, u), (n, n): C u is the Coriolis and centrifugal force.

        dM/dt = C + C^T. In joint rates C is the matrix of the Christoffel symbols, half
        the derivative of C u with respect to u; otherwise its projection on the
        independent speeds. Where speeds or constraints depend on time, C u lacks the
        force of the motion that they prescribe at u = 0.
        """
        return self._call('coriolis_matrix', (q, u), out, t)

    @compiled
    def gravity_force(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                      out: Array | None = None) -> Array:
        """Return the torque that balances gravity alone, (n,), N m or N."""
        return self._call('gravity_force', (q,), out, t)

    @compiled
    def friction_force(self, u: ArrayLike, q: ArrayLike | None = None, *,
                       t: ArrayLike = 0.0,
                       out: Array | None = None) -> Array:
        """
        Return the torque that overcomes friction without load, (n,), N m or N.

        By `mechanics.friction.friction_torque`; friction that depends on the load of a
        drive is in `inverse_dynamics` and `torque_terms`. With chosen speeds or
        constraints it depends on q; other robots ignore q and t.
        """
        # In joint rates each joint has its own; otherwise T(q) projects it.
        if self.equations.in_joint_rates:
            return self._call('friction_force', (u,), out)
        if q is None:
            raise InputError('q: missing; expected the configuration, on which the '
                             'friction of a robot with chosen speeds or constraints '
                             'depends')
        return self._call('friction_force', (u, q), out, t)

    def holding_torques(self, q: ArrayLike, *,
                        wrench: ArrayLike | None = None) -> tuple[Array, Array]:
        """
        Return the least and the largest torques with which motors hold the robot at rest.

        Friction of a joint at rest is any torque up to breakaway friction, so that every
        torque between the two holds the joint, and others move it. A self-locking drive
        holds its load also without torque.

        Parameters
        ----------
        q : (n,) or (N, n) array_like
            rad or m.
        wrench : (k, 6) or (N, k, 6) array_like, optional
            External wrenches, as of `inverse_dynamics`.

        Returns
        -------
        least, largest : (n,) or (N, n) arrays
            N m or N.

        Raises
        ------
        InputError
            The robot has chosen speeds or constraints: there the torques that hold are
            no intervals of single joints.

        """
        if not self.equations.in_joint_rates:
            raise InputError('holding_torques: of a robot with chosen speeds, constraints '
                             'or ball joints; expected a tree in joint rates, since '
                             'joints share what holds others')
        u = np.zeros_like(converted(Argument('q', (self.n_q,), self.coordinate_names), q))
        # At rest the drives carry gravity, springs and wrenches; friction holds up to
        # breakaway.
        terms = self.torque_terms(q, u, u)
        load = terms.sum(axis=-2) - terms[..., FRICTION_TERM, :]
        if wrench is not None:
            load = load - self.external_force(q, wrench=wrench)
        least, largest = load.copy(), load.copy()
        # Each joint's interval of friction, under the load that it has.
        equations = self.equations
        joints = [body.joint for body in equations.model.bodies if equations.friction]
        for joint in joints:
            k = joint.coordinate
            low, high = holding_interval(joint, load[..., k])
            least[..., k] += low
            largest[..., k] += high
        return least, largest

    @compiled
    def external_force(self, q: ArrayLike, *, wrench: ArrayLike | None = None,
                       t: ArrayLike = 0.0,
                       out: Array | None = None) -> Array:
        """Return the generalized force of wrenches at the declared frames, (n,)."""
        return self._loaded('external_force', (q,), wrench, out, t)

    @compiled
    def torque_terms(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                     t: ArrayLike = 0.0,
                     out: Array | None = None) -> Array:
        """Return inverse dynamics by source, (5, n): the rows of `TORQUE_TERMS`."""
        return self._call('torque_terms', (q, u, udot), out, t)

    @compiled
    def body_torques(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                     t: ArrayLike = 0.0,
                     out: Array | None = None) -> Array:
        """
        Return the torque of each body at every joint, (n_bodies, n).

        Of its inertia and weight, and of a beam's elasticity and material damping.
        """
        return self._call('body_torques', (q, u, udot), out, t)

    @compiled
    def joint_reactions(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                        wrench: ArrayLike | None = None, t: ArrayLike = 0.0,
                        out: Array | None = None) -> Array:
        """Return `joint_reaction` of every body's joint, (n_bodies, 6)."""
        return self._loaded('joint_reactions', (q, u, udot), wrench, out, t)

    def explain(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                wrench: ArrayLike | None = None, t: ArrayLike = 0.0) -> TorqueBreakdown:
        """Return the torque breakdown by source and by body; see `inverse_dynamics`."""
        external: Any = self.external_force(q, wrench=wrench, t=t)
        terms = self.torque_terms(q, u, udot, t=t)
        model = self.equations.model
        # What wrenches contribute has the opposite sign: they relieve the actuators.
        return TorqueBreakdown(
            np.concatenate([terms, 0.0 - external[..., None, :]], axis=-2),
            self.body_torques(q, u, udot, t=t), SOURCES,
            tuple(body.name for body in model.bodies),
            tuple(self.equations.speed_names))

    @compiled
    def regressor(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                  t: ArrayLike = 0.0,
                  out: Array | None = None) -> Array:
        """
        Return the regressor Y, (n, 10 n_bodies), of `inertial_parameters`.

        Y times `inertial_parameters` is the torque. The torque is that of rigid bodies:
        inverse dynamics without armature, friction, springs, payload and wrenches.
        `mechanics.recursive.regressor` defines the order of parameters.
        """
        return self._call('regressor', (q, u, udot), out, t)

    @property
    def inertial_parameters(self) -> Array:
        """Inertial parameters of the model, (10 n_bodies,), in the regressor's order."""
        return inertial_parameters(self.equations.model)

    @compiled
    def center_of_mass(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                       out: Array | None = None) -> Array:
        """Return the center of mass of moving bodies and payload, (3,), m."""
        return self._call('center_of_mass', (q,), out, t)

    @compiled
    def center_of_mass_jacobian(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                                out: Array | None = None) -> Array:
        """Return the Jacobian of `center_of_mass`, (3, n)."""
        return self._call('center_of_mass_jacobian', (q,), out, t)

    @compiled
    def centroidal_momentum(self, q: ArrayLike, u: ArrayLike, *, t: ArrayLike = 0.0,
                            out: Array | None = None) -> Array:
        """
        Return the momentum of moving bodies and payload, (6,), kg m/s and kg m^2/s.

        Linear, then angular about `center_of_mass`, world axes. Rotors that armature
        stands for have no part in it. Source: D. Orin, A. Goswami & S.-H. Lee,
        "Centroidal dynamics of a humanoid robot", Autonomous Robots 35, 2013.
        """
        return self._call('centroidal_momentum', (q, u), out, t)

    @compiled
    def centroidal_momentum_matrix(self, q: ArrayLike, *, t: ArrayLike = 0.0,
                                   out: Array | None = None) -> Array:
        """
        Return the Jacobian of `centroidal_momentum` by the speeds, (6, n).

        The momentum is this matrix times u, and that of the motion at u = 0 where speeds
        or constraints depend on time.
        """
        return self._call('centroidal_momentum_matrix', (q,), out, t)

    @compiled
    def centroidal_momentum_rate(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                                 t: ArrayLike = 0.0, out: Array | None = None) -> Array:
        """
        Return the time derivative of `centroidal_momentum`, (6,), N and N m.

        It is the wrench of the base and of gravity on the moving bodies, about their
        center of mass.
        """
        return self._call('centroidal_momentum_rate', (q, u, udot), out, t)

    @compiled
    def kinetic_energy(self, q: ArrayLike, u: ArrayLike, *, t: ArrayLike = 0.0,
                       out: Array | None = None) -> Any:
        """Return 1/2 u^T M u, J; a float, or (N,) for a batch."""
        return self._call('kinetic_energy', (q, u), out, t)

    @compiled
    def potential_energy(self, q: ArrayLike, *, out: Array | None = None) -> Any:
        """Return the energy of gravity (zero at the world's origin) and springs, J."""
        return self._call('potential_energy', (q,), out)

    @of_frame('joint_reaction')
    def joint_reaction(self, joint: str, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                       wrench: ArrayLike | None = None, t: ArrayLike = 0.0,
                       out: Array | None = None) -> Array:
        """
        Return the wrench of the parent on the child at a joint, (6,), N, N m.

        Force, then moment. At the joint's origin, in world axes; includes the torque of
        actuator and friction about the axis, all loads, and the forces of
        `constraint_forces`.

        Parameters
        ----------
        joint : str
            A moving joint; fixed and locked joints are merged into bodies.
        q, u, udot, wrench, t, out
            As in `inverse_dynamics`.

        Raises
        ------
        InputError
            An unknown joint; the message lists the valid ones.

        """
        if not isinstance(joint, str):
            raise InputError(f'joint: a {type(joint).__name__}; expected a name (str): '
                             'the order is (joint, q, u, udot)')
        return self._loaded('joint_reaction', (q, u, udot), wrench, out, t, joint)

    @compiled
    def inverse_dynamics_derivatives(self, q: ArrayLike, u: ArrayLike, udot: ArrayLike,
                                     *,
                                     wrench: ArrayLike | None = None,
                                     t: ArrayLike = 0.0) -> Matrices:
        """
        Return dtau/dq, (n, n_q), dtau/du and M = dtau/dudot, (n, n) each, analytically.

        Friction (smoothed) and springs included; arguments as `inverse_dynamics`.
        """
        by_q, by_u, M = self._matrices('inverse_dynamics_derivatives', (q, u, udot), t)
        # The torque is tau = f(q, u, udot) - sum of J^T w, with a wrench w that stays
        # the same.
        if wrench is not None:
            by_q = by_q - self.derivative('external_force', q, by='q', wrench=wrench,
                                          t=t)
        return by_q, by_u, M

    @compiled
    def forward_dynamics_derivatives(self, q: ArrayLike, u: ArrayLike, tau: ArrayLike, *,
                                     wrench: ArrayLike | None = None,
                                     t: ArrayLike = 0.0) -> Matrices:
        """
        Return dudot/dq, (n, n_q), dudot/du and M^-1 = dudot/dtau, (n, n) each.

        Arguments as `forward_dynamics`. One kernel; with wrenches, or more than 16
        degrees of freedom, three kernels and NumPy products.
        """
        if wrench is None and 'forward_dynamics_derivatives' in self.kernels.names:
            return self._matrices('forward_dynamics_derivatives', (q, u, tau), t)
        # By the implicit function theorem: tau(q, u, udot) is constant, so that M dudot
        # = -dtau.
        udot = self.forward_dynamics(q, u, tau, wrench=wrench, t=t)
        by_q, by_u, _ = self.inverse_dynamics_derivatives(q, u, udot, wrench=wrench, t=t)
        inverse = self.inverse_mass_matrix(q, t=t)
        return -(inverse @ by_q), -(inverse @ by_u), inverse

    def vjp(self, name: str, cotangent: ArrayLike, *arguments: ArrayLike,
            by: str | Sequence[str] | None = None, wrench: ArrayLike | None = None,
            t: ArrayLike = 0.0) -> Any:
        """
        Return the vector-Jacobian product: the gradients of sum(cotangent * quantity).

        By reverse mode: for all inputs together about 2 to 3 times the operations of the
        quantity.

        Parameters
        ----------
        name : str
            A quantity, as `operation_count` lists them; of a frame or joint
            ``'frame_pose:<frame>'``, ``'jacobian:<frame>'``,
            ``'joint_reaction:<joint>'`` and the like.
        cotangent : array_like
            The weight of each entry of the quantity, of its shape; (N, ...) for a batch.
        *arguments : array_like
            Those of the quantity's method, in its order, without frame and joint; one
            state or a batch.
        by : str or sequence of str, optional
            Inputs to differentiate by: arguments of the quantity, 'wrench', 't' (if the
            equations depend on time), 'gravity', 'payload' (its ten parameters: mass,
            mass times center of mass, and the integrals of xx, xy, xz, yy, yz, zz over
            the mass, in the payload frame). All of `arguments` by default.
        wrench, t
            As in `inverse_dynamics`.

        Returns
        -------
        array or tuple of arrays
            The gradient of each input, of the shape of the input. One array if `by` is a
            str.

        Raises
        ------
        InputError
            Names the argument, what was given and what is expected.

        """
        names, single = self._by(name, by)
        flat = self._derived(name, Derivative('vjp', names), (cotangent,), arguments,
                             wrench, t)
        return self._split(name, flat, names, single)

    def jvp(self, name: str, tangents: Mapping[str, ArrayLike], *arguments: ArrayLike,
            wrench: ArrayLike | None = None, t: ArrayLike = 0.0) -> Array:
        """
        Return the Jacobian-vector product: the rate of a quantity.

        The rate for given rates of its inputs. By forward mode: about 2 to 3 times the
        operations of the quantity.

        Parameters
        ----------
        name, arguments, wrench, t
            As in `vjp`.
        tangents : mapping from str to array_like
            The rate of each input that varies, by the names of `by` in `vjp`, of the
            input's shape.

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
            raise InputError(f'tangents: a {type(tangents).__name__}; expected a '
                             'dictionary from '
                             "names of inputs to their rates, such as {'q': dq}")
        # The rates are inputs beside the state: one pass, whatever the number of
        # results.
        names, _ = self._by(name, tuple(tangents))
        result: Array = self._derived(name, Derivative('jvp', names),
                                      tuple(tangents.values()), arguments, wrench, t)
        return result

    def derivative(self, name: str, *arguments: ArrayLike,
                   by: str | Sequence[str] | None = None,
                   wrench: ArrayLike | None = None,
                   t: ArrayLike = 0.0) -> Any:
        """
        Return the Jacobian of a quantity by its inputs, exact to rounding.

        Forward mode for each input or reverse mode for each entry of the quantity, in
        one kernel. `inverse_dynamics_derivatives` and `forward_dynamics_derivatives` are
        faster for those two.

        Parameters
        ----------
        name, arguments, by, wrench, t
            As in `vjp`.

        Returns
        -------
        array or tuple of arrays
            For each input the derivative, of the quantity's shape followed by the
            input's, so that ``derivative('inverse_dynamics', q, u, udot, by='q')[i, j]``
            is dtau_i/dq_j. One array if `by` is a str.

        Raises
        ------
        InputError
            Names the argument, what was given and what is expected.

        """
        # All derivatives as one matrix, split by inputs.
        names, single = self._by(name, by)
        flat = self._derived(name, Derivative('derivative', names), (), arguments,
                             wrench, t)
        return self._split(name, flat, names, single)

    def _by(self, name: str, by: str | Sequence[str] | None) -> tuple[tuple[str, ...],
                                                                      bool]:
        """Return the inputs to differentiate by, and whether a single one was given."""
        quantity, _ = place_of(name)
        shapes = self.kernels.differentiable(quantity)
        names = self.kernels.arguments(quantity)
        # Without a choice, all arguments of the kernel.
        if by is not None:
            if not isinstance(by, Iterable):
                raise InputError(f'by: {by!r}; expected for {name} some of '
                                 f'{", ".join(shapes)}')
            names = (by,) if isinstance(by, str) else tuple(map(str, by))
        require_known(name, names, shapes)
        return names, isinstance(by, str)

    def _derived(self, name: str, derivative: Derivative, leading: tuple[Any, ...],
                 arguments: tuple[Any, ...], wrench: Any, t: Any) -> Array:
        """Call the kernel of a derivative; `leading` arguments precede the others."""
        if isinstance(wrench, Mapping):
            robot, rows = self._under(wrench)
            return robot._derived(name, derivative, leading, arguments, rows, t)
        quantity, at = place_of(name)
        expected = self.kernels.arguments(quantity)
        if len(arguments) != len(expected):
            raise InputError(f'{name}: {len(arguments)} arguments; expected '
                             f'{len(expected)}: '
                             f'{", ".join(expected)}')
        kernel = self.kernels.kernel(quantity, at, derivative)
        # Seeds first, then the arguments, the wrench and the time, as the kernel has
        # them.
        inputs = self._at_time(arguments, t)
        if any(argument.name == 'wrench' for argument in kernel.arguments):
            with suppress(ValueError):  # rows of several lengths, which the kernel refuses
                wrench = of_one_frame(wrench, np.shape(arguments[0])[:-1],
                                      len(self.equations.wrench_frames))
            inputs = (*arguments, wrench, *inputs[len(arguments):])
        elif wrench is not None:
            raise InputError(f'wrench: given to {name} of this robot; expected a '
                             'quantity that depends on it, and Robot(..., '
                             'wrench_frames=[...])')
        result: Array = kernel(*leading, *inputs)
        return result

    def _split(self, name: str, flat: Array, names: Sequence[str], single: bool) -> Any:
        """Return the parts of the last axis for the inputs, with their shapes."""
        shapes = self.kernels.differentiable(place_of(name)[0])
        leading = flat.shape[:flat.ndim - 1]
        ends = np.cumsum([math.prod(shapes[input_name]) for input_name in names])
        parts = []
        for input_name, part in zip(names, np.split(flat, ends[:-1], axis=-1)):
            parts.append(part.reshape((*leading, *shapes[input_name]))[()])
        return parts[0] if single else tuple(parts)

    def _matrices(self, name: str, arguments: tuple[Any, ...], t: Any) -> Matrices:
        """Return the three matrices of a kernel that has all of them."""
        result = self._call(name, arguments, None, t)
        if len(self.kernels.kernel(name).shape) == 3:
            return result[..., 0, :, :], result[..., 1, :, :], result[..., 2, :, :]
        n_q, n = self.n_q, self.n
        return result[..., :n_q], result[..., n_q:n_q + n], result[..., n_q + n:]
