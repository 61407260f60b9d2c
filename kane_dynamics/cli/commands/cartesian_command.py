"""The command `cartesian`: a motion in which a frame follows lines and arcs."""

from argparse import Namespace

from kane_dynamics._util.typing import Array
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.cli.printing import print_json
from kane_dynamics.cli.robot_options import load_robot, positions
from kane_dynamics.cli.tables import MOST_SAMPLES, write_states
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics import pose_from
from kane_dynamics.kinematics.cartesian_motion import cartesian_motion
from kane_dynamics.kinematics.pose_motion import PoseLimits
from kane_dynamics.kinematics.pose_path import PosePath
from kane_dynamics.motion.motion import Motion
import numpy as np


def cartesian(options: Namespace) -> None:
    """Write the motion of the joints in which a frame follows a path."""
    _, robot = load_robot(options)
    robot.model.frame(options.frame)  # an unknown frame is an error before any message
    if not 0.0 < options.rate < np.inf:
        raise InputError(f'--rate: {options.rate}; expected a positive, finite number of '
                         'Hz')
    q = positions(options, 'q', robot)
    path = _path(options, robot.frame_pose(options.frame, q))
    # A stated duration replaces the limits of the frame.
    limits = None
    if options.duration is None:
        limits = PoseLimits(options.linear, options.angular)
    result = cartesian_motion(robot, options.frame, q, path, limits,
                              duration=options.duration, tolerance=options.tolerance)
    files = []
    if options.out:
        _write(result.motion, options.out, options.rate)
        files.append(options.out)
    # The same facts as data, or in words.
    if options.json:
        print_json({
            'joint_names': list(result.motion.joint_names),
            'duration': result.motion.duration, 'end': result.motion.positions[-1],
            'distance': result.distance, 'angle': result.angle,
            'largest_speed': result.largest_speed,
            'smallest_singular_value': result.smallest_singular_value,
            'nearest_singular': result.nearest_singular,
            'corners': [corner._asdict() for corner in path.corners], 'files': files})
        return
    # How well the joints' motion follows the path, then where it is near its limits.
    print(f'{result.motion.duration:.4g} s; distance from the path at most '
          f'{1e3 * result.distance:.2g} mm and {1e3 * result.angle:.2g} mrad')
    print(f'largest joint speed: {100.0 * result.largest_speed:.3g} % of its limit')
    print(f'smallest singular value of the Jacobian: {result.smallest_singular_value:.3g} '
          f'at {result.nearest_singular:.4g} s')
    for corner in path.corners:
        passed = (f'passes within {1e3 * corner.distance:.3g} mm and '
                  f'{1e3 * corner.angle:.3g} mrad')
        if corner.rests:
            passed = 'rests'
        print(f'corner at {100.0 * corner.place:.3g} % of the path: {passed}')
    for file in files:
        print(f'wrote {file}')


def _path(options: Namespace, start: Array) -> PosePath:
    """Return the path of --to and --via from a pose."""
    parts: list[PosePath] = []
    via: list[float] | None = None
    # Pairs of --via and --to, in the order of the command line.
    last = start
    for option, *numbers in options.stations or []:
        sizes = (3,) if option == '--via' else (3, 6)
        if len(numbers) not in sizes:
            expected = ' or '.join(str(size) for size in sizes)
            raise InputError(f'{option}: {len(numbers)} numbers; expected {expected}')
        if option == '--via':
            if via is not None:
                raise InputError('--via: two in a row; expected --to after each')
            via = numbers
            continue
        # A piece ends at each pose: straight, or an arc if --via came before.
        pose = _pose(numbers, last)
        ends = np.array([last, pose])
        if options.free:
            ends = ends[:, :3, 3]
        if via is None:
            parts.append(PosePath.through(ends))
        else:
            parts.append(PosePath.arc(ends[0], via, ends[1]))
        last = pose
        via = None
    if via is not None or not parts:
        raise InputError('--to: missing; expected a position or pose at the end of the '
                         'path')
    return PosePath.joined(parts, blend=options.blend, blend_angle=options.blend_angle)


def _pose(numbers: list[float], last: Array) -> Array:
    """Return the pose of a position, with the orientation before unless it is stated."""
    if len(numbers) == 6:
        return pose_from(numbers[:3], rpy=numbers[3:])
    pose = last.copy()
    pose[:3, 3] = numbers
    return pose


def _write(motion: Motion, path: str, rate: float) -> None:
    """Write a motion as a table of states, with its end as the last row."""
    count = int(np.ceil(motion.duration * rate)) + 1
    if count > MOST_SAMPLES:
        raise InputError(f'--rate: {rate:g} Hz gives {count} rows; expected at most '
                         f'{MOST_SAMPLES}')
    t = np.linspace(0.0, motion.duration, count)
    states = dict(zip(('q', 'u', 'udot'), motion.sample(t), strict=True))
    with whole_file(path) as stream:
        write_states(stream, t, states, motion.joint_names)
