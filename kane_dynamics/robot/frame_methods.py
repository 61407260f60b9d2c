"""Poses, velocities and accelerations of a robot's frames, each by a kernel of its own."""

from kane_dynamics._util.typing import Array
from kane_dynamics.robot.dispatch import Dispatch
from numpy.typing import ArrayLike


class FrameMethods(Dispatch):
    """The calls of a `Robot` that tell where frames are and how they move, in world axes."""

    def frame_pose(self, frame: str, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the (4, 4) pose of a frame in the world, m."""
        return self._at_frame('frame_pose', frame, (q,), out)

    def frame_velocity(self, frame: str, q: ArrayLike, u: ArrayLike, *, t: ArrayLike = 0.0,
                       out: Array | None = None) -> Array:
        """Return (6,): linear then angular velocity at a frame's origin, world axes."""
        return self._at_frame('frame_velocity', frame, (q, u), out, t)

    def frame_acceleration(self, frame: str, q: ArrayLike, u: ArrayLike, udot: ArrayLike, *,
                           t: ArrayLike = 0.0, out: Array | None = None) -> Array:
        """Return (6,): classical linear then angular acceleration, without gravity."""
        return self._at_frame('frame_acceleration', frame, (q, u, udot), out, t)

    def forward_kinematics(self, frame: str, q: ArrayLike, *, out: Array | None = None) -> Array:
        """Return the (4, 4) pose of a frame in the world, m; the same as `frame_pose`."""
        return self._at_frame('frame_pose', frame, (q,), out)

    def jacobian(self, frame: str, q: ArrayLike, *, t: ArrayLike = 0.0,
                 out: Array | None = None) -> Array:
        """
        Return the geometric Jacobian of a frame, (6, n): its partial velocities.

        Column r is the frame's velocity per unit of u_r, linear at the frame's origin, then
        angular, in world axes (Pinocchio's LOCAL_WORLD_ALIGNED). Under constraints the columns
        are those of the independent speeds. In axes of the frame itself, with R its rotation:
        ``(R.T @ J.reshape(2, 3, -1)).reshape(6, -1)``.

        Parameters
        ----------
        frame : str
            One of `frame_names`.
        q : (n_q,) or (N, n_q) array_like
            Coordinates, rad or m.
        t : float or (N,) array_like
            Time, s; ignored unless speeds or constraints depend on it.
        out : array, optional
            Written to and returned.

        Raises
        ------
        InputError
            Names the argument, what was given and what is expected.

        """
        return self._at_frame('partial_velocities', frame, (q,), out, t)

    def jacobian_rate(self, frame: str, q: ArrayLike, u: ArrayLike, *, t: ArrayLike = 0.0,
                      out: Array | None = None) -> Array:
        """Return the time derivative of `jacobian` along the motion, (6, n); same arguments."""
        return self._at_frame('partial_velocity_rates', frame, (q, u), out, t)

    def partial_velocities(self, frame: str, q: ArrayLike, *, t: ArrayLike = 0.0,
                           out: Array | None = None) -> Array:
        """Return (6, n), as `jacobian`: column r is the frame's velocity per unit u_r."""
        return self._at_frame('partial_velocities', frame, (q,), out, t)

    def partial_velocity_rates(self, frame: str, q: ArrayLike, u: ArrayLike, *,
                               t: ArrayLike = 0.0, out: Array | None = None) -> Array:
        """Return (6, n), as `jacobian_rate`: the time derivative of `partial_velocities`."""
        return self._at_frame('partial_velocity_rates', frame, (q, u), out, t)
