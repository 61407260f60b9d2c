"""Gravity and payload, which may change between two cycles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from kane_dynamics.control.controller import Controller
from kane_dynamics.errors import InputError
from kane_dynamics.model.inertial import Inertial, principal_moments
from kane_dynamics.model.model import Model
from kane_dynamics.robot.parameters import Parameters
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array
import numpy as np


@dataclass(frozen=True, eq=False)
class GravityAndPayload:
    """Gravity, (3,) m/s^2 in world axes, and the payload in the axes of payload.frame."""

    gravity: Array
    payload: Inertial | None = None

    def apply(self, robot: Robot) -> None:
        """Set the parameters of a robot's kernels."""
        self._write(robot, robot.parameters)

    def parameters_of(self, robot: Robot) -> Parameters:
        """Return a copy of a robot's parameters with these loads."""
        parameters = robot.parameters.copy()
        self._write(robot, parameters)
        return parameters

    def _write(self, robot: Robot, parameters: Parameters) -> None:
        """Set gravity, and the payload of a robot that may carry one."""
        parameters.gravity = self.gravity
        if robot.equations.payload_frame is not None:
            parameters.payload = self.payload

    def apply_to(self, controller: Controller) -> None:
        """Set the parameters of the robots of a controller."""
        self.apply(controller.robot)
        if controller.bending is not None:
            self.apply(controller.bending.robot)


def checked_payload(model: Model, values: Mapping[str, Any], frame: str, mass: float,
                    com: Sequence[float], inertia: Sequence[float]) -> Inertial | None:
    """
    Check a payload and return it in the axes of the payload frame; None for zero mass.

    Parameters
    ----------
    model : Model
        Model of the robot that carries the payload.
    values : mapping
        The node's parameters: payload frame, largest accepted mass and distance.
    frame : str
        Frame of com and inertia, fixed to the same body as the payload frame; empty: the
        payload frame.
    mass : float
        Mass, kg.
    com : three float
        Center of mass relative to the origin of the frame, m.
    inertia : six float
        xx, xy, xz, yy, yz, zz about the center of mass, kg m^2.

    Raises
    ------
    InputError
        A field is invalid, or the node has no payload frame.

    """
    carrying = values['payload.frame']
    max_mass = values['payload.max_mass']
    max_distance = values['payload.max_distance']
    if not carrying:
        raise InputError('payload: parameter payload.frame is empty; expected a frame, '
                         'set before the node configures')
    if not (math.isfinite(mass) and 0.0 <= mass <= max_mass):
        raise InputError(f'mass: {mass:g} kg; expected 0 to {max_mass:g} kg (parameter '
                         'payload.max_mass)')
    # The moments of inertia are at most those of all mass at the largest distance.
    distance = math.hypot(*com)
    if not distance <= max_distance:
        raise InputError(f'center of mass: {np.asarray(com).tolist()} m; expected '
                         f'finite numbers, at most {max_distance:g} m from the frame')
    xx, xy, xz, yy, yz, zz = inertia
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    _check_inertia(tensor, mass * max_distance * max_distance)
    # In axes of the payload frame, whichever frame of the same body the payload is
    # stated in.
    at = model.frame(frame or carrying)
    carrier = model.frame(carrying)
    if at.body != carrier.body:
        expected = ', '.join(sorted(fixed.name for fixed in model.frames
                                    if fixed.body == carrier.body))
        raise InputError(f"frame: '{at.name}', not fixed to the body of payload.frame "
                         f"'{carrier.name}'; expected one of {expected}")
    if mass == 0.0:
        return None
    back = carrier.rotation.T
    return Inertial(mass, np.array(com), tensor).moved(
        back @ at.rotation, back @ (at.translation - carrier.translation))


def _check_inertia(tensor: Array, bound: float) -> None:
    """Raise InputError unless a body within the bounds can have this central inertia."""
    if not np.isfinite(tensor).all():
        raise InputError(f'inertia: {tensor.tolist()}; expected finite numbers')
    principal = principal_moments(tensor, rounding=1e-6)  # rounding of numbers in text
    if not principal.possible:
        raise InputError(f'inertia: principal moments {principal}; expected none '
                         'negative and none larger than the sum of the other two')
    largest = principal.moments[2]
    if largest > bound:
        raise InputError(f'inertia: principal moment {largest:g} kg m^2; expected at '
                         f'most {bound:g} kg m^2, the mass times the square of the '
                         'largest distance')


def parameter_loads(model: Model, values: Mapping[str, Any]) -> GravityAndPayload:
    """
    Return gravity and payload of the parameters.

    Raise InputError for an invalid payload.
    """
    payload = None
    # A frame without mass declares where a payload may come later.
    if values['payload.frame'] or values['payload.mass'] > 0.0:
        try:
            payload = checked_payload(model, values, '', values['payload.mass'],
                                      values['payload.com'], values['payload.inertia'])
        except InputError as error:
            raise InputError(f"parameters 'payload.*': {error}") from None
    return GravityAndPayload(values['gravity'], payload)
