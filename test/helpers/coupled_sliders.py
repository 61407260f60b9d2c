"""
Sliders with friction on a shaken cart, coupled to each other, and their exact motion.

The rates of the sliders are T u with a constant T, so the mass matrix is constant, and
the speeds between two transitions are polynomials of the time. Each transition is found
by trying all signs of motion.
"""

from dataclasses import dataclass
from itertools import combinations, product

from kane_dynamics import ModelBuilder, point_mass, Prescribed, Robot
from kane_dynamics.mechanics.constraints import Coupling
import numpy as np
from scipy.optimize import brentq

TINY = 1e-9
AT_REST = 1e-7  # m/s
LATER = 1e-7  # s after a transition, where accelerations have their signs
GRID = 600  # intervals of a phase in which transitions are looked for
EXACT = {'xtol': 1e-15, 'rtol': 1e-15}


class Ambiguous(Exception):
    """Several motions satisfy the law."""


@dataclass(frozen=True)
class Sliders:
    """
    k sliders of which m move independently: their rates are T u.

    Attributes
    ----------
    T : (k, m) array
    masses, level, breakaway : (k,) arrays
        kg; friction of sliding and at rest, N.
    shaking : (3,) array
        Coefficients of the acceleration of the cart over time, the constant first.
    torque : (m,) array
        Constant forces along the independent speeds, N.

    """

    T: np.ndarray
    masses: np.ndarray
    level: np.ndarray
    breakaway: np.ndarray
    shaking: np.ndarray
    torque: np.ndarray

    def robot(self):
        """Return the robot; its independent speeds are those of the first sliders."""
        k, m = self.T.shape
        a, b, c = self.shaking.tolist()
        builder = ModelBuilder('sliders', gravity=(0, 0, 0))
        builder.body('cart', kind='prismatic', axis=(1, 0, 0), inertial=point_mass(1.0))
        names = [f's{j}' for j in range(k)]
        for j, name in enumerate(names):
            law = {'friction': self.level[j]}
            if self.breakaway[j] > self.level[j]:
                law['breakaway_friction'] = self.breakaway[j]
            builder.body(name, 'cart', 'prismatic', axis=(1, 0, 0),
                         inertial=point_mass(self.masses[j]), **law)
        constraints = [Prescribed('cart', lambda t: t * t * (
            a / 2.0 + t * (b / 6.0 + t * c / 12.0)))]
        for j in range(m, k):
            factors = {names[i]: float(self.T[j, i]) for i in range(m) if self.T[j, i]}
            constraints.append(Coupling(names[j], factors))
        return Robot(builder.model(), constraints=constraints, independent=names[:m])

    def mass(self):
        """Return the mass matrix, (m, m)."""
        return self.T.T @ (self.masses[:, None] * self.T)

    def force(self, t, signs):
        """Return the generalized force without what holds sliders, (m,), N."""
        inertial = -self.masses * np.polyval(self.shaking[::-1], t)
        return self.T.T @ (inertial - self.level * signs) + self.torque

    def admissible(self, held):
        """Return a basis of the speeds at which some sliders rest, (m, d)."""
        _, sizes, rows = np.linalg.svd(self.T[held])
        rank = int((sizes > TINY).sum())
        return rows[rank:].T

    def acceleration(self, t, signs):
        """Return u' where sliders move as `signs` says, and others, 0, rest."""
        N = self.admissible(signs == 0.0)
        return N @ np.linalg.solve(N.T @ self.mass() @ N, N.T @ self.force(t, signs))

    def excess(self, t, signs):
        """Return by how much holding friction exceeds its bounds, relative to them."""
        held = np.flatnonzero(signs == 0.0)
        if not len(held):
            return -1.0
        lacking = self.force(t, signs) - self.mass() @ self.acceleration(t, signs)
        return least_largest(self.T[held].T * self.breakaway[held], lacking) - 1.0

    def patterns(self, t, rates):
        """Return the signs of motion just after a time that satisfy the law."""
        moving = np.sign(rates) * (np.abs(rates) > AT_REST)
        choices = []
        for s in moving:
            choices.append([s] if s else [0.0, 1.0, -1.0])
        solutions = []
        for choice in product(*choices):
            signs = np.array(choice)
            a = self.T @ self.acceleration(t, signs)
            begins = (moving == 0.0) & (signs != 0.0)
            if (a[begins] * signs[begins] > TINY).all() and self.excess(
                    t, signs) <= TINY:
                solutions.append(signs)
        # A joint rests where it can: no other solution has fewer joints that move.
        return [signs for signs in solutions
                if not any(rests_more(rival, signs) for rival in solutions)]

    def signs_after(self, t, u):
        """Return the signs of motion after a time, if one solution satisfies the law."""
        possible = self.patterns(t + LATER, self.T @ u)
        if len(possible) != 1:
            raise Ambiguous(f'{len(possible)} motions at {t} s: {possible}')
        return possible[0]


def rests_more(signs, others):
    """Return whether signs are those of others but for joints that rest."""
    same = (signs == 0.0) | (signs == others)
    return bool(same.all() and (signs != others).any())


