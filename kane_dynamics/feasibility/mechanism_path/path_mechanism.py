"""
A robot with chosen speeds or constraints along a path of its driving joints.

The other joints follow by loop closure: with the path parameter s as the time, q_s are rates and
q_ss accelerations of all joints. Between the points of the motion the driving joints move along
quintics, and the loops are closed at every place at which the limits are checked.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
import math

from kane_dynamics._util.checks import finite_row
from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque import followed_joints
from kane_dynamics.control.trajectory_joints import driving_joints
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.feasibility.mechanism_path.mechanism_limits import MechanismLimits
from kane_dynamics.feasibility.mechanism_path.mechanism_peaks import MechanismPeaks
from kane_dynamics.feasibility.path_geometry import kernels as path_kernels, path_of, Section
from kane_dynamics.feasibility.path_limits import Bounds, bounds_kernel, PathLimits
from kane_dynamics.feasibility.path_robot import PathRobot
from kane_dynamics.feasibility.path_timing import point_kernel, SectionMotion
from kane_dynamics.feasibility.reachability import compile_passes
from kane_dynamics.feasibility.torque_demand import require_scalable, unit_torques
from kane_dynamics.loop_tracking.driven_mechanism import DrivenLoops, motion_of_closed
from kane_dynamics.loop_tracking.loop_tracker import tracking_kernel, velocity_rows
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.points import point_times
from kane_dynamics.motion.uniform_spline import kernels as compile_spline
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

NO_MOTION = 1e-11  # largest rate of a joint that does not move, relative to the largest rate


class PathMechanism(PathRobot):
    """
    A robot with chosen speeds or constraints along a path of its driving joints.

    Parameters
    ----------
    robot : Robot
        Its constraints are those of positions.
    path : Motion or (K, n) array_like
        As in `time_optimal`.
    rest : (n_q,) array_like, optional
        As in `time_optimal`.

    Raises
    ------
    InputError
        The joints are others or not as many as independent speeds, constraints are those of
        velocities, or speeds or constraints prescribe velocities or are functions of time.

    """

    def __init__(self, robot: Robot, path: Motion | ArrayLike,
                 rest: ArrayLike | None = None) -> None:
        require_scalable(robot, np.zeros((0, robot.n_q)))
        every = robot.coordinate_names
        names = path.joint_names if isinstance(path, Motion) else tuple(
            every[k] for k in followed_joints(robot))
        if not set(names) <= set(every) or len(names) != robot.n:
            raise InputError(f'path: joints {list(names)}; expected {robot.n} of '
                             f'{", ".join(every)}, as many as independent speeds')
        self.names = robot.joint_names
        self.robot, self.motion = robot, path_of(path, names)
        self.driving = [every.index(name) for name in names]
        self._rest = None if rest is None else finite_row(rest, 'rest', every)
        self._loops = DrivenLoops(robot, names) if robot.constraint_names else None

    def sections(self, points: int, ends: tuple[bool, bool]) -> list[Section]:
        """Return the sections of the path, of all joints; arguments as of the function."""
        found, start = [], None
        for part in super().sections(points, ends):
            q = np.empty((len(part.q), self.robot.n_q))
            q[:, self.driving] = part.q
            if self._loops is not None:
                start = self._begin(part.q[0]) if start is None else start
                q = self._loops.followed(start, q, np.zeros(len(q)), partial(self._place, q))
                start = q[-1]
            found.append(self._whole(part, q))
        return found

    def _begin(self, driving: Array) -> Array:
        """Return a closed configuration near the start of the path, in its assembly mode."""
        robot = self.robot
        if self._rest is not None:
            return robot.closed_posture(self._rest)
        guess = np.zeros(robot.n_q) if robot.configuration is None else np.array(
            robot.configuration)
        guess[self.driving] = driving
        return robot.closed_posture(guess, fixed=self.motion.joint_names)

    def _whole(self, part: Section, q: Array) -> Section:
        """Return a section of all joints for one of the driving joints, and configurations."""
        require_scalable(self.robot, q)
        q, first, second, _ = self.states(q, part.first, part.second, torques=False)
        first[:, self.driving], second[:, self.driving] = part.first, part.second
        rates = np.abs(first).max(axis=0)
        still = rates <= NO_MOTION * rates.max()
        q[:, still], first[:, still], second[:, still] = q[0, still], 0.0, 0.0
        return Section(q, first, second, q.min(axis=0), q.max(axis=0), part.span)

    def _place(self, q: Array, k: int) -> str:
        """Return the place of a vertex on the path in words."""
        return f'path: {k / (len(q) - 1):.3g} of it, {self._stated(q[k])}'

    def _stated(self, q: Array) -> dict[str, float]:
        """Return the positions of the driving joints by name."""
        return dict(zip(self.motion.joint_names, q[self.driving].round(4).tolist()))

    def closed(self, q: Array) -> Array:
        """Return configurations, (K, n_q), near those with nearly closed loops."""
        if self._loops is None:
            return q
        return self._loops.closed(q, np.zeros(len(q)), lambda k: f'path: {self._stated(q[k])}')

    def states(self, q: Array, rates: Array, accelerations: Array, *, torques: bool = True
               ) -> tuple[Array, Array, Array, Array]:
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
        robot, q = self.robot, self.closed(q)
        whole = motion_of_closed(robot, self.driving, np.zeros(len(q)), q, rates, accelerations)
        tau = robot.joint_torques(robot.inverse_dynamics(*whole), q) if torques else q
        return q, robot.joint_rates(q, whole.u), robot.joint_accelerations(*whole), tau

    def check(self, bounds: Bounds, section: Section) -> None:
        """As of `PathRobot`; limits of power count for joints with actuators."""
        robot, q = self.robot, section.q
        torques = [robot.joint_torques(np.broadcast_to(unit, (len(q), robot.n)), q)
                   for unit in np.eye(robot.n)]
        acts = np.any(torques, axis=(0, 1))
        super().check(bounds._replace(power=np.where(acts, bounds.power, math.inf)), section)

    def limits(self, section: Section, bounds: Bounds) -> PathLimits:
        """Return the limits at the vertices of a section."""
        return MechanismLimits(self.robot, section, bounds, self.driving)

    def motion_along(self, section: Section, bounds: Bounds) -> SectionMotion:
        """Return the motion along a section, for profiles to follow."""
        peaks = MechanismPeaks(self.states, self.driving, self.robot, np.array(bounds))
        return SectionMotion(self.robot, section, peaks)

    def motion_of(self, points: ControllerPoints, coefficients: Callable[[], Array]) -> Motion:
        """Return the motion of the driving joints; arguments as from `joined`."""
        return Motion(self.motion.joint_names, point_times(points.t), points.q[:, self.driving],
                      partial(_columns, coefficients, self.driving))


def _columns(coefficients: Callable[[], Array], joints: list[int]) -> Array:
    return np.asarray(coefficients()[:, :, joints])


def compile_mechanism_timing(robot: Robot) -> None:
    """Compile what `time_optimal` needs for paths of the driving joints of closed loops."""
    if velocity_rows(robot):
        return
    places, acting = (sorted(robot.coordinate_names.index(name) for name in names)
                      for names in (driving_joints(robot), robot.actuated_names))
    compile_passes(int(np.isfinite(robot.limits.effort[acting]).sum()) or 1)
    for part in (*path_kernels(robot.n), bounds_kernel(robot.n_q), point_kernel(robot.n_q)):
        part.compile_lanes()
    compile_spline(robot.n)
    robot.compile('inverse_dynamics', 'torque_terms', 'joint_rates', 'joint_accelerations',
                  'joint_torques', batches=True)
    tracking_kernel(robot, places).compile_lanes()
    with suppress(KaneError):  # zeros are no closed configuration, but compile the kernels
        unit_torques(robot, np.zeros((1, robot.n_q)), [0])
