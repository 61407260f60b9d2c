"""Motion of a mechanism whose driving joints move as desired: closed loops, speeds, rates."""

from collections.abc import Sequence
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.driven_loops import DrivenLoops
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.robot.robot import Robot
import numpy as np

FARTHEST = 1e3  # rad or m, of a driving joint from one time to the next
SINGULAR = 1e7  # condition number from which the driving joints do not determine the motion


class MechanismMotion(NamedTuple):
    """Coordinates (N, n_q), independent speeds and their rates (N, n); rad or m, and s."""

    q: Array
    u: Array
    udot: Array


def mechanism_motion(robot: Robot, joints: Sequence[str], t: Array, q: Array, rates: Array,
                     accelerations: Array) -> MechanismMotion:
    """
    Return the motion of a robot with chosen speeds or constraints for that of driving joints.

    The loops are closed from each configuration to the next one (`DrivenLoops`), so that the
    assembly mode stays that of the robot's `configuration`, else of the one found near zero. With
    the joint rates T of the independent speeds, q' = T u + x, the rows of the driving joints
    determine u, and those of q'' its rate.

    Parameters
    ----------
    robot : Robot
        With chosen speeds or constraints; velocity constraints (rolling, knife edges) do not
        determine positions.
    joints : sequence of n str
        Driving joints, as many as independent speeds.
    t : (N,) array
        Times, s, in order.
    q, rates, accelerations : (N, n) arrays
        Of the driving joints; rad or m, and s.

    Raises
    ------
    InputError
        The joints are others or not as many, the constraints are not those of positions, or the
        driving joints do not determine the motion; names the time.
    LoopError
        A configuration does not follow from the one before, or is near a singular one; names the
        time.

    """
    require_angles(robot.model, 'motion')
    equations = robot.equations
    assert isinstance(equations, ConstrainedEquations)
    names = robot.coordinate_names
    unknown = [name for name in joints if name not in names]
    if unknown or len(set(joints)) != robot.n or len(joints) != robot.n:
        raise InputError(f'motion: joints {list(joints)}; expected {robot.n} of '
                         f'{", ".join(names)}, as many as independent speeds')
    driving = [names.index(name) for name in joints]
    return motion_of_closed(robot, driving, t, _closed(robot, driving, t, q),
                            rates, accelerations)


def motion_of_closed(robot: Robot, driving: Sequence[int], t: Array, Q: Array, rates: Array,
                     accelerations: Array) -> MechanismMotion:
    """
    Return the motion in closed configurations, (N, n_q), for joints with the indices `driving`.

    The other arguments are those of `mechanism_motion`.
    """
    names = robot.coordinate_names
    none = np.zeros((len(t), robot.n))
    still = robot.joint_rates(Q, none, t=t)
    T = np.stack([robot.joint_rates(Q, none + unit, t=t) - still for unit in np.eye(robot.n)],
                 axis=-1)[:, driving]
    singular = np.flatnonzero(np.linalg.cond(T) > SINGULAR)
    if singular.size:
        raise InputError(f'motion: at {t[singular[0]]:.4g} s the joints '
                         f'{[names[k] for k in driving]} do not determine the motion; expected '
                         'others there')
    u = _solved(T, rates - still[:, driving])
    held = robot.joint_accelerations(Q, u, none, t=t)[:, driving]
    return MechanismMotion(Q, u, _solved(T, accelerations - held))


def velocity_rows(robot: Robot) -> tuple[str, ...]:
    """Return the rows of constraints on velocities: with these, positions depend on the path."""
    mechanism = robot.mechanism
    found = mechanism.rows(mechanism.state(np.zeros(robot.n_q))).residual
    return tuple(label for label, residual in zip(mechanism.labels, found) if residual is None)


def _solved(T: Array, right: Array) -> Array:
    """Return T^-1 times vectors, (N, n)."""
    return np.asarray(np.linalg.solve(T, right[..., None])[..., 0])


def _closed(robot: Robot, driving: list[int], t: Array, q: Array) -> Array:
    """Return closed configurations, (N, n_q), with the driving joints at q, (N, n)."""
    Q = np.zeros((len(t), robot.n_q))
    Q[:, driving] = q
    if not robot.constraint_names or not len(t):
        return Q
    fixed = [robot.coordinate_names[k] for k in driving]
    loops = DrivenLoops(robot, fixed)
    start = np.zeros(robot.n_q)
    start[driving] = q[0]
    start = robot.closed_posture(start, t=float(t[0]), fixed=fixed)
    moves = np.abs(np.diff(q, axis=0, prepend=q[:1])).max(axis=1, initial=0.0)
    if (far := int(moves.argmax())) and moves[far] > FARTHEST:
        raise InputError(f'motion: a joint moves by {moves[far]:.4g} rad or m in the interval '
                         f'that ends at {t[far]:.4g} s; expected at most {FARTHEST:g} between '
                         'two times')
    return loops.followed(start, Q, t, lambda k: f'motion: at {t[k]:.4g} s')
