"""FollowJointTrajectory over DDS: a client of this action moves the arm."""

from collections import Counter
import math
import re
import time

from action_msgs.msg import GoalStatus
from control_messages import imported_control_messages
from geometry_msgs.msg import WrenchStamped
from kane_dynamics import Motion, Robot
from lifecycle_msgs.msg import Transition
from node_process import DEEP, JOINTS, model, NAME, prefer, Process, URDF, wait_until
import numpy as np
from palletizer import DRIVEN, LOOPS, palletizer, URDF as URDF_OF_LOOPS
import pytest
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

NANO = 10**9
START = (0.3, -0.4, 0.2)
RATE = 250
ACTION = 'follow_joint_trajectory'
SUCCEEDED = GoalStatus.STATUS_SUCCEEDED
CANCELED = GoalStatus.STATUS_CANCELED
ABORTED = GoalStatus.STATUS_ABORTED
ROBOT = Robot(model())
SETTLED = 2e-3  # rad or m, of an arm that rests where it is to rest
REACH = 0.6  # rad or m, of random plans


class Arm:
    """The client of the action, and the joint states, with which the test compares."""

    def __init__(self, client, namespace=''):
        from control_msgs.action import FollowJointTrajectory
        from control_msgs.msg import JointTolerance
        self.client = client
        self.kind = FollowJointTrajectory
        self.tolerance = JointTolerance
        self.states = []  # position, velocity, effort, stamp
        self.feedback = []
        self.action = f'{namespace}{NAME}/{ACTION}'
        self.wrenches = client.create_publisher(WrenchStamped, '/plant_node/wrench', 1)
        self.subscription = client.create_subscription(
            JointState, f'{namespace}/joint_states', self._on_state, DEEP)

    def close(self):
        self.client.destroy_subscription(self.subscription)
        self.client.destroy_publisher(self.wrenches)

    def _on_state(self, message):
        stamp = message.header.stamp
        self.states.append((np.array(message.position), np.array(message.velocity),
                            np.array(message.effort), stamp.sec + 1e-9 * stamp.nanosec))

    def send(self, times, rows, joints=JOINTS, **fields):
        """Send a goal; return its handle and the future of its result."""
        trajectory = JointTrajectory(joint_names=list(joints))
        for moment, row in zip(times, rows):
            point = JointTrajectoryPoint(positions=[float(x) for x in row])
            sec, nanosec = divmod(round(moment * NANO), NANO)
            point.time_from_start.sec = sec
            point.time_from_start.nanosec = nanosec
            trajectory.points.append(point)
        fields = {'trajectory': trajectory} | fields
        self.feedback.clear()
        return self.client.send_goal(self.kind, self.action,
                                     lambda m: self.feedback.append(m.feedback),
                                     **fields)

    def result(self, future, timeout=20.0):
        """Return status, code and text of a result."""
        assert wait_until(future.done, timeout), 'no result'
        answer = future.result()
        return answer.status, answer.result.error_code, answer.result.error_string

    def ask(self, *points, **fields):
        """Send a goal and return status, code and text of its result."""
        return self.result(self.send(*points, **fields)[1])

    def rest(self, timeout=30.0):
        """Return where the arm comes to rest, by states from now on."""
        now = time.time()

        def rests():
            # A busy machine delivers states late, when the arm has moved on.
            recent = self.states[-30:]
            if len(recent) < 30 or recent[0][-1] < now:
                return False
            q, u = (np.array([state[k] for state in recent]) for k in (0, 1))
            return np.ptp(q, axis=0).max() < 2e-4 and np.abs(u).max() < 2e-3
        assert wait_until(rests, timeout), 'the arm does not come to rest'
        return self.states[-1][0]

    def tolerances(self, position=0.0, velocity=0.0, acceleration=0.0):
        return [self.tolerance(name=name, position=position, velocity=velocity,
                               acceleration=acceleration) for name in JOINTS]

    def push(self, force):
        message = WrenchStamped()
        message.header.frame_id = 'c'
        message.wrench.force.x = message.wrench.force.y = force
        self.wrenches.publish(message)


