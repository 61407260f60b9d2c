"""Base of the laws of modes that also run on the native torque path."""

from kane_dynamics._util.typing import Array
from kane_dynamics.control.traced_laws import TracedLaw
from kane_dynamics.ros.torque_path.live_law import LiveLaw
import numpy as np

NOTHING = np.zeros(0)


class NativeLaw(LiveLaw):
    """Base of the laws of modes that also run on the native torque path."""

    def traced(self) -> TracedLaw:
        """Return the law as a function over any scalar, for an arm in joint rates."""
        raise NotImplementedError

    def settings_numbers(self) -> Array:
        """Return the numbers of the law's parameters, the first settings of `traced`."""
        raise NotImplementedError

    def order_numbers(self, epoch: int) -> Array:
        """Return its further settings: what messages ask for; times are since epoch, ns."""
        return NOTHING

    def mirror(self, memory: Array, epoch: int) -> None:
        """Keep the memory of a cycle of the native thread."""
