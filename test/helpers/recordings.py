"""Recordings for tests: of real arms, where there are any, and of simulated ones."""

import os
from pathlib import Path
import warnings

from kane_dynamics import load_urdf, ModelWarning, Robot
from kane_dynamics.identification import Recording
import numpy as np
import pytest

DATA = Path(os.environ.get('KANE_DYNAMICS_RECORDINGS',
                           Path(__file__).resolve().parents[3] / 'shared' / 'data'))


def real(recording, urdf, n):
    """Return the paths of a recording and its URDF, and the first n joints; skip without."""
    paths = DATA / recording, DATA / urdf
    if not all(path.exists() for path in paths):
        pytest.skip(f'{DATA} holds no {recording}; KANE_DYNAMICS_RECORDINGS names the folder')
    return *paths, quiet(paths[1]).joint_names[:n]


def quiet(urdf, joints=None):
    """Return the model of a real URDF, which says much that nobody uses."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', ModelWarning)
        return load_urdf(urdf, joints=joints)


def exciting(n, seed, duration=20.0, rate=100.0, harmonics=5, speed=2.0):
    """Return t, q, u and udot of a random Fourier series with the given top speed."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 1.0 / rate)
    w = 2.0 * np.pi * 0.1 * np.arange(1, harmonics + 1)
    a, b = rng.normal(size=(2, harmonics, n))
    s, c = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    u = c @ a + s @ b
    k = speed / np.abs(u).max(axis=0)
    return t, (s / w @ a - c / w @ b) * k, u * k, ((-s * w) @ a + (c * w) @ b) * k


def simulated(model, seed, noise=0.0, **motion):
    """Return a recording of a model along a random motion, torques with white noise, N m."""
    t, q, u, udot = exciting(model.n, seed, **motion)
    tau = Robot(model).inverse_dynamics(q, u, udot)
    rng = np.random.default_rng(seed + 1)
    return Recording(t, q, u, udot, tau + noise * rng.normal(size=tau.shape))
