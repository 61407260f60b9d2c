"""
Values that vary between trials, as given in a sweep's description.

A value is a number (or a name), or one of::

    {uniform: [low, high]}
    {loguniform: [low, high]}        # both positive
    {normal: [mean, deviation]}      # only for values that may be negative
    {choice: [a, b, ...]}            # at random
    {grid: [a, b, ...]}              # in turn: every combination of all grids of a sweep

A value for every joint is one value for all joints, ``{each: value}`` for an independent
draw per joint, a list with one value per joint, or a mapping from joints to values.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from kane_dynamics._util.text import SHORT
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
import numpy as np

RANGES = ('uniform', 'loguniform', 'normal')
LISTS = ('choice', 'grid')
FIXED = 'fixed'
MOST = 1e60  # larger numbers are treated as mistakes
FORMS = 'a number, or a mapping with one of uniform, loguniform, normal, choice, grid'


@dataclass(frozen=True)
class Value:
    """
    Value of a sweep with its distribution.

    Attributes
    ----------
    name : str
        Name of its column.
    kind : str
        'fixed', or one of `RANGES` and `LISTS`.
    numbers : tuple of float
        The value; low and high; mean and deviation; or the list. For names, their
        indices.

    """

    name: str
    kind: str
    numbers: tuple[float, ...]

    @property
    def random(self) -> bool:
        """Return whether the value is drawn at random."""
        return self.kind not in (FIXED, 'grid')

    def taken(self, uniform: Array, normal: Array, place: Any) -> Array:
        """
        Return the value of each trial.

        Parameters
        ----------
        uniform, normal : (N,) arrays
            Draws of all trials: uniform in [0, 1), and standard normal.
        place : (N,) array of int
            Index of each trial in the list of a grid.

        """
        # The bounds, or mean and deviation.
        first, last = self.numbers[0], self.numbers[-1]
        if self.kind == 'uniform':
            return first + (last - first) * uniform
        if self.kind == 'loguniform':  # not np.exp, whose result may depend on the array's length
            low, high = math.log(first), math.log(last)
            return np.array([math.exp(low + (high - low) * x) for x in uniform.tolist()])
        if self.kind == 'normal':
            return first + last * normal
        if len(self.numbers) == 1:
            return np.full(len(uniform), first)
        # An index for each trial; a list of values is one each in order.
        if self.kind == 'choice':
            place = (uniform * len(self.numbers)).astype(np.int64)
        chosen: Array = np.array(self.numbers)[place]
        return chosen


def parse_value(name: str, data: Any, *, signed: bool = False,
                names: Sequence[str] = ()) -> Value:
    """
    Parse a value from plain data.

    Parameters
    ----------
    name : str
        Name of its column, for the table and for messages.
    data : number, str or mapping
        See this module.
    signed : bool
        Whether it may be negative.
    names : sequence of str
        Valid names, if the value is a name instead of a number.

    Raises
    ------
    InputError
        If the data is invalid; the message names the value.

    """
    # Plain data is one value; {kind: [...]} varies it.
    if not isinstance(data, Mapping):
        return Value(name, FIXED, (_entry(name, data, signed, names),))
    forms = LISTS if names else (*RANGES, *LISTS)
    if len(data) != 1 or next(iter(data)) not in forms:
        expected = FORMS
        if names:
            expected = f'one of {", ".join(names)}, or {{choice: [...]}}'
        raise InputError(f'{name}: {SHORT.repr(data)}; expected {expected}')
    # One kind, with its list: {uniform: [low, high]}.
    (kind, entries), = data.items()
    if not isinstance(entries, Sequence) or isinstance(entries, str) or not entries:
        raise InputError(f'{name}: {kind}: {SHORT.repr(entries)}; expected a list')
    numbers = tuple(_entry(name, x, signed or kind == 'normal', names) for x in entries)
    if kind in RANGES:
        _check_range(name, kind, numbers, signed)
    return Value(name, kind, numbers)


def parse_values(name: str, data: Any, joints: Sequence[str], default: Sequence[float], *,
                 signed: bool = False) -> tuple[Value, ...]:
    """
    Parse the values of all joints: one for all, or one per joint, called <name>.<joint>.

    Parameters
    ----------
    name : str
        Name of the quantity.
    data : None, number, sequence or mapping
        See this module; None selects the defaults.
    joints : sequence of str
        Names, in the order of a list.
    default : sequence of float
        Values of joints that a mapping does not name.
    signed : bool
        Whether it may be negative.

    Raises
    ------
    InputError
        If the data is invalid; the message names the joint.

    """
    # By default, one for each joint, by name, or in the order of the joints.
    # Without a value, each joint has its default.
    if data is None:
        data = list(default)
    elif isinstance(data, Mapping) and set(data) == {'each'}:
        data = [data['each']] * len(joints)
    elif isinstance(data, Mapping) and not set(data) & {*RANGES, *LISTS}:
        unknown = [key for key in data if key not in joints]
        if unknown:
            raise InputError(f'{name}: no joint {SHORT.repr(unknown[0])}; expected '
                             f'{", ".join(joints)}; or {FORMS}')
        starts = zip(joints, default, strict=True)
        data = [data.get(joint, start) for joint, start in starts]
    if not isinstance(data, list | tuple | np.ndarray):
        return (parse_value(name, data, signed=signed),)
    if len(data) != len(joints):
        raise InputError(f'{name}: {len(data)} entries; expected {len(joints)}, in the '
                         'order '
                         f'{", ".join(joints)}')
    return tuple(parse_value(f'{name}.{joint}', x, signed=signed)
                 for joint, x in zip(joints, data))


def number_of(name: str, value: Any, *, signed: bool = False) -> float:
    """Return a finite number; text is accepted because YAML reads 1e-3 as text."""
    number = math.nan
    if isinstance(value, int | float | str | np.number) and not isinstance(value, bool):
        try:
            number = float(value)
        except (ValueError, OverflowError):
            number = math.nan
    if not abs(number) < MOST or (number < 0.0 and not signed):
        sign = '' if signed else ' >= 0'
        raise InputError(f'{name}: {SHORT.repr(value)}; expected a finite number{sign}')
    return number


def _entry(name: str, value: Any, signed: bool, names: Sequence[str]) -> float:
    """Return a number, or the index of a name."""
    if not names:
        return number_of(name, value, signed=signed)
    if value is None and 'none' in names:  # YAML reads `null` and `~` as None
        value = 'none'
    if value not in names:
        raise InputError(f'{name}: {SHORT.repr(value)}; expected one of '
                         f'{", ".join(names)}')
    return float(names.index(value))


def _check_range(name: str, kind: str, numbers: tuple[float, ...], signed: bool) -> None:
    """Raise InputError if two numbers are no valid range of this kind."""
    # A normal distribution has no bounds, so that its values must be allowed to be
    # negative.
    if kind == 'normal':
        if not signed:
            raise InputError(f'{name}: normal, which includes negative values; expected '
                             'uniform or loguniform')
        if len(numbers) != 2 or numbers[1] < 0.0:
            raise InputError(f'{name}: normal: {list(numbers)}; expected [mean, '
                             'deviation], deviation >= 0')
        return
    positive = kind == 'loguniform'
    ascending = len(numbers) == 2 and numbers[0] <= numbers[1]
    if not ascending or (positive and not numbers[0] > 0.0):
        bounds = '0 < low <= high' if positive else 'low <= high'
        raise InputError(f'{name}: {kind}: {list(numbers)}; expected [low, high], '
                         f'{bounds}')
