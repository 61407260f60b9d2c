"""
One cycle of mode cartesian_impedance, over any scalar: target, its limits, and the law.

A pose of `~/target_pose` is reached along a straight line and about one axis, at constant
speed, in the time between the last two poses: poses at 5 Hz then give a motion without
stops, one period late. While `~/target_twist` is in time, the target moves with it from
the last pose on, without delay. A target that no message moves any more is held. What
messages make of the target moves within limits of speed and acceleration, so that no
message makes a jump of torque.

The torque path and the readable law call the same function. Times are ns
since an epoch; flags are 1 or 0.
"""

from collections.abc import Callable
import math
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.control_cycle.cycle_results import NEVER
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.flags import branch, either, flag, packed
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.modes.pose_functions import displaced, displacement
from kane_dynamics.task_space.pose_filter import smooth_step
import numpy as np

LONGEST_PERIOD = 0.3  # s between two poses that belong together: of 5 Hz, with delays
SMOOTHING = 0.03  # s: of the target, so that its acceleration has no steps
FILTER_SIZE = 56  # of the state of `smooth_step`


class TargetOrders(NamedTuple):
    """
    Orders of messages to the target, and the limits of its parameters.

    Attributes
    ----------
    count, posed_at : Scalar
        Number and time of the latest pose.
    twists, wrenches : Scalar
        Numbers of the latest twist and wrench.
    goal : (4, 4) array
        That pose, in the world.
    twist, wrench : (6,) arrays
        The latest ones, linear then angular.
    twist_at, wrench_at : Scalar
        Their times, `NEVER` without one.
    twist_turns, wrench_turns : Scalar
        Whether they are in the axes of the target; else they are in those of the world.
    timeout : Scalar
        Age, ns, above which twist and wrench end.
    farthest, widest : Scalar
        Distance, m, and angle, rad, from the measured pose beyond which a twist moves the
        target no farther.
    limits : (4,) array
        Of `PoseFilter`.

    """

    count: Scalar
    posed_at: Scalar
    twists: Scalar
    wrenches: Scalar
    goal: Matrix
    twist: Vector
    twist_at: Scalar
    twist_turns: Scalar
    wrench: Vector
    wrench_at: Scalar
    wrench_turns: Scalar
    timeout: Scalar
    farthest: Scalar
    widest: Scalar
    limits: Vector


class TargetMemory(NamedTuple):
    """
    The target from one cycle to the next.

    Attributes
    ----------
    pose : (4, 4) array
        Of the target by the messages.
    start : (4, 4) array
        Where the movement to the latest pose began.
    step : (6,) array
        Displacement of that movement.
    began, duration : Scalar
        Its beginning, ns, and duration, s; 0: it has ended.
    count, posed_at : Scalar
        Number and time of the latest pose.
    advanced_at : Scalar
        Time of `pose`.
    followed : (56,) array
        The target within its limits: state of `smooth_step`.
    wrench : (6,) array
        That acts, world axes.
    twists, wrenches : Scalar
        Numbers of the latest twist and wrench at the first state of the law, which have
        no effect: not their times tell it, as the clock may jump backward.
    posture : (n_q,) array
        The configuration there.

    """

    pose: Matrix
    start: Matrix
    step: Vector
    began: Scalar
    duration: Scalar
    count: Scalar
    posed_at: Scalar
    advanced_at: Scalar
    followed: Vector
    wrench: Vector
    twists: Scalar
    wrenches: Scalar
    posture: Vector


ORDER_SHAPES: list[tuple[int, ...]] = [
    (), (), (), (), (4, 4), (6,), (), (), (6,), (), (), (), (), (), (4,)]
ORDERS_SIZE = sum(math.prod(shape) for shape in ORDER_SHAPES)


def memory_shapes(n_q: int) -> list[tuple[int, ...]]:
    """Return the shapes of a `TargetMemory`."""
    return [(4, 4), (4, 4), (6,), (), (), (), (), (), (FILTER_SIZE,), (6,), (),
            (), (n_q,)]


