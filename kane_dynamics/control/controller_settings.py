"""The settings of `Controller`, which change between two commands."""

from __future__ import annotations

from dataclasses import replace

from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.typing import Array
from kane_dynamics.control.terms import Mode, Terms
from kane_dynamics.control.torque_limiter import TorqueLimiter
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike


class ControllerSettings:
    """Mode, compensated terms, gains and limits; the base of `Controller`."""

    robot: Robot
    _names: tuple[str, ...]  # of the commands
    _follow: tuple[str, ...]  # of the gains
    _limiter: TorqueLimiter
    _mode: Mode
    _kp: Array
    _kd: Array
    _pose: Array | None

    def update(self, *, mode: Mode | str | None = None, compensate: Terms | None = None,
               kp: ArrayLike | None = None, kd: ArrayLike | None = None,
               effort_limit: ArrayLike | None = None,
               rate_limit: ArrayLike | None = None) -> None:
        """
        Change settings between two commands; None keeps a setting.

        On an InputError no setting changes. The rate limit continues from the last command; a new
        mode holds a new pose.
        """
        if mode is not None and mode not in list(Mode):
            raise InputError(f'mode: {mode!r}; expected one of {", ".join(Mode)}')
        names = self._names
        new_kp = self._kp if kp is None else per_joint(kp, 'kp', self._follow)
        new_kd = self._kd if kd is None else per_joint(kd, 'kd', self._follow)
        effort = None if effort_limit is None else np.minimum(
            per_joint(effort_limit, 'effort_limit', names, finite=False),
            np.asarray(self.robot.limits.effort, dtype=np.float64))
        rate = None if rate_limit is None else per_joint(rate_limit, 'rate_limit', names,
                                                         finite=False)
        self._kp, self._kd = new_kp, new_kd
        self._gains = np.concatenate([new_kp, new_kd])
        if effort is not None:
            self._limiter.set_effort(effort)
        if rate is not None:
            self._limiter.set_rate(rate)
        if mode is not None and mode != self._mode:
            self._mode, self._pose = Mode(mode), None
        if compensate is not None:
            self._compensate = compensate
            # Feedback acts through M in any case; friction is added at the desired speed.
            self._back = replace(compensate, inertia=True, friction=False).weights

    @property
    def followed(self) -> tuple[str, ...]:
        """Return the names of the joints that follow motions, in the order of the gains."""
        return self._follow

    @property
    def mode(self) -> Mode:
        """Return the mode; `update` changes it."""
        return self._mode

    @property
    def compensate(self) -> Terms:
        """Return the torque terms of the command; `update` changes them."""
        return self._compensate

    @property
    def kp(self) -> Array:
        """Return the gains of the position, (n,) 1/s^2; `update` changes them."""
        return self._kp

    @property
    def kd(self) -> Array:
        """Return the gains of the speed, (n,) 1/s; `update` changes them."""
        return self._kd

    @property
    def pose(self) -> Array | None:
        """Return the positions that computed torque holds, (n,) rad or m; None with a motion."""
        return self._pose

    @property
    def effort_limit(self) -> Array:
        """Return the effort limits, (n,) N m or N: the minimum of the robot's and given ones."""
        return self._limiter.effort

    @property
    def rate_limit(self) -> Array:
        """Return the largest change of each torque, (n,) N m/s or N/s."""
        return self._limiter.rate
