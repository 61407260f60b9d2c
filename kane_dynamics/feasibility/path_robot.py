"""
A robot along a path: the sections of the path, their limits, and the motion along them.

A path is that of the driving joints, which for a tree in joint rates are all joints.
Other joints follow by loop closure: with the path parameter s as the time, q_s are rates
and q_ss accelerations of all joints. Between the points of the motion the driving joints
move along quintics, and loops are closed at every place at which the limits are checked.
"""

from collections.abc import Callable
from functools import partial

from kane_dynamics._util.checks import finite_row
from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque import followed_joints
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.path_geometry import (path_of, Section, sections)
from kane_dynamics.feasibility.path_limits import (Bounds, PathLimits)
from kane_dynamics.feasibility.path_timing import (SectionMotion)
from kane_dynamics.feasibility.samples import ROUNDING
from kane_dynamics.feasibility.segment_peaks import (SegmentPeaks)
from kane_dynamics.feasibility.torque_demand import require_scalable
from kane_dynamics.loop_tracking.driven_mechanism import DrivenLoops, motion_of_closed
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.motion.free_spline import free_kernels as compile_free_spline
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.points import point_times
from kane_dynamics.motion.uniform_spline import uniform_kernels as compile_uniform_spline
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

NO_MOTION = 1e-11  # rate of a joint that does not move, relative to the largest rate


