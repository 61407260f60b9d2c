"""
Stiffness curve of one drive: straight segments in place of a constant stiffness.

The spring's equation of `gear_fit` is then

    theta - q + offset = k^-1(tau_J - D (theta' - q') - torque_offset)

with a `StiffnessCurve` k whose slopes and corners are fitted. The curve is odd: where torques
of both signs reach its corners, it separates the offset of the torque from that of the
deflection; elsewhere the corners move with the offset, which is then taken as zero. The
fewest segments whose residuals justify them are taken, by the criterion of Schwarz (Annals
of Statistics 6, 1978): each parameter has to lessen the sum of squares by the logarithm of
their number.
"""

from collections.abc import Sequence
from itertools import combinations, pairwise, product

from kane_dynamics._util.typing import Array
from kane_dynamics.identification.drives.gear_fit import (Elasticity, fitted,
                                                          GearEquations, GearFit,
                                                          LinkSignals, slip_speed)
from kane_dynamics.mechanics.elastic_joints import spring_slope, spring_torque
from kane_dynamics.model.drive import Drive, StiffnessCurve
import numpy as np

CORNERS = 0.1, 0.2, 0.35, 0.5, 0.65, 0.8  # of the largest torque: trials to start from
SOFTEST, STIFFEST = 20.0, 0.05  # first compliances, relative to that of one segment
WIDEST = 1e4  # factor from the start to which compliances and corners are searched
BEYOND = 1.25  # of the last corner: the least torque of the last point of a curve
GRID = 1000  # deflections between which the inverse of a curve is linear
DAMPING = 'drive_damping'
TORQUE_OFFSET = 'torque_offset'


class CurveEquations(GearEquations):
    """
    The equations of a joint whose stiffness is a curve.

    Parameters
    ----------
    straight : GearEquations
        Those of the same joint with a constant stiffness.
    fit : GearFit
        Their fit, from which this one starts.
    segments : int
        Number of straight segments, at least 2.
    offset : bool
        Whether the torque has an offset, of a sensor or a constant one on the link.

    """

    def __init__(self, straight: GearEquations, fit: GearFit, segments: int,
                 offset: bool) -> None:
        super().__init__(straight._signals, straight._of, straight._given_skew)
        self.segments = segments
        self.holds = (straight.held,)
        self._straight = fit
        self._bent: dict[tuple[float, ...], tuple[Array, Array]] = {}
        others = [name for name in self.names if name not in ('compliance', 'eta')]
        if offset:
            others.append(TORQUE_OFFSET)
        self.names = (*compliance_names(segments), *_corner_names(segments), DAMPING,
                      *others)

    def start(self) -> Array:
        """Return parameters to start from: the corners that fit best of a few."""
        # All but the spring are those of the constant stiffness.
        straight = dict(zip(self._straight.names, self._straight.x.tolist(), strict=True))
        value = self._values(np.zeros(len(self.names))) | straight
        compliance = max(value['compliance'], 1e-12)
        value[DAMPING] = max(value['eta'], 0.0) / compliance
        # The torque of each gear and its deflection, by the straight fit.
        link = self._of_links(value['skew'], slip_speed(value))
        torque = self._spring_load(value, link)
        deflection = self._theta - link.q
        largest = float(np.abs(torque).max())

        # The deflection is linear in the compliances of segments between given corners.
        least = np.inf
        for shares in combinations(CORNERS, self.segments - 1):
            corners = largest * np.array(shares)
            parts = [self._of.of(part) for part in _parts(torque, corners)]
            columns = np.column_stack([*parts, -self._constant])
            A = np.vstack([columns.real, columns.imag])
            b = np.concatenate([deflection.real, deflection.imag])
            solution = np.linalg.lstsq(A, b)[0]
            missing = float(np.sum((A @ solution - b)**2))
            # The best corners give all parameters of the curve.
            if missing < least:
                least = missing
                compliances = np.clip(solution[:-1], STIFFEST * compliance,
                                      SOFTEST * compliance)
                value.update(zip(compliance_names(self.segments), np.log(compliances)))
                rises = np.diff(corners, prepend=0.0)
                value.update(zip(_corner_names(self.segments), np.log(rises)))
        return np.array([value[name] for name in self.names])

    def bounds(self) -> Array:
        """Return the least and the largest parameters, (2, n)."""
        bounds = super().bounds()
        start = self.start()
        for k, name in enumerate(self.names):
            if name in (*compliance_names(self.segments), *_corner_names(self.segments)):
                bounds[:, k] = start[k] + np.log(WIDEST) * np.array([-1.0, 1.0])
        return bounds

    def curve(self, value: dict[str, float]) -> StiffnessCurve:
        """Return the curve of parameters, up to the largest torque of the recording."""
        compliances = np.exp([value[name] for name in compliance_names(self.segments)])
        rises = np.exp([value[name] for name in _corner_names(self.segments)])
        corners = np.cumsum(rises)
        last = max(self._largest, BEYOND * float(corners[-1]))
        torques = np.append(corners, last)
        deflections = np.cumsum(compliances * np.diff(torques, prepend=0.0))
        return StiffnessCurve(deflections, torques)

    @property
    def _largest(self) -> float:
        """Return the largest torque of the gear without friction of the link, N m or N."""
        torque = self._signals.gear_torque
        if self._signals.link is not None:
            torque = self._signals.link.torque
        if torque is None:
            return 0.0
        return float(np.abs(torque).max())

    def _spring_load(self, value: dict[str, float], link: LinkSignals) -> Array:
        """Return the torque of the spring alone, tau_J - D (theta' - q'), (N,)."""
        rate = self._signals.speed.values - link.speed
        load = link.torque - value[DAMPING] * rate - value.get(TORQUE_OFFSET, 0.0)
        if self._signals.link is not None:
            load = (load + value['link_damping'] * link.speed
                    + value['link_friction'] * link.friction)
        return np.asarray(load)

    def _spring(self, value: dict[str, float], link: LinkSignals, gear: Array) -> Array:
        """Return the first equation: the deflection of the curve is the measured one."""
        bent, _ = self._bent_along(value, link)
        return np.asarray(self._of.of(bent) - self._deflection(value, link))

    def _bent_along(self, value: dict[str, float], link: LinkSignals) -> tuple[Array, Array]:
        """Return `_along` of the curve; both parts of an evaluation need it."""
        key = tuple(value.values())
        if key not in self._bent:
            self._bent.clear()
            self._bent[key] = _along(self.curve(value), self._spring_load(value, link))
        return self._bent[key]

    def _elasticity(self, value: dict[str, float]) -> Elasticity:
        """Return the compliance of the curve along the motion, and its time constant."""
        link = self._of_links(value['skew'], slip_speed(value))
        _, compliance = self._bent_along(value, link)
        mean = float(compliance.mean())
        return Elasticity(mean, float(compliance.std()), mean * value[DAMPING])


