"""The frame, axes and directions of a task, and its dynamics over any scalar."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from kane_dynamics._util.checks import instance, number
from kane_dynamics._util.text import SHORT
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.control.computed_torque import require_rigid
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.lane_products import product, solutions, transpose
from kane_dynamics.mechanics.algebra.lanes import Lanes
from kane_dynamics.mechanics.algebra.ltdl import factorize, Factors
from kane_dynamics.mechanics.ball_joints import on_unit_quaternions
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.model.model import Frame, WORLD
from kane_dynamics.robot.methods.frame_methods import DIRECTIONS
from kane_dynamics.robot.robot import Robot
import numpy as np

HEAVY = 10.0  # times the robot's mass: directions that resist like more are singular
LEAST = 1e-9  # of the least mobility: keeps the factorization of singular ones finite
ROUNDING = 1e-14  # of the trace of a mobility, likewise
INDEPENDENT = 1e-3  # least relative singular value of independent directions
ORDINARY = 1.0  # rad or m
NEAR = 0.2  # rad or m
ATTEMPTS = 10  # to close the loops


@dataclass(frozen=True, eq=False)
class FrameTask:
    """
    A frame, the axes of its task, and the directions in them.

    Attributes
    ----------
    frame : Frame
    axes : str
        'world', 'frame', or the name of a frame.
    moving : bool
        Whether the axes are fixed to the frame's body, not to the world.
    rotation : (3, 3) array
        Columns are the axes: in the world, or in the frame if they are moving.
    rows : tuple of int
        Of the six directions, linear then angular.
    length : float
        m; scales angles to distances.

    """

    frame: Frame
    axes: str
    moving: bool
    rotation: Array
    rows: tuple[int, ...]
    length: float

    def in_world(self, R: Matrix) -> Matrix:
        """Return the axes as columns, in the world, for the frame's orientation R."""
        if self.moving:
            return R @ self.rotation
        return self.rotation

    def scaled(self, six: Matrix) -> Matrix:
        """Return the task's rows among six, with angular ones times `length`."""
        scales = self.scales
        return np.array([scales[k] * six[row] for k, row in enumerate(self.rows)])

    @property
    def scales(self) -> tuple[float, ...]:
        """Return the factors of `scaled`, one for each row."""
        return tuple(1.0 if row < 3 else self.length for row in self.rows)

    @property
    def words(self) -> tuple[str, ...]:
        """Return a text that distinguishes the tasks of one robot."""
        directions = ''.join(map(str, self.rows))
        return self.frame.name, self.axes, directions


def frame_task(robot: Robot, frame: str, axes: str,
               directions: Sequence[str] | None) -> FrameTask:
    """
    Return a task, checked; without directions, in as many as the frame can follow.

    Raises
    ------
    InputError
        An unknown frame or direction; the frame does not move; axes that move relative
        to the frame.

    """
    instance(robot, Robot, 'robot')
    if directions is None:
        directions = independent_directions(robot, frame, axes)
    require_rigid(robot)
    model = robot.model
    controlled = model.frame(frame)
    if controlled.body == WORLD:
        raise InputError(f"frame: '{frame}', which does not move; expected a frame of a "
                         'moving body')
    # The axes of the task turn with the frame, or are fixed in the world.
    moving = axes == 'frame'
    rotation = np.eye(3)
    if axes not in ('world', 'frame'):
        reference = model.frame(axes)
        moving = reference.body == controlled.body
        if moving:
            rotation = controlled.rotation.T @ reference.rotation
        elif reference.body == WORLD:
            rotation = reference.rotation
        else:
            raise InputError(f"axes: '{axes}', which moves relative to '{frame}'; "
                             "expected 'world', 'frame', or a frame that is fixed to the "
                             f"world or to the body of '{frame}'")
    rows = checked_directions(directions, 'directions')
    length = float(robot.mechanism.length)
    return FrameTask(controlled, axes, moving, rotation, rows, length)


def checked_directions(directions: Sequence[str], what: str) -> tuple[int, ...]:
    """Return the rows, 0 to 5, of directions in their order; InputError otherwise."""
    names: list[str] = []
    if isinstance(directions, Iterable) and not isinstance(directions, str):
        names = list(directions)
    known = [name for name in DIRECTIONS if name in names]
    if not names or len(known) < len(names):
        raise InputError(f'{what}: {SHORT.repr(directions)}; expected a sequence of some '
                         f'of {", ".join(DIRECTIONS)}, each once')
    return tuple(map(DIRECTIONS.index, known))


