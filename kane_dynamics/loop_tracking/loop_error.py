"""`LoopError`: why a configuration does not follow from measured joints."""

from __future__ import annotations

from kane_dynamics.errors import ConstraintError

SINGULAR = 'closed loop near a singular configuration'
BRANCH = 'closed loop on a lost branch'
CONTRADICTION = 'measured joints contradict the closed loop'
UNKNOWN = 'assembly mode unknown'
CONTRADICTORY_POINT = 'point of the trajectory contradicts the closed loop'


class LoopError(ConstraintError):
    """
    The configuration does not follow from the measured joints.

    Attributes
    ----------
    reason : str
        `SINGULAR`, `BRANCH`, `CONTRADICTION`, `UNKNOWN` or `CONTRADICTORY_POINT`.
    detail : str
        The numbers, and what is expected.

    """

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f'{reason}: {detail}')
        self.reason = reason
        self.detail = detail
