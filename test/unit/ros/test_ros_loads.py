"""Payload and gravity: what is accepted, in which axes, and that it equals a heavier model."""

import math

from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.errors import InputError
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.with_payload import with_payload
from kane_dynamics.ros.monitors.imu_gravity import GravityFromImu
from kane_dynamics.ros.torque_path.gravity_payload import (checked_payload, GravityAndPayload,
                                                           PayloadBounds)
import numpy as np
import pytest
from sensor_msgs.msg import Imu

NOW = 7 * 10**9  # ns, when a message without a stamp comes
MODEL = load_urdf(resource_path('urdf', 'ur10e.urdf'))
BOUNDS = PayloadBounds('wrist_3_link', 10.0, 0.5)
COM, INERTIA = (0.01, -0.02, 0.05), (0.02, 0.001, -0.002, 0.025, 0.003, 0.03)
STATE = [np.linspace(-1.0, 1.0, 6), np.linspace(0.5, -0.7, 6), np.linspace(1.0, 2.0, 6)]


def tensor(xx, xy, xz, yy, yz, zz):
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.parametrize('frame', ['', 'wrist_3_link', 'tool0'])
def test_a_payload_in_any_frame_of_its_link_equals_a_heavier_model(frame):
    robot = Robot(MODEL, payload_frame='wrist_3_link')
    payload = checked_payload(MODEL, BOUNDS, frame, 3.0, COM, INERTIA)
    GravityAndPayload(MODEL.gravity, payload).apply(robot)
    heavier = Robot(with_payload(MODEL, frame or 'wrist_3_link',
                                 Inertial(3.0, np.array(COM), tensor(*INERTIA))))
    np.testing.assert_allclose(robot.inverse_dynamics(*STATE), heavier.inverse_dynamics(*STATE),
                               rtol=1e-12, atol=1e-11)


def test_a_mass_of_zero_takes_the_payload_off():
    robot, plain = Robot(MODEL, payload_frame='wrist_3_link'), Robot(MODEL)
    for mass in (3.0, 0.0):
        payload = checked_payload(MODEL, BOUNDS, '', mass, COM, (0.0,) * 6)
        GravityAndPayload(MODEL.gravity, payload).apply(robot)
    np.testing.assert_allclose(robot.inverse_dynamics(*STATE), plain.inverse_dynamics(*STATE),
                               rtol=1e-12)


@pytest.mark.parametrize(('words', 'changes'), [
    ('mass is -1 kg; valid: 0 to 10', {'mass': -1.0}), ('mass is nan', {'mass': math.nan}),
    ('mass is 11 kg', {'mass': 11.0}), ('mass is inf', {'mass': math.inf}),
    ('at most 0.5 m away', {'com': (0.0, 0.6, 0.0)}), ('finite', {'com': (0.0, math.nan, 0.0)}),
    ('finite', {'com': (1e308, math.inf, 0.0)}),
    ('inertia is .*finite', {'inertia': (math.nan, 0, 0, 1, 0, 1)}),
    ('none negative', {'inertia': (-0.1, 0, 0, 0.1, 0, 0.1)}),
    ('sum of the other two', {'inertia': (0.1, 0, 0, 0.1, 0, 0.3)}),
    ('at most 0.75 kg', {'inertia': (1.0, 0, 0, 1.0, 0, 1.0)}),
    ("no frame 'claw'", {'frame': 'claw'}),
    ("'forearm_link' is not fixed to .* valid: .*tool0", {'frame': 'forearm_link'}),
])
def test_an_impossible_payload_is_refused_by_name(words, changes):
    given = {'frame': '', 'mass': 3.0, 'com': COM, 'inertia': INERTIA, **changes}
    with pytest.raises(InputError, match=words):
        checked_payload(MODEL, BOUNDS, **given)


def test_without_a_payload_frame_there_is_no_payload():
    with pytest.raises(InputError, match='set parameter payload'):
        checked_payload(MODEL, PayloadBounds('', 10.0, 0.5), '', 1.0, COM, INERTIA)


def imu(t, force, turn=0.0, frame='base_link'):
    message = Imu()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(round(t * 1e9), 10**9)
    a = message.linear_acceleration
    a.x, a.y, a.z = map(float, force)
    message.angular_velocity.z = turn
    return message