class CurveFit:
    """
    The stiffness curve of a fit.

    Attributes
    ----------
    curve : StiffnessCurve
    slope_deviation : (k,) array
        Standard deviations of the slopes, N m/rad or N/m.

    """

    def __init__(self, equations: CurveEquations, fit: GearFit) -> None:
        values = dict(zip(fit.names, fit.x.tolist(), strict=True))
        self.curve = equations.curve(values)
        # Of a logarithm: the relative deviation.
        relative = [fit.deviation(name) for name in compliance_names(equations.segments)]
        self.slope_deviation = np.array(self.curve.slopes) * np.array(relative)


def compliance_names(segments: int) -> list[str]:
    """Return the names of the logarithms of the compliances of segments."""
    return [f'log_compliance_{k + 1}' for k in range(segments)]


def fitted_curve(straight: GearEquations, fit: GearFit, most: int,
                 largest_deviation: float) -> tuple[GearFit, CurveFit | None]:
    """
    Return the fit with the fewest segments that the residuals justify, and its curve.

    Parameters
    ----------
    straight : GearEquations
        With a constant stiffness.
    fit : GearFit
        Of these equations; its curve is None.
    most : int
        Largest number of segments.
    largest_deviation : float
        Relative standard deviation up to which all slopes of a curve are determined.

    """
    candidates: list[tuple[GearFit, CurveFit | None]] = [(fit, None)]
    residuals = [straight.weighted(fit.x)]
    for segments, offset in product(range(2, most + 1), (False, True)):
        equations = CurveEquations(straight, fit, segments, offset)
        candidate = fitted(equations)
        curve = CurveFit(equations, candidate)
        # A curve counts if the data determine the slope of each segment.
        allowed = largest_deviation * np.array(curve.curve.slopes)
        is_determined = (curve.slope_deviation <= allowed).all()
        if offset:
            first_corner = curve.curve.torque[0]
            is_determined &= (candidate.deviation(TORQUE_OFFSET)
                              <= largest_deviation * first_corner)
        if is_determined:
            candidates.append((candidate, curve))
            residuals.append(equations.weighted(candidate.x))

    # What no curve explains counts as noise.
    noise = min(candidate.misfit for candidate, _ in candidates)
    # Bayesian information criterion: misfit, and a price for each parameter.
    costs = []
    for (candidate, _), residual in zip(candidates, residuals, strict=True):
        parameters = len(candidate.x) * np.log(len(residual))
        costs.append(float(residual @ residual) / noise + parameters)
    return candidates[int(np.argmin(costs))]


def _corner_names(segments: int) -> list[str]:
    """Return the names of the logarithms of the torques between corners."""
    return [f'log_rise_{k + 1}' for k in range(segments - 1)]


def _parts(torque: Array, corners: Sequence[float] | Array) -> list[Array]:
    """Return the parts of a torque in each segment between corners, (N,) each."""
    bounds = [0.0, *corners, np.inf]
    size = np.abs(torque)
    parts = []
    for begin, end in pairwise(bounds):
        parts.append(np.sign(torque) * (np.clip(size, begin, end) - begin))
    return parts


def _along(curve: StiffnessCurve, torque: Array) -> tuple[Array, Array]:
    """Return the deflections of a curve under torques, and its compliances there, (N,)."""
    drive = Drive(curve)
    size = np.abs(torque)
    # Rounded corners move the largest deflection by less than half of it.
    deflections = np.linspace(0.0, 1.5 * _sharp(curve, float(size.max())), GRID)
    torques = spring_torque(drive, deflections)
    compliances = 1.0 / spring_slope(drive, deflections)
    bent = np.interp(size, torques, deflections)
    return np.sign(torque) * bent, np.interp(size, torques, compliances)


def _sharp(curve: StiffnessCurve, torque: float) -> float:
    """Return the deflection of a curve with sharp corners under a positive torque."""
    last = (torque - float(curve.torque[-1])) / curve.slopes[-1]
    inside = np.interp(torque, [0.0, *curve.torque], [0.0, *curve.deflection])
    return float(inside) + max(last, 0.0)
