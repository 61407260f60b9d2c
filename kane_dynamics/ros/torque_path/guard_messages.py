"""
The messages between the dynamics node and torque_guard, as std_msgs/Float64MultiArray.

~/loads (node to guard, latched): id of the configuration, gravity, payload.
~/guard_request (node to guard): number of a request for the topic `commands`; 0 after zeros.
~/guard_state (guard to node): number of the request that it answers, whether the guard commanded
until then, whether the last torques are the guard's, the last torques. Without a request it is
sent with number 0 as a heartbeat.
"""

from kane_dynamics.model.inertial import Inertial
from kane_dynamics.ros.common.commanders import GUARD_STATE
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.torque_path.gravity_payload import GravityAndPayload
import numpy as np

LOADS, REQUEST, STATE = 'loads', 'guard_request', GUARD_STATE  # names of topics of the node
LOADS_LENGTH = 14
STOPPED = 0.0  # request number of a node that commanded zeros
FIELDS = 3  # numbers before the torques
HEARTBEAT_PERIOD = 0.1  # s between two heartbeats of the guard
LOST = 0.5  # s without a heartbeat after which the guard counts as dead
_UPPER = np.triu_indices(3)


def loads_to_numbers(configuration: float, loads: GravityAndPayload) -> list[float]:
    """Return the content of ~/loads: id, gravity (3), mass, com (3), central inertia (6)."""
    payload = loads.payload or Inertial(0.0, np.zeros(3), np.zeros((3, 3)))
    return [configuration, *loads.gravity, payload.mass, *payload.com,
            *payload.inertia[_UPPER]]


def loads_from_numbers(numbers: Array) -> tuple[float, GravityAndPayload]:
    """Return the id of the configuration and the loads of a message on ~/loads, (14,)."""
    configuration, gravity, mass, com = numbers[0], numbers[1:4], numbers[4], numbers[5:8]
    inertia = np.zeros((3, 3))
    inertia[_UPPER] = numbers[8:14]
    inertia = inertia + np.triu(inertia, 1).T
    return float(configuration), GravityAndPayload(
        gravity, Inertial(float(mass), com, inertia) if mass else None)