def source(used, frame='', time_constant=1.0):
    return GravityFromImu(MODEL, frame, 9.81, time_constant, used.append)


def test_an_imu_at_rest_gives_gravity_in_world_axes_after_a_time_constant():
    used = []
    gravity = source(used)
    for k in range(21):
        gravity.take(imu(100.0 + 0.05 * k, (0.0, 9.7, 0.0)), NOW)
        assert bool(used) == (k == 20)
    rotation = MODEL.frame('base_link').rotation
    np.testing.assert_allclose(used, [rotation @ [0.0, -9.81, 0.0]], atol=1e-12)
    assert len(used) == 1, 'what does not change is not handed on again'


def test_noise_is_filtered_and_a_slow_turn_followed():
    used, generator = [], np.random.default_rng(0)
    gravity = source(used, time_constant=0.5)
    for k in range(4000):
        angle = min(0.5, max(0.0, 0.1 * (0.01 * k - 10.0)))
        force = 9.81 * np.array([math.sin(angle), 0.0, math.cos(angle)])
        gravity.take(imu(0.01 * k + 1.0, force + generator.normal(size=3) * 0.05), NOW)
    rotation = MODEL.frame('base_link').rotation
    np.testing.assert_allclose(rotation.T @ used[-1],
                               [-9.81 * math.sin(0.5), 0.0, -9.81 * math.cos(0.5)], atol=0.05)
    assert np.allclose([np.linalg.norm(g) for g in used], 9.81)


@pytest.mark.parametrize(('words', 'message'), [
    ('acceleration is 12', imu(1.0, (0.0, 0.0, 12.0))), ('is 0 m/s', imu(1.0, (0.0,) * 3)),
    ('is nan', imu(1.0, (math.nan, 0.0, 9.81))), ('e.308', imu(1.0, (1e308, 1e308, 9.81))),
    ('turns at 0.2', imu(1.0, (0.0, 0.0, 9.81), 0.2)),
    ('turns at nan', imu(1.0, (0.0, 0.0, 9.81), math.nan)),
    ("no frame 'table'", imu(1.0, (0.0, 0.0, 9.81), frame='table')),
    ("'tool0' moves; valid, fixed to the base: .*base_link",
     imu(1.0, (0.0, 0.0, 9.81), frame='tool0')),
])
def test_an_implausible_imu_message_is_left_out_with_the_reason(words, message):
    used = []
    gravity = source(used)
    with pytest.raises(InputError, match=words):
        gravity.take(message, NOW)
    for k in range(30):
        gravity.take(imu(2.0 + 0.05 * k, (0.0, 0.0, 9.81)), NOW)
    assert used


def test_an_imu_without_accelerometer_is_told_so():
    message = imu(1.0, (0.0, 0.0, 9.81))
    message.linear_acceleration_covariance[0] = -1.0
    with pytest.raises(InputError, match='measures no acceleration'):
        source([]).take(message, NOW)


def test_a_gap_or_a_jump_back_starts_the_filter_anew():
    used = []
    gravity = source(used)

    def never_settled(start):
        for k in range(20):  # 0.95 s
            gravity.take(imu(start + 0.05 * k, (0.0, 0.0, 9.81)), NOW)
    never_settled(1.0)
    # Said, lest an IMU that speaks but seldom be ignored for ever in silence.
    with pytest.raises(InputError, match=r'at most 3 times imu\.time_constant, 1 s'):
        gravity.take(imu(50.0, (0.0, 0.0, 9.81)), NOW)
    never_settled(50.01)
    never_settled(20.0)
    assert not used


def test_an_imu_without_stamps_is_of_when_it_comes():
    used = []
    gravity = source(used)
    for k in range(40):
        gravity.take(imu(0.0, (0.0, 9.7, 0.0)), NOW + 50_000_000 * k)
    assert len(used) == 1


@pytest.mark.parametrize('frame', ['tool0', 'claw'])
def test_a_frame_that_cannot_carry_the_imu_is_refused_at_once(frame):
    with pytest.raises(InputError, match=frame):
        source([], frame)
