"""`Robot`: a model with its dynamics compiled, what users hold."""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, TypeVar

from kane_dynamics.errors import InputError, ModelError
from kane_dynamics.kernel_set import KernelSet, QUANTITIES
from kane_dynamics.mechanics.equations import Equations, TORQUE_TERMS
from kane_dynamics.model import Array, Inertial, Model
from kane_dynamics.native.program import OperationCount
from kane_dynamics.parameters import JointLimits, Parameters
from kane_dynamics.verification import verified
from kane_dynamics.workspace import Workspace
import numpy as np

__all__ = ['Robot', 'TORQUE_TERMS']

Method = TypeVar('Method', bound=Callable[..., Any])


class _Compiled:
    """A method that, once used on a robot, gives way to its kernel's own entry there."""

    def __init__(self, checked: Callable[..., Any]) -> None:
        self.checked = checked
        self.__doc__ = checked.__doc__

    def __get__(self, robot: 'Robot | None', owner: type | None = None) -> Any:
        if robot is None:
            return self.checked
        name, fallback = self.checked.__name__, self.checked.__get__(robot)
        entry = robot.kernels.quantity(name).entry(self.checked.__doc__ or '', fallback)
        robot.__dict__[name] = entry
        return entry


def compiled(method: Method) -> Method:
    """Serve a method by the kernel of its name; its body is the road for unusual arguments."""
    return _Compiled(method)  # type: ignore[return-value]


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
        Use Denavit-Hartenberg-like frames inside the kernels. That saves arithmetic on most arms
        and costs some on a few; `operation_count` tells. The numbers are the same.

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
        key = model.digest() + repr(sorted(self._options.items()))
        self.kernels = KernelSet(self.equations, key, self.parameters.block)
        self._frame_entries: dict[tuple[str, str], Callable[..., Any]] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as model, options and parameters; kernels load again from the cache."""
        return _restored, (self.model, self._options, self.parameters.gravity,
                           self.parameters.payload)

    @property
    def n(self) -> int:
        """Return the number of generalized speeds."""
        return self.model.n

    @property
    def n_q(self) -> int:
        """Return the number of coordinates."""
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

    def bind(self) -> Workspace:
        """Return arrays with zero-argument calls on them, for a loop that must not allocate."""
        return Workspace(self.kernels)

    def compile(self) -> None:  # noqa: A003
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
        return verified(self, states)

    def operation_count(self) -> dict[str, OperationCount]:
        """Return the arithmetic of one call of every kernel."""
        return {name: self.kernels.program(name).operation_count() for name in QUANTITIES}

    def _call(self, name: str, arguments: tuple[Any, ...], out: Array | None) -> Array:
        result: Array = self.kernels.quantity(name)(*arguments, out=out)
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
            kernel = self.kernels.at_frame(name, frame)
            entry = self._frame_entries[name, frame] = kernel.entry('', kernel)
        result: Array = entry(*arguments) if out is None else entry(*arguments, out=out)
        return result


def _restored(model: Model, options: dict[str, Any], gravity: Array,
              payload: Inertial | None) -> Robot:
    robot = Robot(model, **options)
    robot.parameters.gravity = gravity
    if payload is not None:
        robot.parameters.payload = payload
    return robot
