"""The Whipple bicycle of the 2007 benchmark: z up, y left, origin below the rear hub."""

from kane_dynamics import Inertial, linearized, ModelBuilder, Robot, Rolling
import numpy as np

y = (0, 1, 0)
tilt = np.pi / 10
b = ModelBuilder('bicycle')
b.body('frame', 'world', 'floating', turns='zxy', inertial=Inertial(
    85, (0.3, 0, 0.9), [[9.2, 0, -2.4], [0, 11, 0], [-2.4, 0, 2.8]]))
b.body('rear', 'frame', axis=y, at=(0, 0, 0.3),
       inertial=Inertial(2, inertia=np.diag([0.0603, 0.12, 0.0603])))
b.body('fork', 'frame', joint='steer', axis=(-np.sin(tilt), 0, np.cos(tilt)),
       at=(1.1, 0, 0),
       inertial=Inertial(4, (-0.2, 0, 0.7), [[0.05892, 0, 0.00756], [0, 0.06, 0],
                                             [0.00756, 0, 0.00708]]))
b.body('front', 'fork', axis=y, at=(-0.08, 0, 0.35),
       inertial=Inertial(3, inertia=np.diag([0.1405, 0.28, 0.1405])))
model = b.model()
free = ['frame/rx', 'rear', 'steer']
wheels = [Rolling('rear', 0.3, axis=y), Rolling('front', 0.35, axis=y)]

if __name__ == '__main__':
    bicycle = Robot(model, constraints=wheels, independent=free)
    q = np.zeros(9)
    u = np.array([0.0, 5.0 / 0.3, 0.0])
    none = np.zeros(3)
    load = bicycle.constraint_forces(q, u, none)
    print(dict(zip(bicycle.constraint_names, load.round(6).tolist())))
    u[0] = 0.1  # it begins to fall to the right, and steers to the right
    udot = bicycle.forward_dynamics(q, u, none)
    print(dict(zip(bicycle.speed_names, udot.round(6).tolist())))
    u[0] = 0.0
    for eigenvalue, name in linearized(bicycle, q, u, none).modes():
        if name.endswith(('steer', 'frame/rx')):  # not those of place and heading
            print(f'{eigenvalue:.6f} {name}')
