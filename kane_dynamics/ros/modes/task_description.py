"""Records of a cycle of a law, for ~/task_state."""

from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
import numpy as np


class TaskSnapshot(NamedTuple):
    """
    State of a law in one cycle; the next cycle does not change it.

    Attributes
    ----------
    desired : (4, 4) array or None
        The pose that the law uses; None without one.
    target_age : float
        s since the last message that moved the target; negative: none.
    detail : object
        Of the law itself.

    """

    desired: Array | None = None
    target_age: float = -1.0
    detail: Any = None


class TaskDescription(NamedTuple):
    """
    Wrench and saturation of a law at a state.

    Attributes
    ----------
    wrench : (6,) array
        Of the law at the controlled frame, world axes, N and N m.
    saturated : list of str

    """

    wrench: Array = np.zeros(6)
    saturated: tuple[str, ...] = ()
