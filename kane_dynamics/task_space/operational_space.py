"""
Operational space: a frame's acceleration prescribed, then the posture in its null space.

    a = a_d + kd (v_d - v) - kp e
    tau = h + J^T (Lambda (a - J' u) + wrench) + N^T M (posture_kp (q_p - q) - posture_kd q')

so that the errors of the frame obey e'' + kd e' + kp e = 0 on the exact model, with the
bias force h, friction at the reference rates, and Lambda and N of `TaskInertia`. Beyond
160 degrees the orientation in e falls smoothly to zero at half a turn, where its
direction is undefined (`orientation_error`). Unlike an impedance it shapes the inertia: a
force at the frame meets the mass Lambda as before, but stiffness and damping are
kp Lambda and kd Lambda, which change with the configuration; and it claims no passivity.
Source: O. Khatib, IEEE J. Robotics and Automation 3(1), 1987.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.checks import finite_row, instance, per_joint
from kane_dynamics._util.fixed_attributes import guarded_class
from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.control.computed_torque import KD, KP
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.conditioning import guarded as nan_unless
from kane_dynamics.mechanics.constraints.transmission import transmission_margin
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.methods.frame_methods import DIRECTIONS
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.robot_function import identifier
from kane_dynamics.task_space.effort_limits import within_limits
from kane_dynamics.task_space.frame_task import (frame_mobility, frame_task, FrameTask,
                                                 in_axes, singular_mass as checked_mass,
                                                 TaskInertia)
from kane_dynamics.task_space.joint_walls import JointWalls, WALL
from kane_dynamics.task_space.law_kernel import (checked_effort, LanesOf,
                                                 Law, law_kernel, PoseLaw, Settings)
from kane_dynamics.task_space.orientation_error import pose_difference
from kane_dynamics.task_space.pose_checks import pose_margin
from kane_dynamics.task_space.reference_dynamics import reference_friction
from kane_dynamics.task_space.reference_motion import reference_motion, TargetMotion
import numpy as np
from numpy.typing import ArrayLike


@guarded_class
class OperationalSpace(PoseLaw):
    """
    Acceleration of a frame prescribed, with a posture in its null space.

    Parameters
    ----------
    robot : Robot
        A robot without beams.
    frame : str
        One of `frame_names` of a moving body.
    kp, kd : float or (6,) array_like
        1/s^2 and 1/s, in the axes; 100 and 20 by default.
    axes : str
        'world', 'frame' (the axes of the target), or a frame that is fixed to the world
        or to the body of `frame`.
    directions : sequence of str, optional
        The directions that are prescribed, of x, y, z, rx, ry, rz; the others belong to
        the null space. Default: as many as the frame can follow.
    posture : (n_q,) array_like, optional
        Positions of the joints for the null space. Default: damping alone.
    posture_kp, posture_kd : float or array_like
        1/s^2 and 1/s, one for each joint with a position.
    limit_stiffness, limit_margin : float or array_like, optional
        Soft walls before the joint limits, as of `CartesianImpedance`.
    effort_limit : float or array_like, optional
        The torques beside compensation and walls respect it, by one common factor.
        Default: the robot's.
    singular_mass : float, optional
        kg; see `TaskSpace`.

    Raises
    ------
    InputError
        Names the argument, what was given and what is expected.

    """

    _changeable = ('kp', 'kd', 'posture', 'posture_kp', 'posture_kd', 'limit_stiffness',
                   'limit_margin', 'effort_limit', 'singular_mass')

    def __init__(self, robot: Robot, frame: str, *, kp: ArrayLike = KP,
                 kd: ArrayLike = KD, axes: str = 'world',
                 directions: Sequence[str] | None = None,
                 posture: ArrayLike | None = None, posture_kp: ArrayLike | None = None,
                 posture_kd: ArrayLike = KD, limit_stiffness: ArrayLike | None = None,
                 limit_margin: ArrayLike | None = None,
                 effort_limit: ArrayLike | None = None,
                 singular_mass: float | None = None) -> None:
        """Check the settings and compile the kernel."""
        instance(robot, Robot, 'robot')
        self.robot = robot
        self._task = frame_task(robot, frame, axes, directions)
        self._walls = JointWalls(robot)
        joints = self._walls.count
        super().__init__(robot, Settings({
            'kp': (6,), 'kd': (6,), 'posture': (robot.n_q,), 'posture_kp': (joints,),
            'posture_kd': (joints,), 'singular_mass': (),
            'effort': (len(robot.joint_names),), **self._walls.shapes(*WALL)}))
        self.update(kp=kp, kd=kd, posture=posture, posture_kp=posture_kp,
                    posture_kd=posture_kd, limit_stiffness=limit_stiffness,
                    limit_margin=limit_margin, effort_limit=effort_limit,
                    singular_mass=singular_mass)
        _ = self._law  # compiles it

    def _checked(self, values: dict[str, Any]) -> dict[str, Any]:
        """Return the numbers of the kernel by name, from checked settings."""
        robot = self.robot
        names = [robot.joint_names[r] for r in self._walls.joints]
        posture = values['posture']
        posture_kp = values['posture_kp']
        # Without a posture its spring is switched off; the damping of the null space
        # stays.
        if posture is None:
            if posture_kp is not None:
                raise InputError(f'posture_kp: {posture_kp!r}, without a posture; '
                                 'expected a posture, (n_q,)')
            posture = np.zeros(robot.n_q)
            posture_kp = 0.0
        elif posture_kp is None:
            posture_kp = KP
        return {
            'kp': per_joint(values['kp'], 'kp', DIRECTIONS, part='direction'),
            'kd': per_joint(values['kd'], 'kd', DIRECTIONS, part='direction'),
            'posture': finite_row(posture, 'posture', robot.coordinate_names),
            'posture_kp': per_joint(posture_kp, 'posture_kp', names),
            'posture_kd': per_joint(values['posture_kd'], 'posture_kd', names),
            'singular_mass': checked_mass(robot, values['singular_mass']),
            'effort': checked_effort(robot, values['effort_limit']),
            **self._walls.settings(values['limit_stiffness'], values['limit_margin'])}

    def _kernel(self) -> Kernel:
        """Return the kernel of the law."""
        robot = self.robot
        task = self._task
        walls = self._walls
        shapes = self._shapes

        def law_of(choice: Robot, lanes_of: LanesOf) -> Law:
            return _law(choice, task, walls, shapes, lanes_of)
        inputs = {'q': (robot.n_q,), 'u': (robot.n,), 'pose': (4, 4), 'twist': (6,),
                  'acceleration': (6,), 'desired_wrench': (6,),
                  'settings': (shapes.size,)}
        name = identifier('operational_space', task.words)
        return law_kernel(robot, law_of, name, inputs, (len(robot.joint_names),))


def _law(robot: Robot, task: FrameTask, walls: JointWalls, shapes: Settings,
         lanes_of: LanesOf) -> Law:
    """Return the law as a function over any scalar; see the module."""
    equations = robot.equations
    tree = equations.tree
    frame = task.frame

    def law(q: Vector, u: Vector, target: Matrix, twist: Vector, acceleration: Vector,
            wrench: Vector, settings: Vector, *, t: Scalar, parameters: Vector
            ) -> Vector:
        values = shapes.unpacked(settings)
        lanes = lanes_of(q[0])
        axes = task.in_world(target[:3, :3])
        motion = equations.joint_motion(q, u, equations.zeros, t)
        J = in_axes(axes, equations.partial_velocities(frame, q, t))
        mobility = frame_mobility(equations, J, q, parameters, t, lanes)
        inertia = TaskInertia(task, mobility, values['singular_mass'])

        # The acceleration of the frame, in the axes.
        measured = equations.frame_pose(frame, q, t)
        displacement, orientation = pose_difference(measured, target, axes)
        # The gradient of half the square of the orientation error is the error up to
        # `FADE`, and does not jump at half a turn.
        turn = orientation.moment(orientation.vector)
        error = np.concatenate([displacement, turn])
        lag = in_axes(axes, twist - equations.frame_velocity(frame, q, u, t))
        drift = equations.frame_acceleration(frame, q, u, equations.zeros, t)
        corrected = (in_axes(axes, acceleration - drift) + values['kd'] * lag
                     - values['kp'] * error)
        force = inertia.momentum(corrected)
        force = force + mobility.force(in_axes(axes, wrench))

        # The posture, by accelerations of the joints.
        stretch = np.zeros(len(motion.qdot)).astype(object)
        for k, (r, place) in enumerate(zip(walls.joints, walls.places)):
            stretch[r] = (values['posture_kp'][k] * (values['posture'][place] - q[place])
                          - values['posture_kd'][k] * motion.qdot[r])
        M_q = tree.mass_matrix(q, parameters)
        force = force + inertia.null_force(motion.projected(M_q @ stretch))

        # The bias force, with friction at the rates of the reference motion.
        rigid = equations.rigid_dynamics(q, u, equations.zeros, None, parameters, t)
        desired = TargetMotion(axes, twist, acceleration)
        u_r, udot_r = reference_motion(equations, task, inertia, q, u, desired, t)
        drift = motion.qddot + motion.T_rate @ (u_r - u)
        friction = reference_friction(equations, q, motion.T @ u_r,
                                      drift + motion.T @ udot_r, rigid, t)
        at_walls = walls.force(q, motion.qdot, values, lanes)
        held = rigid + motion.projected(friction + at_walls)

        tau, _ = within_limits(equations.shared_torques(q, held, t),
                               equations.shared_torques(q, force, t), values['effort'],
                               lanes)
        if equations.actuated is not None:
            tau = nan_unless(tau, transmission_margin(equations.mechanism, motion.T,
                                                      equations.actuated))
        return nan_unless(tau, pose_margin(target))
    return law
