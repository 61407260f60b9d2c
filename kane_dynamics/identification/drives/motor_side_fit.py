"""
Stiffness, damping and rotor inertia from motor positions and torques alone.

The links are driven by the measured motion of the motors, and simulated with their own
equations of motion from an initial state that belongs to the unknowns:

    M q'' + h(q, q') + friction(q') + offset = K (theta - q) + D (theta' - q')

The torque of the springs then enters the equation of the motors,

    tau_m = B theta'' + K (theta - q) + D (theta' - q') + friction(theta') + offset,

whose spectra are compared; tau_m acts later than it is recorded, by a time to be found.
Below the resonance the motor feels M + B whatever the stiffness is; above it, B. Only
frequencies near the resonance determine K and D.

Noise of theta is seen through the drive and the links. Its part of the residual is that
of the equations linearized about the mean configuration.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.identification.drives.driven_links import DrivenLinks
from kane_dynamics.identification.drives.gear_fit import (coulomb_slope, covariance_of,
                                                          FIRST_SLIP, GearFit,
                                                          mean_coulomb, ROUNDS)
from kane_dynamics.identification.drives.spectra import SmoothSpeed, Spectra
from kane_dynamics.identification.solvers import scientific
from kane_dynamics.loop_tracking.loop_error import LoopError
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.mechanics.integrators.runge_kutta import runge_kutta_4
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
import numpy as np

# Of the simulated links.
SPRING = 'compliance', 'eta', 'link_damping', 'link_friction', 'link_offset'
START = ('q', 'u')  # initial state of the links
LINEAR = ('rotor_inertia', 'motor_damping', 'motor_friction', 'motor_offset')
NAMES = (*SPRING, *START, *LINEAR, 'torque_delay')
FREQUENCIES = np.geomspace(2.0, 60.0, 24)  # Hz, tried for each joint at first
FIRST_DAMPING = 0.02  # damping ratio
SWEEPS = 2  # over all joints
MOST_EVALUATIONS = 40
LARGEST_TORQUE = 1e9  # N m or N, of a simulation that diverges


class MotorSignals(NamedTuple):
    """
    Signals of all motors.

    Attributes
    ----------
    t : (N,) array
    theta, motor_torque : (N, n) arrays
    speeds : list of n SmoothSpeed
    noise : dict of str to (n,) array

    """

    t: Array
    theta: Array
    motor_torque: Array
    speeds: list[SmoothSpeed]
    noise: dict[str, Array]


class MotorSideFit(NamedTuple):
    """Values by name, (n,) each, their covariance, and the mean square of the residuals."""

    values: dict[str, Array]
    covariance: Array
    misfit: float

    def of_joint(self, joint: int) -> GearFit:
        """Return the values of one joint with their covariance."""
        count = len(self.values['compliance'])
        places = joint + count * np.arange(len(NAMES))
        values = np.array([of_joints[joint] for of_joints in self.values.values()])
        return GearFit(NAMES, values, self.covariance[np.ix_(places, places)], self.misfit)


class MotorEquations:
    """The equations of all motors, with the links simulated."""

    def __init__(self, links: DrivenLinks, signals: MotorSignals, of: Spectra) -> None:
        self._links = links
        self._robot = links.robot
        self._signals = signals
        self._of = of
        n = self._robot.n
        mean = signals.theta.mean(axis=0)
        self.inertia = self._robot.mass_matrix(links.closed(mean[None])[0])
        self._gravity_slope = _gravity_slope(links, mean)
        self._driven = list(map(self._robot.coordinate_names.index, links.joint_names))
        self._kernel = _link_step(self._robot, self._driven, signals.t[1] - signals.t[0])
        # The motion of the motors, of which the links are simulated.
        spline = scientific('scipy.interpolate').CubicSpline(signals.t, signals.theta)
        self._motors = _motors_of_steps(spline, signals.t)
        self._rate = spline(signals.t, 1)
        # The torque of each motor is linear in its inertia, viscous and Coulomb friction
        # and offset, beside the torque of its gear.
        self._motor = [of.delayed(torque) for torque in signals.motor_torque.T]
        self._columns = _linear_columns(signals, of)
        self.varying = np.zeros(n)  # motor friction whose noise counts, see `gear_fit`
        self.holds = 0.0, of.step  # as in `gear_fit`
        self.held = 0.0
        self._slopes = [coulomb_slope(speed.values, FIRST_SLIP)
                        for speed in signals.speeds]

    def gear_torque(self, spring: Array, start: Array) -> Array:
        """Return the torque of the springs along the motion, (N, n)."""
        n_q = self._robot.n_q
        stiffness = 1.0 / spring[0]
        values = np.ascontiguousarray(np.array([stiffness, spring[1] * stiffness,
                                                *spring[2:]]))
        states = np.empty((len(self._signals.t), n_q + self._robot.n))
        try:
            states[0, :n_q] = self._links.closed(start[:1])[0]
        except LoopError:  # a start beyond the reach of the loops fits nothing
            return np.full_like(self._signals.theta, LARGEST_TORQUE)
        states[0, n_q:] = start[1]
        self._kernel.scan([states[:-1], self._motors, values], states[1:])
        deflection = self._signals.theta - states[:, self._driven]
        torque = stiffness * deflection + values[1] * (self._rate - states[:, n_q:])
        # A simulation that diverges fits nothing; its residual stays a number.
        return np.asarray(np.nan_to_num(np.clip(torque, -LARGEST_TORQUE, LARGEST_TORQUE)))

    def weighted(self, x: Array) -> Array:
        """Return the residuals over their standard deviations, real, (R,)."""
        rows = x.reshape(len(NAMES), -1)
        spring, start, linear = rows[:5], rows[5:7], rows[7:11]
        # A constant torque on a link is one on the motor, but for the place of the link.
        gear = self._spectra(self.gear_torque(spring, start) - spring[4])
        delays = rows[11]
        motor = np.array([torque.by(delay, self.held)
                          for torque, delay in zip(self._motor, delays)])
        missing = motor - gear - np.einsum('kj,kjf->jf', linear, self._columns)
        return self._whitened(missing, spring, linear).ravel()

    def start(self) -> Array:
        """Return parameters to start from: stiffnesses of a grid, joint by joint."""
        n = self._robot.n
        own_inertia = np.diag(self.inertia)
        x = np.zeros((len(NAMES), n))
        # Springs that vibrate at 15 Hz with the link's own inertia.
        x[0] = 1.0 / (own_inertia * (2.0 * np.pi * 15.0)**2)
        for _ in range(SWEEPS):
            for j in range(n):
                costs = []
                trials = []
                # The cost has many minima along the frequency: a grid finds the deepest
                # one.
                for frequency in FREQUENCIES:
                    trial = x.copy()
                    omega = 2.0 * np.pi * frequency
                    trial[0, j] = 1.0 / (own_inertia[j] * omega**2)
                    trial[1, j] = 2.0 * FIRST_DAMPING / omega
                    trial = self._with_linear(trial)
                    residual = self.weighted(trial.ravel())
                    trials.append(trial)
                    costs.append(float(residual @ residual))
                x = trials[int(np.argmin(costs))]
        return x.ravel()

    def _with_linear(self, x: Array) -> Array:
        """Return parameters with the static start and the motors that fit a simulation best."""
        x = x.copy()
        # At rest the springs carry the weight.
        first = self._links.closed(self._signals.theta[:1])[0]
        weight = self._robot.gravity_force(first)
        x[5] = self._signals.theta[0] - x[0] * weight
        x[6] = self._rate[0]
        gear = self._spectra(self.gear_torque(x[:5], x[5:7]))
        # Inertia and friction of each motor are linear in what the gear leaves
        # unexplained.
        for j in range(self._robot.n):
            columns = self._columns[:, j].T
            missing = self._motor[j].windowed - gear[j]
            A = np.concatenate([columns.real, columns.imag])
            scale = np.linalg.norm(A, axis=0)
            right = np.concatenate([missing.real, missing.imag])
            x[7:11, j] = np.linalg.lstsq(A / scale, right)[0] / scale
        return x

    def _spectra(self, values: Array) -> Array:
        """Return the spectra of the columns of values (N, n), (n, F)."""
        return np.array([self._of.of(column) for column in values.T])

    def _whitened(self, missing: Array, spring: Array, linear: Array) -> Array:
        """Return the residuals, (n, F), over the root of their covariance, real."""
        omega = self._of.omega[:, None, None]
        n = len(missing)
        # How noise of the motor's position passes the springs and the links into the
        # equation.
        elastic = np.eye(n) * (1.0 + 1j * omega * spring[1]) / spring[0]
        # The mean slope of friction, and the noise that its variation makes.
        slope = np.array([of_motor.mean for of_motor in self._slopes])
        densities = np.array([speed.density for speed in self._signals.speeds])
        spread = np.array([of_motor.spread for of_motor in self._slopes]) * densities
        of_links = (self._gravity_slope + elastic - omega**2 * self.inertia
                    + 1j * omega * np.diag(spring[2]))
        followed = np.linalg.solve(of_links, elastic)
        seen = (elastic - elastic @ followed - omega**2 * np.diag(linear[0])
                + 1j * omega * np.diag(linear[1] + linear[2] * slope))
        noise = self._signals.noise
        covariance = (seen * noise['theta']**2) @ seen.conj().transpose(0, 2, 1)
        of_friction = self.varying**2 * spread
        covariance = covariance + np.diag(noise['motor_torque']**2 + of_friction)
        covariance = self._of.gain * covariance
        # L^-1 r of the covariance L L^T has independent entries of variance 1.
        root = np.linalg.cholesky(covariance)
        white = np.linalg.solve(root, missing.T[:, :, None])[:, :, 0].ravel()
        return np.asarray(np.sqrt(2.0) * np.concatenate([white.real, white.imag]))


def motor_side_fit(equations: MotorEquations) -> MotorSideFit:
    """Return the maximum of the likelihood, with its covariance."""
    lowest = np.full((len(NAMES), len(equations.inertia)), -np.inf)
    lowest[0] = 1e-12
    x = equations.start()
    least = np.inf
    for held, rounds in zip(equations.holds, (ROUNDS, 1), strict=True):
        equations.held = held
        for _ in range(rounds):
            # The covariance depends on the friction: it is fixed during a fit, then
            # computed again.
            friction = x.reshape(len(NAMES), -1)[NAMES.index('motor_friction')]
            equations.varying = friction
            trial = scientific('scipy.optimize').least_squares(
                equations.weighted, x, bounds=(lowest.ravel(), np.inf), x_scale='jac',
                max_nfev=MOST_EVALUATIONS)
            x = trial.x
        if trial.cost < least:
            least = trial.cost
            solution = trial
    residual = solution.fun
    # The deviations grow where residuals are larger than the noise.
    freedom = max(len(residual) - len(solution.x), 1)
    misfit = max(float(residual @ residual) / freedom, 1.0)
    values = dict(zip(NAMES, solution.x.reshape(len(NAMES), -1), strict=True))
    return MotorSideFit(values, misfit * covariance_of(solution.jac), misfit)


def _link_step(robot: Robot, driven: Sequence[int], step: float) -> Kernel:
    """Return the kernel of one step of the links, driven by their motors."""
    n, n_q = robot.n, robot.n_q

    def driven_links(state: Any, motors: Any, values: Any, parameters: Any) -> Any:
        stiffness, damping, link_damping, link_friction, link_offset = values
        equations = robot.equations

        def rates(x: Any, motor: Any) -> Any:
            # Spring and damper of the drive, less the friction of the link's side.
            q = x[:n_q]
            u = x[n_q:]
            torque = (stiffness * (motor[0] - q[driven]) + damping * (motor[1] - u)
                      - link_damping * u - link_friction * coulomb(u, FIRST_SLIP)
                      - link_offset)
            return equations.state_rates(q, u, torque, None, parameters)

        # The motors' motion is recorded; the links follow it by the equations of
        # motion.
        after = runge_kutta_4(rates, state, motors, step)
        after[:n_q] = equations.closure_step(after[:n_q])
        return after

    return robot.compiled(driven_links, name='driven_links', state=(n_q + n,),
                          motors=(3, 2, n), values=(len(SPRING), n), shape=(n_q + n,))


def _motors_of_steps(spline: Callable[..., Array], t: Array) -> Array:
    """Return positions and speeds of the motors in each step, (N - 1, 3, 2, n)."""
    middle = 0.5 * (t[:-1] + t[1:])
    parts = []
    for times in (t[:-1], middle, t[1:]):  # its beginning, middle and end
        parts.append(np.stack([spline(times), spline(times, 1)], axis=1))
    return np.ascontiguousarray(np.stack(parts, axis=1))


def _linear_columns(signals: MotorSignals, of: Spectra) -> Array:
    """Return the spectra of what the motor torques are linear in, (4, n, F)."""
    columns: list[list[Array]] = [[], [], [], []]
    constant = of.of(np.ones(len(signals.t)))
    for theta, speed in zip(signals.theta.T, signals.speeds, strict=True):
        columns[0].append(of.acceleration_of(theta))
        columns[1].append(of.rate_of(theta))
        columns[2].append(of.of_means(mean_coulomb(speed.values, FIRST_SLIP, speed.noise)))
        columns[3].append(constant)
    return np.array(columns)


def _gravity_slope(links: DrivenLinks, q: Array) -> Array:
    """Return the derivative of the gravity force by the driven positions, (n, n)."""
    change = 1e-5 * np.eye(len(q))
    robot = links.robot
    ahead = robot.gravity_force(links.closed(q + change))
    behind = robot.gravity_force(links.closed(q - change))
    return np.asarray((ahead - behind).T / 2e-5)
