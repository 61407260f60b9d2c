"""Run-time parameters of a robot (gravity, payload, tolerances) and its joint limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.checks import constant, real_numbers
from kane_dynamics._util.fixed_attributes import refused
from kane_dynamics._util.text import SHORT
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.conditioning import EXCESS
from kane_dynamics.model.inertial import principal_moments
from kane_dynamics.model.model import Frame, Inertial, Model
from kane_dynamics.model.plausible_sizes import reach, warn_of_distance
import numpy as np


@dataclass(frozen=True, eq=False)
class JointLimits:
    """
    Limits of every coordinate's joint, (n_q,) arrays; infinite where none is given.

    With ball joints, velocity and effort have one entry for each joint name instead.
    """

    lower: Array
    upper: Array
    velocity: Array
    effort: Array


def checked_limits(limits: JointLimits, coordinates: Sequence[str],
                   joints: Sequence[str]) -> JointLimits:
    """Return the limits in arrays of their own; InputError names a wrong one."""
    arrays = {}
    for name in ('lower', 'upper', 'velocity', 'effort'):
        value = getattr(limits, name)
        if name in ('lower', 'upper'):
            names, least, expected = coordinates, -np.inf, 'a number'
        else:
            names, least, expected = joints, 0.0, 'a number >= 0'
        try:
            array = np.array(real_numbers(value))
        except (TypeError, ValueError):
            raise InputError(f'limits.{name}: {SHORT.repr(value)}; expected '
                             f'{len(names)} numbers') from None
        if array.shape != (len(names),):
            raise InputError(f'limits.{name}: shape {array.shape}; expected '
                             f'{(len(names),)}, of {", ".join(names)}')
        wrong = np.flatnonzero(~(array >= least))  # NaN passes no comparison
        if len(wrong) > 0:
            raise InputError(f"limits.{name} of joint '{names[wrong[0]]}': "
                             f'{array[wrong[0]]}; expected {expected}')
        arrays[name] = array
    crossed = np.flatnonzero(arrays['lower'] > arrays['upper'])
    if len(crossed) > 0:
        j = crossed[0]
        raise InputError(f"limits of joint '{coordinates[j]}': lower "
                         f'{arrays["lower"][j]:g}, upper {arrays["upper"][j]:g}; expected '
                         'lower <= upper')
    return JointLimits(**arrays)


class Parameters:
    """Gravity, payload and closure tolerance; they change without compiling."""

    __slots__ = ('_excess', '_frame', '_payload', '_reach', '_tolerance', 'block',
                 'physical')

    def __init__(self, model: Model, payload_frame: Frame | None, watched: int = 0,
                 excess: float = EXCESS) -> None:
        """
        Start with the model's gravity and no payload.

        `watched` is the number of limits, `excess` the largest violation of redundant
        rows.
        """
        self._excess = excess
        self._frame = payload_frame
        self._payload: Inertial | None = None
        self._reach = reach(model)
        self._tolerance: tuple[float, float] | None = None
        self.physical = 3 if payload_frame is None else 13  # entries before the limits
        self.block = np.zeros(self.physical + watched)
        self.gravity = model.gravity

    def __setattr__(self, name: str, value: Any) -> None:
        """Raise AttributeError for an unknown attribute."""
        if not hasattr(type(self), name):
            raise AttributeError(refused(self, name))
        object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        """Return the values on one line."""
        words = [f'gravity {self.gravity.tolist()} m/s^2']
        # Only a robot that declares a payload frame has a payload.
        if self._frame is not None:
            load = self._payload
            words.append('no payload' if load is None else
                         f"payload {load.mass:g} kg at {load.com.tolist()} m of '"
                         f"{self._frame.name}'")
        if self._tolerance is not None:
            words.append('closure tolerance {:g} m, {:g} rad'.format(*self._tolerance))
        return f'<Parameters: {", ".join(words)}>'

    def copy(self) -> Parameters:
        """Return a copy with a separate block."""
        other = object.__new__(Parameters)
        for name in self.__slots__:
            object.__setattr__(other, name, getattr(self, name))
        other.block = self.block.copy()
        return other

    def assign(self, values: Parameters) -> None:
        """Set the values of a copy of these parameters; the block stays the same."""
        self.block[:] = values.block
        for name in ('_payload', '_tolerance'):
            object.__setattr__(self, name, getattr(values, name))

    @property
    def gravity(self) -> Array:
        """Acceleration of free fall, (3,), m/s^2, world axes."""
        value = self.block[:3].copy()
        value.flags.writeable = False  # an assigned entry of a copy has no effect
        return value

    @gravity.setter
    def gravity(self, value: Any) -> None:
        self.block[:3] = constant(value, (3,), 'gravity (m/s^2)', InputError)

    @property
    def closure_tolerance(self) -> tuple[float, float] | None:
        """
        Largest constraint residual that calls accept, (m, rad); None for no limit.

        The first is that of the largest loop, those of others are smaller in proportion.

        Set it to a number for both, to a pair, or to None. It applies to the 2-norm of
        the residuals.
        """
        return self._tolerance

    @closure_tolerance.setter
    def closure_tolerance(self, value: Any) -> None:
        if value is None:
            self._tolerance = None
        else:
            # One number stands for m and rad.
            try:
                pair = np.broadcast_to(np.asarray(value, dtype=np.float64), 2)
            except (TypeError, ValueError):
                pair = np.full(2, np.nan)
            if not (np.isfinite(pair).all() and (pair > 0.0).all()):
                raise InputError(f'closure_tolerance: {value!r}; expected a positive '
                                 'number, m and rad, a pair of them, or None')
            self._tolerance = float(pair[0]), float(pair[1])
        if len(self.block) > self.physical:  # redundant rows hold where loops close
            # The block has 1 / limit^2, so that 0 is no limit.
            limits = np.full(3, np.inf)
            if self._tolerance is not None:
                limits[:] = *self._tolerance, self._excess
            self.block[self.physical + 1:] = limits**-2.0

    @property
    def payload(self) -> Inertial | None:
        """
        Return the payload in the axes of `payload_frame`; None without one.

        Set it to an Inertial, or to its ten `Inertial.parameters`, as functions for
        CasADi, PyTorch and JAX take them.
        """
        return self._payload

    @payload.setter
    def payload(self, value: Any) -> None:
        if self._frame is None:
            raise InputError('payload: given to a robot without payload frame; expected '
                             "robot.with_payload('<frame>', payload), or "
                             "Robot(..., payload_frame='...')")
        # Ten numbers are the parameters of an inertia.
        if not (value is None or isinstance(value, Inertial)):
            if np.shape(value) != (10,):
                raise InputError(f'payload: a {type(value).__name__}; expected an '
                                 'Inertial, its ten parameters or None')
            value = Inertial.from_parameters(constant(value, (10,), 'payload',
                                                      InputError))
        if value is not None:
            _check_payload(value, self._reach)
        # The entries behind gravity; zeros are no payload.
        self.block[3:13] = 0.0 if value is None else value.parameters
        self._payload = value


def _check_payload(payload: Inertial, links: float) -> None:
    """
    Raise InputError for impossible moments; warn of a distant center of mass.

    `links` is the length of all links in one line, m.
    """
    moments = principal_moments(payload.inertia)
    if not moments.possible:
        raise InputError(f'payload: principal moments of inertia are {moments}; '
                         'expected none negative or larger than the sum of the others')
    warn_of_distance(payload.com, links, 'payload: center of mass', stacklevel=4)
