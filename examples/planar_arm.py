"""Velocities of a planar arm from link to link, and its Jacobian."""

from kane_dynamics import ModelBuilder, Robot, rod
import numpy as np

l1 = 0.5
l2 = 0.4
b = ModelBuilder('planar arm')
b.body('link1', 'world', 'revolute', inertial=rod(3.0, (0, 0, 0), (l1, 0, 0)))
b.body('link2', 'link1', 'revolute', at=(l1, 0, 0),
       inertial=rod(2.4, (0, 0, 0), (l2, 0, 0)))
b.frame('tip', 'link2', at=(l2, 0, 0))

robot = Robot(b.model())
q = np.array([0.3, 0.7])
u = np.array([1.0, -0.5])
for frame in ('link1', 'link2', 'tip'):
    R = robot.frame_pose(frame, q)[:3, :3]
    v, omega = robot.frame_velocity(frame, q, u).reshape(2, 3) @ R
    print(f'{frame}: v = {v.round(6).tolist()}, omega = {omega.round(6).tolist()} in '
          'its own axes')
print('Jacobian of the tip, base axes:', robot.jacobian('tip', q)[:2].round(6).tolist())
