"""One step of an integrator, over any scalar."""

from collections.abc import Callable, Sequence
from typing import Any

Rates = Callable[[Any, Any], Any]


def runge_kutta_4(rates: Rates, x: Any, inputs: Sequence[Any], h: Any) -> Any:
    """
    Return x one classical fourth-order Runge-Kutta step later.

    Parameters
    ----------
    rates : callable
        ``rates(x, input)``, the time derivative of x.
    x : (k,) array
        The state.
    inputs : sequence of three
        What `rates` is given at the step's beginning, middle and end.
    h : scalar
        Length of the step, s.

    """
    half = 0.5 * h
    k1 = rates(x, inputs[0])
    k2 = rates(x + half * k1, inputs[1])
    k3 = rates(x + half * k2, inputs[1])
    k4 = rates(x + h * k3, inputs[2])
    return x + h * (1.0 / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)
