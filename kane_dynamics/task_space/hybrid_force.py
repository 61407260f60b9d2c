"""
Hybrid force control: a force along some directions, an impedance along the others.

Along a force direction, with the desired wrench w_d and the measured one w_m that the
frame exerts on the environment, and the frame's velocity v:

    f = c - (|c| / approach_speed + m / s) v,    c = w_d + gain (w_d - w_m) + I

so that without contact the frame approaches at most at `approach_speed`, and in contact
the same damper keeps it from bouncing. I is the integral of `integral_gain` times the
error, in contact alone, bounded. m is the mass of the frame along the direction. Source
of the separation: M. Raibert, J. Craig, "Hybrid position/force control of manipulators",
J. Dyn. Sys. Meas. Control 103, 1981.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any

from kane_dynamics._util.checks import finite_row, number, per_joint
from kane_dynamics._util.fixed_attributes import guarded_class
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import magnitude, select
from kane_dynamics.mechanics.constraints.conditioning import guarded as nan_unless
from kane_dynamics.mechanics.constraints.transmission import transmission_margin
from kane_dynamics.native.python_call.entry import FIXED, KEYWORD, NUMBER
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Shape
from kane_dynamics.robot.methods.frame_methods import DIRECTIONS
from kane_dynamics.robot.robot import Robot
from kane_dynamics.robot.robot_function import identifier
from kane_dynamics.task_space.cartesian_impedance import (CartesianImpedance,
                                                          impedance_forces)
from kane_dynamics.task_space.frame_task import checked_directions, FrameTask, in_axes
from kane_dynamics.task_space.joint_walls import JointWalls
from kane_dynamics.task_space.law_kernel import (LanesOf, Law, law_kernel,
                                                 Settings)
from kane_dynamics.task_space.pose_checks import pose_margin
from kane_dynamics.task_space.reference_motion import TargetMotion
from kane_dynamics.task_space.stiffness import checked_matrix
import numpy as np
from numpy.typing import ArrayLike

GAIN = 0.5  # default of `force_gain`
INTEGRAL_GAIN = 2.0  # 1/s, default
INTEGRAL_LIMIT = 0.5  # of the desired force
LINEAR_APPROACH = 0.05  # m/s, default
ANGULAR_APPROACH = 0.2  # rad/s, default
DRAG = 2.0  # 1/s: rate at which motion along a force direction decays without a force
HELD = 0.5  # largest decay of a motion in a period, half of what one period of delay bears


@guarded_class
class HybridForce(CartesianImpedance):
    """
    A wrench kept along some directions, and a Cartesian impedance along the others.

    Parameters
    ----------
    robot, frame, stiffness, axes, ...
        As of `CartesianImpedance`, whose other settings are accepted too. Stiffness and
        damping along the force directions are left out, and the motion of the target
        along them is not used.
    force_directions : sequence of str
        Of x, y, z, rx, ry, rz, in the axes.
    force_gain : float
        Of the error of the force; 0.5 by default.
    integral_gain : float
        1/s, of its integral.
    approach_speed : float or (6,) array_like, optional
        Largest speed without contact, m/s and rad/s. Default: 0.05 and 0.2. About light
        axes it is larger, twice the acceleration by the force in a period (`elapsed`),
        since a controller with this period can hold no stronger damper.

    Attributes
    ----------
    integral : (6,) array
        The integral I, N and N m, in the axes; `reset` makes it zero.

    """

    _changeable = (*CartesianImpedance._changeable, 'force_gain', 'integral_gain',
                   'approach_speed')
    _arguments = (*CartesianImpedance._arguments, ('measured', KEYWORD),
                  ('integral', FIXED), ('elapsed', NUMBER))
    _memory = 'integral'

    def __init__(self, robot: Robot, frame: str, *, force_directions: Sequence[str],
                 stiffness: ArrayLike, force_gain: float = GAIN,
                 integral_gain: float = INTEGRAL_GAIN,
                 approach_speed: ArrayLike | None = None, **impedance: Any) -> None:
        """Check the settings and compile the kernel."""
        self._forced = checked_directions(force_directions, 'force_directions')
        self._further = {'force_gain': force_gain, 'integral_gain': integral_gain,
                         'approach_speed': approach_speed}
        self._integral = np.zeros(6)  # which every call updates
        self._step = np.zeros(1)
        super().__init__(robot, frame, stiffness=stiffness, **impedance)

    @property
    def integral(self) -> Array:
        """Return the integral of the force's error."""
        return self._integral.copy()

    def reset(self) -> None:
        """Set the integral of the force's error to zero."""
        self._integral[:] = 0.0

    def _layout(self) -> dict[str, Shape]:
        """Return the names and shapes of the kernel's settings."""
        return {**super()._layout(), 'force_gain': (), 'integral_gain': (),
                'approach_speed': (6,)}

    def _checked(self, values: dict[str, Any]) -> dict[str, Any]:
        """Return the numbers of the kernel by name, from checked settings."""
        # Without stiffness and damping along the force directions.
        moved = dict(values)
        for name in ('stiffness', 'damping'):
            if values[name] is not None:
                moved[name] = self._without_forced(values[name], name)
        checked = super()._checked(moved)
        # The speed of approach without contact: damping holds the commanded force
        # there.
        approach = values['approach_speed']
        if approach is None:
            approach = 3 * [LINEAR_APPROACH] + 3 * [ANGULAR_APPROACH]
        speeds = per_joint(approach, 'approach_speed', DIRECTIONS, part='direction')
        if not speeds.all():
            raise InputError(f'approach_speed: {speeds.tolist()}; expected positive '
                             'numbers, m/s and rad/s')
        positive = 'a finite number >= 0'
        for name in ('force_gain', 'integral_gain'):
            checked[name] = number(values[name], name, positive,
                                   lambda x: 0.0 <= x < math.inf)
        return {**checked, 'approach_speed': speeds}

    def _without_forced(self, value: ArrayLike, what: str) -> Array:
        """Return a stiffness or damping, (6, 6), with zeros along the forces; checked."""
        matrix = checked_matrix(value, what)
        forced = list(self._forced)
        matrix[forced] = 0.0
        matrix[:, forced] = 0.0
        return matrix

    def torque(self, q: ArrayLike, u: ArrayLike, pose: ArrayLike,
               twist: ArrayLike | None = None, acceleration: ArrayLike | None = None,
               wrench: ArrayLike | None = None, t: float = 0.0, *,
               measured: ArrayLike | None = None, elapsed: float = 0.0) -> Array:
        """
        Return the torques of the joints, (n_q,).

        Parameters
        ----------
        q, u, pose, twist, acceleration, t
            As of `CartesianImpedance.torque`.
        wrench : (6,) array_like, optional
            Force and moment to exert on the environment, at the frame's origin, world
            axes, N, N m; along the force directions it is kept.
        measured : (6,) array_like, optional
            Wrench of the environment on the frame, as of `frame_wrench` or a sensor, at
            the same point and in the same axes. Without it there is no feedback of the
            force.
        elapsed : float
            Time since the last call, s, for the integral.

        Raises
        ------
        InputError
            A wrong shape, a number that is not finite, or no pose.
        ConstraintError
            The configuration is open or singular.

        """
        elapsed = number(elapsed, 'elapsed', 'a finite time in s, not negative',
                         lambda x: 0.0 <= x < math.inf)
        # Fields in local names: each read of an object with hints costs as much as ten.
        call = self.__dict__['_call'] or self._call_fields()
        law, block, zero, step, integral = call
        step[0] = elapsed
        if twist is None:
            twist = zero
        if acceleration is None:
            acceleration = zero
        desired = zero if wrench is None else wrench
        if measured is None:  # as if the force were exactly the desired one
            measured = -finite_row(desired, 'wrench', DIRECTIONS, part='direction')
        torques: Array = law(q, u, pose, twist, acceleration, desired, measured, integral,
                             step, block, t)
        return torques

    def _call_fields(self) -> tuple[Any, ...]:
        """Return and keep what a call reads."""
        common = super()._call_fields()
        self._call = *common, self._step, self._integral
        return self._call

    def _stand_ins(self) -> dict[str, Any]:
        """Return the values of arguments that are left out, and of fixed ones."""
        return {**super()._stand_ins(), 'integral': self._integral, 'elapsed': 0.0}

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes of a copy, with its own integral."""
        return {**super().__getstate__(), '_integral': self._integral.copy(),
                '_step': self._step.copy()}

    def _kernel(self) -> Kernel:
        """Return the kernel of the torques and the integral."""
        robot = self.robot
        task = self._task
        shapes = self._shapes
        walls = self._walls
        forced = self._forced

        def law_of(choice: Robot, lanes_of: LanesOf) -> Law:
            return _law(choice, task, forced, walls, shapes, lanes_of)
        size = len(robot.joint_names) + 6
        inputs = {'q': (robot.n_q,), 'u': (robot.n,), 'pose': (4, 4), 'twist': (6,),
                  'acceleration': (6,), 'desired_wrench': (6,), 'measured': (6,),
                  'integral': (6,), 'elapsed': (1,),
                  'settings': (shapes.size,)}
        # Tasks of other directions have other kernels.
        name = identifier('hybrid_force', task.words, *map(str, forced))
        return law_kernel(robot, law_of, name, inputs, (size,))


def _law(robot: Robot, task: FrameTask, forced: Sequence[int], walls: JointWalls,
         shapes: Settings, lanes_of: LanesOf) -> Law:
    """Return the law as a function over any scalar; see the module."""
    equations = robot.equations
    moving = np.ones(6)
    moving[list(forced)] = 0.0

    def law(q: Vector, u: Vector, target: Matrix, twist: Vector, acceleration: Vector,
            wrench: Vector, measured: Vector, integral: Vector, elapsed: Vector,
            settings: Vector, *, t: Scalar, parameters: Vector) -> Vector:
        values = shapes.unpacked(settings)
        axes = task.in_world(target[:3, :3])

        # The motion of the target without its part along the force directions.
        parts = []
        for six in (twist, acceleration):
            along = moving * in_axes(axes, six)
            parts.append(in_axes(axes.T, along))
        desired = TargetMotion(axes, *parts)
        forces = impedance_forces(robot, task, walls, (q, u, t, parameters), target,
                                  desired, values, lanes_of(q[0]))

        # The wrench to exert, in the axes: as desired along the impedance.
        wanted = in_axes(axes, wrench)
        exerted = -in_axes(axes, measured)
        command = np.array(wanted, dtype=object)
        integrated = np.zeros(6).astype(object)
        # Force directions: proportional and integral feedback, damped to the speed of
        # approach.
        for i in forced:
            error = wanted[i] - exerted[i]
            integrated[i] = _integrated(integral[i], error, exerted[i] * wanted[i],
                                        wanted[i], elapsed[0] * values['integral_gain'])
            pushed = wanted[i] + values['force_gain'] * error + integrated[i]
            mobility = forces.mobility.W[i, i] + 1.0 / values['singular_mass']
            damping = (magnitude(pushed) / values['approach_speed'][i]
                       + DRAG / mobility)
            # A torque that is held for a period makes a stronger damper oscillate.
            sampled = damping * mobility * elapsed[0]
            damping = damping / select(sampled > HELD, sampled / HELD, 1.0)
            command[i] = pushed - damping * forces.velocity[i]
        tau, _, _ = forces.torques(equations, forces.mobility.force(command),
                                   values['effort'])
        if equations.actuated is not None:
            tau = nan_unless(tau, transmission_margin(equations.mechanism,
                                                      equations.at_rest(q, t).T,
                                                      equations.actuated))
        tau = nan_unless(tau, pose_margin(target))
        return np.concatenate([tau, integrated])
    return law


def _integrated(integral: Scalar, error: Scalar, contact: Scalar, wanted: Scalar,
                gain: Scalar) -> Scalar:
    """Return the integral after a step, which grows in contact alone."""
    moved = integral + select(contact > 0.0, gain * error, 0.0)
    bound = INTEGRAL_LIMIT * magnitude(wanted)
    moved = select(bound < moved, bound, moved)
    return select(moved < -bound, -bound, moved)
