"""Flexible links: description of a beam and computation of its modal integrals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any, Literal

from kane_dynamics._util.checks import constant, real_numbers
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
from kane_dynamics.model.beam import Beam, Deflection
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.mode_shapes import Bending, gauss, MOST_MODES, Shapes, Torsion
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
        Number of modes in these two directions, at most 32 each.
    direction, up : (3,) arrays
        Directions of the beam and of the first bending, in the body's axes.
    bending : Bending or pair of Bending
        The assumed shapes: `clamped_free` and so on, for both directions or one each.
    torsion : Torsion, optional
        GJ and modes of torsion. Default: no torsion.
    damping : float
        Material damping (Kelvin-Voigt): stress per strain rate over stress per strain,
        s.
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
            raise ModelError(f'tube: bore {bore} m, radius {radius} m; expected 0 <= '
                             'bore < radius')
        # Polar moment of the section; that of bending is half of it.
        polar = 0.5 * math.pi * (radius**4 - bore**4)
        torsion = Torsion(shear * polar, material_density * polar, twists)
        density = material_density * math.pi * (radius**2 - bore**2)
        bending_stiffness = 0.5 * young * polar
        return cls(length, density, bending_stiffness, modes, torsion=torsion, **options)

    def assumed_modes(self, name: str) -> AssumedModes:
        """Check the description and return the assumed modes; errors name the link."""
        what = f"beam '{name}'"
        for key in ('length', 'density', 'damping'):
            value = float(constant(getattr(self, key), (), f'{what}: {key}'))
            may_be_zero = key == 'damping'
            if value < 0.0 or (value == 0.0 and not may_be_zero):
                sign = 'nonnegative' if may_be_zero else 'positive'
                raise ModelError(f'{what}: {key} {value:g}; expected a {sign} number')
        modes = _of_both_planes(self.modes)
        is_integer = np.asarray(modes).dtype.kind in 'iu'
        if not is_integer or modes.min() < 0 or modes.max() > MOST_MODES:
            raise ModelError(f'{what}: modes {self.modes!r}; expected one or two '
                             f'numbers of modes, 0 to {MOST_MODES}')
        # A plane without modes needs no stiffness.
        stiffness = _of_both_planes(self.stiffness)
        if stiffness is None or stiffness[modes > 0].min(initial=1.0) <= 0.0:
            raise ModelError(f'{what}: stiffness {self.stiffness!r}; expected positive '
                             'EI')
        torsion = self.torsion or Torsion(1.0, 0.0, 0)
        return AssumedModes(name, self, self._axes(what), stiffness, modes,
                            torsion.checked(what))

    def _axes(self, what: str) -> Array:
        """Return the directions of the beam and of its two bendings, (3, 3)."""
        e = constant(self.direction, (3,), f'{what}: direction')
        up = constant(self.up, (3,), f'{what}: up')
        # `up` is in the plane of the first bending, and need not be perpendicular to
        # the beam.
        side = np.cross(e, up)
        if not np.linalg.norm(side) > 1e-9 * float(np.linalg.norm(e)):
            raise ModelError(f'{what}: direction {e.tolist()} and up {up.tolist()}; '
                             'expected two different directions')
        e = e / np.linalg.norm(e)
        side = side / np.linalg.norm(side)
        return np.array([e, np.cross(side, e), side])


def _of_both_planes(value: Any) -> Any:
    """Return one or two finite numbers as (2,), None for anything else."""
    try:
        real_numbers(value)
        pair = np.broadcast_to(np.asarray(value), (2,))
    except (TypeError, ValueError):
        return None
    is_number = pair.dtype.kind in 'iuf' and np.isfinite(pair).all()
    return pair if is_number else None


class AssumedModes:
    """Assumed modes of a beam as functions of the position, orthonormal in mass."""

    def __init__(self, name: str, link: FlexibleLink, axes: Array, stiffness: Array,
                 modes: Array, torsion: Torsion) -> None:
        """
        Evaluate the shapes at the quadrature points.

        Parameters
        ----------
        name : str
            Name of the beam, for its coordinates and for messages.
        link : FlexibleLink
            Length, density, damping and shapes of bending are read from it.
        axes : (3, 3) array
            Directions of the beam and of the two bendings, one a row.
        stiffness, modes : (2,) arrays
            EI and number of modes in the two directions.
        torsion : Torsion
            Checked; without modes for none.

        """
        self.name = name
        self.length = float(link.length)
        self.density = float(link.density)
        self.axes = axes
        self._damping = float(link.damping)
        self._stiffness = stiffness
        self._modes = modes
        self._torsion = torsion
        self._foreshortening = link.foreshortening
        # Both planes bend alike unless two bendings are stated.
        bending = link.bending
        if not isinstance(bending, Sequence):
            bending = (bending or Bending.clamped_free(),) * 2
        self._bending = list(bending)
        self._bends = int(modes.sum())
        self.count = self._bends + torsion.modes
        # As many points as integrate products of all shapes exactly enough.
        self.x, self._weights = gauss(self.length, self.count)
        self._mixing = [self._orthonormal(plane) for plane in range(2)]

    @property
    def names(self) -> list[str]:
        """Return the names of the modal coordinates: <beam>/mode_1 and so on."""
        bends = [f'{self.name}/mode_{k + 1}' for k in range(self._bends)]
        twists = [f'{self.name}/twist_{k + 1}' for k in range(self._torsion.modes)]
        return bends + twists

    @property
    def inertial(self) -> Inertial:
        """Return the inertial of the straight beam: a rod with rotary inertia."""
        e = self.axes[0]
        end = self.length * e
        mass = self.density * self.length
        rod = mass / 12.0 * (end @ end * np.eye(3) - np.outer(end, end))
        polar = self._torsion.inertia * self.length
        sections = 0.5 * polar * (np.eye(3) + np.outer(e, e))
        return Inertial(mass, 0.5 * end, rod + sections)

    def _orthonormal(self, plane: int) -> Array:
        """Return the matrix, (k, k), that makes the shapes orthonormal in mass."""
        count = int(self._modes[plane])
        if not count:
            return np.zeros((0, 0))
        # int phi_i phi_j dm along the beam, and the mass at its tip.
        phi, _, _ = self._assumed(plane, self.x)
        gram = (phi * (self._weights * self.density)) @ phi.T
        phi_at_tip, _, _ = self._assumed(plane, np.array([self.length]))
        tip = phi_at_tip[:, 0]
        gram = gram + self._bending[plane].tip_mass * np.outer(tip, tip)
        values = np.linalg.eigvalsh(gram)
        if not values[0] > DEPENDENT * values[-1]:
            raise ModelError(f"beam '{self.name}': {count} linearly dependent shapes of "
                             f'bending (singular values {values[0]:.3g} to '
                             f'{values[-1]:.3g}); expected independent ones')
        # With gram = L L^T, the shapes L^-1 phi have the unit matrix as theirs.
        return np.linalg.inv(np.linalg.cholesky(gram))

    def _assumed(self, plane: int, x: Array) -> Shapes:
        mass = self.density * self.length
        count = int(self._modes[plane])
        return self._bending[plane].at(x, self.length, mass, count)

    def at(self, x: Array) -> tuple[Array, Array, Array]:
        """Return phi, phi' and phi'', (len(x), m, 3) each, at positions x."""
        shapes = np.zeros((3, len(x), self.count, 3))
        first = 0
        # Each plane's shapes are orthonormal combinations of assumed ones, along its
        # axis.
        for plane, mixing in enumerate(self._mixing):
            last = first + len(mixing)
            if len(mixing):
                direction = self.axes[1 + plane]
                for order, assumed in enumerate(self._assumed(plane, x)):
                    orthonormal = mixing @ assumed
                    vectors = np.multiply.outer(orthonormal.T, direction)
                    shapes[order, :, first:last] = vectors
            first = last
        phi, slope, curvature = shapes
        return phi, slope, curvature

    def twists(self, x: Array) -> tuple[Array, Array]:
        """Return psi and psi', (len(x), m) each, at positions x along the beam."""
        twists = np.zeros((2, len(x), self.count))
        torsion = self._torsion.at(x, self.length)  # (2, modes, len(x))
        twists[:, :, self._bends:] = torsion.transpose(0, 2, 1)
        psi, slope = twists
        return psi, slope

    def shortening(self, x: Array) -> Array:
        """Return the foreshortening matrices H at positions x, (len(x), m, m)."""
        H = np.zeros((len(x), self.count, self.count))
        if not self._foreshortening:
            return H
        for k, end in enumerate(x):
            # H_ij = int_0^x phi_i' . phi_j', by a quadrature of its own up to this
            # position.
            points, weights = gauss(float(end), self.count)
            _, slope, _ = self.at(points)
            H[k] = np.einsum('gik,gjk->ij', weights[:, None, None] * slope, slope)
        return H

    def _roll(self, x: float) -> Array:
        """
        Return the second derivatives of the roll by bending in two planes, (m, m).

        With deflections v along `up` and w along e x up, a section turns by v' and -w'
        about these axes and by theta about the beam. Its torsion is theta' + v'' w'.
        Without torsion theta is therefore -int v'' w'.
        """
        points, weights = gauss(x, self.count)
        _, slope, curvature = self.at(points)
        _, up, side = self.axes
        product: Array = np.einsum('g,gi,gj->ij', weights, curvature @ up, slope @ side)
        roll: Array = -(product + product.T)
        return roll

    def beam(self, coordinates: tuple[int, ...]) -> Beam:
        """Return the modal integrals for the equations of motion."""
        phi, _, curvature = self.at(self.x)
        psi, twist = self.twists(self.x)
        e = self.axes[0]
        dm = self._weights * self.density
        polar = self._weights * self._torsion.inertia

        # Mass: that of the deflections and that of the turning sections.
        mass = (np.einsum('g,gik,gjk->ij', dm, phi, phi)
                + np.einsum('g,gi,gj->ij', polar, psi, psi))

        # Stiffness: EI phi'' . phi'' of each mode of bending, and GJ psi' psi'.
        no_bending = np.zeros(self._torsion.modes)
        EI = np.append(np.repeat(self._stiffness, self._modes.astype(int)), no_bending)
        bending = np.einsum('g,gik,gjk->ij',
                            self._weights, curvature, curvature) * EI[:, None]
        GJ = self._weights * self._torsion.stiffness
        stiffness = bending + np.einsum('g,gi,gj->ij', GJ, twist, twist)

        # Foreshortening: its coefficients in the constant and the linear function of x.
        basis, straight = self._linear_functions()
        axial = -np.einsum('g,ag,gij->aij', dm, basis, self.shortening(self.x))
        return Beam(
            coordinates, straight, _clean(axial),
            coupling=_clean(np.einsum('g,gik,ag->iak', dm, phi, basis)),
            products=_clean(np.einsum('g,gik,gjl->ijkl', dm, phi, phi)),
            twist_momentum=_clean(np.multiply.outer(polar @ psi, e)),
            mass=_clean(mass), stiffness=_clean(stiffness),
            damping=_clean(self._damping * stiffness),
            root_of_mass=math.sqrt(self.density * self.length),
            points=np.multiply.outer(self.x, e), weights=dm, shapes=phi,
            shortening=-np.einsum('ag,aij->gij', basis, axial), twists=psi, spins=polar,
            direction=e)

    def _linear_functions(self) -> tuple[Array, Array]:
        """
        Return a constant and a linear function, orthonormal in mass, and x in them.

        The functions are at the quadrature points, (2, g); the coefficients of x are
        (2,).
        """
        root_of_mass = math.sqrt(self.density * self.length)
        middle = 0.5 * self.length
        radius = self.length / math.sqrt(12.0)  # of gyration
        constant_function = np.full(len(self.x), 1.0 / root_of_mass)
        linear_function = (self.x - middle) / (radius * root_of_mass)
        return (np.stack([constant_function, linear_function]),
                root_of_mass * np.array([middle, radius]))

    def deflections(self, x: float, coordinates: tuple[int, ...]
                    ) -> list[tuple[str, Kind, Array, Deflection]]:
        """Return the joints of a section in series: name, kind, axis, deflection."""
        position = np.array([x])
        phi, slope, _ = (shapes[0] for shapes in self.at(position))
        twist = self.twists(position)[0][0]
        shortening = self.shortening(position)[0]
        roll = self._roll(x)
        e, up, side = self.axes
        none = np.zeros(self.count)
        flat = np.zeros((self.count, self.count))
        # A roll is of second order, so its place among the turns does not matter to this
        # order: a twisting section has it in its twist, another one ahead of its other
        # turns, where it does not separate these from the joint at the section.
        separate_roll = flat if twist.any() else roll
        roll_of_twist = roll if twist.any() else flat
        parts: list[tuple[str, Kind, Array, Array, Array]] = [
            ('along', 'prismatic', e, none, -shortening),
            ('up', 'prismatic', up, phi @ up, flat),
            ('side', 'prismatic', side, phi @ side, flat),
            ('roll', 'revolute', e, none, separate_roll),
            ('turn_side', 'revolute', side, slope @ up, flat),
            ('turn_up', 'revolute', up, -(slope @ side), flat),
            ('twist', 'revolute', e, twist, roll_of_twist)]
        joints = []
        for name, kind, axis, linear, quadratic in parts:
            if linear.any() or quadratic.any():
                deflection = Deflection(coordinates, _clean(linear), _clean(quadratic))
                joints.append((name, kind, axis, deflection))
        return joints


def _clean(array: Array) -> Array:
    """Return a read-only array with rounding errors of zeros removed."""
    largest = float(np.abs(array).max(initial=0.0))
    result = np.where(np.abs(array) < ROUNDING * largest, 0.0, array)
    result.flags.writeable = False
    return result
