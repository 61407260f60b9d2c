"""Classical fourth-order Runge-Kutta method, over any scalar type."""

from collections.abc import Callable, Sequence
from typing import Any

from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.mechanics.integrators.interface import System
import numpy as np

Rates = Callable[[Vector, Any], Vector]
# Accelerations, (n,), at one configuration: of the speeds and the moment of a stage.
AtConfiguration = Callable[[Vector, int], Vector]


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


def runge_kutta_4_in_pairs(
        at_pair: Callable[[Vector, Vector], Sequence[AtConfiguration]],
        q: Vector, u: Vector, h: Scalar) -> Vector:
    """
    Return q and u after one step of `runge_kutta_4` of q' = u and u' = a(q, u).

    The configuration of a stage follows from the speeds of the stages before it, without
    the acceleration of the last of these. So the first and the second configuration are
    known at the beginning, and the third and the fourth after the second acceleration:
    what depends on the configuration alone is computed for two stages at once.

    Parameters
    ----------
    at_pair : callable
        ``at_pair(q_a, q_b)`` returns the accelerations at each of two configurations as
        functions of the speeds and of the moment, 0 at the beginning of the step, 1 in its
        middle and 2 at its end.
    q, u : (n,) arrays
        The state.
    h : scalar
        Step size, s.

    """
    half = 0.5 * h
    at_1, at_2 = at_pair(q, q + half * u)
    a_1 = at_1(u, 0)
    u_2 = u + half * a_1
    a_2 = at_2(u_2, 1)
    u_3 = u + half * a_2
    at_3, at_4 = at_pair(q + half * u_2, q + h * u_3)
    a_3 = at_3(u_3, 1)
    u_4 = u + h * a_3
    a_4 = at_4(u_4, 2)

    # Their mean by Simpson's rule.
    sixth = h * (1.0 / 6.0)
    return np.concatenate([q + sixth * (u + 2.0 * (u_2 + u_3) + u_4),
                           u + sixth * (a_1 + 2.0 * (a_2 + a_3) + a_4)])


class RungeKutta4:
    """The classical Runge-Kutta method of fourth order."""

    name = 'rk4'
    damps = False

    def step(self, system: System, state: Vector, h: Scalar) -> Vector:
        """Return the state after one step of length h, s."""
        return runge_kutta_4(system.rates, state, (0, 1, 2), h)
