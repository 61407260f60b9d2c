"""Poses, Jacobians and motion of a robot's frames, and operational-space dynamics."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.robot.methods.dispatch import of_frame
from kane_dynamics.robot.methods.dynamics_methods import DynamicsMethods
import numpy as np
from numpy.typing import ArrayLike


Frame = str | Sequence[str]  # one, or several in one call
DIRECTIONS = ('x', 'y', 'z', 'rx', 'ry', 'rz')  # linear, then angular, world axes
SINGULAR = 1e12  # condition number of J M^-1 J^T at which a direction counts as singular


class FrameMethods(DynamicsMethods):
    """The methods of `Robot` for poses and motion of frames, in world axes."""

    @of_frame('frame_pose')
    def frame_pose(self, frame: Frame, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the (4, 4) pose of a frame in the world, m."""
        return self._at_frame('frame_pose', frame, (q,), out)

    @of_frame('frame_velocity')
    def frame_velocity(self, frame: Frame, q: ArrayLike, u: ArrayLike, *,
                       t: ArrayLike = 0.0, axes: str = 'world',
                       out: Array | None = None) -> Array:
        """Return the velocity of a frame, (6,): linear, angular; axes as in `jacobian`."""
        velocity = self._at_frame('frame_velocity', frame, (q, u), out, t)
        self._turn(velocity[..., None], frame, q, axes)
        return velocity

    @of_frame('frame_acceleration')
    def frame_acceleration(self, frame: Frame, q: ArrayLike, u: ArrayLike, udot: ArrayLike,
                           *,
                           t: ArrayLike = 0.0, out: Array | None = None) -> Array:
        """Return the acceleration of a frame, (6,): linear, angular; without gravity."""
        return self._at_frame('frame_acceleration', frame, (q, u, udot), out, t)

    @of_frame('partial_velocities')
    def jacobian(self, frame: Frame, q: ArrayLike, *, t: ArrayLike = 0.0,
                 axes: str = 'world',
                 out: Array | None = None) -> Array:
        """
        Return the geometric Jacobian of a frame, (6, n): its partial velocities.

        Column r is the frame's velocity per unit of u_r, linear at the frame's origin,
        then angular, in world axes (Pinocchio's LOCAL_WORLD_ALIGNED) or the frame's own
        (LOCAL). Under constraints the columns are those of the independent speeds.

        Parameters
        ----------
        frame : str or sequence of str
            One of `frame_names`, or several, whose results are stacked: (k, 6, n). So do
            all methods of frames.
        q : (n_q,) or (N, n_q) array_like
            Coordinates, rad or m.
        t : float or (N,) array_like
            Time, s; ignored unless speeds or constraints depend on it.
        axes : {'world', 'frame'}
            The axes of the six rows; 'frame' is the body Jacobian.
        out : array, optional
            Written to and returned.

        Raises
        ------
        InputError
            Names the argument, what was given and what is expected.

        """
        J = self._at_frame('partial_velocities', frame, (q,), out, t)
        self._turn(J, frame, q, axes)
        return J

    def _turn(self, rows: Array, frame: Frame, q: ArrayLike,
              axes: str) -> None:
        """Turn rows in world axes, (..., 6, k), to the chosen axes, in place."""
        if axes not in ('world', 'frame'):
            raise InputError(f"axes: {axes!r}; expected 'world' or 'frame'")
        if axes == 'world':
            return
        # R^T J, for linear and angular rows.
        to_frame = np.swapaxes(self.frame_pose(frame, q)[..., :3, :3], -1, -2)
        rows[..., :3, :] = to_frame @ rows[..., :3, :]
        rows[..., 3:, :] = to_frame @ rows[..., 3:, :]

    @of_frame('partial_velocity_rates')
    def jacobian_rate(self, frame: str, q: ArrayLike, u: ArrayLike, *,
                      t: ArrayLike = 0.0,
                      out: Array | None = None) -> Array:
        """Return the time derivative of `jacobian` along the motion, (6, n)."""
        return self._at_frame('partial_velocity_rates', frame, (q, u), out, t)

    @of_frame('operational_space_inertia')
    def operational_space_inertia(self, frame: str, q: ArrayLike, *,
                                  directions: Sequence[str] = DIRECTIONS,
                                  t: ArrayLike = 0.0) -> Array:
        """
        Return the operational-space inertia Lambda, (k, k), at a frame.

        In kg, kg m, kg m^2. ``F = Lambda a + mu`` is the force at the frame, in the
        chosen directions, for its acceleration a: ``Lambda = (J M^-1 J^T)^-1`` and ``mu
        = Lambda (J M^-1 h - J' u)``, with the frame's Jacobian J and the bias force h.
        Source: O. Khatib, "A unified approach for motion and force control of robot
        manipulators: the operational space formulation", IEEE J. Robotics and Automation
        3(1), 1987.

        Parameters
        ----------
        frame, q, t
            As in `jacobian`.
        directions : sequence of str
            The k directions, of 'x', 'y', 'z' (linear) and 'rx', 'ry', 'rz' (angular),
            world axes. All six by default, which needs at least six joints.

        Raises
        ------
        InputError
            Names the argument; or the frame cannot accelerate in all of the directions
            at q.

        """
        return np.asarray(np.linalg.inv(self._mobility(frame, q, directions, t)[0]),
                          np.float64)

    def operational_space_bias(self, frame: str, q: ArrayLike, u: ArrayLike, *,
                               directions: Sequence[str] = DIRECTIONS,
                               t: ArrayLike = 0.0) -> Array:
        """
        Return the bias mu, (k,), of `operational_space_inertia`, N, N m.

        Arguments and errors are the same. It includes gravity, friction and springs, as
        `bias_force` does.
        """
        mobility, J, inverse, rows = self._mobility(frame, q, directions, t)
        # mu = Lambda (J M^-1 h - J' u), and J' u is the acceleration at udot = 0.
        bias = self.bias_force(q, u, t=t)[..., None]  # checks u
        rest = np.zeros_like(np.asarray(u, dtype=np.float64))
        drift = self.frame_acceleration(frame, q, u, rest, t=t)[..., rows, None]
        force = np.linalg.solve(mobility, J @ (inverse @ bias) - drift)
        return np.asarray(force[..., 0], np.float64)

    def _mobility(self, frame: str, q: ArrayLike, directions: Sequence[str],
                  t: ArrayLike) -> tuple[Array, Array, Array, list[int]]:
        """Return J M^-1 J^T, J, M^-1, and the indices of the chosen rows of J."""
        if not isinstance(directions, Iterable):
            raise InputError(f'directions: {directions!r}; expected some of '
                             f'{", ".join(DIRECTIONS)}')
        wrong = [name for name in directions
                 if not isinstance(name, str) or name not in DIRECTIONS]
        if wrong or not len(directions) or len(set(directions)) < len(directions):
            raise InputError(f'directions: {list(directions)}; expected some of '
                             f'{", ".join(DIRECTIONS)}, each once')
        # M^-1 maps forces of the frame to accelerations: J M^-1 J^T, whose rank says in
        # how many directions.
        rows = list(map(DIRECTIONS.index, directions))
        J = self.jacobian(frame, q, t=t)[..., rows, :]
        inverse = self.inverse_mass_matrix(q, t=t)
        mobility = np.asarray(J @ inverse @ np.swapaxes(J, -1, -2), np.float64)
        size = np.linalg.svd(mobility, compute_uv=False)
        lost = (size < size[..., :1] / SINGULAR) | (size == 0.0)
        if lost.any():
            able = int((~lost).sum(axis=-1).min())
            raise InputError(f"directions: {', '.join(directions)}; frame '{frame}' "
                             f'accelerates independently in only {able} of these '
                             f'{len(rows)} at this q; expected fewer directions, or a q '
                             'that is not singular')
        return mobility, J, inverse, rows
