"""`Robot`: a model with its dynamics compiled, what users hold."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

from kane_dynamics.errors import CompileError, InputError, ModelError
from kane_dynamics.mechanics import frames, kane
from kane_dynamics.mechanics.equations import Equations, TORQUE_TERMS
from kane_dynamics.mechanics.payload import with_payload
from kane_dynamics.model import Array, constant, Frame, Inertial, Model
from kane_dynamics.native.kernels import Argument, Kernel
from kane_dynamics.native.program import OperationCount, Program, Shape, trace_program
import numpy as np

__all__ = ['JointLimits', 'Parameters', 'Robot', 'TORQUE_TERMS']

VERIFIED = 1e-9  # relative error of a kernel at which it is taken to be wrong, not rounded
Method = TypeVar('Method', bound=Callable[..., Any])


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Bounds of every coordinate's joint, (n,) arrays; infinite where none is stated."""

    lower: Array
    upper: Array
    velocity: Array
    effort: Array


@dataclass(frozen=True)
class Quantity:
    """What a kernel computes: the arguments of `Equations`' method and its result's shape."""

    arguments: tuple[str, ...]
    shape: Callable[[int], Shape]
    wrench: bool = False
    parameters: bool = True


def _vector(n: int) -> Shape:
    return (n,)


def _matrix(n: int) -> Shape:
    return (n, n)


def _scalar(n: int) -> Shape:
    return ()


QUANTITIES = {
    'inverse_dynamics': Quantity(('q', 'u', 'udot'), _vector, wrench=True),
    'forward_dynamics': Quantity(('q', 'u', 'tau'), _vector, wrench=True),
    'mass_matrix': Quantity(('q',), _matrix),
    'inverse_mass_matrix': Quantity(('q',), _matrix),
    'bias_force': Quantity(('q', 'u'), _vector),
    'gravity_force': Quantity(('q',), _vector),
    'friction_force': Quantity(('u',), _vector, parameters=False),
    'torque_terms': Quantity(('q', 'u', 'udot'), lambda n: (len(TORQUE_TERMS), n)),
    'kinetic_energy': Quantity(('q', 'u'), _scalar),
    'potential_energy': Quantity(('q',), _scalar),
}
FRAME_QUANTITIES = {
    'frame_pose': Quantity(('q',), lambda n: (4, 4)),
    'frame_velocity': Quantity(('q', 'u'), lambda n: (6,)),
    'frame_acceleration': Quantity(('q', 'u', 'udot'), lambda n: (6,)),
    'partial_velocities': Quantity(('q',), lambda n: (6, n)),
}


class _Compiled:
    """A method that, once used on a robot, gives way to its kernel's own entry there."""

    def __init__(self, checked: Callable[..., Any]) -> None:
        self.checked = checked
        self.__doc__ = checked.__doc__

    def __get__(self, robot: 'Robot | None', owner: type | None = None) -> Any:
        if robot is None:
            return self.checked
        name, fallback = self.checked.__name__, self.checked.__get__(robot)
        entry = robot.kernel(name).entry(self.checked.__doc__ or '', fallback)
        robot.__dict__[name] = entry
        return entry


def compiled(method: Method) -> Method:
    """Serve a method by the kernel of its name; its body is the road for unusual arguments."""
    return _Compiled(method)  # type: ignore[return-value]


class Parameters:
    """
    What may change while a robot runs, without compiling anew.

    Attributes
    ----------
    gravity : (3,) array
        m/s^2, world axes.
    payload : Inertial or None
        In the axes of the robot's `payload_frame`.
    """

    def __init__(self, model: Model, payload_frame: Frame | None) -> None:
        """Start with the model's gravity and no payload."""
        self._frame = payload_frame
        self._payload: Inertial | None = None
        self.block = np.zeros(3 if payload_frame is None else 13)
        self.gravity = model.gravity

    @property
    def gravity(self) -> Array:
        return self.block[:3].copy()

    @gravity.setter
    def gravity(self, value: Any) -> None:
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            array = np.array(np.nan)
        if array.shape != (3,) or not np.isfinite(array).all():
            raise InputError(f'gravity is {value!r}; expected three finite numbers, m/s^2')
        self.block[:3] = array

    @property
    def payload(self) -> Inertial | None:
        return self._payload

    @payload.setter
    def payload(self, value: Inertial | None) -> None:
        if self._frame is None:
            raise InputError('this robot carries no payload: construct it with payload_frame=')
        if not (value is None or isinstance(value, Inertial)):
            raise InputError(f'payload is a {type(value).__name__}; expected an Inertial or None')
        P = np.zeros((4, 4)) if value is None else value.pseudo_inertia
        self.block[3:] = [P[3, 3], *P[:3, 3], P[0, 0], P[0, 1], P[0, 2], P[1, 1], P[1, 2], P[2, 2]]
        self._payload = value


