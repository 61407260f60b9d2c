"""Optimal excitation: motions within an arm's limits that identify its parameters best."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math

from kane_dynamics._util.checks import instance, integer, number
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.excitation.clearance import clearance_of, DISTANCE
from kane_dynamics.identification.excitation.design_criterion import DesignCriterion
from kane_dynamics.identification.excitation.fourier_basis import FourierBasis
from kane_dynamics.identification.recordings.recording import require_rigid_links
from kane_dynamics.identification.solvers import on_one_processor, scientific
from kane_dynamics.model.link_shapes import LinkShape
from kane_dynamics.model.model import Model
from kane_dynamics.motion.motion import Motion
import numpy as np
from numpy.typing import ArrayLike

PENALTIES = (1e1, 1e2, 1e3, 1e4)  # of squared excesses, one after the other
ITERATIONS = 60  # with each of them
SHRINK = 0.98
SHORTEST = 1e-3  # s, of a motion
LONGEST, MOST_HARMONICS = 1e5, 1000  # s; beyond them memory may not suffice
CENTERS = 50  # of which the search starts from the first that is clear
SMALLEST = 0.05  # amplitude, relative, that is still worth a recording


@dataclass(frozen=True, eq=False)
class Excitation:
    """
    A motion to record an arm with.

    Attributes
    ----------
    joint_names : tuple of str
    basis : FourierBasis
    coefficients : (size, n) array
        As the basis takes them.
    periods : int
        How often the series runs through.
    condition : float
        Condition number of the weighted equations of the base parameters, columns scaled
        to unit length.
    uses : dict of str to (n,) array
        Largest share of each limit: 'position', 'velocity', 'acceleration', 'effort'.
    lowest : (str, float) or None
        The lowest link that the joints raise, and its least height at any time, m; None
        without shapes.
    nearest : (str, str, float) or None
        The links that come nearest to each other, and their least distance, m, as
        capsules.

    """

    joint_names: tuple[str, ...]
    basis: FourierBasis
    coefficients: Array
    periods: int
    condition: float
    uses: dict[str, Array]
    lowest: tuple[str, float] | None = None
    nearest: tuple[str, str, float] | None = None

    def sample(self, t: Array) -> tuple[Array, Array, Array]:
        """Return q, u and udot at times, (N, n) each; rad or m, s."""
        Q, U, A = (matrix @ self.coefficients for matrix in self.basis.at(t))
        return Q, U, A

    def motion(self, rate: float = 100.0) -> Motion:
        """
        Return the motion as quintics through samples, which start and end at rest.

        Parameters
        ----------
        rate : float
            Samples a second, at least.

        """
        duration = self.periods * self.basis.period
        t = np.linspace(0.0, duration, math.ceil(duration * rate - 1e-9) + 1)
        return Motion.from_points(t, *self.sample(t), joint_names=self.joint_names)


@on_one_processor
def excite(model: Model, *, duration: float = 10.0, harmonics: int = 5, periods: int = 1,
           seed: int = 0, starts: int = 2, share: float = 0.9,
           velocity: ArrayLike = math.inf,
           acceleration: ArrayLike = math.inf, floor: float | None = None,
           shapes: Sequence[LinkShape] | None = None,
           distance: float | None = DISTANCE,
           progress: Callable[[float], object] = lambda done: None) -> Excitation:
    """
    Return a rest-to-rest motion that excites the base parameters of a model well.

    The same arguments give the same motion. Each joint's equations count by its effort
    limit, as if noise were in proportion to the size of the motor; alike if there are
    none.

    Parameters
    ----------
    model : Model
        The arm, with limits of position, speed and effort; its masses count for torque
        limits.
    duration : float
        s; of all periods together.
    harmonics : int
        Sines and cosines of each joint, 2 or more; the fastest has harmonics * periods /
        duration Hz.
    periods : int
        How often the same motion repeats, which averages noise.
    seed : int
        Of the motions that the search starts from.
    starts : int
        How many of them; the best end counts.
    share : float
        Of every limit that the motion may use, up to 1.
    velocity, acceleration : float or (n,) array_like
        Further limits, rad/s or m/s, rad/s^2 or m/s^2.
    floor : float, optional
        Height in the world above which links stay, m; without shapes they are rods.
    shapes : sequence of LinkShape, optional
        Boxes, cylinders and spheres of the links, see `shapes.load_collision_shapes`; a
        model has none. Without them links are not kept apart.
    distance : float or None
        Least distance between links, m, as capsules around their shapes; None for none.
        Links that a joint connects and shapes that touch at rest (all coordinates 0, or
        at the nearest limit) are left out; shapes that are near each other at rest keep
        half that distance. Without shapes, None suppresses the warning about them.
    progress : callable
        Called with the share of the work that is done.

    Raises
    ------
    InputError
        An argument is out of range, a joint has no limit of speed, a frame is not known,
        or no motion within the limits was found: names it.

    Warns
    -----
    ModelWarning
        There is a distance, but there are no shapes.

    """
    # Arguments, and what keeps the links above the floor and apart.
    instance(model, Model, 'model')
    require_rigid_links(model)
    duration = number(duration, 'duration', f'from {SHORTEST:g} to {LONGEST:g} s',
                      lambda x: SHORTEST <= x <= LONGEST)
    harmonics = integer(harmonics, 'harmonics', 2, MOST_HARMONICS)
    periods = integer(periods, 'periods', 1)
    starts = integer(starts, 'starts', 1)
    share = number(share, 'share', 'a number above 0, up to 1', lambda x: 0.0 < x <= 1.0)
    rng = np.random.default_rng(integer(seed, 'seed', 0))
    clearance = clearance_of(model, shapes, floor, distance)
    design = DesignCriterion(model, FourierBasis(duration / periods, harmonics), share,
                             velocity, acceleration, clearance)
    # The search has many local minima: it starts several times, and the best end counts.
    # An optimum may exceed the limits slightly, so that it is shrunk until it keeps them.
    motions = []
    for k in range(starts):
        optimum = improved(design, random_motion(design, rng))
        motion, broken = largest_motion(design, optimum)
        if motion is not None:
            motions.append(motion)
        progress((k + 1) / starts)
    if not motions:
        raise InputError(f'motion: none satisfies {broken}; expected more starts, a '
                         'lower share, other limits, or no floor and no distance (None)')
    # The least cost without a penalty: all of these keep the limits.
    best = min(motions, key=lambda p: design.cost(p, 0.0)[0])
    lowest = nearest = None
    if clearance is not None:
        q = design.dense[0] @ best
        lowest = clearance.lowest(q)
        nearest = clearance.nearest(q)
    return Excitation(model.joint_names, design.basis, best, periods,
                      design.condition(best), design.uses(best), lowest, nearest)


def random_motion(design: DesignCriterion, rng: np.random.Generator) -> Array:
    """Return coefficients that reach a limit of speed or acceleration, or half the positions."""
    p = rng.normal(size=(design.basis.size, design.model.n))
    p[0] = 0.0
    # Scale the random motion to the first limit that it meets.
    Q, U, A = (np.abs(matrix @ p).max(axis=0) for matrix in design.grid)
    reach = np.minimum(design.reach, math.pi)
    p *= design.share * np.minimum.reduce([0.5 * reach / Q, design.velocity / U,
                                           design.acceleration / A])
    # Its middle is near that of the ranges; with obstacles, the freest of several.
    centers = design.middle + rng.uniform(-0.3, 0.3, design.model.n) * reach
    if design.clearance is not None:
        some = design.middle + rng.uniform(-0.6, 0.6, (CENTERS, design.model.n)) * reach
        centers = some[int(np.argmin(design.clearance.shortfall(some)))]
    p[0] = centers
    return p


def improved(design: DesignCriterion, p: Array) -> Array:
    """Return the coefficients of a better motion, which may exceed the limits slightly."""
    minimize = scientific('scipy.optimize').minimize
    # Of each coefficient a size by which it counts: a reach, or a speed.
    size = np.vstack([np.minimum(design.reach, math.pi),
                      np.tile(design.velocity, (design.basis.size - 1, 1))])
    for weight in PENALTIES:
        def cost(x: Array, weight: float = weight) -> tuple[float, Array]:
            value, slope = design.cost(x.reshape(size.shape) * size, weight)
            return value, (slope * size).ravel()
        p = minimize(cost, (p / size).ravel(), jac=True, method='L-BFGS-B',
                     options={'maxiter': ITERATIONS}).x.reshape(size.shape) * size
    return p


def largest_motion(design: DesignCriterion, p: Array) -> tuple[Array | None, str | None]:
    """Return the motion of largest amplitude within all limits, or None and the exceeded limit."""
    p, room = p.copy(), 0.9 * design.share * np.minimum(design.reach, math.pi)
    p[0] = np.clip(p[0], design.middle - room, design.middle + room)
    for _ in range(math.ceil(math.log(SMALLEST) / math.log(SHRINK))):
        broken = design.broken(p)
        if broken is None:
            return p, None
        p[1:] *= SHRINK
    return None, broken
