"""Assumed mode shapes of beams in bending and torsion: closed-form or user-defined."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
import math
from typing import Literal

from kane_dynamics._util.checks import constant
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
import numpy as np

MOST_MODES = 32  # in a direction, or of torsion: more take minutes to prepare
Shapes = tuple[Array, Array, Array]  # phi, phi' and phi'', (k, len(x)) each
Function = Callable[[Array], Shapes]


@dataclass(frozen=True, eq=False)
class Bending:
    """
    Family of bending shapes; create one by `clamped_free`, `pinned_free`, `shapes`.

    Parameters
    ----------
    kind : 'clamped_free', 'pinned_free' or 'own'
    tip_mass : float
        Tip mass assumed by the shapes only, kg; it is not added to the beam.
    function : callable, optional
        For kind 'own': returns phi, phi' and phi'' at positions x.

    """

    kind: Literal['clamped_free', 'pinned_free', 'own'] = 'clamped_free'
    tip_mass: float = 0.0
    function: Function | None = None

    @classmethod
    def clamped_free(cls, tip_mass: float = 0.0) -> Bending:
        """Return the modes of a beam clamped at its root, with a mass at its tip, kg."""
        if not (math.isfinite(tip_mass) and tip_mass >= 0.0):
            raise ModelError(f'tip_mass: {tip_mass}; expected a nonnegative number')
        return cls('clamped_free', float(tip_mass))

    @classmethod
    def pinned_free(cls) -> Bending:
        """Return the modes of a beam pinned at its root, without the rigid-body mode."""
        return cls('pinned_free')

    @classmethod
    def shapes(cls, function: Function) -> Bending:
        """
        Return user-defined shapes.

        Parameters
        ----------
        function : callable
            ``function(x)`` returns phi, phi' and phi'' at positions x, (k, len(x))
            arrays of k shapes. They are orthonormalized. For a clamped root, phi(0) =
            phi'(0) = 0.

        """
        return cls('own', 0.0, function)

    def at(self, x: Array, length: float, mass: float, count: int) -> Shapes:
        """Return phi, phi' and phi'' of the first shapes at x, (count, len(x))."""
        if self.function is not None:
            return self._user_defined(self.function, x, count)
        closed_form = _clamped if self.kind == 'clamped_free' else _pinned
        shapes = np.zeros((3, count, len(x)))
        for k in range(count):
            shapes[:, k] = closed_form(self.wave_number(k, mass), x / length)
        # The derivatives are with respect to x / length.
        return shapes[0], shapes[1] / length, shapes[2] / length**2

    def _user_defined(self, function: Function, x: Array, count: int) -> Shapes:
        """Return the shapes of a user's function; raise ModelError for invalid ones."""
        shapes = []
        for part in function(x):
            shapes.append(np.asarray(part, dtype=np.float64))
        # phi, phi' and phi'', each with a row for a shape.
        phi, slope, curvature = shapes
        for part in shapes:
            if part.shape != (count, len(x)) or not np.isfinite(part).all():
                raise ModelError('bending shapes: '
                                 f'{[part.shape for part in shapes]}; expected three '
                                 f'finite arrays of shape ({count}, {len(x)})')
        return phi, slope, curvature

    def wave_number(self, k: int, mass: float) -> float:
        """Return beta L of mode k (from 0): the root of the frequency equation."""
        return _wave_number(self.kind, self.tip_mass / mass, k)


