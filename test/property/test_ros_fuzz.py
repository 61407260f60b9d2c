"""
Mutated messages cause no crash, no hang, and no torque but that of rclpy's reading.

Each mutation starts from a valid message and a fixed seed, so that failures are
reproducible.
"""

from collections import Counter
import math
import random
import struct

import numpy as np
import pytest

pytest.importorskip('rclpy')
pytest.importorskip('kane_dynamics_interfaces')

from geometry_msgs.msg import WrenchStamped  # noqa: E402, I100
from kane_dynamics import Controller, load_urdf, Robot  # noqa: E402, I100
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.errors import InputError, KaneError  # noqa: E402
from kane_dynamics.ros.common.conversion import motion_from_message, read_message  # noqa: E402
from kane_dynamics.ros.common.node_statistics import Statistics  # noqa: E402
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload  # noqa: E402
from kane_dynamics.ros.loads.wrench_input import WrenchFrames, WrenchInput  # noqa: E402
from kane_dynamics.ros.services import service_calls  # noqa: E402
from kane_dynamics.ros.services.served_robot import ServedRobot  # noqa: E402
from kane_dynamics.ros.services.simulation_request import SimulationRequest  # noqa: E402
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from kane_dynamics_interfaces.srv import (Explain, ForwardDynamics,  # noqa: E402
                                          GetDynamics, InverseDynamics, Simulate)
from node_values import node_values, UNCHECKED  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint  # noqa: E402

STATES = 100_000
TRAJECTORIES = 10_000
REQUESTS = 10_000
WRENCHES = 10_000
SHARES = [0.3, pytest.param(1.0, marks=pytest.mark.slow)]  # of these numbers
MODEL = load_urdf(resource_path('urdf', 'two_link.urdf'))
FRAME = MODEL.bodies[-1].name
ROBOT = Robot(MODEL, wrench_frames=(FRAME,))
A, B = ROBOT.joint_names
NOW = 100 * 10**9
TIMEOUT = 10**8
WORDS = [0, 1, 2, 3, 5, 255, 2**16, 2**31 - 1, 2**31, 2**32 - 1]
NUMBERS = [math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 0.0, -0.0, 1e22]


