"""
Calibrate gravity, torque scales and offsets by held poses.

At rest the torque of joint j is linear in masses and first moments phi of the bodies. With
the effort c_j that the arm reports per unit of torque, an offset o_j, and friction m_j in
the direction d_j of the approach:

    effort_j = c_j (Y_j(q) phi + load_j(q)) + o_j + m_j d_j + error

Errors are those of the effort, among them friction that is not m_j d_j. The equations are
bilinear in c and phi; Gauss-Newton steps solve them, each with physically consistent
bodies (`physical_consistency`). Only a known load separates c from phi.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

from kane_dynamics._util.checks import instance
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError
from kane_dynamics.identification.base_regressor import combinations, unknown_names
from kane_dynamics.identification.physical_consistency import (physical,
                                                               prior_metric,
                                                               prior_parameters)
from kane_dynamics.identification.poses.held_poses import HeldPoses
from kane_dynamics.identification.recordings.recording import (Recording,
                                                               require_rigid_links)
from kane_dynamics.identification.regression import rms, rows, triangle
from kane_dynamics.identification.solvers import on_one_processor
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.recursive.regressor import pseudo_inertia_of
from kane_dynamics.model.elastic_model import require_rigid_joints
from kane_dynamics.model.model import Inertial, Model, with_payload
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import NDArray

WEIGHTS = 1e-4, 1e-2, 1.0, 100.0  # of the prior on the bodies
SCALE_PRIOR = 0.5  # standard deviation of effort per torque, relative to its start
OFFSET_PRIOR = 0.3  # standard deviation of an offset, of the largest effort
FOLDS = 5  # of poses that take turns in being left out
STEPS, CONVERGED = 30, 1e-6  # of Gauss-Newton; largest relative change at the end
ROUNDS = 3  # of reweighting
SAME = 0.02  # rad or m: poses that differ less are one, approached twice
TOLD = 0.1  # largest relative deviation of a scale that the poses determine
LEAST_TORQUE = 1e-3  # of the largest gravity torque: a joint with less sees no gravity
FAINT = 1e-6  # weight of a prior that only makes equations regular
STATES = 200  # random configurations by which combinations of parameters are found
FEWEST = 4  # poses
LEAST_FACTOR = 1e-3  # of all masses
LEAST_LOAD = 0.02  # of the torque of a joint: less tells nothing of its scale
LIKE = 0.5  # least correlation of efforts with the gravity of the model
CANDIDATES = 300  # random configurations among which further poses are chosen


@dataclass(frozen=True, eq=False)
class PoseCalibration:
    """
    Gravity, scales and offsets by held poses; joints are in the order of the model.

    Attributes
    ----------
    given, model : Model
        The initial and the calibrated model.
    scale : (n,) array
        Torque per reported effort, N m or N; negative where the effort has the opposite
        sign.
    scale_deviation : (n,) array
        Standard deviation, relative to the scale. Infinite where the poses and the load
        do not determine it: such scales and the masses cannot be told apart.
    offset, offset_deviation : (n,) arrays
        Effort that is reported without torque, in units of the efforts.
    friction : (n, 2) array
        Interval of the friction that holds the arm at rest, N m or N: the one that the
        approaches show, or else the root mean square of what is left of the torques; and
        the largest one that is left. Friction is between minus and plus the latter.
    parameters : tuple of str
        Combinations of masses (kg) and first moments (kg m) that the joints can see.
    values, deviations : (b,) arrays
        Of these combinations. Infinite deviations belong to scales that are not known.
    before, held_out : (n,) arrays
        RMS of the torque error, N m or N: of the given model with efforts as they are;
        and of poses that were left out of the fit, in the calibrated scale.
    sees_gravity : (n,) array of bool
        Whether gravity loads the joint in any of the poses.
    further_poses : (k, n) array
        Configurations within the limits that would reduce the deviations most, rad or m.

    """

    given: Model
    model: Model
    scale: Array
    scale_deviation: Array
    offset: Array
    offset_deviation: Array
    friction: Array
    parameters: tuple[str, ...]
    values: Array
    deviations: Array
    before: Array
    held_out: Array
    sees_gravity: Flags
    further_poses: Array

    @lazy_property
    def not_told_apart(self) -> tuple[str, ...]:
        """Return the joints whose scale cannot be told apart from the masses."""
        unknown = self.sees_gravity & ~np.isfinite(self.scale_deviation)
        return tuple(np.array(self.model.joint_names)[unknown].tolist())


class _Equations(NamedTuple):
    """Static equations of all poses, empty ones first: k poses of n joints."""

    effort: Array  # (k, n)
    Y: Array  # (k, n, 10 bodies)
    known: Array  # (k, n): torque of springs and the load, N m or N
    approach: Array  # (k, n)
    places: Array  # (k,): number of the pose, the same for one that is held twice

    def part(self, chosen: Flags) -> '_Equations':
        """Return the equations of some poses."""
        return _Equations(*(field[chosen] for field in self))

    def torque(self, phi: Array) -> Array:
        """Return the torque that holds the arm, (k, n), N m or N."""
        return np.asarray(self.Y @ phi + self.known)


class _Unknowns(NamedTuple):
    """The unknowns of the equations."""

    phi: Array  # (10 bodies,)
    ratio: Array  # (n,): effort per torque
    offset: Array  # (n,)
    friction: Array  # (n,): effort that the approach leaves

    def effort(self, equations: _Equations) -> Array:
        """Return the effort of the poses, (k, n)."""
        return np.asarray(self.ratio * equations.torque(self.phi) + self.offset
                          + self.friction * equations.approach)


@on_one_processor
def calibrate_poses(model: Model, poses: HeldPoses, *, loaded: HeldPoses | None = None,
                    load: tuple[str, Inertial] | None = None, further: int = 5
                    ) -> PoseCalibration:
    """
    Return gravity, torque scales and offsets of an arm by poses in which it is held.

    Without a load the scales of all joints together cannot be told apart from the masses:
    the result is then the one with masses nearest to those of the model, and
    `not_told_apart` names the joints. The torques that hold the arm are right
    nevertheless, in units of the efforts.

    Parameters
    ----------
    model : Model
        Tree of rigid links and joints. Its inertials are the prior of what the poses do
        not determine.
    poses : HeldPoses
        Poses of the arm as the model describes it; best approached from both sides.
    loaded : HeldPoses, optional
        Poses with the load.
    load : (str, Inertial), optional
        The known load: its frame, and its inertial in the axes of this frame.
    further : int
        Number of `further_poses`.

    Raises
    ------
    InputError
        Poses have other joints or are too few, or a load comes without its poses.

    """
    instance(model, Model, 'model')
    require_angles(model, 'held poses')
    require_rigid_joints(model)
    require_rigid_links(model)
    if (loaded is None) != (load is None):
        raise InputError('loaded: expected together with load, the frame and the inertial '
                         'of what the arm carries in these poses')
    equations = _equations(model, poses, None)
    if loaded is not None:
        of_loaded = _equations(model, loaded, load)
        equations = _Equations(*map(np.concatenate, zip(equations, of_loaded)))
    equations = equations._replace(places=_places(
        np.concatenate([poses.q, loaded.q]) if loaded is not None else poses.q))
    fit = _Fit(model, equations)

    # The weight of the prior that predicts left-out poses best.
    errors = [fit.left_out(weight) for weight in WEIGHTS]
    best = int(np.argmin([np.sum((error / fit.size)**2) for error in errors]))
    unknowns, sigma = fit.solve(equations, WEIGHTS[best])
    scale = 1.0 / unknowns.ratio
    bodies = len(unknowns.phi)
    ratios = np.arange(bodies, bodies + model.n)
    told = fit.covariance(equations, unknowns, sigma, FAINT, ratios[:0])
    deviation = np.sqrt(np.diag(told))[ratios] / np.abs(unknowns.ratio)
    determined = deviation < TOLD

    # Deviations of masses and offsets: scales that are not determined count as known.
    known = ratios[~determined]
    covariance = fit.covariance(equations, unknowns, sigma, WEIGHTS[best], known)
    names, B = _gravity_parameters(model)
    of_bodies = covariance[:bodies, :bodies]
    candidates = Robot(model).random_configuration(0, CANDIDATES)
    further_q = _most_informative(_equations_at(model, candidates), unknowns, sigma,
                                  covariance, candidates, further)
    return PoseCalibration(
        model, _with_inertials(model, unknowns.phi), scale,
        np.where(determined, deviation, np.inf), unknowns.offset,
        np.sqrt(np.diag(covariance))[bodies + model.n:bodies + 2 * model.n],
        _friction(equations, unknowns), names, B @ unknowns.phi,
        np.sqrt(np.einsum('bi,ij,bj->b', B, of_bodies, B)),
        rms(equations.effort - equations.torque(fit.of_model)), errors[best] * np.abs(scale),
        fit.sees_gravity, further_q)


def _friction(equations: _Equations, x: _Unknowns) -> Array:
    """Return the interval of friction at rest, (n, 2), N m or N."""
    left = (equations.effort - x.effort(equations)) / x.ratio
    of_approach = x.friction / x.ratio
    both = left + of_approach * equations.approach
    least = np.where(of_approach > 0.0, of_approach, rms(left))
    return np.column_stack([least, np.abs(both).max(axis=0)])


def _equations(model: Model, poses: HeldPoses,
               load: tuple[str, Inertial] | None) -> _Equations:
    """Return the equations of poses, with the torque of a load."""
    instance(poses, HeldPoses, 'poses')
    if poses.q.shape[1] != model.n:
        raise InputError(f'poses: {poses.q.shape[1]} joints; expected {model.n}: '
                         f'{", ".join(model.joint_names)}')
    Y, known = _static(model, poses.q)
    if load is not None:
        frame, inertial = load
        carrying = Robot(with_payload(model, frame, inertial), friction=False)
        empty = Robot(model, friction=False)
        known = known + carrying.gravity_force(poses.q) - empty.gravity_force(poses.q)
    return _Equations(poses.effort, Y, known, poses.approach, np.zeros(len(poses)))


def _equations_at(model: Model, q: Array) -> _Equations:
    """Return the equations of configurations, with the efforts that the model expects."""
    Y, known = _static(model, q)
    masses = np.concatenate([prior_parameters(body.inertial) for body in model.bodies])
    return _Equations(Y @ masses + known, Y, known, np.zeros_like(q),
                      np.arange(float(len(q))))


def _static(model: Model, q: Array) -> tuple[Array, Array]:
    """Return the regressor of gravity, (k, n, 10 bodies), and the torque of springs, (k, n)."""
    rest = np.zeros_like(q)
    at_rest = Recording(np.arange(float(len(q))), q, rest, rest, rest)
    data = rows(model, at_rest)
    return data.Y, data.rest


def _places(q: Array) -> Array:
    """Return a number for each pose, (k,); poses that differ little have the same one."""
    places = np.arange(len(q))
    for k in range(len(q)):
        near = np.flatnonzero(np.abs(q[:k] - q[k]).max(axis=1) < SAME)
        if len(near):
            places[k] = places[near[0]]
    return np.asarray(np.unique(places, return_inverse=True)[1], dtype=float)


class _Fit:
    """
    The bilinear least squares of held poses.

    Parameters
    ----------
    model : Model
    equations : _Equations
        Of all poses.

    """

    def __init__(self, model: Model, equations: _Equations) -> None:
        if len(np.unique(equations.places)) < FEWEST:
            raise InputError(f'poses: {len(np.unique(equations.places))} different ones; '
                             f'expected at least {FEWEST}')
        self.given = equations
        self.inertials = [body.inertial for body in model.bodies]
        self.prior = self.of_model = self._prior()
        self.size = np.maximum(rms(equations.effort - equations.effort.mean(axis=0)), 1e-9)
        # Gravity on a joint, whatever the masses: by the model and by the regressor.
        moment = np.abs(equations.torque(self.prior)).max(axis=0)
        self.sees_gravity: Flags = moment > LEAST_TORQUE * moment.max()
        # Densities may be wrong by orders of magnitude: a known load tells by which factor.
        self.ratio = self._start(equations)
        if np.ptp(equations.known, axis=0).any():
            factor = self._mass_factor(equations)
            self.inertials = [Inertial(factor * x.mass, x.com, factor * x.inertia)
                              for x in self.inertials]
            self.prior = self._prior()

    def _prior(self) -> Array:
        """Return the parameters of the prior, (10 bodies,)."""
        return np.concatenate([prior_parameters(inertial) for inertial in self.inertials])

    def _mass_factor(self, equations: _Equations) -> float:
        """Return the factor of all masses that fits the efforts best."""
        weight = (equations.Y @ self.prior)[:, self.sees_gravity]
        left = (equations.effort / self.ratio - equations.known)[:, self.sees_gravity]
        left = left - left.mean(axis=0)
        slope = float(np.sum((weight - weight.mean(axis=0)) * left) / np.sum(
            (weight - weight.mean(axis=0))**2))
        return max(slope, LEAST_FACTOR)

    def solve(self, equations: _Equations, weight: float) -> tuple[_Unknowns, Array]:
        """Return the unknowns, and the deviation of each joint's error in effort, (n,)."""
        n = equations.effort.shape[1]
        x = _Unknowns(self.prior, self.ratio, np.zeros(n), np.zeros(n))
        sigma = 0.1 * self.size
        for _ in range(ROUNDS):
            for _ in range(STEPS):
                previous = x
                x = self._step(equations, x, sigma, weight)
                change = np.abs(x.effort(equations) - previous.effort(equations))
                if (change < CONVERGED * self.size).all():
                    break
            left = equations.effort - x.effort(equations)
            sigma = np.maximum(rms(left), 1e-4 * self.size)
        return x, sigma

    def _start(self, equations: _Equations) -> Array:
        """
        Return the effort per torque by which Gauss-Newton begins, (n,).

        A known load determines it. Without one it is that with the masses of the model; a
        joint whose efforts are not like those of the model has the usual one of the others.
        """
        n = equations.effort.shape[1]
        ratio = np.zeros(n)
        torque = equations.torque(self.prior)
        for j in np.flatnonzero(self.sees_gravity):
            load = equations.known[:, j]
            effort = equations.effort[:, j]
            if np.ptp(load) > LEAST_LOAD * np.ptp(torque[:, j]):
                ratio[j] = _own_ratio(equations.Y[:, j], load, equations.approach[:, j],
                                      effort)
            elif abs(np.corrcoef(torque[:, j], effort)[0, 1]) > LIKE:
                ratio[j] = np.polyfit(torque[:, j], effort, 1)[0]
        found = np.abs(ratio[ratio != 0.0])
        ratio[ratio == 0.0] = np.median(found) if len(found) else 1.0
        return ratio

    def _step(self, equations: _Equations, x: _Unknowns, sigma: Array,
              weight: float) -> _Unknowns:
        """Return the unknowns after a step of Gauss-Newton."""
        A, b = _linear_equations(equations, x, sigma)
        prior, target = self._priors()
        n = len(sigma)
        solution = physical(np.vstack([A, prior]), np.concatenate([b, target]),
                            self.inertials, np.full(3 * n, -np.inf), weight)
        bodies = len(x.phi)
        return _Unknowns(solution[:bodies], *solution[bodies:].reshape(3, n))

    def _priors(self) -> tuple[Array, Array]:
        """Return the equations of the priors on ratios, offsets and friction."""
        n = len(self.ratio)
        largest = np.maximum(np.abs(self.given.effort).max(axis=0), 1e-9)
        deviation = np.concatenate([SCALE_PRIOR * np.abs(self.ratio),
                                    OFFSET_PRIOR * largest, largest])
        A = np.hstack([np.zeros((3 * n, len(self.prior))), np.diag(1.0 / deviation)])
        return A, np.concatenate([self.ratio, np.zeros(2 * n)]) / deviation

    def left_out(self, weight: float) -> Array:
        """Return the RMS error in effort of poses that the fit leaves out, (n,)."""
        equations = self.given
        errors = np.zeros_like(equations.effort)
        folds = equations.places % FOLDS
        for fold in range(FOLDS):
            out = folds == fold
            x, _ = self.solve(equations.part(~out), weight)
            left = equations.part(out)
            errors[out] = left.effort - x.effort(left)
        return rms(errors)

    def covariance(self, equations: _Equations, x: _Unknowns, sigma: Array, weight: float,
                   known: NDArray[np.intp]) -> Array:
        """Return the covariance of all unknowns, of which some count as known."""
        A, _ = _linear_equations(equations, x, sigma)
        prior, _ = self._priors()
        near = np.zeros((len(x.phi), A.shape[1]))
        for k, inertial in enumerate(self.inertials):
            block = slice(10 * k, 10 * k + 10)
            near[block, block] = np.linalg.cholesky(weight * prior_metric(inertial)).T
        # Columns of equal length: data and prior differ by orders of magnitude.
        R = triangle(np.vstack([A, prior, near]))
        R[:, known] = 0.0
        lengths = np.linalg.norm(R, axis=0)
        lengths[known] = np.inf
        _, singular, V = np.linalg.svd(R / lengths)
        root = V.T[:, singular > 0.0] / singular[singular > 0.0] / lengths[:, None]
        return np.asarray(root @ root.T)


