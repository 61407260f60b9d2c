"""Checks of arguments: shapes, finite numbers, ranges; errors name what is wrong."""

from collections.abc import Callable, Sequence
import math
from typing import Any
import warnings

from kane_dynamics._util.text import SHORT
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError, KaneError, ModelError, ModelWarning
import numpy as np
from numpy.typing import ArrayLike

LEAST_LIMIT, LARGEST_LIMIT = 1e-9, 1e12  # of joints, SI units
FULL_TURN = 2.0 * math.pi + 1e-3  # rad; of decimal angles too


def constant(value: ArrayLike, shape: tuple[int, ...], what: str,
             error: type[KaneError] = ModelError) -> Array:
    """Return `value` as a finite, read-only float array of `shape`, or raise `error`."""
    expected = f'finite numbers of shape {shape}' if shape else 'a finite number'
    try:
        array = np.array(real_numbers(value))
    except (TypeError, ValueError):
        raise error(f'{what}: {value!r}; expected {expected}') from None
    if array.shape != shape or not np.isfinite(array).all():
        raise error(f'{what}: {value!r}; expected {expected}')
    array.flags.writeable = False
    return array


def real_numbers(value: Any) -> Array:
    """Return `value` as an array of floats; raise TypeError or ValueError if it is none."""
    array = np.asarray(value)
    # NumPy would drop imaginary parts, and count True as 1.
    if array.dtype.kind in 'cb':
        raise TypeError(f'{array.dtype} numbers')
    return np.asarray(array, dtype=np.float64)


def shape_of(value: ArrayLike, what: str) -> tuple[int, ...]:
    """Return the shape of an array; raise InputError if rows have different lengths."""
    try:
        return np.shape(value)
    except ValueError:
        raise InputError(f'{what}: not rectangular; expected an array of numbers') from None


def per_joint(value: ArrayLike, what: str, names: Sequence[str], *,
              finite: bool = True, part: str = 'joint', signed: bool = False) -> Array:
    """
    Return one number, or one per joint, as a read-only (n,) array of numbers >= 0.

    `signed` allows numbers < 0 too. Messages call an entry that of a `part`.

    Raises
    ------
    InputError
        If a number is invalid; the message names `what`, the joint and the value.

    """
    try:
        numbers = np.array(value)
        if numbers.dtype.kind not in 'iuf':  # neither truth values nor text
            raise ValueError
        array = numbers.astype(np.float64)
    except (TypeError, ValueError):
        raise InputError(f'{what}: {value!r}; expected one number, or one per '
                         f'{part}') from None
    # One number for all, or one for each by its place.
    if array.shape not in ((), (len(names),)):
        raise InputError(f'{what}: {value!r}; expected one number, or {len(names)} '
                         f'({", ".join(names)})')
    array = np.full(len(names), array)
    lowest = -math.inf if signed else 0.0
    expected = 'a finite number' if finite else 'a number'
    if not signed:
        expected += ' >= 0'
    for name, number in zip(names, array.tolist(), strict=True):
        if not number >= lowest or (finite and math.isinf(number)):
            raise InputError(f"{what} of {part} '{name}': {number}; expected {expected}")
    array.flags.writeable = False
    return array


def limit_per_joint(value: ArrayLike, what: str, names: Sequence[str]) -> Array:
    """
    Return a limit per joint, (n,): 0, infinite, or of a size that computations resolve.

    Raises
    ------
    InputError
        If a limit is invalid, or no machine has it; the message names the joint.

    """
    stated: object = value
    if isinstance(stated, float) and stated == math.inf:  # the default of most calls
        unlimited = np.full(len(names), math.inf)
        unlimited.flags.writeable = False
        return unlimited
    limits = per_joint(value, what, names, finite=False)
    for name, limit in zip(names, limits.tolist(), strict=True):
        if limit and not (LEAST_LIMIT <= limit <= LARGEST_LIMIT or math.isinf(limit)):
            raise InputError(f"{what} of joint '{name}': {limit:g}; expected from "
                             f'{LEAST_LIMIT:g} to {LARGEST_LIMIT:g}, or inf for no limit')
    return limits


def finite_times(value: ArrayLike) -> Array:
    """Return one time or times, s; raise InputError unless they are finite numbers."""
    try:
        return constant(value, np.shape(value), 't', InputError)
    except ValueError:  # rows of several lengths
        raise InputError(f't: {SHORT.repr(value)}; expected finite numbers') from None


def names_of_joints(value: Any, what: str = 'joint_names') -> tuple[str, ...]:
    """Return names of joints as a tuple; raise InputError for anything else."""
    is_sequence = isinstance(value, Sequence) and not isinstance(value, (str, bytes))
    if not is_sequence or not all(isinstance(name, str) for name in value):
        raise InputError(f'{what}: {SHORT.repr(value)}; expected a sequence of names')
    return tuple(value)


