"""
Dynamics in the space of a frame: Lambda, mu, gravity, consistent inverse, null space.

With the frame's Jacobian J and M udot + h = tau, the force F = Lambda a + mu at the
frame accelerates it by a, where Lambda = (J M^-1 J^T)^-1, mu = Lambda (J M^-1 h - J' u).
The dynamically consistent inverse M^-1 J^T Lambda gives the speeds of least kinetic
energy for a velocity of the frame; N = 1 - inverse J projects on motions that do not move
it, and N^T tau does not accelerate it. Source: O. Khatib, "A unified approach for motion
and force control of robot manipulators: the operational space formulation", IEEE J.
Robotics and Automation 3(1), 1987.

Where the frame loses a direction, Lambda is regularized smoothly (`TaskInertia`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from kane_dynamics._util.checks import instance
from kane_dynamics._util.fixed_attributes import fixed
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.methods.frame_methods import DIRECTIONS
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.robot_function import identifier
from kane_dynamics.task_space.frame_task import (frame_mobility, frame_task, FrameTask,
                                                 in_axes, singular_mass as checked_mass,
                                                 TaskInertia)
from kane_dynamics.task_space.law_kernel import (LanesOf, Law, law_kernel,
                                                 Settings)
import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class TaskDynamics:
    """
    The dynamics of a frame at a state, with k directions of n speeds.

    Attributes
    ----------
    jacobian : (k, n) array
        J, in the task's axes.
    mobility : (k, k) array
        J M^-1 J^T, 1/kg, 1/(kg m^2).
    inertia : (k, k) array
        Lambda, kg, kg m^2; regularized where the frame is singular.
    bias, gravity : (k,) arrays
        mu, and the part of gravity in it, N, N m.
    consistent_inverse : (n, k) array
        M^-1 J^T Lambda.
    null_projector : (n, n) array
        N.
    mass : float
        Mass with which the frame resists motion in its heaviest direction, kg: the
        trace of Lambda without regularization, angles scaled by the length of the task.
    regularization : float
        lambda^2, 1/kg; exactly 0 while `mass` is below `singular_mass`.
    heaviest : (k,) array
        Direction of least mobility, of length 1 with angles scaled: the one that is
        lost first.

    """

    jacobian: Array
    mobility: Array
    inertia: Array
    bias: Array
    gravity: Array
    consistent_inverse: Array
    null_projector: Array
    mass: float
    regularization: float
    heaviest: Array


@fixed
class TaskSpace:
    """
    Dynamics of a robot in the space of one of its frames.

    Parameters
    ----------
    robot : Robot
        A robot without beams.
    frame : str
        One of `frame_names` of a moving body.
    axes : str
        'world', 'frame', or a frame that is fixed to the world or to the same body.
        Accelerations are those of `Robot.frame_acceleration` in these axes.
    directions : sequence of str, optional
        Of x, y, z, rx, ry, rz. Default: as many as the frame can follow.
    singular_mass : float, optional
        kg: a direction in which the frame resists with more is singular. Lambda is exact
        below and at most 4/3 of it (angles scaled by `Robot.mechanism.length`) above.
        Default: ten times the mass of the moving bodies.

    Attributes
    ----------
    directions : tuple of k str

    Raises
    ------
    InputError
        Names the argument, what was given and what is expected.

    """

    def __init__(self, robot: Robot, frame: str, *, axes: str = 'world',
                 directions: Sequence[str] | None = None,
                 singular_mass: float | None = None) -> None:
        """Check the task; the kernel compiles on first use."""
        instance(robot, Robot, 'robot')
        self.robot = robot
        self._task = frame_task(robot, frame, axes, directions)
        self.directions = tuple(DIRECTIONS[row] for row in self._task.rows)
        self._mass = np.array([checked_mass(robot, singular_mass)])
        k = len(self.directions)
        n = robot.n
        # The result of the kernel is one array; these are its parts.
        self._parts = Settings({
            'jacobian': (k, n), 'mobility': (k, k), 'inertia': (k, k), 'bias': (k,),
            'gravity': (k,), 'consistent_inverse': (n, k), 'null_projector': (n, n),
            'mass': (), 'regularization': ()})

    def at(self, q: ArrayLike, u: ArrayLike | None = None, t: float = 0.0
           ) -> TaskDynamics:
        """
        Return the dynamics at a state.

        Parameters
        ----------
        q : (n_q,) array_like
            rad or m.
        u : (n,) array_like, optional
            rad/s or m/s. Default: at rest.
        t : float
            Time, s, where speeds or constraints depend on it.

        Raises
        ------
        InputError
            A wrong shape, or a number that is not finite.
        ConstraintError
            The configuration is open or singular.

        """
        speeds = np.zeros(self.robot.n) if u is None else u
        time = self.robot.equations.time_inputs(t)
        parts = self._parts.unpacked(self._kernel(q, speeds, self._mass, *time))
        scales = np.array(self._task.scales)
        scaled = scales[:, None] * parts['mobility'] * scales
        _, vectors = np.linalg.eigh(scaled)
        return TaskDynamics(heaviest=vectors[:, 0], **parts)

    def compile(self) -> None:  # noqa: A003
        """Compile the kernel."""
        self._kernel  # noqa: B018

    @lazy_property
    def _kernel(self) -> Kernel:
        robot = self.robot
        task = self._task

        def law_of(choice: Robot, _: LanesOf) -> Law:
            return _quantities(choice, task)
        inputs = {'q': (robot.n_q,), 'u': (robot.n,), 'singular_mass': (1,)}
        return law_kernel(robot, law_of, identifier('task_space', task.words), inputs,
                          (self._parts.size,))


def _quantities(robot: Robot, task: FrameTask) -> Law:
    """Return the quantities of `TaskDynamics` in a row, over any scalar."""
    equations = robot.equations
    frame = task.frame

    def law(q: Vector, u: Vector, mass: Vector, *, t: Scalar, parameters: Vector
            ) -> Vector:
        axes = task.in_world(equations.frame_pose(frame, q, t)[:3, :3])
        J = in_axes(axes, equations.partial_velocities(frame, q, t))
        mobility = frame_mobility(equations, J, q, parameters, t)
        inertia = TaskInertia(task, mobility, mass[0])

        # An inverse that inertia weighs: its motions have the least kinetic energy.
        rows = list(task.rows)
        Lambda = mirrored(inertia.Lambda[np.ix_(rows, rows)])
        inverse = mobility.P[:, rows] @ Lambda

        # The frame accelerates by J' u even where u' is zero.
        drift = equations.frame_acceleration(frame, q, u, equations.zeros, t)
        bias = equations.bias_force(q, u, parameters, t)
        mu = inverse.T @ bias - Lambda @ in_axes(axes, drift)[rows]
        gravity = inverse.T @ equations.gravity_force(q, parameters, t)
        # N keeps of a motion what J does not see.
        N = np.eye(len(u)) - inverse @ J[rows]
        W = mirrored(mobility.W[np.ix_(rows, rows)])
        parts = [J[rows], W, Lambda, mu, gravity, inverse, N]
        flat = [np.asarray(part, dtype=object).ravel() for part in parts]
        return np.concatenate([*flat, np.array([inertia.mass, inertia.regularization])])
    return law


def mirrored(A: Matrix) -> Matrix:
    """Return a symmetric matrix without the rounding of its upper triangle."""
    return np.tril(A) + np.tril(A, -1).T
