"""Flexible links: description of a beam and computation of its modal integrals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any, Literal

from kane_dynamics._util.checks import constant
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
from kane_dynamics.model.beam import Beam, Deflection
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.mode_shapes import Bending, gauss, Shapes, Torsion
import numpy as np

Kind = Literal['revolute', 'prismatic']
DEPENDENT = 1e-10  # relative singular value below which shapes are linearly dependent
ROUNDING = 1e-12  # relative size below which entries are zero


@dataclass(frozen=True, eq=False)
class FlexibleLink:
    """
    Description of a beam: its section and its modes in the two planes of bending.

    Parameters
    ----------
    length : float
        m.
    density : float
        Mass per length, kg/m.
    stiffness : float or pair of float
        EI for bending along `up`, and along e x up, N m^2; one number applies to both.
    modes : int or pair of int
        Number of modes in these two directions.
    direction, up : (3,) arrays
        Directions of the beam and of the first bending, in the body's axes.
    bending : Bending or pair of Bending
        The assumed shapes: `clamped_free` and so on, for both directions or one each.
    torsion : Torsion, optional
        GJ and modes of torsion. Default: no torsion.
    damping : float
        Material damping (Kelvin-Voigt): stress per strain rate over stress per strain, s.
    foreshortening : bool
        Include foreshortening; disable it only for comparison.

    Raises
    ------
    ModelError
        If a value is invalid; the message names it.

    """

    length: float
    density: float
    stiffness: float | Sequence[float]
    modes: int | Sequence[int] = 3
    direction: Array | Sequence[float] = (1.0, 0.0, 0.0)
    up: Array | Sequence[float] = (0.0, 1.0, 0.0)
    bending: Bending | Sequence[Bending] | None = None
    torsion: Torsion | None = None
    damping: float = 0.0
    foreshortening: bool = True

    @classmethod
    def tube(cls, length: float, radius: float, bore: float, young: float, shear: float,
             material_density: float, modes: int | Sequence[int] = 3, twists: int = 0,
             **options: Any) -> FlexibleLink:
        """
        Return a beam of round section, solid or hollow.

        Parameters
        ----------
        length, radius, bore : float
            m; `bore` is the inner radius, 0 for a rod.
        young, shear : float
            E and G of the material, Pa.
        material_density : float
            Mass per volume, kg/m^3.
        modes, twists : int
            Number of modes of bending in each direction, and of torsion.
        **options
            Further parameters of the class.

        Raises
        ------
        ModelError
            If the bore is negative or not smaller than the radius.

        """
        if not 0.0 <= bore < radius:
            raise ModelError(f'tube: bore {bore} m, radius {radius} m; expected 0 <= bore < '
                             'radius')
        polar = 0.5 * math.pi * (radius**4 - bore**4)
        torsion = Torsion(shear * polar, material_density * polar, twists)
        density = material_density * math.pi * (radius**2 - bore**2)
        bending_stiffness = 0.5 * young * polar
        return cls(length, density, bending_stiffness, modes, torsion=torsion, **options)

    def checked(self, name: str) -> AssumedModes:
        """Check the description and return the assumed modes; errors name the link."""
        what = f"beam '{name}'"
        numbers = {key: float(constant(getattr(self, key), (), f'{what}: {key}'))
                   for key in ('length', 'density', 'damping')}
        for key, value in numbers.items():
            if not value > 0.0 and not (key == 'damping' and value == 0.0):
                raise ModelError(f'{what}: {key} {value:g}; expected a '
                                 f'{"nonnegative" if key == "damping" else "positive"} number')
        stiffness = np.broadcast_to(np.asarray(self.stiffness, dtype=np.float64), (2,))
        modes = np.broadcast_to(np.asarray(self.modes), (2,))
        if modes.dtype.kind not in 'iu' or modes.min() < 0:
            raise ModelError(f'{what}: modes {self.modes!r}; expected one or two numbers of '
                             'modes, 0 or more')
        if not (np.isfinite(stiffness).all() and stiffness[modes > 0].min(initial=1.0) > 0.0):
            raise ModelError(f'{what}: stiffness {self.stiffness!r}; expected positive EI')
        e, up = (constant(getattr(self, key), (3,), f'{what}: {key}')
                 for key in ('direction', 'up'))
        side = np.cross(e, up)
        if not np.linalg.norm(side) > 1e-9 * float(np.linalg.norm(e)):
            raise ModelError(f'{what}: direction {e.tolist()} and up {up.tolist()}; expected two '
                             'different directions')
        e = e / np.linalg.norm(e)
        side = side / np.linalg.norm(side)
        bending = self.bending if isinstance(self.bending, Sequence) else [self.bending] * 2
        shapes = [shape or Bending.clamped_free() for shape in bending]
        return AssumedModes(name, numbers['length'], numbers['density'], numbers['damping'],
                            stiffness, modes, np.array([e, np.cross(side, e), side]), shapes,
                            (self.torsion or Torsion(1.0, 0.0, 0)).checked(what),
                            self.foreshortening)


class AssumedModes:
    """Assumed modes of a beam as functions of the position, orthonormal in mass."""

    def __init__(self, name: str, length: float, density: float, damping: float,
                 stiffness: Array, modes: Array, axes: Array, bending: Sequence[Bending],
                 torsion: Torsion, foreshortening: bool) -> None:
        """Evaluate the shapes at the quadrature points."""
        self.name, self.length, self.density, self.axes = name, length, density, axes
        self._damping, self._stiffness = damping, stiffness
        self._modes, self._bending, self._torsion = modes, bending, torsion
        self._foreshortening = foreshortening
        self._bends = int(modes.sum())
        self.count = self._bends + torsion.modes
        self.x, self._weights = gauss(length, self.count)
        self._mixing = [self._orthonormal(plane) for plane in range(2)]

    @property
    def names(self) -> list[str]:
        """Return the names of the modal coordinates: <beam>/mode_1, <beam>/twist_1, ..."""
        return [f'{self.name}/{kind}_{k + 1}' for kind, count in (
            ('mode', self._bends), ('twist', self._torsion.modes)) for k in range(count)]

    @property
    def inertial(self) -> Inertial:
        """Return the inertial of the straight beam: a rod with the rotary inertia of torsion."""
        mass, e = self.density * self.length, self.axes[0]
        end, polar = self.length * e, self._torsion.inertia * self.length
        return Inertial(mass, 0.5 * end, mass / 12.0 * (
            end @ end * np.eye(3) - np.outer(end, end)) + 0.5 * polar * (
            np.eye(3) + np.outer(e, e)))

    def _orthonormal(self, plane: int) -> Array:
        """Return the matrix, (k, k), that makes the assumed shapes orthonormal in mass."""
        count = int(self._modes[plane])
        if not count:
            return np.zeros((0, 0))
        phi = self._assumed(plane, self.x)[0]
        gram = (phi * (self._weights * self.density)) @ phi.T
        tip = self._assumed(plane, np.array([self.length]))[0][:, 0]
        gram = gram + self._bending[plane].tip_mass * np.outer(tip, tip)
        size = np.linalg.eigvalsh(gram)
        if not size[0] > DEPENDENT * size[-1]:
            raise ModelError(f"beam '{self.name}': {count} linearly dependent shapes of bending "
                             f'(singular values {size[0]:.3g} to {size[-1]:.3g}); expected '
                             'independent ones')
        return np.linalg.inv(np.linalg.cholesky(gram))

    def _assumed(self, plane: int, x: Array) -> Shapes:
        return self._bending[plane].at(x, self.length, self.density * self.length,
                                       int(self._modes[plane]))

    def at(self, x: Array) -> tuple[Array, Array, Array]:
        """Return phi, phi' and phi'', (len(x), m, 3) each, at positions x along the beam."""
        result = np.zeros((3, len(x), self.count, 3))
        first = 0
        for plane, mixing in enumerate(self._mixing):
            last = first + len(mixing)
            if len(mixing):
                for k, values in enumerate(self._assumed(plane, x)):
                    result[k, :, first:last] = np.multiply.outer((mixing @ values).T,
                                                                 self.axes[1 + plane])
            first = last
        return result[0], result[1], result[2]

    def twists(self, x: Array) -> tuple[Array, Array]:
        """Return psi and psi', (len(x), m) each, at positions x along the beam."""
        result = np.zeros((2, len(x), self.count))
        result[:, :, self._bends:] = np.transpose(self._torsion.at(x, self.length), (0, 2, 1))
        return result[0], result[1]

    def shortening(self, x: Array) -> Array:
        """Return the foreshortening matrices H at positions x, (len(x), m, m)."""
        H = np.zeros((len(x), self.count, self.count))
        if self._foreshortening:
            for k, end in enumerate(x):
                places, weights = gauss(float(end), self.count)
                slope = self.at(places)[1]
                H[k] = np.einsum('gik,gjk->ij', weights[:, None, None] * slope, slope)
        return H

    def _roll(self, x: float) -> Array:
        """
        Return the second derivatives of the roll that bending in two planes causes, (m, m).

        With deflections v along `up` and w along e x up, a section turns by v' and -w' about these
        axes and by theta about the beam. Its torsion is theta' + v'' w'. Without torsion theta is
        therefore -int v'' w'.
        """
        places, weights = gauss(x, self.count)
        _, slope, curvature = self.at(places)
        _, up, side = self.axes
        product: Array = np.einsum('g,gi,gj->ij', weights, curvature @ up, slope @ side)
        roll: Array = -(product + product.T)
        return roll

    def beam(self, coordinates: tuple[int, ...]) -> Beam:
        """Return the modal integrals for the equations of motion."""
        phi, _, curvature = self.at(self.x)
        dm, e = self._weights * self.density, self.axes[0]
        basis, straight = self._linear_functions()
        axial = -np.einsum('g,ag,gij->aij', dm, basis, self.shortening(self.x))
        EI = np.repeat([*self._stiffness, 0.0], [*self._modes, self._torsion.modes])
        K = np.einsum('g,gik,gjk->ij', self._weights, curvature, curvature) * EI[:, None]
        (psi, twist), polar = self.twists(self.x), self._weights * self._torsion.inertia
        K = K + np.einsum('g,gi,gj->ij', self._weights * self._torsion.stiffness, twist, twist)
        mass = (np.einsum('g,gik,gjk->ij', dm, phi, phi)
                + np.einsum('g,gi,gj->ij', polar, psi, psi))
        return Beam(
            coordinates, straight, _clean(axial),
            coupling=_clean(np.einsum('g,gik,ag->iak', dm, phi, basis)),
            products=_clean(np.einsum('g,gik,gjl->ijkl', dm, phi, phi)),
            twist_momentum=_clean(np.multiply.outer(polar @ psi, e)),
            mass=_clean(mass), stiffness=_clean(K), damping=_clean(self._damping * K),
            root_of_mass=math.sqrt(self.density * self.length),
            points=np.multiply.outer(self.x, e), weights=dm, shapes=phi,
            shortening=-np.einsum('ag,aij->gij', basis, axial), twists=psi, spins=polar,
            direction=e)

    def _linear_functions(self) -> tuple[Array, Array]:
        """
        Return a constant and a linear function that are orthonormal in mass, and x in them.

        The functions are at the quadrature points, (2, g); the coefficients of x are (2,).
        """
        root_of_mass, middle = math.sqrt(self.density * self.length), 0.5 * self.length
        radius = self.length / math.sqrt(12.0)  # of gyration
        linear = (self.x - middle) / (radius * root_of_mass)
        return (np.stack([np.full(len(self.x), 1.0 / root_of_mass), linear]),
                root_of_mass * np.array([middle, radius]))

    def deflections(self, x: float, coordinates: tuple[int, ...]
                    ) -> list[tuple[str, Kind, Array, Deflection]]:
        """Return the joints of a section in series: name, kind, axis, deflection."""
        place = np.array([x])
        phi, slope, _ = (values[0] for values in self.at(place))
        zero, none = np.zeros(self.count), np.zeros((self.count, self.count))
        e, up, side = self.axes
        twist, roll = self.twists(place)[0][0], self._roll(x)
        # A roll is of second order, so its place among the turns does not matter to this order:
        # a twisting section has it in its twist, another one before its other turns, where it
        # does not separate these from the joint at the section.
        before, within = (none, roll) if twist.any() else (roll, none)
        parts: list[tuple[str, Kind, Array, Array, Array]] = [
            ('along', 'prismatic', e, zero, -self.shortening(place)[0]),
            ('up', 'prismatic', up, phi @ up, none),
            ('side', 'prismatic', side, phi @ side, none),
            ('roll', 'revolute', e, zero, before),
            ('turn_side', 'revolute', side, slope @ up, none),
            ('turn_up', 'revolute', up, -(slope @ side), none),
            ('twist', 'revolute', e, twist, within)]
        return [(name, kind, axis, Deflection(coordinates, _clean(a), _clean(B)))
                for name, kind, axis, a, B in parts if a.any() or B.any()]


def _clean(array: Array) -> Array:
    """Return a read-only array with rounding errors of zeros removed."""
    largest = float(np.abs(array).max(initial=0.0))
    result = np.where(np.abs(array) < ROUNDING * largest, 0.0, array)
    result.flags.writeable = False
    return result
