"""
Cartesian impedance: a frame held to a target pose by a spring and a damper.

With e the displacement and the orientation error, J the Jacobian of the frame, u_r a
reference motion with J u_r = the desired twist, and s = u - u_r:

    tau = compensation(u_r) + J^T (-dV/de - D J s + wrench) + posture + walls

V = 1/2 e^T K e is the spring's energy (`Spring`), D the damping by ratio from the
inertia and K at each state (`modal_damping`). The posture acts where it does not
accelerate the frame (`posture`). The inertia is not shaped: no inverse of the Jacobian
multiplies a feedback, and no measured force is needed. The reference motion alone uses
the regularized Lambda.

The compensation leaves the feedback passive (`reference_dynamics`): while the target
rests, without a posture, kinetic plus spring energy falls at every state, singular ones
included. Source: C. Ott, "Cartesian impedance control of redundant and flexible-joint
robots", Springer, 2008.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import math
from types import MappingProxyType
from typing import Any, NamedTuple

from kane_dynamics._util.checks import finite_row, instance, number, per_joint
from kane_dynamics._util.fixed_attributes import guarded_class
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.control.terms import EVERY_TERM, Terms
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.lane_products import product, transpose
from kane_dynamics.mechanics.algebra.lanes import Lanes
from kane_dynamics.mechanics.constraints.conditioning import guarded as nan_unless
from kane_dynamics.mechanics.constraints.mechanism import JointMotion
from kane_dynamics.mechanics.constraints.transmission import transmission_margin
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Shape
from kane_dynamics.robot.methods.frame_methods import DIRECTIONS
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.robot_function import identifier
from kane_dynamics.task_space.effort_limits import clamped, plus_scaled, within_limits
from kane_dynamics.task_space.frame_task import (frame_mobility, frame_task,
                                                 FrameMobility, FrameTask, in_axes,
                                                 singular_mass as checked_mass,
                                                 TaskInertia)
from kane_dynamics.task_space.joint_speed_limits import (brake_torques, checked_speeds,
                                                         slowdown)
from kane_dynamics.task_space.joint_walls import JointWalls, STOPS, WALL
from kane_dynamics.task_space.law_kernel import (checked_effort, checked_terms,
                                                 LanesOf, Law, law_kernel,
                                                 PoseLaw, Settings, StateAt)
from kane_dynamics.task_space.modal_damping import inverse_root_times, RATIO
from kane_dynamics.task_space.pose_checks import pose_margin, require_pose
from kane_dynamics.task_space.posture import null_damping, posture_force
from kane_dynamics.task_space.reference_dynamics import (compensation_weights,
                                                         reference_dynamics,
                                                         resisting_force, WEIGHTS)
from kane_dynamics.task_space.reference_motion import reference_motion, TargetMotion
from kane_dynamics.task_space.stiffness import (checked_matrix, factor, Spring,
                                                stored_energy, stored_energy_limits)
import numpy as np
from numpy.typing import ArrayLike

NULL_DAMPING = 5.0  # 1/s: default rate at which motion that the frame does not see decays


class ImpedanceState(NamedTuple):
    """
    Errors, wrench and saturation of a Cartesian impedance at a state.

    Attributes
    ----------
    error : (6,) array
        Displacement from the target, m, and orientation error, rad, in the task's axes.
    wrench : (6,) array
        The wrench of spring and damper on the frame, N, N m, in the task's axes.
    spring_scale : (2,) array
        Factors of force and moment by `force_limit` and `moment_limit`, 1 without.
    effort_scale : float
        Factor of the task's torques by the effort limits, 1 without.
    mass : float
        Mass with which the frame resists motion in its heaviest direction, kg.
    regularization : float
        lambda^2 of `TaskInertia`, 1/kg; 0 away from singular configurations.
    speed_scale : float
        Factor of the reference motion by the speed limits, 1 without.
    braking : float
        Norm of the torques that brake joints at their speed limits, N m; 0 without.

    """

    error: Array
    wrench: Array
    spring_scale: Array
    effort_scale: float
    mass: float
    regularization: float
    speed_scale: float
    braking: float


STATE_SIZE = 6 + 6 + 2 + 5


@guarded_class
class CartesianImpedance(PoseLaw):
    """
    Cartesian impedance of a frame: spring, damper and posture, without inertia shaping.

    ``tau = compensation + J^T (K e + D de/dt + wrench) + N^T posture + walls``, with
    every setting a run-time argument of one compiled kernel: `update` changes them
    between two calls.

    Parameters
    ----------
    robot : Robot
        A robot without beams.
    frame : str
        One of `frame_names` of a moving body.
    stiffness : (6,) or (6, 6) array_like
        N/m, then N m/rad, in the axes; positive semidefinite.
    damping_ratio : float or (6,) array_like
        Of the modes of the frame's inertia on the spring; 0.7 by default. With six
        ratios, one for each axis, and a diagonal stiffness each mode has one between the
        smallest and the largest.
    damping : (6,) or (6, 6) array_like, optional
        N s/m and N m s/rad, in place of the damping by ratio.
    axes : str
        'world', 'frame' (the axes of the target), or a frame that is fixed to the world
        or to the body of `frame`. Axes of a body turn with the target, not with the
        measured pose, so that the spring has an energy.
    directions : sequence of str, optional
        Directions in the axes that count as the task for feedforward and null space.
        Default: as many of x, y, z, rx, ry, rz as the frame can follow.
    posture : (n_q,) array_like, optional
        Positions towards which joint springs pull in the null space; a force there does
        not accelerate the frame. Entries of ball joints are not used.
    posture_stiffness : float or array_like
        N m/rad or N/m, one for each joint with a position; 0 by default.
    null_damping : float
        1/s: the rate at which motion that does not move the frame decays; 5 by default.
        Near singular configurations it damps the directions that the frame loses. With
        a posture, 2 sqrt(stiffness / inertia) is critical.
    limit_stiffness, limit_margin : float or array_like, optional
        Soft walls before the joint limits, N m/rad and rad. Default: 0.1 rad or 5 % of
        the range, with the effort limit at the joint limit; 0 for none.
    force_limit, moment_limit : float
        Largest force and moment of the spring, N and N m. Directions are kept.
    effort_limit : float or array_like, optional
        Limits that the torques respect, those of the task by one common factor. What
        holds the arm against gravity is not reduced. Default: the robot's.
    speed_limit : float or array_like, optional
        Limits of the joint speeds, rad/s or m/s; inf for none. The reference motion is
        slower than the target where it needs more than 90 % of one, and a joint that is
        about to exceed that is braked. Towards its position limit the speed of a joint is
        at most the distance that is left, divided by 0.1 s, unless its speed limit is inf.
        Default: the robot's; a joint without one is slow towards its position limits alone.
    compensate : Terms
        The terms of the model that are compensated.
    singular_mass : float, optional
        kg; see `TaskSpace`.

    Raises
    ------
    InputError
        Names the argument, what was given and what is expected.

    """

    _changeable: tuple[str, ...] = (
        'stiffness', 'damping_ratio', 'damping', 'posture', 'posture_stiffness',
        'null_damping', 'limit_stiffness', 'limit_margin', 'force_limit',
        'moment_limit', 'effort_limit', 'speed_limit', 'compensate', 'singular_mass')
    _further: Mapping[str, Any] = MappingProxyType({})  # of a subclass, at first

    def __init__(self, robot: Robot, frame: str, *, stiffness: ArrayLike,
                 damping_ratio: ArrayLike | None = None,
                 damping: ArrayLike | None = None, axes: str = 'world',
                 directions: Sequence[str] | None = None,
                 posture: ArrayLike | None = None,
                 posture_stiffness: ArrayLike = 0.0, null_damping: float = NULL_DAMPING,
                 limit_stiffness: ArrayLike | None = None,
                 limit_margin: ArrayLike | None = None, force_limit: float = math.inf,
                 moment_limit: float = math.inf, effort_limit: ArrayLike | None = None,
                 speed_limit: ArrayLike | None = None, compensate: Terms = EVERY_TERM,
                 singular_mass: float | None = None) -> None:
        """Check the settings; kernels compile on first use."""
        instance(robot, Robot, 'robot')
        self.robot = robot
        self._task = frame_task(robot, frame, axes, directions)
        self._walls = JointWalls(robot)
        super().__init__(robot, Settings(self._layout()))
        self.update(stiffness=stiffness, damping_ratio=damping_ratio, damping=damping,
                    posture=posture, posture_stiffness=posture_stiffness,
                    null_damping=null_damping, limit_stiffness=limit_stiffness,
                    limit_margin=limit_margin, force_limit=force_limit,
                    moment_limit=moment_limit, effort_limit=effort_limit,
                    speed_limit=speed_limit, compensate=compensate,
                    singular_mass=singular_mass, **self._further)

    # Settings, which may change between two calls.

    def _layout(self) -> dict[str, Shape]:
        """Return the names and shapes of the kernel's settings."""
        robot = self.robot
        joints = self._walls.count
        return {
            'stiffness': (6, 6), 'damping_factor': (6, 6), 'damping': (6, 6),
            'bounds': (2,), 'weights': (len(WEIGHTS),), 'posture': (robot.n_q,),
            'posture_stiffness': (joints,), 'null_damping': (), 'singular_mass': (),
            'effort': (len(robot.joint_names),), 'speed': (len(robot.joint_names),),
            **self._walls.shapes(*WALL, *STOPS)}

    def _checked(self, values: dict[str, Any]) -> dict[str, Any]:
        """Return the settings of the kernel by name, checked."""
        robot = self.robot
        K = checked_matrix(values['stiffness'], 'stiffness')
        # Damping by ratio follows the inertia; a stated matrix takes its place.
        D = np.zeros((6, 6))
        ratio = values['damping_ratio']
        if values['damping'] is not None:
            if ratio is not None:
                raise InputError('damping, damping_ratio: both given; expected one')
            D = checked_matrix(values['damping'], 'damping')
            ratio = 0.0
        elif ratio is None:
            ratio = RATIO
        ratios = per_joint(ratio, 'damping_ratio', DIRECTIONS, part='direction')

        # Limits of the spring's force, and the null-space posture.
        positive = 'a positive number'
        limits = {}
        for name in ('force_limit', 'moment_limit'):
            limits[name] = number(values[name], name, positive, lambda x: x > 0.0)
        wall_names = [robot.joint_names[r] for r in self._walls.joints]
        posture = values['posture']
        posture_stiffness = per_joint(values['posture_stiffness'], 'posture_stiffness',
                                      wall_names)
        # Without a posture its spring is switched off.
        if posture is None:
            posture = np.zeros(robot.n_q)
            if posture_stiffness.any():
                raise InputError(f'posture_stiffness: {values["posture_stiffness"]!r}, '
                                 'without a posture; expected a posture, (n_q,)')
        return {
            'stiffness': K, 'damping_factor': factor(K) * ratios, 'damping': D,
            'bounds': stored_energy_limits(K, limits['force_limit'],
                                           limits['moment_limit']),
            'weights': compensation_weights(checked_terms(values['compensate'])),
            'posture': finite_row(posture, 'posture', robot.coordinate_names),
            'posture_stiffness': posture_stiffness,
            'null_damping': number(values['null_damping'], 'null_damping',
                                   'a finite number >= 0, 1/s',
                                   lambda x: 0.0 <= x < math.inf),
            'singular_mass': checked_mass(robot, values['singular_mass']),
            'effort': checked_effort(robot, values['effort_limit']),
            'speed': checked_speeds(robot, values['speed_limit']),
            **self._walls.settings(values['limit_stiffness'], values['limit_margin'])}

    # Torques.

    def state(self, q: ArrayLike, u: ArrayLike, pose: ArrayLike,
              twist: ArrayLike | None = None, t: float = 0.0) -> ImpedanceState:
        """Return errors, wrench and saturation at a state; arguments as `torque`."""
        kernel = self._state_entry
        row = kernel(q, u, pose, self._zero if twist is None else twist,
                     self._zero, self._zero, self._block, t)
        return ImpedanceState(row[:6], row[6:12], row[12:14], *map(float, row[14:]))

    def energy(self, q: ArrayLike, pose: ArrayLike) -> float:
        """Return the energy that the spring and the walls store, J."""
        positions = finite_row(q, 'q', self.robot.coordinate_names)
        target = require_pose(pose)
        measured = self.robot.frame_pose(self._task.frame.name, positions)
        settings = self._shapes.unpacked(self._block)
        axes = self._task.in_world(target[:3, :3])
        spring = stored_energy(measured, target, axes, settings['stiffness'],
                               settings['bounds'])
        return spring + float(self._walls.energy(positions, settings))

    def compile(self) -> None:  # noqa: A003
        """Compile the kernels of `torque` and `state`."""
        _ = self._law
        _ = self._state_entry

    @lazy_property
    def _state_entry(self) -> Callable[..., Array]:
        """Return the entry point of the state, compiled at the first use."""
        kernel = self._impedance_kernel(True)
        return kernel.entry('', kernel)

    def _kernel(self) -> Kernel:
        """Return the kernel of the torques."""
        return self._impedance_kernel(False)

    def _impedance_kernel(self, with_state: bool) -> Kernel:
        """Return the kernel of the torques of an impedance alone, or of its state."""
        robot = self.robot
        task = self._task
        shapes = self._shapes
        walls = self._walls

        # Compiled again in regular speeds where the robot's are singular.
        def law_of(choice: Robot, lanes_of: LanesOf) -> Law:
            return _law(choice, task, walls, shapes, with_state, lanes_of)
        name = 'impedance_state' if with_state else 'cartesian_impedance'
        inputs = {'q': (robot.n_q,), 'u': (robot.n,), 'pose': (4, 4), 'twist': (6,),
                  'acceleration': (6,), 'desired_wrench': (6,),
                  'settings': (shapes.size,)}
        size = STATE_SIZE if with_state else len(robot.joint_names)
        return law_kernel(robot, law_of, identifier(name, task.words), inputs, (size,))


