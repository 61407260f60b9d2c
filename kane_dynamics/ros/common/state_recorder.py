"""Record the joint states of a live graph for some time."""

from collections.abc import Sequence
import time
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.ros.common.conversion import nanoseconds
from kane_dynamics.ros.common.qos import EXAMINED_STATES
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState


def record_states(joint_names: Sequence[str], seconds: float,
                  topic: str = 'joint_states') -> Recording:
    """
    Return the joint states that come within some time, with speeds from positions.

    Raises
    ------
    InputError
        Fewer than three states with positions and efforts of all joints came.

    """
    rows: list[list[float]] = []

    def take(message: Any) -> None:
        places = {name: k for k, name in enumerate(message.name)}
        if not set(joint_names) <= set(places) or len(message.effort) < len(places):
            return
        stamp = 1e-9 * nanoseconds(message.header.stamp)
        if rows and stamp <= rows[-1][0]:
            return
        chosen = [places[name] for name in joint_names]
        rows.append([stamp, *(message.position[k] for k in chosen),
                     *(message.effort[k] for k in chosen)])
    # A context of its own, so that the caller's nodes are not touched.
    context = Context()
    rclpy.init(context=context)
    try:
        node = Node('kane_dynamics_recorder', context=context)
        node.create_subscription(JointState, topic, take, EXAMINED_STATES)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.05)
    finally:
        rclpy.try_shutdown(context=context)
    if len(rows) < 3:
        raise InputError(f"joint states: {len(rows)} on '{topic}' within {seconds:g} s with "
                         f'positions and efforts of {", ".join(joint_names)}; expected those '
                         'of a driver or of plant_node')
    table = np.array(rows)
    n = len(joint_names)
    t = table[:, 0] - table[0, 0]
    still = np.zeros((len(t), n))
    recording = Recording(t, table[:, 1:n + 1], still, still, table[:, n + 1:])
    return recording.with_derived_speeds()