def _own_ratio(Y: Array, load: Array, approach: Array, effort: Array) -> float:
    """
    Return the effort per torque of a joint by a known load, whatever the bodies are.

    The effort is linear in the joint's own products of ratio and masses.
    """
    Y = Y / np.maximum(np.linalg.norm(Y, axis=0), 1e-12)
    A = np.column_stack([load, np.ones(len(load)), approach, Y])
    return float(np.linalg.lstsq(A, effort, rcond=1e-3)[0][0])


def _linear_equations(equations: _Equations, x: _Unknowns, sigma: Array) -> tuple[Array, Array]:
    """Return the equations in units of their deviations, linear in the unknowns near x."""
    count, n, bodies = equations.Y.shape
    torque = equations.torque(x.phi)
    of_bodies = x.ratio[:, None] * equations.Y
    A = np.zeros((count, n, bodies + 3 * n))
    A[:, :, :bodies] = of_bodies
    joints = np.arange(n)
    A[:, joints, bodies + joints] = torque
    A[:, joints, bodies + n + joints] = 1.0
    A[:, joints, bodies + 2 * n + joints] = equations.approach
    b = equations.effort + of_bodies @ x.phi
    return (A / sigma[:, None]).reshape(count * n, bodies + 3 * n), (b / sigma).ravel()


