"""
An effort loop that does what joint_trajectory_controller's documentation says.

Interpolation: docs.ros.org/en/jazzy/p/joint_trajectory_controller/doc/trajectory.html. Positions
alone are interpolated linearly, with velocities by cubics, with accelerations too by quintics, and
efforts linearly. If the first point is later than now, a first segment leads to it from the
measured state. After the last point it is held. Control law (doc/userdoc.html, "effort" without
"position"): PID on the errors of position and velocity, plus the trajectory's effort.

Run as a program, it drives the topics of a robot; scipy interpolates, so that it shares nothing
with the code that it tests.
"""

from dataclasses import dataclass
import sys
import time

import numpy as np
from scipy.interpolate import BPoly


@dataclass
class Gains:
    """Parameters gains.<joint>.p, i, d and ff_velocity_scale, (n,) arrays or numbers."""

    p: object = 0.0
    i: object = 0.0
    d: object = 0.0
    ff_velocity_scale: object = 0.0


class Spline:
    """The sampled trajectory; fields that a trajectory lacks are None."""

    def __init__(self, t, q, u=None, udot=None, effort=None):
        self.t, self.q, self.effort = np.asarray(t), np.asarray(q), effort
        fields = [field for field in (q, u, udot) if field is not None]
        self._curve = None if len(t) < 2 else BPoly.from_derivatives(
            self.t, np.stack(fields, axis=1))
        self._last = [np.asarray(q)[-1],
                      np.zeros_like(q[-1]) if u is None else np.asarray(u)[-1]]

    def sample(self, t):
        """Return desired position, velocity and effort."""
        effort = 0.0 if self.effort is None else np.array(
            [np.interp(t, self.t, column) for column in np.transpose(self.effort)])
        if self._curve is None or t >= self.t[-1]:
            return *self._last, effort
        t = max(t, self.t[0])
        return self._curve(t), self._curve(t, 1), effort


class EffortLoop:
    """
    The controller with command interface `effort` and state interfaces `position`, `velocity`.

    `ahead` is the time by which the effort is sampled after the state, s: the period in versions
    from 4.17 on ("Sample at t + dT instead of the beginning of the control cycle"), else 0.
    """

    def __init__(self, gains, ahead=0.0):
        self.gains, self._ahead = gains, ahead
        self._spline, self._sum, self._start = None, 0.0, 0.0

    def accept(self, start, q, t, points, u=None, udot=None, effort=None):
        """Execute a trajectory from `start`, s; q is the measured position."""
        if t[0] > 0.0:  # from the measured state, at rest; the first segment has no effort
            def with_first(field, first):
                return None if field is None else np.vstack([first, field])
            rest = np.zeros_like(q)
            t, points = np.concatenate([[0.0], t]), np.vstack([q, points])
            u, udot, effort = (with_first(field, rest) for field in (u, udot, effort))
        self._spline, self._start = Spline(t, points, u, udot, effort), start

    def desired(self, now):
        """Return the desired position."""
        return self._spline.sample(now - self._start)[0]

    def update(self, now, period, q, u):
        """Return the effort command."""
        if self._spline is None:
            return None
        q_d, u_d, _ = self._spline.sample(now - self._start)
        _, ahead, effort = self._spline.sample(now - self._start + self._ahead)
        error = q_d - q
        self._sum = self._sum + error * period
        return (effort + self.gains.ff_velocity_scale * ahead + self.gains.p * error
                + self.gains.i * self._sum + self.gains.d * (u_d - u))
