"""The monitor of an arm over DDS: its payload, and arms unlike their model."""

from contextlib import contextmanager
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from kane_dynamics import load_urdf, Robot
from kane_dynamics_interfaces.msg import PayloadEstimate
from node_process import active_until_end, DEEP, JOINTS, Process, URDF, wait_until
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

PLANT = 'kane_dynamics.ros.plant.main'
MONITOR = 'kane_dynamics.ros.monitor_node.main'
TOPICS = '/monitor_node'
START = np.array([0.3, -0.4, 0.2])
AMPLITUDE = np.array([0.5, 0.4, 0.15])
NOISE = 0.05  # N m or N
WINDOW = 6.0
LIFT = ('<dynamics damping="0.5" friction="0.2"/>'
        '<limit lower="-3" upper="3" velocity="5" effort="60"/>')
OK = DiagnosticStatus.OK
STIFF = LIFT.replace('0.5', '0.75').replace('0.2', '0.3')  # 1.5 times the friction


def motion(t, frequencies):
    """
    Return positions, speeds and accelerations that begin at rest at the start.

    Of two frequencies a joint: with one, a late torque is like friction.
    """
    q = np.tile(START, (len(t), 1))
    u = np.zeros_like(q)
    udot = np.zeros_like(q)
    for part, multiple in ((0.6, 1.0), (0.25, 2.7)):
        w = multiple * np.asarray(frequencies)
        angles = np.outer(t, w)
        q += part * AMPLITUDE * (1.0 - np.cos(angles))
        u += part * AMPLITUDE * w * np.sin(angles)
        udot += part * AMPLITUDE * w**2 * np.cos(angles)
    return q, u, udot


@contextmanager
def simulated(client, urdf, frequencies, **parameters):
    """Provide a simulated arm that follows a motion for a minute."""
    plant = Process(module=PLANT, robot_description=f"'{urdf}'", rate=200,
                    initial__position=START.tolist(), noise__effort=NOISE, **parameters)
    try:
        plant.wait_for('200 joint states/s')
        # A motion is refused where the states of this arm do not arrive yet.
        client.torques.clear()
        assert wait_until(lambda: len(client.torques) > 100, 60.0), client.process.log
        message = JointTrajectory(joint_names=list(JOINTS))
        times = np.arange(0.0, 60.0, 0.05)
        q, u, udot = motion(times, frequencies)
        # A motion ends at rest, here within a second.
        times = np.append(times, times[-1] + 1.0)
        q = np.vstack([q, q[-1] + 0.5 * u[-1]])
        u = np.vstack([u, np.zeros(len(JOINTS))])
        udot = np.vstack([udot, np.zeros(len(JOINTS))])
        for moment, *state in zip(times, q, u, udot, strict=True):
            fields = zip(('positions', 'velocities', 'accelerations'), state,
                         strict=True)
            point = JointTrajectoryPoint(**{name: x.tolist() for name, x in fields})
            point.time_from_start.sec = int(moment)
            point.time_from_start.nanosec = round(moment % 1.0 * 1e9)
            message.points.append(point)
        client.motions.publish(message)
        yield plant
    finally:
        assert plant.end()[0] == 0


@contextmanager
def node(client, **parameters):
    """Provide a node in mode computed_torque, of which the client gets torques."""
    for process in active_until_end(Process(
            robot_description=f"'{URDF}'", mode='computed_torque',
            state_timeout=2.0, **parameters)):
        client.process = process
        client.connect()
        yield process


@contextmanager
def monitor(**parameters):
    """Provide a monitor of the arm as its URDF describes it."""
    process = Process(module=MONITOR, robot_description=f"'{URDF}'",
                      arm_compensates='none', diagnostics_rate=20, **parameters)
    try:
        process.wait_for('listening for')
        yield process
    finally:
        assert process.end()[0] == 0, process.log


