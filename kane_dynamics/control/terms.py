"""Control modes, and the terms of the torque that is commanded."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Any

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array
from kane_dynamics.control.arm_gravity import ArmGravity
from kane_dynamics.control.quasi_static import QuasiStatic
from kane_dynamics.errors import InputError
from kane_dynamics.robot.feedforward_friction import changes_friction, feedforward_change
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
import numpy as np


class Mode(StrEnum):
    """Control modes; see `Controller`."""

    INVERSE_DYNAMICS = 'inverse_dynamics'
    COMPUTED_TORQUE = 'computed_torque'
    GRAVITY_COMPENSATION = 'gravity_compensation'
    JOINT_IMPEDANCE = 'joint_impedance'
    CARTESIAN_IMPEDANCE = 'cartesian_impedance'
    HAND_GUIDING = 'hand_guiding'
    MOTOR_SIDE = 'motor_side'

    @property
    def follows_motions(self) -> bool:
        """Return whether the joints follow a desired motion in this mode."""
        return self in (Mode.INVERSE_DYNAMICS, Mode.COMPUTED_TORQUE,
                        Mode.JOINT_IMPEDANCE, Mode.MOTOR_SIDE)

    @property
    def is_stiff(self) -> bool:
        """Return whether the torque depends on the distance to a desired position."""
        return self in (Mode.COMPUTED_TORQUE, Mode.JOINT_IMPEDANCE,
                        Mode.CARTESIAN_IMPEDANCE, Mode.MOTOR_SIDE)


@dataclass(frozen=True)
class Terms:
    """
    Torque terms of the command; False for terms that the arm compensates itself.

    With `arm` the arm compensates that gravity, and the command contains the difference:
    `gravity` is True then.
    """

    gravity: bool = True
    coriolis: bool = True
    inertia: bool = True
    friction: bool = True
    arm: ArmGravity | None = None

    @classmethod
    def beside(cls, arm_compensates: Collection[str]) -> Terms:
        """
        Return the terms to command in addition to the terms that the arm adds itself.

        Parameters
        ----------
        arm_compensates : collection of str
            Some of gravity, friction, coriolis and inertia, or 'none'.

        Raises
        ------
        InputError
            A name is unknown, or 'none' is one of several.

        """
        added = stated_terms(arm_compensates, 'arm_compensates')
        switches: Any = {name: False for name in added if name != NO_TERM}
        return cls(**switches)

    def __post_init__(self) -> None:
        """Raise InputError unless each switch is True or False."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name != 'arm' and not isinstance(value, bool | np.bool_):
                raise InputError(f'{field.name}: {value!r}; expected True or False')

    @lazy_property
    def weights(self) -> Array:
        """Return a weight for each row of `torque_terms`; the springs have no switch."""
        switches = [getattr(self, name, True) for name in TORQUE_TERMS]
        return np.array(switches, dtype=np.float64)

    @lazy_property
    def label(self) -> str:
        """Return a name that distinguishes kernels of these terms."""
        words = ''.join(str(int(weight)) for weight in self.weights)
        return words if self.arm is None else f'{words}_{self.arm.label}'

    @lazy_property
    def of_feedback(self) -> Terms:
        """
        Return the terms that computed torque takes at the measured state.

        Feedback acts through M in any case; friction is added at the desired speed.
        """
        return replace(self, inertia=True, friction=False)

    @lazy_property
    def complete(self) -> bool:
        """Return whether no term is switched off."""
        return bool(self.weights.all())

    def inverse_dynamics(self, source: Robot | QuasiStatic, q: Array, u: Array,
                         udot: Array, **time: Any) -> Array:
        """
        Return the command of a motion without the terms switched off, (..., n).

        Its friction is that of the choice `feedforward_friction`.
        """
        tau = self.whole_inverse_dynamics(source, q, u, udot, **time)
        if self.arm is None:
            return tau
        if not isinstance(source, Robot):
            raise InputError('arm: given for flexible links; expected rigid links')
        return tau - self.arm.force_at(source, q, **time)

    def whole_inverse_dynamics(self, source: Robot | QuasiStatic, q: Array, u: Array,
                               udot: Array, **time: Any) -> Array:
        """Return `inverse_dynamics` with the gravity that the arm itself compensates."""
        tau: Array
        # All terms: one inverse dynamics. Otherwise the sum of the terms that are
        # switched on.
        if self.complete:
            tau = source.inverse_dynamics(q, u, udot, **time)
        else:
            tau = self.weights @ source.torque_terms(q, u, udot, **time)
        if self.changes_friction(source):
            tau = tau + self.friction_change(source, q, u, udot, **time)
        return tau

    def changes_friction(self, source: Robot | QuasiStatic) -> bool:
        """Return whether commands have other friction than at the desired speed."""
        robot = source.robot if isinstance(source, QuasiStatic) else source
        return self.friction and changes_friction(robot)

    def friction_change(self, source: Robot | QuasiStatic, q: Array, u: Array,
                        udot: Array, **time: Any) -> Array:
        """Return the torques by which commands of a motion exceed inverse dynamics, (..., n)."""
        if isinstance(source, QuasiStatic):
            return source.feedforward_change(q, u, udot)
        return feedforward_change(source, q, u, udot, **time)


EVERY_TERM = Terms()
ARM_TERMS = ('gravity', 'friction', 'coriolis', 'inertia')  # that an arm may add itself
NO_TERM = 'none'
STATEMENT = f'a list of {", ".join(ARM_TERMS)}, or {NO_TERM} alone'


def stated_terms(value: Any, what: str) -> tuple[str, ...]:
    """
    Return a statement of which torque terms an arm adds to commanded efforts itself.

    Parameters
    ----------
    value : str or collection of str
        Names of terms, as text separated by commas, or 'none'.
    what : str
        Name of the value in errors.

    Raises
    ------
    InputError
        A name is unknown or occurs twice, 'none' is one of several, or there is no name.

    """
    names = value
    if isinstance(value, str):
        # From a parameter as text, from Python as names.
        names = [name.strip() for name in value.split(',')]
    wrong = InputError(f'{what}: {value!r}; expected {STATEMENT}')
    if not isinstance(names, list | tuple | set | frozenset):
        raise wrong
    # 'none' stands alone; other terms in any order, each once.
    distinct = [name for name in names if isinstance(name, str)]
    if len(set(distinct)) < len(names) or not names:
        raise wrong
    if distinct != [NO_TERM] and not set(distinct) <= set(ARM_TERMS):
        raise wrong
    return tuple(distinct)
