"""
The messages between the dynamics node and torque_guard, as std_msgs/Float64MultiArray.

~/loads (node to guard, latched): id of the configuration, gravity, payload, digest of
the arm. ~/guard_request (node to guard): number of a request for the topic `commands`; 0
after zeros. ~/guard_state (guard to node): number of the request that it answers,
whether the guard commanded until then, whether the last torques are the guard's, the
identity of the guard (its start on the monotonic clock of its computer, which is never
set back), the last torques. Without a request it is sent with number 0 as a heartbeat.
"""

from collections.abc import Sequence
from dataclasses import replace
import hashlib
import sys
from typing import Any, NamedTuple

from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.model import Model
from kane_dynamics.ros.common.command_topic import GUARD_STATE
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload
import numpy as np

# Names of topics of the node
LOADS, REQUEST, STATE = 'loads', 'guard_request', GUARD_STATE
LOADS_LENGTH = 15
HEARTBEAT_PERIOD = 0.1  # s between two heartbeats of the guard
DIGITS = 13  # hexadecimal digits of a digest, which a double holds exactly
_UPPER = np.triu_indices(3)


class NodeLoads(NamedTuple):
    """The content of ~/loads: id of the configuration, loads, digest of the arm."""

    configuration: float
    loads: GravityAndPayload
    digest: float


def arm_digest(model: Model, constraints: Sequence[Any] | None) -> float:
    """
    Return a number that differs for arms of other equations of motion.

    It covers the model and its constraints, but not gravity, which may change.

    Parameters
    ----------
    model : Model
        Model that the parameters describe.
    constraints : sequence, optional
        Those of a constraints file.

    """
    content = replace(model, gravity=np.zeros(3)).digest().encode()
    with np.printoptions(floatmode='unique', threshold=sys.maxsize):
        content += repr(tuple(constraints or ())).encode()
    return float(int(hashlib.sha256(content).hexdigest()[:DIGITS], 16))


def loads_to_numbers(configuration: float, loads: GravityAndPayload,
                     digest: float) -> list[float]:
    """
    Return the content of ~/loads as numbers.

    They are id, gravity, mass, com, central inertia (6), digest.
    """
    payload = loads.payload or Inertial(0.0, np.zeros(3), np.zeros((3, 3)))
    return [configuration, *loads.gravity, payload.mass, *payload.com,
            *payload.inertia[_UPPER], digest]


def loads_from_numbers(numbers: Array) -> NodeLoads:
    """Return the content of a message on ~/loads, (15,)."""
    configuration = numbers[0]
    gravity = numbers[1:4]
    mass = numbers[4]
    com = numbers[5:8]
    # The message has the upper triangle.
    inertia = np.zeros((3, 3))
    inertia[_UPPER] = numbers[8:14]
    inertia = inertia + np.triu(inertia, 1).T
    payload = Inertial(float(mass), com, inertia) if mass else None
    return NodeLoads(float(configuration), GravityAndPayload(gravity, payload),
                     float(numbers[14]))
