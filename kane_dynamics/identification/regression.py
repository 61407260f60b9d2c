"""
Linear equations of identification: torque = Y phi + friction and armature terms.

The unknowns, in order: ten inertial parameters per body as in
`mechanics.recursive.regressor`, then damping, Coulomb friction, armature and offset of
each joint. The friction speed of Coulomb friction enters nonlinearly. It is given, or
chosen for each joint: by `friction_speeds` for given bodies, by `settled_speeds` for
unknown bodies.

The torque of a joint at rest is undetermined within the limits of stiction and contains
no information on its parameters: its equations omit rows in which it is slower than a
bound (Swevers, Verdonck & De Schutter, IEEE Control Systems 27 (2007), section on
friction).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from kane_dynamics._util.checks import instance, number, real_numbers
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError
from kane_dynamics.identification.qr_factor import Factor
from kane_dynamics.identification.recordings.recording import (check_recording,
                                                               Recording,
                                                               require_rigid_links,
                                                               STANDSTILL)
from kane_dynamics.identification.solvers import scientific
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.model.model import FRICTION as LAW_FIELDS, Joint, Model
from kane_dynamics.robot.robot import Robot
import numpy as np

FRICTION = ('damping', 'friction', 'armature', 'friction_offset')
FAR_ABOVE = 1e12  # N m or N, of coefficients of friction
LOWEST = np.array([0.0, 0.0, 0.0, -np.inf])  # lower bounds of FRICTION
UNBOUNDED = np.full(4, -np.inf)
SPEEDS = np.geomspace(0.005, 0.5, 41)  # candidates, rad/s or m/s
TURNS = 10  # largest number of alternating fits of bodies and speeds
STAYS = 0.02  # relative change of a converged speed
STRETCHES = 4  # number of blocks of consecutive rows, factorized separately


@dataclass(frozen=True, eq=False)
class RegressionRows:
    """
    Regression data of a recording and a model.

    Attributes
    ----------
    recording : Recording
    joint_names : tuple of str
    rigid : (N, n) array
        Torque of the model's rigid bodies, N m or N.
    rest : (N, n) array
        Torque that is not identified: springs, payloads, friction of mimic joints.
    Y : (N, n, 10 bodies) array
        The regressor.
    moving : (N, n) array of bool
        Where a joint is faster than standstill.

    """

    recording: Recording
    joint_names: tuple[str, ...]
    rigid: Array
    rest: Array
    Y: Array
    moving: Flags

    def half(self, *, second: bool) -> 'RegressionRows':
        """Return the first half of the rows, or the second."""
        middle = len(self.recording) // 2
        return self.part(slice(middle, None) if second else slice(0, middle))

    def part(self, chosen: slice | Flags) -> 'RegressionRows':
        """Return the rows of a slice or a mask."""
        return RegressionRows(self.recording.rows(chosen), self.joint_names,
                              self.rigid[chosen],
                              self.rest[chosen], self.Y[chosen], self.moving[chosen])

    @lazy_property
    def stretches(self) -> list['RegressionRows']:
        """Return the rows as consecutive blocks of equal length."""
        bounds = np.linspace(0, len(self.recording), STRETCHES + 1).round().astype(int)
        blocks = []
        for first, end in pairwise(bounds):
            blocks.append(self.part(slice(first, end)))
        return blocks

    @lazy_property
    def factors(self) -> list[Factor]:
        """Return for each joint the factorized columns that do not depend on friction speeds."""
        # The unknowns are the inertial parameters, then the four of `FRICTION` of each joint;
        # the torque is the last column.
        _, n, n_inertial = self.Y.shape
        tau = self.recording.tau - self.rest
        torque_column = n_inertial + 4 * n
        factors = []
        for j in range(n):
            moves = self.moving[:, j]
            Y = self.Y[moves, j]
            used = np.flatnonzero(Y.any(axis=0))
            u = self.recording.u[moves, j]
            udot = self.recording.udot[moves, j]
            # Coulomb friction is left out: its column depends on the friction speed.
            damping = n_inertial + 4 * j
            coulomb_friction, armature, offset = damping + 1, damping + 2, damping + 3
            places = np.concatenate([used, [damping, armature, offset, torque_column]])
            table = np.column_stack([Y[:, used], u, udot, np.ones(len(u)), tau[moves, j]])
            Q, R = np.linalg.qr(table)
            factors.append(Factor(places, coulomb_friction, u, Q, R))
        return factors


def without_losses(model: Model) -> Model:
    """Return the model without friction and armature at joints with a coordinate of their own."""
    nothing = Joint('nothing', 'revolute', np.array([0.0, 0.0, 1.0]))
    without: dict[str, Any] = {name: getattr(nothing, name)
                               for name in (*LAW_FIELDS, 'armature')}
    bodies = []
    for body in model.bodies:
        if body.joint.name in model.coordinate_names:
            body = replace(body, joint=replace(body.joint, **without))
        bodies.append(body)
    return replace(model, bodies=tuple(bodies))


def rows(model: Model, recording: Recording,
         standstill: float = STANDSTILL) -> RegressionRows:
    """Return the regression data of a recording; raise InputError for other joints."""
    check_recording(model, recording)
    require_rigid_links(model)
    standstill = number(standstill, 'standstill', 'a nonnegative speed, rad/s or m/s',
                        lambda x: x >= 0.0)
    # The regressor is of bodies alone; springs and armature are known, friction is
    # fitted.
    robot = Robot(without_losses(model))
    state = recording.q, recording.u, recording.udot
    Y = robot.regressor(*state)
    rigid = Y @ robot.inertial_parameters
    return RegressionRows(recording, robot.joint_names, rigid,
                          robot.inverse_dynamics(*state) - rigid, Y,
                          np.abs(recording.u) > standstill)


def friction_columns(recording: Recording, joint: int, speed: float) -> Array:
    """Return the torques of unit damping, friction, armature and offset of a joint, (N, 4)."""
    u = recording.u[:, joint]
    return np.column_stack([u, coulomb(u, speed), recording.udot[:, joint],
                            np.ones(len(u))])


def fit_friction(data: RegressionRows, joint: int, speed: float, lowest: Array = LOWEST
                 ) -> tuple[Array, float]:
    """
    Fit friction and armature of a joint, with lower bounds `lowest`, for given bodies.

    Returns
    -------
    (4,) array
        Damping, friction, armature and offset.
    float
        Sum of squares of the residual, (N m)^2 or N^2.

    """
    return _fitted_friction(_friction_factor(data, joint), speed, lowest)


def _friction_factor(data: RegressionRows, joint: int) -> Factor:
    """Return the factorized friction equations of a joint for given bodies."""
    moves = data.moving[:, joint]
    if moves.sum() < 10:
        raise InputError(f"joint '{data.joint_names[joint]}': moves in {moves.sum()} "
                         'rows of the fit; expected at least 10')
    # What the bodies do not explain is damping, armature and an offset; the column of
    # Coulomb friction, which depends on the friction speed, comes later.
    left = data.recording.tau[:, joint] - data.rigid[:, joint] - data.rest[:, joint]
    u = data.recording.u[moves, joint]
    udot = data.recording.udot[moves, joint]
    columns = np.column_stack([u, udot, np.ones(len(u)), left[moves]])
    Q, R = np.linalg.qr(columns)
    return Factor(np.array([0, 2, 3, 4]), 1, u, Q, R)


def _fitted_friction(factor: Factor, speed: float, lowest: Array) -> tuple[Array, float]:
    """Return the result of `fit_friction` for factorized equations."""
    R = factor.with_coulomb(speed, 5)
    found = scientific('scipy.optimize').lsq_linear(
        R[:, :-1], R[:, -1], bounds=(lowest, np.inf), method='bvls').x
    x = np.maximum(found, lowest)  # the solver exceeds bounds by rounding errors
    missed = R[:, -1] - R[:, :-1] @ x
    return x, float(missed @ missed)


def friction_speeds(data: RegressionRows, lowest: Array = LOWEST) -> Array:
    """
    Return the friction speed that fits best for each joint, (n,), rad/s or m/s.

    It is searched among `SPEEDS`, then between the neighbors of the best one.
    """
    # A fit for each joint by itself: its friction speed alone is not linear.
    instance(data, RegressionRows, 'data')
    try:
        lowest = real_numbers(lowest)
    except (TypeError, ValueError):
        lowest = np.empty(0)
    if lowest.shape != (4,) or not (lowest < FAR_ABOVE).all():
        raise InputError('lowest: no four numbers, or one too large; expected the lowest '
                         'value of each coefficient, N m, or -inf')
    speeds = []
    for joint in range(data.rigid.shape[1]):
        speeds.append(_friction_speed(data, joint, lowest))
    return np.array(speeds)


def _friction_speed(data: RegressionRows, joint: int, lowest: Array) -> float:
    """Return the friction speed that fits best for a joint."""
    factor = _friction_factor(data, joint)

    def missed(speed: float) -> float:
        return _fitted_friction(factor, speed, lowest)[1]
    return least_between(missed, SPEEDS, 1e-6)


def least_between(function: Callable[[float], float], candidates: Array,
                  tolerance: float) -> float:
    """
    Return the argument of the smallest value of a function.

    It is searched among increasing, positive candidates, then between the neighbors of
    the best one, to a relative tolerance.
    """
    # The best candidate, refined between its neighbors.
    values = [function(float(candidate)) for candidate in candidates]
    best = int(np.argmin(values))
    at_best = float(candidates[best])
    neighbors = candidates[[max(best - 1, 0), min(best + 1, len(candidates) - 1)]]
    refined = scientific('scipy.optimize').minimize_scalar(
        lambda ratio: function(at_best * ratio), bounds=neighbors / at_best,
        method='bounded', options={'xatol': tolerance})
    if refined.fun < values[best]:
        return at_best * float(refined.x)
    return at_best


def settled_speeds(data: RegressionRows, speeds: Array, rigid: Callable[[Array], Array],
                   lowest: Array = LOWEST) -> Array:
    """
    Return the friction speeds that fit best for unknown inertial parameters.

    Bodies and speeds are fitted alternately until the speeds converge; each fit reduces
    the same sum of squares. Speeds fitted to wrong bodies compensate part of their
    error, and vice versa.

    Parameters
    ----------
    data : RegressionRows
        The rows to fit.
    speeds : (n,) array
        Initial speeds, rad/s or m/s.
    rigid : callable
        Fits the bodies for given speeds and returns their torque, (N, n), N m or N.
    lowest : (4,) array
        Lower bounds of damping, friction, armature and offset.

    """
    for _ in range(TURNS):
        before, speeds = speeds, friction_speeds(replace(data, rigid=rigid(speeds)),
                                                 lowest)
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
    Return equations R x = z per joint, with the normal equations of all its rows in motion.

    Returns
    -------
    equations : list of (R, z)
        One per joint; R is square, or has fewer rows, from a QR factorization.
    floor : (n,) array
        Smallest possible sum of squares.
    counts : (n,) array
        Number of rows of each joint.

    """
    columns = data.Y.shape[2] + 4 * data.Y.shape[1]
    counts = data.moving.sum(axis=0)
    for j, count in enumerate(counts):
        if count <= columns + 1:
            raise InputError(f"joint '{data.joint_names[j]}': moves in {count} rows of "
                             f'the fit; expected more than {columns + 1} for {columns} '
                             'unknowns')
    # QR of the QR of consecutive blocks: [R z; 0 f] for each joint, where f^2 is the sum of
    # squares that no parameters reduce. With few columns in use that row may be missing.
    parts = [factorized(part, speeds) for part in data.stretches]
    equations = []
    floor = np.zeros(len(counts))
    for j, of_joint in enumerate(zip(*parts, strict=True)):
        R = triangle(np.vstack(of_joint))
        if len(R) > columns:
            floor[j] = R[-1, -1]**2
        equations.append((R[:columns, :-1], R[:columns, -1]))
    return equations, floor, counts