@pytest.fixture(scope='module')
def node(participant):
    with imported_control_messages():
        common = {'robot_description': f"'{URDF}'"}
        plant = Process(module='kane_dynamics.ros.plant.main', rate=RATE,
                        after_timeout='hold',
                        initial__position=list(START), wrench__frames='[c]', **common)
        node = Process(real_states=True, mode='computed_torque', state_timeout=5.0,
                       limits__rate='.inf',
                       trajectory__path_tolerance=1.0,
                       modes='[joint_impedance, hand_guiding]', **common)
        try:
            node.wait_for('active, mode computed_torque', 120.0)
            # The arm follows in real time, also beside other work.
            for process, priority in ((plant, 25), (node, 18)):
                prefer(process.pid, priority)
            yield node
        finally:
            for process in (node, plant):
                assert process.end()[0] == 0
                assert 'Traceback' not in process.log, process.log


@pytest.fixture
def arm(node, client):
    arm = Arm(client)
    assert wait_until(lambda: len(arm.states) > 10 and client.torques, 60.0)
    yield arm
    arm.close()


def random_plan(random):
    """Return times and points that the arm can move through."""
    count = random.integers(1, 4)
    rows = random.uniform(-REACH, REACH, (count, 3))
    times = np.cumsum(random.uniform(0.9, 1.2, count))
    return times, rows


def succeeds(arm, random):
    times, rows = random_plan(random)
    status, code, text = arm.ask(times, rows)
    assert (status, code) == (SUCCEEDED, 0), text
    assert text.startswith('goal reached ')
    assert len(arm.feedback) > 5
    np.testing.assert_allclose(arm.rest(), rows[-1], atol=SETTLED)


def is_cancelled(arm, random):
    place_before = arm.rest()
    times, rows = random_plan(random)
    handle, future = arm.send(times, rows)
    time.sleep(random.uniform(0.0, times[-1]))
    arm.client.on_spinner(handle.cancel_goal_async)
    status, code, text = arm.result(future)
    if status == SUCCEEDED:  # it ended before the request arrived
        return 'too late'
    assert (status, code) == (CANCELED, 0), text
    # On a busy machine the request may arrive before the motion begins or after its end.
    if re.fullmatch(r'cancelled \S+ s before its motion of \S+ s began', text):
        np.testing.assert_allclose(arm.rest(), place_before, atol=SETTLED)
        return 'before'
    if re.match(r'cancelled \S+ s after the end of its motion', text):
        np.testing.assert_allclose(arm.rest(), rows[-1], atol=SETTLED)
        return 'after'
    stated = re.fullmatch(
        r'cancelled at (\S+) s of (\S+) s; the arm rests at (\S+) s of its '
        r'motion', text)
    assert stated, text
    began, duration, end_of_stop = map(float, stated.groups())
    assert began < end_of_stop <= duration
    motion = Motion.from_points(times, rows, joint_names=JOINTS,
                                start=(place_before, None, None))
    np.testing.assert_allclose(arm.rest(), motion.sample(end_of_stop)[0], atol=SETTLED)


def is_preempted(arm, random):
    plan = random_plan(random)
    _, first = arm.send(*plan)
    time.sleep(random.uniform(0.0, 0.5 * plan[0][-1]))
    times, rows = random_plan(random)
    _, second = arm.send(times, rows)
    status, code, text = arm.result(first)
    # On a busy machine the new goal may arrive after the end of the first one.
    late = status == SUCCEEDED
    if not late:
        assert (status, code) == (ABORTED, -1), text
        assert re.fullmatch(r'replaced by a new goal at \S+ s of \S+ s', text), text
    status, code, text = arm.result(second)
    assert (status, code) == (SUCCEEDED, 0), text
    np.testing.assert_allclose(arm.rest(), rows[-1], atol=SETTLED)
    return 'too late' if late else None


