"""Variations in rotating frames: identities against automatic differentiation."""

from hyperdual import HyperDual, joined, Parts, parts, seeded
from kane_dynamics.mechanics.energy_form.variation_rules import (absolute,
                                                                 angular_velocity_variation,
                                                                 relative,
                                                                 rotation_change)
import numpy as np
import pytest

FRAMES = 'NAB'
SEEDS = range(3)


class Varied:
    """
    A random motion and its variation: functions of a time s and a parameter e.

    A hyper-dual's gradient is the derivative by e, its rate that by s.
    """

    def __init__(self, seed):
        """Create frames A and B rotating in N, and a varying vector and dyadic."""
        self._rng = np.random.default_rng(seed)
        e = seeded([0.0], [0.0], 0, 1)[0]
        s = HyperDual(0.0, np.zeros(1), 1.0, np.zeros(1))
        self._terms = np.array([1.0, s, e, s * e], dtype=object)
        A = self._rotation()
        self.axes = {'N': np.eye(3), 'A': A, 'B': A @ self._rotation()}
        self.vector, self.dyadic = self._free((3,)), self._free((3, 3))

    def _free(self, shape):
        return self._rng.normal(size=(*shape, 4)) @ self._terms

    def _rotation(self):
        result = np.linalg.qr(self._rng.normal(size=(3, 3)))[0]
        for k, angle in enumerate(self._free((3,))):
            i = (k + 1) % 3
            j = (k + 2) % 3
            turn = np.eye(3).astype(object)
            turn[i, i] = turn[j, j] = np.cos(angle)
            turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
            result = result @ turn
        return result

    def seen_from(self, frame, quantity, derivative):
        """Return the derivative of components along a frame's axes, along N's axes."""
        R = self.axes[frame]
        components = R.T @ quantity if quantity.ndim == 1 else R.T @ quantity @ R
        change = derivative(components)
        return R @ change if quantity.ndim == 1 else R @ change @ R.T

    def turn(self, frame, into, derivative):
        """Return the derivative of a rotation, of a frame in another, as a vector."""
        R = self.axes[frame]
        R_into = self.axes[into]
        relative_axes = R_into.T @ R
        spin = R_into @ derivative(relative_axes) @ relative_axes.T @ R_into.T
        return np.array([spin[2, 1], spin[0, 2], spin[1, 0]])


def varied(x):
    """Return derivatives by e, with their derivatives by s."""
    p = parts(x, 1)
    return joined(Parts(p.gradient[..., 0], np.nan * p.gradient, p.gradient_rate[..., 0],
                        np.nan * p.gradient))


def timed(x):
    """Return derivatives by s, with their derivatives by e."""
    p = parts(x, 1)
    return joined(Parts(p.rate, p.gradient_rate, np.nan * p.rate, np.nan * p.gradient))


def close(a, b):
    """Assert that two arrays of scalars agree."""
    a, b = (np.array([getattr(x, 'value', x) for x in np.ravel(y)], dtype=float)
            for y in (a, b))
    np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-12 * (1.0 + np.abs(b).max()))


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('derivative', [varied, timed])
def test_absolute_change_is_relative_change_plus_rotation_of_the_frame(derivative, seed):
    motion = Varied(seed)
    for quantity in (motion.vector, motion.dyadic):
        for one in FRAMES:
            for frame in FRAMES:
                turn = motion.turn(frame, one, derivative)
                in_one = motion.seen_from(one, quantity, derivative)
                in_other = motion.seen_from(frame, quantity, derivative)
                close(absolute(in_other, turn, quantity), in_one)
                close(relative(in_one, turn, quantity), in_other)


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('derivative', [varied, timed])
def test_rotations_of_frames_add_up(derivative, seed):
    motion = Varied(seed)
    close(motion.turn('B', 'N', derivative),
          motion.turn('B', 'A', derivative) + motion.turn('A', 'N', derivative))


@pytest.mark.parametrize('seed', SEEDS)
def test_variation_of_angular_velocity_follows_from_possible_rotations(seed):
    motion = Varied(seed)
    for body, frame in (('A', 'N'), ('B', 'N'), ('B', 'A')):
        theta = motion.turn(body, frame, varied)
        omega = motion.turn(body, frame, timed)
        theta_rate = motion.seen_from(frame, theta, timed)
        omega_variation = motion.seen_from(frame, omega, varied)
        close(angular_velocity_variation(theta_rate, theta, omega), omega_variation)
        # The variation of omega seen in the body is the rate of theta seen in the other
        # frame.
        close(motion.seen_from(body, omega, varied), theta_rate)


@pytest.mark.parametrize('seed', SEEDS)
def test_variation_and_time_derivative_commute_in_one_frame_and_differ_by_turning_in_two(
        seed):
    motion = Varied(seed)
    for quantity in (motion.vector, motion.dyadic):
        def rate_varied(timed_in, varied_in, quantity=quantity):
            return motion.seen_from(varied_in,
                                    motion.seen_from(timed_in, quantity, timed), varied)

        def variation_timed(timed_in, varied_in, quantity=quantity):
            return motion.seen_from(timed_in,
                                    motion.seen_from(varied_in, quantity, varied), timed)
        for frame in FRAMES:
            close(rate_varied(frame, frame), variation_timed(frame, frame))
        theta = motion.turn('B', 'A', varied)
        theta_rate = motion.seen_from('B', theta, timed)
        close(rate_varied('B', 'A'),
              variation_timed('B', 'A') - rotation_change(theta_rate, quantity))


@pytest.mark.parametrize('seed', SEEDS)
def test_a_scalar_made_of_vectors_and_dyadics_varies_alike_in_all_frames(seed):
    motion = Varied(seed)
    V = motion.vector
    D = motion.dyadic
    changes = []
    for frame in FRAMES:
        dV = motion.seen_from(frame, V, varied)
        dD = motion.seen_from(frame, D, varied)
        changes.append(dV @ D @ V + V @ dD @ V + V @ D @ dV)
    close(np.array(changes), varied(np.array([V @ D @ V])).repeat(3))
