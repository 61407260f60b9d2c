"""
The transmission of a mechanism to some joints: whether these determine its motion.

With q' = T u and scaled coordinates, the squared ratio of the rates of all joints to
those of some of them, P q', is between 1 and the largest eigenvalue of (T^T P T)^-1 T^T
T. Its trace bounds that eigenvalue and does not depend on the choice of independent
speeds. Where it is infinite, a motion exists in which these joints rest: actuators there
produce no force along it.
"""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.constraints.conditioning import described
from kane_dynamics.mechanics.constraints.mechanism import congruent, Mechanism
import numpy as np

LARGEST_RATIO = 1e3  # largest ratio of the rates of all joints to those of some


def transmission_margin(mechanism: Mechanism, T: Matrix,
                        places: Sequence[int]) -> Scalar:
    """
    Return 1 minus the squared ratio over that of `LARGEST_RATIO`; accepted if positive.

    Parameters
    ----------
    mechanism : Mechanism
        Its units scale the coordinates.
    T : (n_q, n) array of scalars
        Joint rates per unit of each independent speed.
    places : sequence of int
        Indices of the joints.

    Raises
    ------
    ConstraintError
        The joints do not determine the motion in any configuration.

    """
    n = T.shape[1]
    if not n or len(places) == len(T):
        return 1.0

    # The trace of (T^T P T)^-1 T^T T, in scaled coordinates.
    scaled = T * (1.0 / mechanism.units)[:, None]
    scaled_part = scaled[list(places)]
    whole = scaled.T @ scaled
    part = scaled_part.T @ scaled_part
    order = list(range(n))
    try:
        factors = factorize(part, order)
    except ZeroDivisionError:
        raise undetermined(mechanism, places) from None
    # Entry k of the diagonal needs only column k of T^T T.
    ratio_2 = sum(solve(factors, order, whole[:, k])[k] for k in order)
    return 1.0 - ratio_2 * LARGEST_RATIO**-2


def undetermined(mechanism: Mechanism, places: Sequence[int]) -> ConstraintError:
    """Return the error for joints that determine the motion in no configuration."""
    return ConstraintError(f'{_names(mechanism, places)}: these joints do not determine the '
                           'motion in any configuration; expected others')


def least_torques(T_A: Matrix, inverse_weights: Vector, force: Vector) -> Vector:
    """
    Return the torques of actuators, (k,), with a generalized force, (n,).

    They are those with the least sum of weight times torque squared:
    E T_A (T_A^T E T_A)^-1 force, with the inverse weights E.

    Parameters
    ----------
    T_A : (k, n) array of scalars
        Rates of the joints with actuators per unit of each independent speed.
    inverse_weights : (k,) array
        One over the weights.
    force : (n,) array of scalars
        Dual to the independent speeds.

    Raises
    ------
    ZeroDivisionError
        The actuators determine the motion in no configuration.

    """
    order = list(range(T_A.shape[1]))
    factors = factorize(congruent(np.diag(inverse_weights), T_A), order)
    return inverse_weights * (T_A @ solve(factors, order, force))


def require_transmission(mechanism: Mechanism, T: Array, places: Sequence[int],
                         actuated: bool, q: Array, where: str = '',
                         share: float = 1.0) -> None:
    """
    Raise ConstraintError where joints do not determine the motion, or almost so.

    Parameters
    ----------
    mechanism, T, places
        As in `transmission_margin`, numeric.
    actuated : bool
        The joints are those with actuators, else those that follow a motion.
    q : (n_q,) array
        The configuration, for the message, rad or m.
    where : str
        Begin of the message.
    share : float
        Of the largest ratio that is accepted.

    """
    n = T.shape[1]
    if not n or len(places) == len(T):
        return

    # Singular values of the map from the rates of all joints to those of some.
    scaled = T / mechanism.units[:, None]
    with np.errstate(all='ignore'):
        to_places = scaled[list(places)] @ np.linalg.pinv(scaled)
        singular_values = np.linalg.svd(to_places, compute_uv=False)[:n]
        ratio = float(np.sqrt((singular_values**-2.0).sum()))
    if ratio < share * LARGEST_RATIO:
        return

    names = _names(mechanism, places)
    at = described(mechanism, q)
    # Beyond that, a singular value is zero but for rounding.
    if ratio < 1e12:
        speed = f'{ratio:.3g} times as fast as these joints'
    else:
        speed = 'while these rest'
    # The error names the joints, the configuration and a remedy.
    if actuated:
        problem = (f'actuated: {names} cannot produce every motion at {at}, a singular '
                   'configuration of the actuation')
        remedy = 'more actuators'
    else:
        problem = f'followed: {names} do not determine the motion at {at}'
        remedy = 'other joints'
    raise ConstraintError(
        f'{where}{problem}: the mechanism moves {speed}; expected at most '
        f'{LARGEST_RATIO:g} times; choose {remedy}, or stay away from that '
        'configuration')


def _names(mechanism: Mechanism, places: Sequence[int]) -> str:
    """Return the names of joints as text."""
    return ', '.join(mechanism.model.joint_names[k] for k in places)
