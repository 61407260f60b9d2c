"""Classical fourth-order Runge-Kutta method, over any scalar type."""

from collections.abc import Callable, Sequence
from typing import Any

from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.mechanics.integrators.interface import System

Rates = Callable[[Vector, Any], Vector]


def runge_kutta_4(rates: Rates, x: Vector, inputs: Sequence[Any], h: Scalar) -> Vector:
    """
    Return the state after one step of the classical fourth-order Runge-Kutta method.

    Parameters
    ----------
    rates : callable
        ``rates(x, input)`` returns the time derivative of x.
    x : (k,) array
        The state.
    inputs : sequence of three
        Inputs of `rates` at the beginning, middle and end of the step.
    h : scalar
        Step size, s.

    """
    # The slopes at the beginning, twice in the middle, and at the end.
    half = 0.5 * h
    k1 = rates(x, inputs[0])
    k2 = rates(x + half * k1, inputs[1])
    k3 = rates(x + half * k2, inputs[1])
    k4 = rates(x + h * k3, inputs[2])

    # Their mean by Simpson's rule.
    return x + h * (1.0 / 6.0) * (k1 + 2.0 * (k2 + k3) + k4)


class RungeKutta4:
    """The classical Runge-Kutta method of fourth order."""

    name = 'rk4'
    damps = False

    def step(self, system: System, state: Vector, h: Scalar) -> Vector:
        """Return the state after one step of length h, s."""
        return runge_kutta_4(system.rates, state, (0, 1, 2), h)
