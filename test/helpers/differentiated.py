"""Time derivatives of any function of time, by Chebyshev interpolation."""

import numpy as np
from numpy.polynomial import chebyshev

NODES = 20


def time_derivatives(function, order, window=0.02):
    """Return value and derivatives at t = 0 of an analytic function, to 1e-10."""
    x = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
    values = np.array([np.ravel(function(t)) for t in window * x])
    coefficients = chebyshev.chebfit(x, values, NODES - 1)
    result = [chebyshev.chebval(0.0, coefficients)]
    for k in range(1, order + 1):
        derivative = chebyshev.chebval(0.0, chebyshev.chebder(coefficients, k))
        result.append(derivative / window**k)
    return np.array(result)


def taylor_motion(q, *rates):
    """Return a function of time: q, u, udot of the polynomial with these derivatives."""
    derivatives = [q, *rates]

    def at(t):
        state = []
        for order in range(3):
            value = np.zeros_like(q)
            power = 1.0
            for k, x in enumerate(derivatives[order:]):
                value = value + power * x
                power *= t / (k + 1)
            state.append(value)
        return state
    return at
