"""Base parameters: the identifiable combinations of unknowns, their names and estimates."""

from collections.abc import Sequence
from dataclasses import dataclass

from kane_dynamics._util.checks import instance, integer, per_joint
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.identification.regression import (FRICTION, full_regressor,
                                                     least_between, RegressionRows,
                                                     rows, SPEEDS, triangle,
                                                     without_losses)
from kane_dynamics.identification.solvers import on_one_processor, scientific
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.mechanics.recursive.regressor import inertial_parameters, PARAMETERS
from kane_dynamics.model.model import Model
import numpy as np

MOST_STATES = 100_000
RANK = 1e-9  # smallest pivot of independent columns, relative to the largest
ROUNDS = 8  # of reweighting, which converges in three or four
TINY = 1e-300


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """
    Minimal combinations B x of the unknowns x that determine the torques.

    Attributes
    ----------
    names : tuple of str
        Combinations as text, such as 'shoulder.mx + 0.612 elbow.m'.
    columns : (b,) array of int
        Columns of the full regressor that represent the combinations.
    B : (b, unknowns) array
        Matrix of the combinations; their values are B @ x.

    """

    names: tuple[str, ...]
    columns: Array
    B: Array

    @property
    def single(self) -> Flags:
        """Return which unknowns are individually identifiable, (unknowns,) array of bool."""
        found = np.zeros(self.B.shape[1], dtype=bool)
        found[self.columns[np.count_nonzero(self.B, axis=1) == 1]] = True
        return found


@dataclass(frozen=True, eq=False)
class BaseFit:
    """
    Estimated base parameters.

    Attributes
    ----------
    base : BaseParameters
    values, deviations : (b,) arrays
        Estimates and standard deviations for independent residuals; kg, m, s as the
        unknowns. Residuals of oversampled or filtered rows are correlated: the
        deviations are too small.
    condition : float
        Condition number of the equations with columns scaled to unit length.
    sigma : (n,) array
        Standard deviation of each joint's residual, N m or N.

    """

    base: BaseParameters
    values: Array
    deviations: Array
    condition: float
    sigma: Array


def unknown_names(model: Model) -> list[str]:
    """Return a name for every unknown, in order."""
    return [*(f'{body.name}.{name}' for body in model.bodies for name in PARAMETERS),
            *(f'{joint}.{name}' for joint in model.joint_names for name in FRICTION)]


def true_unknowns(model: Model) -> Array:
    """Return the values of the unknowns of a model, (10 bodies + 4 n,)."""
    losses = []
    for joint in model.coordinate_joints:
        losses += [getattr(joint, name) for name in FRICTION]
    return np.concatenate([inertial_parameters(model), losses])


def base_parameters(model: Model, speeds: Sequence[float] | Array, *, states: int = 200
                    ) -> BaseParameters:
    """
    Return the base parameters of a model.

    The regressor at random states is factorized by QR with column pivoting; dependent
    columns give the groupings (Gautier, J. Robotic Systems 8 (1991)).

    Parameters
    ----------
    model : Model
        The arm.
    speeds : (n,) array
        Friction speed of each joint, rad/s or m/s.
    states : int
        Number of random states.

    """
    instance(model, Model, 'model')
    require_angles(model, 'base parameters')
    states = integer(states, 'states', 1, MOST_STATES)
    friction_speeds = per_joint(speeds, 'speeds', model.joint_names)
    if not friction_speeds.all():
        raise InputError(f'speeds: {friction_speeds.tolist()}; expected positive numbers, '
                         'rad/s or m/s')
    rng = np.random.default_rng(0)
    q, u, udot = rng.uniform(-2.0, 2.0, (3, states, model.n))
    sample = Recording(np.arange(float(states)), q, u, udot, np.zeros((states, model.n)))
    X = full_regressor(rows(without_losses(model), sample), friction_speeds)
    X = X.reshape(-1, X.shape[2])
    return combinations(X, unknown_names(model))


def combinations(X: Array, names: Sequence[str]) -> BaseParameters:
    """Return the independent combinations of the unknowns with these columns of equations."""
    # Without scaling, pivots prefer columns of bodies late in the tree.
    _, R, order = scientific('scipy.linalg').qr(X, mode='economic', pivoting=True)
    diagonal = np.abs(np.diag(R))
    rank = int(np.sum(diagonal > RANK * diagonal[0]))
    independent = order[:rank]
    dependent = order[rank:]

    # Dependent columns are combinations of the independent ones, X_d = X_i K, so that
    # each base parameter is its own unknown plus those of the dependent columns by K.
    K = np.linalg.solve(R[:rank, :rank], R[:rank, rank:])
    B = np.zeros((rank, X.shape[1]))
    B[np.arange(rank), independent] = 1.0
    B[:, dependent] = np.where(np.abs(K) > 1e-8, K, 0.0)

    # In the order of the unknowns instead of that of the pivots.
    by_unknown = np.argsort(independent)
    words = []
    for k in by_unknown:
        words.append(_combination(B[k], int(independent[k]), names))
    return BaseParameters(tuple(words), independent[by_unknown], B[by_unknown])


