"""
Stiffness, damping and rotor inertia of one drive from both of its encoders.

With the compliance c = 1/K and eta = D/K the spring and the motor of a joint obey

    c tau_J = (theta - q) + eta (theta' - q') + offset                      (spring)
    tau_m   = B theta'' + tau_J + friction(theta') + offset                 (motor)

tau_J is measured by a torque sensor, or it is that of the links, M q'' + h(q, q') plus
friction of the link's side. Encoders of the links may be late by s: q is q_m(t + s), and
so is every torque computed from it. To first order the delay adds s q' to the deflection,
as if the spring were c s q' softer: a torque that is not in step with the speed separates
the two.

A motor's torque acts later than it is recorded: a command that is held for a cycle by half
a cycle. tau_m is that of the recording at t - d. Without d in the equations the links'
torque, and with it s, would follow the motor's torque. Whether each torque is held for the
step of the recording, or measured, is what leaves the smaller residuals.

All signals have noise, the deflection as much as its size: least squares would take the
noise for stiffness. The equations are therefore weighted by the covariance that the noise
of all signals gives them at the parameters themselves, as maximum likelihood does for
linear equations (Pintelon & Schoukens, System Identification, 2nd ed., chapter 9):

    sum over omega of E^H C(omega, x)^-1 E,   C = sum over signals of sigma^2 a a^H

with E the spectra of the equations and a their coefficients of a signal.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.identification.drives.spectra import SmoothSpeed, Spectra
from kane_dynamics.identification.solvers import scientific
from kane_dynamics.mechanics.friction import coulomb
import numpy as np

FLOOR = 1e-12  # relative size of eigenvalues of the information that are kept
PARAMETERS = ('compliance', 'eta', 'skew', 'deflection_offset', 'link_damping',
              'link_friction', 'rotor_inertia', 'motor_damping', 'motor_friction',
              'motor_offset', 'log_slip', 'torque_delay')
FIRST_SLIP = 0.05  # rad/s or m/s
SLIPS = 1e-5, 50.0  # rad/s or m/s: beyond, friction is a step, or viscous
DELAY_BLOCKS = 8  # of rows that are left out in turn
LARGEST_FIRST_SKEW = 0.02  # s
MOST_EVALUATIONS = 40
ROUNDS = 3  # of the noise of friction


class LinkTorque(NamedTuple):
    """
    Torque that the links need at one joint, and how it follows a change of q.

    Attributes
    ----------
    torque : (N,) array
        Without friction, N m or N, at the times of the links' encoders.
    inertia : (n,) array
        Row of the mass matrix, RMS over the motion.

    """

    torque: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class JointSignals:
    """
    Signals of one joint.

    Attributes
    ----------
    t, theta, q : (N,) arrays
    speed, link_speed : SmoothSpeed
        Of theta and q.
    link : LinkTorque, or None with a torque sensor
    gear_torque, motor_torque : (N,) arrays or None
    noise : dict of str to float
        Standard deviations of theta, q, gear_torque, motor_torque.
    place : int
        Of the joint among the links.
    of_links : (n,) array
        Standard deviations of the positions of all links.

    """

    t: Array
    theta: Array
    q: Array
    speed: SmoothSpeed
    link_speed: SmoothSpeed
    link: LinkTorque | None
    gear_torque: Array | None
    motor_torque: Array | None
    noise: dict[str, float]
    place: int
    of_links: Array


def mean_coulomb(speed: Array, slip: float, noise: float) -> Array:
    """
    Return the means of Coulomb friction of coefficient 1 over the steps about rows, (N,).

    It reverses within a step, so that its values at the rows alias into the band. Speeds
    are linear between rows; the integral of tanh(x) is log(cosh(x)).

    Noise of a standard deviation flattens the mean of a curve: E f(x + n) = f + n^2 f'' / 2.
    """
    # The ends of both halves of each step: rows and the middles between them, in order.
    x = speed / slip
    ends = np.empty(2 * len(x) + 1)
    ends[1::2] = x
    ends[2:-1:2] = 0.5 * (x[:-1] + x[1:])
    ends[0] = x[0]
    ends[-1] = x[-1]
    # The mean of tanh over each half of the step, by its integral log cosh, is exact for
    # a speed that is linear in time.
    size = np.abs(ends)
    integral = size + np.log(1.0 + np.exp(-2.0 * size))
    change = np.diff(ends)
    small = np.abs(change) < 1e-4
    of_small = np.tanh(0.5 * (ends[:-1] + ends[1:]))
    halves = np.where(small, of_small, np.diff(integral) / np.where(small, 1.0, change))
    # Noise of the speed flattens the transition: half its variance times the second
    # derivative.
    slipping = np.tanh(x)
    bend = -2.0 * slipping * (1.0 - slipping**2)
    flattened = 0.5 * (noise / slip)**2 * bend
    return np.asarray(0.5 * (halves[::2] + halves[1::2]) - flattened)


class FrictionSlope(NamedTuple):
    """
    Slope of Coulomb friction of coefficient 1 over the speed, along a motion.

    Through it the friction of a noisy speed has noise: the mean slope's is that of
    damping; what the slope varies by spreads the noise over the band.
    """

    mean: float  # s/rad
    spread: float  # variance, per variance of a speed that is white up to the cutoff


def coulomb_slope(speed: Array, slip: float) -> FrictionSlope:
    """Return the slope of Coulomb friction along speeds."""
    slope = (1.0 - coulomb(speed, slip)**2) / slip
    return FrictionSlope(float(slope.mean()), float(slope.var()))


class GearFit(NamedTuple):
    """Values, covariance, and the mean square of the weighted residuals, 1 if noise only."""

    names: tuple[str, ...]
    x: Array
    covariance: Array
    misfit: float

    def value(self, name: str) -> float:
        """Return a parameter; NaN if it was no part of the fit."""
        return float(self.x[self.names.index(name)]) if name in self.names else np.nan

    def deviation(self, name: str) -> float:
        """Return the standard deviation of a parameter; NaN if it was no part of the fit."""
        if name not in self.names:
            return np.nan
        k = self.names.index(name)
        return float(np.sqrt(self.covariance[k, k]))


class LinkSignals(NamedTuple):
    """
    Signals of a link at the times of its motor's samples.

    Attributes
    ----------
    q, q_rate, sliding, rigid : (F,) arrays
        Spectra of the position and its rate, of Coulomb friction of coefficient 1, and of
        the torque of the gear without friction of the link.
    speed, friction, torque : (N,) arrays
        The last three over time.

    """

    q: Array
    q_rate: Array
    sliding: Array
    rigid: Array
    speed: Array
    friction: Array
    torque: Array


class GearEquations:
    """The equations of a joint in the spectra of its signals."""

    def __init__(self, signals: JointSignals, of: Spectra, skew: float | None) -> None:
        self._signals = signals
        self._of = of
        self._given_skew = skew
        self.names = parameter_names(signals, skew)
        spline = scientific('scipy.interpolate').CubicSpline
        columns = [signals.q, signals.link_speed.values]
        if signals.link is not None:
            columns.append(signals.link.torque)
        self._links = spline(signals.t, np.column_stack(columns))
        self.varying = np.zeros(2)  # of the friction of motor and link, see `settle`
        # Times for which each motor torque may be held, and the one in use, s.
        self.holds: tuple[float, ...] = (0.0,)
        self.held = 0.0
        # Spectra of the last parameters: most parameters leave them as they are.
        self._cache: dict[tuple[float, float], LinkSignals] = {}
        self._sliding: dict[float, Array] = {}
        self._slopes: dict[float, tuple[FrictionSlope, FrictionSlope]] = {}
        self._constant = of.of(np.ones(len(signals.t)))
        self._theta = of.of(signals.theta)
        self._theta_rate = of.rate_of(signals.theta)
        self._theta_acceleration = of.acceleration_of(signals.theta)
        if signals.gear_torque is not None:
            self._gear = of.of(signals.gear_torque)
        if signals.motor_torque is not None:
            self._motor = of.delayed(signals.motor_torque)
            self.holds = 0.0, of.step

    def start(self) -> Array:
        """Return parameters to start from: least squares of the spring without a delay."""
        signals = self._signals
        spectrum_of = self._of.of
        if signals.link is None:
            gear = self._gear
        else:
            gear = spectrum_of(signals.link.torque)

        # theta - q = compliance * torque + skew * q' - offset, since the link is at
        # q + skew q' at the time of the motor's sample.
        deflection = self._theta - spectrum_of(signals.q)
        columns = np.column_stack(
            [gear, spectrum_of(signals.link_speed.values), -self._constant])
        # Real and imaginary parts are equations of their own, so that the solution is real.
        solution = np.linalg.lstsq(np.vstack([columns.real, columns.imag]),
                                   np.concatenate([deflection.real, deflection.imag]))[0]
        compliance, skew, _ = solution

        # Far skews come from a poor fit: the search would start in another minimum.
        if abs(skew) > LARGEST_FIRST_SKEW:
            skew = 0.0
        values = {'compliance': compliance, 'skew': skew, 'log_slip': np.log(FIRST_SLIP)}
        return np.array([values.get(name, 0.0) for name in self.names])

    def bounds(self) -> Array:
        """
        Return the least and the largest parameters, (2, n).

        A long step to a friction speed of which the residuals say nothing would stay there.
        """
        bounds = np.full((2, len(self.names)), np.inf)
        bounds[0] = -np.inf
        if 'log_slip' in self.names:
            bounds[:, self.names.index('log_slip')] = np.log(SLIPS)
        return bounds

    def weighted(self, x: Array) -> Array:
        """Return the residuals over their standard deviations, real, (R,)."""
        value = self._values(x)
        signals = self._signals
        slip = slip_speed(value)
        link = self._of_links(value['skew'], slip)
        # The gear carries the link: its rigid dynamics and the friction of the link.
        gear = link.rigid
        if signals.link is not None:
            gear = (link.rigid + value['link_damping'] * link.q_rate
                    + value['link_friction'] * link.sliding)
        # First equation, the spring: compliance times gear torque is the deflection.
        deflection = self._theta - link.q + value['deflection_offset'] * self._constant
        spring = (value['compliance'] * gear - deflection
                  - value['eta'] * (self._theta_rate - link.q_rate))
        # Second equation, the rotor: motor torque less inertia, losses and gear torque
        # is zero.
        rows = [spring]
        if signals.motor_torque is not None:
            losses = (value['motor_damping'] * self._theta_rate
                      + value['motor_friction'] * self._motor_friction(slip))
            motor = self._motor.by(value['torque_delay'], self.held)
            rows.append(motor - value['rotor_inertia'] * self._theta_acceleration
                        - losses - gear - value['motor_offset'] * self._constant)
        return _whitened(np.array(rows), self._covariance(value, slip))

    def _values(self, x: Array) -> dict[str, float]:
        """Return parameters by name; 0 or the default of those that are not fitted."""
        value = dict.fromkeys(PARAMETERS, 0.0)
        value['skew'] = self._given_skew or 0.0
        value['log_slip'] = float(np.log(FIRST_SLIP))
        value.update(zip(self.names, x.tolist(), strict=True))
        return value

    def settle(self, x: Array) -> None:
        """
        Update the noise that the varying slope of friction adds, from parameters.

        It stays in a fit: the residuals would be smallest for a friction of infinite noise.
        """
        value = self._values(x)
        slip = slip_speed(value)
        speeds = {'motor_friction': self._signals.speed,
                  'link_friction': self._signals.link_speed}
        # Friction of a slope that varies makes noise of the speed's noise.
        noise = []
        for name, speed in speeds.items():
            spread = coulomb_slope(speed.values, slip).spread
            noise.append(value[name] * np.sqrt(spread * speed.density))
        self.varying = np.array(noise)

    def _of_links(self, skew: float, slip: float) -> LinkSignals:
        """Return the signals of the link at the motors' times."""
        # Only the last skew and slip are kept: the fit varies other parameters in
        # between.
        key = skew, slip
        if key not in self._cache:
            signals, of = self._signals, self._of
            shifted = self._links(signals.t + skew)
            speed = shifted[:, 1]
            if signals.link is None:
                rigid, torque = self._gear, signals.gear_torque
            else:
                torque = shifted[:, 2]
                rigid = of.of(torque)
            assert torque is not None
            friction = mean_coulomb(speed, slip, signals.link_speed.noise)
            self._cache.clear()
            self._cache[key] = LinkSignals(of.of(shifted[:, 0]), of.rate_of(shifted[:, 0]),
                                           of.of_means(friction), rigid, speed, friction,
                                           torque)
        return self._cache[key]

    def _motor_friction(self, slip: float) -> Array:
        """Return the spectrum of the motor's Coulomb friction of coefficient 1."""
        if slip not in self._sliding:
            self._sliding.clear()
            speed = self._signals.speed
            friction = mean_coulomb(speed.values, slip, speed.noise)
            self._sliding[slip] = self._of.of_means(friction)
        return self._sliding[slip]

    def _friction_slopes(self, slip: float) -> tuple[FrictionSlope, FrictionSlope]:
        """Return the slopes of Coulomb friction of coefficient 1 of motor and link."""
        if slip not in self._slopes:
            self._slopes.clear()
            self._slopes[slip] = (coulomb_slope(self._signals.speed.values, slip),
                                  coulomb_slope(self._signals.link_speed.values, slip))
        return self._slopes[slip]

    def _covariance(self, value: dict[str, float], slip: float) -> Array:
        """Return the covariance of the equations at each frequency, (F, e, e)."""
        signals, omega = self._signals, self._of.omega
        nothing, ones = np.zeros(len(omega)), np.ones(len(omega))
        compliance = value['compliance']
        elastic = 1.0 + 1j * omega * value['eta']
        # Signals with their coefficients in the two equations; friction acts as damping
        # on the noise of a position, by its mean slope.
        on_motor, on_link = self._friction_slopes(slip)
        damping = value['motor_damping'] + value['motor_friction'] * on_motor.mean
        of_motor = omega**2 * value['rotor_inertia'] - 1j * omega * damping
        terms: list[tuple[float, Any, Any]] = [(signals.noise['theta'], -elastic, of_motor)]
        # What the slope of friction varies by.
        terms.append((1.0, nothing, self.varying[0] * ones))
        if signals.link is None:
            sensor = signals.noise['gear_torque']
            terms.append((signals.noise['q'], elastic, nothing))
            terms.append((sensor, compliance * ones, -ones))
        else:
            damping = value['link_damping'] + value['link_friction'] * on_link.mean
            varying = self.varying[1] * ones
            terms.append((1.0, compliance * varying, -varying))
            for k, deviation in enumerate(signals.of_links):
                of_torque = -omega**2 * signals.link.inertia[k]
                of_spring = compliance * of_torque
                if k == signals.place:
                    of_torque = of_torque + 1j * omega * damping
                    of_spring = compliance * of_torque + elastic
                terms.append((deviation, of_spring, -of_torque))
        if signals.motor_torque is not None:
            terms.append((signals.noise['motor_torque'], nothing, ones))
        size = 1 if signals.motor_torque is None else 2
        covariance = np.zeros((len(omega), size, size), dtype=complex)
        for deviation, *of_rows in terms:
            a = np.column_stack(of_rows[:size])
            covariance += deviation**2 * a[:, :, None] * a[:, None, :].conj()
        return self._of.gain * covariance


