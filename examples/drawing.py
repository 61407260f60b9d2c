"""A UR10e draws a rounded frame and a circle: paths of poses and fastest timing."""

from pathlib import Path

from kane_dynamics import (cartesian_motion, inverse_kinematics, load_urdf, pose_from,
                           PoseLimits, PosePath, Robot)
from kane_dynamics.feasibility import time_optimal
import numpy as np

robot = Robot(load_urdf(Path(__file__).parents[1] / 'urdf' / 'ur10e.urdf'))
limits = PoseLimits(linear=(0.5, 2.0, 20.0), angular=(2.0, 8.0, 80.0))


def above(x, y, height=0.2):
    """Return the pose of a pen that points down."""
    return pose_from((x, y, height), rpy=(np.pi, 0.0, 0.0))


# A frame with rounded corners, from the middle of one side.
corners = [(0.5, 0.0), (0.5, 0.2), (0.8, 0.2), (0.8, -0.2), (0.5, -0.2), (0.5, 0.0)]
rounded = PosePath.through([above(x, y) for x, y in corners], blend=0.01)
inside = PosePath.through([above(0.5, 0.0), above(0.55, 0.0)])
circle = PosePath.circle(above(0.55, 0.0), (0.65, 0.0, 0.2), (0.0, 0.0, 1.0))
path = PosePath.joined([rounded, inside, circle], blend=0.01)

start = inverse_kinematics(robot, 'tool0', above(0.5, 0.0),
                           [0.0, -1.6, 2.1, -2.1, -1.57, 0.0])
drawing = cartesian_motion(robot, 'tool0', start.q, path, limits)
for corner in path.corners:
    print(f'corner at {corner.place:.2f} of the path: within '
          f'{1e3 * corner.distance:.1f} mm')
print(f'within the limits of the tool: {drawing.motion.duration:.2f} s')

timing = time_optimal(robot, drawing.motion)
q = timing.motion.positions_at(np.linspace(0.0, timing.duration, 2000))
heights = robot.frame_pose('tool0', q)[:, 2, 3]
print(f'within the limits of the motors: {timing.duration:.2f} s')
print(f'the pen stays on the paper: {np.abs(heights - 0.2).max() < 1e-5}')
