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

from kane_dynamics._util.typing import Array
from kane_dynamics.identification.base_regressor import base_deviations, base_parameters
from kane_dynamics.identification.physical_consistency import prior_metric, prior_parameters
from kane_dynamics.model.model import Model
import numpy as np


def friction_statistics(A: Array, model: Model) -> tuple[Array, Array, float]:
    """Return `statistics` of a fit of friction alone; deviations of inertials are NaN."""
    information = A.T @ A
    own = slice(10 * len(model.bodies), None)
    inverse, condition = _inverse(information[own, own])
    return (_deviations(inverse).reshape(-1, 4),
            np.full((len(model.bodies), 10), np.nan),
            condition)


def statistics(A: Array, model: Model, x: Array, speeds: Array, weight: float
               ) -> tuple[Array, Array, float]:
    """
    Return standard deviations of the unknowns and the condition number.

    Parameters
    ----------
    A : (m, 10 bodies + 4 n) array
        Equations, each divided by its standard deviation.
    model : Model
        Its inertials are the prior.
    x : (10 bodies + 4 n,) array
        Identified values.
    speeds : (n,) array
        Friction speed of each joint, rad/s or m/s.
    weight : float
        Weight of the prior.

    Returns
    -------
    (n, 4) array
        Standard deviations of damping, friction, armature and offset.
    (bodies, 10) array
        Standard deviations of inertial parameters; NaN if not identifiable by
        themselves.
    float
        Condition number of the equations with the prior, columns scaled to unit length.

    """
    size = 10 * len(model.bodies)
    # The metric of the prior, block by block, and the distance of the result from it.
    G = np.zeros((A.shape[1], A.shape[1]))
    for k, body in enumerate(model.bodies):
        block = slice(10 * k, 10 * k + 10)
        G[block, block] = prior_metric(body.inertial)
    change = np.zeros(A.shape[1])
    change[:size] = x[:size] - np.concatenate([prior_parameters(body.inertial)
                                               for body in model.bodies])
    # Information of the data and of the prior; P is the covariance of both.
    information = A.T @ A
    P, condition = _inverse(information + weight * G)
    # The unknowns that the data determine, and how much farther than expected the prior
    # was moved.
    determined_count = max(size - weight * float(np.trace(P @ G)), 1.0)
    overdone = max(1.0, weight * float(change @ G @ change) / determined_count)
    # The covariance of the estimate, with the bias of the prior as variance.
    every = _deviations(P @ (information + weight * overdone * G) @ P)
    # Base parameters alone can be stated singly; others are undetermined.
    base = base_parameters(model, speeds)
    single = np.full(A.shape[1], np.nan)
    single[base.columns] = np.maximum(base_deviations(A[:, base.columns]),
                                      every[base.columns])
    single[~base.single] = np.nan
    return every[size:].reshape(-1, 4), single[:size].reshape(-1, 10), condition


def _inverse(information: Array) -> tuple[Array, float]:
    """Return the inverse of an information matrix, and the condition of its scaled equations."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information / np.outer(scale, scale)
    return (np.asarray(np.linalg.pinv(scaled) / np.outer(scale, scale)),
            float(np.sqrt(np.linalg.cond(scaled))))


def _deviations(covariance: Array) -> Array:
    """Return the standard deviations of unknowns with this covariance."""
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 0.0)))
