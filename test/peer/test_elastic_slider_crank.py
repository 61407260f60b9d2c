"""A loop with an elastic drive against SymPy."""

from itertools import pairwise
import math

from kane_dynamics import (Closure, Drive, ElasticFeedforward, Inertial, ModelBuilder,
                           point_mass, Robot)
import numpy as np
from numpy.testing import assert_allclose
import sympy


def test_a_slider_crank_with_an_elastic_drive_in_closed_form():
    """SymPy: T = 1/2 J q'^2 + 1/2 m x'^2, x = r cos q + sqrt(l^2 - r^2 sin^2 q)."""
    r = 0.3
    length = 0.8
    m = 2.0
    J = 0.15
    k = 400.0
    B = 0.05
    values = [0.7, 1.3, -0.8, 2.1, -3.0]
    symbols = sympy.symbols('q u a j s')
    q, _, a, _, _ = symbols

    def rate(expression):
        return sum(sympy.diff(expression, x) * dx for x, dx in pairwise(symbols))
    x = r * sympy.cos(q) + sympy.sqrt(length**2 - r**2 * sympy.sin(q)**2)
    # Lagrange's equation for a mass on a line, which is horizontal: m x'' dx/dq.
    gear = J * a + m * rate(rate(x)) * sympy.diff(x, q)
    theta = q + gear / k
    rows = [gear, rate(gear), rate(rate(gear)), theta, rate(theta), rate(rate(theta))]
    rows.append(B * rows[5] + gear)
    expected = [float(row.subs(list(zip(symbols, values)))) for row in rows]

    b = ModelBuilder(gravity=(0, 0, -9.81))
    b.body('crank', axis=(0, -1, 0),
           inertial=Inertial(0.0, (0, 0, 0), np.diag([J, J, J])),
           drive=Drive(k, rotor_inertia=B))
    b.body('rod', 'crank', axis=(0, -1, 0), at=(r, 0, 0),
           inertial=point_mass(m, (length, 0, 0)))
    b.frame('slider', 'rod', at=(length, 0, 0))
    b.frame('rail', 'world')
    rail = Closure('slider', 'rail', 'inline', axis=(1, 0, 0))
    robot = Robot(b.model(), constraints=[rail], independent=('crank', 'crank_motor'))
    angle = math.asin(-r * math.sin(0.7) / length) - 0.7
    rows = ElasticFeedforward(robot)([0.7, angle], *[[x] for x in values[1:]])
    assert_allclose(rows[:, 0], expected, rtol=1e-11)
