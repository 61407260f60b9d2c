"""
Springs and dampers in a sampled loop: whether an arm on them swings up.

A torque that is computed from the state at t_k acts from t_(k+1) to t_(k+2), one period T
late. With the inertia M of the independent speeds, a spring K and a damper D,

    x_(k+1) = x_k + T v_k + T^2/2 M^-1 F_k
    v_(k+1) = v_k + T M^-1 F_k
    F_(k+1) = -K x_k - D v_k,

and motion grows if an eigenvalue of this map lies outside of the unit circle. Of one mass
without a spring the damper alone has to satisfy d T < m. The springs of elastic joints act
without a delay: the first two rows are then those of the matrix exponential of the arm.
Source: Astrom and Wittenmark, "Computer-Controlled Systems", section 3.2: sampling of
systems with a delay.
"""

from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.robot.robot import Robot
import numpy as np

BISECTIONS = 20
TERMS = 12  # of the series of an exponential whose norm is at most 1/4
# Free motion has double eigenvalues of one, which rounding moves by its square root.
ROUNDING = 1e-6


class JointSpring(NamedTuple):
    """
    Spring and damper of an arm about a state, in its independent speeds.

    Attributes
    ----------
    stiffness, damping : (n, n) arrays
        N m/rad and N m s/rad, or N/m and N s/m.
    by_ratio : bool
        Whether the damper follows from the spring by a damping ratio.

    """

    stiffness: Array
    damping: Array
    by_ratio: bool

    def scaled(self, factor: float) -> 'JointSpring':
        """Return the spring times a factor, with the damper that belongs to it."""
        of_damper = np.sqrt(factor) if self.by_ratio else factor
        return JointSpring(factor * self.stiffness, of_damper * self.damping,
                           self.by_ratio)

    def beside(self, other: 'JointSpring | None') -> 'JointSpring':
        """Return the sum of this spring and another one."""
        if other is None:
            return self
        return JointSpring(self.stiffness + other.stiffness, self.damping + other.damping,
                           self.by_ratio)


def spring_of_joints(robot: Robot, q: Array, stiffness: Array, damping: Array
                     ) -> JointSpring:
    """
    Return the springs and dampers of the joints at q in the independent speeds.

    Parameters
    ----------
    robot : Robot
        Its joint rates are T u.
    q : (n_q,) array
        rad or m.
    stiffness, damping : (n_j,) arrays
        N m/rad or N/m; N m s/rad or N s/m.

    """
    T = np.stack([robot.joint_rates(q, speeds) for speeds in np.eye(robot.n)], axis=1)
    return JointSpring(T.T @ (stiffness[:, None] * T), T.T @ (damping[:, None] * T), False)


class Swing(NamedTuple):
    """
    The motion of a sampled loop that decays least.

    Attributes
    ----------
    growth : float
        Factor of its amplitude in one period; above 1 it swings up.
    joint : int
        The speed with most of its kinetic energy, by its index.

    """

    growth: float
    joint: int

    @property
    def swings_up(self) -> bool:
        """Return whether the motion grows."""
        return self.growth > 1.0 + ROUNDING


def swing(inertia: Array, spring: JointSpring, period: float,
          own: JointSpring | None = None) -> Swing:
    """
    Return the motion of a sampled loop that decays least.

    Parameters
    ----------
    inertia : (n, n) array
        Mass matrix of the independent speeds, kg m^2 or kg.
    spring : JointSpring
        About the state.
    period : float
        Time between two states, by which the torques are late, s.
    own : JointSpring, optional
        Springs and dampers of the arm itself, which act at once.

    """
    # In coordinates y = L^T x with M = L L^T the inertia is one. Without inertia, motion
    # on a spring or damper grows without limit, however short the period is.
    try:
        root = np.linalg.cholesky(inertia)
    except np.linalg.LinAlgError:
        return Swing(np.inf, int(np.argmin(np.diag(inertia))))
    inverse = np.linalg.inv(root)
    n = len(inertia)
    identity = np.eye(n)
    zero = np.zeros((n, n))
    # The rates of position, speed and held acceleration.
    own = own or JointSpring(zero, zero, False)
    rates = np.block([
        [zero, identity, zero],
        [-inverse @ own.stiffness @ inverse.T, -inverse @ own.damping @ inverse.T, identity],
        [zero, zero, zero]])
    # After a period in which the torque is held, the new one follows from its begin.
    step = matrix_exponential(period * rates)
    step[2 * n:] = np.block([-inverse @ spring.stiffness @ inverse.T,
                             -inverse @ spring.damping @ inverse.T, zero])
    # The eigenvalue of largest size decays least; its mode shows which joint swings.
    values, vectors = np.linalg.eig(step)
    largest = int(np.argmax(np.abs(values)))
    amplitudes = np.abs(inverse.T @ vectors[n:2 * n, largest])
    energies = np.diag(inertia) * amplitudes**2
    return Swing(float(np.abs(values[largest])), int(np.argmax(energies)))


def matrix_exponential(matrix: Array) -> Array:
    """Return e^matrix by scaling and squaring of its series."""
    squarings = max(0, 3 + int(np.frexp(np.linalg.norm(matrix, 1))[1]))
    scaled = matrix / 2.0**squarings
    term = np.eye(len(matrix))
    total = term
    for k in range(1, TERMS + 1):
        term = term @ scaled / k
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total


def steady_share(inertia: Array, spring: JointSpring, period: float,
                 other: JointSpring | None = None, own: JointSpring | None = None
                 ) -> float:
    """
    Return the largest factor of a spring, at most 1, whose loop does not swing up.

    Another spring beside it, and the arm's own ones, keep their stiffness.
    """
    if not swing(inertia, spring.beside(other), period, own).swings_up:
        return 1.0
    # Bisection: steady without a spring, growing with the whole one.
    steady = 0.0
    growing = 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (steady + growing)
        scaled = spring.scaled(middle).beside(other)
        if swing(inertia, scaled, period, own).swings_up:
            growing = middle
        else:
            steady = middle
    return steady
