"""The closed configuration on a given branch, followed in small steps."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.constraints.conditioning import stacked
from kane_dynamics.mechanics.constraints.independent_speeds import closed_posture, STRIDE
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np

SMALL = 0.05  # rad, or lengths of the mechanism: steps along a branch


def followed_posture(mechanism: Mechanism, start: Any, q: Any, *, t: float = 0.0,
                     fixed: Sequence[str] = ()) -> Array:
    """
    Return the closed posture on the branch of another one.

    The fixed coordinates go there from their values at the start in small steps, and the others
    follow.

    Parameters
    ----------
    mechanism : Mechanism
        Whose conditions to meet.
    start : (n_q,) array
        A closed posture, rad or m; it says which branch is meant.
    q : (n_q,) array
        Of it the values of the fixed coordinates count.
    t, fixed
        As in `closed_posture`.

    Raises
    ------
    ConstraintError
        None is found, or the loops jump: another branch begins on the way.

    """
    here = closed_posture(mechanism, start, t=t, fixed=())
    names = mechanism.model.coordinate_names
    unknown = sorted(set(fixed) - set(names))
    if unknown:
        raise ConstraintError(f'no coordinate {unknown[0]!r}; valid: {", ".join(names)}')
    places = [k for k, name in enumerate(names) if name in fixed]
    first, last = here[places], np.asarray(q, dtype=np.float64)[places]
    way = np.abs(last - first) / mechanism.units[places]
    count = int(np.ceil(way.max(initial=0.0) / SMALL)) or 1
    units, side = np.eye(len(names))[places], 0.0
    for share in np.arange(1, count + 1) / count:
        ahead = here.copy()
        ahead[places] = first + share * (last - first)
        closed = closed_posture(mechanism, ahead, t=t, fixed=fixed)
        moved = np.abs(closed - here) / mechanism.units
        worst = int(np.argmax(moved))
        before, side = side, 0.0
        if len(places) == mechanism.n:
            J = stacked(mechanism, closed, t).J[mechanism.kept]
            side = float(np.sign(np.linalg.det(np.concatenate([units, J]))))
        if moved[worst] > STRIDE or before * side < 0.0:
            raise ConstraintError(
                f"no posture on this branch: with {', '.join(fixed)} at {ahead[places].tolist()} "
                f"'{names[worst]}' jumps by {abs(closed - here)[worst]:.3g} rad or m; the branch "
                'ends there')
        here = closed
    return here
