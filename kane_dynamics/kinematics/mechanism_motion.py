"""Motion of a mechanism whose driving joints move as desired: closed loops, speeds, rates."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.tracing.program import Program, trace_program
from kane_dynamics.robot.robot import Robot
import numpy as np

NAME = 'closure_rows'
CLOSED = 1e-12  # rad and m
LONGEST_MOVE = 0.05  # rad or m, of a driving joint between two loop closures
FARTHEST = 1e3  # rad or m, of a driving joint from one time to the next
ITERATIONS = 12
SINGULAR = 1e7  # condition number from which the driving joints do not determine the motion


class MechanismMotion(NamedTuple):
    """Coordinates (N, n_q), independent speeds and their rates (N, n); rad or m, and s."""

    q: Array
    u: Array
    udot: Array


def mechanism_motion(robot: Robot, joints: Sequence[str], t: Array, q: Array, rates: Array,
                     accelerations: Array, configuration: Any = None) -> MechanismMotion:
    """
    Return the motion of a robot with chosen speeds or constraints for that of driving joints.

    Each configuration is closed by Newton's method from the one before, in short moves, so that
    the assembly mode stays the same. With the joint rates T of the independent speeds,
    q' = T u + x, the rows of the driving joints determine u, and those of q'' its rate.

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
    configuration : (n_q,) array_like, optional
        Initial guess of the first configuration. Default: that of the robot, else zero.

    Raises
    ------
    InputError
        The joints are others or not as many, the constraints are not those of positions, or the
        driving joints do not determine the motion; names the time.
    ConstraintError
        A loop cannot be closed; names the time and the constraint.

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
    return motion_of_closed(robot, driving, t, _closed(robot, driving, t, q, configuration),
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


def _closed(robot: Robot, driving: list[int], t: Array, q: Array, configuration: Any) -> Array:
    """Return closed configurations, (N, n_q), with the driving joints at q, (N, n)."""
    Q = np.zeros((len(t), robot.n_q))
    Q[:, driving] = q
    others = [k for k in range(robot.n_q) if k not in driving]
    if not others or not len(t):
        return Q
    mechanism, rows = robot.mechanism, _rows_kernel(robot)
    guess = robot.configuration if configuration is None else configuration
    start = np.zeros(robot.n_q) if guess is None else np.array(guess, dtype=np.float64)
    start[driving] = q[0]
    fixed = [robot.coordinate_names[k] for k in driving]
    here = robot.closed_posture(start, t=float(t[0]), fixed=fixed)
    before = here.copy()
    moves = np.abs(np.diff(q, axis=0, prepend=q[:1])).max(axis=1)
    if (far := int(moves.argmax())) and moves[far] > FARTHEST:
        raise InputError(f'motion: a move of {moves[far]:.4g} rad or m until {t[far]:.4g} s; '
                         f'expected at most {FARTHEST:g} from one time to the next')
    for k, count in enumerate(np.maximum(np.ceil(moves / LONGEST_MOVE), 1.0).astype(int).tolist()):
        for step in range(1, count + 1):
            x = step / count
            # Rows may be of any distances: steps of one move alone are alike.
            following = 2.0 * here - before if step > 1 or (count == 1 and k > 1) else here.copy()
            following[driving] = q[k] if step == count else (1.0 - x) * q[k - 1] + x * q[k]
            moment = t[k] if step == count else (1.0 - x) * t[k - 1] + x * t[k]
            before = here
            here = _closed_once(mechanism.labels, rows, others, following, moment,
                                robot.equations.timed)
        Q[k] = here
    return Q


def _closed_once(labels: Sequence[str], rows: Any, others: list[int], q: Array, t: float,
                 timed: bool) -> Array:
    """Return q with its other coordinates moved until the residuals vanish."""
    for _ in range(ITERATIONS):
        found = rows(q, np.array(t)) if timed else rows(q)
        residual = found[:, 0]
        if np.abs(residual).max(initial=0.0) < CLOSED:
            return q
        q = q.copy()
        q[others] -= np.linalg.lstsq(found[:, 1:][:, others], residual, rcond=1e-9)[0]
    worst = int(np.argmax(np.abs(residual)))
    raise ConstraintError(f"motion: at {t:.4g} s '{labels[worst]}' stays open by "
                          f'{abs(residual[worst]):.3g} (m or rad); expected a motion along which '
                          'the loops close')


def _rows_kernel(robot: Robot) -> Any:
    """Return the kernel of the residuals of all rows, beside their Jacobian, (m, 1 + n_q)."""
    equations = robot.equations
    assert isinstance(equations, ConstrainedEquations)
    mechanism, timed = equations.mechanism, equations.timed
    links, m = equations.tree.geometry, len(mechanism.labels)

    def rows(q: Any, *rest: Any) -> Any:
        found = mechanism.rows(mechanism.state(q, rest[0][()] if timed else 0.0, links))
        open_by = [(label, x) for label, x in zip(mechanism.labels, found.residual)]
        moving = [label for label, x in open_by if x is None]
        if moving:
            raise InputError(f"motion: constraint '{moving[0]}' is one of velocities, and the "
                             'positions of driving joints do not determine the configuration; '
                             'expected constraints of positions')
        residual = np.array([x for _, x in open_by], dtype=object)
        return np.concatenate([residual[:, None], found.J], axis=1)

    def program() -> Program:
        inputs: list[Any] = [('q', (robot.n_q,)), *([('t', ())] if timed else []),
                             ('parameters', robot.parameters.block.shape)]
        return trace_program(NAME, rows, inputs)
    arguments = [Argument('q', (robot.n_q,), robot.coordinate_names)]
    arguments += [Argument('t', ())] if timed else []
    return robot.kernels.extra(NAME, program, arguments, robot.parameters.block,
                               (m, 1 + robot.n_q))
