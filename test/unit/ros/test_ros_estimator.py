"""Payload estimation of the demo's arm in motion."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')
pytest.importorskip('kane_dynamics_interfaces')
pytest.importorskip('mujoco')

from kane_dynamics import Controller, Inertial, load_urdf, Robot  # noqa: E402, I100
from kane_dynamics.demo.demo_settings import FR3, RATE  # noqa: E402
from kane_dynamics.demo.mujoco_plant import MujocoArm  # noqa: E402
from kane_dynamics.errors import InputError  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload  # noqa: E402
from kane_dynamics.ros.monitors.payload_monitor import (estimator_settings,  # noqa: E402
                                                        PayloadMonitor)
from kane_dynamics.ros.parameters.parameter_checks import read  # noqa: E402
from kane_dynamics.ros.parameters.parameter_table import BY_NAME  # noqa: E402
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from node_values import node_values, UNCHECKED  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402

FRAME = 'fr3_link8'
MASS = 2.0
COM = np.array([0.03, -0.02, 0.08])
CARRIED = f"""<link name="load"><inertial><origin xyz="{' '.join(map(str, COM))}"/>
  <mass value="{MASS}"/><inertia ixx="0.02" iyy="0.015" izz="0.01" ixy="0" ixz="0" iyz="0"/>
  </inertial></link><joint name="carried" type="fixed"><parent link="{FRAME}"/>
  <child link="load"/></joint></robot>"""  # noqa: E501
MODEL = load_urdf(FR3.urdf, joints=list(FR3.joints))
NANO = 10**9
NOISE = np.array([1e-5, 5e-4])  # of positions, rad, and speeds, rad/s: of good encoders


def settings(**changes):
    values = node_values()
    values['arm_compensates'] = ('none',)
    arguments = {'payload.frame': FRAME, 'estimator.enabled': True,
                 'mode': 'gravity_compensation'}
    return values | arguments | {
        f'estimator.{name}': read(BY_NAME[f'estimator.{name}'], value)
        for name, value in changes.items()}


class Rig:
    """The demo's arm with payload and servo; the torque path with the monitor."""

    def __init__(self, carrying=True, **changes):
        with open(FR3.urdf, encoding='utf-8') as file:
            text = file.read()
        self.arm = MujocoArm(FR3,
                             text.replace('</robot>', CARRIED) if carrying else text)
        self.published = []
        self.rejected = []
        self.time = 100 * NANO
        self.chance = np.random.default_rng(0)
        self.robot = Robot(MODEL, payload_frame=FRAME)
        silent = SimpleNamespace(publish=lambda message: None)
        self.path = TorquePath(Controller(self.robot, mode='gravity_compensation'),
                               silent, silent,
                               lambda: self.time, node_values(UNCHECKED), Statistics(),
                               lambda *words: None)
        timers = SimpleNamespace(create_timer=self.timer)
        self.estimator = PayloadMonitor(self.robot, settings(**changes), timers,
                                        SimpleNamespace(publish=self.published.append),
                                        lambda *words: self.rejected.append(words))
        self.path.add_observer(self.estimator, need_effort=True)
        self.path.start()

    def timer(self, period, callback, clock):
        self.period = period
        self.publish = callback

    def run(self, seconds, motion=None, effort=True):
        """Simulate; the servo holds the arm or follows the motion."""
        for k in range(round(seconds * RATE)):
            q, u = self.arm.state
            t = k / RATE
            q_d, u_d, udot_d = (motion or FR3.motion()).sample(t if motion else 0.0)
            servo = FR3.kp * (q_d - q) + FR3.kd * (u_d - u)
            tau = self.robot.inverse_dynamics(q_d, u_d, udot_d) + servo
            message = JointState(
                name=list(FR3.joints),
                position=(q + NOISE[0] * self.chance.normal(size=7)).tolist(),
                velocity=(u + NOISE[1] * self.chance.normal(size=7)).tolist(),
                effort=tau.tolist() if effort else [])
            self.time += round(NANO / RATE)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(
                self.time, NANO)
            self.path.on_state(serialize_message(message))
            self.arm.step(tau)
            if (k + 1) % round(self.period * RATE) == 0:
                self.publish()


@pytest.mark.parametrize(('loads', 'memory', 'rise'), [
    (None, 1e4, 1.0), (Inertial(MASS, COM, 0.01 * np.eye(3)), 20.0, 1.05)],
    ids=['no payload parameter', 'payload parameter'])
def test_two_kilograms_are_found_to_2_percent_and_5_mm_within_ten_seconds_of_motion(
        loads, memory, rise):
    rig = Rig(memory=memory)
    rig.path.set_loads(GravityAndPayload(MODEL.gravity, loads))
    rig.run(8.0, FR3.motion())
    published = rig.published[-1]
    assert len(rig.published) == 16
    assert published.header.frame_id == FRAME
    assert abs(published.mass - MASS) < min(0.02 * MASS, 3.0 * published.mass_deviation)
    off = np.array([published.com.x, published.com.y, published.com.z]) - COM
    assert np.linalg.norm(off) < 0.005
    deviation = published.com_deviation
    assert (np.abs(off) < 3.0 * np.array([deviation.x, deviation.y, deviation.z])).all()
    assert rig.rejected == []
    # The deviation falls as the arm moves, at every message. With a memory as short as
    # the motion it may rise a little at the end: the forgotten part excited the payload
    # more than the last.
    deviations = np.array([message.mass_deviation for message in rig.published])
    assert (deviations[1:] < rise * np.minimum.accumulate(deviations)[:-1]).all()
    assert deviations[-1] < 0.25 * deviations[0]


def test_without_payload_the_mass_is_zero_and_its_center_unknown():
    rig = Rig(carrying=False)
    rig.run(4.0, FR3.motion())
    assert abs(rig.published[-1].mass) < 0.1
    assert np.isnan(rig.published[-1].com.x)


def test_without_the_required_efforts_there_is_no_estimate():
    rig = Rig()
    rig.estimator._applied_torque._source = 'effort'
    rig.run(0.1, effort=False)
    rig.publish()
    assert rig.published == []
    assert rig.rejected[0][0] == 'no effort'


@pytest.mark.parametrize(('changes', 'words'), [
    ({'payload.frame': ''}, "'payload.frame': empty; expected"),
    ({'estimator.torque_deviation': np.array([1.0, 2.0])},
     '2 entries; expected one number, or one for each of the 7 joints')])
def test_invalid_settings_are_refused_by_name(changes, words):
    with pytest.raises(InputError, match=words):
        estimator_settings(settings() | changes, Robot(MODEL))
