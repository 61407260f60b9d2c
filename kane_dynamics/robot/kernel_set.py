"""
The quantities of a robot and their kernels, traced from its equations at the first use.

`QUANTITIES` and the tables below it say which arguments and shape each quantity has.
`KernelSet` traces the method of that name of the equations, and compiles and stores the
kernel.
"""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from functools import partial, wraps
from typing import Any, NamedTuple
from weakref import ref, WeakKeyDictionary

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Matrix, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.ltdl import solve
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.ball_joints import least_square, require_direction
from kane_dynamics.mechanics.constraints.conditioning import guarded
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.recursive.tree_equations import TORQUE_TERMS, TreeEquations
from kane_dynamics.model.model import WORLD
from kane_dynamics.native.backends.llvm_simd import width
from kane_dynamics.native.python_call.entry import ResultPart
from kane_dynamics.native.runtime.kernel import Argument, Kernel, ResultCheck
from kane_dynamics.native.tracing.program import origin, Program, Shape, trace_program
from kane_dynamics.native.tracing.subroutine import call, Subroutines
from kane_dynamics.robot.derivative_kernels import (Derivative, PARAMETERS,
                                                    SlopesOfDynamics)
from kane_dynamics.robot.robot_function import RobotFunction, Supply
import numpy as np


class Sizes(NamedTuple):
    """Numbers of independent speeds, coordinates, joints, bodies and constraint rows."""

    n: int
    n_q: int
    joints: int
    bodies: int
    rows: int

    @property
    def inertial_parameters(self) -> int:
        """Return the number of inertial parameters of all bodies."""
        return 10 * self.bodies

    @property
    def slopes(self) -> int:
        """Return the number of columns of dtau/dq, dtau/du and dtau/dudot together."""
        return self.n_q + 2 * self.n


@dataclass(frozen=True)
class Quantity:
    """
    The quantity of a kernel.

    Attributes
    ----------
    arguments : tuple of str
        Arguments of the equations' method of that name, before the wrench and the
        parameters.
    shape : tuple of int and str
        Shape of the result; names are those of `Sizes`.
    wrench, parameters : bool
        Whether the method has these arguments.

    """

    arguments: tuple[str, ...]
    shape: tuple[int | str, ...]
    wrench: bool = False
    parameters: bool = True


