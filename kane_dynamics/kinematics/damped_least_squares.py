"""
Inverse kinematics: the configuration at which a frame has a desired pose or position.

Damped least squares (Levenberg-Marquardt) whose damping falls with the error, by T.
Sugihara, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method",
IEEE Trans. Robotics 27(5), 2011: regular at singular configurations, quadratic near a
solution. Limits of the coordinates are an active set: a coordinate that would move
beyond its limit is fixed.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple
import warnings

from kane_dynamics._util.checks import (finite_row, instance, integer,
                                        number, real_numbers)
from kane_dynamics._util.text import SHORT
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.errors import ConstraintError, InputError, ModelWarning
from kane_dynamics.kinematics.poses import checked_pose, pose_error
from kane_dynamics.mechanics.ball_joints import (angle_places, angles, balls,
                                                 joint_positions, joint_speeds, moved,
                                                 require_unit)
from kane_dynamics.model.elastic_model import with_motors_at_links
from kane_dynamics.robot.methods.configuration_methods import random_generator
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike

LONGEST = 0.5  # longest step, rad, and m or lengths of the mechanism
LARGEST_DAMPING = 1e-2  # squared, so that unreachable targets do not slow the search
BIAS = 1e-12  # squared damping at zero error
PATIENCE = 15  # iterations without progress before the next start
PROGRESS = 0.99  # ratio of two errors, below which an iteration has made progress
AT_LIMIT = 1e-9  # rad or m
SHORTENINGS = 12  # halvings of a step that leaves the loops open or the limits
FARTHEST = 1e12  # m
FAR_BEYOND = 30.0  # of a target that may be in mm: distance over the reach


class InverseKinematics(NamedTuple):
    """
    The result of `inverse_kinematics`.

    `q`, (n_q,), rad or m, is the configuration with the smallest error found, within the
    limits. `error`, (6,) or (3,), is what remains there, as `pose_error`: m, then rad.
    `converged` tells whether it is below the tolerance; `iterations` counts those of all
    starts.
    """

    q: Array
    error: Array
    converged: bool
    iterations: int


def inverse_kinematics(robot: Robot, frame: str, target: ArrayLike,
                       q0: ArrayLike | None = None, *,
                       joints: Sequence[str] | None = None, tolerance: float = 1e-8,
                       iterations: int = 100, starts: int = 20,
                       seed: int = 0) -> InverseKinematics:
    """
    Return a configuration within the limits at which a frame has a desired pose.

    Parameters
    ----------
    robot : Robot
        Constraints on positions are met too. With chosen speeds, any. Motors of elastic
        joints are where their springs are not deflected.
    frame : str
        One of `robot.frame_names`.
    target : (4, 4) or (3,) array_like
        Pose of the frame in the world, or position of its origin alone, m.
    q0 : (n_q,) array_like, optional
        Initial guess, rad or m; a solution near it is preferred. Default:
        `Robot.feasible_configuration`.
    joints : sequence of str, optional
        The joints that may move, such as those of a leg; the others stay as in q0. By
        default all, also those of a floating base. Not with closed loops.
    tolerance : float
        Largest remaining distance, m, and angle, rad.
    iterations : int
        Of each start.
    starts : int
        Configurations to start from: q0, then random ones.
    seed : int
        Of the random ones.

    Raises
    ------
    InputError
        Names the argument, what was given and what is expected. A target that cannot be
        reached is no error: `converged` is False. ModelWarning says that one may be in
        mm.
    ConstraintError
        No configuration near the starts meets the robot's constraints.

    """
    instance(robot, Robot, 'robot')
    if not isinstance(frame, str):
        raise InputError(f'frame: a {type(frame).__name__}; expected a name (str): the '
                         'order is (robot, frame, target)')
    goal = _checked_target(target)
    iterations = integer(iterations, 'iterations', 1)
    starts = integer(starts, 'starts', 1)
    tolerance = number(tolerance, 'tolerance', 'a positive number, m and rad',
                       lambda x: x > 0.0)
    rng = random_generator(seed)
    search = _Search(robot, frame, goal, tolerance, joints)
    best: InverseKinematics | None = None
    count = 0
    # From the stated start first, then from random ones, until one converges.
    for start in range(starts):
        q = search.first_start(q0) if start == 0 else search.random_start(rng)
        result = search.run(q, iterations)
        count += result.iterations
        if best is None or np.abs(result.error).max() < np.abs(best.error).max():
            best = result
        if result.converged:
            break
    assert best is not None
    if not best.converged:
        _warn_of_millimeters(robot, frame, goal, best.q)
    # Motors of elastic joints move no frame: they are put where no spring is deflected.
    q = with_motors_at_links(robot.model, best.q)
    if robot.model.drives:  # constraints may hold motors
        q = robot.closed_configuration(q)
    return best._replace(q=q, iterations=count)


def _warn_of_millimeters(robot: Robot, frame: str, goal: Array, q: Array) -> None:
    """Warn of a target that is far beyond the positions that a frame reaches."""
    # The frame's own distance from the base, and the size of the robot, bound what it
    # reaches.
    target = goal if goal.ndim == 1 else goal[:3, 3]
    reached = robot.frame_pose(frame, q)[:3, 3]
    distance = float(np.linalg.norm(target - reached))
    reach = float(np.linalg.norm(reached)) + robot.mechanism.length
    if distance > FAR_BEYOND * reach:
        warnings.warn(f'target: {distance:.4g} m from the nearest position of the frame '
                      'that was found; expected a target in m: are these mm?',
                      ModelWarning, stacklevel=3)


def _checked_target(target: ArrayLike) -> Array:
    """Return a pose (4, 4) or a position (3,); InputError for anything else."""
    try:
        numbers = real_numbers(target)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    # A position leaves the orientation free.
    if numbers.shape == (3,):
        goal = origin = numbers
    else:
        goal = checked_pose(target, 'target')
        if goal.ndim > 2:
            raise InputError(f'target: shape {goal.shape}; expected one pose (4, 4) or '
                             'one position (3,)')
        origin = goal[:3, 3]
    # Beyond this distance rounding exceeds any tolerance.
    if not (np.abs(origin) <= FARTHEST).all():
        raise InputError(f'target: position {origin.tolist()}; expected finite numbers '
                         f'of at most {FARTHEST:g} m')
    return goal


class _Search:
    """
    Iterations towards one target from several initial configurations.

    Steps are rates of the joints, (n_j,), over unit time: ball joints turn about an axis
    of their body. Limits are those of the joints; a ball joint has none.
    """

    def __init__(self, robot: Robot, frame: str, goal: Array, tolerance: float,
                 joints: Sequence[str] | None) -> None:
        self.robot = robot
        self.frame = frame
        self.goal = goal
        self.tolerance = tolerance
        # Rows of the task: position alone, or position and orientation.
        self.rows = 3 if goal.ndim == 1 else 6
        self.constrained = not robot.equations.in_joint_rates
        self.looped = bool(robot.constraint_names)
        model = robot.model
        # Limits by joint; ball joints have none.
        self.lower = np.full(model.n, -np.inf)
        self.upper = np.full(model.n, np.inf)
        self.lower[angles(model)] = robot.limits.lower[angle_places(model)]
        self.upper[angles(model)] = robot.limits.upper[angle_places(model)]
        # A slide of a crane may take steps of its size.
        self.unit = np.ones(model.n)
        for k, name in enumerate(model.joint_names):
            if name in model.sliding:
                self.unit[k] = max(1.0, robot.mechanism.length)
        self.start = np.zeros(robot.n_q)
        self.fixed = self._fixed(joints)

    def _fixed(self, joints: Sequence[str] | None) -> Flags:
        """Return which joints may not move, (n_j,)."""
        names = self.robot.joint_names
        if joints is None:
            return np.zeros(len(names), dtype=bool)
        chosen: set[str] = set()
        if isinstance(joints, Collection) and not isinstance(joints, str):
            chosen = set(joints)
        # The chosen joints move, all others are fixed; neither part of a loop nor of a
        # ball joint can.
        if not chosen or not chosen <= set(names):
            raise InputError(f'joints: {SHORT.repr(joints)}; expected some of '
                             f'{", ".join(names)}')
        if self.looped:
            raise InputError(f'joints: {list(joints)}, of a robot with closed loops; '
                             'expected None: the loops determine which joints move '
                             'together')
        for ball in balls(self.robot.model):
            parts = set(names[ball.speed:ball.speed + 3])
            some = parts & chosen
            if some and some != parts:
                stated = ', '.join(sorted(some))
                expected = ', '.join(sorted(parts))
                raise InputError(f"joints: {stated} of the ball joint '{ball.name}'; "
                                 f'expected {expected} together')
        return np.array([name not in chosen for name in names])

    def first_start(self, q0: ArrayLike | None) -> Array:
        """Return q0 clipped to the limits and closed."""
        robot = self.robot
        # A guess of the user, or a configuration within the limits.
        if q0 is None:
            guess = robot.feasible_configuration()
        else:
            guess = finite_row(q0, 'q0', robot.model.coordinate_names)
        robot.frame_pose(self.frame, guess)  # raises InputError for an unknown frame
        guess = require_unit(robot.model, guess, 'q0')
        self.start = np.clip(guess, robot.limits.lower, robot.limits.upper)
        if self.looped:
            self.start = robot.closed_configuration(self.start)
        return self.start

    def random_start(self, rng: np.random.Generator) -> Array:
        """Return a random configuration; joints that may not move are as at first."""
        q = self.robot.random_configuration(rng)
        # Fixed joints stay where the first start has them; the quaternion of a ball
        # counts as one.
        for joint, place in enumerate(self.robot.model.places):
            if place is not None and self.fixed[joint]:
                q[place] = self.start[place]
        for ball in balls(self.robot.model):
            if self.fixed[ball.speed]:
                ball.quaternion(q)[...] = ball.quaternion(self.start)
        return q

    def run(self, q: Array, iterations: int) -> InverseKinematics:
        """Return the best configuration of a search from q."""
        # Errors may grow for some steps, so the best configuration is kept aside.
        best = InverseKinematics(q, self.error(q), False, 0)
        without_progress = 0
        for k in range(iterations + 1):
            error = self.error(q)

            # The patience counts steps that do not reduce the error by a factor.
            size = np.abs(error).max()
            smallest = np.abs(best.error).max()
            if size < PROGRESS * smallest:
                without_progress = 0
            if size <= smallest:
                best = InverseKinematics(q, error, False, k)
            without_progress += 1
            if self.within(best.error) or without_progress > PATIENCE or k == iterations:
                break
            # No step is left at a minimum of the error that is not zero.
            next_q = self.step(q, error)
            if next_q is None:
                break
            q = next_q
        return best._replace(converged=self.within(best.error), iterations=k)

    def within(self, error: Array) -> bool:
        """Return whether distance and angle are below the tolerance."""
        distance = float(np.linalg.norm(error[:3]))
        angle = float(np.linalg.norm(error[3:]))
        return distance <= self.tolerance and angle <= self.tolerance

    def error(self, q: Array) -> Array:
        """Return the error at q, (6,) or (3,)."""
        pose = self.robot.frame_pose(self.frame, q)
        if self.rows == 3:
            return self.goal - pose[:3, 3]
        return pose_error(pose, self.goal)

    def step(self, q: Array, error: Array) -> Array | None:
        """Return the configuration after a damped step; None if none is possible."""
        J = self.robot.jacobian(self.frame, q)[:self.rows]
        rates = self._rates(q)
        positions = joint_positions(self.robot.model, q)
        at_lower = positions <= self.lower + AT_LIMIT
        at_upper = positions >= self.upper - AT_LIMIT
        # Damping falls with the error: far away short steps, near the solution those of
        # Gauss-Newton.
        damping = min(float(error @ error), LARGEST_DAMPING) + BIAS
        # The active set: joints that would leave their limits are held, until none does.
        held = self.fixed.copy()
        while True:
            free = _motions_without(rates, held)
            if not free.shape[1]:
                return None
            A = J @ free
            # (A^T A + damping 1) x = A^T error in the motions that are left.
            normal = A.T @ A + damping * np.eye(A.shape[1])
            step = rates @ (free @ np.linalg.solve(normal, A.T @ error))
            beyond = (at_lower & (step < -1e-14)) | (at_upper & (step > 1e-14))
            beyond &= ~held
            if not beyond.any():
                break
            held |= beyond
        longest = float(np.abs(step / self.unit).max(initial=0.0))
        if longest == 0.0:
            return None
        # No joint passes its limit, and no angle changes so much that the Jacobian is
        # another.
        # The part of the step that reaches a limit, and the longest step.
        with np.errstate(divide='ignore', invalid='ignore'):
            to_limit = np.where(step < 0.0, (self.lower - positions) / step,
                                (self.upper - positions) / step)
        to_limit = np.where(held | (step == 0.0), np.inf, to_limit)
        part = min(1.0, LONGEST / longest, max(float(to_limit.min()), 0.0))
        return self._moved(q, step * part)

    def _moved(self, q: Array, step: Array) -> Array | None:
        """Return q after a step within limits and constraints, shortened if needed."""
        model = self.robot.model
        limits = self.robot.limits
        if not self.looped:
            return np.clip(moved(model, q, step), limits.lower, limits.upper)
        # Loops close near the step; a shorter one where they do not, or beyond the
        # limits.
        for _ in range(SHORTENINGS):
            try:
                closed = self.robot.closed_configuration(moved(model, q, step))
            except ConstraintError:
                closed = np.full(len(q), np.inf)
            above = (closed >= limits.lower - AT_LIMIT).all()
            below = (closed <= limits.upper + AT_LIMIT).all()
            if above and below:
                return closed
            step = 0.5 * step
        return None

    def _rates(self, q: Array) -> Array:
        """Return the rates of the joints per unit of the independent speeds, (n_j, n)."""
        n = self.robot.n
        if not self.constrained:
            return np.eye(n)
        # Columns of T: the rates at unit speeds, less those at rest.
        drift = self.robot.joint_rates(q, np.zeros(n))
        columns = []
        for unit in np.eye(n):
            q_rate = self.robot.joint_rates(q, unit) - drift
            columns.append(joint_speeds(self.robot.model, q, q_rate))
        return np.stack(columns, axis=1)


def _motions_without(rates: Array, held: Flags) -> Array:
    """Return a basis, (n, k), of the speeds at which the held joints do not move."""
    if not held.any():
        return np.eye(rates.shape[1])
    _, singular_values, right = np.linalg.svd(rates[held])
    rank = int((singular_values > 1e-10).sum())
    return np.asarray(right[rank:].T)
