"""
The computed-torque law of robots with chosen speeds or constraints.

As many joints as there are independent speeds follow the motion; the others follow from the
constraints. With q' = T u + X, and the rows of these joints marked by c,

    T_c udot = q''_d + kd (q'_d - q'_c) + kp (q_d - q_c) - q''_c(udot = 0),

so that the errors of these joints obey e'' + kd e' + kp e = 0 for every choice of speeds. The
torque is T^T times the joint forces of that motion, with friction at the desired joint rates.
"""

from collections.abc import Callable, Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque_law import corrected_acceleration
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.conditioning import guarded
from kane_dynamics.mechanics.constraints.transmission import (require_transmission,
                                                              transmission_margin)
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import Program, Shape
from kane_dynamics.robot.robot import Robot
import numpy as np

NAME = 'computed_torque'
DESIRED = ('q_d', 'u_d', 'udot_d')  # of the joints that follow


def followed_joints(robot: Robot, followed: Sequence[str] | None = None) -> tuple[int, ...]:
    """
    Return the indices of the joints that follow a motion, as many as independent speeds.

    Parameters
    ----------
    robot : Robot
        With chosen speeds or constraints.
    followed : sequence of str, optional
        Their names. Default: all joints without constraints; else those whose rates are the
        independent speeds, or else those with actuators.

    Raises
    ------
    InputError
        An unknown joint, another number of joints, no default, or a robot with beams.

    """
    names, n = robot.coordinate_names, robot.n
    equations = robot.equations
    require_rigid(robot)
    if followed is None:
        speeds = robot.speed_names
        actuated = equations.actuated
        if n == robot.n_q:
            followed = names
        elif robot.mechanism.speeds.key and set(speeds) <= set(names):
            followed = speeds
        elif actuated is not None and len(actuated) == n:
            followed = tuple(names[k] for k in actuated)
        else:
            raise InputError(f'followed: missing; expected {n} of the joints {list(names)}, which '
                             'follow the motion, because the independent speeds are not joint '
                             'rates')
    unknown = [name for name in followed if name not in names]
    if unknown or len(set(followed)) != n or len(followed) != n:
        raise InputError(f'followed: {list(followed)}; expected {n} of the joints {list(names)}, '
                         'as many as there are independent speeds')
    return tuple(names.index(name) for name in followed)


def joints_that_follow(robot: Robot) -> tuple[int, ...]:
    """Return the indices of the joints that follow motions: all, or those of closed loops."""
    return followed_joints(robot) if not robot.equations.in_joint_rates else tuple(
        range(robot.n_q))


def require_rigid(robot: Robot) -> None:
    """Raise InputError if a robot has beams, which feedforward would bend at will."""
    if robot.model.modal_coordinates:
        raise InputError('robot: with beams; expected the rigid model, such as stiffened(model), '
                         'because no actuator moves the coordinates of bending')


def motion_columns(robot: Robot, followed: Sequence[int], names: Sequence[str]) -> list[int]:
    """
    Return the columns of a motion's joints that are those that follow it.

    InputError unless the motion is of these joints, in their order, or of all joints in theirs.
    """
    every = robot.coordinate_names
    if tuple(names) == tuple(every[k] for k in followed):
        return list(range(len(followed)))
    if tuple(names) == tuple(every):
        return list(followed)
    raise InputError(f'motion: of the joints {list(names)}; expected '
                     f'{[every[k] for k in followed]}, or all: {list(every)}')


def require_closed(robot: Robot, positions: Array, times: Array) -> None:
    """
    Raise InputError unless points of a motion of all joints, (K, n_q), satisfy the constraints.

    The limit is `closure_tolerance`; None for none.
    """
    limits = robot.parameters.closure_tolerance
    if not robot.constraint_names or limits is None or positions.shape[1] != robot.n_q:
        return
    residual = np.abs(robot.constraint_residual(positions, t=times))
    allowed = np.where(robot.mechanism.turning, limits[1], limits[0])
    if (residual <= allowed).all():
        return
    point, row = np.unravel_index(np.argmax(residual / allowed), residual.shape)
    raise InputError(f"motion: the residual of '{robot.constraint_names[row]}' is "
                     f'{residual[point, row]:.3g} (m or rad) in point {point + 1}; expected '
                     'closed configurations, as from robot.closed_posture, or a motion of '
                     'the independent joints')


