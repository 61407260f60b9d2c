"""Slopes of Kane's definition, by hyper-dual numbers: the reference for derivatives."""

from hyperdual import HyperDual
from kane_dynamics.mechanics.definition import kane
import numpy as np


def split(array, count):
    """Return values, gradients, rates and gradients of rates of hyper-dual numbers."""
    array = np.asarray(array, dtype=object)
    entries = []
    for x in array.ravel():
        entries.append([x.value, x.gradient, x.rate, x.gradient_rate]
                       if isinstance(x, HyperDual)
                       else [float(x), np.zeros(count), 0.0, np.zeros(count)])
    shapes = ((), (count,), (), (count,))
    return [np.array([parts[k] for parts in entries]).reshape(*array.shape, *shape)
            for k, shape in enumerate(shapes)]


def variables(value, gradient, rate=None, gradient_rate=None):
    """Return hyper-dual numbers with these parts; those of the rate default to 0."""
    value = np.asarray(value)
    gradient = np.asarray(gradient)
    rate = np.zeros(value.shape) if rate is None else np.asarray(rate)
    gradient_rate = np.zeros(gradient.shape) if gradient_rate is None else gradient_rate
    result = np.empty(value.shape, dtype=object)
    for k in np.ndindex(value.shape):
        result[k] = HyperDual(float(value[k]), gradient[k], float(rate[k]),
                              gradient_rate[k])
    return result


def solved(S, dS, s, ds):
    """Return the solution x of S x = s and its gradient."""
    x = np.linalg.solve(S, s)
    return x, np.linalg.solve(S, ds - np.einsum('ijk,j->ik', dS, x))


def slopes_of_definition(mechanism, q, u, udot, t=0.0, **forces):
    """
    Return the gradients of tau by q, u, udot and t, for a mechanism or a model.

    The definition: q' and q'' solve S q' = s and its time derivative, S = [Y_I; J] and s
    = [u - Z; b]; then tau = -T^T (F + F*) with the joint forces F of Kane's sums, T =
    dq'/du.
    """
    n_q = len(q)
    n = len(u)
    count = n_q + 2 * n + 1
    ends = np.cumsum([n_q, n, n, 1])
    e_q, e_u, e_udot, e_t = np.split(np.eye(count), ends[:-1])
    if not hasattr(mechanism, 'speeds'):  # a model: u = q'
        forces = kane.inverse_dynamics(mechanism, variables(q, e_q), variables(u, e_u),
                                       variables(udot, e_udot), **forces)
        return np.split(split(forces, count)[1], ends[:-1], axis=1)

    def system(q, t):
        Y, Z = mechanism.speeds.of(q, t)
        rows = mechanism.rows(mechanism.state(q, t))
        free = list(mechanism.free)
        dependent = list(mechanism.kept)
        S = np.concatenate(
            [np.asarray(Y, dtype=object)[free],
             np.asarray(rows.J, dtype=object).reshape(-1, n_q)[dependent]])
        s = np.concatenate([-np.asarray(Z, dtype=object)[free],
                            np.asarray(rows.b, dtype=object).reshape(-1)[dependent]])
        return split(S, count), split(s, count)
    (S, dS, *_), (s, ds, *_) = system(variables(q, e_q), variables([t], e_t)[0])
    s[:n] = s[:n] + u
    ds[:n] = ds[:n] + e_u
    qdot, dqdot = solved(S, dS, s, ds)
    (_, _, S_rate, dS_rate), (_, _, s_rate, ds_rate) = system(
        variables(q, e_q, qdot, dqdot), variables([t], e_t, [1.0])[0])
    s_rate[:n] = s_rate[:n] + udot
    ds_rate[:n] = ds_rate[:n] + e_udot
    qddot, dqddot = solved(S, dS, s_rate - S_rate @ qdot, ds_rate - np.einsum(
        'ijk,j->ik', dS_rate, qdot) - S_rate @ dqdot)
    q = variables(*(q, e_q))
    qdot = variables(*(qdot, dqdot))
    qddot = variables(*(qddot, dqddot))
    force, dforce, *_ = split(
        -kane.generalized_active_force(mechanism.model, q, qdot, **forces)
        - kane.generalized_inertia_force(mechanism.model, q, qdot, qddot), count)
    inverse = np.linalg.inv(S)
    T = inverse[:, :n]
    dT = -np.einsum('ia,abk,bj->ijk', inverse, dS, T)
    return np.split(np.einsum('ijk,i->jk', dT, force) + T.T @ dforce, ends[:-1], axis=1)
