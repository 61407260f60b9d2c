"""The layout of the arrays of a horizon."""

from typing import Any, NamedTuple

from kane_dynamics.optimal_control.stage_cost import Limits
import numpy as np

NUMBERS = 3  # at the beginning of the constants: interval, scale of the step, regularization


class Sizes(NamedTuple):
    """
    Numbers of entries.

    Attributes
    ----------
    state, directions : int
        Of a state, and of a change of it, n_x.
    torques, joints : int
        Torques, m, and joints, n_j, whose positions and rates have costs.
    multipliers : int
        What closes the loops in an interval.
    target, slopes : int
        Of a target, and of the derivatives of an interval.

    """

    state: int
    directions: int
    torques: int
    joints: int
    multipliers: int
    target: int
    slopes: int

    @property
    def row(self) -> int:
        """Return the length of a row of the path."""
        return self.state + self.torques + self.multipliers + 1

    @property
    def policy(self) -> int:
        """Return the length of a row of the policy."""
        x = self.directions
        return int(self.policy_parts[-1]) + x * (x + 1) // 2

    @property
    def policy_parts(self) -> Any:
        """Return where the parts of `backward_step.Policy` end, but the last."""
        x, m = self.directions, self.torques
        return np.cumsum([m, m * x, 1, 1, x])

    @property
    def limits(self) -> int:
        """Return the number of limits and their weights."""
        return 2 * (self.torques + self.joints)


class Constants(NamedTuple):
    """Length of an interval, scale of the step, limits, robot's parameters, regularization."""

    h: Any
    scale: Any
    limits: Limits
    parameters: Any
    regular: Any


def constants_of(block: Any, sizes: Sizes) -> Constants:
    """Return the parts of the array of constants."""
    m, n = sizes.torques, sizes.joints
    *limits, parameters = np.split(block[NUMBERS:], np.cumsum([m, m, n, n]))
    return Constants(block[0], block[1], Limits(*limits), parameters, block[2])
