"""Constraints on coordinates: coupled joints, prescribed motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.frozen import freeze
from kane_dynamics.errors import ConstraintError, KaneError
from kane_dynamics.mechanics.algebra.jet import moving, rates, values
from kane_dynamics.mechanics.algebra.spline import clamped_spline
from kane_dynamics.mechanics.algebra.user_functions import evaluated_scalar
from kane_dynamics.mechanics.constraints.constraint_types.constraint_rows import (
    ConstraintRows, finite_number, Geometry)
import numpy as np


@dataclass(frozen=True, eq=False)
class Coupling:
    """
    A coordinate follows others: q_joint = offset + sum_k p_k(q_k), p_k(0) = 0.

    Parameters
    ----------
    joint : str
        The dependent joint.
    ratios : mapping of joint name to float, or to a sequence of floats
        For each other joint its ratio c (a gear's, with sign), p(x) = c x; or the
        coefficients of a polynomial, p(x) = c_1 x + c_2 x^2 + ..., as of a cam.
    offset : float
        rad or m.
    name : str

    """

    joint: str
    ratios: Mapping[str, float | Sequence[float]]
    offset: float = 0.0
    name: str = ''

    def __post_init__(self) -> None:
        """Set the default name, and check the numbers."""
        freeze(self, 'name', self.name or f'coupling of {self.joint}')
        what = f"constraint '{self.name}'"
        if not isinstance(self.joint, str):
            raise ConstraintError(f'{what}: joint: {self.joint!r}; expected a name')
        if not isinstance(self.ratios, Mapping) or self.joint in self.ratios:
            raise ConstraintError(f'{what}: ratios: {self.ratios!r}; expected a mapping '
                                  'of other joints to their ratios')
        ratios: dict[str, float | tuple[float, ...]] = {}
        for joint, ratio in self.ratios.items():
            quantity = f"{what}: ratio of '{joint}'"
            if isinstance(ratio, list | tuple):
                ratios[joint] = tuple(finite_number(c, quantity) for c in ratio)
            else:
                ratios[joint] = finite_number(ratio, quantity)
        freeze(self, 'ratios', ratios)
        freeze(self, 'offset', finite_number(self.offset, f'{what}: offset'))

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the name of the row."""
        return (self.name,)

    def rows(self, geometry: Geometry) -> ConstraintRows:
        """Return the row of q_joint' - sum(p_k'(q_k) q_k') = 0, with its residual."""
        row, residual = geometry.coordinate(self.joint, self.name)
        for joint, ratio in self.ratios.items():
            joint_row, x = geometry.coordinate(joint, self.name)
            coefficients = ratio if isinstance(ratio, tuple) else (ratio,)
            # Horner's rule for p(x) and its slope.
            value: Any = 0.0
            slope: Any = 0.0
            for c in reversed((0.0, *coefficients)):
                slope = value + x * slope
                value = c + x * value
            row = row - slope * joint_row
            residual = residual - value
        return ConstraintRows(row[None, :], np.zeros(1), (residual - self.offset,))


@dataclass(frozen=True, eq=False)
class Prescribed:
    """
    A joint moves as a function of time (a shaker, a platform, a spacecraft's base).

    Parameters
    ----------
    joint : str
    position : callable, Motion or (times, positions)
        ``position(t)``, rad or m, of arithmetic and the functions of numpy that
        `kane_dynamics.mechanics.algebra.user_functions` lists; or a `Motion` that has
        this joint; or a table, interpolated by one cubic spline with continuous
        accelerations, at rest at both ends. Before and after its times a Motion or a
        table is at rest.
    name : str

    Notes
    -----
    The constraint force of its row is the force or torque of the prescribed motion. The
    velocity must be continuous: a jump (abs, minimum, a branch of where) needs an
    impulse, which the equations of motion do not model. `simulate` refuses it. The
    acceleration may jump.

    """

    joint: str
    position: Any
    name: str = ''

    def __post_init__(self) -> None:
        """Set the default name, and convert a motion or a table to a function."""
        freeze(self, 'name', self.name or f'prescribed {self.joint}')
        what = f"constraint '{self.name}'"
        has_polynomials = hasattr(self.position, 'joint_polynomial')
        is_class = has_polynomials and isinstance(self.position, type)
        try:
            # A motion supplies polynomials of the joint; a table becomes a spline that
            # starts and ends at rest.
            if has_polynomials and not is_class:
                freeze(self, 'position', self.position.joint_polynomial(self.joint))
            elif isinstance(self.position, tuple | list) and len(self.position) == 2:
                freeze(self, 'position', clamped_spline(*self.position))
        except KaneError as error:
            raise ConstraintError(f'{what}: {error}') from None
        # A class in place of its instance would be callable, but is no function of t.
        if is_class or not callable(self.position):
            raise ConstraintError(
                f'{what}: position: a {type(self.position).__name__}; expected a '
                'function of t, a Motion, or a table (times, positions)')

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the name of the row."""
        return (self.name,)

    def rows(self, geometry: Geometry) -> ConstraintRows:
        """Return the row: the joint rate equals the time derivative of the function."""
        row, joint_position = geometry.coordinate(self.joint, self.name)
        position, velocity = self.functions(geometry).values()
        residual = joint_position - position
        return ConstraintRows(row[None, :], np.array([velocity]), (residual,))

    def functions(self, geometry: Geometry) -> dict[str, Any]:
        """Return the functions that must be continuous, by name: position, velocity."""
        # The velocity is the derivative part of the position at a time with t' = 1.
        what = f"constraint '{self.name}': position(t)"
        time = moving(geometry.t, 1.0)
        position = np.array([evaluated_scalar(self.position, what, time)], dtype=object)
        return {'position(t)': values(position)[0],
                'the velocity of position(t)': rates(position)[0]}
