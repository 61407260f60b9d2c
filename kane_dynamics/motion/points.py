"""Check the points of a joint trajectory: names, times, positions, derivatives."""

from collections.abc import Iterable, Sequence
import math

from kane_dynamics._util.checks import finite_row, real_numbers
from kane_dynamics._util.text import SHORT
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
import numpy as np
from numpy.typing import ArrayLike

Start = tuple[ArrayLike, ArrayLike | None, ArrayLike | None]
State = tuple[Array, Array, Array]
Rows = Sequence[ArrayLike] | ArrayLike


def trajectory_points(times: ArrayLike, positions: Rows, velocities: Rows | None,
                      accelerations: Rows | None, names: tuple[str, ...]
                      ) -> tuple[Array, Array, Array | None, Array | None]:
    """
    Return the checked points of a trajectory; arguments as `Motion.from_points`.

    Returns
    -------
    t : (K,) array
    q, u, udot : (K, n) arrays
        In the order of `names`; u and udot None if missing.

    Raises
    ------
    InputError
        If an argument is invalid; the message names the point, the joint and the value.

    """
    t = point_times(times)
    q = _rows(positions, 'positions', len(t), names)
    u = _rows(velocities, 'velocities', len(t), names)
    udot = _rows(accelerations, 'accelerations', len(t), names)
    if q is None:
        raise InputError('positions: none; expected one row per point for '
                         f'{list(names)}')
    # A polynomial with given accelerations needs the velocities too.
    if udot is not None and u is None:
        raise InputError('accelerations: given without velocities; expected both or '
                         'neither')
    return t, q, u, udot


def checked_joint_names(names: Sequence[str], what: str) -> tuple[str, ...]:
    """Return the joint names as a tuple; raise InputError if empty or not unique."""
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise InputError(f'{what}: {names!r}; expected a list of joint names')
    # A generator is read once, then checked.
    names = tuple(names)
    are_text = all(isinstance(name, str) for name in names)
    if not names or not are_text or len(set(names)) != len(names):
        raise InputError(f'{what}: {list(names)}; expected one or more different joint '
                         'names')
    return names


def point_times(times: ArrayLike) -> Array:
    """Return the times of the points as a (K,) array; raise InputError if invalid."""
    try:
        t = np.array(real_numbers(times))
    except (TypeError, ValueError):
        raise InputError(f'times: {times!r}; expected one number per point, in '
                         's') from None
    if t.ndim != 1 or not len(t):
        raise InputError(f'times: shape {t.shape}; expected one number per point, and '
                         'at least one point')
    # Times are finite, not negative, and increase.
    valid = np.isfinite(t).all() and t[0] >= 0.0 and (t[1:] > t[:-1]).all()
    # Valid at once as an array; the reason names the first invalid point.
    if not valid:
        for i, value in enumerate(t.tolist()):
            if not math.isfinite(value) or value < 0.0:
                raise InputError(f'point {i}: time {value} s; expected a finite time >= '
                                 '0 s')
            if i and value <= t[i - 1]:
                raise InputError(f'point {i}: time {value} s; expected more than the '
                                 f'{t[i - 1]} s of point {i - 1}')
    return t


def _rows(values: Rows | None, what: str, count: int,
          names: tuple[str, ...]) -> Array | None:
    """Return one row per point as a (K, n) array, or None if there are no values."""
    if values is None:
        return None
    if (isinstance(values, np.ndarray) and values.dtype == np.float64
            and values.shape == (count, len(names)) and np.isfinite(values).all()):
        return values.copy()  # thousands of rows would take milliseconds one by one
    try:
        rows = [real_numbers(row) for row in values]  # type: ignore[union-attr]
    except (TypeError, ValueError):
        raise InputError(f'{what}: {values!r}; expected one row of {len(names)} numbers '
                         f'per point ({", ".join(names)})') from None
    if all(row.size == 0 for row in rows):
        return None
    if len(rows) != count:
        raise InputError(f'{what}: {len(rows)} rows; expected {count}, one per time')
    checked = [finite_row(row, f'point {i}: '
                               f'{what}', names) for i, row in enumerate(rows)]
    return np.array(checked)


def start_state(start: Start, names: tuple[str, ...]) -> State:
    """Return the start state as three (n,) arrays; raise InputError if invalid."""
    try:
        q, u, udot = start
    except (TypeError, ValueError):
        raise InputError(f'start: {SHORT.repr(start)}; expected positions, velocities '
                         'and accelerations') from None
    if u is None:
        u = np.zeros(len(names))
    if udot is None:
        udot = np.zeros(len(names))
    return (finite_row(q, 'start: '
                          'positions', names), finite_row(u, 'start: velocities', names),
            finite_row(udot, 'start: accelerations', names))
