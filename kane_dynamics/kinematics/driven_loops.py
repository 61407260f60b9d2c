"""Configurations of closed loops for positions of the joints that drive them."""

from collections.abc import Callable, Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.loop_error import BRANCH, LoopError, SINGULAR
from kane_dynamics.kinematics.loop_kernel import FIGURES, SHARE, STRIDE, tracking_kernel
from kane_dynamics.kinematics.loop_tracker import LoopTracker
from kane_dynamics.mechanics.constraints import conditioning
from kane_dynamics.robot.robot import Robot
import numpy as np

CLOSED = 1e-11  # rad, or lengths of the mechanism: residual of the independent rows
CALLS = 5  # of the kernel for all rows, at most
STEPS_IN_TIME = 8  # at least, from row to row, where constraints are functions of time

Described = Callable[[int], str]  # what a row is of, in words


def driving_tracker(robot: Robot, joints: Sequence[str], **limits: float) -> LoopTracker:
    """
    Return a tracker whose measured joints are driving joints, in the robot's order.

    So one kernel serves every order of the joints. `limits` are those of `LoopTracker`. InputError
    as from `LoopTracker`, or if a constraint is one of velocities.
    """
    names = robot.coordinate_names
    known = set(joints) <= set(names)  # else `LoopTracker` refuses them
    tracker = LoopTracker(robot, sorted(joints, key=names.index) if known else joints, **limits)
    if rows := tracker.path_rows:
        raise InputError(f"motion: constraint '{rows[0]}' is one of velocities, and the positions "
                         'of driving joints do not determine the configuration; expected '
                         'constraints of positions')
    return tracker


class DrivenLoops:
    """
    Closed configurations for rows of positions of driving joints, in one assembly mode.

    Arguments `q`, (K, n_q) with K > 0, are configurations, rad or m; `t`, (K,), times, s;
    `described` returns what a row is of, in words, for errors.

    Parameters
    ----------
    robot : Robot
        With constraints on positions.
    joints : sequence of n str
        The driving joints, as many as independent speeds.

    Raises
    ------
    InputError
        The joints do not fit the robot, or a constraint is one of velocities.

    """

    def __init__(self, robot: Robot, joints: Sequence[str]) -> None:
        self._tracker = driving_tracker(robot, joints, max_figure=conditioning.SINGULAR)

    def followed(self, start: Array, q: Array, t: Array, described: Described) -> Array:
        """
        Return configurations, (K, n_q), each from the one before, the first from a closed start.

        Only the driving joints of `q` are used; they keep their positions. LoopError if a
        configuration does not follow, or is near a singular one; it names the row.
        """
        tracker, result = self._tracker, np.empty_like(q)
        timed, rest = tracker.robot.equations.timed, np.zeros(tracker.robot.n)
        target, before = q[:, tracker.places], start[tracker.places]
        k = 0
        try:
            tracker.restart(start, t[0])
            for k, row in enumerate(target):
                if timed and k:  # the driving joints alone do not state how far the others move
                    far = np.abs(row - before).max(initial=0.0) / STRIDE
                    for x in np.linspace(0.0, 1.0, max(int(far), STEPS_IN_TIME) + 1)[1:-1]:
                        tracker.update(before + x * (row - before), rest,
                                       t=t[k - 1] + x * (t[k] - t[k - 1]))
                tracker.update(row, rest, t=t[k])
                result[k], before = tracker.q, row
        except LoopError as error:
            raise LoopError(error.reason, f'{described(k)}: {error.detail}') from None
        return self.closed(result, t, described)

    def closed(self, q: Array, t: Array, described: Described) -> Array:
        """
        Return configurations, (K, n_q), near those with nearly closed loops, all at once.

        The driving joints keep their positions. LoopError if the others move by more than a part
        of the distance from a singular configuration, beyond which they might not return.
        """
        tracker = self._tracker
        robot, places = tracker.robot, tracker.places
        kernel, n, n_q = tracking_kernel(robot, places), robot.n, robot.n_q
        target = np.ascontiguousarray(q[:, places])
        # Without a motion of the driving joints the kernel does not need their rates.
        T, *others = [np.zeros(shape) for shape in ((n_q, n), (n,), (n_q,), (n_q,))]
        others += [np.ascontiguousarray(t)] * robot.equations.timed
        rows = np.empty((len(q), *kernel.shape))
        for _ in range(CALLS):
            kernel.run([np.ascontiguousarray(q), T, target, *others], rows, len(q))
            moved, missed, _, figure, *_ = np.sqrt(rows[:, -FIGURES:].T)
            far = ~((figure <= tracker.max_figure) & (figure * moved <= SHARE))
            if far.any():
                k = int(far.argmax())
                raise LoopError(SINGULAR, f'{described(k)}: conditioning figure {figure[k]:.3g}; '
                                f'expected at most {tracker.max_figure:g}, and less between '
                                'points next to which the joints move by '
                                f'{moved[k]:.3g} rad or lengths')
            q = rows[:, :n_q].copy()
            q[:, places] = target
            if missed.max() <= CLOSED:
                return q
        k = int(missed.argmax())
        raise LoopError(BRANCH, f'{described(k)}: residual {missed[k]:.3g} rad or lengths; '
                        'expected joints for which the loops close')