def finite_row(values: ArrayLike, what: str, names: Sequence[str], *,
               part: str = 'joint') -> Array:
    """
    Return one finite number per joint, or per another `part`, (n,).

    Raises
    ------
    InputError
        If a number is missing or not finite; the message names `what`, the joint and its
        value.

    """
    try:
        array = real_numbers(values)
    except (TypeError, ValueError):
        raise InputError(f'{what}: {values!r}; expected {len(names)} numbers '
                         f'({", ".join(names)})') from None
    if array.shape != (len(names),):
        raise InputError(f'{what}: shape {array.shape}; expected {(len(names),)} '
                         f'({", ".join(names)})')
    if not all(map(math.isfinite, array.tolist())):  # short rows: faster than numpy
        for name, value in zip(names, array.tolist(), strict=True):
            if not math.isfinite(value):
                raise InputError(f"{what} of {part} '{name}': {value}; expected a finite "
                                 'number')
    return array


def integer(value: Any, what: str, least: int, most: int | None = None) -> int:
    """Return an integer within bounds; raise InputError for anything else."""
    is_integer = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if is_integer and value >= least and (most is None or value <= most):
        return int(value)
    bounds = f'>= {least}' if most is None else f'from {least} to {most}'
    raise InputError(f'{what}: {SHORT.repr(value)}; expected an integer {bounds}')


def number(value: Any, what: str, expected: str,
           valid: Callable[[float], bool]) -> float:
    """Return a number that is `valid`; raise InputError for anything else."""
    try:
        result = float(value)
    except (TypeError, ValueError):
        result = math.nan
    is_number = not isinstance(value, str | bool | np.bool_)
    if not is_number or not valid(result):
        raise InputError(f'{what}: {SHORT.repr(value)}; expected {expected}')
    return result


def instance(value: object, kind: type, what: str) -> None:
    """Raise InputError unless a value is of a class."""
    if not isinstance(value, kind):
        raise InputError(f'{what}: a {type(value).__name__}; expected a {kind.__name__}')


def robot_like(value: object) -> None:
    """Raise InputError unless a value is a Robot, or has its methods."""
    if isinstance(value, type) or not hasattr(value, 'inverse_dynamics'):
        raise InputError(f'robot: a {type(value).__name__}; expected a Robot')


def warn_of_turns(angles: Array, what: str, stacklevel: int) -> None:
    """Warn of an angle of an orientation, rad, beyond a full turn, as degrees are."""
    largest = float(np.abs(angles).max(initial=0.0))
    if largest > FULL_TURN:
        warnings.warn(f'{what}: {largest:g} rad; expected rad, at most a full turn: are '
                      'these degrees?', ModelWarning, stacklevel=stacklevel + 1)


def positive_time(value: Any, what: str, otherwise: str = '') -> float:
    """
    Return a positive, finite time in s.

    Raises
    ------
    InputError
        If it is not; the message names `what` and the value, and what else is accepted
        (`otherwise`).

    """
    is_number = not isinstance(value, bool | np.bool_ | str)
    # NaN passes no comparison.
    number = math.nan
    try:
        number = float(value)
    except (TypeError, ValueError):
        is_number = False
    if is_number and math.isfinite(number) and number > 0.0:
        return number
    shown = f'{number:g} s' if is_number else SHORT.repr(value)
    raise InputError(
        f'{what}: {shown}; expected a positive, finite time in s{otherwise}')


def increasing(t: ArrayLike, count: int, what: str) -> Array:
    """
    Return increasing times, one per row, (count,), s.

    Raises
    ------
    InputError
        If their number differs, or one is not finite or not larger than the previous
        one; the message names the row.

    """
    try:
        times = real_numbers(t)
    except (TypeError, ValueError):
        raise InputError(f'{what}: {SHORT.repr(t)}; expected ({count},) times, s') from None
    if times.shape != (count,):
        raise InputError(f'{what}: shape {times.shape}; expected ({count},), one time '
                         'per row')
    # The first row that is wrong, for the message.
    finite = np.isfinite(times)
    if not finite.all():
        k = int(np.argmin(finite))
        raise InputError(f'{what}: {times[k]} in row {k + 1}; expected a finite time, s')
    rises = np.diff(times) > 0.0
    if not rises.all():
        k = int(np.argmin(rises)) + 1
        raise InputError(f'{what}: {times[k]} in row {k + 1}, after {times[k - 1]}; '
                         'expected times that increase from row to row')
    return times