class FollowingMotion:
    """Rates of a mechanism whose given joints follow; traced or numeric."""

    def __init__(self, equations: Equations, followed: Sequence[int], q: Any, u: Any,
                 t: Any) -> None:
        """Compute the motion at udot = 0."""
        self.equations, self.places = equations, list(followed)
        self.motion = equations.joint_motion(q, u, equations.zeros, t)
        self.T = self.motion.T[self.places]

    def speeds(self, qdot: Any) -> Any:
        """Return the change of u that changes the rates of the given joints by qdot."""
        return self.equations.mechanism.solved(self.T, qdot)


def constrained_law_program(robot: Robot, followed: Sequence[int],
                            commanded: bool = False) -> Program:
    """
    Trace the law; arguments as `constrained_law_kernel`, then the robot's parameters.

    The result is dual to the independent speeds, (n,), without a check of the configuration. With
    `commanded` it is the torques of the joints, (n_q,), NaN where calls of the robot are refused.
    """
    law = _law(robot, followed, commanded)
    return robot.kernels.function(law, NAME, _inputs(robot)).program()


def _law(robot: Robot, followed: Sequence[int], commanded: bool) -> Callable[..., Any]:
    """Return the function of `constrained_law_program`."""
    equations: Any = robot.equations
    n = equations.n

    def law(q: Any, u: Any, q_d: Any, u_d: Any, udot_d: Any, gains: Any, wrench: Any, t: Any,
            parameters: Any, limits: Any) -> Any:
        here = FollowingMotion(equations, followed, q, u, t)
        motion, places = here.motion, here.places
        wanted = corrected_acceleration(q[places], motion.qdot[places], q_d, u_d, udot_d,
                                        gains[:n], gains[n:])
        qddot = motion.qddot + motion.T @ here.speeds(wanted - motion.qddot[places])
        qdot_d = motion.qdot + motion.T @ here.speeds(u_d - motion.qdot[places])
        tree = equations.tree
        rigid = tree.rigid_dynamics(q, motion.qdot, qddot, wrench, parameters)
        tau = motion.T.T @ (np.array(rigid) + tree.friction_force(qdot_d))
        if not commanded:
            return tau
        tau = equations.joint_torques(tau, q, t)
        if equations.watched:
            tau = guarded(tau, equations.margin(q, t, limits))
        return guarded(tau, transmission_margin(equations.mechanism, motion.T, places))
    return law


def constrained_law_kernel(robot: Robot, followed: Sequence[int],
                           commanded: bool = False) -> Kernel:
    """
    Return the law as a kernel of the robot; results as of `constrained_law_program`.

    Its arguments are q (n_q,), u (n,); q, q', q'' desired of the joints that follow, (n,) each;
    the gains: kp, then kd, (2 n,); then wrenches and time where the robot has them.
    """
    def reason(state: dict[str, Array]) -> Kernel | None:
        sets = robot.speed_sets
        other = sets.instead(robot.mechanism, state)
        require_following(robot, followed, state['q'], float(state.get('t', np.zeros(()))))
        if other is None or other.equations.in_joint_rates:
            return None
        mechanism = other.equations.mechanism
        return constrained_law_kernel(robot.in_choice(mechanism.free, mechanism.kept), followed,
                                      commanded)
    name = f'{NAME}_{"_".join(map(str, followed))}{"" if commanded else "_anywhere"}'
    return robot.kernels.compiled(_law(robot, followed, commanded), name, _inputs(robot),
                                  (robot.n_q if commanded else robot.n,), reason=reason)


def require_following(robot: Robot, followed: Sequence[int], q: Array, t: float,
                      where: str = '', share: float = 1.0) -> None:
    """Raise ConstraintError where followed or actuated joints do not determine the motion."""
    equations: Any = robot.equations
    T = np.array(equations.at_rest(q, t).T, dtype=np.float64)
    if equations.actuated is not None:
        require_transmission(robot.mechanism, T, equations.actuated, True, q, where, share)
    require_transmission(robot.mechanism, T, followed, False, q, where, share)


def law_margin(robot: Robot, followed: Sequence[int], q: Any, t: Any) -> Any:
    """Return a number that is positive where `require_following` raises no error; traced."""
    equations: Any = robot.equations
    T, mechanism = equations.at_rest(q, t).T, equations.mechanism
    margin = transmission_margin(mechanism, T, followed)
    if equations.actuated is None:
        return margin
    return margin + transmission_margin(mechanism, T, equations.actuated) - 1.0


def _inputs(robot: Robot) -> dict[str, Shape]:
    n = robot.n
    desired = dict.fromkeys(DESIRED, (n,))
    return {'q': (robot.n_q,), 'u': (n,), **desired, 'gains': (2 * n,)}
