"""Payload requests and gravity from an IMU."""

import math

from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.errors import InputError
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.model import with_payload
from kane_dynamics.ros.loads.gravity_payload import checked_payload, GravityAndPayload
from kane_dynamics.ros.monitors.imu_gravity import GravityFromImu
import numpy as np
import pytest
from sensor_msgs.msg import Imu

NOW = 7 * 10**9  # ns, reception of a message without stamp
MODEL = load_urdf(resource_path('urdf', 'ur10e.urdf'))
VALUES = {'payload.frame': 'wrist_3_link', 'payload.max_mass': 10.0,
          'payload.max_distance': 0.5}
COM = (0.01, -0.02, 0.05)
INERTIA = (0.02, 0.001, -0.002, 0.025, 0.003, 0.03)
STATE = [np.linspace(-1.0, 1.0, 6), np.linspace(0.5, -0.7, 6), np.linspace(1.0, 2.0, 6)]


def tensor(xx, xy, xz, yy, yz, zz):
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.parametrize('frame', ['', 'wrist_3_link', 'tool0'])
def test_a_payload_in_any_frame_of_its_link_equals_a_model_with_payload(frame):
    robot = Robot(MODEL, payload_frame='wrist_3_link')
    payload = checked_payload(MODEL, VALUES, frame, 3.0, COM, INERTIA)
    GravityAndPayload(MODEL.gravity, payload).apply(robot)
    heavier = Robot(with_payload(MODEL, frame or 'wrist_3_link',
                                 Inertial(3.0, np.array(COM), tensor(*INERTIA))))
    np.testing.assert_allclose(robot.inverse_dynamics(*STATE),
                               heavier.inverse_dynamics(*STATE), rtol=1e-12, atol=1e-11)


def test_a_mass_of_zero_removes_the_payload():
    robot = Robot(MODEL, payload_frame='wrist_3_link')
    plain = Robot(MODEL)
    for mass in (3.0, 0.0):
        payload = checked_payload(MODEL, VALUES, '', mass, COM, (0.0,) * 6)
        GravityAndPayload(MODEL.gravity, payload).apply(robot)
    np.testing.assert_allclose(robot.inverse_dynamics(*STATE),
                               plain.inverse_dynamics(*STATE), rtol=1e-12)


@pytest.mark.parametrize(('words', 'changes'), [
    ('mass: -1 kg; expected 0 to 10', {'mass': -1.0}), ('mass: nan', {'mass': math.nan}),
    ('mass: 11 kg', {'mass': 11.0}), ('mass: inf', {'mass': math.inf}),
    ('at most 0.5 m from the frame', {'com': (0.0, 0.6, 0.0)}),
    ('finite', {'com': (0.0, math.nan, 0.0)}),
    ('finite', {'com': (1e308, math.inf, 0.0)}),
    ('inertia: .*finite', {'inertia': (math.nan, 0, 0, 1, 0, 1)}),
    ('none negative', {'inertia': (-0.1, 0, 0, 0.1, 0, 0.1)}),
    ('sum of the other two', {'inertia': (0.1, 0, 0, 0.1, 0, 0.3)}),
    ('at most 0.75 kg', {'inertia': (1.0, 0, 0, 1.0, 0, 1.0)}),
    ("no frame 'claw'", {'frame': 'claw'}),
    ("'forearm_link', not fixed to .* expected one of .*tool0",
     {'frame': 'forearm_link'}),
])
def test_an_invalid_payload_is_refused_by_name(words, changes):
    arguments = {'frame': '', 'mass': 3.0, 'com': COM, 'inertia': INERTIA, **changes}
    with pytest.raises(InputError, match=words):
        checked_payload(MODEL, VALUES, **arguments)


def test_a_distance_without_a_square_bounds_nothing():
    values = VALUES | {'payload.max_distance': 1e300}
    payload = checked_payload(MODEL, values, '', 3.0, (0.0, 1e6, 0.0),
                              (1e9, 0, 0, 1e9, 0, 1e9))
    assert payload.mass == 3.0


def test_without_a_payload_frame_a_payload_is_refused():
    with pytest.raises(InputError, match=r'payload\.frame is empty; expected a frame'):
        checked_payload(MODEL, VALUES | {'payload.frame': ''}, '', 1.0, COM, INERTIA)


