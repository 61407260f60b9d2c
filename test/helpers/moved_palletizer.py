"""The palletizer in MuJoCo, whose loops equality constraints close, and its motion."""

from kane_dynamics._util.resources import resource_path
from kane_dynamics.demo.demo_settings import DemoRobot
import numpy as np

PALLETIZER = DemoRobot(
    title='A palletizer with three parallelograms in MuJoCo',
    urdf=resource_path('urdf', 'palletizer.urdf'),
    constraints=resource_path('urdf', 'palletizer.constraints.yaml'),
    joints=('swivel', 'shoulder', 'turn', 'lever_drive'),
    home=np.array([0.0, 0.2, 0.0, 0.1]),
    amplitude=np.array([0.9, 0.35, 1.5, 0.3]),
    frequency=np.array([2.0, 3.0, 4.0, 2.5]) / 8.0,
    kp=np.array([30000.0, 30000.0, 60.0, 15000.0]),
    kd=np.array([2500.0, 2500.0, 5.0, 1200.0]),
    passive={'elbow': -0.1, 'wrist_pin': -0.1, 'drive_pin': 0.1, 'triangle_pin': -0.2,
             'rod_1_pin': 0.2, 'rod_2_pin': 0.1})