STATE = ('q', 'u')
MOTION = ('q', 'u', 'udot')
LOADED = ('q', 'u', 'tau')
QUANTITIES = {
    'inverse_dynamics': Quantity(MOTION, ('n',), wrench=True),
    'forward_dynamics': Quantity(LOADED, ('n',), wrench=True),
    'mass_matrix': Quantity(('q',), ('n', 'n')),
    'inverse_mass_matrix': Quantity(('q',), ('n', 'n')),
    'bias_force': Quantity(STATE, ('n',)),
    'coriolis_matrix': Quantity(STATE, ('n', 'n')),
    'gravity_force': Quantity(('q',), ('n',)),
    'friction_force': Quantity(('u',), ('n',), parameters=False),
    'external_force': Quantity(('q',), ('n',), wrench=True, parameters=False),
    'torque_terms': Quantity(MOTION, (len(TORQUE_TERMS), 'n')),
    'body_torques': Quantity(MOTION, ('bodies', 'n')),
    'joint_reactions': Quantity(MOTION, ('bodies', 6), wrench=True),
    'center_of_mass': Quantity(('q',), (3,)),
    'center_of_mass_jacobian': Quantity(('q',), (3, 'n')),
    'centroidal_momentum': Quantity(STATE, (6,)),
    'centroidal_momentum_matrix': Quantity(('q',), (6, 'n')),
    'centroidal_momentum_rate': Quantity(MOTION, (6,)),
    'kinetic_energy': Quantity(STATE, ()),
    'potential_energy': Quantity(('q',), ()),
    'inverse_dynamics_derivatives': Quantity(MOTION, (3, 'n', 'n')),
    'forward_dynamics_derivatives': Quantity(LOADED, (3, 'n', 'n')),
    'regressor': Quantity(MOTION, ('n', 'inertial_parameters')),
}
# Where speeds are chosen or constraints given. In joint rates without constraints, those
# of joints are the argument itself: kernels of them are made only where they are asked
# for by name.
CONSTRAINED = {
    'joint_rates': Quantity(STATE, ('n_q',), parameters=False),
    'joint_torques': Quantity(('tau', 'q'), ('joints',), parameters=False),
    'constraint_forces': Quantity(LOADED, ('rows',), wrench=True),
    'constraint_residual': Quantity(('q',), ('rows',), parameters=False),
    'constraint_velocity_residual': Quantity(STATE, ('rows',), parameters=False),
    'joint_accelerations': Quantity(MOTION, ('joints',), parameters=False),
    'friction_force': Quantity(('u', 'q'), ('n',), parameters=False),
}
ALL = {**QUANTITIES, **CONSTRAINED}
FRAME_QUANTITIES = {
    'frame_pose': Quantity(('q',), (4, 4), parameters=False),
    'frame_velocity': Quantity(STATE, (6,), parameters=False),
    'frame_acceleration': Quantity(MOTION, (6,), parameters=False),
    'partial_velocities': Quantity(('q',), (6, 'n'), parameters=False),
    'partial_velocity_rates': Quantity(STATE, (6, 'n'), parameters=False),
}
OF_PARTS = {  # of a frame or joint
    **FRAME_QUANTITIES,
    'operational_space_inertia': Quantity(('q',), (6, 6)),
    'joint_reaction': Quantity(MOTION, (6,), wrench=True),
}
# Quantities that are valid for open loops and any choice of independent speeds:
UNWATCHED = ('potential_energy', 'constraint_residual', 'frame_pose')
# Quantities of control and simulation, which a node compiles in configure.
IN_LOOPS = ('inverse_dynamics', 'forward_dynamics', 'mass_matrix', 'inverse_mass_matrix',
            'bias_force', 'gravity_force', 'friction_force', 'torque_terms',
            'joint_reactions', 'kinetic_energy', 'potential_energy')

# Trees in joint rates have recursions of their own for derivatives; the largest trees
# share subroutines, so that programs do not grow with the square of the number of
# joints.
ANALYTIC = ('inverse_dynamics_derivatives', 'forward_dynamics_derivatives')
SHARING = ('coriolis_matrix', 'inverse_dynamics_derivatives', 'regressor')
LARGE = 24  # more coordinates: inverses by a subroutine in batches, matrices in lanes
LONG = 16  # more coordinates: derivatives of forward dynamics are NumPy products
OUTLINED = 40  # more coordinates: quantities of SHARING are traced with subroutines
# A path of more joints: accelerations by articulated inertias, whose arithmetic grows with
# its length, and not with the cube of it.
LONG_PATH = 20
# Matrices of one state that are computed for several joints at once, where that takes
# fewer instructions: in trees of any size, and in large ones.
IN_LANES = ('coriolis_matrix', *ANALYTIC)
LARGE_IN_LANES = (*IN_LANES, 'mass_matrix', 'inverse_mass_matrix', 'regressor')
NO_DIRECTION = 1e-16  # squared length of a quaternion that has no direction

# Of a kernel: a frame, several frames, a joint, or nothing.
At = str | tuple[str, ...]
Place = tuple[str, Hashable]  # of a kernel: name, and what tells it from its namesakes
Instead = Callable[[dict[str, Array]], 'KernelSet | None']


