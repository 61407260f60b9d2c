"""Lead an arm through poses, by hand or by its own controller, and record how it holds them."""

from collections.abc import Callable, Sequence
from contextlib import suppress
import threading
import time
from typing import Any

from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.poses.held_poses import (FEWEST, HeldPoses,
                                                           last_hold)
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.ros.common.conversion import nanoseconds
from kane_dynamics.ros.common.qos import EXAMINED_STATES
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

WAIT = 30.0  # s of real time for joint states, or for a controller
LATE = 3.0, 20.0  # factor and s of real time by which a motion may be late
SETTLED, RECORDED = 0.5, 1.0  # s of a hold: before and during the record
ATTEMPTS = 10  # times that a hold is recorded until the arm rests
SIDE = 0.1  # rad or m: distance from which a pose is approached
SPEED = 1.0  # rad/s or m/s: largest speed of a motion, and its share of the limit
SHARE = 0.3
SHORTEST = 1.0  # s of a motion
SENT = 3  # times that a motion is sent
FOLLOWED = 0.3  # of the last way: an arm that moves less does not follow
PEAK = 1.875  # largest speed of a quintic from rest to rest over its mean
FRICTION = 0.02  # of the efforts: a smaller change between both sides is not friction
TRIED = 2  # poses that are approached from both sides in any case