def least_largest(G, force):
    """Return the least value over x with G x = force of the largest |x|."""
    start = np.linalg.pinv(G) @ force
    _, sizes, rows = np.linalg.svd(G)
    rank = int((sizes > TINY * max(sizes.max(), 1e-300)).sum())
    free = rows[rank:].T
    d = free.shape[1]
    best = np.abs(start).max()
    # At the optimum d + 1 entries have the largest size r, with some signs s:
    # start + free z = s r in these entries.
    for entries in combinations(range(len(start)), d + 1):
        for signs in product((-1.0, 1.0), repeat=d + 1):
            matrix = np.column_stack([free[list(entries)], -np.array(signs)])
            if abs(np.linalg.det(matrix)) > 1e-12:
                z = np.linalg.solve(matrix, -start[list(entries)])[:-1]
                best = min(best, np.abs(start + free @ z).max())
    return best


@dataclass(frozen=True)
class Phase:
    """
    A motion between two transitions: u' = a + b s + c s^2, s after its beginning.

    Attributes
    ----------
    start : float
        s.
    u, q : (m,) arrays
    signs : (k,) array
        Directions of motion; 0 of sliders at rest.
    coefficients : (3, m) array

    """

    start: float
    u: np.ndarray
    q: np.ndarray
    signs: np.ndarray
    coefficients: np.ndarray

    def speeds(self, s):
        """Return u, s after the beginning."""
        a, b, c = self.coefficients
        return self.u + s * (a + s * (b / 2.0 + s * c / 3.0))

    def positions(self, s):
        """Return q, s after the beginning."""
        a, b, c = self.coefficients
        return self.q + s * (self.u + s * (a / 2.0 + s * (b / 6.0 + s * c / 12.0)))


def exact_motion(sliders, u, duration):
    """Return the phases of the motion from q = 0; Ambiguous if there are several."""
    t = 0.0
    q = np.zeros_like(u)
    phases = []
    while t < duration:
        signs = sliders.signs_after(t, u)
        samples = np.array([0.0, 0.5, 1.0])
        values = [sliders.acceleration(t + s, signs) for s in samples]
        coefficients = np.linalg.solve(np.vander(samples, increasing=True), values)
        phase = Phase(t, u, q, signs, coefficients)
        phases.append(phase)
        length = phase_length(sliders, phase, duration - t)
        q = phase.positions(length)
        u = phase.speeds(length)
        t += length
        # Sliders that stopped rest exactly.
        N = sliders.admissible(np.abs(sliders.T @ u) <= AT_REST)
        u = N @ (N.T @ u)
    return phases


def phase_length(sliders, phase, left):
    """Return the time from the beginning of a phase to the next transition, s."""
    grid = np.linspace(0.0, left, GRID + 1)[1:]
    length = left
    # Sliders reverse where their rates along the motion, which first grow from rest,
    # end.
    for j in np.flatnonzero(phase.signs):
        def ahead(s, j=j):
            return phase.signs[j] * (sliders.T @ phase.speeds(s))[j]
        past = np.flatnonzero([ahead(s) < 0.0 for s in grid])
        if len(past):
            low = grid[past[0] - 1] if past[0] else 0.5 * grid[0]
            length = min(length, brentq(ahead, low, grid[past[0]], **EXACT))

    # Sliders at rest break away where no forces hold them.
    def excess(s):
        return sliders.excess(phase.start + s, phase.signs)
    low = 0.0
    for s in [*grid[grid < length], length]:
        if excess(s) > 0.0:
            if low == 0.0 and excess(0.0) >= -1e-13:
                raise Ambiguous('friction at its bound at the beginning of a phase')
            return brentq(excess, low, s, **EXACT)
        low = s
    return length


def state_at(phases, t):
    """Return q and u at a time."""
    phase = [phase for phase in phases if phase.start <= t][-1]
    return phase.positions(t - phase.start), phase.speeds(t - phase.start)


def random_sliders(seed):
    """Return random sliders, two to four, most of them with a drop of friction."""
    rng = np.random.default_rng(seed)
    k = rng.integers(2, 5)
    m = rng.integers(1, k)
    T = np.vstack([np.eye(m), rng.uniform(-2.0, 2.0, (k - m, m))])
    if m > 1:
        T[m:][rng.uniform(size=(k - m, m)) < 0.3] = 0.0
        T[m:, 0] = np.where((T[m:] == 0.0).all(axis=1), 1.0, T[m:, 0])
    level = rng.uniform(0.3, 2.0, k)
    if rng.uniform() < 0.2:  # equal joints, which reach their bounds together
        level[:] = 1.0
        T = np.sign(T)
    drop = np.where(rng.uniform(size=k) < 0.8, rng.uniform(0.1, 3.0, k), 0.0)
    scale = rng.uniform(2.0, 12.0) * rng.choice([-1.0, 1.0])
    return Sliders(T, rng.uniform(0.3, 3.0, k), level, level + drop,
                   scale * np.array([0.0, 1.0, -0.5]), np.zeros(m))
