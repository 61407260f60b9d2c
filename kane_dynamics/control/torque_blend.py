"""Continuous torque across a change of the control law."""

from kane_dynamics._util.typing import Array, Scalar
import numpy as np


def share_left(x: Scalar) -> Scalar:
    """Return the share of the difference that is left after x, 0 to 1, of the time."""
    return 1.0 - x * x * (3.0 - 2.0 * x)


class TorqueBlend:
    """
    Lets the torque go on from the last command where the control law changes.

    The difference between the last command and the new law is added to the new law, and
    vanishes along a cubic without a slope at both ends.

    Attributes
    ----------
    duration : float
        s; 0: the new law takes effect at once.
    active : bool
        Whether a difference has not vanished yet.

    """

    def __init__(self) -> None:
        self.duration = 0.0
        self.stop()

    def begin(self) -> None:
        """Begin at the next torque."""
        self.active = self.duration > 0.0
        self._difference: Array | None = None

    def stop(self) -> None:
        """Use the law alone."""
        self.active = False
        self._difference = None

    def apply(self, t: float, tau: Array, last: Array | None) -> Array:
        """
        Return the torque, (n,), for that of the new law at stamp `t`, s.

        Parameters
        ----------
        t : float
            s, on any clock; the time begins again with an earlier stamp.
        tau : (n,) array
            Of the new law, N m or N.
        last : (n,) array or None
            The last command; None: there was none, so the law is used alone.

        """
        if last is None:
            self.stop()
            return tau
        # The first torque of the new law fixes the step that is blended out.
        if self._difference is None:
            if not np.isfinite(tau).all():  # of a state that is refused
                return tau
            self._difference = last - tau
            self._began = t
        # A stamp before the begin (a clock that was reset) begins again.
        self._began = min(self._began, t)
        x = (t - self._began) / self.duration
        if x >= 1.0:
            self.stop()
            return tau
        blended: Array = tau + share_left(x) * self._difference
        return blended
