"""The kernels of one robot: what each computes, how it is traced, and the one of each made."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.mechanics import frames
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.factorization import solve
from kane_dynamics.mechanics.sharing import directly, Share
from kane_dynamics.mechanics.vector import is_zero
from kane_dynamics.model import Array
from kane_dynamics.native.expression import call
from kane_dynamics.native.kernels import Argument, Kernel
from kane_dynamics.native.outline import Outline
from kane_dynamics.native.program import Program, Shape, trace_program
from kane_dynamics.quantities import FRAME_QUANTITIES, JOINT_REACTION, QUANTITIES, Quantity
import numpy as np

LARGE = 24  # coordinates from which on an inverse is not written out
LONG = 16  # and from which on a product with it is none of the compiler's business
OUTLINED = 40  # and from which on derivatives would
SHARING = ('coriolis_matrix', 'inverse_dynamics_derivatives', 'regressor')
FEEDBACK = ('q', 'u', 'q_d', 'u_d', 'udot_d')  # arguments of computed torque before the gains


class KernelSet:
    """
    The kernels of one robot, each compiled at its first use.

    Parameters
    ----------
    equations : Equations
    key : str
        Everything that the equations depend on, for the cache.
    parameters : array
        The block that kernels read at each call.

    """

    def __init__(self, equations: Equations, key: str, parameters: Array) -> None:
        """Compile nothing yet."""
        self.equations = equations
        self.no_wrench = np.zeros((len(equations.wrench_frames), 6))
        self._key = key
        self._parameters = parameters
        self._made: dict[tuple[str, str], Kernel] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the `QUANTITIES` that are one kernel; for a large robot not all of them are."""
        return tuple(name for name in QUANTITIES
                     if self.equations.n <= LONG or name != 'forward_dynamics_derivatives')

    def quantity(self, name: str) -> Kernel:
        """Return the kernel of one of `names`; InputError lists them for another name."""
        def make() -> Kernel:
            if name not in self.names:
                raise InputError(f"no kernel '{name}'; valid: {', '.join(self.names)}")
            quantity = QUANTITIES[name]
            return Kernel(name, lambda: self.program(name), self._key, self._arguments(quantity),
                          self._parameters, self._shape(quantity))
        return self._kept((name, ''), make)

    def in_use(self, name: str) -> bool:
        """Tell whether the kernel of one of `QUANTITIES` has been asked for."""
        return (name, '') in self._made

    def at_frame(self, name: str, frame: str) -> Kernel:
        """Return the kernel of one of `FRAME_QUANTITIES`; InputError for an unknown frame."""
        def make() -> Kernel:
            quantity = FRAME_QUANTITIES[name]
            return Kernel(name, lambda: self._frame_program(name, frame), self._key + frame,
                          self._arguments(quantity), self._parameters, self._shape(quantity))
        self.equations.model.frame(frame)
        return self._kept((name, frame), make)

    def reaction(self, joint: str) -> Kernel:
        """Return the kernel of the reaction at a joint; InputError for an unknown joint."""
        model = self.equations.model
        names = [body.joint.name for body in model.bodies]
        if joint not in names:
            raise InputError(f"no moving joint '{joint}'; valid: {', '.join(names) or 'none'} "
                             '(fixed and locked joints are merged into the bodies they join)')
        body = names.index(joint)

        def program() -> Program:
            def function(*inputs: Any) -> Any:
                q, u, udot, *wrench, parameters = inputs
                return self.equations.joint_reaction(body, q, u, udot,
                                                     wrench[0] if wrench else None, parameters)
            return trace_program('joint_reaction', function, self._inputs(JOINT_REACTION))
        return self._kept(('joint_reaction', joint), lambda: Kernel(
            'joint_reaction', program, self._key + joint, self._arguments(JOINT_REACTION),
            self._parameters, self._shape(JOINT_REACTION)))

    def extra(self, name: str, program: Callable[[], Program], arguments: Sequence[Argument],
              block: Array, shape: Shape) -> Kernel:
        """Return a kernel of the caller's own on this robot; `name` tells its program apart."""
        return self._kept((name, ''), lambda: Kernel(name, program, self._key, arguments, block,
                                                     shape))

    def program(self, name: str) -> Program:
        """Trace one of `names`."""
        quantity = QUANTITIES[name]
        if name == 'inverse_mass_matrix' and self.equations.n > LARGE:
            return self._large_inverse()
        method = getattr(self.equations, name)
        if name in SHARING:
            method = partial(method, share=self._share())

        def function(*inputs: Any) -> Any:
            *given, parameters = inputs
            if quantity.wrench and not len(self.no_wrench):
                given.append(None)
            return method(*given, parameters) if quantity.parameters else method(*given)
        return trace_program(name, function, self._inputs(quantity))

    def computed_torque(self) -> Kernel:
        """
        Return the kernel of computed torque.

        Its arguments are q, u measured, q, u, udot desired, and the gains: kp, then kd, (2 n,).
        """
        def make() -> Kernel:
            n = self.equations.n
            arguments = [Argument(name, (n,), self.equations.model.coordinate_names)
                         for name in FEEDBACK] + [Argument('gains', (2 * n,))]
            if len(self.no_wrench):
                arguments.append(Argument('wrench', self.no_wrench.shape,
                                          default=self.no_wrench))
            return Kernel('computed_torque', self.feedback_program, self._key, arguments,
                          self._parameters, (n,))
        return self._kept(('computed_torque', ''), make)

    def feedback_program(self) -> Program:
        """
        Trace the law of computed torque, with friction at the desired speed.

        ``tau = ID_rigid(q, u, udot_d + kd (u_d - u) + kp (q_d - q)) + friction(u_d)``: at the
        measured speed, compensating friction would push a resting arm on.
        """
        n = self.equations.n

        def function(q: Any, u: Any, q_d: Any, u_d: Any, udot_d: Any, gains: Any,
                     *rest: Any) -> Any:
            kp, kd = gains[:n], gains[n:]
            wrench = rest[0] if len(self.no_wrench) else None
            wanted = udot_d + (kd * (u_d - u) + kp * (q_d - q))
            return (np.array(self.equations.rigid_dynamics(q, u, wanted, wrench, rest[-1]))
                    + self.equations.friction_force(u_d))
        inputs: list[tuple[str, Shape]] = [(name, (n,)) for name in FEEDBACK]
        inputs.append(('gains', (2 * n,)))
        if len(self.no_wrench):
            inputs.append(('wrench', self.no_wrench.shape))
        return trace_program('computed_torque', function,
                             [*inputs, ('parameters', self._parameters.shape)])

    def _large_inverse(self) -> Program:
        """Trace M^-1 column by column, the solution as one subroutine: code that stays small."""
        equations, n = self.equations, self.equations.n
        places: list[tuple[int, int]] = []  # of the factor's entries that are not always zero

        def factors(q: Any, parameters: Any) -> Any:
            L, reciprocal = equations.factors(q, parameters)
            places.extend((k, i) for k in range(n) for i in range(k) if not is_zero(L[k][i]))
            return [*(L[k][i] for k, i in places), *reciprocal]
        inputs = self._inputs(QUANTITIES['inverse_mass_matrix'])
        factorization = trace_program('factorization', factors, inputs)

        def solution(entries: Any, b: Any) -> Any:
            L = [[0.0] * n for _ in range(n)]
            for (k, i), entry in zip(places, entries):
                L[k][i] = entry
            return solve((L, list(entries[len(places):])), equations.order, b)
        solving = trace_program('solution', solution,
                                [('entries', (len(places) + n,)), ('b', (n,))])

        def columns(q: Any, parameters: Any) -> Any:
            entries = call(factorization, q, parameters)
            full = [call(solving, entries, unit) for unit in np.eye(n)]
            return np.array([[full[max(r, s)][min(r, s)] for s in range(n)] for r in range(n)])
        return trace_program('inverse_mass_matrix', columns, inputs)

    def _share(self) -> Share:
        """Return how parts of derivatives are used again: written out, or called."""
        return directly if self.equations.n <= OUTLINED else Outline()

    def _frame_program(self, name: str, frame_name: str) -> Program:
        frame = self.equations.model.frame(frame_name)

        def function(*inputs: Any) -> Any:
            q, *rates, parameters = inputs
            links = self.equations.links(parameters)
            if rates:
                u, udot = (*rates, self.equations.zeros)[:2]
                if name == 'partial_velocity_rates':
                    return frames.partial_velocity_rates(links, frame, q, u)
                motion = frames.frame_motion(links, frame, q, u, udot)
                return motion[0 if name == 'frame_velocity' else 1]
            return getattr(frames, name)(links, frame, q)
        return trace_program(name, function, self._inputs(FRAME_QUANTITIES[name]))

    def _kept(self, key: tuple[str, str], make: Callable[[], Kernel]) -> Kernel:
        if key not in self._made:
            self._made[key] = make()
        return self._made[key]

    def _shape(self, quantity: Quantity) -> Shape:
        model = self.equations.model
        return quantity.shape(model.n, len(model.bodies))

    def _arguments(self, quantity: Quantity) -> list[Argument]:
        model = self.equations.model
        arguments = [Argument(name, (model.n,), model.coordinate_names)
                     for name in quantity.arguments]
        if quantity.wrench and len(self.no_wrench):
            arguments.append(Argument('wrench', self.no_wrench.shape, default=self.no_wrench))
        return arguments

    def _inputs(self, quantity: Quantity) -> list[tuple[str, Shape]]:
        inputs: list[tuple[str, Shape]] = [(name, (self.equations.n,))
                                           for name in quantity.arguments]
        if quantity.wrench and len(self.no_wrench):
            inputs.append(('wrench', self.no_wrench.shape))
        return [*inputs, ('parameters', self._parameters.shape)]
