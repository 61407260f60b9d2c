"""Laws as kernels of a robot: settings in one array, checks of the configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
import math
from typing import Any

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.control.computed_torque import require_following
from kane_dynamics.control.terms import Terms
from kane_dynamics.control.torque_limiter import lowered_efforts
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.lanes import Lanes
from kane_dynamics.mechanics.constraints.conditioning import guarded
from kane_dynamics.native.python_call.entry import CallForm, FIXED, OPTIONAL, REQUIRED
from kane_dynamics.native.runtime.kernel import Argument, Kernel
from kane_dynamics.native.tracing.expression import Expr
from kane_dynamics.native.tracing.program import Shape
from kane_dynamics.native.tracing.wide import WideLanes
from kane_dynamics.robot.robot import in_regular_speeds, Robot
from kane_dynamics.task_space.pose_checks import require_pose
import numpy as np
from numpy.typing import ArrayLike

UNLIMITED = 1e300  # stands for an infinite limit in the settings of a kernel


class Settings:
    """
    Names and shapes of the settings of a law, which are one array for its kernel.

    Parameters
    ----------
    shapes : mapping of str to shape
        In the order of the array.

    Attributes
    ----------
    size : int
        Length of the array.

    """

    def __init__(self, shapes: Mapping[str, Shape]) -> None:
        self.shapes = dict(shapes)
        self.size = sum(map(math.prod, self.shapes.values()))

    def place(self, name: str) -> slice:
        """Return where the array has a setting."""
        first = 0
        for other, shape in self.shapes.items():
            if other == name:
                return slice(first, first + math.prod(shape))
            first += math.prod(shape)
        raise KeyError(name)

    def packed(self, values: Mapping[str, Any]) -> Array:
        """Return the array of settings; infinite numbers become `UNLIMITED`."""
        parts = []
        for name, shape in self.shapes.items():
            array = np.asarray(values[name], dtype=np.float64)
            parts.append(np.broadcast_to(array, shape).ravel())
        result: Array = np.clip(np.concatenate(parts), -UNLIMITED, UNLIMITED)
        return result

    def unpacked(self, block: Vector) -> dict[str, Any]:
        """Return the settings by name; those of shape () as scalars."""
        values: dict[str, Any] = {}
        first = 0
        for name, shape in self.shapes.items():
            size = math.prod(shape)
            values[name] = block[first:first + size].reshape(shape)[()]
            first += size
        return values


class RunTimeSettings:
    """
    Base of laws whose settings change between two calls, without compiling.

    A subclass names its settings in `_changeable` and checks them in `_checked`.
    """

    _changeable: tuple[str, ...] = ()
    _shapes: Settings

    def __init__(self, robot: Robot, shapes: Settings) -> None:
        self.robot = robot
        self._shapes = shapes
        self._values: dict[str, Any] = {}
        self._block = np.zeros(shapes.size)

    def update(self, **settings: Any) -> None:
        """
        Change settings of the constructor between two calls; the others stay.

        On an InputError no setting changes.
        """
        unknown = sorted(settings.keys() - set(self._changeable))
        if unknown:
            raise InputError(f'update: {", ".join(unknown)}; expected some of '
                             f'{", ".join(self._changeable)}')
        # Copies, so that arrays of the caller may change without effect here.
        values = {**self._values, **deepcopy(settings)}
        block = self._shapes.packed(self._checked(values))
        self._values = values
        self._block[:] = block  # in place: entry points read it there

    def _checked(self, values: dict[str, Any]) -> dict[str, Any]:
        """Return the numbers of the kernel by name, from checked settings."""
        raise NotImplementedError

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes of a copy: its own settings, and no compiled function."""
        state = {**self.__dict__, '_block': self._block.copy()}
        state.pop('_law', None)
        return state


def settings_of(law: RunTimeSettings) -> Array:
    """Return the settings of a law as its kernel takes them."""
    return law._block.copy()