def impedance_law(law: CartesianImpedance, robot: Robot, lanes_of: LanesOf) -> Law:
    """
    Return the torques of an object's law as a function over any scalar.

    Its arguments are those of `torque`, with all settings for the last. The robot is that
    of the object, or the same in other speeds.
    """
    return _law(robot, law._task, law._walls, law._shapes, False, lanes_of)


def compile_state(law: CartesianImpedance) -> None:
    """Compile the kernel of `state` alone."""
    _ = law._state_entry


def joints_at_walls(law: CartesianImpedance, q: Array) -> list[str]:
    """Return the names of the joints on which a wall acts at q, (n_q,)."""
    return law._walls.reached(q, law._shapes.unpacked(law._block))


def wall_slopes(law: CartesianImpedance, q: Array) -> tuple[Array, Array]:
    """Return stiffness and damping of the walls that act at q, as of `JointWalls`."""
    return law._walls.slopes(q, law._shapes.unpacked(law._block))


def null_space_spring(law: CartesianImpedance, q: Array, J: Array) -> tuple[Array, Array]:
    """
    Return stiffness and damping of a law in the null space of its frame, (n, n) each.

    They are N^T T^T K T with the posture at q, and beta S; see `posture`.

    Parameters
    ----------
    law : CartesianImpedance
        With its present settings.
    q : (n_q,) array
        rad or m.
    J : (6, n) array
        The Jacobian of the frame in the axes of the law.

    """
    robot = law.robot
    values = law._shapes.unpacked(law._block)
    M = robot.mass_matrix(q)
    inverse = np.linalg.inv(M)
    P = inverse @ J.T
    inertia = TaskInertia(law._task, FrameMobility(inverse, J, P, J @ P, Lanes),
                          values['singular_mass'])
    T = np.stack([robot.joint_rates(q, speeds) for speeds in np.eye(robot.n)], axis=1)
    held = T[law._walls.joints]
    springs = held.T @ (values['posture_stiffness'][:, None] * held)
    stiffness = np.stack([inertia.null_force(column) for column in springs.T], axis=1)
    damping = [-null_damping(inertia, M[:, j], J[:, j], values['null_damping'])
               for j in range(robot.n)]
    return stiffness, np.stack(damping, axis=1)


