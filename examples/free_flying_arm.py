"""
A satellite with an arm: it turns while the arm moves, and its momenta stay.

Figures: ETS-VII, the satellite with the first free-flying robot arm (NASDA, 1997), from
model_ETS7.m of D. Dimitrov's bMSd (github.com/drdv/bmsd), without its three reaction
wheels. The masses and moments are those of K. Yoshida and S. Abiko, "Inertia Parameter
Identification for a Free-Flying Space Robot", AIAA Guidance, Navigation and Control
Conference 2002. The moments of link 2 break the triangle inequality as published;
`strict=False` accepts them with a warning. The initial speeds are ours.
"""

import warnings

from kane_dynamics import Inertial, ModelBuilder, ModelWarning, Robot, simulate
from kane_dynamics.mechanics.definition import kane
import numpy as np

right = np.pi / 2
# Place of the joint from the last center of mass, rpy; center of mass from the joint,
# mass, moments xx, yy, zz, xy, xz, yz about it; axes of the link, whose z is that of the
# joint.
LINKS = [
    ((-0.785, -0.295, 1), (0, 0, 0), (0, 0, 0.175),
     35.01, (1.218, 0.5132, 1.692, -0.07309, 0.00071, 0.1132)),
    ((0, 0.275, 0.175), (-right, -right, 0), (0.435, 0, 0),
     22.45, (0.102, 3.378, 3.752, 0, -0.00214, 0)),
    ((0.435, 0, 0), (0, 0, right), (0.315, 0, 0.275),
     21.89, (0.4327, 2.266, 2.528, 0, -0.6328, 0)),
    ((0.315, 0, 0), (0, 0, -right), (0, 0, -0.1335),
     16.54, (0.3878, 0.3963, 0.07271, 0, 0.01675, 0)),
    ((0, 0, -0.1335), (right, 0, right), (0, 0, 0.1385),
     26.0, (0.5727, 0.5987, 0.1290, 0, -0.2313, 0)),
    ((0, 0, 0.1385), (np.pi, -right, 0), (0, 0, 0.266),
     18.49, (0.165, 0.241, 0.2590, 0.000781, -0.0145, -0.000137)),
]


def inertial(mass, center, moments):
    """Return the inertial of a link from its mass, center of mass and moments."""
    xx, yy, zz, xy, xz, yz = moments
    return Inertial(mass, np.array(center, dtype=float),
                    np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


b = ModelBuilder('ETS-VII', gravity=(0, 0, 0), strict=False)
b.body('bus', kind='free', inertial=inertial(
    2552.0, (0, 0, 0), (6206.0, 3541.0, 7087.0, 48.16, 78.52, -29.22)))
on = 'bus'
center = np.zeros(3)
for k, (place, rpy, ahead, mass, moments) in enumerate(LINKS, 1):
    b.body(f'joint{k}', on, axis=(0, 0, 1), at=center + place, rpy=rpy,
           inertial=inertial(mass, ahead, moments))
    on = f'joint{k}'
    center = np.array(ahead)
with warnings.catch_warnings():
    warnings.simplefilter('ignore', ModelWarning)  # link 2, see above
    robot = Robot(b.model())


def momenta(q, u):
    """Return momentum, kg m/s, and angular momentum about the origin, kg m^2/s."""
    P, H = np.zeros((2, 3))
    bodies = kane.configurations(robot.model, q)
    for body, placed in zip(robot.model.bodies, bodies):
        p = body.inertial.mass * (u @ placed.partial_velocity)
        spin = kane.central_inertia(body, placed) @ (u @ placed.partial_angular_velocity)
        P = P + p
        H = H + np.cross(placed.p_com, p) + spin
    return np.concatenate([P, H])


q = robot.neutral()
q[7:] = 0.3, -0.5, 0.8, 0.2, 0.4, -0.3
u = np.array([0.01, -0.02, 0.005, 0.02, -0.03, 0.01, 0.05, 0.08, -0.06, 0.1, 0.05, -0.1])
run = simulate(robot, q, u, 60.0, step=2e-3, sample=1.0)

both = np.array([momenta(*state) for state in zip(run.q, run.u)])
turned = robot.difference(run.q[0], run.q[-1])[3:6]
print(
    f'after 60 s the bus has turned by {np.degrees(np.linalg.norm(turned)):.3f} degrees')
for name, rows in (('momentum', both[:, :3]), ('angular momentum', both[:, 3:])):
    change = np.abs(rows - rows[0]).max() / np.linalg.norm(rows[0])
    print(f'{name} {np.linalg.norm(rows[0]):.6f}, constant to 1e-12 of it: '
          f'{change < 1e-12}')
