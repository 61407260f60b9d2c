"""Poses, velocities and accelerations of a robot's frames, each by a kernel of its own."""

from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.robot.dispatch import Dispatch


class FrameMethods(Dispatch):
    """The calls of a `Robot` that tell where frames are and how they move, in world axes."""

    def frame_pose(self, frame: str, q: Any, *, out: Array | None = None) -> Array:
        """Return the (4, 4) pose of a frame in the world, m."""
        return self._at_frame('frame_pose', frame, (q,), out)

    def frame_velocity(self, frame: str, q: Any, u: Any, *, t: Any = 0.0,
                       out: Array | None = None) -> Array:
        """Return (6,): linear then angular velocity at a frame's origin, world axes."""
        return self._at_frame('frame_velocity', frame, (q, u), out, t)

    def frame_acceleration(self, frame: str, q: Any, u: Any, udot: Any, *,
                           t: Any = 0.0, out: Array | None = None) -> Array:
        """Return (6,): classical linear then angular acceleration, without gravity."""
        return self._at_frame('frame_acceleration', frame, (q, u, udot), out, t)

    def partial_velocities(self, frame: str, q: Any, *, t: Any = 0.0,
                           out: Array | None = None) -> Array:
        """Return (6, n): column r is the frame's linear then angular velocity per unit u_r."""
        return self._at_frame('partial_velocities', frame, (q,), out, t)

    def partial_velocity_rates(self, frame: str, q: Any, u: Any, *,
                               t: Any = 0.0, out: Array | None = None) -> Array:
        """Return (6, n): the time derivative of `partial_velocities` along the motion."""
        return self._at_frame('partial_velocity_rates', frame, (q, u), out, t)