def _combination(row: Array, own: int, names: Sequence[str]) -> str:
    """Return a combination of unknowns as text, beginning with the one it stands for."""
    parts = [names[own]]
    for k in np.flatnonzero(row).tolist():
        if k != own:
            factor = '' if abs(abs(row[k]) - 1.0) < 1e-6 else f'{abs(row[k]):.4g} '
            parts.append(f'{"-" if row[k] < 0.0 else "+"} {factor}{names[k]}')
    return ' '.join(parts)


@on_one_processor
def fit_base(data: RegressionRows, model: Model, speeds: Array, *,
             weighted: bool = True) -> BaseFit:
    """
    Estimate base parameters by least squares.

    Parameters
    ----------
    data : RegressionRows
        Regressor and torques.
    model : Model
        Model; its structure is used, not its masses.
    speeds : (n,) array
        Friction speed of each joint, rad/s or m/s.
    weighted : bool
        Whether joints are weighted by the variances of their residuals, which are
        iterated.

    Raises
    ------
    InputError
        If the motion does not excite all base parameters; the message names one.

    """
    instance(data, RegressionRows, 'data')
    instance(model, Model, 'model')
    speeds = per_joint(speeds, 'speeds', model.joint_names)
    base = base_parameters(model, speeds)
    X = full_regressor(data, speeds)
    tau = data.recording.tau - data.rest
    counts = data.moving.sum(axis=0)
    equations = []
    for j, count in enumerate(counts):
        if count <= X.shape[2] + 1:
            raise InputError(f"joint '{data.joint_names[j]}': moves in {count} rows of the "
                             f'fit; expected more than {X.shape[2] + 1} for {X.shape[2]} '
                             'unknowns')
        table = np.column_stack([X[:, j, base.columns], tau[:, j]])
        equations.append(triangle(table[data.moving[:, j]]))

    # Weighted least squares; the weights are the deviations of the last residuals.
    sigma = np.ones(len(equations))
    for _ in range(ROUNDS if weighted else 1):
        # Columns of unit length, so that singular values compare combinations, not
        # units.
        R = np.vstack([of_joint / deviation for of_joint, deviation
                       in zip(equations, sigma, strict=True)])
        A, b = R[:, :-1], R[:, -1]
        scale = np.linalg.norm(A, axis=0)
        if not scale.all():
            raise InputError('motion: does not excite '
                             f"'{base.names[int(np.argmin(scale))]}'; expected an "
                             'exciting motion')
        # The combination of the smallest singular value is the least excited.
        _, singular, Vt = np.linalg.svd(A / scale, full_matrices=False)
        if singular[-1] < 1e-12 * singular[0]:
            worst = int(np.argmax(np.abs(Vt[-1])))
            raise InputError(f"motion: does not excite '{base.names[worst]}'; expected "
                             'an exciting motion')
        values = np.linalg.lstsq(A / scale, b, rcond=None)[0] / scale
        left = np.array([np.sum((R[:, -1] - R[:, :-1] @ values)**2) for R in equations])
        residual = np.sqrt(np.maximum(left / counts, 1e-24))
        sigma = residual if weighted else sigma
    # Residuals of a fit with few rows are smaller than the noise.
    freedom = counts.sum() / (counts.sum() - len(values))
    noise = 1.0 if weighted else float(residual @ residual) / len(residual)
    return BaseFit(base, values, base_deviations(A) * np.sqrt(noise * freedom),
                   float(singular[0] / singular[-1]), residual)


@on_one_processor
def base_speeds(data: RegressionRows, model: Model) -> Array:
    """
    Return the friction speeds that fit best with free parameters, (n,), rad/s or m/s.

    Each joint has free inertial parameters of its own here.

    Parameters
    ----------
    data : RegressionRows
        Regressor and torques.
    model : Model
        Model; its structure is used, not its masses.

    """
    instance(data, RegressionRows, 'data')
    instance(model, Model, 'model')
    speeds = []
    for j in range(model.n):
        moves = data.moving[:, j]
        u = data.recording.u[moves, j]
        tau = (data.recording.tau - data.rest)[moves, j]
        others = np.column_stack([data.Y[moves, j], u, data.recording.udot[moves, j],
                                  np.ones(len(u))])
        basis = scientific('scipy.linalg').orth(others, rcond=RANK)

        def missed(speed: float, u: Array = u, tau: Array = tau,
                   basis: Array = basis) -> float:
            """Return the squares that Coulomb friction of a speed leaves of the torque."""
            pair = np.column_stack([coulomb(u, speed), tau])
            alone = pair - basis @ (basis.T @ pair)
            slip, left = alone.T
            return float(left @ left - (slip @ left)**2 / max(slip @ slip, TINY))
        speeds.append(least_between(missed, SPEEDS, 1e-6))
    return np.array(speeds)


def base_error(fit: BaseFit, data: RegressionRows, speeds: Array) -> Array:
    """Return measured torque minus that of estimated base parameters, (N, n), N m or N."""
    X = full_regressor(data, speeds)[:, :, fit.base.columns]
    return np.asarray(data.recording.tau - data.rest - X @ fit.values)


def base_deviations(A: Array) -> Array:
    """Return standard deviations from equations of unit variance, (b,); infinite if singular."""
    scale = np.linalg.norm(A, axis=0)
    if not scale.all():
        return np.full(len(scale), np.inf)
    _, singular, Vt = np.linalg.svd(A / scale, full_matrices=False)
    with np.errstate(divide='ignore'):
        return np.asarray(np.sqrt(np.sum((Vt.T / singular)**2, axis=1)) / scale)
