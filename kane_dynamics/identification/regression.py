"""
The linear equations of identification: torque = Y phi + friction and rotor terms.

The unknowns, in order: ten inertial parameters a body as `mechanics.regressor` has them, then for
each joint damping, Coulomb friction, armature and offset. How fast Coulomb friction sets in
enters nonlinearly; it is given, or chosen for each joint: by `friction_speeds` beside given
bodies, by `settled_speeds` beside bodies that are unknown too.

A joint that stands takes any torque up to that of stiction, so that what it takes says nothing
about its parameters: rows in which a joint is slower than a bound are left out of its equations
(Swevers, Verdonck & De Schutter, IEEE Control Systems 27 (2007), section on friction).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.qr_factor import Factor
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.identification.solvers import scientific
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import NDArray

FRICTION = ('damping', 'friction', 'armature', 'friction_offset')
LOWEST = np.array([0.0, 0.0, 0.0, -np.inf])  # of what dissipates
UNBOUNDED = np.full(4, -np.inf)
STANDSTILL = 0.02  # rad/s or m/s
SPEEDS = np.geomspace(0.005, 0.5, 41)  # candidates, rad/s or m/s
TURNS = 10  # of fitting bodies and speeds, at most
STAYS = 0.02  # relative change of a speed
STRETCHES = 4  # of consecutive rows, which are factorized one by one


@dataclass(frozen=True, eq=False)
class RegressionRows:
    """
    What a recording says of a model.

    Attributes
    ----------
    recording : Recording
    rigid : (N, n) array
        Torque of the model's rigid bodies, N m or N.
    rest : (N, n) array
        Torque that is not identified: springs, payloads, mimic joints' friction.
    Y : (N, n, 10 bodies) array
        The regressor.
    moving : (N, n) array of bool
        Where a joint is faster than standstill.

    """

    recording: Recording
    rigid: Array
    rest: Array
    Y: Array
    moving: NDArray[np.bool_]

    def half(self, *, second: bool) -> 'RegressionRows':
        """Return the first half of the rows, or the second."""
        middle = len(self.recording) // 2
        return self.part(slice(middle, None) if second else slice(0, middle))

    def part(self, chosen: slice) -> 'RegressionRows':
        """Return some consecutive rows."""
        return RegressionRows(self.recording.rows(chosen), self.rigid[chosen], self.rest[chosen],
                              self.Y[chosen], self.moving[chosen])

    @cached_property
    def stretches(self) -> list['RegressionRows']:
        """Return the rows in consecutive stretches of equal length."""
        ends = np.linspace(0, len(self.recording), STRETCHES + 1).round().astype(int)
        return [self.part(slice(a, b)) for a, b in pairwise(ends)]

    @cached_property
    def factors(self) -> list[Factor]:
        """Return for each joint the factorized columns that no friction speed changes."""
        _, n, inertial = self.Y.shape
        tau, found = self.recording.tau - self.rest, []
        for j in range(n):
            moves, own = self.moving[:, j], inertial + 4 * j
            Y = self.Y[moves, j]
            used = np.flatnonzero(Y.any(axis=0))
            u, udot = self.recording.u[moves, j], self.recording.udot[moves, j]
            places = np.concatenate([used, [own, own + 2, own + 3, inertial + 4 * n]])
            found.append(Factor(places, own + 1, u, *np.linalg.qr(np.column_stack(
                [Y[:, used], u, udot, np.ones(len(u)), tau[moves, j]]))))
        return found


def without_losses(model: Model) -> Model:
    """Return the model without friction and armature at the joints that carry a coordinate."""
    own = set(model.coordinate_names)
    nothing: dict[str, Any] = dict.fromkeys(FRICTION, 0.0)
    return replace(model, bodies=tuple(
        replace(body, joint=replace(body.joint, **nothing))
        if body.joint.name in own else body for body in model.bodies))


def rows(model: Model, recording: Recording, standstill: float = STANDSTILL) -> RegressionRows:
    """Return what a recording says of a model; InputError if it is of other joints."""
    if recording.tau.shape[1] != model.n:
        raise InputError(f'the recording is of {recording.tau.shape[1]} joints, the model has '
                         f'{model.n}: {", ".join(model.joint_names)}')
    robot = Robot(without_losses(model))
    state = recording.q, recording.u, recording.udot
    Y = robot.regressor(*state)
    rigid = Y @ robot.inertial_parameters
    return RegressionRows(recording, rigid, robot.inverse_dynamics(*state) - rigid, Y,
                          np.abs(recording.u) > standstill)


def friction_columns(recording: Recording, joint: int, speed: float) -> Array:
    """Return what unit damping, friction, armature and offset ask of a joint, (N, 4)."""
    u = recording.u[:, joint]
    return np.column_stack([u, coulomb(u, speed), recording.udot[:, joint], np.ones(len(u))])


def fit_friction(data: RegressionRows, joint: int, speed: float, lowest: Array = LOWEST
                 ) -> tuple[Array, float]:
    """
    Fit a joint's friction and armature, of which `lowest` are bounds, beside the model's bodies.

    Returns
    -------
    (4,) array
        Damping, friction, armature and offset.
    float
        Sum of squares of what they leave, (N m)^2 or N^2.

    """
    return _fitted_friction(_friction_factor(data, joint), speed, lowest)


def _friction_factor(data: RegressionRows, joint: int) -> Factor:
    """Return a joint's equations of friction beside the model's bodies, factorized."""
    moves = data.moving[:, joint]
    if moves.sum() < 10:
        raise InputError(f'joint number {joint + 1} moves in {moves.sum()} rows of the fit; '
                         'identification needs all joints in motion')
    left = data.recording.tau[:, joint] - data.rigid[:, joint] - data.rest[:, joint]
    u, udot = data.recording.u[moves, joint], data.recording.udot[moves, joint]
    return Factor(np.array([0, 2, 3, 4]), 1, u, *np.linalg.qr(np.column_stack(
        [u, udot, np.ones(len(u)), left[moves]])))


def _fitted_friction(factor: Factor, speed: float, lowest: Array) -> tuple[Array, float]:
    """Return what `fit_friction` does of factorized equations."""
    R = factor.with_coulomb(speed, 5)
    found = scientific('scipy.optimize').lsq_linear(
        R[:, :-1], R[:, -1], bounds=(lowest, np.inf), method='bvls').x
    x = np.maximum(found, lowest)  # the solver leaves bounds by rounding
    missed = R[:, -1] - R[:, :-1] @ x
    return x, float(missed @ missed)


def friction_speeds(data: RegressionRows, lowest: Array = LOWEST) -> Array:
    """
    Return the speed at which each joint's Coulomb friction fits best, (n,), rad/s or m/s.

    It is sought among `SPEEDS`, then between the neighbours of the best.
    """
    return np.array([_friction_speed(data, joint, lowest) for joint in range(data.rigid.shape[1])])


def _friction_speed(data: RegressionRows, joint: int, lowest: Array) -> float:
    """Return the speed at which a joint's Coulomb friction fits best."""
    factor = _friction_factor(data, joint)

    def missed(speed: float) -> float:
        return _fitted_friction(factor, speed, lowest)[1]
    losses = [missed(float(speed)) for speed in SPEEDS]
    best = int(np.argmin(losses))
    speed = float(SPEEDS[best])
    ratios = SPEEDS[[max(best - 1, 0), min(best + 1, len(SPEEDS) - 1)]] / speed
    found = scientific('scipy.optimize').minimize_scalar(
        lambda ratio: missed(speed * ratio), bounds=ratios, method='bounded',
        options={'xatol': 1e-6})
    return speed * float(found.x) if found.fun < losses[best] else speed


