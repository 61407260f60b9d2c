"""What `doctor` finds without ROS: whether a URDF is one to command a real arm with."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from kane_dynamics.model import Array, Model
from kane_dynamics.robot import Robot
import numpy as np

POSTURES = 500  # at which the weight is compared with the efforts
Level = Literal['fine', 'doubt', 'problem']


@dataclass(frozen=True)
class Finding:
    """
    What was looked at, and what it means.

    Attributes
    ----------
    level : 'fine', 'doubt' or 'problem'
        Doubts may be meant; a problem makes torques wrong or unsafe.
    words : str

    """

    level: Level
    words: str


def examine_model(model: Model, robot: Robot, warnings: Sequence[str]) -> list[Finding]:
    """Return what is doubtful or wrong about a robot's description."""
    found = [Finding('doubt', f'URDF: {warning}') for warning in warnings]
    limits, names = robot.limits, model.joint_names
    for what, values, consequence in (
            ('effort limit', limits.effort, 'torques on them are bounded by nothing'),
            ('speed limit', limits.velocity, 'motions are not held against one')):
        without = [name for name, value in zip(names, values) if not np.isfinite(value)]
        if without:
            found.append(Finding('doubt', f'no {what}: {listed(without)}; {consequence}'))
    found += _weight(robot)
    joints = model.coordinate_joints
    for what, missing, consequence in (
            ('friction', [j.name for j in joints if not (j.damping or j.friction)],
             '`kane-dynamics identify` finds it from a recording'),
            ('rotor inertia (armature)', [j.name for j in joints if not j.armature],
             'behind a gear it can outweigh the link; say it in the supplement')):
        if missing:
            found.append(Finding('doubt', f'no {what} is known of {listed(missing)}: '
                                 f'{consequence}'))
    return found


def _weight(robot: Robot) -> list[Finding]:
    """Return whether the motors can hold the arm everywhere within its limits."""
    rng = np.random.default_rng(0)
    lower, upper = (np.clip(bound, -np.pi, np.pi)
                    for bound in (robot.limits.lower, robot.limits.upper))
    q = rng.uniform(lower, np.maximum(lower, upper), (POSTURES, robot.n))
    most = np.abs(robot.gravity_force(q)).max(axis=0)
    weak = [f"'{name}' (weight up to {weight:.3g}, effort {limit:.3g})"
            for name, weight, limit in zip(robot.joint_names, most, robot.limits.effort)
            if weight > limit]
    if weak:
        return [Finding('problem', f'the arm cannot hold itself in every posture: {listed(weak)} '
                        'N m or N')]
    if not most.any():
        return [Finding('doubt', 'gravity asks no torque of any joint: is the base mounted as '
                        'the URDF says, and gravity along its -z?')]
    return [Finding('fine', 'the efforts hold the arm in every posture within its limits')]


def examine_efforts(robot: Robot, q: Array, effort: Array) -> list[Finding]:
    """
    Return what measured efforts at rest say about sign and gravity.

    Parameters
    ----------
    robot : Robot
        Whose weight it is.
    q, effort : (n,) arrays
        At rest; rad or m, N m or N.

    """
    weight = robot.gravity_force(q)
    size = float(np.linalg.norm(weight))
    if size < 1e-9:
        return []
    share = float(effort @ weight) / size**2  # 1: just the weight
    if share > 0.7:
        return [Finding('fine', f'at rest the measured efforts hold {share:.0%} of the weight')]
    if share < -0.7:
        return [Finding('problem', 'at rest the measured efforts are the weight with the opposite '
                        'sign: efforts or joint axes are reversed, and torques would push the '
                        'wrong way')]
    return [Finding('doubt', f'at rest the measured efforts hold {share:.0%} of the weight: the '
                    'arm adds gravity itself (then compensate.gravity: false), or its efforts '
                    'leave it out')]


def listed(names: Iterable[str], most: int = 8) -> str:
    """Return names in one line, the first few of many."""
    every = list(names)
    more = f' and {len(every) - most} more' if len(every) > most else ''
    return ', '.join(every[:most]) + more


def print_findings(found: Sequence[Finding]) -> None:
    """Print findings, the worst first."""
    counts = []
    for level in ('problem', 'doubt', 'fine'):
        group = [finding for finding in found if finding.level == level]
        counts.append(len(group))
        for finding in group:
            print(f'{level:>8}: {finding.words}')
    print(f'\n{counts[0]} problems, {counts[1]} doubts, {counts[2]} fine')