def imu(t, force, turn=0.0, frame='base_link'):
    message = Imu()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(
        round(t * 1e9), 10**9)
    a = message.linear_acceleration
    a.x, a.y, a.z = map(float, force)
    message.angular_velocity.z = turn
    return message


def source(used, time_constant=1.0):
    return GravityFromImu(MODEL, 9.81, time_constant, used.append)


def test_an_imu_at_rest_gives_gravity_in_world_axes_after_a_time_constant():
    used = []
    gravity = source(used)
    for k in range(21):
        gravity.update(imu(100.0 + 0.05 * k, (0.0, 9.7, 0.0)), NOW)
        assert bool(used) == (k == 20)
    rotation = MODEL.frame('base_link').rotation
    np.testing.assert_allclose(used, [rotation @ [0.0, -9.81, 0.0]], atol=1e-12)
    assert len(used) == 1, 'unchanged gravity is not applied again'


def test_noise_is_filtered_and_a_slow_rotation_is_tracked():
    used = []
    generator = np.random.default_rng(0)
    gravity = source(used, time_constant=0.5)
    for k in range(4000):
        angle = min(0.5, max(0.0, 0.1 * (0.01 * k - 10.0)))
        force = 9.81 * np.array([math.sin(angle), 0.0, math.cos(angle)])
        gravity.update(imu(0.01 * k + 1.0, force + generator.normal(size=3) * 0.05), NOW)
    rotation = MODEL.frame('base_link').rotation
    np.testing.assert_allclose(rotation.T @ used[-1],
                               [-9.81 * math.sin(0.5), 0.0, -9.81 * math.cos(0.5)],
                               atol=0.05)
    assert np.allclose([np.linalg.norm(g) for g in used], 9.81)


@pytest.mark.parametrize(('words', 'message'), [
    ('acceleration of the IMU: 12 m', imu(1.0, (0.0, 0.0, 12.0))),
    ('IMU: 0 m/s', imu(1.0, (0.0,) * 3)), ('IMU: nan', imu(1.0, (math.nan, 0.0, 9.81))),
    ('e.308', imu(1.0, (1e308, 1e308, 9.81))),
    ('angular velocity of the IMU: 0.2 rad/s', imu(1.0, (0.0, 0.0, 9.81), 0.2)),
    ('angular velocity of the IMU: nan', imu(1.0, (0.0, 0.0, 9.81), math.nan)),
    ("no frame 'table'", imu(1.0, (0.0, 0.0, 9.81), frame='table')),
    ("'tool0', which moves; expected one fixed to the base: .*base_link",
     imu(1.0, (0.0, 0.0, 9.81), frame='tool0')),
])
def test_an_implausible_imu_message_is_ignored_with_the_reason(words, message):
    used = []
    gravity = source(used)
    with pytest.raises(InputError, match=words):
        gravity.update(message, NOW)
    for k in range(30):
        gravity.update(imu(2.0 + 0.05 * k, (0.0, 0.0, 9.81)), NOW)
    assert used


def test_an_imu_without_accelerometer_is_refused():
    message = imu(1.0, (0.0, 0.0, 9.81))
    message.linear_acceleration_covariance[0] = -1.0
    with pytest.raises(InputError, match='acceleration of the IMU: not measured'):
        source([]).update(message, NOW)


def test_a_gap_or_a_backward_jump_resets_the_filter():
    used = []
    gravity = source(used)

    def never_settled(start):
        for k in range(20):  # 0.95 s
            gravity.update(imu(start + 0.05 * k, (0.0, 0.0, 9.81)), NOW)
    never_settled(1.0)
    # An error, because an IMU with a low rate would otherwise be ignored silently.
    with pytest.raises(InputError, match='expected at most 3 s'):
        gravity.update(imu(50.0, (0.0, 0.0, 9.81)), NOW)
    never_settled(50.01)
    never_settled(20.0)
    assert not used


def test_imu_messages_without_stamp_use_the_time_of_reception():
    used = []
    gravity = source(used)
    for k in range(40):
        gravity.update(imu(0.0, (0.0, 9.7, 0.0)), NOW + 50_000_000 * k)
    assert len(used) == 1


@pytest.mark.parametrize('frame', ['tool0', 'claw'])
def test_messages_of_an_imu_that_moves_or_is_unknown_are_refused(frame):
    gravity = source([])
    message = imu(0.0, (0.0, 0.0, 9.81))
    message.header.frame_id = frame
    with pytest.raises(InputError, match=frame):
        gravity.update(message, NOW)