def _gravity_parameters(model: Model) -> tuple[tuple[str, ...], Array]:
    """Return names and matrix of the combinations of masses and moments that joints see."""
    Y, _ = _static(model, Robot(model).random_configuration(0, STATES))
    base = combinations(Y.reshape(-1, Y.shape[2]), unknown_names(model))
    return base.names, base.B


def _with_inertials(model: Model, phi: Array) -> Model:
    """Return the model with the inertial parameters phi."""
    bodies = []
    for body, ten in zip(model.bodies, phi.reshape(-1, 10), strict=True):
        inertial = Inertial.from_pseudo_inertia(pseudo_inertia_of(ten))
        bodies.append(replace(body, inertial=inertial))
    return replace(model, bodies=tuple(bodies))


# Poses that would help.

def proposed_poses(model: Model, count: int, margin: float = 0.0,
                   free: Callable[[Array], Flags] | None = None) -> Array:
    """
    Return configurations that determine gravity best, before any is held, (count, n).

    Parameters
    ----------
    model : Model
        As for `calibrate_poses`.
    count : int
        Number of configurations; fewer if fewer are free.
    margin : float
        Distance from the position limits, rad or m.
    free : callable, optional
        Whether configurations, (k, n), are without contact, (k,).

    Raises
    ------
    InputError
        Too few configurations are free.

    """
    robot = Robot(model)
    lower, upper = robot.limits.lower + margin, robot.limits.upper - margin
    q = robot.random_configuration(0, CANDIDATES)
    q = np.clip(q, lower, np.maximum(lower, upper))
    if free is not None:
        q = q[free(q)]
    if len(q) < FEWEST:
        raise InputError(f'poses: {len(q)} of {CANDIDATES} proposed ones without contact; '
                         f'expected at least {FEWEST} (--floor)')
    fit = _Fit(model, _equations_at(model, q))
    n = model.n
    x = _Unknowns(fit.prior, fit.ratio, np.zeros(n), np.zeros(n))
    sigma = 0.1 * fit.size
    nothing = np.zeros(len(q), dtype=bool)
    covariance = fit.covariance(fit.given.part(nothing), x, sigma, 1.0, np.arange(0))
    return _most_informative(fit.given, x, sigma, covariance, q, count)


def _most_informative(equations: _Equations, x: _Unknowns, sigma: Array,
                      covariance: Array, q: Array, count: int) -> Array:
    """
    Return those of the configurations that reduce the volume of the covariance most.

    They are chosen one after the other: each adds A^T A to the information (D-optimal).
    """
    A, _ = _linear_equations(equations, x, sigma)
    A = A.reshape(*q.shape, -1)
    chosen: list[int] = []
    for _ in range(min(count, len(q))):
        # log det (1 + A C A^T) is what a pose adds to that of the information.
        of_poses = A @ covariance @ np.swapaxes(A, 1, 2) + np.eye(q.shape[1])
        gained = np.linalg.slogdet(of_poses)[1]
        gained[chosen] = -np.inf
        best = int(np.argmax(gained))
        chosen.append(best)
        gain = np.linalg.solve(of_poses[best], A[best] @ covariance)
        covariance = covariance - covariance @ A[best].T @ gain
    return q[chosen]
