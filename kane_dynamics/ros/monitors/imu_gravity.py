"""
Estimate the direction of gravity from an IMU on the base of the arm.

At rest an accelerometer measures the specific force f = -g, so that g = -R f in world
axes, where R is the rotation of the IMU. Only the direction is used, because
accelerometers have scale errors; the magnitude is that of parameter `gravity`.
"""

from collections.abc import Callable
import math

from kane_dynamics.errors import InputError
from kane_dynamics.model.model import Model, WORLD
from kane_dynamics.ros.common.conversion import Array, NANO, nanoseconds
from kane_dynamics.ros.common.transform_tree import TransformTree
import numpy as np
from sensor_msgs.msg import Imu

REST_FORCE = 0.05  # largest deviation of |f| from |g| at rest, relative to |g|
REST_RATE = 0.05   # largest angular velocity at rest, rad/s
SETTLED = 1.0      # time at rest before the direction is used, time constants
GAP = 3.0          # time without a valid message that resets the filter, time constants
STEP = 1e-3        # smallest change of gravity that is applied, relative to |g|


class GravityFromImu:
    """
    Low-pass filter of the direction of gravity, updated in the services' thread.

    The frame of a message has to be fixed to the base.

    Parameters
    ----------
    model : Model
    magnitude : float
        Magnitude of gravity, m/s^2.
    time_constant : float
        Time constant of the filter, s.
    use : callable
        Called with gravity, (3,) m/s^2 in world axes, after each change.
    transforms : TransformTree, optional
        Finds frames that the model lacks.

    Raises
    ------
    InputError
        The magnitude is zero.

    """

    def __init__(self, model: Model, magnitude: float, time_constant: float,
                 use: Callable[[Array], None],
                 transforms: TransformTree | None = None) -> None:
        self._model = model
        self._find_frame = model.frame if transforms is None else transforms.frame
        self._magnitude = magnitude
        self.time_constant = time_constant
        self._use = use
        if magnitude == 0.0:
            raise InputError("parameter 'gravity': zero; expected a magnitude above "
                             'zero, as the IMU gives the direction only')
        self._filtered: Array | None = None
        self._used = np.zeros(3)
        self._first = self._last = 0

    def update(self, message: Imu, now: int) -> None:
        """
        Update the filter with one message; `now`, ns, replaces a stamp of zero.

        Raises
        ------
        InputError
            The message does not determine the direction of gravity; it is ignored.

        """
        f = self._force_at_rest(message)
        # At rest an accelerometer shows minus gravity.
        g = -self._magnitude / float(np.linalg.norm(f)) * f
        stamp = nanoseconds(message.header.stamp) or now
        elapsed = (stamp - self._last) / NANO
        follows = self._last > 0
        if self._filtered is None or not 0.0 <= elapsed <= GAP * self.time_constant:
            self._filtered = g
            self._first = stamp
        else:
            # The exact low-pass filter of a sample that holds since the previous one.
            share = -math.expm1(-elapsed / self.time_constant)
            self._filtered = self._filtered + share * (g - self._filtered)
        self._last = stamp
        if follows and elapsed > GAP * self.time_constant:
            raise InputError(f'time since the previous message: {elapsed:.3g} s; '
                             f'expected at most {GAP * self.time_constant:g} s')
        if (stamp - self._first) / NANO >= SETTLED * self.time_constant:
            # The filtered vector is shorter while the direction changes: only its
            # direction is used.
            scale = self._magnitude / float(np.linalg.norm(self._filtered))
            gravity = scale * self._filtered
            if np.abs(gravity - self._used).max() > STEP * self._magnitude:
                self._used = gravity
                self._use(gravity)

    def _force_at_rest(self, message: Imu) -> Array:
        """Return the specific force at rest, (3,) m/s^2 in world axes."""
        if message.linear_acceleration_covariance[0] == -1.0:
            raise InputError('acceleration of the IMU: not measured (covariance -1); '
                             'expected an accelerometer')
        a = message.linear_acceleration
        w = message.angular_velocity
        # At rest the accelerometer measures the force that holds it: minus gravity, of
        # known magnitude.
        force = np.array([a.x, a.y, a.z])
        size = math.hypot(a.x, a.y, a.z)
        if not abs(size - self._magnitude) <= REST_FORCE * self._magnitude:
            raise InputError(f'acceleration of the IMU: {size:.3g} m/s^2; expected '
                             f'{self._magnitude:.3g} within {REST_FORCE:.0%} at rest')
        # A covariance of -1 says that the angular velocity is not measured.
        turn = math.hypot(w.x, w.y, w.z)
        if message.angular_velocity_covariance[0] != -1.0 and not turn <= REST_RATE:
            raise InputError(f'angular velocity of the IMU: {turn:.3g} rad/s; expected, '
                             f'at rest, at most {REST_RATE:g} rad/s')
        world: Array = self._rotation(message.header.frame_id) @ force
        return world

    def _rotation(self, name: str) -> Array:
        """Return the rotation of a frame fixed to the base."""
        frame = self._find_frame(name)
        if frame.body != WORLD:
            expected = ', '.join(sorted(fixed.name for fixed in self._model.frames
                                        if fixed.body == WORLD))
            raise InputError(f"frame of the IMU: '{name}', which moves; expected one "
                             f'fixed to the base: {expected}')
        return frame.rotation