def posture_place(law: CartesianImpedance) -> slice:
    """Return where its settings have the posture."""
    return law._shapes.place('posture')


def _law(robot: Robot, task: FrameTask, walls: JointWalls, shapes: Settings,
         with_state: bool, lanes_of: LanesOf) -> Law:
    """Return the law as a function over any scalar; see the module."""
    equations = robot.equations

    def law(q: Vector, u: Vector, target: Matrix, twist: Vector, acceleration: Vector,
            wrench: Vector, settings: Vector, *, t: Scalar, parameters: Vector
            ) -> Vector:
        values = shapes.unpacked(settings)
        desired = TargetMotion(task.in_world(target[:3, :3]), twist, acceleration)
        forces = impedance_forces(robot, task, walls, (q, u, t, parameters), target,
                                  desired, values, lanes_of(q[0]))
        exerted = forces.mobility.force(in_axes(desired.axes, wrench))
        tau, scale, brakes = forces.torques(equations, exerted, values['effort'])
        # The state of the law, for those who look at it, takes the place of the
        # torques.
        if with_state:
            numbers = np.array([scale, forces.inertia.mass,
                                forces.inertia.regularization, forces.speed_scale,
                                np.sqrt(brakes @ brakes)])
            tau = np.concatenate([forces.spring.error, forces.spring.wrench
                                  - forces.damping, forces.spring.saturation, numbers])
        elif equations.actuated is not None:
            tau = nan_unless(tau, transmission_margin(equations.mechanism,
                                                      equations.at_rest(q, t).T,
                                                      equations.actuated))
        return nan_unless(tau, pose_margin(target))
    return law


