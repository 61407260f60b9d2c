"""Fixed points of one number, by the secant method within a bracket."""

from collections.abc import Callable
import math

from kane_dynamics.errors import InputError

MOST = 100  # evaluations
LESS = 0.5  # of the residual before: with a larger one, the bracket is bisected


def upper_fixed_point(value: Callable[[float], float | None], low: float, precision: float,
                      missing: str) -> float | None:
    """
    Return x >= `low` > 0 with x = value(x) to a relative precision, or infinity, or None.

    Below the fixed point, `value` is above its argument; above, it is below, None, or raises an
    InputError. None or a value up to `low` at `low` is the result.

    Raises
    ------
    InputError
        That of `value`, if it alone bounds x; `missing` if no fixed point is found.

    """
    x, high, before = low, math.inf, (math.nan, math.nan)
    cause = InputError(missing)
    for _ in range(MOST):
        try:
            found = value(x)
        except InputError as error:
            if x == low:
                raise
            found, cause = None, error
        if found == math.inf or (x == low and (found is None or found <= low)):
            return found
        away = math.nan if found is None else found - x
        if found is not None and abs(away) <= precision * found:
            return found
        if away > 0.0:
            low = x
        else:
            high = x
        if high <= low * (1.0 + precision):
            break
        (x_0, away_0), before = before, (x, away)
        secant = x - away * (x - x_0) / (away - away_0) if away != away_0 else math.nan
        x = next((y for y in (secant, x + away) if low < y < high and not (
            high < math.inf and abs(away) > LESS * abs(away_0))), math.sqrt(low * high))
    raise cause
