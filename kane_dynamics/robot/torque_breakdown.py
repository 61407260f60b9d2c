"""Torque breakdown: inverse dynamics by source and by body."""

from dataclasses import dataclass

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.recursive.tree_equations import TORQUE_TERMS

SOURCES = (*TORQUE_TERMS, 'external')


@dataclass(frozen=True, eq=False)
class TorqueBreakdown:
    """
    Inverse dynamics by source and by body.

    Attributes
    ----------
    by_source : (6, n) or (N, 6, n) array
        Rows as `sources`, which add up to inverse dynamics; N m or N. Armature
        belongs to inertia, centrifugal forces to coriolis; external is minus the generalized
        force of the wrenches.
    by_body : (n_bodies, n) or (N, n_bodies, n) array
        Torque of each body's inertia and weight at every joint, and of a beam's elasticity and
        material damping. The rows, as `bodies`, add up to the torque without what belongs to
        joints: armature, springs, friction and external wrenches.
    sources, bodies : tuple of str
    joints : tuple of str
        Names of the columns.

    """

    by_source: Array
    by_body: Array
    sources: tuple[str, ...]
    bodies: tuple[str, ...]
    joints: tuple[str, ...]

    @property
    def torque(self) -> Array:
        """Return the total torque, (n,) or (N, n)."""
        total: Array = self.by_source.sum(axis=-2)
        return total

    def source(self, name: str) -> Array:
        """Return the torque of one source, (n,) or (N, n)."""
        share: Array = self.by_source[..., self.sources.index(name), :]
        return share