@dataclass(frozen=True)
class Torsion:
    """
    Torsion of a beam: stiffness, and the modes of a uniform clamped-free shaft.

    Parameters
    ----------
    stiffness : float
        GJ, N m^2.
    inertia : float
        rho I_p: moment of inertia about the beam per length, kg m.
    modes : int
        Number of modes, at most 32.
    tip_inertia : float
        Tip inertia assumed by the shapes only, kg m^2; it is not added to the beam.

    """

    stiffness: float
    inertia: float
    modes: int = 1
    tip_inertia: float = 0.0

    def checked(self, what: str) -> Torsion:
        """Return the torsion with checked numbers; ModelError names the fault."""
        numbers = {}
        for key in ('stiffness', 'inertia', 'tip_inertia'):
            numbers[key] = float(constant(getattr(self, key), (),
                                          f'{what}: torsion: {key}'))
        # bool is an int in Python, but no count.
        count = self.modes
        is_integer = isinstance(count, (int, np.integer)) and not isinstance(count, bool)
        if not is_integer or not 0 <= count <= MOST_MODES:
            raise ModelError(f'{what}: torsion: modes {count!r}; expected an integer, 0 '
                             f'to {MOST_MODES}')
        for key, value in numbers.items():
            may_be_zero = key == 'tip_inertia'
            # A body at the tip is optional; without modes, stiffness and inertia have no
            # influence.
            if value < 0.0 or (value == 0.0 and count and not may_be_zero):
                sign = 'nonnegative' if may_be_zero else 'positive'
                raise ModelError(f'{what}: torsion: {key} {value:g}; expected a {sign} '
                                 'number')
        return Torsion(**numbers, modes=int(count))

    def at(self, x: Array, length: float) -> Array:
        """
        Return psi and psi', (2, modes, len(x)), at positions x of a beam of this length.

        psi = sin(b x / L) with cot b = b J / (rho I_p L) and J the inertia at the tip.
        The modes are orthonormal with respect to the inertia of shaft and tip.
        """
        # psi = sin(b x / L): at the tip, the torque of the shaft accelerates the body
        # there, cos b = J b / (rho I_p L) sin b.
        shaft = self.inertia * length

        def torque_at_tip(b: float) -> float:
            return math.cos(b) - self.tip_inertia / shaft * b * math.sin(b)
        shapes = np.zeros((2, self.modes, len(x)))
        for k in range(self.modes):
            # One root in each of these intervals; without a body at the tip, at its
            # end.
            b = _root(torque_at_tip, k * math.pi, (k + 0.5) * math.pi)
            # int rho I_p sin^2(b x / L) dx + J sin^2 b
            mass = (0.5 * shaft * (1.0 - math.sin(2.0 * b) / (2.0 * b))
                    + self.tip_inertia * math.sin(b) ** 2)
            shapes[0, k] = np.sin(b * x / length) / math.sqrt(mass)
            shapes[1, k] = b / length * np.cos(b * x / length) / math.sqrt(mass)
        return shapes


@cache
def _wave_number(kind: str, ratio: float, k: int) -> float:
    """Return beta L of mode k of a beam with `ratio` of its mass at the tip, cached."""
    def clamped(b: float) -> float:
        return (math.cos(b) + 1.0 / math.cosh(b)
                + ratio * b * (math.cos(b) * math.tanh(b) - math.sin(b)))

    def pinned(b: float) -> float:
        return math.sin(b) - math.cos(b) * math.tanh(b)
    # Each root lies between two multiples of pi.
    if kind == 'clamped_free':
        return _root(clamped, k * math.pi + 1e-9, (k + 1) * math.pi)
    return _root(pinned, (k + 1) * math.pi, (k + 2) * math.pi)


def _root(f: Callable[[float], float], low: float, high: float) -> float:
    """Return the root of f between low and high by bisection, to rounding."""
    # A hundred halvings end at adjacent numbers.
    sign = math.copysign(1.0, f(low))
    for _ in range(100):
        middle = 0.5 * (low + high)
        if f(middle) * sign > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def _clamped(b: float, x: Array) -> Shapes:
    """Return cosh bx - cos bx - s (sinh bx - sin bx) with two derivatives."""
    total = math.sinh(b) + math.sin(b)
    s = (math.cosh(b) + math.cos(b)) / total
    # Near 1, s would cancel in 1 - s.
    one_less_s = (math.sin(b) - math.cos(b) - math.exp(-b)) / total
    # cosh and sinh by the exponentials that grow and that fade towards the tip.
    growing = 0.5 * one_less_s * np.exp(b * x)
    fading = 0.5 * (1.0 + s) * np.exp(-b * x)
    sine = np.sin(b * x)
    cosine = np.cos(b * x)
    return (growing + fading - cosine + s * sine,
            b * (growing - fading + sine + s * cosine),
            b * b * (growing + fading + cosine - s * sine))


def _pinned(b: float, x: Array) -> Shapes:
    """Return sin bx + (sin b / sinh b) sinh bx with two derivatives."""
    sine = np.sin(b * x)
    cosine = np.cos(b * x)
    share = math.sin(b) / math.sinh(b)
    sinh = share * np.sinh(b * x)
    cosh = share * np.cosh(b * x)
    return sine + sinh, b * (cosine + cosh), b * b * (sinh - sine)


@cache
def _legendre(count: int) -> tuple[Array, Array]:
    """Return the nodes and weights of Gauss-Legendre quadrature on (-1, 1), cached."""
    x, weights = np.polynomial.legendre.leggauss(count)
    x.flags.writeable = weights.flags.writeable = False
    return x, weights


def gauss(length: float, modes: int) -> tuple[Array, Array]:
    """Return nodes and weights of Gauss quadrature on (0, length) for the modes."""
    x, weights = _legendre(16 + 8 * modes)
    return 0.5 * length * (x + 1.0), 0.5 * length * weights