class ImpedanceForces(NamedTuple):
    """
    The forces of a Cartesian impedance, over any scalar.

    Attributes
    ----------
    at : tuple
        q, u, t and the robot's parameters.
    motion : JointMotion
        At q and u.
    held, walls, feedforward : (n,) arrays
        What holds the arm at rest, of the walls of the joint limits, and of the reference
        motion.
    drag, pull : (n,) arrays
        Of dampers, and of the spring and the posture.
    spring : Spring
    damping : (6,) array
        The wrench that the damper takes off, in the axes.
    velocity : (6,) array
        Of the frame relative to the reference motion, in the axes.
    mobility : FrameMobility
    inertia : TaskInertia
    weights : (4,) array
        Of the terms that are compensated.
    speeds : (n_j,) array
        Limits of the joint speeds in the direction of their motion.
    speed_scale : scalar
        Factor of the reference motion by these.

    """

    at: StateAt
    motion: JointMotion
    held: Vector
    walls: Vector
    feedforward: Vector
    drag: Vector
    pull: Vector
    spring: Spring
    damping: Vector
    velocity: Vector
    mobility: FrameMobility
    inertia: TaskInertia
    weights: Vector
    speeds: Vector
    speed_scale: Scalar

    def torques(self, equations: Equations, exerted: Vector, effort: Vector
                ) -> tuple[Vector, Scalar, Vector]:
        """
        Return the torques of the joints, the pull's factor, and the brakes, (n_j,).

        Within the effort limits come in this order: what holds the arm, the walls, the
        dampers, the feedforward, the pull. Each keeps its direction, by one factor for
        all torques. Then joints about to exceed their speeds are braked, each by itself.
        """
        q, u, t, parameters = self.at
        lanes = self.mobility.lanes
        tau = equations.shared_torques(q, self.held, t)
        force = self.held
        # In the order of importance: each part gets what the limits leave after those
        # before.
        scale: Scalar = 1.0
        for part in (self.walls, self.drag, self.feedforward, self.pull + exerted):
            tau, scale = within_limits(tau, equations.shared_torques(q, part, t), effort,
                                       lanes)
            force = plus_scaled(force, scale, part, lanes)
        # Friction that the arm compensates itself does not slow its joints down.
        bias = resisting_force(equations, q, u, self.weights, parameters, t)
        brakes = brake_torques(self.motion, self.mobility.inverse_mass, force - bias,
                               self.speeds, lanes)
        braking = equations.shared_torques(q, self.motion.projected(brakes), t)
        return clamped(tau, braking, effort, lanes), scale, brakes