def violates(arm, random):
    times, rows = random_plan(random)
    case = random.choice(['position', 'velocity', 'acceleration', 'goal', 'pushed'])
    if case == 'goal':
        # Nearer than the state of a moving arm can be read, in no time
        fields = {'goal_tolerance': arm.tolerances(1e-9)}
        fields['goal_time_tolerance'] = type(arm.kind.Goal().goal_time_tolerance)(
            nanosec=1)
        expected = -5
        words = r'position error \S+ rad or m \S+ s after the end .* \(goal tol'
    elif case == 'pushed':
        fields = {'path_tolerance': arm.tolerances(0.02)}
        expected = -4
        words = r'position error \S+ rad or m at \S+ s of .* 0\.02 \(path tol'
    else:
        fields = {'path_tolerance': arm.tolerances(**{case: 1e-6})}
        expected = -4
        words = rf'{case} error \S+ rad\S* or m\S* at \S+ s of .* 1e-06 \(path tol'
    _, future = arm.send(times, rows, **fields)
    if case == 'pushed':
        time.sleep(0.2)
        arm.push(40.0)
    status, code, text = arm.result(future)
    arm.push(0.0)
    assert (status, code) == (ABORTED, expected), (case, text)
    assert re.search(words, text), (case, text)
    arm.rest()
    return case


KINDS = {'succeeded': succeeds, 'cancelled': is_cancelled, 'preempted': is_preempted,
         'violated': violates}


def drive(arm, counts, seed):
    """Send random plans in random order; return how each ended."""
    random = np.random.default_rng(seed)
    plans = random.permutation(np.repeat(list(counts), list(counts.values())))
    ends = Counter()
    for kind in plans:
        arm.states.clear()
        end = KINDS[kind](arm, random)
        ends[kind, end] += 1
        speeds = np.abs([u for _, u, _, _ in arm.states])
        assert speeds.max() < 5.0
        limits = ROBOT.limits.effort
        assert (np.abs([tau
                        for _, _, tau, _ in arm.states]) <= limits * (1.0 + 1e-9)).all()
    return ends


def test_random_plans_end_with_their_codes_and_the_arm_where_stated(arm):
    drive(arm, {'succeeded': 4, 'cancelled': 2, 'preempted': 2, 'violated': 2}, 1)


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_a_hundred_random_plans_end_with_their_codes(arm):
    ends = drive(arm,
                 {'succeeded': 40, 'cancelled': 20, 'preempted': 20, 'violated': 20}, 2)
    print(ends)
    assert ends['cancelled', 'too late'] <= 2
    assert ends['preempted', 'too late'] <= 1
    assert ends['cancelled', 'before'] + ends['cancelled', 'after'] <= 3


REFUSED = {  # fields of the goal or changes of its trajectory, code, reason
    'no points': ({'rows': []}, -1, r'trajectory: 0 points'),
    'a joint is missing': ({'joints': JOINTS[:2]}, -2,
                           r'reach missing; expected each of'),
    'an unknown joint': ({'joints': (*JOINTS, 'x')}, -2,
                         r'x; expected turn, lift, reach'),
    'an old stamp': ({'stamp': 5.0}, -3, r'end of the motion: 4\.\d+ s ago'),
    'degrees': ({'rows': [[40.0, 0.0, 0.0]]}, -1,
                r"joint 'turn': position 40 .*if these are deg"),
    'far from the arm': ({'times': [0.0, 1.0],
                          'rows': [[2.0, 2.0, 1.0], [0.0, 0.0, 0.0]]}, -1,
                         r'the motion sets out at 2, the arm is at'),
    'too fast': ({'times': [0.01], 'rows': [[1.5, 1.5, 1.5]]}, -1,
                 r'speed .* expected at most .*, 1\.2 times its limit'),
    'tolerance of an unknown joint': (
        {'path': {'name': 'y', 'position': 1.0}}, -2,
        r"path_tolerance: 'y'; expected joints of"),
    'negative tolerance': (
        {'path': {'name': 'lift', 'velocity': -2.0}}, -1,
        r"path_tolerance of 'lift': velocity -2; expected a positive"),
    'tolerance that is no number': ({'path': {'name': 'lift', 'position': math.nan}}, -1,
                                    r"path_tolerance of 'lift': position nan; expected"),
    'multi-dof trajectory': ({'multi': True}, -1,
                             r'multi_dof_trajectory: 1 joints, 0 points'),
    'component tolerance': ({'component': True}, -1,
                            r'component_path_tolerance: 1 entries'),
}


