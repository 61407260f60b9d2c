"""The kernels of one robot: traced from its equations and compiled on first use."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.ltdl import solve
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.ball_joints import least_square, require_direction
from kane_dynamics.mechanics.constraints.conditioning import guarded
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel, ResultCheck
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
from kane_dynamics.native.tracing.subroutine import call, Subroutines
from kane_dynamics.robot.derivative_kernels import (block_of, Derivative, shapes_by_name,
                                                    SlopesOfDynamics)
from kane_dynamics.robot.quantities import (CONSTRAINED, FRAME_QUANTITIES, JOINT_REACTION,
                                            QUANTITIES, Quantity, Sizes, UNWATCHED)
from kane_dynamics.robot.robot_function import RobotFunction, Supply
from kane_dynamics.robot.single_state import in_lanes, shorter
import numpy as np

LARGE = 24  # more coordinates: inverses by a subroutine in batches
LONG = 16  # more coordinates: derivatives of forward dynamics are NumPy products
OUTLINED = 40  # more coordinates: quantities of SHARING are traced with subroutines
SMALL = 1e-16  # squared length of a quaternion that has no direction
ANALYTIC = ('inverse_dynamics_derivatives', 'forward_dynamics_derivatives')
SHARING = ('coriolis_matrix', 'inverse_dynamics_derivatives', 'regressor')
ALL = {**QUANTITIES, **CONSTRAINED}
OF_PARTS = {**FRAME_QUANTITIES, 'joint_reaction': JOINT_REACTION}  # of a frame or joint
Place = tuple[str, Hashable]  # of a kernel: its name, and what tells it from others of the name
Instead = Callable[[dict[str, Array]], 'KernelSet | None']


class KernelSet:
    """
    The kernels of one robot, each compiled on first use.

    Parameters
    ----------
    equations : Equations
    key : str or None
        Cache key of everything that the equations depend on; None with user-defined functions,
        where the traced programs are the key.
    parameters : array
        The block of parameters that kernels read at each call.
    instead : callable, optional
        Called with the arguments of a state with a non-finite result: raises a specific error, or
        returns kernels that are regular there, or None.

    """

    def __init__(self, equations: Equations, key: str | None, parameters: Array,
                 instead: Instead | None = None) -> None:
        """Store the equations; kernels compile on first use."""
        self.equations = equations
        self._in_order = self._sizes.rows > 0  # spills fewer values
        self._instead = instead
        self._at_time_zero = np.zeros(())
        self.no_wrench = np.zeros((len(equations.wrench_frames), 6))
        self.key = key
        self._parameters = parameters
        self._made: dict[Place, Kernel] = {}
        self._explained: set[Place] = set()  # kernels with a reason of their own
        self._same: dict[Place, Callable[[KernelSet], Kernel]] = {}  # of another set

    def with_parameters(self, parameters: Array, instead: Instead | None = None) -> 'KernelSet':
        """
        Return the same kernels, compiled ones included, with another block of parameters.

        `instead` is the callable of the result.
        """
        other = KernelSet(self.equations, self.key, parameters, instead)
        other._same = dict(self._same)
        other._made = {place: kernel.with_parameters(
            parameters if kernel.parameters is self._parameters else kernel.parameters.copy(),
            partial(other._another, place) if place in self._same else None)
            for place, kernel in self._made.items() if place not in self._explained}
        return other

    def _another(self, place: Place, state: dict[str, Array]) -> Kernel | None:
        """Return the kernel to use at a state with a non-finite result, or None."""
        if 'q' in state:
            require_direction(self.equations.model, state['q'], SMALL)
        other = None if self._instead is None else self._instead(state)
        return None if other is None or other is self else self._same[place](other)

    @property
    def parameters(self) -> Array:
        """Return the block of parameters that kernels read at each call."""
        return self._parameters

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities that this robot has as one kernel."""
        known = QUANTITIES if self.equations.in_joint_rates else ALL
        left_out = ['forward_dynamics_derivatives'] if self.equations.n > LONG else []
        return tuple(name for name in known if name not in left_out and (
            self._has(name) or hasattr(SlopesOfDynamics, name)))

    def _has(self, name: str) -> bool:
        """Return whether there is a recursion for a quantity; otherwise it is a derivative."""
        if name in self.equations.unsupported:
            return False
        return hasattr(self.equations, name) or self._recursion(name) is not None

    def _recursion(self, name: str) -> Callable[..., Any] | None:
        """
        Return the function of the tree that computes a quantity with fewer operations, or None.

        This is the one place that chooses algorithms of trees in joint rates. All others are
        those of any mechanism, and the tracer folds T = 1.
        """
        if not self.equations.in_joint_rates:
            return None
        tree = self.equations.tree
        if name == 'inverse_mass_matrix' and tree.n > LARGE:
            return self._large_inverse
        if name in SHARING and tree.n > OUTLINED:
            return partial(getattr(tree, name), share=Subroutines())
        return getattr(tree, name) if name in ANALYTIC else None

    def quantity(self, name: str) -> Kernel:
        """Return the kernel of one of `names`; InputError lists them for another name."""
        return self.kernel(name)

    def at_frame(self, name: str, frame: str) -> Kernel:
        """Return the kernel of one of `FRAME_QUANTITIES`; InputError for an unknown frame."""
        return self.kernel(name, frame)

    def reaction(self, joint: str) -> Kernel:
        """Return the kernel of the reaction at a joint; InputError for an unknown joint."""
        return self.kernel('joint_reaction', joint)

    def kernel(self, name: str, at: str = '', derivative: Derivative | None = None) -> Kernel:
        """
        Return the kernel of a quantity or of a derivative of it.

        Parameters
        ----------
        name, at : str
            One of `names` and '', or one of `FRAME_QUANTITIES` and a frame, or 'joint_reaction'
            and a joint.
        derivative : Derivative, optional
            The derivative; by default the quantity itself.

        Raises
        ------
        InputError
            An unknown name, frame or joint; the message lists the valid ones.

        """
        label = name if derivative is None else derivative.label(name)

        def make() -> Kernel:
            arguments, shape = self.signature(name, at, derivative)
            self._same[label, at] = lambda other: other.kernel(name, at, derivative)
            return Kernel(label, lambda: self.program(name, at, derivative),
                          self.key and self.key + at, arguments, self._parameters, shape,
                          partial(self._another, (label, at)),
                          lambda: self.program(name, at, derivative, single=True), self._in_order)
        return self._kept((label, at), make)

    def signature(self, name: str, at: str = '',
                  derivative: Derivative | None = None) -> tuple[list[Argument], Shape]:
        """Return the arguments of a kernel and the shape of its result; arguments as `kernel`."""
        quantity = self._quantity(name)
        self._method(name, at)  # raises InputError now, not where the kernel is traced
        arguments, shape = self._arguments(quantity), self._sizes.shape(quantity.shape)
        if derivative is None:
            return arguments, shape
        shapes = self.differentiable(name)
        own = [Argument(name, shapes[name]) for name in derivative.parameters]
        return ([*derivative.seeds(shapes, shape), *arguments, *own],
                derivative.shape(shapes, shape))

    def differentiable(self, name: str) -> dict[str, Shape]:
        """Return the shapes of the inputs by which a quantity can be differentiated."""
        quantity = self._quantity(name)
        physical = len(self._parameters) - self.equations.limits
        return shapes_by_name(self._arguments(quantity), quantity, physical)

    def arguments(self, name: str) -> tuple[str, ...]:
        """Return the names of the arguments of a quantity, before the wrench and the time."""
        return self._quantity(name).arguments

    def in_use(self, name: str) -> bool:
        """Return whether the kernel of one of `QUANTITIES` has been used."""
        return (name, '') in self._made

    def compiled(self, function: Callable[..., Any], name: str,
                 inputs: Mapping[str, Shape | Argument], shape: Shape, *,
                 constants: Shape | None = None, reason: ResultCheck | None = None) -> Kernel:
        """
        Return the kernel of a function over any scalar, as `Robot.compiled`.

        With `constants`, the shape of the function's last argument, its numbers take the place of
        the robot's parameters: calls of the kernel's address pass them last. `reason` is that of
        `Kernel`.
        """
        traced = self.function(function, name, inputs, constants, shape)
        place = name, traced.identity
        if reason is not None:
            self._explained.add(place)
        block = self._parameters if constants is None else np.zeros(constants)

        def make() -> Kernel:
            # The code of functions of others is in no key, so that they are traced always.
            key = self.key if traced.is_of_library else None
            return Kernel(name, traced.program, key, traced.arguments, block, shape, reason,
                          in_order=self._in_order)
        return self._kept(place, make)

    def function(self, function: Callable[..., Any], name: str,
                 inputs: Mapping[str, Shape | Argument], constants: Shape | None = None,
                 shape: Shape | None = None) -> RobotFunction:
        """Return a function over any scalar, with what the robot supplies, to trace."""
        equations, block = self.equations, len(self._parameters)
        supply = Supply(self.no_wrench, equations.timed, block, block - equations.limits)
        labels = {'q': equations.model.coordinate_names,
                  **dict.fromkeys(('u', 'udot', 'tau'), equations.speed_names)}
        labelled = dict(inputs)
        for key in labels.keys() & inputs.keys():
            if inputs[key] == (len(labels[key]),):
                labelled[key] = Argument(key, (len(labels[key]),), labels[key])
        return RobotFunction(function, name, labelled, supply, constants, shape)

    def _quantity(self, name: str) -> Quantity:
        """Return the quantity of a name; InputError lists the valid ones."""
        if name in OF_PARTS:
            return OF_PARTS[name]
        tree = self.equations.in_joint_rates
        known = {**CONSTRAINED, **QUANTITIES} if tree else ALL
        if tree:  # of constraints there are none
            known = {key: quantity for key, quantity in known.items()
                     if 'rows' not in quantity.shape}
        if name not in self.names and not (name in known and self._has(name)):
            raise InputError(f"no kernel '{name}' for this robot; expected one of "
                             f'{", ".join(self.names)}')
        return known[name] if self._has(name) else replace(known[name], shape=('n', 'slopes'))

    def _method(self, name: str, at: str = '') -> Callable[..., Any]:
        """Return the function of a quantity to trace; InputError for an unknown frame or joint."""
        equations = self.equations
        if name in FRAME_QUANTITIES:
            return partial(getattr(equations, name), equations.model.frame(at))
        if name == 'joint_reaction':
            return partial(equations.joint_reaction, self._body(at))
        if not self._has(name):
            return getattr(SlopesOfDynamics(equations), name)  # type: ignore[no-any-return]
        recursion = self._recursion(name)
        return getattr(equations, name) if recursion is None else recursion

    def _body(self, joint: str) -> int:
        names = [body.joint.name for body in self.equations.model.bodies]
        if joint not in names:
            raise InputError(f"no moving joint '{joint}'; expected one of "
                             f'{", ".join(names) or "none"} '
                             '(fixed and locked joints are merged into the bodies they join)')
        return names.index(joint)

    def _large_inverse(self, q: Any, parameters: Any) -> Any:
        """Return M^-1 of a tree column by column with one solve subroutine, for small code."""
        tree, n = self.equations.tree, self.equations.n
        places: list[tuple[int, int]] = []  # of the factor's entries that are not always zero

        def factors(q: Any, parameters: Any) -> Any:
            L, reciprocal = tree.factors(q, parameters)
            places.extend((k, i) for k in range(n) for i in range(k) if not is_zero(L[k][i]))
            return [*(L[k][i] for k, i in places), *reciprocal]
        inputs = self._inputs(self.signature('inverse_mass_matrix')[0])
        entries = call(trace_program('factorization', factors, inputs), q, parameters)

        def solution(entries: Any, b: Any) -> Any:
            L = [[0.0] * n for _ in range(n)]
            for (k, i), entry in zip(places, entries):
                L[k][i] = entry
            return solve((L, list(entries[len(places):])), tree.order, b)
        solving = trace_program('solution', solution,
                                [('entries', (len(places) + n,)), ('b', (n,))])
        full = [call(solving, entries, unit) for unit in np.eye(n)]
        return np.array([[full[max(r, s)][min(r, s)] for s in range(n)] for r in range(n)])

    def _kept(self, key: Place, make: Callable[[], Kernel]) -> Kernel:
        if key not in self._made:
            self._made[key] = make()
        return self._made[key]

    @property
    def _sizes(self) -> Sizes:
        equations = self.equations
        model, rows = equations.model, equations.mechanism.labels
        return Sizes(equations.n, equations.n_q, model.n, len(model.bodies), len(rows))

    def _arguments(self, quantity: Quantity) -> list[Argument]:
        equations = self.equations
        arguments = [Argument(name, (equations.n_q,), equations.model.coordinate_names)
                     if name == 'q' else Argument(name, (equations.n,), equations.speed_names)
                     for name in quantity.arguments]
        if quantity.wrench and len(self.no_wrench):
            arguments.append(Argument('wrench', self.no_wrench.shape, default=self.no_wrench))
        if equations.timed:
            arguments.append(Argument('t', (), default=self._at_time_zero))
        return arguments

    def program(self, name: str, at: str = '', derivative: Derivative | None = None,
                single: bool = False) -> Program:
        """
        Trace a quantity or a derivative of it; arguments as `kernel`.

        `single` selects the program of single states on this processor, which uses lanes where
        they save instructions.
        """
        method = self._method(name, at)
        wide = in_lanes(self.equations, name) if single and derivative is None else None
        if wide is None:
            return self._traced(method, name, at, derivative)
        return shorter(self.equations.n, self._traced(wide, name, at),
                       lambda: self._traced(method, name, at))

    def _traced(self, method: Callable[..., Any], name: str, at: str,
                derivative: Derivative | None = None) -> Program:
        """Return the program of a function of the equations; other arguments as `kernel`."""
        def function(*inputs: Any) -> Any:
            given = dict(zip(names, inputs))
            values = [given[argument] for argument in quantity.arguments]
            values += [given.get('wrench')] if quantity.wrench else []
            block = block_of(given)
            parameters, limits = np.split(block, [len(block) - equations.limits])
            values += [parameters] if quantity.parameters else []
            time = {'t': given['t'][()]} if 't' in given else {}
            result = method(*values, **time)
            if derivative is not None:
                result = derivative.traced(result, given)
            if 'q' in given and equations.model.balls:
                result = guarded(result, least_square(equations.model, given['q']) - SMALL)
            if not equations.watched or name in UNWATCHED:
                return result
            return guarded(result, equations.margin(given['q'], time.get('t', 0.0), limits))
        equations = self.equations
        quantity = self._quantity(name)
        inputs = self._inputs(self.signature(name, at, derivative)[0])
        names = [key for key, _ in inputs]
        return trace_program(name, function, inputs)

    def _inputs(self, arguments: Sequence[Argument]) -> list[tuple[str, Shape]]:
        return [*((argument.name, argument.shape) for argument in arguments),
                ('parameters', self._parameters.shape)]
