"""Checks of arguments: shapes, finiteness, ranges; errors name the thing and its value."""

from collections.abc import Sequence
import math
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, KaneError, ModelError
import numpy as np
from numpy.typing import ArrayLike


def constant(value: ArrayLike, shape: tuple[int, ...], what: str,
             error: type[KaneError] = ModelError) -> Array:
    """Return `value` as a finite, read-only float array of `shape`, or raise `error`."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise error(f'{what} is {value!r}; expected {shape} finite numbers') from None
    if array.shape != shape or not np.isfinite(array).all():
        raise error(f'{what} is {value!r}; expected finite numbers of shape {shape}')
    array.flags.writeable = False
    return array


def per_joint(value: ArrayLike, what: str, names: Sequence[str], *,
              finite: bool = True) -> Array:
    """
    Return one number, or one a joint, as a read-only (n,) array of numbers >= 0.

    Raises
    ------
    InputError
        Names `what`, the joint, the value and what is valid.

    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f'{what} is {value!r}; expected one number, or one a joint') from None
    if array.shape not in ((), (len(names),)):
        raise InputError(f'{what} is {value!r}; expected one number, or {len(names)} '
                         f'({", ".join(names)})')
    array = np.broadcast_to(array, len(names)).copy()
    for name, number in zip(names, array.tolist(), strict=True):
        if not number >= 0.0 or (finite and math.isinf(number)):
            raise InputError(f"{what} of joint '{name}' is {number}; expected a "
                             f'{"finite " if finite else ""}number >= 0')
    array.flags.writeable = False
    return array


def finite_row(values: ArrayLike, what: str, names: Sequence[str]) -> Array:
    """
    Return one finite number per joint, (n,).

    Raises
    ------
    InputError
        Names `what`, the joint and its value.

    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f'{what} is {values!r}; expected {len(names)} numbers '
                         f'({", ".join(names)})') from None
    if array.shape != (len(names),):
        raise InputError(f'{what} has shape {array.shape}; expected {(len(names),)} '
                         f'({", ".join(names)})')
    if not all(map(math.isfinite, array.tolist())):  # short rows: faster than numpy
        for name, value in zip(names, array.tolist(), strict=True):
            if not math.isfinite(value):
                raise InputError(f"{what} of joint '{name}' is {value}; expected a finite number")
    return array


def positive_time(value: Any, what: str, otherwise: str = '') -> float:
    """
    Return a positive, finite time in s.

    Raises
    ------
    InputError
        Names `what` and the value; `otherwise` names what else is accepted.

    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and number > 0.0):
        given = repr(value) if isinstance(value, str) or value is None else f'{number:g} s'
        raise InputError(f'{what} is {given}; expected a positive, finite time in s{otherwise}')
    return number


def increasing(t: ArrayLike, count: int, what: str) -> Array:
    """
    Return the times of rows, (count,), s.

    Raises
    ------
    InputError
        They are not so many, not finite, or do not increase from row to row: says which.

    """
    times = np.asarray(t, dtype=np.float64)
    if times.shape != (count,):
        raise InputError(f'{what} has shape {times.shape}; expected ({count},), one time a row')
    finite = np.isfinite(times)
    if not finite.all():
        k = int(np.argmin(finite))
        raise InputError(f'{what} is {times[k]} in row {k + 1}; expected a finite time, s')
    rises = np.diff(times) > 0.0
    if not rises.all():
        k = int(np.argmin(rises)) + 1
        raise InputError(f'{what} is {times[k]} in row {k + 1}, after {times[k - 1]}; it must '
                         'increase from row to row')
    return times
