"""
The direction of gravity from an IMU on the base of the arm.

At rest an accelerometer reads the specific force f = -g, so that g = -R f in world axes, with R
the IMU's rotation in them. Only the direction is taken, since accelerometers err in scale; the
magnitude is that of parameter `gravity`.
"""

from collections.abc import Callable
import math

from kane_dynamics.errors import InputError
from kane_dynamics.model.model import Model, WORLD
from kane_dynamics.ros.common.conversion import Array, NANO, nanoseconds
import numpy as np
from sensor_msgs.msg import Imu

REST_FORCE = 0.05  # largest deviation of |f| from |g|, of |g|, that still passes for rest
REST_RATE = 0.05   # rad/s, the same for the angular velocity
SETTLED = 1.0      # time constants of rest before the direction is used
GAP = 3.0          # time constants without a good message after which it starts anew
STEP = 1e-3        # change of direction, of |g|, from which on it is handed on


class GravityFromImu:
    """
    Low-passes the direction of gravity; the services' thread calls it.

    Parameters
    ----------
    model : Model
    frame : str
        Frame of the IMU; empty: the one that each message names. It must be fixed to the base.
    magnitude : float
        Of gravity, m/s^2.
    time_constant : float
        Of the low-pass, s.
    use : callable
        Takes gravity, (3,) m/s^2 in world axes, when it has changed.

    Raises
    ------
    InputError
        There is no such frame, or it moves.

    """

    def __init__(self, model: Model, frame: str, magnitude: float, time_constant: float,
                 use: Callable[[Array], None]) -> None:
        self._model, self._frame, self._magnitude = model, frame, magnitude
        self.time_constant, self._use = time_constant, use
        if frame:
            self._rotation(frame)
        if magnitude == 0.0:
            raise InputError("parameter 'gravity' is zero; the IMU gives its direction only, so "
                             'the magnitude must not be')
        self._filtered: Array | None = None
        self._used = np.zeros(3)
        self._first = self._last = 0

    def take(self, message: Imu, now: int) -> None:
        """
        Take one message; without a stamp it is of now, ns of the node's clock.

        Raises
        ------
        InputError
            Why it says nothing of gravity; it is then left out.

        """
        f = self._force_at_rest(message)
        g = -self._magnitude / float(np.linalg.norm(f)) * f
        stamp = nanoseconds(message.header.stamp) or now
        elapsed, follows = (stamp - self._last) / NANO, self._last > 0
        if self._filtered is None or not 0.0 <= elapsed <= GAP * self.time_constant:
            self._filtered, self._first = g, stamp
        else:
            self._filtered = self._filtered + -math.expm1(-elapsed / self.time_constant) * (
                g - self._filtered)
        self._last = stamp
        if follows and elapsed > GAP * self.time_constant:
            raise InputError(f'the message before was {elapsed:.3g} s ago; valid: at most '
                             f'{GAP:g} times imu.time_constant, {self.time_constant:g} s')
        if (stamp - self._first) / NANO >= SETTLED * self.time_constant:
            found = self._magnitude / float(np.linalg.norm(self._filtered)) * self._filtered
            if np.abs(found - self._used).max() > STEP * self._magnitude:
                self._used = found
                self._use(found)

    def _force_at_rest(self, message: Imu) -> Array:
        """Return the specific force, (3,) m/s^2 in world axes, of a base at rest."""
        if message.linear_acceleration_covariance[0] == -1.0:
            raise InputError('the IMU measures no acceleration: its covariance begins with -1')
        a, w = message.linear_acceleration, message.angular_velocity
        force = np.array([a.x, a.y, a.z])
        size = math.hypot(a.x, a.y, a.z)
        if not abs(size - self._magnitude) <= REST_FORCE * self._magnitude:
            raise InputError(f'the acceleration is {size:.3g} m/s^2; valid at rest: '
                             f'{self._magnitude:.3g} within {REST_FORCE:.0%}')
        turn = math.hypot(w.x, w.y, w.z)
        if message.angular_velocity_covariance[0] != -1.0 and not turn <= REST_RATE:
            raise InputError(f'the IMU turns at {turn:.3g} rad/s; valid at rest: at most '
                             f'{REST_RATE:g} rad/s')
        world: Array = self._rotation(self._frame or message.header.frame_id) @ force
        return world

    def _rotation(self, name: str) -> Array:
        """Return the rotation of a frame that is fixed to the base."""
        frame = self._model.frame(name)
        if frame.body != WORLD:
            valid = ', '.join(sorted(each.name for each in self._model.frames
                                     if each.body == WORLD))
            raise InputError(f"the IMU's frame '{name}' moves; valid, fixed to the base: {valid}")
        return frame.rotation
