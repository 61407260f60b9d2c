"""What may change between two cycles: gravity, and what the arm carries."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.model.inertial import Inertial, principal_moments
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array
import numpy as np


@dataclass(frozen=True, eq=False)
class GravityAndPayload:
    """Gravity, (3,) m/s^2 in world axes, and the payload in axes of the payload frame."""

    gravity: Array
    payload: Inertial | None = None

    def apply(self, robot: Robot) -> None:
        """Put both into the parameters of a robot's kernels."""
        robot.parameters.gravity = self.gravity
        if robot.equations.payload_frame is not None:
            robot.parameters.payload = self.payload


@dataclass(frozen=True)
class PayloadBounds:
    """Where payloads are given, and the largest that is accepted, kg and m."""

    frame: str
    max_mass: float
    max_distance: float

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> 'PayloadBounds':
        """Take them from the node's parameters."""
        return cls(values['payload.frame'], values['payload.max_mass'],
                   values['payload.max_distance'])


def checked_payload(model: Model, bounds: PayloadBounds, frame: str, mass: float,
                    com: Sequence[float], inertia: Sequence[float]) -> Inertial | None:
    """
    Return a payload in axes of the payload frame; None for a mass of zero.

    Parameters
    ----------
    model : Model
        Of the robot that carries it.
    bounds : PayloadBounds
        What is believed at most.
    frame : str
        Frame that com and inertia are given in, fixed to the same body as the payload frame;
        empty: the payload frame.
    mass : float
        kg.
    com : three float
        Mass centre from the frame's origin, m.
    inertia : six float
        xx, xy, xz, yy, yz, zz about the mass centre, kg m^2.

    Raises
    ------
    InputError
        Names the field, its value and what is valid.

    """
    if not bounds.frame:
        raise InputError('this node carries no payload; set parameter payload.frame before it '
                         'configures')
    if not (math.isfinite(mass) and 0.0 <= mass <= bounds.max_mass):
        raise InputError(f'the mass is {mass:g} kg; valid: 0 to {bounds.max_mass:g} kg (parameter '
                         'payload.max_mass)')
    distance = math.hypot(*com)
    if not distance <= bounds.max_distance:
        raise InputError(f'the mass centre is at {list(com)} m; valid: finite numbers, at most '
                         f'{bounds.max_distance:g} m away (parameter payload.max_distance)')
    xx, xy, xz, yy, yz, zz = inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    _check_inertia(tensor, mass * bounds.max_distance ** 2)
    at, carrier = model.frame(frame or bounds.frame), model.frame(bounds.frame)
    if at.body != carrier.body:
        valid = ', '.join(sorted(each.name for each in model.frames if each.body == carrier.body))
        raise InputError(f"frame '{at.name}' is not fixed to that of parameter payload.frame, "
                         f"'{carrier.name}'; valid: {valid}")
    if mass == 0.0:
        return None
    back = carrier.rotation.T
    return Inertial(mass, np.array(com), tensor).moved(
        back @ at.rotation, back @ (at.translation - carrier.translation))


def _check_inertia(tensor: Array, most: float) -> None:
    """Raise unless matter within bounds can have this central inertia."""
    if not np.isfinite(tensor).all():
        raise InputError(f'the inertia is {tensor.tolist()}; valid: finite numbers')
    found = principal_moments(tensor, rounding=1e-6)  # of numbers that were printed and read
    if not found.possible:
        raise InputError(f'the inertia has the principal moments {found}; expected none '
                         'negative, none larger than the sum of the other two')
    largest = found.moments[2]
    if largest > most:
        raise InputError(f'the inertia has the principal moment {largest:g} kg m^2; expected at '
                         f'most {most:g} kg m^2, mass times the square of parameter '
                         'payload.max_distance')


def start_loads(model: Model, values: Mapping[str, Any]) -> GravityAndPayload:
    """
    Return what the parameters gravity and payload.* say.

    Raises
    ------
    InputError
        The payload is not valid, or there is one but no frame for it.

    """
    payload = None
    if values['payload.frame'] or values['payload.mass'] > 0.0:
        try:
            payload = checked_payload(model, PayloadBounds.from_values(values), '',
                                      values['payload.mass'], values['payload.com'],
                                      values['payload.inertia'])
        except InputError as error:
            raise InputError(f"parameters 'payload.*': {error}") from None
    return GravityAndPayload(values['gravity'], payload)
