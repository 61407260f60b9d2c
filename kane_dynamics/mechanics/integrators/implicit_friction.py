"""
Speed at the end of a semi-implicit Euler step with implicit friction, for long steps.

    M u+ + h friction(u+) = M u + h (tau - rigid(q, u))

Friction follows its law, `friction.friction_torque`, at the speed u+ of the step's end. So
it neither limits the step, nor reverses a joint that stops. u+ is the minimum of a convex
function, found by Newton's method, each step with the best of some lengths: full ones may
cycle between two directions of sliding. The number of iterations is fixed, since programs
do not branch. Of first order. `mechanism_step` has the step.
"""

from collections.abc import Callable
from typing import NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.friction import is_nonlinear
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
import numpy as np

ITERATIONS = 8
LENGTHS = (1.0, 0.5, 0.2)  # of each iteration's Newton step


class Resistance(NamedTuple):
    """
    Forces that are those of the speed at the step's end, in the space of the speeds.

    `force` and `slope` take the speeds, (n,), and return (n,) and (n, n); `linear` is
    whether the slope is constant.
    """

    force: Callable[[Vector], Vector]
    slope: Callable[[Vector], Matrix]
    linear: bool


def has_linearized_friction(equations: TreeEquations) -> bool:
    """Return whether a joint has friction that an implicit step linearizes."""
    bodies = equations.model.bodies
    return equations.friction and any(
        is_nonlinear(body.joint) for body in bodies)


def resisted_speed(M: Matrix, momentum: Vector, u: Vector, h: Scalar, order: list[int],
                   resistance: Resistance) -> Vector:
    """
    Return the speeds u+, (n,), with M u+ + h resistance(u+) = momentum.

    u is the initial guess, and `order` that of the factorization of M.
    """
    force, slope_of, linear = resistance
    if linear:  # one Newton step is exact
        slope = slope_of(u)
        factors = factorize(M + h * slope, order)
        return solve(factors, order, momentum - h * (force(u) - slope @ u))

    # Newton's method: `excess` is M u+ + h resistance(u+) - momentum, the gradient of
    # the convex function, and M + h slope its Hessian.
    u_end = u
    excess = M @ u + h * force(u) - momentum
    for _ in range(ITERATIONS):
        hessian = M + h * slope_of(u_end)
        newton_step = -solve(factorize(hessian, order), order, excess)
        start = u_end
        excess_of_start = M @ start - momentum
        momentum_of_step = M @ newton_step

        # Keep the length with the smallest slope along the step, which is 0 at the
        # minimum. Programs do not branch: all lengths are evaluated.
        smallest: Scalar = None
        for length in LENGTHS:
            trial = start + length * newton_step
            trial_excess = (excess_of_start + length * momentum_of_step
                            + h * force(trial))
            slope = trial_excess @ newton_step
            squared_slope = slope * slope
            if smallest is None:
                u_end = trial
                excess = trial_excess
                smallest = squared_slope
            else:
                better = squared_slope < smallest
                u_end = _selected(better, trial, u_end)
                excess = _selected(better, trial_excess, excess)
                smallest = select(better, squared_slope, smallest)
    return u_end


def _selected(condition: Scalar, x: Vector, y: Vector) -> Vector:
    """Return x if the condition holds, else y."""
    return np.array([select(condition, a, b) for a, b in zip(x, y)])