def settled_speeds(data: RegressionRows, speeds: Array, rigid: Callable[[Array], Array],
                   lowest: Array = LOWEST) -> Array:
    """
    Return the speeds at which friction sets in, chosen beside bodies that are unknown as well.

    Bodies and speeds are fitted in turn until the speeds stay: each lowers the same sum of
    squares. A speed that was chosen beside wrong bodies makes up for what these leave, and bodies
    that are fitted beside wrong speeds likewise.

    Parameters
    ----------
    data : RegressionRows
        The rows to fit.
    speeds : (n,) array
        To begin with, rad/s or m/s.
    rigid : callable
        Given speeds, fits the bodies and returns their torque, (N, n), N m or N.
    lowest : (4,) array
        Of damping, friction, armature and offset.

    """
    for _ in range(TURNS):
        before, speeds = speeds, friction_speeds(replace(data, rigid=rigid(speeds)), lowest)
        if np.abs(np.log(speeds / before)).max() < STAYS:
            break
    return speeds


def full_regressor(data: RegressionRows, speeds: Array) -> Array:
    """Return the regressor of all unknowns, (N, n, 10 bodies + 4 n)."""
    count, n, inertial = data.Y.shape
    X = np.zeros((count, n, inertial + 4 * n))
    X[:, :, :inertial] = data.Y
    for j in range(n):
        X[:, j, inertial + 4 * j:inertial + 4 * j + 4] = friction_columns(
            data.recording, j, float(speeds[j]))
    return X