def encoder_delay(signals: JointSignals) -> tuple[float, float]:
    """
    Return how late the link's encoder is, and the standard deviation, s.

    It is that of three columns of least squares, deflection = compliance * torque + delay *
    speed + offset, which hold whatever the spring is; the deviation is that of fits without
    each of some blocks of rows (jackknife).
    """
    torque = signals.gear_torque if signals.link is None else signals.link.torque
    assert torque is not None
    columns = np.column_stack([torque, signals.link_speed.values, np.ones(len(torque))])
    deflection = signals.theta - signals.q
    delays = []
    for rows in np.array_split(np.arange(len(torque)), DELAY_BLOCKS):
        others = np.setdiff1d(np.arange(len(torque)), rows)
        delays.append(np.linalg.lstsq(columns[others], deflection[others])[0][1])
    spread = float(np.std(delays)) * np.sqrt(DELAY_BLOCKS - 1)
    return float(np.linalg.lstsq(columns, deflection)[0][1]), spread


def slip_speed(value: Mapping[str, float]) -> float:
    """Return the friction speed of the motor, rad/s or m/s, from its logarithm."""
    return float(np.exp(value['log_slip']))


def fitted(equations: GearEquations) -> GearFit:
    """Return the maximum of the likelihood, with its covariance."""
    x = equations.start()
    bounds = equations.bounds()
    least = np.inf
    for held, rounds in zip(equations.holds, (ROUNDS, 1)):
        equations.held = held
        for _ in range(rounds):
            trial = scientific('scipy.optimize').least_squares(
                equations.weighted, x, x_scale='jac', method='trf', bounds=bounds,
                max_nfev=MOST_EVALUATIONS)
            x = trial.x
            equations.settle(x)
        if trial.cost < least:
            least = trial.cost
            solution = trial
            best = held
    equations.held = best
    residual = solution.fun
    freedom = max(len(residual) - len(solution.x), 1)
    # 1 where the noise explains the residual; what the equations lack adds to it.
    misfit = max(float(residual @ residual) / freedom, 1.0)
    return GearFit(equations.names, solution.x, misfit * covariance_of(solution.jac), misfit)


