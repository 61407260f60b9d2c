"""The settings of the demo: the arm, its motion and gains, names of nodes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from kane_dynamics._util.resources import resource_path
from kane_dynamics._util.typing import Array
from kane_dynamics.motion.motion import Motion
import numpy as np

RATE = 500.0  # joint states, 1/s
STATE_TIMEOUT = 0.1  # s: largest age of the states that the node uses
NODE, PLANT = '/kane_dynamics', '/plant'
DURATION = 8.0  # duration of the motion, s
POINTS = 10.0  # of the motion, per second


@dataclass(frozen=True, eq=False)
class DemoRobot:
    """
    A robot of the demo: its files, its motion and its servo.

    Attributes
    ----------
    title : str
        Of the picture.
    urdf : Path
    joints : tuple of n str
        The joints with motors, in the order of the node's commands.
    home, amplitude, frequency : (n,) arrays
        Each joint oscillates about its home, rad, by its amplitude, rad, with its
        frequency, Hz.
    kp, kd : (n,) arrays
        Gains of a soft servo, N m/rad and N m s/rad.
    constraints : Path, optional
        Constraints file of a robot with closed loops. Then only `joints` are measured.
    passive : mapping of str to float
        The other joints of closed loops, and their positions at home, rad.

    """

    title: str
    urdf: Path
    joints: tuple[str, ...]
    home: Array
    amplitude: Array
    frequency: Array
    kp: Array
    kd: Array
    constraints: Path | None = None
    passive: Mapping[str, float] = field(default_factory=dict)

    def motion(self, duration: float = DURATION) -> Motion:
        """Return a motion of every joint about home, from rest to rest."""
        t = np.linspace(0.0, duration, round(POINTS * duration) + 1)
        envelope = np.sin(np.pi * t / duration)[:, None] ** 2
        wave = np.sin(2.0 * np.pi * np.multiply.outer(t, self.frequency))
        return Motion.from_points(t, self.home + envelope * self.amplitude * wave,
                                  joint_names=self.joints)

    @property
    def positions(self) -> dict[str, float]:
        """Return the positions of all joints at home, rad."""
        return dict(zip(self.joints, self.home.tolist())) | dict(self.passive)

    @property
    def parameters(self) -> dict[str, str]:
        """Return the parameters that describe the robot to the node."""
        # MuJoCo adds nothing
        common = {'urdf': str(self.urdf), 'arm_compensates': 'none'}
        if self.constraints is None:
            return common | {'joints': f'[{",".join(self.joints)}]'}
        return common | {'constraints': str(self.constraints)}


_FR3_JOINTS = tuple(f'fr3_joint{k}' for k in range(1, 8))
FR3 = DemoRobot(
    title='A seven-axis arm in MuJoCo',
    urdf=resource_path('urdf', 'fr3.urdf'),
    joints=_FR3_JOINTS,
    home=np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8]),
    amplitude=np.array([0.9, 0.45, 0.6, 0.5, 0.7, 0.6, 0.9]),
    frequency=np.array([2.0, 3.0, 2.5, 3.0, 4.0, 3.0, 5.0]) / 8.0,
    kp=np.array([150.0, 150.0, 120.0, 120.0, 40.0, 30.0, 15.0]),
    kd=np.array([12.0, 12.0, 10.0, 10.0, 3.0, 2.5, 1.0]))
