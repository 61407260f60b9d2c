"""Programs of single states that compute several joints at once, in lanes."""

from collections.abc import Callable
from typing import Any

from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.native.backends.llvm_simd import width
from kane_dynamics.native.tracing.program import Program

LARGE = 24  # more coordinates: matrices of one state always in lanes
SMALL = 4  # fewer coordinates: never in lanes
COMPARED = ('coriolis_matrix', 'inverse_dynamics_derivatives', 'forward_dynamics_derivatives')


def in_lanes(equations: Equations, name: str) -> Callable[..., Any] | None:
    """Return the function of a quantity that computes several joints at once, or None."""
    if not equations.in_joint_rates or not (
            equations.n > LARGE or (equations.n >= SMALL and name in COMPARED)):
        return None
    # Needed only where a program is traced.
    from kane_dynamics.mechanics.joint_lanes.tree_in_lanes import TreeInLanes
    from kane_dynamics.native.tracing.wide import WideLanes
    if not TreeInLanes.suits(equations.tree):
        return None
    return getattr(TreeInLanes(equations.tree, lambda q: WideLanes(q.trace)), name, None)


def shorter(n: int, wide: Program, plain: Callable[[], Program]) -> Program:
    """
    Return the program of fewer instructions on this processor.

    Parameters
    ----------
    n : int
        Number of coordinates.
    wide : Program
        In lanes.
    plain : callable
        Traces the program without lanes, which is far longer for a large robot.

    """
    if n > LARGE:
        return wide
    other = plain()
    doubles = width()
    return min(other, wide, key=lambda program: program.instruction_count(doubles))
