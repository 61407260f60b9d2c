"""Dispatch of a robot's methods to their compiled kernels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, Self, TypeVar

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, ModelError
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.model.drive import ElasticJoint
from kane_dynamics.native.python_call.entry import chooser
from kane_dynamics.native.runtime.kernel import Argument, converted
from kane_dynamics.native.runtime.threads import run_concurrently
from kane_dynamics.native.tracing.program import OperationCount
from kane_dynamics.robot.kernel_set import At, KernelSet
import numpy as np

Method = TypeVar('Method', bound=Callable[..., Any])
# What a robot may lack: accelerations do not follow from torques where a joint moves no mass
# or a drive is self-locking, and a robot without mass has no center of it.
LACKING = {'forward_dynamics', 'inverse_mass_matrix', 'forward_dynamics_derivatives',
           'constraint_forces', 'center_of_mass', 'center_of_mass_jacobian',
           'centroidal_momentum', 'centroidal_momentum_matrix',
           'centroidal_momentum_rate'}


class _Compiled:
    """
    A method that the first access replaces by entry points of machine code.

    Parameters
    ----------
    checked : callable
        The method: its body serves calls that an entry point does not.
    parted : str, optional
        The quantity of a frame, frames or a joint, which the first argument names. Each
        has an entry point from its second call on. By default the method has one kernel,
        of its name, if the robot has that quantity.

    """

    def __init__(self, checked: Callable[..., Any], parted: str | None = None) -> None:
        self.checked = checked
        self.parted = parted
        self.__doc__ = checked.__doc__

    def __get__(self, robot: Dispatch | None, owner: type | None = None) -> Any:
        if robot is None:
            return self.checked
        name = self.checked.__name__
        function: Any = self.checked.__get__(robot)
        if self.parted is not None:
            function = self._of_parts(robot, self.parted)
        elif name in robot.kernels.names:  # else it is of several kernels, or an error
            kernel = robot.kernels.kernel(name)
            parts = robot.kernels.parts(name)
            function = kernel.entry(self.checked.__doc__ or '', function, parts)
        robot.__dict__[name] = function
        return function

    def _of_parts(self, robot: Dispatch, quantity: str) -> Callable[..., Any]:
        """Return a function that calls the entry point of its first argument."""
        entries: dict[Any, Callable[..., Any]] = {}

        def first(*values: Any, **named: Any) -> Any:
            result = self.checked(robot, *values, **named)
            if values and type(values[0]) in (str, tuple) and values[0] not in entries:
                kernel = robot.kernels.kernel(quantity, values[0])
                entries[values[0]] = kernel.entry('', partial(self.checked, robot,
                                                              values[0]))
            return result
        return chooser(self.checked.__name__, self.checked.__doc__ or '', entries, first)


def compiled(method: Method) -> Method:
    """Decorate a method to call the kernel of its name, or else its body."""
    return _Compiled(method)  # type: ignore[return-value]


def of_frame(quantity: str) -> Callable[[Method], Method]:
    """Return a decorator of a method whose first argument is a frame, frames, or a joint."""
    return partial(_Compiled, parted=quantity)  # type: ignore[return-value]


def of_one_frame(wrench: Any, batch: tuple[int, ...], frames: int) -> Any:
    """Return wrenches (6,) or (N, 6) as (1, 6) or (N, 1, 6) of a single frame."""
    if frames == 1 and np.ndim(wrench) == 1 + len(batch) and np.shape(wrench) == (*batch,
                                                                                  6):
        return np.asarray(wrench)[..., None, :]
    return wrench


class Dispatch:
    """Calls of the kernels of a robot, for one state or a batch."""

    equations: Equations
    kernels: KernelSet

    def _call(self, name: str, arguments: tuple[Any, ...], out: Array | None,
              t: Any = 0.0, at: At = '') -> Array:
        """Call the kernel of a quantity, `at` a frame, frames or a joint."""
        kernel = self.kernels.kernel(name, at)
        result: Array = kernel(*self._at_time(arguments, t), out=out)
        return result

    def _loaded(self, name: str, arguments: tuple[Any, ...], wrench: Any,
                out: Array | None, t: Any = 0.0, at: str = '') -> Array:
        """
        Call the kernel of a quantity with wrenches; `at` is the joint of a reaction.

        A mapping of frames to wrenches is for the declared frames, or for kernels of its
        own frames, which compile at their first use.
        """
        if isinstance(wrench, Mapping):
            robot, rows = self._under(wrench)
            return robot._loaded(name, arguments, rows, out, t, at)
        frames = len(self.equations.wrench_frames)
        if frames:
            # A single wrench stands for all states and for the one frame.
            with suppress(ValueError):  # rows of several lengths, which the kernel refuses
                batch = np.shape(arguments[0])[:-1]
                wrench = of_one_frame(wrench, batch, frames)
            given = (*arguments, wrench)
        elif wrench is None:
            given = arguments
        else:
            raise InputError('wrench: an array, given to a robot without wrench frames; '
                             'expected '
                             'a mapping {frame: wrench}, or Robot(..., '
                             'wrench_frames=[...])')
        return self._call(name, given, out, t, at)

    def _under(self, wrenches: Mapping[str, Any]) -> tuple[Self, Array | None]:
        """Return a robot that declares the frames of wrenches, and its argument."""
        if not wrenches:
            return self, None
        rows = {}
        for frame, wrench in wrenches.items():
            self.equations.model.frame(frame)  # raises InputError
            rows[frame] = converted(Argument(f"wrench of '{frame}'", (6,)), wrench)
        shapes = {row.shape for row in rows.values()}
        if len(shapes) > 1:
            listed = ', '.join(map(str, sorted(shapes)))
            raise InputError(f'wrench: shapes {listed}; expected one shape, (6,) or (N, 6), '
                             'for all frames')
        # The declared frames if they suffice; else a robot of these frames alone.
        declared = tuple(frame.name for frame in self.equations.wrench_frames)
        robot = self
        frames = declared
        if not set(rows) <= set(declared):
            frames = tuple(sorted(rows))
            robot = self._declaring(frames)
        batch = shapes.pop()[:-1]
        stacked = np.zeros((*batch, len(frames), 6))
        for k, frame in enumerate(frames):
            stacked[..., k, :] = rows.get(frame, 0.0)
        return robot, stacked

    def _declaring(self, frames: tuple[str, ...]) -> Self:
        """Return this robot with other wrench frames, which shares the parameters."""
        raise NotImplementedError

    def _at_time(self, arguments: tuple[Any, ...], t: Any) -> tuple[Any, ...]:
        """Append the time, of all states or of each, if the equations depend on it."""
        return arguments + self.equations.time_inputs(t, arguments[0])

    def _at_frame(self, name: str, frame: str | Sequence[str], arguments: tuple[Any, ...],
                  out: Array | None, t: Any = 0.0) -> Array:
        """Call the kernel of a quantity of a frame, or of several frames."""
        at = tuple(frame) if isinstance(frame, list | tuple) else frame
        names = (at,) if isinstance(at, str) else at
        if not (isinstance(names, tuple) and names
                and all(isinstance(name, str) for name in names)):
            raise InputError(f'frame: a {type(frame).__name__}; expected a name (str) or '
                             'a sequence of names: the order is (frame, q)')
        assert isinstance(at, str | tuple)
        return self._call(name, arguments, out, t, at)

    @property
    def n(self) -> int:
        """Return the number of independent generalized speeds."""
        return self.equations.n

    @property
    def n_q(self) -> int:
        """Return the number of coordinates."""
        return self.equations.n_q

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the moving joints, in the order of their entries in q."""
        return self.equations.model.joint_names

    @property
    def drives(self) -> tuple[ElasticJoint, ...]:
        """Elastic joints: name, `Drive`, and indices of link and motor in u and tau."""
        return self.equations.model.drives

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the entries of q."""
        return self.equations.model.coordinate_names

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of the frames (links), for `jacobian`, `frame_pose` and others."""
        return tuple(frame.name for frame in self.equations.model.frames)

    def compile(self, *names: str, batches: bool = False) -> None:  # noqa: A003
        """
        Compile kernels now instead of at their first use.

        Parameters
        ----------
        *names : str
            Names of quantities; by default all but those of frames and joint reactions.
        batches : bool
            Compile their SIMD kernels for batches too.

        Raises
        ------
        InputError
            An unknown kernel; the message lists the valid names.
        ModelError, InputError
            The robot does not have a quantity of `names`, such as forward dynamics where a
            joint moves no mass or a drive is self-locking. Without `names`, that quantity
            is left out.

        """
        run_concurrently([partial(self._compile, name, batches, name in names)
                          for name in names or self.kernels.names])

    def _compile(self, name: str, batches: bool, is_named: bool) -> None:
        may_lack = name in LACKING and not is_named
        with suppress(*((ModelError, InputError) if may_lack else ())):
            kernel = self.kernels.kernel(name)
            kernel.compile_entry()
            if batches:
                kernel.compile_lanes()
            getattr(self, name)

    def operation_count(self) -> dict[str, OperationCount]:
        """Return the operation counts of every kernel, per call."""
        kernels = self.kernels
        return {name: kernels.program(name).operation_count() for name in kernels.names}
