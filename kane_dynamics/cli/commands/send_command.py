"""The command `send`: a motion for the dynamics node, and how well the arm follows it."""

from argparse import Namespace
from typing import Any

from kane_dynamics._util.optional_imports import extra
from kane_dynamics._util.typing import Array
from kane_dynamics.cli.printing import print_json, print_table, warn
from kane_dynamics.cli.robot_options import load_robot
from kane_dynamics.cli.tables import read_motion
from kane_dynamics.errors import InputError
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
import numpy as np

FOLLOWED = 0.5  # of its travel: a joint with a larger error did not follow
ROUNDING = 1e-12  # rad or m
STILL = 1e-3  # rad or m: travel of a joint that rests, and the error with which it does


def send(options: Namespace) -> int:
    """Send a motion to a running node, print the errors; return 1 if the arm did not follow."""
    sender = extra('kane_dynamics.ros.common.motion_sender', 'ros', 'send')
    if not 0.0 < options.duration < np.inf:
        raise InputError(f'--duration: {options.duration}; expected a positive, finite '
                         'time in s')
    _, robot = load_robot(options)
    names = robot.actuated_names or robot.joint_names
    motion = None
    if options.motion is not None:
        motion = read_motion(options.motion, names)

    # There and back begins where the arm rests, which is known once its state came.
    def make(q: Array) -> Motion:
        if motion is not None:
            return motion
        travel = _travel(options.by, robot, names, q)
        return there_and_back(q, travel, options.duration, names)
    tracking = sender.send_motion(make, names, node_name=options.node,
                                  namespace=options.namespace)
    if options.json:
        print_json({'joint_names': list(names), 'travel': tracking.travel,
                    'largest_error': tracking.largest_error, 'states': tracking.states,
                    'warnings': list(tracking.warnings),
                    'commanders': list(tracking.commanders)})
    else:
        print_tracking(tracking)
    # A node may take a motion and the arm not move: its exit code tells a script.
    lost = did_not_follow(tracking.travel, tracking.largest_error)
    if not lost.any():
        return 0
    names_lost = ', '.join(np.array(names)[lost])
    reasons = '; '.join(tracking.warnings) or 'none'
    warn(f'the motion was not followed by {names_lost}; warnings of the node '
         f'meanwhile: {reasons}')
    return 1


def did_not_follow(travel: Array, largest_error: Array) -> Array:
    """Return which joints had too large errors for their travel; arguments in rad or m."""
    return np.asarray(largest_error > np.where(travel > STILL, FOLLOWED * travel, STILL))


def print_tracking(tracking: Any) -> None:
    """Print how far the arm was from the motion."""
    print(f'{tracking.states} joint states during the motion; rad or m')
    # The polynomial of a joint that rests is constant to rounding.
    travel = np.where(tracking.travel < ROUNDING, 0.0, tracking.travel)
    print_table(['joint', 'travel', 'largest error'],
                zip(tracking.joint_names, travel, tracking.largest_error, strict=True))
    holders = ', '.join(tracking.commanders) or "no node that commands on 'commands'"
    print(f'held by {holders}')
    if len(tracking.commanders) > 1:
        warn(f'commands: {len(tracking.commanders)} nodes command the arm; expected one '
             'dynamics node with its torque_guard')
    print(f'largest error: {1e3 * tracking.largest_error.max():.2g} mrad or mm')


def there_and_back(q: Array, travel: Array, duration: float,
                   names: tuple[str, ...]) -> Motion:
    """Return a motion from q by some travel and back, at rest at the start, turn and end."""
    still = np.zeros((3, len(q)))
    return Motion.from_points([0.0, 0.5 * duration, duration], [q, q + travel, q], still,
                              still, joint_names=names)


def _travel(by: list[float], robot: Robot, names: tuple[str, ...], q: Array) -> Array:
    """
    Return the travel of each joint from the measured positions, rad or m.

    One value for all joints is reduced to a quarter of a joint's range, and turned round
    where it would leave the limits.
    """
    sizes = np.array(by)
    if len(by) not in (1, len(names)) or not np.isfinite(sizes).all():
        raise InputError(f'--by: {by}; expected one finite number, or {len(names)} in '
                         f'the order {", ".join(names)}')
    if len(by) == len(names) > 1:
        return sizes
    places = list(map(robot.joint_names.index, names))
    lower, upper = robot.limits.lower[places], robot.limits.upper[places]
    travel = np.clip(sizes[0], -0.25 * (upper - lower), 0.25 * (upper - lower))
    leaves = (q + travel > upper) | (q + travel < lower)
    return np.asarray(np.where(leaves, -travel, travel))
