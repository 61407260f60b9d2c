"""
Reach of the controlled frame: its distance from a pose that the arm cannot have.

Damped least squares in native code, with the joint limits as an active set and with the
residuals of closed loops as further rows: the search from the present configuration that
an impedance makes too. A pose that only another branch reaches counts as out of reach.
"""

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.robot_function import identifier
from kane_dynamics.ros.modes.pose_functions import displacement
import numpy as np

REACHED = 1e-4  # m and rad: what may remain
STEPS = 8  # between two looks at what remains
LOOKS = 12
PROGRESS = 0.9  # ratio of what remains at two looks, above which the search ends
LONGEST = 0.3  # longest step, rad or m
LARGEST_DAMPING = 1e-2
BIAS = 1e-10
AT_LIMIT = 1e-9  # rad or m
FARTHEST = float(np.finfo(np.float64).max)  # stands for no limit


class TargetReach:
    """
    Searches for a configuration at which a frame has a pose.

    Parameters
    ----------
    robot : Robot
        Of the calling thread; with constraints on positions or none.
    frame : str

    """

    def __init__(self, robot: Robot, frame: str) -> None:
        self._equations = robot.equations
        self._frame = robot.model.frame(frame)
        n = robot.n_q
        lower = np.clip(robot.limits.lower, -FARTHEST, FARTHEST)
        upper = np.clip(robot.limits.upper, -FARTHEST, FARTHEST)
        self._bounds = np.stack([lower, upper])
        self._rows = np.zeros((STEPS + 1, n + 2))
        self._kernel = robot.compiled(self._step, name=identifier('reach_of', frame),
                                      row=(n + 2,), goal=(4, 4), bounds=(2, n),
                                      shape=(n + 2,))
        self._solution: Array | None = None  # of the last pose that is reached

    def restart(self) -> None:
        """Search from the present configuration."""
        self._solution = None

    def remaining(self, goal: Array, q: Array) -> tuple[float, float]:
        """
        Return distance, m, and angle, rad, that remain to a pose (4, 4).

        Both are at most `REACHED` where the frame reaches it. The search begins at the
        last solution, since poses of a stream are near each other; then at q, (n_q,).
        """
        # From the last solution first: a stream of goals moves little from one to the
        # next.
        best = np.array([np.inf, np.inf])
        for start in (self._solution, q):
            if start is None:
                continue
            solution, remaining = self._search(goal, start)
            if remaining.max() < best.max():
                best = remaining
            if best.max() <= REACHED:
                self._solution = solution
                break
        return float(best[0]), float(best[1])

    def _search(self, goal: Array, q: Array) -> tuple[Array, Array]:
        """Return the last configuration, and its distance and angle from the goal."""
        rows = self._rows
        rows[0, :-2] = q
        last = np.inf
        for _ in range(LOOKS):
            self._kernel.scan([rows[:-1], goal, self._bounds], rows[1:])
            remaining = rows[-1, -2:]
            size = float(remaining.max())
            # Not finite: a singular configuration of the loops.
            if size <= REACHED or not size < PROGRESS * last:
                break
            last = size
            rows[0] = rows[-1]
        return rows[-2, :-2].copy(), remaining.copy()

    def _step(self, row: Vector, goal: Matrix, bounds: Matrix) -> Vector:
        """
        Return the next configuration, and distance and angle at the present one; traced.

        The row is the configuration, then distance and angle, which are not used.
        """
        q = row[:-2]
        lower, upper = bounds
        pose = self._equations.tree.frame_pose(self._frame, q)
        error = displacement(pose, goal)
        J = self._equations.tree.partial_velocities(self._frame, q)
        distance = error[:3] @ error[:3]
        # Rows of closed loops join the task, so that the step keeps them closed.
        if self._equations.watched:
            rows = self._equations.constraint_rows(q)
            open_by = rows.residual_or_zero
            J = np.concatenate([J, rows.J])
            error = np.concatenate([error, -open_by])
            distance = distance + open_by @ open_by
        size = error @ error
        # Damping that vanishes with the error: Newton's method near the solution.
        damping = select(size < LARGEST_DAMPING, size, LARGEST_DAMPING) + BIAS
        # Joints at a limit that the step would pass are held in a second step.
        step = _damped_step(J, error, damping)
        free = []
        for x, change, low, high in zip(q, step, lower, upper):
            is_low = select(x < low + AT_LIMIT, select(change < 0.0, 0.0, 1.0), 1.0)
            free.append(select(x > high - AT_LIMIT, select(change > 0.0, 0.0, is_low),
                               is_low))
        step = _damped_step(J * np.array(free), error, damping)
        # The step is at most LONGEST for any joint, in its direction.
        longest = 0.0
        for change in step:
            magnitude = select(change < 0.0, -change, change)
            longest = select(longest < magnitude, magnitude, longest)
        share = select(longest > LONGEST, LONGEST / longest, 1.0)
        moved = []
        for x, change, low, high in zip(q, step, lower, upper):
            new = x + share * change
            moved.append(select(new < low, low, select(high < new, high, new)))
        angle = error[3:6] @ error[3:6]
        return np.array([*moved, np.sqrt(distance), np.sqrt(angle)])


def _damped_step(J: Matrix, error: Vector, damping: Scalar) -> Vector:
    """Return J^T (J J^T + damping)^-1 error."""
    order = range(len(error))
    normal = J @ J.T + damping * np.eye(len(error))
    return np.asarray(J.T @ solve(factorize(normal, order), order, error))