class PathRobot:
    """
    A robot along a path of its driving joints.

    Parameters
    ----------
    robot : Robot
        Its constraints are those of positions.
    path : Motion or (K, n) array_like
        As in `time_optimal`.
    bounds : Bounds
        The limits of all joints.
    rest
        As in `time_optimal`.

    Attributes
    ----------
    names : tuple of str
        Of all joints.
    motion : Motion
        A motion along the path, whose timing is ignored.
    driving : list of int or None
        Indices of the driving joints; None for all joints of a tree in joint rates.

    Raises
    ------
    InputError
        The joints are others or not as many as independent speeds, constraints are those
        of velocities, or speeds or constraints prescribe velocities or are functions of
        time.

    """

    def __init__(self, robot: Robot, path: Motion | ArrayLike, bounds: Bounds,
                 rest: ArrayLike | None = None) -> None:
        self.robot = robot
        self.bounds = bounds
        self.names = robot.joint_names
        self.driving: list[int] | None = None
        self._rest: Array | None = None
        # Only joints that follow others have a configuration to begin from.
        if rest is not None and robot.n == robot.n_q:
            raise InputError('rest: given for a robot without constraints; expected None')
        # Trees follow the path by themselves; closed loops by their driving joints.
        if robot.equations.in_joint_rates:
            self.motion = path_of(path, self.names)
        else:
            self._require_mechanism(path, rest)

    def _require_mechanism(self, path: Motion | ArrayLike, rest: ArrayLike | None
                           ) -> None:
        """Check and set the path of a robot with chosen speeds or constraints."""
        robot = self.robot
        require_scalable(robot, np.zeros((0, robot.n_q)))
        coordinates = robot.coordinate_names
        # A motion names its joints; waypoints are of the joints that robots with chosen
        # speeds follow.
        if isinstance(path, Motion):
            joints = path.joint_names
        else:
            joints = tuple(coordinates[k] for k in followed_joints(robot))
        if not set(joints) <= set(coordinates) or len(joints) != robot.n:
            raise InputError(f'path: joints {list(joints)}; expected {robot.n} of '
                             f'{", ".join(coordinates)}, as many as independent speeds')
        self.motion = path_of(path, joints)
        self.driving = list(map(coordinates.index, joints))
        if rest is not None:
            self._rest = finite_row(rest, 'rest', coordinates)
        self._loops = DrivenLoops(robot, joints)

    def sections(self, points: int, ends: tuple[bool, bool]) -> list[Section]:
        """Return the sections of the path, of all joints; as the function `sections`."""
        # The sections of the driving joints, then all joints from closed loops along
        # each.
        parts = sections(self.motion, points, 2, ends)
        if self.driving is None:
            return parts
        whole, start = [], None
        for part in parts:
            q = np.empty((len(part.q), self.robot.n_q))
            q[:, self.driving] = part.q
            # Each section continues on the branch on which the previous one ended.
            if start is None:
                start = self._begin(part.q[0])
            q = self._loops.followed(start, q, np.zeros(len(q)),
                                     partial(self._place, q))
            start = q[-1]
            whole.append(self._of_all_joints(part, q, self.driving))
        return whole

    def _begin(self, driving: Array) -> Array:
        """Return a closed configuration near the start of the path, in its mode."""
        robot = self.robot
        if self._rest is not None:
            return robot.closed_configuration(self._rest)
        guess = np.zeros(robot.n_q)
        if robot.configuration is not None:
            guess[:] = robot.configuration
        guess[self.driving] = driving
        return robot.closed_configuration(guess, fixed=self.motion.joint_names)

    def _of_all_joints(self, part: Section, q: Array, driving: list[int]) -> Section:
        """Return a section of all joints for one of the driving joints."""
        # The motion of all joints by that of the driving ones, on which the exact
        # values are known.
        require_scalable(self.robot, q)
        q, first, second, _ = self.states(q, part.first, part.second, torques=False)
        first[:, driving] = part.first
        second[:, driving] = part.second
        # Joints that move by rounding alone are at rest.
        rates = np.abs(first).max(axis=0)
        still = rates <= NO_MOTION * rates.max()
        q[:, still] = q[0, still]
        first[:, still] = 0.0
        second[:, still] = 0.0
        return Section(q, first, second, q.min(axis=0), q.max(axis=0), part.span)

    def _place(self, q: Array, k: int) -> str:
        """Return the place of a vertex on the path in words."""
        return f'path: {k / (len(q) - 1):.3g} of it, {self._stated(q[k])}'

    def _stated(self, q: Array) -> dict[str, float]:
        """Return the positions of the driving joints by name."""
        return dict(zip(self.motion.joint_names, q[self.driving].round(4).tolist()))

    def states(self, q: Array, rates: Array, accelerations: Array, *,
               torques: bool = True) -> tuple[Array, Array, Array, Array]:
        """
        Return q, q', q'' and torques of all joints, (K, n_q) each.

        Parameters
        ----------
        q : (K, n_q) array
            Configurations with nearly closed loops.
        rates, accelerations : (K, n) arrays
            Of the driving joints.
        torques : bool
            Whether torques are needed.

        """
        robot = self.robot
        if self.driving is None:
            return q, rates, accelerations, self._torques(q, rates, accelerations)
        # The path states the driving joints; loops decide where the others are.
        near = q
        q = self._loops.closed(near, np.zeros(len(q)),
                               lambda k: f'path: {self._stated(near[k])}')
        # At time zero: nothing here depends on time (`require_scalable`).
        t = np.zeros(len(q))
        whole = motion_of_closed(robot, self.driving, t, q, rates, accelerations)
        tau = q
        if torques:
            tau = self._torques(*whole)
        return q, robot.joint_rates(q, whole.u), robot.joint_accelerations(*whole), tau

    def _torques(self, q: Array, u: Array, udot: Array) -> Array:
        """Return the torques of all joints, (K, n_q)."""
        return self.robot.joint_torques(self.robot.inverse_dynamics(q, u, udot), q)

    def check(self, section: Section) -> None:
        """Raise InputError if a position limit or a limit of 0 forbids the path."""
        self._check_positions(section)
        bounds = self.bounds
        if np.all(bounds[1:]):  # no limit is 0
            return
        if self.driving is not None:  # power counts for joints with actuators
            robot = self.robot
            q = section.q
            # A joint has an actuator if a unit of some generalized force acts on it.
            torques = []
            for unit in np.eye(robot.n):
                force = np.broadcast_to(unit, (len(q), robot.n))
                torques.append(robot.joint_torques(force, q))
            acts = np.any(torques, axis=(0, 1))
            bounds = bounds._replace(power=np.where(acts, bounds.power, np.inf))
        for quantity in ('velocity', 'power', 'acceleration'):
            still = getattr(bounds, quantity) == 0.0
            if still.any():
                still &= section.first.any(axis=0)
            if still.any():
                joint = self.names[int(still.argmax())]
                raise InputError(f"{quantity} of joint '{joint}': limit 0; expected a "
                                 'positive limit, since the joint moves along the path')

    def _check_positions(self, section: Section) -> None:
        """Raise InputError if a path exceeds a position limit."""
        limits = self.robot.limits
        for side, bound, sign, extremes in (
                ('lower', limits.lower, -1.0, section.lowest),
                ('upper', limits.upper, 1.0, section.highest)):
            # Extremes first, which decide for nearly all paths.
            if (sign * extremes <= sign * bound).all():
                continue
            # Interpolation may leave the bound by rounding.
            slack = ROUNDING * np.maximum(1.0, np.abs(bound))
            excess = sign * (section.q - bound) - slack
            k, j = np.unravel_index(int(excess.argmax()), excess.shape)
            if excess[k, j] > 0.0:
                raise InputError(f"path: joint '{self.names[int(j)]}': position "
                                 f'{section.q[k, j]:.6g}; expected within its {side} '
                                 f'limit {bound[j]:.6g}')

    def limits(self, section: Section) -> PathLimits:
        """Return the limits at the vertices of a section."""
        return PathLimits(self.robot, section, self.bounds, self.driving)

    def motion_along(self, section: Section) -> SectionMotion:
        """Return the motion along a section, for profiles to follow."""
        limits = np.array(self.bounds)
        if self.driving is None:
            peaks = SegmentPeaks(self.robot, limits)
        else:
            peaks = SegmentPeaks(self.robot, limits, self.states, self.driving)
        return SectionMotion(self.robot, section, peaks)

    def motion_of(self, points: ControllerPoints, coefficients: Callable[[], Array]
                  ) -> Motion:
        """Return the motion of the driving joints; arguments as from `joined_sections`."""
        t = point_times(points.t)
        if self.driving is None:
            return Motion(self.names, t, points.q, coefficients)
        return Motion(self.motion.joint_names, t, points.q[:, self.driving],
                      partial(_columns, coefficients, self.driving))


def _columns(coefficients: Callable[[], Array], joints: list[int]) -> Array:
    return np.asarray(coefficients()[:, :, joints])


def compile_splines(n: int) -> None:
    """Compile the splines of motions of `n` joints that state positions alone."""
    compile_uniform_spline(n)
    compile_free_spline(n)