class KernelSet:
    """
    The kernels of one robot, each compiled on first use.

    Parameters
    ----------
    equations : Equations
    key : str or None
        Cache key of everything that the equations depend on; None with user-defined
        functions, where the traced programs are the key.
    parameters : array
        The block of parameters that kernels read at each call.
    instead : callable, optional
        Called with the arguments of a state with a non-finite result: raises a specific
        error, or returns kernels that are regular there, or None.

    """

    def __init__(self, equations: Equations, key: str | None, parameters: Array,
                 instead: Instead | None = None) -> None:
        """Store the equations; kernels compile on first use."""
        self.equations = equations
        self.key = key
        self.no_wrench = np.zeros((len(equations.wrench_frames), 6))
        # The time as an argument of kernels, zero by default; none where no result depends
        # on it.
        self._time = equations.time_inputs(Argument('t', (), default=np.zeros(())))
        self._parameters = parameters
        self._instead = instead
        model = equations.model
        rows = len(equations.mechanism.labels)
        self._sizes = Sizes(equations.n, equations.n_q, model.n, len(model.bodies), rows)
        self._in_order = rows > 0  # spills fewer values
        self._made: dict[Place, Kernel] = {}
        # What other packages compile for this robot, by keys of theirs.
        self.kept: dict[tuple[Any, ...], Any] = {}
        self._explained: set[Place] = set()  # kernels with a reason of their own
        self._same: dict[Place, Callable[[KernelSet], Kernel]] = {}  # of another set

    def with_parameters(self, parameters: Array,
                        instead: Instead | None = None) -> 'KernelSet':
        """
        Return the same kernels, compiled ones included, with other parameters.

        `instead` is the callable of the result.
        """
        copied = KernelSet(self.equations, self.key, parameters, instead)
        copied._same = dict(self._same)
        # The machine code is shared; only the block that it reads is another.
        for place, kernel in self._made.items():
            if place in self._explained:
                continue
            block = parameters
            if kernel.parameters is not self._parameters:  # constants of a function
                block = kernel.parameters.copy()
            reason: ResultCheck = copied._of_direction
            if place in self._same:
                reason = partial(copied._another, place)
            copied._made[place] = kernel.with_parameters(block, reason)
        return copied

    def _another(self, place: Place, state: dict[str, Array]) -> Kernel | None:
        """Return the kernel to use at a state with a non-finite result, or None."""
        self._of_direction(state)
        regular = None if self._instead is None else self._instead(state)
        if regular is None or regular is self:
            return None
        return self._same[place](regular)

    def _of_direction(self, state: dict[str, Array]) -> None:
        """Raise InputError if a quaternion of a state has no direction."""
        q = state.get('q')
        if q is not None and q.shape == (self.equations.n_q,):
            require_direction(self.equations.model, q, NO_DIRECTION)

    @property
    def parameters(self) -> Array:
        """Return the block of parameters that kernels read at each call."""
        return self._parameters

    @lazy_property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities that this robot has as one kernel."""
        names = []
        for name in QUANTITIES if self.equations.in_joint_rates else ALL:
            if name == 'forward_dynamics_derivatives' and self.equations.n > LONG:
                continue
            if self._has(name) or hasattr(SlopesOfDynamics, name):
                names.append(name)
        return tuple(names)

    def _has(self, name: str) -> bool:
        """Return whether a quantity has a recursion; otherwise it is a derivative."""
        if name in self.equations.unsupported:
            return False
        analytic = self.equations.in_joint_rates and name in ANALYTIC
        return analytic or hasattr(self.equations, name)

    def parts(self, name: str) -> tuple[ResultPart, ...] | None:
        """Return the arrays into which a method divides the result of its kernel."""
        if name not in ANALYTIC:
            return None
        n = self.equations.n
        shape = self.kernel(name).shape
        if len(shape) == 3:
            return tuple(ResultPart((n, n), k * n * n, 1, n * n, 0) for k in range(3))
        # Columns of one matrix.
        start = 0
        parts = []
        for columns in (self.equations.n_q, n, n):
            parts.append(ResultPart((n, columns), start, n, columns, shape[1]))
            start += columns
        return tuple(parts)

    def kernel(self, name: str, at: At = '',
               derivative: Derivative | None = None) -> Kernel:
        """
        Return the kernel of a quantity or of a derivative of it.

        Parameters
        ----------
        name, at : str
            One of `names` and '', or one of `FRAME_QUANTITIES` and a frame or several,
            or 'joint_reaction' and a joint.
        derivative : Derivative, optional
            The derivative; by default the quantity itself.

        Raises
        ------
        InputError
            An unknown name, frame or joint; the message lists the valid ones.

        """
        label = name if derivative is None else derivative.label(name)
        place = label, at
        kernel = self._made.get(place)
        if kernel is None:
            arguments, shape = self.signature(name, at, derivative)
            # In other speeds at a singular state, the same quantity of the robot with
            # those.
            self._same[place] = lambda regular: regular.kernel(name, at, derivative)
            traced = partial(self.program, name, at, derivative)
            traced_single = partial(self.program, name, at, derivative, single=True)
            key = self.key and self.key + (at if isinstance(at, str) else repr(at))
            kernel = Kernel(label, traced, key, arguments, self._parameters, shape,
                            partial(self._another, place), traced_single, self._in_order)
            self._made[place] = kernel
        return kernel

    def signature(self, name: str, at: At = '',
                  derivative: Derivative | None = None) -> tuple[list[Argument], Shape]:
        """Return the arguments of a kernel and the shape of its result; see `kernel`."""
        quantity = self._quantity(name)
        self._method(name, at)  # raises InputError now, not where the kernel is traced
        arguments = self._arguments(quantity)
        # With the sizes of this robot in place of their names.
        lengths: list[int] = [] if isinstance(at, str) else [len(at)]
        for entry in quantity.shape:
            if isinstance(entry, str):
                entry = getattr(self._sizes, entry)
            lengths.append(entry)
        shape = tuple(lengths)
        if derivative is None:
            return arguments, shape
        # Cotangents and tangents come first, run-time parameters of each state last.
        shapes = self.inputs(name)
        seeds = derivative.seeds(shapes, shape)
        blocks = [Argument(block, shapes[block]) for block in derivative.parameters]
        return [*seeds, *arguments, *blocks], derivative.shape(shapes, shape)

    def differentiable(self, name: str) -> dict[str, Shape]:
        """Return the shapes of the inputs by which a quantity can be differentiated."""
        # Inputs of a state; then those parts of the block of parameters that the robot
        # has.
        quantity = self._quantity(name)
        shapes = {}
        for argument in self._arguments(quantity):
            shapes[argument.name] = argument.shape
        if quantity.parameters:
            # Limits of a state at the end of the block are no physical quantities.
            physical = len(self._parameters) - self.equations.limits
            for block, part in PARAMETERS.items():
                if part.stop <= physical:
                    shapes[block] = (part.stop - part.start,)
        return shapes

    def constants(self, name: str) -> dict[str, Shape]:
        """Return the shapes of constants of links and joints that may be arguments."""
        equations = self.equations
        if not self._quantity(name).parameters or equations.tree.flexible:
            return {}
        shapes: dict[str, Shape] = {}
        # Speeds that are momenta depend on the inertia.
        if equations.mechanism.speeds.key != 'momenta':
            shapes['inertial_parameters'] = (self._sizes.inertial_parameters,)
        if equations.friction and not equations.carries_loads:
            shapes['damping'] = shapes['friction'] = (self._sizes.joints,)
        return shapes

    def inputs(self, name: str) -> dict[str, Shape]:
        """Return the shapes of all that may be an argument of each state."""
        return {**self.differentiable(name), **self.constants(name)}

    def arguments(self, name: str) -> tuple[str, ...]:
        """Return the names of the arguments of a quantity, before wrench and time."""
        return self._quantity(name).arguments

    def in_use(self, name: str) -> bool:
        """Return whether one of `QUANTITIES` has been compiled, so that it exists here."""
        kernel = self._made.get((name, ''))
        return kernel is not None and kernel.is_compiled

    def compiled(self, function: Callable[..., Any], name: str,
                 inputs: Mapping[str, Shape | Argument], shape: Shape, *,
                 constants: Shape | None = None,
                 reason: ResultCheck | None = None,
                 single: Callable[..., Any] | None = None,
                 ahead: bool = True) -> Kernel:
        """
        Return the kernel of a function over any scalar, as `Robot.compiled`.

        With `constants`, the shape of the function's last argument, its numbers take the
        place of the robot's parameters: calls of the kernel's address pass them last.
        `reason` is that of `Kernel`; `single` is the same function in lanes, for single
        states. The code of single states is compiled now, or at its first use unless
        `ahead`.
        """
        traced = self.function(function, name, inputs, constants, shape)
        # Within one robot, the text of a function of this library tells it from others of
        # its name; of other functions, what is traced does.
        identity = origin(traced.program) if traced.is_of_library else traced.program.args
        place = name, identity
        if reason is not None:
            self._explained.add(place)

        def explanation(state: dict[str, Array]) -> Kernel | None:
            self._of_direction(state)
            return None if reason is None else reason(state)
        kernel = self._made.get(place)
        if kernel is None:
            block = self._parameters if constants is None else np.zeros(constants)
            # The code of functions of others is in no key, so that they are traced
            # always.
            key = self.key if traced.is_of_library else None
            program_in_lanes = None
            if single is not None:
                program_in_lanes = self.function(single, name, inputs, constants,
                                                 shape).program
            kernel = Kernel(name, traced.program, key, traced.arguments, block, shape,
                            explanation, program_in_lanes, self._in_order,
                            traced.unread)
            self._made[place] = kernel
        if ahead:
            kernel.compile()
        return kernel

    def function(self, function: Callable[..., Any], name: str,
                 inputs: Mapping[str, Shape | Argument], constants: Shape | None = None,
                 shape: Shape | None = None) -> RobotFunction:
        """Return a function over any scalar, with what the robot supplies."""
        equations = self.equations
        # What a function may ask for by name: wrench, time, parameters, limits of a
        # state.
        block = len(self._parameters)
        supply = Supply(self.no_wrench, self._time, block, block - equations.limits)
        # Errors about states name the entry of q, u, udot or tau.
        labels = {'q': equations.model.coordinate_names}
        for key in ('u', 'udot', 'tau'):
            labels[key] = equations.speed_names
        labelled = dict(inputs)
        for key in labels.keys() & inputs.keys():
            if inputs[key] == (len(labels[key]),):
                labelled[key] = Argument(key, (len(labels[key]),), labels[key])
        return RobotFunction(function, name, labelled, supply, constants, shape)

    def _quantity(self, name: str) -> Quantity:
        """Return the quantity of a name; InputError lists the valid ones."""
        if name in OF_PARTS:
            return OF_PARTS[name]
        quantity = ALL.get(name)
        if self.equations.in_joint_rates:
            # Friction depends on u alone there.
            quantity = QUANTITIES.get(name, quantity)
        # Without a recursion, derivatives of a quantity are those of its traced
        # program.
        has_recursion = quantity is not None and self._has(name)
        if quantity is None or not (has_recursion or name in self.names):
            raise InputError(f"no kernel '{name}' for this robot; expected one of "
                             f'{", ".join(self.names)}')
        return quantity if has_recursion else replace(quantity, shape=('n', 'slopes'))

    def _method(self, name: str, at: At = '',
                equations: Equations | None = None) -> Callable[..., Any]:
        """Return the method of a quantity; InputError for an unknown part."""
        equations = equations or self.equations
        if not isinstance(at, str):
            methods = [self._method(name, part, equations) for part in at]
            return lambda *values, **time: np.stack(
                [np.asarray(method(*values, **time)) for method in methods])
        if name == 'joint_reaction':
            return partial(equations.joint_reaction, self._body(at))
        if name in OF_PARTS:
            return partial(getattr(equations, name), equations.model.frame(at))
        if not self._has(name):
            slopes: Callable[..., Any] = getattr(SlopesOfDynamics(equations), name)
            return slopes

        # The one place that chooses algorithms of trees in joint rates that take fewer
        # operations. All others are those of any mechanism, and the tracer folds T = 1.
        method: Callable[..., Any] | None = getattr(equations, name, None)
        if equations.in_joint_rates:
            tree = equations.tree
            if name == 'inverse_mass_matrix' and tree.n > LARGE:
                method = self._large_inverse
            elif name in SHARING and tree.n > OUTLINED:
                method = partial(getattr(tree, name), share=Subroutines())
            elif name in ANALYTIC:
                method = getattr(tree, name)
            elif name == 'forward_dynamics' and _has_long_path(tree):
                method = tree.accelerations_by_articulated_inertias
                if tree.n > OUTLINED:
                    method = partial(method, share=Subroutines())
        assert method is not None
        return method

    def _body(self, joint: str) -> int:
        """Return the index of the body that a joint moves."""
        # Reactions exist for every body, with the joint that moves it.
        names = [body.joint.name for body in self.equations.model.bodies]
        if joint not in names:
            valid = ', '.join(names) or 'none'
            raise InputError(f"no moving joint '{joint}'; expected one of {valid} "
                             '(fixed and locked joints are merged into the bodies they '
                             'join)')
        return names.index(joint)

    def _large_inverse(self, q: Vector, parameters: Vector) -> Matrix:
        """Return M^-1 of a tree column by column with one subroutine, for small code."""
        tree = self.equations.tree
        n = self.equations.n
        factor_entries: list[tuple[int, int]] = []  # those of L that are not always zero

        # First subroutine: M = L^T D L, as its nonzero entries, then those of 1 / D.
        def factors(q: Vector, parameters: Vector) -> list[Any]:
            L, reciprocal = tree.factors(tree.mass_matrix(q, parameters))
            values = []
            for k in range(n):
                for i in range(k):
                    if not is_zero(L[k][i]):
                        factor_entries.append((k, i))
                        values.append(L[k][i])
            return [*values, *reciprocal]
        inputs = [('q', q.shape), ('parameters', parameters.shape)]
        values = call(trace_program('factorization', factors, inputs), q, parameters)

        # Second subroutine, called once a column: M x = b.
        def solution(values: Vector, b: Vector) -> Vector:
            L = [[0.0] * n for _ in range(n)]
            for (k, i), value in zip(factor_entries, values):
                L[k][i] = value
            reciprocal = list(values[len(factor_entries):])
            return solve((L, reciprocal), tree.order, b)
        solution_inputs = [('entries', (len(factor_entries) + n,)), ('b', (n,))]
        solving = trace_program('solution', solution, solution_inputs)
        columns = [call(solving, values, unit) for unit in np.eye(n)]

        # Both halves are the same expressions, so that the result is exactly symmetric.
        inverse = np.empty((n, n), dtype=object)
        for r in range(n):
            for s in range(n):
                inverse[r, s] = columns[max(r, s)][min(r, s)]
        return inverse

    def _arguments(self, quantity: Quantity) -> list[Argument]:
        """Return the arguments of the kernel of a quantity, before its parameters."""
        equations = self.equations
        # q in coordinates, all else in speeds.
        arguments = []
        for name in quantity.arguments:
            if name == 'q':
                labels = equations.model.coordinate_names
                arguments.append(Argument(name, (equations.n_q,), labels))
            else:
                arguments.append(Argument(name, (equations.n,), equations.speed_names))
        # The wrench and the time are optional: they have defaults.
        if quantity.wrench and len(self.no_wrench):
            no_wrench = self.no_wrench
            arguments.append(Argument('wrench', no_wrench.shape, default=no_wrench))
        return [*arguments, *self._time]

    def program(self, name: str, at: At = '', derivative: Derivative | None = None,
                single: bool = False) -> Program:
        """
        Trace a quantity or a derivative of it; arguments as `kernel`.

        `single` selects the program of single states on this processor, which uses lanes
        where they save instructions.
        """
        if not single or derivative is not None:
            return self._traced(self._method(name, at), name, at, derivative)

        # For single states the program that takes fewer instructions. Beyond some size
        # the plain one is far longer, and is not even traced.
        plain = None
        in_lanes = method_in_lanes(self.equations, name)
        if in_lanes is None or self.equations.n <= OUTLINED:
            plain = self._traced(self._method(name, at), name, at)
        if in_lanes is None:
            assert plain is not None
            return plain
        program = self._traced(in_lanes, name, at)
        lanes = width()
        if plain is not None and (plain.instruction_count(lanes)
                                  <= program.instruction_count(lanes)):
            return plain
        return program

    def _traced(self, method: Callable[..., Any], name: str, at: At,
                derivative: Derivative | None = None) -> Program:
        """Return the program of a function of the equations; see `program`."""
        equations = self.equations
        quantity = self._quantity(name)
        inputs = []
        for argument in self.signature(name, at, derivative)[0]:
            inputs.append((argument.name, argument.shape))
        inputs.append(('parameters', self._parameters.shape))

        def function(*arrays: Any) -> Any:
            by_name = {}
            for (key, _), array in zip(inputs, arrays):
                by_name[key] = array
            # Parameters that are arguments of each state stand in for those of the
            # block.
            block = np.array(by_name['parameters'], dtype=object)
            for key, part in PARAMETERS.items():
                if key in by_name:
                    block[part] = by_name[key]
            parameters, limits = np.split(block, [len(block) - equations.limits])

            values = list(map(by_name.__getitem__, quantity.arguments))
            if quantity.wrench:
                values.append(by_name.get('wrench'))
            if quantity.parameters:
                values.append(parameters)
            time = {}
            if 't' in by_name:
                time['t'] = by_name['t'][()]
            evaluated = method
            constants = {key: by_name[key] for key in self.constants(name)
                         if key in by_name}
            if constants:
                evaluated = self._method(name, at, equations.with_constants(**constants))
            result = evaluated(*values, **time)
            if derivative is not None:
                result = derivative.traced(result, by_name)

            # NaN where a quaternion has no direction, and beyond the limits of a state.
            if 'q' in by_name and equations.model.balls:
                square = least_square(equations.model, by_name['q'])
                result = guarded(result, square - NO_DIRECTION)
            if equations.watched and name not in UNWATCHED:
                margin = equations.margin(by_name['q'], time.get('t', 0.0), limits)
                result = guarded(result, margin)
            return result
        return trace_program(name, function, inputs)


def method_in_lanes(equations: Equations, name: str) -> Callable[..., Any] | None:
    """Return the function that computes several joints at once, or None."""
    names = LARGE_IN_LANES if equations.n > LARGE else IN_LANES
    if name not in names or not equations.in_joint_rates or equations.n == 0:
        return None
    if not equations.tree.has_simple_joints:
        return None
    # Needed only where a program is traced.
    from kane_dynamics.mechanics.joint_lanes.tree_in_lanes import TreeInLanes
    from kane_dynamics.native.tracing.wide import WideLanes
    tree_in_lanes = TreeInLanes(equations.tree, lambda q: WideLanes(q.trace))
    method: Callable[..., Any] = getattr(tree_in_lanes, name)
    return method


def _has_long_path(tree: TreeEquations) -> bool:
    """Return whether articulated inertias serve a tree, and take less time than M."""
    if not tree.has_simple_joints or tree.without_own_inertia:
        return False
    depths: list[int] = []
    for link in tree.geometry:
        carriers = 0 if link.parent == WORLD else depths[link.parent]
        depths.append(carriers + 1)
    return max(depths, default=0) > LONG_PATH and all(
        link.multiplier == 1.0 for link in tree.geometry)


def kernel_per_robot(function: Callable[..., Kernel]) -> Callable[..., Kernel]:
    """
    Return a function that makes a kernel once for each robot, by another function.

    `Robot.compiled` compiles once, too, but reads its function again at each call, which
    takes longer than many kernels. The robot's set of kernels stores the kernel, which
    refers to the robot; so this function refers to both weakly. Further arguments of the
    function are hashable, and each choice of them has its kernel.
    """
    # Weak references: a kernel lives as long as its users, a robot's entry as long as
    # the robot.
    references: WeakKeyDictionary[KernelSet, dict[tuple[Hashable, ...], ref[Kernel]]]
    references = WeakKeyDictionary()

    @wraps(function)
    def kernel_of(robot: Any, *choices: Hashable) -> Kernel:
        kernels = references.setdefault(robot.kernels, {})
        reference = kernels.get(choices)
        kernel = None if reference is None else reference()
        if kernel is None:
            kernel = function(robot, *choices)
            kernels[choices] = ref(kernel)
        return kernel
    return kernel_of