def singular_mass(robot: Robot, stated: float | None) -> float:
    """Return the mass, kg, above which a direction is singular."""
    if stated is not None:
        return number(stated, 'singular_mass', 'a positive, finite mass in kg',
                      lambda x: 0.0 < x < np.inf)
    # By default HEAVY times the mass of all bodies; rotors count as masses at the
    # mechanism's length.
    mass = 0.0
    for body in robot.model.bodies:
        joint = body.joint
        rotor = joint.multiplier**2 * joint.armature
        if joint.kind == 'revolute':
            rotor /= robot.mechanism.length**2
        mass += body.inertial.mass + rotor
    return HEAVY * mass


def in_axes(axes: Matrix, six: Matrix) -> Matrix:
    """Return linear and angular components, (6,) or (6, n), of world ones, in axes."""
    to_axes = axes.T
    return np.concatenate([to_axes @ six[:3], to_axes @ six[3:]])


class FrameMobility(NamedTuple):
    """
    Mobility of a frame in the axes of a task.

    Attributes
    ----------
    inverse_mass : (n, n) array
        M^-1.
    J : (6, n) array
        The Jacobian, linear then angular; or some of its rows, as in P and W.
    P : (n, 6) array
        M^-1 J^T.
    W : (6, 6) array
        J M^-1 J^T, the inverse of Lambda where that exists; symmetric to rounding.
    lanes : class or object
        The functions of `Lanes` for products of these.

    """

    inverse_mass: Matrix
    J: Matrix
    P: Matrix
    W: Matrix
    lanes: Any

    def force(self, wrench: Vector) -> Vector:
        """Return J^T times a wrench on the frame, (n,)."""
        return product(wrench, self.J, self.lanes)


def frame_mobility(equations: Equations, J: Matrix, q: Vector, parameters: Vector,
                   t: Scalar, lanes: Any = Lanes) -> FrameMobility:
    """Return the mobility of a frame with the Jacobian J, (6, n)."""
    inverse = inverse_mass(equations, q, parameters, t, lanes)
    P = transpose(product(J, inverse, lanes), lanes)
    return FrameMobility(inverse, J, P, product(J, P, lanes), lanes)


def inverse_mass(equations: Equations, q: Vector, parameters: Vector, t: Scalar,
                 lanes: Any = Lanes) -> Matrix:
    """Return M^-1, (n, n)."""
    factors, order = equations.mass_factors(q, parameters, t)
    inverse: Matrix = solutions(factors, order, np.eye(len(order)), lanes)
    return inverse


