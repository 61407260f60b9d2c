"""The parts of a controller as kernels, for `Robot.export_c`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.checks import instance
from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.control.collision_detection import detector_step
from kane_dynamics.control.computed_torque import followed_joints, law_kernel
from kane_dynamics.control.momentum_observer import (friction_beyond_speeds,
                                                     later_deflections, residual_step)
from kane_dynamics.control.torque_limiter import within_effort, within_rates
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints.conditioning import guarded
from kane_dynamics.model.elastic_model import require_rigid_joints
from kane_dynamics.native.runtime.kernel import Argument, Kernel
from kane_dynamics.native.tracing.program import Shape
from kane_dynamics.robot.robot import Robot
import numpy as np


def controller_kernels(robot: Robot, *, followed: Sequence[str] | None = None
                       ) -> tuple[Kernel, Kernel, Kernel, Kernel]:
    """
    Return kernels of computed torque, limits, observer and detector, for `export_c`.

    They are traced from the functions that `Controller`, `TorqueLimiter`,
    `MomentumObserver` and `CollisionDetector` use. In C, after the name of the file:

    - ``computed_torque(q, u, q_d, u_d, udot_d, gains, ...)``: joint torques, (n_q,);
      gains are kp, then kd. Desired values and gains are of the joints that follow.
    - ``limited_torque(tau, last, effort, change)``: the torque clamped to the effort,
      then to a change from the last command; change is the limit of the rate times the
      time since.
    - ``momentum_observer(q, u, tau, memory, elapsed, forgotten, ...)``: the memory is
      the estimate of the external torques, the momenta and the torques beta, (3, n), of
      the sample before; the result is that of this sample. tau are the mean joint
      torques since, (n_q,), and `forgotten` exp(-K elapsed) of each speed. Begin with an
      elapsed time of 0, which sets the estimate to 0. Of a robot with presliding friction
      the memory, (5 n + n_b,), goes on with the speeds, the friction that beta lacks, and
      the deflections of the bristles, which begin at 0, too.
    - ``collision_detector(torque, threshold, settings, memory, elapsed)``: the memory,
      (n + 3,), is the flag (1: collision), 1 + the index of the speed that set it, the
      time for which all torques have been below their release, and the times for which
      each torque has been beyond its threshold, s; times are -1 where that does not
      hold. The settings are `confirm`, `release` and `clear` of `CollisionDetector`.
      Begin with an elapsed time of 0, which clears the flag.

    With constraints the first number of computed torque and of the observer is NaN where
    the library raises an error: the loops are open, or the configuration is singular.
    After NaN the observer begins again with an elapsed time of 0.

    Parameters
    ----------
    robot : Robot
        Of any kind that `Controller` accepts.
    followed : sequence of str, optional
        With chosen speeds or constraints: the joints that follow the motion, as for
        `Controller`.

    Raises
    ------
    InputError
        The robot has beams, or chosen speeds or constraints together with ball joints;
        `followed` is not a choice of as many joints as there are independent speeds.

    """
    instance(robot, Robot, 'robot')
    require_rigid_joints(robot.model)
    # In joint rates all joints follow; elsewhere some of them determine the others.
    if robot.equations.in_joint_rates:
        if followed is not None:
            raise InputError(f'followed: {list(followed)}; expected None, because all '
                             'joints of this robot follow the motion')
        law = law_kernel(robot)
    else:
        require_angles(robot.model, 'controller_kernels')
        law = law_kernel(robot, followed_joints(robot, followed), commanded=True)
    return law, _limiter(robot), _observer(robot), _detector(robot)


def _limiter(robot: Robot) -> Kernel:
    """Return the kernel of the torque limits of all joints."""
    def limits(tau: Vector, last: Vector, effort: Vector, change: Vector) -> Vector:
        # Clamped to the effort first, then within the largest change of a cycle.
        return np.array(within_rates(within_effort(tau, effort), last, change))
    row = (robot.n_q,)
    return robot.compiled(limits, name='limited_torque', tau=row, last=row, effort=row,
                          change=row, shape=row)


def _observer(robot: Robot) -> Kernel:
    """Return the kernel of a step of the momentum observer."""
    equations = robot.equations
    n = robot.n
    bristles = len(equations.tree.bristles)

    def step(q: Vector, u: Vector, tau: Vector, memory: Any, elapsed: Scalar,
             forgotten: Vector, t: Scalar, parameters: Vector, limits: Vector) -> Any:
        remembered = np.ravel(memory)
        residual, last_momentum, last_beta = remembered[:3 * n].reshape(3, n)
        momentum, beta = equations.momentum_terms(q, u, parameters, t)
        tau = equations.generalized_force(q, tau, t)
        # The first sample has no time since the last: the estimate is 0.
        has_begun = elapsed > 0.0
        further: list[Scalar] = []  # that a robot with bristles remembers
        if bristles:
            motion = _bristled(q, u, tau, remembered[3 * n:], elapsed, t)
            tau = tau - motion.mean_friction
            further = [*u, *motion.friction, *motion.deflections]
        elif equations.carries_loads:
            tau = tau - equations.load_friction(q, u, tau, t)
        safe_elapsed = select(has_begun, elapsed, 1.0)
        estimate = residual_step(residual, last_momentum, momentum, tau,
                                 0.5 * (last_beta + beta), safe_elapsed, forgotten)
        estimate = [select(has_begun, x, 0.0) for x in estimate]
        result = np.array([*estimate, *momentum, *beta, *further]).reshape(shape)
        if not equations.watched:  # a tree has no singular or open configuration
            return result
        return guarded(result, equations.margin(q, t, limits))

    def _bristled(q: Vector, u: Vector, tau: Vector, remembered: Vector, elapsed: Scalar,
                  t: Scalar) -> _Bristled:
        """Return the friction of bristles after the time since the last sample."""
        has_begun = elapsed > 0.0
        last = [select(has_begun, x, 0.0) for x in remembered]
        last_u, last_friction, deflections = np.split(np.array(last), [n, 2 * n])
        later = later_deflections(equations, q, 0.5 * (last_u + u), deflections, tau,
                                  select(has_begun, elapsed, 0.0), t)
        friction = friction_beyond_speeds(equations, q, u, tau, later, t)
        return _Bristled(0.5 * (last_friction + friction), friction, later)
    row = (n,)
    shape: Shape = (3, n)
    if bristles:
        shape = (5 * n + bristles,)
    inputs: dict[str, Shape | Argument] = {
        'q': (robot.n_q,), 'u': row, 'tau': (robot.n_q,), 'memory': shape,
        'elapsed': (), 'forgotten': row}
    return robot.kernels.compiled(step, 'momentum_observer', inputs, shape)


class _Bristled(NamedTuple):
    """Friction beyond that of speeds, (n,), its mean since the last sample, deflections."""

    mean_friction: Vector
    friction: Vector
    deflections: Vector


def _detector(robot: Robot) -> Kernel:
    """Return the kernel of a step of the collision detector."""
    names = robot.speed_names

    def step(torque: Vector, threshold: Vector, settings: Vector, memory: Vector,
             elapsed: Scalar) -> Vector:
        return detector_step(names, torque, threshold, settings, memory, elapsed)
    row = (robot.n,)
    # Filtered torques, then what the detector remembers of the collision.
    memory = (robot.n + 3,)
    return robot.compiled(step, name='collision_detector', torque=row, threshold=row,
                          settings=(3,), memory=memory, elapsed=(), shape=memory)
