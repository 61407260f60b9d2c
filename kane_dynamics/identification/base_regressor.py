"""Base parameters: the identifiable combinations of unknowns, their names and estimates."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from kane_dynamics._util.checks import instance, integer, per_joint
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import InputError
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.identification.regression import (FRICTION, full_regressor, rows,
                                                     without_losses)
from kane_dynamics.identification.solvers import scientific
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.recursive.regressor import inertial_parameters, PARAMETERS
from kane_dynamics.model.model import Model
import numpy as np

MOST_STATES = 100_000
RANK = 1e-9  # smallest pivot of independent columns, relative to the largest


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


class BaseFit(NamedTuple):
    """
    Identified base parameters.

    Attributes
    ----------
    base : BaseParameters
    values, deviations : (b,) arrays
        Values and standard deviations; kg, m, s as the unknowns.

    """

    base: BaseParameters
    values: Array
    deviations: Array


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


def base_deviations(A: Array) -> Array:
    """Return standard deviations from equations of unit variance, (b,); infinite if singular."""
    scale = np.linalg.norm(A, axis=0)
    if not scale.all():
        return np.full(len(scale), np.inf)
    _, singular, Vt = np.linalg.svd(A / scale, full_matrices=False)
    with np.errstate(divide='ignore'):
        return np.asarray(np.sqrt(np.sum((Vt.T / singular)**2, axis=1)) / scale)