class Robot:
    """
    The dynamics of one manipulator, compiled for it.

    M(q) udot + bias(q, u) = tau + external, with u = q' and everything in SI units and world
    axes. Every method takes one state, (n,) arrays, or a batch, (N, n) arrays, and answers in
    kind. Kernels compile on first use and are kept in a cache on disk.

    Parameters
    ----------
    model : Model
    wrench_frames : sequence of str
        Frames on which the environment may push (`wrench=`, one row each).
    payload_frame : str, optional
        Frame in which `parameters.payload` is given.
    friction : bool
        Whether damping and Coulomb friction are part of the equations.
    frame_reduction : bool
        Use Denavit-Hartenberg-like frames inside the kernels where that saves arithmetic; the
        numbers are the same.

    Raises
    ------
    InputError
        No such frame; the message lists the valid ones.
    """

    def __init__(self, model: Model, *, wrench_frames: Sequence[str] = (),
                 payload_frame: str | None = None, friction: bool = True,
                 frame_reduction: bool = True) -> None:
        """Prepare the equations; nothing is compiled yet."""
        if not isinstance(model, Model):
            raise InputError(f'model is a {type(model).__name__}; expected a Model '
                             '(load_urdf returns one)')
        if isinstance(wrench_frames, str):
            raise InputError(f"wrench_frames is the string '{wrench_frames}'; expected a sequence "
                             'of frame names')
        self._options: dict[str, Any] = {
            'wrench_frames': tuple(wrench_frames), 'payload_frame': payload_frame,
            'friction': bool(friction), 'frame_reduction': bool(frame_reduction)}
        self.model = model
        self.friction = bool(friction)
        self.equations = Equations(model, **self._options)
        self.parameters = Parameters(model, self.equations.payload_frame)
        self._key = model.digest() + repr(sorted(self._options.items()))
        self._kernels: dict[tuple[str, str], Kernel] = {}
        self._frame_entries: dict[tuple[str, str], Callable[..., Any]] = {}
        self._no_wrench = np.zeros((len(self.equations.wrench_frames), 6))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as model, options and parameters; kernels load again from the cache."""
        return _restored, (self.model, self._options, self.parameters.gravity,
                           self.parameters.payload)

    @property
    def n(self) -> int:
        """Number of generalized speeds."""
        return self.model.n

    @property
    def n_q(self) -> int:
        """Number of coordinates."""
        return self.model.n

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints that move freely, in the order of q, u and tau."""
        return self.model.joint_names

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the entries of q."""
        return self.model.coordinate_names

    @cached_property
    def limits(self) -> JointLimits:
        """Bounds of the joints, as the model states them."""
        limits = [joint.limits for joint in self.model.coordinate_joints]
        return JointLimits(*(np.array([getattr(limit, name) for limit in limits])
                             for name in ('lower', 'upper', 'velocity', 'effort')))

    @compiled
    def inverse_dynamics(self, q: Any, u: Any, udot: Any, *, wrench: Any = None,
                         out: Array | None = None) -> Array:
        """
        Return tau = M udot + bias - external, (n,), N m or N.

        Parameters
        ----------
        q, u, udot : (n,) or (N, n) arrays
            Coordinates, speeds and their rates; rad or m, s.
        wrench : (k, 6) or (N, k, 6) array, optional
            What the environment exerts at each of `wrench_frames`: force then moment, at the
            frame's origin, world axes, N and N m.
        out : array, optional
            Written to and returned.

        Raises
        ------
        InputError
            Names the argument, what was given and what is expected.
        """
        return self._dynamics('inverse_dynamics', (q, u, udot), wrench, out)

    @compiled
    def forward_dynamics(self, q: Any, u: Any, tau: Any, *, wrench: Any = None,
                         out: Array | None = None) -> Array:
        """Return udot = M^-1 (tau + external - bias), (n,); arguments as inverse_dynamics."""
        return self._dynamics('forward_dynamics', (q, u, tau), wrench, out)

    @compiled
    def mass_matrix(self, q: Any, *, out: Array | None = None) -> Array:
        """Return M(q), (n, n), armature included, kg m^2, kg m or kg."""
        return self._call('mass_matrix', (q,), out)

    @compiled
    def inverse_mass_matrix(self, q: Any, *, out: Array | None = None) -> Array:
        """Return the inverse of M(q), (n, n)."""
        return self._call('inverse_mass_matrix', (q,), out)

    @compiled
    def bias_force(self, q: Any, u: Any, *, out: Array | None = None) -> Array:
        """Return all that torque must hold at udot = 0: M's companion in the equations, (n,)."""
        return self._call('bias_force', (q, u), out)

    @compiled
    def gravity_force(self, q: Any, *, out: Array | None = None) -> Array:
        """Return the torque that holds gravity alone, (n,), N m or N."""
        return self._call('gravity_force', (q,), out)

    @compiled
    def friction_force(self, u: Any, *, out: Array | None = None) -> Array:
        """Return d u + mu tanh(u / u_s), (n,): the torque that damping and friction ask for."""
        return self._call('friction_force', (u,), out)

    @compiled
    def torque_terms(self, q: Any, u: Any, udot: Any, *, out: Array | None = None) -> Array:
        """Return inverse dynamics by source, (5, n): the rows of `TORQUE_TERMS`."""
        return self._call('torque_terms', (q, u, udot), out)

    @compiled
    def kinetic_energy(self, q: Any, u: Any, *, out: Array | None = None) -> Any:
        """Return 1/2 u^T M u, J; a float, or (N,) for a batch."""
        return self._call('kinetic_energy', (q, u), out)

    @compiled
    def potential_energy(self, q: Any, *, out: Array | None = None) -> Any:
        """Return the energy of gravity (zero at the world's origin) and springs, J."""
        return self._call('potential_energy', (q,), out)

    def frame_pose(self, frame: str, q: Any, *, out: Array | None = None) -> Array:
        """Return the (4, 4) pose of a frame in the world, m."""
        return self._at_frame('frame_pose', frame, (q,), out)

    def frame_velocity(self, frame: str, q: Any, u: Any, *, out: Array | None = None) -> Array:
        """Return (6,): linear then angular velocity at a frame's origin, world axes."""
        return self._at_frame('frame_velocity', frame, (q, u), out)

    def frame_acceleration(self, frame: str, q: Any, u: Any, udot: Any, *,
                           out: Array | None = None) -> Array:
        """Return (6,): classical linear then angular acceleration, without gravity."""
        return self._at_frame('frame_acceleration', frame, (q, u, udot), out)

    def partial_velocities(self, frame: str, q: Any, *, out: Array | None = None) -> Array:
        """Return (6, n): column r is the frame's linear then angular velocity per unit u_r."""
        return self._at_frame('partial_velocities', frame, (q,), out)

    def compile(self) -> None:
        """Compile every kernel now (frame quantities compile at the first use of a frame)."""
        for name in QUANTITIES:
            try:
                getattr(self, name)
            except ModelError:
                continue  # no forward dynamics with massless joints; a call says so

    def verify(self, states: int = 5) -> float:
        """
        Compare the compiled kernels with Kane's equations as defined, at random states.

        Returns
        -------
        float
            The largest error found, relative to the largest entry of its quantity. Forward
            dynamics is judged by the torque that its answer asks for.

        Raises
        ------
        CompileError
            An error is larger than 1e-9: names the quantity and the error.
        """
        rng = np.random.default_rng(0)
        gravity, payload = self.parameters.gravity, self.parameters.payload
        model = self.model
        if payload is not None and self.equations.payload_frame is not None:
            model = with_payload(model, self.equations.payload_frame.name, payload)
        worst = 0.0
        for _ in range(states):
            q, u, udot = rng.uniform(-2.0, 2.0, (3, self.n))
            M = kane.mass_matrix(model, q)
            bias = kane.bias_force(model, q, u, gravity=gravity, friction=self.friction)
            tau = M @ udot + bias
            pairs = {
                'mass_matrix': (self.mass_matrix(q), M),
                'bias_force': (self.bias_force(q, u), bias),
                'gravity_force': (self.gravity_force(q),
                                  kane.gravity_force(model, q, gravity=gravity)),
                'inverse_dynamics': (self.inverse_dynamics(q, u, udot), tau)}
            if np.linalg.cond(M) < 1e12:
                pairs['forward_dynamics'] = (M @ self.forward_dynamics(q, u, tau) + bias, tau)
            for name, (value, reference) in pairs.items():
                size = max(float(np.abs(reference).max()), 1e-300)
                error = float(np.abs(value - reference).max()) / size
                if not error < VERIFIED:
                    raise CompileError(f'{name} is off by {error:.3g} of its size from the '
                                       f'definition; at most {VERIFIED:g} is rounding')
                worst = max(worst, error)
        return worst

    def operation_count(self) -> dict[str, OperationCount]:
        """Return the arithmetic of one call of every kernel."""
        return {name: self.program(name).operation_count() for name in QUANTITIES}

    def program(self, name: str) -> Program:
        """Trace a quantity and return its program."""
        quantity = QUANTITIES[name]
        wrench = quantity.wrench and bool(self.equations.wrench_frames)
        method = getattr(self.equations, name)

        def function(*inputs: Any) -> Any:
            *given, parameters = inputs
            if quantity.wrench and not wrench:
                given.append(None)
            return method(*given, parameters) if quantity.parameters else method(*given)
        return trace_program(name, function, self._inputs(quantity, wrench))

    def kernel(self, name: str) -> Kernel:
        """Return the kernel of a quantity, compiling it at the first use."""
        def make() -> Kernel:
            quantity = QUANTITIES[name]
            arguments = [self._state(key) for key in quantity.arguments]
            if quantity.wrench and self.equations.wrench_frames:
                arguments.append(Argument('wrench', self._no_wrench.shape,
                                          default=self._no_wrench))
            return Kernel(name, lambda: self.program(name), self._key, arguments,
                          self.parameters.block, quantity.shape(self.n))
        return self._kept((name, ''), make)

    def extra_kernel(self, name: str, program: Callable[[], Program],
                     arguments: Sequence[Argument], block: Array, shape: Shape) -> Kernel:
        """Return a kernel of the caller's own on this robot, compiling it at the first use."""
        return self._kept((name, ''), lambda: Kernel(name, program, self._key, arguments, block,
                                                     shape))

    def rigid_program(self) -> Program:
        """Trace inverse dynamics without friction, the part that feedback linearisation needs."""
        equations = self.equations
        quantity = QUANTITIES['inverse_dynamics']

        def function(q: Any, u: Any, udot: Any, *rest: Any) -> Any:
            wrench = rest[0] if equations.wrench_frames else None
            return equations.rigid_dynamics(q, u, udot, wrench, rest[-1])
        return trace_program('rigid_dynamics', function,
                             self._inputs(quantity, bool(equations.wrench_frames)))

    def _kept(self, key: tuple[str, str], make: Callable[[], Kernel]) -> Kernel:
        if key not in self._kernels:
            self._kernels[key] = make()
        return self._kernels[key]

    def _state(self, name: str) -> Argument:
        return Argument(name, (self.n,), self.coordinate_names)

    def _inputs(self, quantity: Quantity, wrench: bool) -> list[tuple[str, Shape]]:
        inputs: list[tuple[str, Shape]] = [(name, (self.n,)) for name in quantity.arguments]
        if wrench:
            inputs.append(('wrench', self._no_wrench.shape))
        return [*inputs, ('parameters', self.parameters.block.shape)]

    def _call(self, name: str, arguments: tuple[Any, ...], out: Array | None) -> Array:
        result: Array = self.kernel(name)(*arguments, out=out)
        return result

    def _dynamics(self, name: str, arguments: tuple[Any, ...], wrench: Any,
                  out: Array | None) -> Array:
        if self.equations.wrench_frames:
            arguments = (*arguments, wrench)
        elif wrench is not None:
            raise InputError('wrench is given but no frame may carry one: construct the Robot '
                             'with wrench_frames=')
        return self._call(name, arguments, out)

    def _at_frame(self, name: str, frame: str, arguments: tuple[Any, ...],
                  out: Array | None) -> Array:
        """Call a frame's kernel by its entry; compile it at the first use."""
        entry = self._frame_entries.get((name, frame))
        if entry is None:
            kernel = self._kept((name, frame), lambda: self._frame_kernel(name, frame))
            entry = self._frame_entries[name, frame] = kernel.entry('', kernel)
        result: Array = entry(*arguments) if out is None else entry(*arguments, out=out)
        return result

    def _frame_kernel(self, name: str, frame_name: str) -> Kernel:
        quantity, frame = FRAME_QUANTITIES[name], self.model.frame(frame_name)

        def function(*inputs: Any) -> Any:
            links = self.equations.links(inputs[-1])
            if name in ('frame_velocity', 'frame_acceleration'):
                q, u, *udot = inputs[:-1]
                motion = frames.frame_motion(links, frame, q, u,
                                             udot[0] if udot else self.equations.zeros)
                return motion[0 if name == 'frame_velocity' else 1]
            return getattr(frames, name)(links, frame, inputs[0])
        return Kernel(name, lambda: trace_program(name, function, self._inputs(quantity, False)),
                      self._key + frame_name, [self._state(k) for k in quantity.arguments],
                      self.parameters.block, quantity.shape(self.n))


def _restored(model: Model, options: dict[str, Any], gravity: Array,
              payload: Inertial | None) -> Robot:
    robot = Robot(model, **options)
    robot.parameters.gravity = gravity
    if payload is not None:
        robot.parameters.payload = payload
    return robot
