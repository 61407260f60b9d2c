"""
The friction law of a joint: viscous damping, smoothed Coulomb friction and an offset.

    torque(rate) = d rate + mu tanh(rate / u_s) + offset

with ``damping`` d, ``friction`` mu, ``friction_speed`` u_s and ``friction_offset`` of
`model.Joint`. This is the torque that overcomes friction; the dissipated power is
``torque(rate) rate``. All formulations of the dynamics, the integrators and
identification use the functions below; to change or to extend the law, edit them and the
fields of `model.Joint`.

All functions run over any scalar.
"""

from kane_dynamics._util.typing import Scalar
from kane_dynamics.model.model import Joint
import numpy as np


def coulomb(rate: Scalar, onset: Scalar) -> Scalar:
    """Return smoothed Coulomb friction of coefficient 1: tanh(rate / onset), -1 to 1."""
    return np.tanh(rate * (1.0 / onset))


def friction_torque(joint: Joint, rate: Scalar) -> Scalar:
    """Return the torque that overcomes a joint's friction at a rate, N m or N."""
    torque = joint.damping * rate
    if joint.friction:
        torque = torque + joint.friction * coulomb(rate, joint.friction_speed)
    return torque + joint.friction_offset


def friction_slope(joint: Joint, rate: Scalar) -> Scalar:
    """Return the derivative of `friction_torque` by the rate, N m s or N s/m."""
    slope: Scalar = joint.damping
    if joint.friction:
        # d tanh(x) / dx = 1 - tanh(x)^2
        y = coulomb(rate, joint.friction_speed)
        slope = slope + (joint.friction / joint.friction_speed) * (1.0 - y * y)
    return slope


def friction_over_rate(joint: Joint, rate: Scalar) -> Scalar:
    """
    Return friction without its offset divided by the rate, N m s or N s/m.

    For implicit integration. Coulomb friction over the rate is mu / sqrt(rate^2 +
    u_s^2), within 8 % of mu tanh(rate / u_s) / rate and regular at rest.
    """
    ratio: Scalar = joint.damping
    if joint.friction:
        ratio = ratio + joint.friction / np.sqrt(rate * rate + joint.friction_speed**2)
    return ratio
