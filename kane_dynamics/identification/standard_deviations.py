"""
Standard deviations of identified values, including the bias of the prior.

With P = (A^T A + w G)^-1 and the error of the prior, d = truth - prior, the error of the
estimate is P (A^T e - w G d): noise e, and bias towards the prior. If the weight w is
that of the true distribution, d has the covariance (w G)^-1, and the error has the
covariance P. But w is chosen by cross-validation and may be too large. By the evidence
(MacKay, Neural Computation 4 (1992), "Bayesian interpolation") the weight supported by
the data is the effective number of parameters, `determined_count`, divided by the
squared distance from the prior. If w is larger, the covariance of d is increased by the
ratio:

    covariance = P (A^T A + w max(1, w distance / determined_count) G) P.
"""

from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.identification.base_regressor import base_deviations, base_parameters
from kane_dynamics.identification.physical_consistency import prior_metric, prior_parameters
from kane_dynamics.model.model import Model
import numpy as np

COMBINED = 1e6  # length of a column over its distance from the span of the others


def statistics(A: Array, model: Model, x: Array, speeds: Array, weight: float,
               losses: int) -> tuple[Array, Array, Array, float]:
    """
    Return standard deviations of the unknowns and the condition number.

    Parameters
    ----------
    A : (m, 10 bodies + losses n + further) array
        Equations, each divided by its standard deviation; zeros of unused columns.
    model : Model
        Its inertials are the prior.
    x : (10 bodies + 4 n,) array
        Identified values.
    speeds : (n,) array
        Friction speed of each joint, rad/s or m/s.
    weight : float
        Weight of the prior; infinite for given bodies.
    losses : int
        Columns of each joint, of which the first four are the losses of x.

    Returns
    -------
    (n, 4) array
        Standard deviations of damping, friction, armature and offset.
    (bodies, 10) array
        Standard deviations of inertial parameters; NaN if not identifiable by
        themselves, or given.
    (k, k) array
        Covariance of all columns of A; zeros of those that are not fitted.
    float
        Condition number of the equations with the prior, columns scaled to unit length.

    """
    size, n = 10 * len(model.bodies), model.n
    used: Flags = np.asarray(A.any(axis=0))
    is_given = np.isinf(weight)
    used[:size] = not is_given
    # The metric of the prior, block by block, and the distance of the result from it.
    G = np.zeros((A.shape[1], A.shape[1]))
    change = np.zeros(A.shape[1])
    for k, body in enumerate(model.bodies if not is_given else ()):
        block = slice(10 * k, 10 * k + 10)
        G[block, block] = weight * prior_metric(body.inertial)
        change[block] = x[block] - prior_parameters(body.inertial)
    places = np.ix_(used, used)
    # Information of the data and of the prior; P is the covariance of both.
    information = A[:, used].T @ A[:, used]
    P, condition = _inverse(information + G[places])
    # The unknowns that the data determine, and how much farther than expected the prior
    # was moved.
    determined_count = max(size - float(np.trace(P @ G[places])), 1.0)
    overdone = max(1.0, float(change @ G @ change) / determined_count)
    # The covariance of the estimate, with the bias of the prior as variance.
    covariance = np.zeros_like(G)
    covariance[places] = P @ (information + overdone * G[places]) @ P
    every = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    of_losses = every[size:size + losses * n].reshape(n, losses)[:, :4]
    single = np.full((len(model.bodies), 10), np.nan)
    if is_given:
        return of_losses, single, covariance, condition
    # Base parameters alone can be stated singly; others are undetermined. All other
    # columns are those of further terms.
    base = base_parameters(model, speeds)
    kept = np.concatenate([np.arange(size), (size + losses * np.arange(n)[:, None]
                                             + np.arange(4)).ravel()])
    columns = kept[base.columns]
    further = np.setdiff1d(np.flatnonzero(used), kept)
    alone = base_deviations(A[:, np.concatenate([columns, further]).astype(int)])[:len(columns)]
    deviations = np.full(size + 4 * n, np.nan)
    # A column that is a combination of further terms, as of coupled motors, says nothing.
    with np.errstate(invalid='ignore'):  # a column of zeros, whose deviation is infinite
        is_combined = alone * np.linalg.norm(A[:, columns], axis=0) > COMBINED
    deviations[base.columns] = np.where(is_combined, np.nan, np.maximum(alone, every[columns]))
    deviations[~base.single] = np.nan
    return of_losses, deviations[:size].reshape(-1, 10), covariance, condition


def _inverse(information: Array) -> tuple[Array, float]:
    """Return the inverse of an information matrix, and the condition of its scaled equations."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information / np.outer(scale, scale)
    return (np.asarray(np.linalg.pinv(scaled) / np.outer(scale, scale)),
            float(np.sqrt(np.linalg.cond(scaled))))
