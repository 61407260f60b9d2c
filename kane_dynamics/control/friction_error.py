"""Friction that a model lacks, from a contact-free run, adapted slowly in motion."""

from __future__ import annotations

from collections.abc import Sequence

from kane_dynamics._util.checks import (finite_row, instance, names_of_joints, number,
                                        per_joint)
from kane_dynamics._util.fixed_attributes import guarded_class
from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array, Scalar
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.friction import coulomb as coulomb_shape
import numpy as np
from numpy.typing import ArrayLike

FRICTION_SPEED = 0.05  # rad/s or m/s, as of `model.Joint`
LEAST_NORM = 0.1  # of the squared regressor: adaptation is slow near standstill
UNIT_SPEED = 1.0  # rad/s or m/s, at which damping adapts as fast as Coulomb friction


@guarded_class
class FrictionError:
    """
    Torque of measured friction beyond the model's, for `MomentumObserver`.

    ``torque(u) = offset + coulomb tanh(u / friction_speed) + damping u`` for each joint;
    the values may be negative. `calibrate_collision` fits them to a recording without
    contact.

    Friction changes with temperature and wear. Coulomb friction and damping therefore
    follow the estimate of the observer by normalized gradient steps (normalized LMS)
    with the time constant `memory`. Both act in motion only: a force on a resting joint
    is never taken for friction, and a constant force averages out when the joint turns
    back.

    Parameters
    ----------
    joint_names : sequence of str
        `Robot.speed_names`.
    coulomb, damping, offset : float or (n,) array_like
        N m or N; damping in N m s or N s/m.
    friction_speed : float or (n,) array_like
        rad/s or m/s, positive.
    memory : float
        Time constant of the adaptation in motion, s; infinite: the values are constant.
    largest : float or (n,) array_like
        Larger estimates adapt as slowly as estimates of this size, N m or N: use the
        thresholds of collision detection, so that contacts change the values little.

    Attributes
    ----------
    joint_names : tuple of n str
    coulomb, damping, offset : (n,) arrays
        The present values.

    Raises
    ------
    InputError
        Names the argument, the joint and the value.

    """

    def __init__(self, joint_names: Sequence[str], *, coulomb: ArrayLike = 0.0,
                 damping: ArrayLike = 0.0, offset: ArrayLike = 0.0,
                 friction_speed: ArrayLike = FRICTION_SPEED, memory: float = np.inf,
                 largest: ArrayLike = np.inf) -> None:
        names = names_of_joints(joint_names)
        self.joint_names = names
        self.coulomb = _signed(coulomb, 'coulomb', names)
        self.damping = _signed(damping, 'damping', names)
        self.offset = _signed(offset, 'offset', names)
        self._speed = per_joint(friction_speed, 'friction_speed', names)
        # The speed divides the rate in tanh(u / speed).
        if not self._speed.all():
            joint = names[int(np.flatnonzero(self._speed == 0.0)[0])]
            raise InputError(f"friction_speed of joint '{joint}': 0; expected a "
                             'positive number, rad/s or m/s')
        self._largest = per_joint(largest, 'largest', names, finite=False)
        self._memory = number(memory, 'memory', 'a positive time in s',
                              lambda x: x > 0.0)
        self.forget_motion()

    def torque(self, u: Array) -> Array:
        """Return the friction beyond the model's at the speeds u, (n,) N m or N."""
        return np.asarray(friction_beyond(u, *values_of(self)))

    def forget_motion(self) -> None:
        """Adapt to later samples only; the values stay."""
        # Low-passes of the shape of Coulomb friction and of the speed.
        self._shape = np.zeros(len(self._speed))
        self._rate = np.zeros(len(self._speed))

    def adapt(self, elapsed: float, forgotten: Array, u: Array, estimate: Array) -> None:
        """
        Follow the observer's estimate, (n,) N m or N, by one step of `elapsed` s.

        `forgotten` is the factor of the observer's low-pass over the step, (n,). The
        same low-pass is applied to the regressor, so that the lag at reversals causes no
        error.
        """
        if self._memory == np.inf:
            return
        shape = coulomb_shape(u, self._speed)
        self._shape = forgotten * self._shape + (1.0 - forgotten) * shape
        self._rate = forgotten * self._rate + (1.0 - forgotten) * u / UNIT_SPEED
        # Normalized least mean squares: steps along the regressor, relative to its
        # square.
        norm = self._shape**2 + self._rate**2 + LEAST_NORM
        # The estimate is external torque; friction opposes the motion, hence the sign.
        bounded = np.clip(estimate, -self._largest, self._largest)
        step = -elapsed / self._memory * bounded / norm
        self.coulomb = self.coulomb + step * self._shape
        self.damping = self.damping + step * self._rate / UNIT_SPEED


def values_of(error: FrictionError) -> tuple[Array, Array, Array, Array]:
    """Return coulomb, damping, offset and friction_speed, (n,) each."""
    return error.coulomb, error.damping, error.offset, error._speed


def friction_beyond(rate: Scalar, coulomb: Scalar, damping: Scalar, offset: Scalar,
                    speed: Scalar) -> Scalar:
    """Return the friction of `FrictionError` at a rate, over any scalar."""
    return offset + coulomb * coulomb_shape(rate, speed) + damping * rate


def checked_friction_error(error: FrictionError, names: Sequence[str]) -> FrictionError:
    """Return the friction of these joints; InputError for anything else."""
    checked: FrictionError = error
    instance(checked, FrictionError, 'friction_error')
    if checked.joint_names != tuple(names):
        raise InputError(f'friction_error: of {listing(checked.joint_names)}; expected '
                         f'{listing(names)}')
    return checked


def _signed(value: ArrayLike, what: str, names: Sequence[str]) -> Array:
    """Return one finite number, or one per joint, of either sign, as (n,)."""
    if np.ndim(value) == 0:
        value = np.full(len(names), value)
    return finite_row(value, what, names).copy()  # callers may change their array
