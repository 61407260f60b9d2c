"""Configurations and motion of a mechanism whose driving joints move as desired."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.loop_tracking.loop_error import BRANCH, LoopError, SINGULAR
from kane_dynamics.loop_tracking.loop_tracker import (CONDITIONING, FIGURES,
                                                      INDEPENDENT_RESIDUAL, LoopTracker,
                                                      MOTION, path_rows, SHARE,
                                                      STRIDE, tracking_kernel)
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.constraints import conditioning
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.robot.robot import Robot
import numpy as np

CLOSED = 1e-11  # rad, or lengths of the mechanism: residual of the independent rows
CALLS = 5  # of the kernel for all rows, at most
STEPS_IN_TIME = 8  # at least, from row to row, where constraints are functions of time
FARTHEST = 1e3  # rad or m, of a driving joint from one time to the next
LARGEST_CONDITION = 1e7  # from here on the driving joints do not determine the motion

Described = Callable[[int], str]  # what a row is of, in words


def driving_tracker(robot: Robot, joints: Sequence[str],
                    **limits: float) -> LoopTracker | None:
    """
    Return a tracker whose measured joints are driving joints, in the robot's order.

    So one kernel serves every order of the joints. None without constraints, where no
    joint follows from others and a configuration needs no kernel. `limits` are those of
    `LoopTracker`. InputError as from `LoopTracker`, or if a constraint is one of
    velocities.
    """
    if not robot.constraint_names:
        return None
    rows = path_rows(robot)
    if rows:
        raise InputError(f"motion: constraint '{rows[0]}' is one of velocities, and the "
                         'positions of driving joints do not determine the '
                         'configuration; expected constraints of positions')
    names = robot.coordinate_names
    if set(joints) <= set(names):  # else `LoopTracker` refuses them
        joints = sorted(joints, key=names.index)
    return LoopTracker(robot, joints, **limits)


class DrivenLoops:
    """
    Closed configurations for rows of positions of driving joints, in one assembly mode.

    Without constraints the driving joints are all joints, and every configuration is
    closed.

    Arguments `q`, (K, n_q) with K > 0, are configurations, rad or m; `t`, (K,), times,
    s; `described` returns what a row is of, in words, for errors.

    Parameters
    ----------
    robot : Robot
        Its constraints are those of positions.
    joints : sequence of n str
        The driving joints, as many as independent speeds.

    Raises
    ------
    InputError
        The joints do not fit the robot, or a constraint is one of velocities.

    """

    def __init__(self, robot: Robot, joints: Sequence[str]) -> None:
        self._tracker = driving_tracker(robot, joints, max_figure=conditioning.SINGULAR)

    @property
    def kernels(self) -> list[Kernel]:
        """Return the kernels that close configurations; none without constraints."""
        tracker = self._tracker
        return [] if tracker is None else [tracking_kernel(tracker.robot, tracker.places)]

    def followed(self, start: Array, q: Array, t: Array, described: Described) -> Array:
        """
        Return configurations, (K, n_q), each from the last, the first from a start.

        Only the driving joints of `q` are used; they keep their positions. LoopError if
        a configuration does not follow, or is near a singular one; InputError if a
        driving joint moves too far for that. Both name the row.
        """
        tracker = self._tracker
        if tracker is None:
            return q
        # A far step could end on another branch.
        targets = q[:, tracker.places]
        moves = np.abs(np.diff(targets, axis=0, prepend=targets[:1])).max(axis=1,
                                                                          initial=0.0)
        farthest = int(moves.argmax())
        if moves[farthest] > FARTHEST:
            raise InputError(f'{described(farthest)}: a joint is {moves[farthest]:.4g} '
                             'rad or m from the row before; expected at most '
                             f'{FARTHEST:g} between two rows')
        at_rest = np.zeros(tracker.robot.n)
        result = np.empty_like(q)
        last = start[tracker.places]
        k = 0
        try:
            tracker.restart(start, t[0])
            for k, target in enumerate(targets):
                # The driving joints alone do not state how far time moves the others.
                if tracker.robot.equations.timed and k:
                    self._approach(tracker, last, target, t[k - 1], t[k])
                tracker.update(target, at_rest, t=t[k])
                result[k] = tracker.q
                last = target
        except LoopError as error:
            raise LoopError(error.reason, f'{described(k)}: {error.detail}') from None
        return self.closed(result, t, described)

    def _approach(self, tracker: LoopTracker, last: Array, target: Array, t_0: float,
                  t_1: float) -> None:
        """Move towards a row in steps of the driving joints and of time."""
        distance = np.abs(target - last).max(initial=0.0)
        steps = max(int(distance / STRIDE), STEPS_IN_TIME)
        at_rest = np.zeros(len(target))
        for x in np.linspace(0.0, 1.0, steps + 1)[1:-1]:
            tracker.update(last + x * (target - last), at_rest, t=t_0 + x * (t_1 - t_0))

    def closed(self, q: Array, t: Array, described: Described) -> Array:
        """
        Return configurations, (K, n_q), near nearly closed ones, all at once.

        The driving joints keep their positions. LoopError if the others move by more
        than a part of the distance from a singular configuration, beyond which they
        might not return.
        """
        tracker = self._tracker
        if tracker is None:
            return q
        robot = tracker.robot
        kernel = tracking_kernel(robot, tracker.places)
        target = np.ascontiguousarray(q[:, tracker.places])
        # The driving joints do not move, so T and their rates do not count. Nothing is
        # compared.
        T = np.zeros((robot.n_q, robot.n))
        rates = np.zeros(robot.n)
        seen = np.zeros(robot.n_q)
        weights = np.zeros(robot.n_q)
        time = robot.equations.time_inputs(np.ascontiguousarray(t))
        rows = np.empty((len(q), *kernel.shape))
        # Each call is a Newton step of all configurations, with the driving joints back
        # in place.
        for _ in range(CALLS):
            kernel.run([np.ascontiguousarray(q), T, target, rates, seen, weights, *time],
                       rows, len(q))
            figures = np.sqrt(rows[:, -FIGURES:])
            _check_distance(tracker.max_figure, figures[:, MOTION],
                            figures[:, CONDITIONING], described)
            q = rows[:, :robot.n_q].copy()
            q[:, tracker.places] = target
            residual = figures[:, INDEPENDENT_RESIDUAL]
            if residual.max() <= CLOSED:
                return q
        k = int(residual.argmax())
        raise LoopError(BRANCH, f'{described(k)}: residual {residual[k]:.3g} rad or '
                        'lengths; expected joints for which the loops close')


def _check_distance(largest: float, motion: Array, figure: Array,
                    described: Described) -> None:
    """Raise LoopError where the loops are near singular, or move too far at once."""
    unsafe = ~((figure <= largest) & (figure * motion <= SHARE))
    if unsafe.any():
        k = int(unsafe.argmax())
        raise LoopError(SINGULAR, f'{described(k)}: conditioning figure '
                        f'{figure[k]:.3g}; expected at most {largest:g}, and less '
                        'between points next to which the joints move by '
                        f'{motion[k]:.3g} rad or lengths')


class MechanismMotion(NamedTuple):
    """Coordinates (N, n_q), independent speeds, their rates (N, n); rad or m, s."""

    q: Array
    u: Array
    udot: Array


def mechanism_motion(robot: Robot, joints: Sequence[str], t: Array | None, q: Array,
                     rates: Array, accelerations: Array) -> MechanismMotion:
    """
    Return the motion of a mechanism for that of its driving joints.

    The loops are closed from each configuration to the next one (`DrivenLoops`), so that
    the assembly mode stays that of the robot's `configuration`, else of the one found
    near zero. With the joint rates T of the independent speeds, q' = T u + x, the rows
    of the driving joints determine u, and those of q'' its rate.

    Parameters
    ----------
    robot : Robot
        Velocity constraints (rolling, knife edges) do not determine positions.
    joints : sequence of n str
        Driving joints, as many as independent speeds.
    t : (N,) array, optional
        Times, s, in order; they may be left out where nothing depends on them.
    q, rates, accelerations : (N, n) arrays
        Of the driving joints; rad or m, and s.

    Raises
    ------
    InputError
        The joints are others or not as many, the constraints are not those of positions,
        or the driving joints do not determine the motion; names the time.
    LoopError
        A configuration does not follow from the one before, or is near a singular one;
        names the time.

    """
    require_angles(robot.model, 'motion')
    names = robot.coordinate_names
    distinct = set(joints)
    if not len(joints) == len(distinct) == robot.n or not distinct <= set(names):
        raise InputError(f'motion: joints {list(joints)}; expected {robot.n} of '
                         f'{", ".join(names)}, as many as independent speeds')
    # Configurations by closing the loops, one after the other; rates by T at each.
    driving = list(map(names.index, joints))
    Q = closed_configurations(robot, driving, t, q)
    return motion_of_closed(robot, driving, t, Q, rates, accelerations)


def _named_row(t: Array | None, row: int) -> str:
    """Return a row of a motion in words, by its time or its number."""
    return f'row {row}' if t is None else f'at {t[row]:.4g} s'


def closed_configurations(robot: Robot, driving: list[int], t: Array | None,
                          q: Array) -> Array:
    """Return closed configurations, (N, n_q), with the driving joints at q, (N, n)."""
    times = np.zeros(len(q)) if t is None else t
    Q = np.zeros((len(q), robot.n_q))
    Q[:, driving] = q
    if not len(q):
        return Q
    # The first configuration closes from the stated one, all others from their
    # predecessor.
    joints = [robot.coordinate_names[k] for k in driving]
    loops = DrivenLoops(robot, joints)
    start = _first_closed(robot, Q[0], float(times[0]), joints)
    return loops.followed(start, Q, times, lambda row: f'motion: {_named_row(t, row)}')


def _first_closed(robot: Robot, q: Array, t: float, joints: Sequence[str]) -> Array:
    """
    Return a closed configuration, (n_q,), with the driving joints as in q.

    It closes from q itself. Where other joints are too far away for that, the driving
    joints move to q from the closed configuration near zero.
    """
    try:
        return robot.closed_configuration(q, t=t, fixed=joints)
    except ConstraintError as error:
        if robot.configuration is not None:  # it moved from there already
            raise
        try:
            near_zero = robot.closed_configuration(robot.neutral(), t=t)
            return robot.closed_configuration(q, t=t, fixed=joints, start=near_zero)
        except ConstraintError:
            raise error from None


def motion_of_closed(robot: Robot, driving: Sequence[int], t: Array | None, Q: Array,
                     rates: Array, accelerations: Array) -> MechanismMotion:
    """
    Return the motion through closed configurations, (N, n_q), of a robot.

    `driving` are the indices of the driving joints; the other arguments are those of
    `mechanism_motion`. In joint rates without constraints they may be some of the
    joints; the others rest.
    """
    at_rest = np.zeros((len(Q), robot.n))
    if robot.equations.in_joint_rates:  # T = 1
        u = at_rest.copy()
        udot = at_rest.copy()
        u[:, driving] = rates
        udot[:, driving] = accelerations
        return MechanismMotion(Q, u, udot)
    # Columns of T: the rates at unit speeds, less those at rest, x.
    times = np.zeros(len(Q)) if t is None else t
    drift = robot.joint_rates(Q, at_rest, t=times)
    columns = [robot.joint_rates(Q, at_rest + unit, t=times) - drift
               for unit in np.eye(robot.n)]
    T = np.stack(columns, axis=-1)[:, driving]
    singular = np.flatnonzero(np.linalg.cond(T) > LARGEST_CONDITION)
    if singular.size:
        names = [robot.coordinate_names[k] for k in driving]
        row = _named_row(t, int(singular[0]))
        raise InputError(f'motion: {row} the joints {names} do not determine the motion; '
                         'expected others there')
    # T u = rates - x in the rows of the driving joints, and the same for udot.
    u = _solved(T, rates - drift[:, driving])
    without_udot = robot.joint_accelerations(Q, u, at_rest, t=times)[:, driving]
    return MechanismMotion(Q, u, _solved(T, accelerations - without_udot))


def _solved(T: Array, right: Array) -> Array:
    """Return T^-1 times vectors, (N, n)."""
    return np.asarray(np.linalg.solve(T, right[..., None])[..., 0])
