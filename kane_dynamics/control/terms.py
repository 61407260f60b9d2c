"""Control modes, and switches for the terms of the torque that is commanded."""

from dataclasses import dataclass, fields
from enum import StrEnum

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
import numpy as np


class Mode(StrEnum):
    """Control modes; see `Controller`."""

    INVERSE_DYNAMICS = 'inverse_dynamics'
    COMPUTED_TORQUE = 'computed_torque'
    GRAVITY_COMPENSATION = 'gravity_compensation'


@dataclass(frozen=True)
class Terms:
    """Torque terms of the command; False for terms that the arm compensates itself."""

    gravity: bool = True
    coriolis: bool = True
    inertia: bool = True
    friction: bool = True

    def __post_init__(self) -> None:
        """Raise InputError unless each switch is True or False."""
        for field in fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, bool | np.bool_):
                raise InputError(f'{field.name}: {value!r}; expected True or False')

    @lazy_property
    def weights(self) -> Array:
        """Return one weight for each row of `torque_terms`; the springs have no switch."""
        return np.array([getattr(self, name, True) for name in TORQUE_TERMS], dtype=np.float64)

    @lazy_property
    def complete(self) -> bool:
        """Return whether no term is switched off."""
        return bool(self.weights.all())

    def inverse_dynamics(self, source: Robot | QuasiStatic, q: Array, u: Array,
                         udot: Array) -> Array:
        """Return the torque of a motion without the terms that are switched off, (..., n)."""
        if self.complete:
            return source.inverse_dynamics(q, u, udot)
        tau: Array = self.weights @ source.torque_terms(q, u, udot)
        return tau


EVERY_TERM = Terms()