def mutated(chance, data, others):
    """Return `data` with one to three faults."""
    data = bytearray(data)
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        size = len(data)
        kind = chance.randrange(9)
        if kind == 0 and size:
            data[chance.randrange(size)] = chance.randrange(256)
        elif kind == 1 and size:
            data[chance.randrange(size)] ^= 1 << chance.randrange(8)
        elif kind == 2 and size > 8:
            at = 4 * chance.randrange(1, size // 4)
            struct.pack_into('<I', data, at, chance.choice(WORDS))
        elif kind == 3 and size > 20:
            at = 4 + 8 * chance.randrange((size - 12) // 8)
            struct.pack_into('<d', data, at, chance.choice(NUMBERS))
        elif kind == 4:
            del data[chance.randrange(size + 1):]
        elif kind == 5:
            data += bytes(chance.randrange(256) for _ in range(chance.randrange(40)))
        elif kind == 6 and size:
            at = chance.randrange(size)
            del data[at:at + chance.choice((1, 4, 8))]
        elif kind == 7:
            at = chance.randrange(size + 1)
            data[at:at] = bytes(chance.choice((1, 4, 8)))
        else:
            donor = chance.choice(others)
            at = chance.randrange(min(size, len(donor)) + 1)
            data[at:] = donor[at:]
    return bytes(data)


def state(chance, names, stamp=NOW, speeds=True):
    message = JointState(name=names)
    message.header.frame_id = chance.choice(('', '', 'world'))
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    message.position = [chance.uniform(-3, 3) for _ in names]
    message.velocity = [chance.uniform(-3, 3) for _ in names] if speeds else []
    return serialize_message(message)


def as_rclpy_reads(data):
    """Return stamp, q, u as read by rclpy; None for a state that must be dropped."""
    try:
        message = deserialize_message(data, JointState)
    except Exception:
        return None
    names = list(message.name)
    if names.count(A) != 1 or names.count(B) != 1:
        return None
    if not len(names) == len(message.position) == len(message.velocity):
        return None
    order = [names.index(A), names.index(B)]
    q = [message.position[k] for k in order]
    u = [message.velocity[k] for k in order]
    # A speed that is NaN counts as absent.
    if not all(map(math.isfinite, q)) or any(map(math.isinf, u)):
        return None
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec, q, u


class Sent:
    """Keeps the published messages."""

    def __init__(self):
        self.messages = []

    def publish(self, data):
        self.messages.append(data)


@pytest.mark.parametrize('share', SHARES)
def test_mutated_state_gives_the_torque_of_rclpys_reading_or_none(share):
    count = round(share * STATES)
    chance = random.Random(5)
    seeds = []
    for names in ([A, B], [B, A], ['x', A, 'yy', B], [A], []):
        for _ in range(3):
            seeds.append(state(chance, names))
    seeds += [state(chance, [A, B], stamp)
              for stamp in (0, NOW - TIMEOUT // 2, NOW + 2 * TIMEOUT)]
    seeds += [state(chance, [A, B], speeds=False)]
    commands = Sent()
    torques = Sent()
    statistics = Statistics()
    path = TorquePath(Controller(ROBOT), commands, torques, lambda: NOW,
                      node_values(UNCHECKED), statistics, lambda reason, detail: None)
    last = 0
    outcomes = Counter()
    for turn in range(count):
        if turn % 20 == 0:  # restart, because stamps may not decrease
            path.start()
            last = 0
        data = mutated(chance, chance.choice(seeds),
                       seeds) if turn % 8 else chance.choice(seeds)
        count_before = len(commands.messages)
        path.on_state(data)
        came = commands.messages[count_before:]
        read = as_rclpy_reads(data)
        stamp = (read[0] or NOW) if read else 0
        if read is None or abs(NOW - stamp) > TIMEOUT or stamp < last:
            assert not came or (read is None and came
                                == commands.messages[count_before - 1:count_before])
            continue
        try:
            torque = ROBOT.gravity_force(np.array(read[1]))
        except InputError:  # the torque of a finite state overflows
            # The last goes on.
            assert not came or came == commands.messages[count_before - 1:count_before]
            continue
        last = min(stamp, NOW)
        limit = ROBOT.limits.effort
        expected = np.clip(torque, -limit, limit)
        assert len(came) == 1, (turn, data.hex())
        assert np.frombuffer(
            came[0], offset=20).tolist() == expected.tolist(), (turn, data.hex())
        stamped = deserialize_message(torques.messages[-1], JointState)
        # Without a stamp of the state, the time of its reception.
        assert stamped.header.stamp.sec * 10**9 + stamped.header.stamp.nanosec == stamp
        outcomes[path._reader.full_parses] += 1
    # Both code paths were used, and most dropped states have a reported reason.
    assert statistics.commands > 0.15 * count
    assert 1000 < path._reader.full_parses < count - 1000
    assert (statistics.dropped.total() + statistics.foreign_states
            + statistics.commands) == count
    assert len(statistics.dropped) >= 8


def trajectory(chance, points):
    message = JointTrajectory(joint_names=[A, 'x', B])
    for k in range(points):
        point = JointTrajectoryPoint(positions=[chance.uniform(-1, 1) for _ in range(3)])
        if chance.random() < 0.7:
            point.velocities = [chance.uniform(-1, 1) for _ in range(3)]
        point.time_from_start.sec = k
        message.points.append(point)
    return message


def test_a_mutated_trajectory_gives_a_finite_motion_or_is_rejected():
    chance = random.Random(6)
    seeds = [serialize_message(trajectory(chance, points)) for points in (1, 2, 3, 5, 0)]
    good = 0
    for _ in range(TRAJECTORIES):
        data = mutated(chance, chance.choice(seeds), seeds)
        try:
            motion = motion_from_message(read_message(data, JointTrajectory),
                                         ROBOT.joint_names, 20)
        except KaneError:
            continue
        good += 1
        assert np.isfinite(motion.times).all() and np.isfinite(motion.positions).all()
    assert good > 0.1 * TRAJECTORIES


def push(chance, frame=FRAME, stamp=NOW):
    message = WrenchStamped()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    for vector in (message.wrench.force, message.wrench.torque):
        vector.x, vector.y, vector.z = (chance.uniform(-9, 9) for _ in range(3))
    return message


def push_as_rclpy_reads(data):
    """Return the wrench, (6,), as read by rclpy; None for one that must be rejected."""
    try:
        message = deserialize_message(data, WrenchStamped)
    except Exception:
        return None
    stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec or NOW
    force = message.wrench.force
    torque = message.wrench.torque
    numbers = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
    good = (message.header.frame_id == FRAME and abs(NOW - stamp) <= TIMEOUT
            and (np.abs(numbers) <= [100.0] * 3 + [50.0] * 3).all())
    return numbers if good else None


@pytest.mark.parametrize('share', SHARES)
def test_a_mutated_wrench_acts_as_rclpy_reads_it_or_is_rejected(share):
    count = round(share * WRENCHES)
    chance = random.Random(8)
    seeds = []
    for choice in ((), (), (), (FRAME, 0), ('elsewhere',), (FRAME, NOW - 2 * TIMEOUT),
                   (FRAME, NOW + 2 * TIMEOUT)):
        seeds.append(serialize_message(push(chance, *choice)))
    reasons = Counter()
    wrenches = WrenchInput(ROBOT, lambda: NOW, {
        'wrench.timeout': TIMEOUT * 1e-9, 'wrench.max_force': 100.0,
        'wrench.max_moment': 50.0,
        'wrench.rise_time': 0.0}, lambda reason, detail: reasons.update([reason]))
    q = np.array([0.3, -0.7])
    acted = 0
    for _ in range(count):
        data = mutated(chance, chance.choice(seeds), seeds)
        wrenches.clear()  # else most stamps would be before the last one
        wrenches.on_message(data)
        came = wrenches.torques(q, NOW)
        read = push_as_rclpy_reads(data)
        if read is None:
            assert came is None, data.hex()
            continue
        acted += 1
        row = wrenches._frames.in_world(q, [(0, read)])
        assert came.tolist() == ROBOT.external_force(q, wrench=row).tolist(), data.hex()
    assert acted > 0.1 * count
    assert acted + reasons.total() == count
    assert len(reasons) >= 6, reasons


def requests(chance):
    """Return serialized valid requests, their types, and their calls and responses."""
    def numbers():
        return [chance.uniform(-1, 1) for _ in range(2)]

    kinds = [
        (InverseDynamics.Request(position=numbers(), velocity=numbers(),
                                 acceleration=numbers()),
         service_calls.inverse_dynamics, InverseDynamics.Response),
        (ForwardDynamics.Request(position=numbers(), velocity=numbers(),
                                 effort=numbers()),
         service_calls.forward_dynamics, ForwardDynamics.Response),
        (GetDynamics.Request(joint_names=[B, A], position=numbers()),
         service_calls.get_dynamics, GetDynamics.Response),
        (Explain.Request(position=numbers(), acceleration=numbers(),
                         wrenches=[push(chance)]),
         service_calls.explain, Explain.Response),
        (Simulate.Request(position=numbers(), duration=0.02), None, Simulate.Response),
        (Simulate.Request(position=numbers(), duration=0.01, step=0.002, torque_source=1,
                          torques=numbers() * 5), None, Simulate.Response),
        (Simulate.Request(position=numbers(), duration=0.01, torque_source=2,
                          kp=[1.0, 2.0],
                          reference=trajectory(chance, 3)), None, Simulate.Response)]
    return [(serialize_message(request), type(request), call, answer)
            for request, call, answer in kinds]


@pytest.mark.parametrize('share', SHARES)
def test_mutated_request_is_answered_or_rejected_with_its_reason(share):
    count = round(share * REQUESTS)
    chance = random.Random(7)
    served = ServedRobot(ROBOT, ROBOT, GravityAndPayload(ROBOT.model.gravity), {
        'gains.kp': np.ones(2), 'gains.kd': np.ones(2), 'simulation.max_duration': 1.0,
        'simulation.max_steps': 200, 'simulation.max_points': 50,
        'trajectory.max_points': 20,
        'simulation.integrator': 'rk4', 'simulation.stops': False,
        'simulation.sticking': False}, WrenchFrames(ROBOT))
    seeds = requests(chance)
    outcomes = Counter()
    for _ in range(count):
        data, kind, call, answer = chance.choice(seeds)
        try:
            request = deserialize_message(mutated(chance, data, [data]), kind)
        except RuntimeError:
            outcomes['not read'] += 1
            continue
        response = answer()
        try:
            if call is not None:
                call(served, request, response)
            else:
                SimulationRequest.from_request(request, served).run(response,
                                                                    lambda t: True)
        except InputError:
            outcomes['refused'] += 1
            continue
        outcomes['answered'] += 1
        for field in ('effort', 'acceleration', 'bias_force', 'by_source', 'by_body'):
            part = getattr(response, 'explanation', response)
            assert np.isfinite(getattr(part, field, [])).all()
    assert min(outcomes.values()) > 0.02 * count, outcomes
