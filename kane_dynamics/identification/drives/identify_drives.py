"""Identify the drives of elastic joints: the entry, what it refuses, and its result."""

from __future__ import annotations

from dataclasses import dataclass, replace

from kane_dynamics._util.attribute_hints import hinting
from kane_dynamics._util.checks import instance, number
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.drives.drive_recording import DriveRecording, joint_count
from kane_dynamics.identification.drives.gear_fit import (fitted, GearEquations, GearFit,
                                                          JointSignals, LinkTorque)
from kane_dynamics.identification.drives.spectra import (audible_band, Spectra, spectra,
                                                         white_noise)
from kane_dynamics.identification.solvers import on_one_processor, scientific
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
import numpy as np

TOLD = 0.25  # largest relative standard deviation of a number that the data tell
SKEW_TOLD = 1e-3  # s, of the skew
FILTER_ORDER = 8  # of the Butterworth filter, forward and backward
BEYOND_BAND = 2.0  # its cutoff over the end of the band: the band passes unchanged
SAMPLES = 200  # configurations for the mean of the mass matrix


@hinting
@dataclass(frozen=True, eq=False)
class DriveIdentification:
    """Result."""

    joint_names: tuple[str, ...]
    stiffness: Array
    damping: Array
    rotor_inertia: Array
    skew: Array
    deviations: dict[str, Array]
    misfit: Array
    fits: tuple[GearFit, ...]


@hinting
@on_one_processor
def identify_drives(model: Model, recording: DriveRecording, *,
                    skew: float | None = None) -> DriveIdentification:
    """Identify."""
    even = recording.resampled()
    step = float(np.diff(even.t).mean())
    of, signals = joint_signals(model, even, step)
    fits = tuple(fitted(GearEquations(signal, of, skew)) for signal in signals)
    return fits


def joint_signals(model: Model, recording: DriveRecording, step: float
                  ) -> tuple[Spectra, list[JointSignals]]:
    """Return the spectra, and what was measured of each joint."""
    noise = {name: white_noise(getattr(recording, name), step) for name in recording.signals}
    assert recording.q is not None
    deflection = recording.theta - recording.q
    highest = audible_band(deflection, np.hypot(noise['theta'], noise['q']), step)
    print('band', highest, noise)
    of = spectra(len(recording), step, highest)
    q, u, udot = smooth_motion(recording.q, step, BEYOND_BAND * highest)
    _, speed, _ = smooth_motion(recording.theta, step, BEYOND_BAND * highest)
    torques = inertia = None
    if recording.gear_torque is None:
        bare = without_drives(model)
        robot = Robot(bare, friction=False)
        torques = robot.inverse_dynamics(q, u, udot)
        some = q[np.linspace(0, len(q) - 1, SAMPLES).astype(int)]
        inertia = np.sqrt(np.mean(robot.mass_matrix(some)**2, axis=0))
    signals = []
    for j in range(model.n):
        of_joint = {name: float(deviation[j]) for name, deviation in noise.items()}
        link = None
        if torques is not None:
            link = LinkTorque(torques[:, j], inertia[j])
        signals.append(JointSignals(
            recording.t, recording.theta[:, j], recording.q[:, j], speed[:, j], u[:, j], link,
            None if recording.gear_torque is None else recording.gear_torque[:, j],
            None if recording.motor_torque is None else recording.motor_torque[:, j],
            of_joint, 2*np.pi*BEYOND_BAND*highest, j, noise['q']))
    return of, signals


def without_drives(model: Model) -> Model:
    """Return the links alone: without rotors."""
    bodies = [replace(body, joint=replace(body.joint, armature=0.0)) for body in model.bodies]
    return replace(model, bodies=tuple(bodies))


def smooth_motion(q: Array, step: float, cutoff: float) -> tuple[Array, Array, Array]:
    """Return positions below a frequency, Hz, with speeds and accelerations, (N, n) each."""
    signal = scientific('scipy.signal')
    sections = signal.butter(FILTER_ORDER, cutoff, output='sos', fs=1.0 / step)
    smooth = signal.sosfiltfilt(sections, q, axis=0)
    spline = scientific('scipy.interpolate').make_interp_spline(
        step * np.arange(len(q)), smooth, k=5)
    t = step * np.arange(len(q))
    return smooth, spline(t, nu=1), spline(t, nu=2)