def memory_size(n_q: int) -> int:
    """Return the number of entries of a `TargetMemory`."""
    return 2 * 16 + 6 + 5 + FILTER_SIZE + 6 + 2 + n_q


def unpacked_orders(array: Vector) -> TargetOrders:
    """Return the `TargetOrders` of an array."""
    return TargetOrders(*_parts(array, ORDER_SHAPES))


def unpacked_memory(array: Vector, n_q: int) -> TargetMemory:
    """Return the `TargetMemory` of an array."""
    return TargetMemory(*_parts(array, memory_shapes(n_q)))


def _parts(array: Vector, shapes: list[tuple[int, ...]]) -> list[Any]:
    """Return consecutive parts of an array, those of shape () as scalars."""
    parts = []
    first = 0
    for shape in shapes:
        size = int(np.prod(shape))
        parts.append(array[first:first + size].reshape(shape)[()])
        first += size
    return parts


# The target by the messages.

def beginning(pose: Matrix, q: Vector, orders: TargetOrders) -> TargetMemory:
    """Return the memory of a law that begins: the frame is held at a pose."""
    still = np.zeros(6)
    row = np.concatenate([np.ravel(pose), still, still])
    return TargetMemory(pose, pose, still, 0.0, 0.0, orders.count, NEVER, NEVER,
                        np.concatenate([row, row]), still, orders.twists, orders.wrenches,
                        q)


def advanced(memory: TargetMemory, orders: TargetOrders, now: Scalar, may_move: Scalar
             ) -> tuple[TargetMemory, Vector]:
    """
    Return the memory at a time, and the velocity of the target, (6,), world axes.

    Parameters
    ----------
    memory : TargetMemory
        The target before.
    orders : TargetOrders
        What messages ask.
    now : Scalar
        ns.
    may_move : Scalar
        0 holds a target that moves with a twist, such as one far ahead of the arm.

    """
    # Between the last two poses.
    interpolates = flag(memory.duration > 0.0)
    duration = either(interpolates, memory.duration, 1.0)
    share = (now - memory.began) * (1.0 / NANO) / duration
    share = select(share < 0.0, 0.0, share)
    goes_on = flag(share < 1.0)
    share = either(goes_on, share, 1.0)
    pose_between = displaced(memory.start, memory.step, share)
    twist_between = (goes_on / duration) * memory.step

    # With a twist, from where the target was.
    elapsed = (now - memory.advanced_at) * (1.0 / NANO)
    elapsed = select(elapsed > 0.0, elapsed, 0.0)
    elapsed = select(memory.advanced_at > NEVER, elapsed, 0.0)
    moves = may_move * _twist_acts(memory, orders, now)
    twist = moves * turned(orders.twist_turns, memory.pose, orders.twist)
    pose_moved = displaced(memory.pose, elapsed * twist)

    moved = memory._replace(pose=either(interpolates, pose_between, pose_moved),
                            duration=memory.duration * goes_on * interpolates,
                            advanced_at=now)
    return moved, either(interpolates, twist_between, twist)


def _twist_acts(memory: TargetMemory, orders: TargetOrders, now: Scalar) -> Scalar:
    """Return whether the latest twist is of this law and in time."""
    in_time = flag(now - orders.twist_at < orders.timeout + 1.0)
    return in_time * flag(memory.twists < orders.twists)


def _wrench_acts(memory: TargetMemory, orders: TargetOrders, now: Scalar) -> Scalar:
    """Return whether the latest wrench is of this law and in time."""
    in_time = flag(now - orders.wrench_at < orders.timeout + 1.0)
    return in_time * flag(memory.wrenches < orders.wrenches)


def turned(turns: Scalar, pose: Matrix, six: Vector) -> Vector:
    """Return a twist or a wrench, (6,), in world axes; a flag says if it is in others."""
    R = pose[:3, :3]
    return np.asarray(either(turns, np.concatenate([R @ six[:3], R @ six[3:]]), six))