class PoseLaw(RunTimeSettings):
    """
    Base of laws by which a frame follows a pose: their torques, of one signature.

    The first call of `torque` replaces it, on this object, by an entry point of the
    kernel, which takes the same arguments and falls back to the method.
    """

    # Names and kinds of what the kernel gets before the settings, as of `CallForm`.
    _arguments: tuple[tuple[str, int], ...] = (
        ('q', REQUIRED), ('u', REQUIRED), ('pose', REQUIRED), ('twist', OPTIONAL),
        ('acceleration', OPTIONAL), ('wrench', OPTIONAL))

    def __init__(self, robot: Robot, shapes: Settings) -> None:
        super().__init__(robot, shapes)
        # What a call reads, at once: each attribute of a class with hints takes as long
        # to read as ten entries of a tuple.
        self._call: tuple[Any, ...] | None = None
        self._zero = np.zeros(6)

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes of a copy, without the entry point of this object."""
        state = {**super().__getstate__(), '_call': None}
        state.pop('torque', None)
        return state

    @lazy_property
    def _law(self) -> Callable[..., Array]:
        """Return the entry point of the torques, compiled at the first use."""
        return self._compiled()

    def _call_fields(self) -> tuple[Any, ...]:
        """Return and keep what a call reads."""
        self._call = self._law, self._block, self._zero
        owner = next(kind for kind in type(self).__mro__ if 'torque' in vars(kind))
        # The method of another package's subclass stays.
        if owner.__module__.startswith('kane_dynamics.'):
            self.__dict__['torque'] = self._by_name()
        return self._call

    def _stand_ins(self) -> dict[str, Any]:
        """Return the values of arguments that are left out, and of fixed ones."""
        return dict.fromkeys(('twist', 'acceleration', 'wrench'), self._zero)

    def _by_name(self) -> Callable[..., Array]:
        """Return the entry point that replaces `torque` on this object."""
        names = [name for name, _ in self._arguments]
        kinds = [kind for _, kind in self._arguments]
        stand_ins = self._stand_ins()
        form = CallForm((*names, 'settings'), (*kinds, FIXED),
                        (*map(stand_ins.get, names), self._block))
        method = type(self).torque
        return self._kernel().entry_by_name(method.__doc__ or '', form,
                                            method.__get__(self), self._memory)

    _memory: str | None = None  # the argument of the kernel that its calls update

    def _kernel(self) -> Kernel:
        """Return the kernel of the torques."""
        raise NotImplementedError

    def _compiled(self) -> Callable[..., Array]:
        """Compile the torques and return their entry point."""
        kernel = self._kernel()
        if self._memory is None:
            return kernel.entry('', kernel)
        return kernel.entry_with_memory('', self._memory)

    def torque(self, q: ArrayLike, u: ArrayLike, pose: ArrayLike,
               twist: ArrayLike | None = None, acceleration: ArrayLike | None = None,
               wrench: ArrayLike | None = None, t: float = 0.0) -> Array:
        """
        Return the torques of the joints, (n_q,).

        Parameters
        ----------
        q, u : (n_q,), (n,) array_like
            The measured state, rad or m, s.
        pose : (4, 4) array_like
            The target in the world, m.
        twist, acceleration : (6,) array_like, optional
            Of the target: linear at the frame's origin, then angular; world axes.
            Default: at rest.
        wrench : (6,) array_like, optional
            Force and moment to exert on the environment at the frame's origin, world
            axes, N, N m.
        t : float
            Time, s, where speeds or constraints depend on it.

        Raises
        ------
        InputError
            A wrong shape, a number that is not finite, or no pose.
        ConstraintError
            The configuration is open or singular.

        """
        # The fields of the call in one tuple, filled at the first call.
        call = self.__dict__['_call'] or self._call_fields()
        law, block, zero = call
        if twist is None:
            twist = zero
        if acceleration is None:
            acceleration = zero
        if wrench is None:
            wrench = zero
        torques: Array = law(q, u, pose, twist, acceleration, wrench, block, t)
        return torques


def checked_terms(value: Any) -> Terms:
    """Return terms of the model; InputError for anything else."""
    if not isinstance(value, Terms):
        raise InputError(f'compensate: {value!r}; expected Terms')
    return value


def checked_effort(robot: Robot, stated: ArrayLike | None) -> Array:
    """Return effort limits, (n,): the robot's, or smaller stated ones."""
    stated = np.inf if stated is None else stated
    return lowered_efforts(robot.limits.effort, stated, robot.joint_names)


LanesOf = Callable[[Scalar], Any]
StateAt = tuple[Vector, Vector, Scalar, Vector]  # q, u, t, and the robot's parameters
Law = Callable[..., Vector]  # of the inputs; wrench, t, parameters and limits by name


def law_kernel(robot: Robot, law_of: Callable[[Robot, LanesOf], Law], name: str,
               inputs: Mapping[str, Shape | Argument], shape: Shape,
               followed: Sequence[int] = ()) -> Kernel:
    """
    Return a law as a kernel of the robot, which refuses open or singular configurations.

    Parameters
    ----------
    robot : Robot
        Its speeds are those of the law.
    law_of : callable
        Returns the law of a robot as a function over any scalar, of the inputs and of
        `t`, `parameters`, all of which it must take. Its result is torques of the
        joints first. Its second argument returns the functions of `Lanes` for a scalar
        of q: those of SIMD instructions for single states.
    name : str
        Distinguishes laws of one class with other frames, axes or directions.
    inputs : mapping of str to shape
        q and u first.
    shape : tuple of int
        Of the result.
    followed : sequence of int
        Joints that must determine the motion.

    """
    equations = robot.equations

    # The law, NaN at singular or open configurations.
    def watched(law: Law) -> Law:

        def guarded_law(*inputs: Vector, t: Scalar, parameters: Vector,
                        limits: Vector) -> Vector:
            result = law(*inputs, t=t, parameters=parameters)
            if not equations.watched:  # a tree has no singular or open configuration
                return result
            return guarded(result, equations.margin(inputs[0], t, limits))
        return guarded_law

    def reason(state: dict[str, Array]) -> Kernel | None:
        """Return the law with rows that are regular at a state, or None; may raise."""
        # Errors in the arguments first, then speeds that are regular at this state.
        if 'pose' in state:
            require_pose(state['pose'])
        if followed and not equations.in_joint_rates:
            t = float(state.get('t', np.zeros(())))
            require_following(robot, followed, state['q'], t)
        regular = in_regular_speeds(robot, state)
        if regular is None:
            return None
        return law_kernel(regular, law_of, name, inputs, shape, followed)
    return robot.kernels.compiled(watched(law_of(robot, lanes_of_scalars)), name, inputs,
                                  shape, reason=reason,
                                  single=watched(law_of(robot, lanes_of_single_states)))


def lanes_of_single_states(scalar: Scalar) -> Any:
    """Return the functions of lanes: of SIMD instructions for a traced scalar."""
    return WideLanes(scalar.trace) if isinstance(scalar, Expr) else Lanes


def lanes_of_scalars(scalar: Scalar) -> Any:
    """Return the functions of lanes for any scalar."""
    return Lanes
