"""
Torque of the drives of elastic joints, over any scalar.

With the deflection delta = theta - q of a drive, its gear transmits tau_J = k(delta) +
D delta' from the motor to the link. A curve of stiffness is straight segments with
rounded corners: with a ramp h(x) that is 0 below -w and x above w,

    k(delta) = K_1 delta + sum_i (K_i+1 - K_i) (h(delta - d_i) - h(-delta - d_i))

which is odd, and straight farther than w from its corners, so that a dead zone transmits
nothing. Within w the ramp's second derivative is 35 / (32 w) (1 - (x / w)^2)^3, which
joins the straight segments with four continuous derivatives.
"""

from collections.abc import Callable
from typing import NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import magnitude, select
from kane_dynamics.model.drive import (corner_integral, corner_ramp, corner_slope, Drive,
                                       StiffnessCurve)
from kane_dynamics.model.model import Model
import numpy as np

STEPS = 12  # of Newton's method for the inverse of a curve
SLOPES = 1e5  # largest ratio of slopes for which that many steps suffice


def spring_torque(drive: Drive, deflection: Scalar) -> Scalar:
    """Return the torque k(delta) of a drive's spring, N m or N."""
    curve = drive.stiffness
    if not isinstance(curve, StiffnessCurve):
        return curve * deflection
    # The first slope everywhere, and beyond each corner, on both sides, its change.
    torque: Scalar = curve.slopes[0] * deflection
    for corner in _corners(curve):
        ahead = _ramp(deflection - corner.deflection, corner.width)
        behind = _ramp(-deflection - corner.deflection, corner.width)
        torque = torque + corner.change * (ahead - behind)
    return torque


def spring_slope(drive: Drive, deflection: Scalar) -> Scalar:
    """Return the derivative of `spring_torque`, N m/rad or N/m."""
    curve = drive.stiffness
    if not isinstance(curve, StiffnessCurve):
        return curve
    slope: Scalar = curve.slopes[0]
    # A curve is a line with corners, at the same distance on both sides of zero.
    for corner in _corners(curve):
        ahead = _ramp_slope(deflection - corner.deflection, corner.width)
        behind = _ramp_slope(-deflection - corner.deflection, corner.width)
        slope = slope + corner.change * (ahead + behind)
    return slope


def steepest_slope(drive: Drive) -> float:
    """Return the largest `spring_slope` of a drive, N m/rad or N/m."""
    curve = drive.stiffness
    if isinstance(curve, StiffnessCurve):
        return max(curve.slopes)
    return curve


def spring_energy(drive: Drive, deflection: Scalar) -> Scalar:
    """Return the integral of `spring_torque` from 0, J."""
    curve = drive.stiffness
    square = deflection * deflection
    if not isinstance(curve, StiffnessCurve):
        return 0.5 * curve * square
    energy = 0.5 * curve.slopes[0] * square
    for corner in _corners(curve):
        ahead = _ramp_integral(deflection - corner.deflection, corner.width)
        behind = _ramp_integral(-deflection - corner.deflection, corner.width)
        # Both ramps have an integral at delta = 0; without it, the energy is zero there.
        at_zero = 2.0 * _ramp_integral(-corner.deflection, corner.width)
        energy = energy + corner.change * (ahead + behind - at_zero)
    return energy


def spring_deflection(drive: Drive, torque: Scalar) -> Scalar:
    """
    Return the deflection at which a drive's spring has a torque, rad or m.

    Newton's method from the curve without rounding. Every step also doubles the number
    of derivatives that are exact, where the torque has some.

    Raises
    ------
    InputError
        The curve has a dead zone, in which the torque does not determine it, or slopes
        that differ by more than a factor of 1e5.

    """
    curve = drive.stiffness
    if not isinstance(curve, StiffnessCurve):
        return torque * (1.0 / curve)
    # Where the curve has no unique or no well-conditioned inverse,
    # there is no deflection.
    if curve.dead_zone:
        raise InputError(f"drive of motor '{drive.motor}': a dead zone of "
                         f'{curve.dead_zone:g} in its stiffness curve; expected a curve '
                         'without one, because within it the torque 0 leaves the '
                         'deflection open')
    if max(curve.slopes) > SLOPES * min(curve.slopes):
        raise InputError(f"drive of motor '{drive.motor}': slopes from "
                         f'{min(curve.slopes):g} to {max(curve.slopes):g} in its '
                         f'stiffness curve; expected a ratio of at most {SLOPES:g} where the '
                         'deflection is computed from the torque')
    # Newton steps from the curve with sharp corners, which is near the smooth one.
    deflection = _sharp_deflection(curve, torque)
    for _ in range(STEPS):
        error = spring_torque(drive, deflection) - torque
        deflection = deflection - error / spring_slope(drive, deflection)
    return deflection


