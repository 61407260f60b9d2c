"""The report of mode cartesian: deflection against the stiffness, recovery, and a plot."""

from dataclasses import dataclass
from pathlib import Path

from kane_dynamics._util.typing import Array
from kane_dynamics.demo.demo_settings import DemoRobot, STIFFNESS
from kane_dynamics.demo.recorded_arm import closed_along, loaded_arm, SavedRecord
from kane_dynamics.plot.deflection_plot import plot_deflection
import numpy as np

MAX_DEVIATION = 0.10  # of the deflection from that of the stiffness, relative
MAX_REMAINING = 1e-3  # m, from the place before the force
SETTLED = 0.2  # s at the end of a force and of a rest, over which places are averaged


@dataclass(frozen=True, eq=False)
class DeflectionLog(SavedRecord):
    """
    A record of the pushed arm.

    Attributes
    ----------
    t : (K,) array
        s.
    q, command : (K, n) arrays
        Positions of the joints, and torques of the node.
    wrench : (K, 6) array
        Acts on the arm at the pushed frame, N and N m in world axes.

    """

    t: Array
    q: Array
    command: Array
    wrench: Array

    def forces(self) -> list[tuple[int, int]]:
        """Return the first and the last row of each force."""
        is_pushed = self.wrench.any(axis=1).astype(int)
        edges = np.diff(is_pushed, prepend=0, append=0)
        firsts = np.flatnonzero(edges > 0).tolist()
        lasts = np.flatnonzero(edges < 0).tolist()
        return list(zip(firsts, lasts, strict=True))


def frame_origins(robot: DemoRobot, q: Array) -> Array:
    """Return the origin of the pushed frame at positions of the joints (K, n), (K, 3)."""
    arm = loaded_arm(robot)
    coordinates = closed_along(arm, robot.joints, q)
    return arm.frame_pose(robot.frame, coordinates)[:, :3, 3]


def report_deflections(robot: DemoRobot, run: DeflectionLog, folder: Path) -> int:
    """Print the results, and return 0 if the arm yields and returns as stated, else 1."""
    place = frame_origins(robot, run.q)
    rate = 1.0 / float(np.median(np.diff(run.t)))
    count = max(1, round(SETTLED * rate))
    print('\nForces against a stiffness of '
          f'{STIFFNESS[0]:g} N/m (expected: force / stiffness)\n'
          f'{"force [N]":>20}{"deflection":>14}{"expected":>12}{"after":>12}')
    fine = True
    forces = run.forces()
    # The arm recovers from a force until the next one begins.
    ends = [first for first, _ in forces[1:]] + [len(run.t)]
    for (first, last), end in zip(forces, ends, strict=True):
        force = run.wrench[first, :3]
        # Means over the end of each phase, when the arm rests.
        at_rest = place[first - count:first].mean(axis=0)
        pushed = place[last - count:last].mean(axis=0)
        recovered = place[end - count:end].mean(axis=0)
        magnitude = float(np.linalg.norm(force))
        # The deflection along the force.
        deflection = float((pushed - at_rest) @ force) / magnitude
        expected = magnitude / STIFFNESS[0]
        remaining = float(np.linalg.norm(recovered - at_rest))
        text = ' '.join(f'{x:g}' for x in force)
        print(f'{text:>20}{1e3 * deflection:11.2f} mm{1e3 * expected:9.2f} mm'
              f'{1e3 * remaining:9.3f} mm')
        fine &= abs(deflection - expected) <= MAX_DEVIATION * expected
        fine &= remaining <= MAX_REMAINING
    picture = folder / 'demo_cartesian.png'
    # Zero is where the arm rests before the first force, not where the servo left it.
    first = forces[0][0]
    start = place[first - count:first].mean(axis=0)
    plot_deflection(run.t, place - start, run.wrench[:, :3], STIFFNESS[:3], picture,
                    torques=run.command, joint_names=robot.joints,
                    title=f'{robot.title}, pushed, in mode cartesian_impedance')
    print(f'\nPicture: {picture}')
    if fine:
        return 0
    print(f'\nExpected each deflection within {MAX_DEVIATION:.0%} of the stiffness, and '
          f'a return within {1e3 * MAX_REMAINING:g} mm.')
    return 1
