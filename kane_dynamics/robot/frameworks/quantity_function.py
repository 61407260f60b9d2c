"""Functions of a robot's quantities: arguments by name, checks of shapes, pickling."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.native.runtime.kernel import Argument
from kane_dynamics.robot.frameworks.batch_function import batch_function


class QuantityFunction:
    """
    A quantity as a function of arrays of another library.

    Parameters
    ----------
    robot : Robot
        The function keeps a copy, with the present gravity and payload.
    quantity, at : str
        A quantity, and its frame or joint or ''.
    parameters : str or sequence of str
        Run-time parameters that are arguments.

    Attributes
    ----------
    names : tuple of str
        Names of the arguments, in order.

    """

    def __init__(self, robot: Any, quantity: str, at: str,
                 parameters: str | Sequence[str]) -> None:
        """Check the names; the kernel compiles at the first call."""
        self._made_of: tuple[Any, ...] = robot.copy(), quantity, at, parameters
        self.function = batch_function(*self._made_of)
        self.names = tuple(a.name for a in self.function.arguments)

    def __repr__(self) -> str:
        """Return the name with its arguments."""
        return f'<{type(self).__name__} {self.function!r}>'

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the robot and the names."""
        return type(self), self._made_of

    def __deepcopy__(self, memo: dict[int, Any]) -> Any:
        """Return this function, which does not change."""
        return self

    def _given(self, arguments: Sequence[Any], named: Mapping[str, Any]) -> list[Any]:
        """Return all arguments in order; InputError unless each is given once."""
        # Arguments by position, then by name; none twice.
        by_name = dict(zip(self.names, arguments))
        refused = [name for name in named if name in by_name or name not in self.names]
        by_name.update(named)
        complete = all(name in by_name for name in self.names)
        if refused or not complete or len(arguments) > len(self.names):
            stated = ', '.join([f'{len(arguments)} by position', *named])
            raise InputError(f'{self.function.name}: arguments {stated}; expected '
                             f'{", ".join(self.names)}, each once')
        return [by_name[name] for name in self.names]

    def _require_batches(self, arrays: Sequence[Any],
                         broadcast: Callable[..., Any]) -> None:
        """Raise InputError unless shapes are right and batch axes broadcast."""
        # The axes before those of one state are the batch.
        batches = []
        for argument, x in zip(self.function.arguments, arrays):
            require_shape(argument, x)
            batches.append(x.shape[:x.ndim - len(argument.shape)])
        try:
            broadcast(*batches)
        except (RuntimeError, ValueError):
            shapes = [f'{name} {tuple(x.shape)}' for name, x in zip(self.names, arrays)]
            raise InputError(f'{self.function.name}: arguments {", ".join(shapes)}; '
                             'expected batch axes that broadcast') from None


def require_shape(argument: Argument, x: Any) -> None:
    """Raise InputError unless an array's last axes are those of one state."""
    shape = argument.shape
    if x.ndim < len(shape) or tuple(x.shape[x.ndim - len(shape):]) != shape:
        raise InputError(f'{argument.name}: shape {tuple(x.shape)}; expected {shape}, '
                         'with batch axes in front of it or without')
