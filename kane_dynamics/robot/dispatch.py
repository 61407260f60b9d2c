"""How a robot's methods reach their kernels."""

from collections.abc import Callable
from typing import Any, TypeVar

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.kernel_set import KernelSet
import numpy as np

Method = TypeVar('Method', bound=Callable[..., Any])


class _Compiled:
    """A method that, once used on a robot, gives way to its kernel's own entry there."""

    def __init__(self, checked: Callable[..., Any]) -> None:
        self.checked = checked
        self.__doc__ = checked.__doc__

    def __get__(self, robot: 'Dispatch | None', owner: type | None = None) -> Any:
        if robot is None:
            return self.checked
        name, fallback = self.checked.__name__, self.checked.__get__(robot)
        entry = robot.kernels.quantity(name).entry(self.checked.__doc__ or '', fallback)
        robot.__dict__[name] = entry
        return entry


def compiled(method: Method) -> Method:
    """Serve a method by the kernel of its name; its body is the road for unusual arguments."""
    return _Compiled(method)  # type: ignore[return-value]


class Dispatch:
    """Ways into the kernels of a robot, for one state or a batch."""

    equations: TreeEquations | ConstrainedEquations
    kernels: KernelSet
    _entries: dict[tuple[str, str], Callable[..., Any]]

    def _call(self, name: str, arguments: tuple[Any, ...], out: Array | None,
              t: Any = 0.0) -> Array:
        """Call the kernel of a quantity that takes no wrenches."""
        result: Array = self.kernels.quantity(name)(*self._at_time(arguments, t), out=out)
        return result

    def _loaded(self, kernel: Kernel, arguments: tuple[Any, ...], wrench: Any,
                out: Array | None, t: Any = 0.0) -> Array:
        """Call a kernel that takes wrenches, where frames for them are declared."""
        if self.equations.wrench_frames:
            given = (*arguments, wrench)
        elif wrench is None:
            given = arguments
        else:
            raise InputError('wrench is given but no frame may carry one: construct the Robot '
                             'with wrench_frames=')
        result: Array = kernel(*self._at_time(given, t), out=out)
        return result

    def _at_time(self, arguments: tuple[Any, ...], t: Any) -> tuple[Any, ...]:
        """Add the time where the equations depend on it: one for all states, or one each."""
        if not self.equations.timed:
            return arguments
        count = np.shape(arguments[0])[:-1]
        return (*arguments, np.full(count, t) if np.ndim(t) == 0 and count else t)

    def _at_frame(self, name: str, frame: str, arguments: tuple[Any, ...],
                  out: Array | None, t: Any = 0.0) -> Array:
        if not isinstance(frame, str):
            raise InputError(f'frame: a {type(frame).__name__}; expected a name (str): the order '
                             'is (frame, q)')
        if self.equations.timed:
            at_time = self._at_time(arguments, t)
            result: Array = self.kernels.at_frame(name, frame)(*at_time, out=out)
            return result
        entry = self._entry(name, frame, lambda at: self.kernels.at_frame(name, at))
        result = entry(*arguments) if out is None else entry(*arguments, out=out)
        return result

    def _entry(self, name: str, at: str, kernel: Callable[[str], Kernel]) -> Callable[..., Any]:
        """Return the way into a kernel of one frame or joint; it is compiled at its first use."""
        entry = self._entries.get((name, at))
        if entry is None:
            made = kernel(at)
            entry = self._entries[name, at] = made.entry('', made)
        return entry
