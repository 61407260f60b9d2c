"""Inertia and bias of a robot as felt at a frame: the dynamics in operational space."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.robot.dispatch import Dispatch
import numpy as np
from numpy.typing import ArrayLike

DIRECTIONS = ('x', 'y', 'z', 'rx', 'ry', 'rz')  # linear, then angular, world axes
SINGULAR = 1e12  # a condition number of J M^-1 J^T at which a direction counts as impossible


class OperationalSpace(Dispatch):
    """
    The calls of a `Robot` for control in the space of a frame's motion.

    ``F = Lambda a + mu`` is what must act at the frame, in the chosen directions, for the
    acceleration a: ``Lambda = (J M^-1 J^T)^-1`` and ``mu = Lambda (J M^-1 h - J' u)``, with J the
    frame's Jacobian and h the bias force. Source: O. Khatib, "A unified approach for motion and
    force control of robot manipulators: the operational space formulation", IEEE J. Robotics and
    Automation 3(1), 1987.
    """

    def operational_space_inertia(self, frame: str, q: ArrayLike, *,
                                  directions: Sequence[str] = DIRECTIONS,
                                  t: ArrayLike = 0.0) -> Array:
        """
        Return Lambda, (k, k), at a frame: kg, kg m, kg m^2.

        Parameters
        ----------
        frame : str
            One of `frame_names`.
        q : (n_q,) or (N, n_q) array_like
            Coordinates, rad or m.
        directions : sequence of str
            The k directions, of 'x', 'y', 'z' (linear) and 'rx', 'ry', 'rz' (angular), world
            axes. All six by default, which takes at least six joints.
        t : float or (N,) array_like
            Time, s; ignored unless speeds or constraints depend on it.

        Raises
        ------
        InputError
            Names the argument; or the frame cannot accelerate in all of the directions at q.

        """
        return np.asarray(np.linalg.inv(self._mobility(frame, q, directions, t)[0]), np.float64)

    def operational_space_bias(self, frame: str, q: ArrayLike, u: ArrayLike, *,
                               directions: Sequence[str] = DIRECTIONS,
                               t: ArrayLike = 0.0) -> Array:
        """
        Return mu, (k,), at a frame: N, N m; arguments and errors as `operational_space_inertia`.

        Gravity, friction and springs are part of it, as they are of `bias_force`.
        """
        mobility, J, inverse, rows = self._mobility(frame, q, directions, t)
        robot: Any = self
        rest = np.zeros_like(np.asarray(u, dtype=np.float64))
        bias = robot.bias_force(q, u, t=t)[..., None]
        drift = robot.frame_acceleration(frame, q, u, rest, t=t)[..., rows, None]
        result: Array = np.linalg.solve(mobility, J @ (inverse @ bias) - drift)[..., 0]
        return result

    def _mobility(self, frame: str, q: ArrayLike, directions: Sequence[str],
                  t: ArrayLike) -> tuple[Array, Array, Array, list[int]]:
        """Return J M^-1 J^T, J, M^-1, and the rows of J that are asked for."""
        wrong = [name for name in directions if name not in DIRECTIONS]
        if wrong or not len(directions) or len(set(directions)) < len(directions):
            raise InputError(f'directions: {list(directions)}; expected some of '
                             f'{", ".join(DIRECTIONS)}, each once')
        rows = [DIRECTIONS.index(name) for name in directions]
        robot: Any = self
        J = robot.jacobian(frame, q, t=t)[..., rows, :]
        inverse = robot.inverse_mass_matrix(q, t=t)
        mobility = J @ inverse @ np.swapaxes(J, -1, -2)
        size = np.linalg.svd(mobility, compute_uv=False)
        lost = (size < size[..., :1] / SINGULAR) | (size == 0.0)
        if lost.any():
            able = int((~lost).sum(axis=-1).min())
            raise InputError(f"directions: {', '.join(directions)}; frame '{frame}' accelerates "
                             f'independently in only {able} of these {len(rows)} at this q: '
                             'expected fewer directions, or a q that is not singular')
        return mobility, J, inverse, rows