def drive_forces(model: Model, values: Vector,
                 torque: Callable[[Drive, Scalar], Scalar]) -> Vector:
    """
    Return a torque of all drives on their two coordinates, (n,), N m or N.

    `torque` is a function of the drive and the difference of motor and link in `values`,
    (n,), which are positions or rates. It is what balances the spring: positive on the
    motor, negative on the link.
    """
    total: list[Scalar] = [0.0] * model.n
    for _, drive, link, motor in model.drives:
        # The spring pulls the motor back and the link along.
        transmitted = torque(drive, values[motor] - values[link])
        total[motor] = total[motor] + transmitted
        total[link] = total[link] - transmitted
    return np.array(total)


def damping_torque(drive: Drive, rate: Scalar) -> Scalar:
    """Return the torque D delta' of a drive's damping, N m or N."""
    return drive.damping * rate


def damping_slope(drive: Drive, rate: Scalar) -> Scalar:
    """Return the derivative of `damping_torque`, N m s/rad or N s/m."""
    return drive.damping


def drive_matrix(model: Model, slope: Callable[[Drive, Scalar], Scalar],
                 values: Vector | None = None) -> Matrix:
    """
    Return the derivative of `drive_forces` by its `values`, (n, n).

    `slope` is the derivative of the torque, a function of the drive and the difference
    of motor and link in `values`, (n,); 0 by default.
    """
    matrix: Matrix = np.zeros((model.n, model.n)).astype(object)
    for _, drive, link, motor in model.drives:
        difference = 0.0 if values is None else values[motor] - values[link]
        change = slope(drive, difference)
        # The matrix of a spring between two coordinates.
        matrix[motor, motor] = matrix[motor, motor] + change
        matrix[link, link] = matrix[link, link] + change
        matrix[motor, link] = matrix[motor, link] - change
        matrix[link, motor] = matrix[link, motor] - change
    return matrix


def linear_drives(model: Model) -> tuple[Matrix, Matrix]:
    """Return stiffness at deflection 0 and damping of all drives, (n, n) each."""
    def stiffness(drive: Drive, _: Scalar) -> Scalar:
        return drive.stiffness_at_rest
    return (drive_matrix(model, stiffness).astype(np.float64),
            drive_matrix(model, damping_slope).astype(np.float64))


class _Corner(NamedTuple):
    """Corner of a curve: where it is, its change of slope, and its width."""

    deflection: float
    change: float
    width: float


def _corners(curve: StiffnessCurve) -> list[_Corner]:
    """Return the corners of a curve between its segments."""
    assert curve.rounding is not None  # the curve chooses one
    corners = []
    slopes = curve.slopes
    for deflection, before, after in zip(curve.deflection.tolist(), slopes, slopes[1:]):
        corners.append(_Corner(deflection, after - before, curve.rounding))
    return corners


def _ramp(x: Scalar, width: float) -> Scalar:
    """Return the ramp h: 0 below -width, x above width."""
    place, beyond = _split(x, width)
    return 2.0 * width * corner_ramp(place) + beyond


def _ramp_slope(x: Scalar, width: float) -> Scalar:
    """Return the derivative of `_ramp`."""
    place, _ = _split(x, width)
    return corner_slope(place)


def _ramp_integral(x: Scalar, width: float) -> Scalar:
    """Return the integral of `_ramp` from far below 0."""
    place, beyond = _split(x, width)
    within = 4.0 * width * width * corner_integral(place)
    return within + beyond * (width + 0.5 * beyond)


def _split(x: Scalar, width: float) -> tuple[Scalar, Scalar]:
    """Return the place in a corner, from 0 to 1, and what of x lies above the corner."""
    place = 0.5 + x * (0.5 / width)
    above = select(place > 1.0, 1.0, place)
    return select(place < 0.0, 0.0, above), select(place > 1.0, x - width, 0.0)


def _sharp_deflection(curve: StiffnessCurve, torque: Scalar) -> Scalar:
    """Return the deflection of the curve without rounding."""
    # The curve is odd. Of the segments, the last one that begins below the load counts.
    load = magnitude(torque)
    deflection = load * (1.0 / curve.slopes[0])
    points = zip(curve.deflection.tolist(), curve.torque.tolist(), curve.slopes[1:])
    for corner, level, slope in points:
        beyond = corner + (load - level) * (1.0 / slope)
        deflection = select(level < load, beyond, deflection)
    return select(torque < 0.0, -deflection, deflection)
