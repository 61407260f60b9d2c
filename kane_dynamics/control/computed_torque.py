"""
Computed torque: the law, one program for all of its uses, and the torque source.

As many joints as there are independent speeds follow the motion; the others follow from
the constraints. With q' = T u + X, and the rows of these joints marked by c,

    T_c udot = q''_d + kd (q'_d - q'_c) + kp (q_d - q_c) - q''_c(udot = 0),

so that the errors of these joints obey e'' + kd e' + kp e = 0 for every choice of
speeds. The torque is T^T times the joint forces of that motion, with friction at the
desired joint rates: compensation at the measured rates would accelerate an arm at rest.
In joint rates without constraints T = 1, all joints follow, and the law is

    tau = ID_rigid(q, u, udot_d + kd (u_d - u) + kp (q_d - q)) + friction(u_d).

At rest and at reversals friction is that of the robot's choice, `feedforward_friction`.

`Controller` calls it as a kernel; native simulation and sweeps call it as a subroutine
of their steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
import warnings

from kane_dynamics._util.checks import names_of_joints, per_joint, robot_like
from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints.conditioning import guarded, largest_residuals
from kane_dynamics.mechanics.constraints.mechanism import JointMotion
from kane_dynamics.mechanics.constraints.transmission import (require_transmission,
                                                              transmission_margin)
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.model.elastic_model import require_rigid_joints
from kane_dynamics.motion.motion import Motion, State
from kane_dynamics.native.runtime.kernel import Argument, Kernel
from kane_dynamics.native.tracing.program import Program, Shape
from kane_dynamics.robot.methods.configuration_methods import warn_of_degrees
from kane_dynamics.robot.robot import in_choice, Robot
import numpy as np
from numpy.typing import ArrayLike

NAME = 'computed_torque'
DESIRED = ('q_d', 'u_d', 'udot_d')  # of the joints that follow
KP, KD = 100.0, 20.0  # default gains, 1/s^2 and 1/s: critically damped


# -------------------------------------------------------------------------------------
# The joints that follow.

def followed_joints(robot: Robot,
                    followed: Sequence[str] | None = None) -> tuple[int, ...]:
    """
    Return the indices of the joints that follow a motion, as many as independent speeds.

    Parameters
    ----------
    robot : Robot
        The robot whose joints follow.
    followed : sequence of str, optional
        Their names. Default: all joints without constraints; else those whose rates are
        the independent speeds, or else those with actuators.

    Raises
    ------
    InputError
        An unknown joint, another number of joints, no default, or a robot with beams.

    """
    require_rigid(robot)
    names = robot.coordinate_names
    n = robot.n
    if followed is None:
        followed = _default_joints(robot)
    # As many as independent speeds, each once, and joints with a coordinate.
    distinct = set(names_of_joints(followed, 'followed'))
    if not len(followed) == len(distinct) == n or not distinct <= set(names):
        raise InputError(f'followed: {list(followed)}; expected {n} of the joints '
                         f'{list(names)}, as many as there are independent speeds')
    return tuple(map(names.index, followed))


def _default_joints(robot: Robot) -> Sequence[str]:
    """Return the joints that follow by default; InputError if there is no default."""
    names = robot.coordinate_names
    # Joint rates; named speeds that are joint rates; or as many actuators as degrees of
    # freedom.
    if robot.n == robot.n_q:
        return names
    if robot.mechanism.speeds.key and set(robot.speed_names) <= set(names):
        return robot.speed_names
    actuated = robot.equations.actuated
    if actuated is not None and len(actuated) == robot.n:
        return tuple(names[k] for k in actuated)
    raise InputError(f'followed: missing; expected {robot.n} of the joints '
                     f'{list(names)}, which follow the motion, because the independent '
                     'speeds are not joint rates')


def joints_that_follow(robot: Robot) -> tuple[int, ...]:
    """Return the indices of the joints that follow motions: all joints of trees."""
    if robot.equations.in_joint_rates:
        return tuple(range(robot.n_q))
    return followed_joints(robot)


def require_rigid(robot: Robot) -> None:
    """Raise InputError for beams or elastic joints, which laws would misjudge."""
    robot_like(robot)
    require_rigid_joints(robot.model)
    if robot.model.modal_coordinates:
        raise InputError('robot: with beams; expected the rigid model, such as '
                         'stiffened(model), because no actuator moves the coordinates '
                         'of bending')


def motion_columns(robot: Robot, followed: Sequence[int],
                   names: Sequence[str]) -> list[int]:
    """
    Return the columns of a motion's joints that are those that follow it.

    InputError unless the motion is of these joints, in their order, or of all joints in
    theirs.
    """
    # A motion of the joints that follow, or of all joints, in the robot's order.
    joints = robot.coordinate_names
    following = [joints[k] for k in followed]
    if list(names) == following:
        return list(range(len(followed)))
    if tuple(names) == tuple(joints):
        return list(followed)
    expected = str(following)
    if following != list(joints):
        expected += f', or all: {list(joints)}'
    raise InputError(f'motion: of the joints {list(names)}; expected {expected}')


def require_closed(robot: Robot, positions: Array, times: Array) -> None:
    """
    Raise InputError unless points of a motion of all joints, (K, n_q), are closed.

    The limit is `closure_tolerance`; None for none.
    """
    if positions.shape[1] != robot.n_q:  # of the joints that follow alone
        return
    # The tolerance that calls of the robot have, unless the user switched it off.
    limits = robot.parameters.closure_tolerance
    if limits is None:
        return
    residual = np.abs(robot.constraint_residual(positions, t=times))
    allowed = largest_residuals(robot.mechanism, limits)
    if (residual <= allowed).all():
        return
    # The largest violation, relative to its limit.
    point, row = np.unravel_index(np.argmax(residual / allowed), residual.shape)
    raise InputError(f"motion: the residual of '{robot.constraint_names[row]}' is "
                     f'{residual[point, row]:.3g} (m or rad) in point {point + 1}; '
                     'expected closed configurations, as from '
                     'robot.closed_configuration, or a motion of the independent joints')


# -------------------------------------------------------------------------------------
# The law.

def corrected_acceleration(q: Vector, u: Vector, q_d: Vector, u_d: Vector,
                           udot_d: Vector, kp: Vector, kd: Vector) -> Vector:
    """Return the corrected acceleration of computed torque, (n,) or (N, n)."""
    return udot_d + (kd * (u_d - u) + kp * (q_d - q))


def followed_rates(equations: Equations, places: Sequence[int], q: Vector, u: Vector,
                   accelerations: Vector, t: Scalar = 0.0) -> Vector:
    """Return udot, (n,), of T_c udot = accelerations of the joints c - those at udot = 0."""
    motion = equations.joint_motion(q, u, equations.zeros, t)
    chosen = list(places)
    right = accelerations - motion.qddot[chosen]
    udot: Vector = equations.mechanism.solved(motion.T[chosen], right)
    return udot


def followed_friction(equations: Equations, places: Sequence[int], q: Vector,
                      motion: JointMotion, u_d: Vector, udot_d: Vector, load: Vector,
                      t: Scalar) -> Vector:
    """
    Return the friction of all joints in a desired motion of those that follow, (n_j,).

    Parameters
    ----------
    equations : Equations
        Of the robot.
    places : sequence of int
        The joints that follow.
    q : (n_q,) array
        Measured, rad or m.
    motion : JointMotion
        Measured, with udot = 0.
    u_d, udot_d : (n,) arrays
        Desired rates and accelerations of the joints that follow.
    load : (n,) array
        Generalized force of the motors without friction.
    t : scalar
        s.

    """
    mechanism = equations.mechanism
    # Loads of the drives follow from the force of the motors.
    T_c = motion.T[places]
    loads = None
    if equations.carries_loads:
        loads = equations.drive_torques(q, load, t)

    # Rates and accelerations of all joints for the desired ones, without the feedback.
    du = mechanism.solved(T_c, u_d - motion.qdot[places])
    drift = motion.qddot + motion.T_rate @ du
    udot = mechanism.solved(T_c, udot_d - drift[places])
    return equations.tree.feedforward_friction(motion.qdot + motion.T @ du,
                                               drift + motion.T @ udot, loads)


def law_program(robot: Robot, followed: Sequence[int] | None = None,
                commanded: bool = False) -> Program:
    """
    Trace the law; arguments as in `law_kernel`, then the robot's parameters.

    The result is dual to the independent speeds, (n,), without a check of the
    configuration. With `commanded` it is the torques of the joints, (n_q,), NaN where
    calls of the robot are refused. In joint rates both are the same.
    """
    law = law_of(robot, followed, commanded)
    return robot.kernels.function(law, NAME, _inputs(robot)).program()


def law_of(robot: Robot, followed: Sequence[int] | None = None, commanded: bool = False
           ) -> Callable[..., Vector]:
    """Return the function of `law_program`; all joints follow by default."""
    equations = robot.equations
    mechanism = equations.mechanism
    tree = equations.tree
    n = equations.n
    places = list(range(n))
    if followed is not None:
        places = list(followed)

    def law(q: Vector, u: Vector, q_d: Vector, u_d: Vector, udot_d: Vector,
            gains: Vector, wrench: Any, t: Scalar, parameters: Vector,
            limits: Vector) -> Vector:
        motion = equations.joint_motion(q, u, equations.zeros, t)
        T_c = motion.T[places]

        # Accelerations of all joints for the corrected ones of those that follow.
        corrected = corrected_acceleration(q[places], motion.qdot[places], q_d, u_d,
                                           udot_d, gains[:n], gains[n:])
        udot = mechanism.solved(T_c, corrected - motion.qddot[places])
        qddot = motion.qddot + motion.T @ udot
        rigid = np.array(tree.rigid_dynamics(q, motion.qdot, qddot, wrench, parameters))
        friction = followed_friction(equations, places, q, motion, u_d, udot_d,
                                     motion.projected(rigid), t)
        tau = motion.projected(rigid + friction)
        if not commanded:
            return tau
        # The torques of the actuators, with NaN where they or the followed joints do not
        # determine the motion, or where the configuration is open or singular.
        tau = equations.joint_torques(tau, q, t)
        if equations.watched:
            tau = guarded(tau, equations.margin(q, t, limits))
        return guarded(tau, transmission_margin(mechanism, motion.T, places))
    return law


def law_kernel(robot: Robot, followed: Sequence[int] | None = None,
               commanded: bool = False) -> Kernel:
    """
    Return the law as a kernel of the robot; results as of `law_program`.

    Its arguments are q (n_q,), u (n,); q, q', q'' desired of the joints that follow,
    (n,) each; the gains: kp, then kd, (2 n,); then wrenches and time where the robot has
    them.
    """
    # Trees need no choice of joints: all follow.
    if robot.equations.in_joint_rates:
        law = law_of(robot)
        return robot.kernels.compiled(law, NAME, _inputs(robot), (robot.n,))
    assert followed is not None
    name = f'{NAME}_{"_".join(map(str, followed))}'
    size = robot.n_q
    if not commanded:
        name += '_anywhere'
        size = robot.n

    # Asked when the law is NaN: where the chosen speeds are singular, others may be
    # regular.
    def reason(state: dict[str, Array]) -> Kernel | None:
        """Return the law in speeds that are regular at a state, or raise the error."""
        regular = robot.speed_sets.instead(robot.mechanism, state)
        t = float(state.get('t', np.zeros(())))
        require_following(robot, followed, state['q'], t)
        if regular is None or regular.equations.in_joint_rates:
            return None
        choice = regular.equations.mechanism
        return law_kernel(in_choice(robot, choice.free, choice.kept), followed,
                          commanded)
    law = law_of(robot, followed, commanded)
    return robot.kernels.compiled(law, name, _inputs(robot), (size,), reason=reason)


def _inputs(robot: Robot) -> dict[str, Shape | Argument]:
    """Return the inputs of the law: measured, then desired; gains."""
    n = robot.n
    desired: dict[str, Shape | Argument] = {}
    for name in DESIRED:
        desired[name] = (n,)
        if robot.equations.in_joint_rates:  # errors name the joints
            desired[name] = Argument(name, (n,), robot.coordinate_names)
    return {'q': (robot.n_q,), 'u': (n,), **desired, 'gains': (2 * n,)}


def require_following(robot: Robot, followed: Sequence[int], q: Array, t: float,
                      where: str = '', share: float = 1.0) -> None:
    """Raise ConstraintError where these joints do not determine the motion."""
    equations = robot.equations
    T = np.array(equations.at_rest(q, t).T, dtype=np.float64)
    if equations.actuated is not None:
        require_transmission(robot.mechanism, T, equations.actuated, True, q, where,
                             share)
    require_transmission(robot.mechanism, T, followed, False, q, where, share)


def law_margin(robot: Robot, followed: Sequence[int], q: Vector, t: Scalar) -> Scalar:
    """Return a traced number, positive where `require_following` raises no error."""
    equations = robot.equations
    T = equations.at_rest(q, t).T
    margin = transmission_margin(equations.mechanism, T, followed)
    if equations.actuated is None:
        return margin
    return margin + transmission_margin(equations.mechanism, T, equations.actuated) - 1.0


# -------------------------------------------------------------------------------------
# The torque source.

@dataclass(frozen=True, eq=False, init=False)
class ComputedTorque:
    """
    Computed torque on a desired motion, as a torque source of `simulate`.

    ``tau = ID(q, u, udot_d + kd (u_d - u) + kp (q_d - q))``, with the dynamics of
    `robot`.

    With chosen speeds or constraints, as many joints as there are independent speeds
    follow the motion, with the errors ``e'' + kd e' + kp e = 0``; see the module.

    Parameters
    ----------
    robot : Robot
        The simulated robot. The former order (motion, kp, kd) still works, with a
        DeprecationWarning.
    motion : Motion
        Motion of the robot's joints, in their order; or of the followed ones, in theirs.
    kp : float or (n,) array_like
        1/s^2, finite, not negative; default: 100.
    kd : float or (n,) array_like
        1/s, finite, not negative; default: 20.
    followed : sequence of str, optional
        The n joints that follow the motion, in the order of the gains. Default: those of
        the motion if it has n; else those whose rates are the independent speeds, or the
        n with actuators. Robots without chosen speeds or constraints: all.

    Raises
    ------
    InputError
        Names the argument, or the gain, the joint and the value; or the point of a
        motion of all joints that violates a constraint. The robot has beams.

    """

    robot: Robot | None
    motion: Motion
    kp: Array
    kd: Array
    followed: tuple[int, ...]
    columns: list[int]

    def __init__(self, robot: Robot | Motion, motion: Motion | ArrayLike | None = None,
                 kp: ArrayLike | None = None, kd: ArrayLike | None = None, *,
                 followed: Sequence[str] | None = None) -> None:
        """Check the gains; one number applies to all joints."""
        simulated: Robot | None = None
        if isinstance(robot, Motion):  # the former order: (motion, kp, kd)
            warnings.warn('ComputedTorque(motion, kp, kd) is deprecated; expected '
                          'ComputedTorque(robot, motion, kp, kd)', DeprecationWarning,
                          stacklevel=2)
            former: Any = (motion, kd if kp is None else kp)
            kp, kd = (kp, kd) if motion is None else former
            motion = robot
        elif isinstance(robot, Robot):
            simulated = robot
            require_angles(robot.model, 'ComputedTorque')
        else:
            raise InputError(f'robot: a {type(robot).__name__}; expected a Robot: the '
                             'order is (robot, motion, kp, kd)')
        if not isinstance(motion, Motion):
            raise InputError(f'motion: a {type(motion).__name__}; expected a Motion: '
                             'the order is (robot, motion, kp, kd)')
        # Without a robot, the motion's own joints.
        places = list(range(motion.n))
        columns = places
        if simulated is not None:
            places, columns = _followed(simulated, motion, followed)
        # The record is frozen: its fields are set once, after their checks.
        freeze(self, 'robot', simulated)
        freeze(self, 'motion', motion)
        freeze(self, 'followed', tuple(places))
        freeze(self, 'columns', columns)
        names = [motion.joint_names[k] for k in columns]
        freeze(self, 'kp', per_joint(KP if kp is None else kp, 'kp', names))
        freeze(self, 'kd', per_joint(KD if kd is None else kd, 'kd', names))

    def desired(self, t: Array) -> State:
        """Return q, u, udot of the followed joints at times (K,), s, (K, n) arrays."""
        q, u, udot = self.motion.sample(t)
        if len(self.columns) == self.motion.n:
            return q, u, udot
        return q[:, self.columns], u[:, self.columns], udot[:, self.columns]


def _followed(robot: Robot, motion: Motion, followed: Sequence[str] | None
              ) -> tuple[list[int], list[int]]:
    """Return the indices of the followed joints, and their columns of the motion."""
    require_rigid(robot)
    if robot.equations.in_joint_rates:
        if motion.joint_names != robot.joint_names:
            raise InputError(f'motion: of the joints {list(motion.joint_names)}; '
                             f'expected {list(robot.joint_names)}')
        if followed is not None:
            raise InputError(f'followed: {list(followed)}; expected None, because all '
                             'joints of this robot follow the motion')
    # A motion of as many joints as independent speeds states which joints follow.
    elif followed is None and motion.n == robot.n:
        followed = motion.joint_names
    places = followed_joints(robot, followed)
    columns = motion_columns(robot, places, motion.joint_names)
    # A motion of all joints is redundant: its configurations must be closed.
    if motion.n == robot.n_q:
        warn_of_degrees(robot, motion.positions, 'motion', stacklevel=5)
        require_closed(robot, motion.positions, motion.times)
    return list(places), columns