@pytest.mark.parametrize('case', REFUSED)
def test_an_impossible_goal_is_refused_with_its_reason_and_the_present_one_goes_on(
        arm, case):
    changes, expected, words = REFUSED[case]
    resting_place = arm.rest()
    _, future = arm.send([1.0], [resting_place + 0.1])
    rows = changes.get('rows', [resting_place])
    rows = [np.resize(row, len(changes.get('joints', JOINTS))) for row in rows]
    trajectory = JointTrajectory(joint_names=list(changes.get('joints', JOINTS)))
    for moment, row in zip(changes.get('times', [1.0]), rows):
        point = JointTrajectoryPoint(positions=[float(x) for x in row])
        sec, nanosec = divmod(round(moment * NANO), NANO)
        point.time_from_start.sec = sec
        point.time_from_start.nanosec = nanosec
        trajectory.points.append(point)
    if 'stamp' in changes:
        then = time.time_ns() - round(changes['stamp'] * NANO)
        trajectory.header.stamp.sec, trajectory.header.stamp.nanosec = divmod(then, NANO)
    goal = arm.kind.Goal(trajectory=trajectory)
    if 'path' in changes:
        goal.path_tolerance = [arm.tolerance(**changes['path'])]
    if 'multi' in changes:
        goal.multi_dof_trajectory.joint_names = ['world']
    if 'component' in changes:
        from control_msgs.msg import JointComponentTolerance
        goal.component_path_tolerance = [JointComponentTolerance(joint_name='world')]
    fields = {name: getattr(goal, name) for name in goal.get_fields_and_field_types()}
    _, refused = arm.client.send_goal(arm.kind, arm.action, **fields)
    status, code, text = arm.result(refused)
    assert (status, code) == (ABORTED, expected), text
    assert re.search(words, text), text
    status, code, text = arm.result(future)
    assert (status, code) == (SUCCEEDED, 0), text
    np.testing.assert_allclose(arm.rest(), resting_place + 0.1, atol=SETTLED)


def test_a_message_on_the_topic_replaces_a_goal_and_one_without_points_ends_it(arm):
    resting_place = arm.rest()
    empty = 'dropped (a trajectory without points on ~/joint_trajectory) at '
    for points, reason in (([(1.0, resting_place)],
                            'replaced by a motion on ~/joint_trajectory at '),
                           ([], empty)):
        _, future = arm.send([3.0], [resting_place + 0.1])
        assert wait_until(lambda: arm.feedback)
        arm.client.follow(points)
        status, code, text = arm.result(future)
        assert (status, code) == (ABORTED, -1)
        assert text.startswith(reason), text
    arm.rest()


def test_a_goal_ends_with_the_reason_when_the_mode_changes_or_the_node_deactivates(
        arm, node):
    resting_place = arm.rest()
    for change, back, reason in (
            (lambda: arm.client.adjust(mode='inverse_dynamics'),
             lambda: arm.client.adjust(mode='computed_torque'),
             'dropped (the mode changed) at '),
            (lambda: arm.client.transition(Transition.TRANSITION_DEACTIVATE),
             lambda: arm.client.transition(Transition.TRANSITION_ACTIVATE),
             'dropped (the node was deactivated) at ')):
        _, future = arm.send([3.0], [resting_place])
        assert wait_until(lambda: arm.feedback)
        assert change()
        status, code, text = arm.result(future)
        assert (status, code) == (ABORTED, -1)
        assert text.startswith(reason), text
        status, code, text = arm.ask([3.0], [resting_place])
        assert (status, code) == (ABORTED, -1)
        assert ('expected one with feedback' in text
                or text == 'node: inactive; expected active')
        assert back()
    arm.rest()


def test_feedback_is_the_motion_beside_the_state(arm):
    resting_place = arm.rest()
    status, _, text = arm.ask([1.0], [resting_place + 0.2])
    assert status == SUCCEEDED, text
    assert 5 <= len(arm.feedback) <= 30
    motion = Motion.from_points([1.0], [resting_place + 0.2],
                                joint_names=JOINTS, start=(resting_place, None, None))
    for message in arm.feedback:
        assert tuple(message.joint_names) == JOINTS
        desired = message.desired
        actual = message.actual
        error = message.error
        since = desired.time_from_start
        q, u, _ = motion.sample(since.sec + 1e-9 * since.nanosec)
        np.testing.assert_allclose(desired.positions, q, atol=SETTLED)
        np.testing.assert_allclose(desired.velocities, u, atol=SETTLED)
        for field in ('positions', 'velocities'):
            difference = np.subtract(getattr(desired, field), getattr(actual, field))
            np.testing.assert_allclose(getattr(error, field), difference, atol=1e-12)