def record(client, path, duration):
    """Record the sound arm, as its joint states come over DDS."""
    rows = []

    def on_state(message):
        stamp = message.header.stamp
        rows.append([stamp.sec + 1e-9 * stamp.nanosec, *message.position,
                     *message.velocity, *message.effort])
    with node(client), simulated(client, URDF, (1.9, 1.4, 2.6)):
        time.sleep(2.0)
        subscription = client.create_subscription(JointState, 'joint_states', on_state,
                                                  DEEP)
        time.sleep(duration)
        client.destroy_subscription(subscription)
    t, *columns = np.array(rows).T
    q, u, tau = np.array(columns).reshape(3, 3, -1).transpose(0, 2, 1)
    np.savez(path, t=t - t[0], q=q, u=u, tau=tau)


@pytest.mark.timeout(300)
def test_the_node_names_what_has_changed_of_simulated_arms(client, tmp_path):
    record(client, tmp_path / 'sound.npz', 12.0)
    reports = []
    statuses = []
    diagnostics = client.create_subscription(
        DiagnosticArray, '/diagnostics', lambda message: statuses.extend(
            status for status in message.status if 'monitor' in status.name), DEEP)
    subscription = client.create_subscription(DiagnosticArray, f'{TOPICS}/model_watch',
                                              reports.append, DEEP)

    def alarms():
        """Return name and cause of the alarms of the latest report."""
        warned = [status for status in reports[-1].status if status.level != OK]
        return [(status.name, pair.value) for status in warned for pair in status.values
                if pair.key == 'cause']
    with node(client), monitor(watch__reference=str(tmp_path / 'sound.npz'),
                               watch__window=WINDOW) as process:
        with simulated(client, URDF, (1.7, 2.3, 1.3)):
            assert wait_until(lambda: len(reports) > 1, 60.0), process.log
            assert alarms() == []
            assert wait_until(lambda: ('model watch', 'no change') in [
                (pair.key, pair.value) for pair in statuses[-1].values])
        with simulated(client, URDF.replace(LIFT, STIFF), (1.7, 2.3, 1.3)):
            assert wait_until(lambda: alarms()[:1] == [('lift', 'friction')], 60.0), (
                alarms(), len(reports), statuses[-1], process.log)
            assert wait_until(lambda: "'lift': friction up" in statuses[-1].message)
            process.wait_for("model watch: joint 'lift': friction up")
        with simulated(client, URDF, (1.7, 2.3, 1.3),
                       payload__frame='c', payload__mass=1.0):
            assert wait_until(lambda: ('c', 'payload') in alarms(), 60.0), process.log
    client.destroy_subscription(subscription)
    client.destroy_subscription(diagnostics)


def play(client, effort, stamp):
    """Publish a state at rest with efforts, as of another day."""
    message = JointState(name=list(JOINTS), position=START.tolist(), velocity=[0.0] * 3,
                         effort=effort.tolist())
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    client.states.publish(message)


def test_the_payload_is_estimated_from_states_of_another_day_without_a_node(client):
    estimates = []
    subscription = client.create_subscription(
        PayloadEstimate, f'{TOPICS}/payload_estimate', estimates.append, DEEP)
    robot = Robot(load_urdf(URDF), wrench_frames=['c'])
    weight = np.array([[0.0, 0.0, -9.81 * 1.5, 0.0, 0.0, 0.0]])  # at the frame's origin
    effort = robot.gravity_force(START) - robot.external_force(START, wrench=weight)
    with monitor(payload__frame='c', estimator__rate=10.0) as process:
        for k in range(2000):
            if len(estimates) > 3:
                break
            play(client, effort, 10**15 + 10**7 * k)
            time.sleep(0.01)
        assert len(estimates) > 3, process.log
    estimate = estimates[-1]
    assert estimate.header.frame_id == 'c'
    # At rest, offsets that the sensors may have cannot be told from a payload: the
    # deviation says so. Of sensors stated to be exact, test_payload_deviations asks for
    # 0.05 kg.
    assert estimate.mass_deviation > 0.0
    assert abs(estimate.mass - 1.5) < 3.0 * estimate.mass_deviation
    client.destroy_subscription(subscription)


def test_a_monitor_that_looks_for_nothing_says_so():
    process = Process(module=MONITOR, robot_description=f"'{URDF}'",
                      arm_compensates='none')
    assert wait_until(lambda: not process.alive(), 60.0)
    assert process.end()[0] == 2
    assert 'neither payload.frame nor watch.reference; expected one of them' in (
        process.log)
