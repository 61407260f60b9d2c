"""The Whipple bicycle of the 2007 benchmark: z up, y to the left, origin under the rear wheel."""

from kane_dynamics import Inertial, ModelBuilder
from kane_dynamics.mechanics.constrained import ConstrainedEquations
from kane_dynamics.mechanics.constraints import Rolling
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.structure import structured
import numpy as np

y, tilt = (0, 1, 0), np.pi / 10
b = ModelBuilder('bicycle')
b.body('frame', 'world', 'floating', turns='zxy', matter=Inertial(
    85, (0.3, 0, 0.9), [[9.2, 0, -2.4], [0, 11, 0], [-2.4, 0, 2.8]]))
b.body('rear', 'frame', axis=y, at=(0, 0, 0.3),
       matter=Inertial(2, inertia=np.diag([0.0603, 0.12, 0.0603])))
b.body('fork', 'frame', joint='steer', axis=(-np.sin(tilt), 0, np.cos(tilt)), at=(1.1, 0, 0),
       matter=Inertial(4, (-0.2, 0, 0.7), [[0.05892, 0, 0.00756], [0, 0.06, 0],
                                           [0.00756, 0, 0.00708]]))
b.body('front', 'fork', axis=y, at=(-0.08, 0, 0.35),
       matter=Inertial(3, inertia=np.diag([0.1405, 0.28, 0.1405])))
model, free = b.model(), ['frame/rx', 'rear', 'steer']
wheels = [Rolling('rear', 0.3, axis=y), Rolling('front', 0.35, axis=y)]

if __name__ == '__main__':
    bicycle = ConstrainedEquations(Equations(model), structured(model, None, wheels, free))
    q, u, none = np.zeros(9), np.array([0.0, 5.0 / 0.3, 0.0]), np.zeros(3)
    load = bicycle.constraint_forces(q, u, none, None, model.gravity, 0.0, np.zeros(9))
    print({name: round(float(x), 6) for name, x in zip(bicycle.mechanism.labels, load)})
    u[0] = 0.1  # it begins to fall to the right, and steers there by itself
    udot = bicycle.forward_dynamics(q, u, none, None, model.gravity, 0.0)
    print(dict(zip(bicycle.mechanism.speed_names, [round(float(x), 6) for x in udot])))
