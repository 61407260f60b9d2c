"""Recordings for tests: of real arms, where there are any, and of simulated ones."""

import os
from pathlib import Path
import re
import warnings

from kane_dynamics import load_urdf, ModelWarning, Robot
from kane_dynamics.identification import Recording
import mujoco
import numpy as np

DATA = Path(os.environ.get('KANE_DYNAMICS_RECORDINGS',
                           Path(__file__).resolve().parents[3] / 'shared' / 'data'))


def present(recording, urdf):
    """Return whether a recording of a real arm and its URDF are there to test on."""
    return all((DATA / name).exists() for name in (recording, urdf))


def real(recording, urdf, n):
    """Return the paths of a recording and its URDF, and the first n joints."""
    return DATA / recording, DATA / urdf, quiet(DATA / urdf).joint_names[:n]


def from_mujoco(folder, urdf, losses, noise):
    """
    Write what an arm in MuJoCo is measured to do, in uneven steps; return the path.

    MuJoCo gives the rigid-body torques, which stand in columns of their own as a
    reference; the friction of each joint and the noise of its torque come on top.
    """
    text = re.sub(r'<(visual|collision)\b.*?</\1>', '', urdf.read_text(),
                  flags=re.DOTALL)
    arm = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(arm)
    rng = np.random.default_rng(5)
    every, *state = exciting(arm.nv, 5, duration=24.0, rate=500.0)
    indices = np.cumsum(rng.integers(1, 5, len(every)))  # 2 to 8 ms between rows
    indices = indices[indices < len(every)]
    q, u, udot = (part[indices] for part in state)
    rigid = np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:] = q[k]
        data.qvel[:] = u[k]
        data.qacc[:] = udot[k]
        mujoco.mj_inverse(arm, data)
        rigid[k] = data.qfrc_inverse
    damping, friction = losses
    tau = rigid + damping * u + friction * np.tanh(u / 0.05) + noise * rng.normal(
        size=q.shape)
    header = ['t', *(f'{word}{k + 1}'
                     for word in ('q', 'v', 'a', 'tau', f'tau_pin_{urdf.stem}_')
                     for k in range(arm.nv))]
    path = folder / 'from_mujoco.csv'
    np.savetxt(path, np.column_stack([every[indices], q, u, udot, tau, rigid]),
               delimiter=',', header=','.join(header), comments='', fmt='%.17g')
    return path


def quiet(urdf, joints=None):
    """Return the model of a real URDF, with many elements that we do not use."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', ModelWarning)
        return load_urdf(urdf, joints=joints)


def exciting(n, seed, duration=20.0, rate=100.0, harmonics=5, speed=2.0):
    """Return t, q, u and udot of a random Fourier series with the given top speed."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, duration, 1.0 / rate)
    w = 2.0 * np.pi * 0.1 * np.arange(1, harmonics + 1)
    a, b = rng.normal(size=(2, harmonics, n))
    s = np.sin(np.outer(t, w))
    c = np.cos(np.outer(t, w))
    u = c @ a + s @ b
    k = speed / np.abs(u).max(axis=0)
    return t, (s / w @ a - c / w @ b) * k, u * k, ((-s * w) @ a + (c * w) @ b) * k


def simulated(model, seed, noise=0.0, **motion):
    """Return a recording along a random motion, torques with white noise, N m."""
    t, q, u, udot = exciting(model.n, seed, **motion)
    tau = Robot(model).inverse_dynamics(q, u, udot)
    rng = np.random.default_rng(seed + 1)
    return Recording(t, q, u, udot, tau + noise * rng.normal(size=tau.shape))