class TaskInertia:
    """
    Inertia of a task at a configuration, regular where the task is singular.

    With the mobility W, Lambda = (W + lambda^2)^-1. Its regularization lambda^2 is
    exactly zero while trace(W^-1), about the mass with which the task resists motion in
    its heaviest direction, is below `heaviest` m_s; above it grows smoothly to 1 / m_s,
    so that Lambda is at most 4/3 m_s. It is the variable damping of Y. Nakamura and H.
    Hanafusa, "Inverse kinematic solutions with singularity robustness for robot
    manipulator control", J. Dyn. Sys. Meas. Control 108, 1986, with a measure in kg:
    W and Lambda of the regularization are those of angles times the task's length.

    Parameters
    ----------
    task : FrameTask
    mobility : FrameMobility
        Of all six directions.
    heaviest : scalar
        m_s, kg.

    Attributes
    ----------
    Lambda : (6, 6) array
        In units of six directions; zero for those that are not of the task.
    mass, regularization : scalars
        trace(W^-1), kg; lambda^2, 1/kg.

    """

    def __init__(self, task: FrameTask, mobility: FrameMobility,
                 heaviest: Scalar) -> None:
        self._mobility = mobility
        scales = np.array(task.scales)
        rows = list(task.rows)
        count = len(rows)
        order = list(range(count))
        W = scales[:, None] * mobility.W[np.ix_(rows, rows)] * scales

        # The trace of W^-1, finite where W is singular.
        least = 1.0 / heaviest
        trace = sum(W[k, k] for k in range(count))
        shift = LEAST * least + ROUNDING * trace
        self.mass = inverse_trace(factorize(W + np.diag([shift] * count), order))

        # lambda^2 = (1 - m_s / mass)^2 / m_s above m_s, else 0. The shift keeps the
        # factorization finite at the edge of rounding.
        share = heaviest / self.mass
        is_singular = share < 1.0
        excess = select(is_singular, 1.0 - share, 0.0)
        self.regularization = least * excess * excess
        added = self.regularization + select(is_singular, shift, 0.0)
        factors = factorize(W + np.diag([added] * count), order)

        # Lambda = S (W + lambda^2)^-1 S with the scales S of the task's rows.
        S = np.zeros((count, 6))
        S[order, rows] = scales
        scaled = solutions(factors, order, S, mobility.lanes)
        self.Lambda = product(S.T, scaled, mobility.lanes)

    def wrench(self, acceleration: Vector) -> Vector:
        """Return Lambda times an acceleration of the frame, (6,)."""
        return product(acceleration, self.Lambda, self._mobility.lanes)

    def momentum(self, v: Vector) -> Vector:
        """Return J^T Lambda v, (n,): the momentum of `speeds`."""
        return self._mobility.force(self.wrench(v))

    def speeds(self, v: Vector) -> Vector:
        """Return the speeds of least kinetic energy, (n,), for a velocity, (6,)."""
        mobility = self._mobility
        return product(self.momentum(v), mobility.inverse_mass, mobility.lanes)

    def null_force(self, tau: Vector) -> Vector:
        """Return N^T tau, (n,), which does not accelerate the task."""
        mobility = self._mobility
        acceleration = product(tau, mobility.P, mobility.lanes)
        return tau - self.momentum(acceleration)


def inverse_trace(factors: Factors) -> Scalar:
    """Return the trace of M^-1 from M = L^T D L: the sum of (L^-1)_ij^2 / D_j."""
    L, reciprocal = factors
    count = len(L)
    total: Scalar = 0.0
    for j in range(count):
        # Column j of L^-1, from its diagonal entry 1 down.
        column = [1.0]
        for i in range(j + 1, count):
            column.append(-sum(L[i][j + k] * x for k, x in enumerate(column)))
        total = total + reciprocal[j] * sum(x * x for x in column)
    return total


def independent_directions(robot: Robot, frame: str, axes: str) -> tuple[str, ...]:
    """Return as many of the six directions as the frame can follow, in their order."""
    task = frame_task(robot, frame, axes, DIRECTIONS)
    q = ordinary_configuration(robot)
    equations = robot.equations
    in_world = task.in_world(equations.frame_pose(task.frame, q, 0.0)[:3, :3])
    J = task.scaled(in_axes(in_world, equations.partial_velocities(task.frame, q, 0.0)))
    names: list[str] = []
    # A direction is taken if its row is independent of those taken before.
    chosen = np.zeros((0, robot.n))
    for name, row in zip(DIRECTIONS, np.asarray(J, np.float64)):
        extended = np.concatenate([chosen, row[None]])
        values = np.linalg.svd(extended, compute_uv=False)
        if len(extended) <= robot.n and values.min() > INDEPENDENT * values.max():
            names.append(name)
            chosen = extended
    return tuple(names)


def ordinary_configuration(robot: Robot) -> Array:
    """Return a configuration, (n_q,), that is not likely to be singular; closed."""
    # Without constraints any configuration is closed; joints stay away from their
    # zeros.
    rng = np.random.default_rng(0)
    if not robot.constraint_names:
        lower = np.maximum(robot.limits.lower, -ORDINARY)
        upper = np.minimum(robot.limits.upper, ORDINARY)
        q = rng.uniform(lower, upper)
        return np.asarray(on_unit_quaternions(robot.model, q))

    # Near the stated configuration or that of the file, on its branch of the loops.
    start = robot.options['configuration']
    start = np.zeros(robot.n_q) if start is None else np.asarray(start, np.float64)
    for _ in range(ATTEMPTS):
        try:
            return robot.closed_configuration(start + rng.uniform(-NEAR, NEAR, robot.n_q))
        except ConstraintError:
            continue
    raise InputError('directions: missing; expected those that the frame can follow, '
                     'because no closed configuration of the robot was reached')
