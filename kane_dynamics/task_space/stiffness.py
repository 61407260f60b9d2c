"""Stiffness and damping matrices of a task, checked; the spring between two poses."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

from kane_dynamics._util.text import SHORT
from kane_dynamics._util.typing import Array, Matrix, Scalar
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.lane_products import product
from kane_dynamics.mechanics.algebra.lanes import Lanes
from kane_dynamics.task_space.orientation_error import pose_difference
import numpy as np
from numpy.typing import ArrayLike

ROUNDING = 1e-12  # relative: asymmetry and negative eigenvalues of a stiffness
AMPLIFIED = 0.5 * math.pi  # largest moment of a spring of unequal stiffness over K phi
LARGEST = 1e100  # of a matrix: larger entries overflow in its eigenvalues


def checked_matrix(value: ArrayLike, what: str) -> Array:
    """
    Return a symmetric, positive semidefinite (6, 6) matrix from its diagonal or itself.

    Raises
    ------
    InputError
        The shape is neither (6,) nor (6, 6), or the matrix is neither finite, symmetric
        nor positive semidefinite.

    """
    try:
        numbers = np.array(value)
        if numbers.dtype.kind not in 'iuf':
            raise ValueError
        array = numbers.astype(np.float64)
    except (TypeError, ValueError):
        raise InputError(f'{what}: {SHORT.repr(value)}; expected numbers of shape (6,) or '
                         '(6, 6)') from None
    # Numbers of a usable size and range.
    if array.shape not in ((6,), (6, 6)):
        raise InputError(f'{what}: shape {array.shape}; expected (6,) or (6, 6), linear '
                         'then angular')
    if not np.isfinite(array).all():
        raise InputError(f'{what}: {SHORT.repr(array.tolist())}; expected finite numbers')
    largest = float(np.abs(array).max())
    if largest > LARGEST:
        raise InputError(f'{what}: {largest:g}; expected numbers up to {LARGEST:g}')

    # The diagonal, or the whole matrix, symmetric to rounding.
    if array.ndim == 1:
        array = np.diag(array)
    if np.abs(array - array.T).max() > ROUNDING * largest:
        raise InputError(f'{what}: not symmetric; expected a symmetric matrix')
    array = 0.5 * (array + array.T)
    # Semidefinite, so that the spring stores no negative energy.
    least = float(np.linalg.eigvalsh(array).min())
    if least < -ROUNDING * largest:
        raise InputError(f'{what}: an eigenvalue of {least:g}; expected none below 0')
    return array


def factor(K: Array) -> Array:
    """Return an upper triangular F with K = F^T F, of a positive semidefinite K."""
    values, vectors = np.linalg.eigh(K)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    result: Array = np.linalg.qr(root)[1]
    return result


def stored_energy_limits(K: Array, force_limit: float, moment_limit: float) -> Array:
    """
    Return the energies, J, above which force and moment of a spring stop growing, (2,).

    Raises
    ------
    InputError
        A limit is given for a stiffness that couples translation and rotation.

    """
    limits = np.full(2, np.inf)
    parts = ((K[:3, :3], force_limit), (K[3:, 3:], moment_limit))
    for k, (part, limit) in enumerate(parts):
        stiffest = float(np.linalg.eigvalsh(part).max())
        if math.isinf(limit) or stiffest <= 0.0:
            continue
        if np.abs(K[:3, 3:]).max() > ROUNDING * np.abs(K).max():
            raise InputError('force_limit, moment_limit: finite, with a stiffness that '
                             'couples translation and rotation; expected inf, or a '
                             'stiffness without coupling')
        # The largest |K e| at an energy V is sqrt(2 stiffest V).
        equal = np.abs(part - stiffest * np.eye(3)).max() <= ROUNDING * stiffest
        if k == 1 and not equal:
            limit = limit / AMPLIFIED
        limits[k] = limit * (limit / (2.0 * stiffest))
    return limits


class Spring:
    """
    The spring between a frame and its target, over any scalar.

    Its energy is V = 1/2 e^T K e with e the displacement and the orientation error, in
    the axes of the task; the part of V that couples the two fades towards half a turn.
    With limits, V grows as the square root beyond `bounds`, so that force and moment stay
    bounded in their directions and have an energy.

    Parameters
    ----------
    pose, target : (4, 4) arrays
    axes : (3, 3) array
        Columns are the axes of the task in the world.
    settings : mapping
        `stiffness` (6, 6) and `bounds` (2,), J.
    lanes : class or object
        The functions of `Lanes`.

    Attributes
    ----------
    error : (6,) array
        Displacement from the target, m, and orientation error, rad, in the axes.
    wrench : (6,) array
        The pull on the frame, in the axes: minus the gradient of the energy.
    saturation : (2,) array
        Factors of force and moment by the limits, 1 without.

    """

    def __init__(self, pose: Matrix, target: Matrix, axes: Matrix,
                 settings: Mapping[str, Any], lanes: Any = Lanes) -> None:
        displacement, orientation = pose_difference(pose, target, axes)
        self.error = np.concatenate([displacement, orientation.vector])
        # K e, by displacement and by rotation; the coupling fades towards half a turn.
        K = settings['stiffness']
        by_displacement = product(displacement, K[:3], lanes)
        by_rotation = product(orientation.vector, K[3:], lanes)
        fading = orientation.coupling
        pull = by_displacement[:3] + fading * by_rotation[:3]
        turn = by_rotation[3:] + fading * by_displacement[3:]
        coupled_energy = by_displacement[3:] @ orientation.vector

        # Twice the energies of translation and rotation decide on the saturation.
        force_scale = _saturation(0.5 * (displacement @ pull), settings['bounds'][0])
        moment_scale = _saturation(0.5 * (orientation.vector @ turn),
                                   settings['bounds'][1])
        self.saturation = np.array([force_scale, moment_scale])
        slope = orientation.coupling_slope * coupled_energy
        moment = orientation.moment(turn) + slope * orientation.unit
        self.wrench = -np.concatenate([force_scale * pull, moment_scale * moment])


def _saturation(energy: Scalar, bound: Scalar) -> Scalar:
    """Return sqrt(bound / energy) where the energy is above the bound, else 1."""
    is_large = bound < energy
    return select(is_large, np.sqrt(bound / select(is_large, energy, 1.0)), 1.0)


def stored_energy(pose: Array, target: Array, axes: Array, K: Array,
                  bounds: Array) -> float:
    """Return the energy stored in a `Spring`, J; of floats only."""
    displacement, orientation = pose_difference(pose, target, axes)
    e = np.concatenate([displacement, np.array(orientation.vector, dtype=np.float64)])
    energy = float(orientation.coupling * (e[:3] @ K[:3, 3:] @ e[3:]))
    # Beyond its bound the energy of a part grows as its square root.
    for part, bound in ((slice(0, 3), bounds[0]), (slice(3, 6), bounds[1])):
        V = 0.5 * float(e[part] @ K[part, part] @ e[part])
        if bound < V:
            V = 2.0 * math.sqrt(bound * V) - bound
        energy += V
    return energy
