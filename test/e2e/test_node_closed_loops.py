"""The palletizer, an arm with three closed loops, commanded over DDS."""

from collections import Counter
import time

from driven_palletizer import START, tracking_errors
from kane_dynamics.loop_tracking.loop_error import CONTRADICTION, SINGULAR
from kane_dynamics.ros.torque_path.drop_reasons import MISSING, STALE
from kane_dynamics_interfaces.srv import Simulate
from lifecycle_msgs.msg import Transition
from node_process import wait_until
import numpy as np
from palletizer import DRIVEN, LOOPS, palletizer, positions, SINGULAR_SHOULDER, URDF
import pytest
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

END = (0.5, 0.3, -0.2, 1.0)
# s: no multiple of a period, or two states may have one stamp, to the nanosecond
LATE = 0.2007


@pytest.fixture(scope='module')
def files():
    palletizer().compile()
    return {'urdf': URDF, 'constraints': LOOPS}


def commanded():
    """Return the indices of the driven joints in the order of the commands."""
    return sorted(palletizer().joint_names.index(name) for name in DRIVEN)


def gravity(driven):
    robot = palletizer()
    q = positions(robot, *driven)
    return robot.joint_torques(robot.gravity_force(q), q)[commanded()]


def test_computed_torque_moves_the_plant_with_only_the_driven_joints_measured(
        client, start, files):
    errors = tracking_errors(client, start, files, 'joint states/s', END, (36.0, 12.0),
                             rate=250, substeps=4)
    assert client.names == tuple(palletizer().joint_names[k] for k in commanded())
    assert len(errors) > 100
    # Torques that neglect the loops would let the arm, of half a ton, fall at once.
    assert np.mean(errors) < 0.02
    assert any('closed loops: residual' in values for _, _, values in client.diagnostics)


def inputs(count, seed=0):
    """Yield joint states of a moving arm, some faulty: kind, positions, delay."""
    rng = np.random.default_rng(seed)
    names = palletizer().joint_names
    for k in range(count):
        phase = 2.0 * np.pi * k / 500.0
        driven = (0.4 * np.sin(phase), 0.2 + 0.3 * np.sin(phase), 0.3 * np.cos(phase),
                  0.5)
        joints = dict(zip(DRIVEN, driven))
        complete = dict(zip(names, positions(palletizer(), *driven)))
        kind = rng.choice(
            ['good', 'complete', 'lost', 'late', 'missing', 'contradictory',
             'singular'], p=[0.4, 0.4, 0.04, 0.04, 0.04, 0.04, 0.04])
        if kind == 'missing':
            del joints['lever_drive']
        elif kind == 'singular':
            joints['shoulder'] = SINGULAR_SHOULDER - rng.uniform(-0.003, 0.3)
        elif kind in ('complete', 'contradictory'):
            joints = complete
            if kind == 'contradictory':
                joints[rng.choice([x for x in names if x not in DRIVEN])] += rng.choice(
                    [-1.0, 1.0]) * rng.uniform(0.05, 1.0)
        yield kind, driven, joints, LATE if kind == 'late' else 0.0


def check_faulty_inputs(client, start, files, seconds, rate):
    node = start(diagnostics_rate=5.0, **files)
    node.wait_for('active, mode', 60.0)
    client.joints = DRIVEN
    assert wait_until(lambda: client.ask(START, START, timeout=0.3) is not None, 60.0)
    sent = Counter()
    expected = {}
    due = time.monotonic()
    for kind, driven, joints, delay in inputs(round(seconds * rate)):
        due += 1.0 / rate
        time.sleep(max(due - time.monotonic(), 0.0))
        sent[kind] += 1
        if kind == 'lost':
            continue
        stamp = client.send(list(joints.values()), [0.0] * len(joints), list(joints),
                            stamp=time.time_ns() - round(delay * 1e9))
        expected[stamp] = (kind, driven)
    wait_until(lambda: False, 0.5)
    answered = Counter()
    for stamp, torques in client.torques.items():
        if stamp not in expected:
            continue  # zeros, or a state of the beginning
        kind, driven = expected[stamp]
        answered[kind] += 1
        assert kind in ('good', 'complete'), kind
        np.testing.assert_allclose(torques, gravity(driven), rtol=1e-8, atol=1e-8)
    zeros = [stamp for stamp, torques in client.torques.items() if not torques.any()]
    good = sent['good'] + sent['complete']
    # Best effort, on a busy machine.
    assert answered.total() > 0.5 * good, (answered, sent)
    # The last command goes on; zeros come at the end, and where the machine stops this
    # process.
    assert len(zeros) < 0.1 * (sent['contradictory'] + sent['singular'])
    assert not set(expected) & set(zeros)
    counts = client.diagnostics[-1][2]
    for kind, reason in (('late', STALE), ('missing', MISSING),
                         ('contradictory', CONTRADICTION),
                         ('singular', SINGULAR)):
        assert int(counts[f'states dropped: {reason}']) > 0.4 * sent[kind], (kind, sent,
                                                                             counts)
    assert 'Traceback' not in node.log


def test_faulty_states_give_no_torque_and_every_refusal_is_named(client, start, files):
    check_faulty_inputs(client, start, files, 10.0, 100.0)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_ten_minutes_of_faulty_states_give_no_wrong_torque(client, start, files):
    check_faulty_inputs(client, start, files, 600.0, 500.0)


def test_a_simulation_request_with_computed_torque_follows_the_driven_joints(
        client, start, files):
    node = start(autostart=False, simulation__stops=True, **files)
    assert client.transition(Transition.TRANSITION_CONFIGURE), node.log
    robot = palletizer()
    reference = JointTrajectory(joint_names=list(DRIVEN))
    for t, q in ((0, START), (1, END)):
        point = JointTrajectoryPoint(positions=list(q), velocities=[0.0] * 4)
        point.time_from_start.sec = t
        reference.points.append(point)
    answer = client.call(Simulate, 'simulate',
                         position=positions(robot, *START).tolist(),
                         duration=1.0, torque_source=Simulate.Request.COMPUTED_TORQUE,
                         reference=reference)
    assert answer.success, answer.message
    end = np.array(answer.trajectory.points[-1].positions)
    np.testing.assert_allclose(end, positions(robot, *END), atol=2e-3)
    effort = np.array(answer.trajectory.points[0].effort)
    others = [k for k in range(robot.n_q) if k not in commanded()]
    assert effort[commanded()].all() and not effort[others].any()