class PoseLeader:
    """
    Leads an arm through poses and records how it holds them.

    Parameters
    ----------
    joint_names : sequence of str
    topic : str
        Of the joint states.
    controller : str or None
        Topic on which the arm's controller takes a JointTrajectory; None for poses that a
        person reaches by hand.
    ask : callable
        Called with what a person has to do; returns when it is done.

    """

    def __init__(self, joint_names: Sequence[str], topic: str, controller: str | None,
                 ask: Callable[[str], None]) -> None:
        self._names = list(joint_names)
        self._topic = topic
        self._controller = controller
        self._ask = ask
        self._rows: list[list[float]] = []
        # A context of its own, so that the caller's nodes are not touched.
        self._context = Context()
        rclpy.init(context=self._context)
        node = Node('kane_dynamics_pose_leader', context=self._context)
        node.create_subscription(JointState, topic, self._keep, EXAMINED_STATES)
        self._publisher = None
        if controller is not None:
            self._publisher = node.create_publisher(JointTrajectory, controller, 1)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(node)
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):  # `close`
            self._executor.spin()

    def close(self) -> None:
        """End the node."""
        rclpy.try_shutdown(context=self._context)
        self._thread.join()

    def _keep(self, message: Any) -> None:
        """Keep a joint state that has positions and efforts of all joints."""
        places = {name: k for k, name in enumerate(message.name)}
        if not set(self._names) <= set(places) or len(message.effort) < len(places):
            return
        stamp = 1e-9 * (nanoseconds(message.header.stamp) or time.time_ns())
        if self._rows and stamp <= self._rows[-1][0]:
            return
        chosen = [places[name] for name in self._names]
        self._rows.append([stamp, *(message.position[k] for k in chosen),
                           *(message.effort[k] for k in chosen)])

    def lead(self, poses: Array, count: int, speed_limit: Array,
             free: Callable[[Array, Array], bool]) -> HeldPoses:
        """
        Return how the arm holds some of the poses, each once or from both sides.

        Both sides are left out after the first poses if the efforts do not depend on the
        side.

        Parameters
        ----------
        poses : (k, n) array
            Candidates, the best ones first; at least `SIDE` within the limits.
        count : int
            Number of poses to hold.
        speed_limit : (n,) array
            Largest rates of the joints, rad/s or m/s.
        free : callable
            Whether the straight way between two configurations is free; poses without
            a free way are left out.

        Raises
        ------
        InputError
            No joint states come, the arm does not move, or does not rest.

        """
        self._await(lambda: len(self._rows) > 1, WAIT,
                    f"joint states: none on '{self._topic}' within {WAIT:g} s with "
                    f'positions and efforts of {listing(self._names)}; expected those of '
                    'a driver or of plant_node')
        publisher = self._publisher
        if publisher is not None:
            self._await(lambda: publisher.get_subscription_count() > 0, WAIT,
                        f"--move: no node takes trajectories on '{self._controller}'; "
                        'expected a controller, as joint_trajectory_controller or '
                        'kane_dynamics')
        held: list[HeldPoses] = []
        number = 0
        at = np.array(self._rows[-1][1:len(self._names) + 1])
        for q in poses:
            if number == count:
                break
            if self._publisher is not None and not free(at, q):
                continue
            number += 1
            title = f'pose {number} of {count}'
            held.append(self._reach(q, -1.0, speed_limit, title))
            if number <= TRIED or _has_friction(held):
                held.append(self._reach(q, 1.0, speed_limit,
                                        f'{title}, from the other side'))
            at = q
        if number < FEWEST:
            raise InputError(f'poses: {number} that the arm reaches on straight ways '
                             'without contact; expected at least '
                             f'{FEWEST} (--floor, or poses by hand)')
        rows = [(pose.q, pose.effort, pose.approach) for pose in held]
        return HeldPoses(*map(np.concatenate, zip(*rows, strict=True)))

    def _reach(self, q: Array, side: float, speed_limit: Array, title: str) -> HeldPoses:
        """Reach a pose from a side of each joint, and return how the arm holds it."""
        first = len(self._rows) - 1
        values = ', '.join(f'{name} {value:.2f}' for name, value in zip(self._names, q))
        if self._publisher is None:
            self._ask(f'{title}: move the arm to about {values}'
                      f'{", past it and back" * (side > 0.0)}; let it hold itself')
        else:
            self._ask(f'{title}: {values}')
            # A controller refuses a motion while it misses joint states.
            if not any(self._move(q, side, speed_limit) for _ in range(SENT)):
                raise InputError(f"--move: the controller on '{self._controller}' did not "
                                 'move the arm; expected one that takes the motion: its '
                                 'log has the reason')
        return self._hold(first)

    def _move(self, q: Array, side: float, speed_limit: Array) -> bool:
        """Let the controller move the arm to a pose from a side; return whether it moved."""
        ways = [q + side * SIDE, q]
        speed = np.minimum(SPEED, SHARE * speed_limit)
        message = JointTrajectory(joint_names=self._names)
        first = len(self._rows) - 1
        last = self._rows[first]
        start = last[0]
        at = np.array(last[1:len(q) + 1])
        ends = [0.0]
        for way in ways:
            duration = max(SHORTEST, PEAK * float(np.max(np.abs(way - at) / speed)))
            ends.append(ends[-1] + duration)
            point = JointTrajectoryPoint(positions=way.tolist())
            point.velocities = point.accelerations = [0.0] * len(q)
            since = divmod(round(1e9 * ends[-1]), 10**9)
            point.time_from_start.sec, point.time_from_start.nanosec = since
            message.points.append(point)
            at = way
        assert self._publisher is not None
        self._publisher.publish(message)
        self._await_states(start + ends[-1] + SETTLED, LATE[0] * ends[-1] + LATE[1])
        # The last way alone: it is short, so that the arm sags as much at both ends.
        table = np.array(self._rows[first:])
        last_way = table[table[:, 0] >= start + ends[1], 1:len(q) + 1]
        from_side = side * (last_way - last_way[-1]).mean(axis=1)
        return bool(from_side.max() > FOLLOWED * SIDE)

    def _hold(self, first: int) -> HeldPoses:
        """Return how the arm is held now; rows since `first` show the approach."""
        n = len(self._names)
        for _ in range(ATTEMPTS):
            self._await_states(self._rows[-1][0] + SETTLED + RECORDED, WAIT)
            table = np.array(self._rows[max(first, 0):])
            still = np.zeros((len(table), n))
            recording = Recording(table[:, 0] - table[0, 0], table[:, 1:n + 1], still,
                                  still, table[:, n + 1:])
            held = last_hold(recording, RECORDED)
            if held is not None:
                return held
        raise InputError('arm: it does not rest; expected an arm that holds itself for '
                         f'{SETTLED + RECORDED:g} s')

    def _await_states(self, stamp: float, seconds: float) -> None:
        """Wait for a state after a stamp, s; raise InputError after some time."""
        self._await(lambda: self._rows[-1][0] > stamp, seconds,
                    f"joint states: they ended on '{self._topic}'; expected them all the "
                    'time')

    def _await(self, condition: Callable[[], bool], seconds: float, words: str) -> None:
        """Wait for a condition; raise InputError after some time."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                raise InputError(words)
            time.sleep(0.02)


def _has_friction(held: Sequence[HeldPoses]) -> bool:
    """Return whether efforts depend on the side, of poses held from both sides."""
    efforts = np.concatenate([pose.effort for pose in held[:2 * TRIED]])
    change = np.sqrt(np.mean((efforts[1::2] - efforts[::2])**2, axis=0))
    size = np.sqrt(np.mean(efforts**2, axis=0))
    return bool((change > FRICTION * size).any())
