"""
A palletizer of three parallelograms follows a motion under a soft servo.

Its loops are closed by the constraints file; the motors are at the independent joints.
Inverse dynamics of the whole mechanism, added to the torques of the servo, leaves less
than a thousandth of the error.
"""

from pathlib import Path

from kane_dynamics import load_constraints, load_urdf, Robot, simulate
import numpy as np

URDF = Path(__file__).parents[1] / 'urdf'
STEP = 1e-3  # s
DURATION = 4.0  # s

arm = Robot(load_urdf(URDF / 'palletizer.urdf'),
            **load_constraints(URDF / 'palletizer.constraints.yaml'))
driven = list(map(arm.coordinate_names.index, arm.speed_names))
stiffness = {'swivel': 3e4, 'shoulder': 3e4, 'lever_drive': 1.5e4, 'turn': 60.0}
kp = np.array([stiffness[name] for name in arm.speed_names])  # N m/rad
kd = 0.08 * kp  # N m s/rad
amplitude = np.full(arm.n, 0.2)  # rad


def desired(t):
    """Return positions, speeds and accelerations of the driven joints."""
    w = 2.0 * np.pi / DURATION
    return (amplitude * (1.0 - np.cos(w * t)) / 2.0, amplitude * w * np.sin(w * t) / 2.0,
            amplitude * w**2 * np.cos(w * t) / 2.0)


def error(feedforward):
    """Return the RMS error of the driven joints, rad."""
    def torque(t, q, u):
        q_d, u_d, udot_d = desired(t)
        servo = kp * (q_d - q[driven]) + kd * (u_d - u)
        if not feedforward:
            return servo
        return servo + arm.inverse_dynamics(q, u_d, udot_d)
    run = simulate(arm, arm.configuration, np.zeros(arm.n), DURATION, step=STEP,
                   torque=torque)
    errors = [q[driven] - desired(t)[0] for t, q in zip(run.t, run.q)]
    return np.sqrt(np.mean(np.square(errors)))


alone = error(feedforward=False)
helped = error(feedforward=True)
print(f'error of the servo alone {1e3 * alone:.3g} mrad, with feedforward '
      f'{1e3 * helped:.3g} mrad')