def test_a_goal_with_a_stamp_begins_then_and_is_cancelled_before(arm, node):
    resting_place = arm.rest()
    goal = arm.kind.Goal()
    stamp = goal.trajectory.header.stamp
    stamp.sec, stamp.nanosec = divmod(time.time_ns() + 5 * NANO, NANO)
    goal.trajectory.joint_names = list(JOINTS)
    point = JointTrajectoryPoint(positions=[float(x) for x in resting_place])
    point.time_from_start.sec = 1
    goal.trajectory.points.append(point)
    handle, future = arm.client.send_goal(arm.kind, arm.action,
                                          trajectory=goal.trajectory)
    time.sleep(0.2)
    assert not future.done()
    arm.client.on_spinner(handle.cancel_goal_async)
    status, code, text = arm.result(future)
    assert (status, code) == (CANCELED, 0)
    assert re.fullmatch(r'cancelled 4\.\d+ s before its motion of 1\.000 s began', text)
    assert re.search(r'follow_joint_trajectory: begins in [45]\.\d s, by its stamp',
                     node.log)


def test_the_driven_joints_of_an_arm_with_closed_loops_follow_and_stop(client):
    palletizer().compile()
    files = {'urdf': URDF_OF_LOOPS, 'constraints': LOOPS}
    names = ('-r', '__ns:=/loops')
    goal_end = (0.3, 0.2, -0.1, 0.5)
    times = (1.6,)
    with imported_control_messages():
        plant = Process(*names, module='kane_dynamics.ros.plant.main',
                        after_timeout='hold',
                        rate=250, substeps=4, measured=list(DRIVEN), **files)
        node = Process(*names, real_states=True, mode='computed_torque', gains__kp=36.0,
                       gains__kd=12.0, state_timeout=5.0, **files)
        arm = Arm(client, '/loops')
        try:
            node.wait_for('active, mode', 120.0)
            for process, priority in ((plant, 25), (node, 18)):
                prefer(process.pid, priority)
            # The node answers states: its torques hold the arm.
            assert wait_until(lambda: arm.states and arm.states[-1][2].any(), 60.0)
            status, code, text = arm.ask(times, [goal_end], DRIVEN)
            assert (status, code) == (SUCCEEDED, 0), text
            np.testing.assert_allclose(arm.rest(), goal_end, atol=5 * SETTLED)
            handle, future = arm.send(times, [(0.0,) * 4], DRIVEN)
            time.sleep(0.7)
            arm.client.on_spinner(handle.cancel_goal_async)
            status, code, text = arm.result(future)
            assert (status, code) == (CANCELED, 0), text
            rest_time = float(re.search(r'rests at (\S+) s', text)[1])
            motion = Motion.from_points(times, [(0.0,) * 4], joint_names=DRIVEN,
                                        start=(np.array(goal_end), None, None))
            np.testing.assert_allclose(arm.rest(), motion.sample(rest_time)[0],
                                       atol=5 * SETTLED)
        finally:
            print(node.log, plant.log)
            _, unfinished = arm.send(times, [goal_end], DRIVEN)
            assert wait_until(lambda: arm.feedback)
            for process in (node, plant):
                assert process.end()[0] == 0
            # A node that ends sends the result first.
            status, code, text = arm.result(unfinished)
            arm.close()
            assert (status, code) == (ABORTED, -1)
            assert text.startswith('dropped (the node was deactivated) at '), text


def test_joint_impedance_follows_goals_and_hand_guiding_does_not(arm):
    assert arm.client.adjust(mode='joint_impedance').successful
    try:
        random = np.random.default_rng(4)
        succeeds(arm, random)
        is_cancelled(arm, random)
        assert arm.client.adjust(mode='hand_guiding').successful
        status, code, text = arm.ask([1.0], [START])
        assert (status, code) == (ABORTED, -1)
        assert text == ('mode: hand_guiding; expected one with feedback '
                        '(computed_torque, joint_impedance, motor_side)')
    finally:
        assert arm.client.adjust(mode='computed_torque').successful
    arm.rest()