def covariance_of(jacobian: Array) -> Array:
    """Return the covariance of parameters, large where nothing determines them."""
    scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    values, vectors = np.linalg.eigh((jacobian / scale).T @ (jacobian / scale))
    inverse = 1.0 / np.maximum(values, FLOOR * values[-1])
    return np.asarray((vectors * inverse) @ vectors.T / np.outer(scale, scale))


def parameter_names(signals: JointSignals, skew: float | None) -> tuple[str, ...]:
    """Return the parameters that the equations of a joint have."""
    names = ['compliance', 'eta', 'skew', 'deflection_offset']
    if skew is not None:
        names.remove('skew')
    if signals.link is not None:
        names += ['link_damping', 'link_friction']
    if signals.motor_torque is not None:
        names += ['rotor_inertia', 'motor_damping', 'motor_friction', 'motor_offset',
                  'log_slip', 'torque_delay']
    return tuple(names)


def _whitened(rows: Array, covariance: Array) -> Array:
    """Return equations (e, F) over the root of their covariance (F, e, e), as real numbers."""
    root = np.linalg.cholesky(covariance)
    white = np.linalg.solve(root, rows.T[:, :, None])[:, :, 0].ravel()
    # The variance is shared by real and imaginary part.
    return np.asarray(np.sqrt(2.0) * np.concatenate([white.real, white.imag]))