def impedance_forces(robot: Robot, task: FrameTask, walls: JointWalls, at: StateAt,
                     target: Matrix, desired: TargetMotion,
                     values: Mapping[str, Any], lanes: Any) -> ImpedanceForces:
    """Return the forces of a Cartesian impedance at a state; see the module."""
    equations = robot.equations
    q, u, t, parameters = at
    axes = desired.axes
    motion = equations.joint_motion(q, u, equations.zeros, t)
    J = in_axes(axes, equations.partial_velocities(task.frame, q, t))
    mobility = frame_mobility(equations, J, q, parameters, t, lanes)
    inertia = TaskInertia(task, mobility, values['singular_mass'])

    # Feedforward of the reference motion, which is slowed down to the speed limits.
    u_r, udot_r = reference_motion(equations, task, inertia, q, u, desired, t)
    reference_rates = motion.T @ u_r
    speed_scale = slowdown(reference_rates, walls.speeds_towards(
        q, reference_rates, values['speed'], values, lanes), lanes)
    u_r = speed_scale * u_r
    at_rest = equations.zeros
    held = reference_dynamics(equations, q, at_rest, at_rest, at_rest,
                              values['weights'], parameters, t)
    compensation = reference_dynamics(equations, q, u, u_r, speed_scale * udot_r,
                                      values['weights'], parameters, t)
    at_walls = motion.projected(walls.force(q, motion.qdot, values, lanes))

    # Spring and damper, on the motion relative to the reference.
    s = u - u_r
    velocity = product(s, transpose(J, lanes), lanes)
    spring = Spring(equations.frame_pose(task.frame, q, t), target, axes, values, lanes)
    damping = damping_wrench(mobility.W, velocity, values, lanes)

    # Posture and damping, where they do not accelerate the frame.
    momentum = equations.mass_matrix(q, parameters, t) @ s
    drag = null_damping(inertia, momentum, velocity, values['null_damping'])
    posture = posture_force(walls, inertia, q, motion, values)
    return ImpedanceForces(at, motion, held, at_walls, compensation - held,
                           drag - mobility.force(damping),
                           mobility.force(spring.wrench) + posture, spring,
                           damping, velocity, mobility, inertia, values['weights'],
                           walls.speeds_towards(q, motion.qdot, values['speed'], values,
                                                lanes),
                           speed_scale)


def damping_wrench(W: Matrix, velocity: Vector, values: Mapping[str, Any],
                   lanes: Any) -> Vector:
    """Return D times a velocity, (6,): the damping by ratio and the stated one."""
    F = np.triu(values['damping_factor'])  # of the stiffness, times the ratios
    modes = product(F, transpose(product(F, W, lanes), lanes), lanes)
    in_modes = product(2.0 * velocity, transpose(F, lanes), lanes)
    by_ratio = product(inverse_root_times(modes, in_modes, lanes), F, lanes)
    return by_ratio + product(velocity, values['damping'], lanes)