def factorized(data: RegressionRows, speeds: Array) -> list[Array]:
    """Return R of each joint's equations [X | torque] in its rows in motion."""
    columns = data.Y.shape[2] + 4 * data.Y.shape[1] + 1
    return [factor.with_coulomb(float(speed), columns)
            for factor, speed in zip(data.factors, speeds, strict=True)]


def weights(equations: list[tuple[Array, Array]], floor: Array, counts: Array,
            x: Array) -> Array:
    """Return the standard deviation of each joint's residual at x, (n,), N m or N."""
    missed = np.array([np.sum((z - R @ x)**2) for R, z in equations]) + floor
    return np.asarray(np.sqrt(np.maximum(missed / counts, 1e-24)))


def rms(values: Array) -> Array:
    """Return the root mean square of each column."""
    return np.asarray(np.sqrt(np.mean(values * values, axis=0)))


def triangle(A: Array) -> Array:
    """Return R of A = Q R, which has the same normal equations and at most as many rows as A."""
    return np.asarray(np.linalg.qr(A, mode='r'))


def stacked_rows(equations: list[tuple[Array, Array]],
                 sigma: Array) -> tuple[Array, Array]:
    """Return the equations of all joints, divided by their standard deviations."""
    rows = []
    right_sides = []
    for (R, z), deviation in zip(equations, sigma, strict=True):
        rows.append(R / deviation)
        right_sides.append(z / deviation)
    return np.vstack(rows), np.concatenate(right_sides)
