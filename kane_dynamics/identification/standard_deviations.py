"""
How sure identified numbers are, the pull of the prior included.

With P = (A^T A + w G)^-1 and prior deviations d = truth less what one began with, the estimate is
off by P (A^T e - w G d): by the noise e, and by the prior's pull towards what one began with. If
w says rightly how near that is to the truth, d has the covariance (w G)^-1, and the error has P.
But the weight is chosen to predict well, and may believe more in the model than what is found
bears out. By the evidence (MacKay, Neural Computation 4 (1992), "Bayesian interpolation") the
weight that the data bear out is the number of parameters that they tell over the squared
distance found; where the one used is larger, d counts for as much more:

    covariance = P (A^T A + w max(1, w distance / told) G) P.
"""

from kane_dynamics._util.typing import Array
from kane_dynamics.identification.base_regressor import base_deviations, base_parameters
from kane_dynamics.identification.physical_consistency import prior_metric, prior_parameters
from kane_dynamics.model.model import Model
import numpy as np


def friction_statistics(A: Array, model: Model) -> tuple[Array, Array, float]:
    """Return what `statistics` does if the inertials are given: of these all is NaN."""
    information = A.T @ A
    own = slice(10 * len(model.bodies), None)
    inverse, condition = _inverse(information[own, own])
    return (_deviations(inverse).reshape(-1, 4), np.full((len(model.bodies), 10), np.nan),
            condition)


def statistics(A: Array, model: Model, x: Array, speeds: Array, weight: float
               ) -> tuple[Array, Array, float]:
    """
    Return how sure the unknowns are.

    Parameters
    ----------
    A : (m, 10 bodies + 4 n) array
        Equations, each divided by its standard deviation.
    model : Model
        Whose inertials are the prior.
    x : (10 bodies + 4 n,) array
        What was found.
    speeds : (n,) array
        At which each joint's Coulomb friction sets in, rad/s or m/s.
    weight : float
        Of the prior.

    Returns
    -------
    (n, 4) array
        Standard deviations of damping, friction, armature and offset.
    (bodies, 10) array
        Of inertial parameters, NaN for those that torques do not tell by themselves.
    float
        Condition number of the equations with the prior, columns scaled to unit length.

    """
    size = 10 * len(model.bodies)
    G = np.zeros((A.shape[1], A.shape[1]))
    for k, body in enumerate(model.bodies):
        block = slice(10 * k, 10 * k + 10)
        G[block, block] = prior_metric(body.inertial)
    change = np.zeros(A.shape[1])
    change[:size] = x[:size] - np.concatenate([prior_parameters(body.inertial)
                                               for body in model.bodies])
    information = A.T @ A
    P, condition = _inverse(information + weight * G)
    told = max(size - weight * float(np.trace(P @ G)), 1.0)
    overdone = max(1.0, weight * float(change @ G @ change) / told)
    every = _deviations(P @ (information + weight * overdone * G) @ P)
    base = base_parameters(model, speeds)
    single = np.full(A.shape[1], np.nan)
    single[base.columns] = np.maximum(base_deviations(A[:, base.columns]), every[base.columns])
    single[~base.single] = np.nan
    return every[size:].reshape(-1, 4), single[:size].reshape(-1, 10), condition


def _inverse(information: Array) -> tuple[Array, float]:
    """Return the inverse of an information matrix, and the condition of its equations, scaled."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information / np.outer(scale, scale)
    return (np.asarray(np.linalg.pinv(scaled) / np.outer(scale, scale)),
            float(np.sqrt(np.linalg.cond(scaled))))


def _deviations(covariance: Array) -> Array:
    """Return standard deviations."""
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 0.0)))
