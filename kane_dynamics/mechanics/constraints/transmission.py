"""
The transmission of a mechanism to some of its joints: whether these determine its motion.

With q' = T u and scaled coordinates, the squared ratio of the rates of all joints to those of some
of them, P q', is between 1 and the largest eigenvalue of (T^T P T)^-1 T^T T. Its trace bounds that
eigenvalue and does not depend on the choice of independent speeds. Where it is infinite, a motion
exists in which these joints rest: actuators there produce no force along it.
"""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.constraints.conditioning import described
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np

MOST = 1e3  # largest ratio of the rates of all joints to those of some


def transmission_margin(mechanism: Mechanism, T: Any, places: Sequence[int]) -> Any:
    """
    Return 1 minus the squared ratio relative to `MOST`, positive where it is accepted.

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
    scaled = T * (1.0 / mechanism.units)[:, None]
    whole, part = (x.T @ x for x in (scaled, scaled[list(places)]))
    order = list(range(n))
    try:
        factors = factorize(part, order)
    except ZeroDivisionError:
        raise ConstraintError(f'{_names(mechanism, places)}: these joints do not determine the '
                              'motion in any configuration; expected others') from None
    ratio_2 = sum(solve(factors, order, whole[:, k])[k] for k in order)
    return 1.0 - ratio_2 * MOST**-2


def require_transmission(mechanism: Mechanism, T: Array, places: Sequence[int], actuated: bool,
                         q: Array, where: str = '', share: float = 1.0) -> None:
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
    if not T.shape[1] or len(places) == len(T):
        return
    scaled = T / mechanism.units[:, None]
    with np.errstate(all='ignore'):
        smallest = np.linalg.svd(scaled[list(places)] @ np.linalg.pinv(scaled),
                                 compute_uv=False)[:T.shape[1]]
        ratio = float(np.sqrt((smallest**-2.0).sum()))
    if ratio < share * MOST:
        return
    names, at = _names(mechanism, places), described(mechanism, q)
    many = f'{ratio:.3g} times as fast as these joints' if ratio < 1e12 else 'while these rest'
    what = (f'actuated: {names} cannot produce every motion at {at}, a singular configuration of '
            'the actuation' if actuated else
            f'followed: {names} do not determine the motion at {at}')
    raise ConstraintError(f'{where}{what}: the mechanism moves {many}; expected at most '
                          f'{MOST:g} times; choose '
                          f'{"more actuators" if actuated else "other joints"}, or stay away from '
                          'that configuration')


def _names(mechanism: Mechanism, places: Sequence[int]) -> str:
    return ', '.join(mechanism.model.joint_names[k] for k in places)
