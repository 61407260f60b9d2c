"""
A robot with chosen speeds or constraints along a path of its driving joints.

The other joints follow by loop closure: with the path parameter s as the time, q_s are rates and
q_ss accelerations of all joints. Between the points of the motion the driving joints move along
quintics, and the loops are closed at every place at which the limits are checked.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import partial

from kane_dynamics._util.checks import finite_row
from kane_dynamics._util.typing import Array
from kane_dynamics.control.constrained_law import followed_joints
from kane_dynamics.control.trajectories.linkage import driving_joints
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.feasibility.mechanism_path.mechanism_limits import MechanismLimits
from kane_dynamics.feasibility.mechanism_path.mechanism_peaks import MechanismPeaks
from kane_dynamics.feasibility.path_geometry import path_of, Section
from kane_dynamics.feasibility.path_limits import Bounds, PathLimits
from kane_dynamics.feasibility.path_robot import PathRobot
from kane_dynamics.feasibility.path_timing import Checked, checked
from kane_dynamics.feasibility.reachability import compile_passes
from kane_dynamics.feasibility.torque_demand import require_scalable, unit_torques
from kane_dynamics.kinematics.closed_path import LoopLimits
from kane_dynamics.kinematics.loop_error import BRANCH, LoopError, SINGULAR
from kane_dynamics.kinematics.loop_kernel import FIGURES, tracking_kernel
from kane_dynamics.kinematics.loop_step import SHARE
from kane_dynamics.kinematics.loop_tracker import LoopTracker
from kane_dynamics.kinematics.mechanism_motion import motion_of_closed, velocity_rows
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.points import point_times
from kane_dynamics.motion.uniform_spline import kernels as compile_spline
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

CLOSED = 1e-11  # m and rad: residual of the independent rows
CALLS = 5  # of the kernel that closes loops, at most
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
        if rows := velocity_rows(robot):
            raise InputError(f"path: constraint '{rows[0]}' is one of velocities, and the "
                             'positions of driving joints do not determine the configuration; '
                             'expected constraints of positions')
        every = robot.coordinate_names
        names = path.joint_names if isinstance(path, Motion) else tuple(
            every[k] for k in followed_joints(robot))
        if not set(names) <= set(every) or len(names) != robot.n:
            raise InputError(f'path: joints {list(names)}; expected {robot.n} of '
                             f'{", ".join(every)}, as many as independent speeds')
        self.robot, self.motion = robot, path_of(path, names)
        self.driving = [every.index(name) for name in names]
        self._order = sorted(range(robot.n), key=lambda k: self.driving[k])
        self._tracker: LoopTracker | None = None
        self._rest = None if rest is None else finite_row(rest, 'rest', every)
        self._start: Array | None = None
        if robot.constraint_names:
            self._tracker = LoopTracker(robot, [names[k] for k in self._order],
                                        max_figure=LoopLimits().max_figure)

    def sections(self, points: int, ends: tuple[bool, bool]) -> list[Section]:
        """Return the sections of the path, of all joints; arguments as of the function."""
        parts = super().sections(points, ends)
        if self._tracker is not None:
            self._begin(self._tracker, parts[0].q[0])
        return [self._whole(part) for part in parts]

    def _begin(self, tracker: LoopTracker, driving: Array) -> None:
        """Close the loops near the start of the path, in the assembly mode of the robot."""
        robot = self.robot
        if self._start is None and self._rest is not None:
            self._start = robot.closed_posture(self._rest)
        elif self._start is None:
            guess = np.zeros(robot.n_q) if robot.configuration is None else np.array(
                robot.configuration)
            guess[self.driving] = driving
            self._start = robot.closed_posture(guess, fixed=self.motion.joint_names)
        tracker.restart(self._start)

    def _whole(self, part: Section) -> Section:
        """Return a section of all joints for one of the driving joints."""
        q = np.empty((len(part.q), self.robot.n_q))
        q[:, self.driving] = part.q
        if self._tracker is not None:
            q = self._followed(self._tracker, q)
        require_scalable(self.robot, q)
        q, first, second, _ = self.states(q, part.first, part.second, torques=False)
        first[:, self.driving], second[:, self.driving] = part.first, part.second
        rates = np.abs(first).max(axis=0)
        still = rates <= NO_MOTION * rates.max()
        q[:, still], first[:, still], second[:, still] = q[0, still], 0.0, 0.0
        return Section(q, first, second, q.min(axis=0), q.max(axis=0), part.span)

    def _followed(self, tracker: LoopTracker, q: Array) -> Array:
        """Return configurations with closed loops, each from the one before."""
        none = np.zeros(self.robot.n)
        for k, row in enumerate(q[:, self.driving][:, self._order]):
            try:
                tracker.update(row, none)
            except LoopError as error:
                raise LoopError(error.reason, f'path: {k / (len(q) - 1):.3g} of it, '
                                f'{self._stated(q[k])}: {error.detail}') from None
            q[k] = tracker.q
        return q

    def _stated(self, q: Array) -> dict[str, float]:
        """Return the positions of the driving joints by name."""
        return dict(zip(self.motion.joint_names, q[self.driving].round(4).tolist()))

    def closed(self, q: Array) -> Array:
        """
        Return configurations, (K, n_q), near those with nearly closed loops.

        The driving joints keep their positions. LoopError if the others move by more than a part
        of the distance from a singular configuration, beyond which they might not return.
        """
        tracker = self._tracker
        if tracker is None:
            return q
        robot, places = self.robot, tracker.places
        kernel, n, n_q = tracking_kernel(robot, places), robot.n, robot.n_q
        # Without a motion of the driving joints the kernel does not need their rates.
        unused = [np.zeros(shape) for shape in ((n_q, n), (n,), (n_q,), (n_q,))]
        rows = np.empty((len(q), *kernel.shape))
        for _ in range(CALLS):
            target = np.ascontiguousarray(q[:, places])
            kernel.run([np.ascontiguousarray(q), unused[0], target, *unused[1:]], rows, len(q))
            moved, missed, _, figure, *_ = np.sqrt(rows[:, -FIGURES:].T)
            far = ~((figure <= tracker.max_figure) & (figure * moved <= SHARE))
            if far.any():
                k = int(far.argmax())
                raise LoopError(SINGULAR, f'path: {self._stated(q[k])}: conditioning figure '
                                f'{figure[k]:.3g}; expected at most {tracker.max_figure:g}, and '
                                f'less between points next to which the joints move by '
                                f'{moved[k]:.3g} rad or lengths')
            q = rows[:, :n_q].copy()
            q[:, places] = target
            if missed.max() <= CLOSED:
                return q
        k = int(missed.argmax())
        raise LoopError(BRANCH, f'path: {self._stated(q[k])}: residual {missed[k]:.3g} m or rad; '
                        'expected joints for which the loops close')

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

    def limits(self, section: Section, bounds: Bounds) -> PathLimits:
        """Return the limits at the vertices of a section."""
        return MechanismLimits(self.robot, section, bounds, self.driving)

    def checked(self, points: ControllerPoints, bounds: Bounds) -> Checked:
        """Return the uses of the limits along the motion between points."""
        return checked(self.robot, points, bounds, partial(
            MechanismPeaks, self.states, self.driving))

    def torques(self, points: ControllerPoints) -> Array:
        """Return the torques of all joints at points, (K, n_q)."""
        _, q, u, udot = points
        return self.states(q, u[:, self.driving], udot[:, self.driving])[3]

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
    compile_spline(robot.n)
    robot.compile('inverse_dynamics', 'torque_terms', 'joint_rates', 'joint_accelerations',
                  'joint_torques', batches=True)
    tracking_kernel(robot, places).compile_lanes()
    with suppress(KaneError):  # zeros are no closed configuration, but compile the kernels
        unit_torques(robot, np.zeros((1, robot.n_q)), [0])