def at_latest_pose(memory: TargetMemory, orders: TargetOrders) -> TargetMemory:
    """Return the memory that reaches the latest pose in the time since the last one."""
    at = orders.posed_at
    before, _ = advanced(memory, orders, at, 1.0)
    since = (at - memory.posed_at) * (1.0 / NANO)
    belongs = flag(since > 0.0) * flag(since < LONGEST_PERIOD + 1e-9)
    # Beside a twist a pose corrects the target at once. A single one is reached as fast
    # as the limits of the target allow.
    duration = since * belongs * (1.0 - _twist_acts(memory, orders, at))
    duration = either(belongs, duration, 0.0)
    is_single = 1.0 - flag(duration > 0.0)
    changed = before._replace(
        pose=either(is_single, orders.goal, before.pose), start=before.pose,
        step=displacement(before.pose, orders.goal), began=at, duration=duration,
        count=orders.count, posed_at=at)
    is_new = flag(memory.count < orders.count)
    return branch(is_new, changed, memory)


# The cycle.

class CartesianCycle(NamedTuple):
    """
    The functions of a robot that a cycle calls, over any scalar.

    Attributes
    ----------
    frame_pose : callable
        Of q and t: the pose of the controlled frame, (4, 4).
    law : callable
        `impedance_law`.
    posture : slice
        Where the settings of the law have the posture.

    """

    frame_pose: Callable[[Vector, Scalar], Matrix]
    law: Callable[..., Vector]
    posture: slice

    def torque(self, q: Vector, u: Vector, stamp: Scalar, begins: Scalar, memory: Vector,
               settings: Vector, orders: Vector, *, t: Scalar, parameters: Vector
               ) -> tuple[Vector, Vector]:
        """
        Return the torques of the joints, (n_q,), and the next memory.

        Parameters
        ----------
        q, u : (n_q,), (n,) arrays
            Measured state.
        stamp : Scalar
            Its time, ns.
        begins : Scalar
            Whether the law begins, and forgets its memory.
        memory, settings, orders : arrays
            Of `TargetMemory`, of the law, and of `TargetOrders`. The last setting says
            whether the others state a posture; else it is that at the beginning.
        t, parameters
            Time, s, and parameters of the robot.

        """
        measured = self.frame_pose(q, t)
        asked = unpacked_orders(orders)
        fresh = beginning(measured, q, asked)
        last = unpacked_memory(memory, len(q))
        last = branch(begins, fresh, last)

        # 1. The target by the messages.
        posed_target = at_latest_pose(last, asked)
        distance = displacement(measured, posed_target.pose)
        near = flag(_length(distance[:3]) < asked.farthest)
        near = near * flag(_length(distance[3:]) < asked.widest)
        target, twist = advanced(posed_target, asked, stamp, near)

        # 2. The same within its limits.
        elapsed = (stamp - last.advanced_at) * (1.0 / NANO)
        goes_on = flag(elapsed > 0.0) * flag(last.advanced_at > NEVER)
        interval = np.array([either(goes_on, elapsed, 1.0)])
        stepped = smooth_step(last.followed, target.pose, twist, asked.limits, interval,
                              np.array([SMOOTHING]))
        followed = either(goes_on, stepped, last.followed)
        pose, twist, acceleration = target_of(followed)

        # 3. The law.
        acts = _wrench_acts(last, asked, stamp)
        wrench = acts * turned(asked.wrench_turns, target.pose, asked.wrench)
        of_law, posture_stated = settings[:-1], settings[-1]
        posture = either(posture_stated, of_law[self.posture], last.posture)
        complete = np.concatenate([of_law[:self.posture.start], posture,
                                   of_law[self.posture.stop:]])
        tau = self.law(q, u, pose, twist, acceleration, wrench, complete, t=t,
                       parameters=parameters)
        return tau, packed(target._replace(followed=followed, wrench=wrench))


def target_of(followed: Vector) -> tuple[Matrix, Vector, Vector]:
    """Return pose, twist and acceleration of the target within its limits."""
    row = followed[FILTER_SIZE // 2:]
    return row[:16].reshape(4, 4), row[16:22], row[22:]


def _length(x: Vector) -> Scalar:
    return np.sqrt(x @ x)