def compressed(data: RegressionRows,
               speeds: Array) -> tuple[list[tuple[Array, Array]], Array, Array]:
    """
    Return per-joint equations R x = z with the normal equations of all rows that count.

    Returns
    -------
    equations : list of (R, z)
        One a joint; R is square, or shorter, from a QR factorization.
    floor : (n,) array
        The sum of squares that no x can take away.
    counts : (n,) array
        Rows in each.

    """
    columns = data.Y.shape[2] + 4 * data.Y.shape[1]
    counts = data.moving.sum(axis=0)
    for j, count in enumerate(counts):
        if count <= columns + 1:
            raise InputError(f'joint number {j + 1} moves in {count} rows of the fit; '
                             f'{columns} unknowns need more')
    parts = [factorized(part, speeds) for part in data.stretches]
    whole = [triangle(np.vstack(of_joint)) for of_joint in zip(*parts, strict=True)]
    # With few columns in use the last row may have gone already.
    floor = [R[-1, -1]**2 if len(R) > columns else 0.0 for R in whole]
    return [(R[:columns, :-1], R[:columns, -1]) for R in whole], np.array(floor), counts


def factorized(data: RegressionRows, speeds: Array) -> list[Array]:
    """Return for each joint R of its equations [X | torque] in the rows that count."""
    columns = data.Y.shape[2] + 4 * data.Y.shape[1] + 1
    return [factor.with_coulomb(float(speed), columns)
            for factor, speed in zip(data.factors, speeds, strict=True)]


def weights(equations: list[tuple[Array, Array]], floor: Array, counts: Array, x: Array) -> Array:
    """Return the standard deviation of each joint's residual at x, (n,), N m or N."""
    missed = np.array([np.sum((z - R @ x)**2) for R, z in equations]) + floor
    return np.asarray(np.sqrt(np.maximum(missed / counts, 1e-24)))


def triangle(A: Array) -> Array:
    """Return R of A = Q R: as few rows as there are columns, with the same normal equations."""
    return np.asarray(np.linalg.qr(A, mode='r'))


def stacked(equations: list[tuple[Array, Array]], sigma: Array) -> tuple[Array, Array]:
    """Return the equations of all joints, each by its standard deviation."""
    return (np.vstack([R / s for (R, _), s in zip(equations, sigma, strict=True)]),
            np.concatenate([z / s for (_, z), s in zip(equations, sigma, strict=True)]))
