"""One step of an integrator, over any scalar."""

from collections.abc import Callable, Sequence
from typing import Any

Dynamics = Callable[[Any, Any, Any], Any]


def runge_kutta_4(udot: Dynamics, q: Any, u: Any, inputs: Sequence[Any],
                  h: Any) -> tuple[Any, Any]:
    """
    Return q, u one classical fourth-order Runge-Kutta step later.

    Parameters
    ----------
    udot : callable
        ``udot(q, u, input)``, (n,) arrays in and out; q' = u.
    q, u : (n,) arrays
        Coordinates and speeds; rad or m, and s.
    inputs : sequence of three
        What `udot` is given at the step's beginning, middle and end.
    h : scalar
        Length of the step, s.

    """
    half = 0.5 * h
    a1 = udot(q, u, inputs[0])
    u2 = u + half * a1
    a2 = udot(q + half * u, u2, inputs[1])
    u3 = u + half * a2
    a3 = udot(q + half * u2, u3, inputs[1])
    u4 = u + h * a3
    a4 = udot(q + h * u3, u4, inputs[2])
    sixth = h * (1.0 / 6.0)
    return q + sixth * (u + 2.0 * (u2 + u3) + u4), u + sixth * (a1 + 2.0 * (a2 + a3) + a4)
