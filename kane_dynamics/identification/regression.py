"""
Linear equations of identification: torque = Y phi + friction and armature terms.

The unknowns, in order: ten inertial parameters per body as in
`mechanics.recursive.regressor`, then damping, Coulomb friction, armature and offset of
each joint. The friction speed of Coulomb friction enters nonlinearly.

The torque of a joint at rest is undetermined within the limits of stiction and contains
no information on its parameters: its equations omit rows in which it is slower than a
bound (Swevers, Verdonck & De Schutter, IEEE Control Systems 27 (2007), section on
friction).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from kane_dynamics._util.checks import number
from kane_dynamics._util.typing import Array, Flags
from kane_dynamics.identification.recordings.recording import (check_recording,
                                                               Recording,
                                                               require_rigid_links,
                                                               STANDSTILL)
from kane_dynamics.identification.solvers import scientific
from kane_dynamics.mechanics.friction import coulomb
from kane_dynamics.model.model import FRICTION as LAW_FIELDS, Joint, Model
from kane_dynamics.robot.robot import Robot
import numpy as np

FRICTION = ('damping', 'friction', 'armature', 'friction_offset')
LOWEST = np.array([0.0, 0.0, 0.0, -np.inf])  # lower bounds of FRICTION
UNBOUNDED = np.full(4, -np.inf)
SPEEDS = np.geomspace(0.005, 0.5, 41)  # candidates, rad/s or m/s


@dataclass(frozen=True, eq=False)
class RegressionRows:
    """
    Regression data of a recording and a model.

    Attributes
    ----------
    recording : Recording
    joint_names : tuple of str
    rigid : (N, n) array
        Torque of the model's rigid bodies, N m or N.
    rest : (N, n) array
        Torque that is not identified: springs, payloads, friction of mimic joints.
    Y : (N, n, 10 bodies) array
        The regressor.
    moving : (N, n) array of bool
        Where a joint is faster than standstill.

    """

    recording: Recording
    joint_names: tuple[str, ...]
    rigid: Array
    rest: Array
    Y: Array
    moving: Flags

    def part(self, chosen: slice | Flags) -> 'RegressionRows':
        """Return the rows of a slice or a mask."""
        return RegressionRows(self.recording.rows(chosen), self.joint_names,
                              self.rigid[chosen],
                              self.rest[chosen], self.Y[chosen], self.moving[chosen])


def without_losses(model: Model) -> Model:
    """Return the model without friction and armature at joints with a coordinate of their own."""
    nothing = Joint('nothing', 'revolute', np.array([0.0, 0.0, 1.0]))
    without: dict[str, Any] = {name: getattr(nothing, name)
                               for name in (*LAW_FIELDS, 'armature')}
    bodies = []
    for body in model.bodies:
        if body.joint.name in model.coordinate_names:
            body = replace(body, joint=replace(body.joint, **without))
        bodies.append(body)
    return replace(model, bodies=tuple(bodies))


def rows(model: Model, recording: Recording,
         standstill: float = STANDSTILL) -> RegressionRows:
    """Return the regression data of a recording; raise InputError for other joints."""
    check_recording(model, recording)
    require_rigid_links(model)
    standstill = number(standstill, 'standstill', 'a nonnegative speed, rad/s or m/s',
                        lambda x: x >= 0.0)
    # The regressor is of bodies alone; springs and armature are known, friction is
    # fitted.
    robot = Robot(without_losses(model))
    state = recording.q, recording.u, recording.udot
    Y = robot.regressor(*state)
    rigid = Y @ robot.inertial_parameters
    return RegressionRows(recording, robot.joint_names, rigid,
                          robot.inverse_dynamics(*state) - rigid, Y,
                          np.abs(recording.u) > standstill)


def friction_columns(recording: Recording, joint: int, speed: float) -> Array:
    """Return the torques of unit damping, friction, armature and offset of a joint, (N, 4)."""
    u = recording.u[:, joint]
    return np.column_stack([u, coulomb(u, speed), recording.udot[:, joint],
                            np.ones(len(u))])


def least_between(function: Callable[[float], float], candidates: Array,
                  tolerance: float) -> float:
    """
    Return the argument of the smallest value of a function.

    It is searched among increasing, positive candidates, then between the neighbors of
    the best one, to a relative tolerance.
    """
    # The best candidate, refined between its neighbors.
    values = [function(float(candidate)) for candidate in candidates]
    best = int(np.argmin(values))
    at_best = float(candidates[best])
    neighbors = candidates[[max(best - 1, 0), min(best + 1, len(candidates) - 1)]]
    refined = scientific('scipy.optimize').minimize_scalar(
        lambda ratio: function(at_best * ratio), bounds=neighbors / at_best,
        method='bounded', options={'xatol': tolerance})
    if refined.fun < values[best]:
        return at_best * float(refined.x)
    return at_best


def bounded(A: Array, b: Array, lowest: Array) -> Array:
    """Return the least-squares solution of A x = b whose entries are at least `lowest`."""
    free = ~np.isfinite(lowest)
    # Unknowns without bounds are eliminated by the first columns of R, then solved for.
    order = np.argsort(~free, kind='stable')
    count = int(free.sum())
    R = triangle(np.column_stack([A[:, order], b]))
    x = np.zeros(len(order))
    rest = R[count:, -1] - R[count:, count:-1] @ lowest[order[count:]]
    if count < len(order):
        solution = scientific('scipy.optimize').nnls(R[count:, count:-1], rest)[0]
        x[count:] = solution + lowest[order[count:]]
    remaining = R[:count, -1] - R[:count, count:-1] @ x[count:]
    x[:count] = np.linalg.lstsq(R[:count, :count], remaining, rcond=None)[0]
    result = np.zeros(len(order))
    result[order] = x
    return result


def full_regressor(data: RegressionRows, speeds: Array) -> Array:
    """Return the regressor of all unknowns, (N, n, 10 bodies + 4 n)."""
    count, n, inertial = data.Y.shape
    X = np.zeros((count, n, inertial + 4 * n))
    X[:, :, :inertial] = data.Y
    for j in range(n):
        X[:, j, inertial + 4 * j:inertial + 4 * j + 4] = friction_columns(
            data.recording, j, float(speeds[j]))
    return X


def rms(values: Array) -> Array:
    """Return the root mean square of each column."""
    return np.asarray(np.sqrt(np.mean(values * values, axis=0)))


def triangle(A: Array) -> Array:
    """Return R of A = Q R, which has the same normal equations and at most as many rows as A."""
    return np.asarray(np.linalg.qr(A, mode='r'))
