"""Fixed points of one number, by the secant method within a bracket."""

from collections.abc import Callable
import math

from kane_dynamics.errors import InputError

EVALUATIONS = 100  # at most
REDUCTION = 0.5  # of the residual in a step; beyond it, the bracket is bisected


def upper_fixed_point(value: Callable[[float], float | None], low: float,
                      precision: float, missing: str) -> float | None:
    """
    Return x >= `low` > 0 with x = value(x) to a relative precision, infinity, or None.

    Below the fixed point, `value` is above its argument; above, it is below, None, or
    raises an InputError. None or a value up to `low` at `low` is the result.

    Raises
    ------
    InputError
        That of `value`, if it alone bounds x; `missing` if no fixed point is found.

    """
    x = low
    high = math.inf
    x_last = math.nan
    residual_last = math.nan
    cause = InputError(missing)
    for _ in range(EVALUATIONS):
        y: float | None
        try:
            y = value(x)
        except InputError as error:
            if x == low:
                raise
            y = None
            cause = error
        if y == math.inf or (x == low and (y is None or y <= low)):
            return y
        residual = math.nan if y is None else y - x
        if y is not None and abs(residual) <= precision * y:
            return y

        # The fixed point is above x where the value is above its argument.
        if residual > 0.0:
            low = x
        else:
            high = x
        if high <= low * (1.0 + precision):
            break
        secant = math.nan
        if residual != residual_last:
            secant = x - residual * (x - x_last) / (residual - residual_last)

        # The next x: the zero of the secant, else the value itself, if it is within the
        # bracket. Bisect if neither is, or if the residual decreases too slowly.
        slow = high < math.inf and abs(residual) > REDUCTION * abs(residual_last)
        x_last = x
        residual_last = residual
        if low < secant < high and not slow:
            x = secant
        elif low < x + residual < high and not slow:
            x = x + residual
        else:
            x = math.sqrt(low * high)
    raise cause
