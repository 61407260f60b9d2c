"""The settings of the demo: the arm, its motion, gains, and the names of nodes."""

import math

from kane_dynamics._util.resources import resource_path
from kane_dynamics._util.typing import Array
from kane_dynamics.motion.motion import Motion
import numpy as np

URDF = resource_path('urdf', 'fr3.urdf')
JOINTS = tuple(f'fr3_joint{k}' for k in range(1, 8))
RATE = 500.0  # joint states, 1/s
STATE_TIMEOUT = 0.1  # s: largest age of the states that the node uses
NODE, PLANT = '/kane_dynamics', '/plant'
DURATION = 8.0  # duration of the motion, s
HOME = np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8])
AMPLITUDE = np.array([0.9, 0.45, 0.6, 0.5, 0.7, 0.6, 0.9])  # rad
CYCLES = np.array([2.0, 3.0, 2.5, 3.0, 4.0, 3.0, 5.0])  # oscillations of each joint in the motion
KP = np.array([150.0, 150.0, 120.0, 120.0, 40.0, 30.0, 15.0])  # N m/rad: a soft servo
KD = np.array([12.0, 12.0, 10.0, 10.0, 3.0, 2.5, 1.0])  # N m s/rad
GAINS = (KP, KD)


def desired_motion(points: int = 81) -> Motion:
    """Return a motion in which every joint oscillates about its home, from rest to rest."""
    t = np.linspace(0.0, DURATION, points)
    return Motion.from_points(t, [_wave(moment) for moment in t], joint_names=JOINTS)


def _wave(t: float) -> Array:
    envelope = math.sin(math.pi * t / DURATION) ** 2
    wave: Array = HOME + envelope * AMPLITUDE * np.sin(2.0 * math.pi * CYCLES * t / DURATION)
    return wave
