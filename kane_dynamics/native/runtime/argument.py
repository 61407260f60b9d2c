"""Arguments of kernels: name, shape and default; checks of given values."""

from dataclasses import dataclass
import sys
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.native.backends.real_types import size_limit
from kane_dynamics.native.tracing.program import Shape
import numpy as np


@dataclass(frozen=True)
class Argument:
    """
    Name, shape and default of a kernel argument.

    Attributes
    ----------
    name : str
    shape : tuple of int
        Shape for a single state; a batch has one more leading axis.
    labels : tuple of str
        Names of the entries of the last axis, for messages.
    default : array, optional
        Used when the argument is not given; read at each call.

    """

    name: str
    shape: Shape
    labels: tuple[str, ...] = ()
    default: Array | None = None


def checked(argument: Argument, value: Any) -> Array:
    """Return a value as a finite C-contiguous float64 array; raise InputError otherwise."""
    array = converted(argument, value)
    require_finite(argument, array)
    return array


def converted(argument: Argument, value: Any) -> Array:
    """Return a value as a C-contiguous float64 array of one state or a batch."""
    name = argument.name
    shape = argument.shape
    expected = f'{shape} or (N, {", ".join(map(str, shape))})'
    # By the attribute, since numpy.ma is slow to import.
    masked = getattr(value, 'mask', None) if isinstance(value, np.ndarray) else None
    if masked is not None and np.any(masked):
        raise InputError(f'{name}: a masked array with {np.count_nonzero(masked)} masked '
                         f'entries; expected numbers of shape {expected}')
    try:
        array = np.asarray(value)
    except ValueError:
        raise InputError(f'{name}: not a rectangular array; expected shape {expected}') from None
    if array.dtype.kind not in 'fiu':
        raise InputError(f'{name}: dtype {array.dtype}; expected numbers of shape {expected}')
    if array.shape != shape and array.shape[1:] != shape:
        raise InputError(f'{name}: shape {array.shape}; expected {expected}')
    return np.asarray(array, dtype=np.float64, order='C')


def require_finite(argument: Argument, array: Array) -> None:
    """Raise InputError that names the first entry that is not finite or too large."""
    limit = size_limit(argument.name)
    good = np.abs(array) <= min(limit, sys.float_info.max)
    if good.all():
        return
    place = tuple(np.argwhere(~good)[0].tolist())
    number = array[place]
    entry = f'{argument.name}[{", ".join(map(str, place))}]'
    if argument.labels:
        entry += f" (joint '{argument.labels[place[-1]]}')"
    expected = 'a finite number'
    if np.isfinite(number):  # only positions have a limit
        expected += f' of at most {limit:g} rad or m'
    raise InputError(f'{entry}: {number}; expected {expected}')
