"""Torque breakdown: inverse dynamics by source and by body."""

from __future__ import annotations

from dataclasses import dataclass

from kane_dynamics._util.notebook import html_table
from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.recursive.tree_equations import TORQUE_TERMS
import numpy as np

SOURCES = (*TORQUE_TERMS, 'external')


@dataclass(frozen=True, eq=False)
class TorqueBreakdown:
    """
    Inverse dynamics by source and by body.

    Attributes
    ----------
    by_source : (6, n) or (N, 6, n) array
        Rows as `sources`, which add up to inverse dynamics; N m or N. Armature belongs
        to inertia, centrifugal forces to coriolis; external is minus the generalized
        force of the wrenches.
    by_body : (n_bodies, n) or (N, n_bodies, n) array
        Torque of each body's inertia and weight at every joint, and of a beam's
        elasticity and material damping. The rows, as `bodies`, add up to the torque
        without what belongs to joints: armature, springs, friction and external
        wrenches.
    sources, bodies : tuple of str
    joints : tuple of str
        Names of the columns.

    """

    by_source: Array
    by_body: Array
    sources: tuple[str, ...]
    bodies: tuple[str, ...]
    joints: tuple[str, ...]

    def __repr__(self) -> str:
        """Return the sources and their largest torques on one line."""
        states = ''
        sizes = np.abs(self.by_source)
        # Of several states, the largest torque of each source.
        if sizes.ndim == 3:
            states = f'{len(sizes)} states, '
            sizes = sizes.max(axis=0)
        largest = sizes.max(axis=1)
        named = zip(self.sources, largest)
        shares = ', '.join(f'{name} {value:.4g}' for name, value in named)
        return f'<TorqueBreakdown: {states}{len(self.joints)} joints, up to {shares}>'

    def _repr_html_(self) -> str:
        """Return torques by source as a table for notebooks; of a batch, the largest."""
        values = self.by_source
        title = 'torque by source, N m or N'
        if values.ndim == 3:
            title = f'largest torque by source of {len(values)} states, N m or N'
            values = np.abs(values).max(axis=0)
        rows = [[joint, *values[:, k]] for k, joint in enumerate(self.joints)]
        return html_table(title, ['joint', *self.sources], rows)

    @property
    def torque(self) -> Array:
        """Return the total torque, (n,) or (N, n)."""
        total: Array = self.by_source.sum(axis=-2)
        return total

    def source(self, name: str) -> Array:
        """Return the torque of one source, (n,) or (N, n)."""
        share: Array = self.by_source[..., self.sources.index(name), :]
        return share
