"""Check a SetPayload request."""

from collections.abc import Mapping
from typing import Any

from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.model import Model
from kane_dynamics.ros.torque_path.gravity_payload import checked_payload, PayloadBounds


def payload_from_request(request: Any, model: Model, values: Mapping[str, Any]) -> Inertial | None:
    """
    Return the payload of a SetPayload request in the axes of the payload frame; None for none.

    Parameters
    ----------
    request : SetPayload.Request
        Payload and its frame.
    model : Model
        Model of the robot that carries the payload.
    values : mapping
        The node's parameters.

    Raises
    ------
    InputError
        A field is invalid, or the node has no payload frame.

    """
    given = request.payload
    return checked_payload(
        model, PayloadBounds.from_values(values), request.frame, given.m,
        (given.com.x, given.com.y, given.com.z),
        (given.ixx, given.ixy, given.ixz, given.iyy, given.iyz, given.izz))
