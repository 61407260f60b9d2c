"""The simulated robot over DDS: what it publishes and refuses, beside a node."""

import math
import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from kane_dynamics import Robot
from kane_dynamics._util.resources import resource_path
from node_process import DEEP, JOINTS, model, Process, URDF, wait_until
import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

PLANT = 'kane_dynamics.ros.plant.main'
START = (0.3, -0.4, 0.2)
NANO = 10**9


class Watch:
    """A client of one simulated robot."""

    def __init__(self, client):
        self.client = client
        self.states = []
        self.clock = []
        self.reports = []
        self.commands = client.create_publisher(Float64MultiArray, 'commands', 1)
        self.wrenches = client.create_publisher(WrenchStamped, '/plant_node/wrench', 1)
        self._open = [
            client.create_subscription(JointState, 'joint_states', self._on_state, DEEP),
            client.create_subscription(Clock, '/clock', lambda m: self.clock.append(
                m.clock.sec * NANO + m.clock.nanosec), DEEP),
            client.create_subscription(DiagnosticArray, '/diagnostics', self._on_report,
                                       DEEP)]

    def _on_state(self, message):
        stamp = message.header.stamp.sec * NANO + message.header.stamp.nanosec
        self.states.append((stamp, np.array(message.position),
                            np.array(message.velocity), np.array(message.effort)))
        self.names = tuple(message.name)

    def _on_report(self, message):
        for status in message.status:
            if status.name.endswith('simulated robot'):
                self.reports.append((status.level, status.message,
                                     {pair.key: pair.value for pair in status.values}))

    def close(self):
        for subscription in self._open:
            self.client.destroy_subscription(subscription)
        for publisher in (self.commands, self.wrenches):
            self.client.destroy_publisher(publisher)

    def fresh(self, count=1, timeout=5.0):
        """Return the last of some joint states that come from now on."""
        count_before = len(self.states)
        assert wait_until(lambda: len(self.states) >= count_before + count,
                          timeout), 'no joint states'
        return self.states[-1]

    def service(self, name, **fields):
        kind = SetBool if name == 'pause' else Trigger
        return self.client.call(kind, f'/plant_node/{name}', **fields)

    def adjust(self, **parameters):
        return self.client.adjust('/plant_node', **parameters)

    def reported(self, key, value, timeout=5.0):
        self.reports.clear()
        return wait_until(
            lambda: any(values.get(key) == value for _, _, values in self.reports),
            timeout)

    def push(self, frame, force):
        message = WrenchStamped()
        message.header.frame_id = frame
        message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = force
        self.wrenches.publish(message)


@pytest.fixture(scope='module')
def process():
    process = Process(
        module=PLANT, robot_description=f"'{URDF}'", publish_clock='true', rate=200,
        initial__position=list(START), wrench__frames='[c]', diagnostics_rate=20)
    process.wait_for('200 joint states/s')
    yield process
    assert process.end()[0] == 0
    assert 'Traceback' not in process.log


@pytest.fixture
def plant(process, client):
    """Return a watch on a plant in its initial state."""
    watch = Watch(client)
    assert watch.adjust(rate_factor=1.0, dropout__states=0.0, delay__states=0.0,
                        reset_clock=False, after_timeout='zero').successful
    assert watch.service('pause', data=False).success
    assert watch.service('reset').success
    assert wait_until(lambda: watch.commands.get_subscription_count() >= 2
                      and watch.wrenches.get_subscription_count() >= 1)
    watch.fresh(20)
    watch.process = process
    yield watch
    watch.close()


def test_brakes_hold_the_arm_until_commands_move_it_as_in_the_library(plant):
    _, q, u, effort = plant.fresh()
    assert plant.names == JOINTS
    assert (q.tolist(), u.tolist(), effort.tolist()) == (list(START), [0.0] * 3,
                                                         [0.0] * 3)
    robot = Robot(model())
    tau = np.array([5.0, 60.0, 3.0])
    plant.states.clear()
    plant.commands.publish(Float64MultiArray(data=tau.tolist()))
    assert wait_until(lambda: len(plant.states) > 15)
    k = next(k for k, state in enumerate(plant.states) if state[2].any())
    (t0, q0, u0, effort), (t1, q1, u1, _) = plant.states[k:k + 2]
    assert effort.tolist() == tau.tolist()
    assert t1 - t0 == 5_000_000
    udot = robot.forward_dynamics(0.5 * (q0 + q1), 0.5 * (u0 + u1), tau)
    np.testing.assert_allclose((u1 - u0) / 5e-3, udot, rtol=1e-3)
    assert wait_until(lambda: not plant.states[-1][3].any(),
                      3.0), 'the command must time out'


def test_invalid_commands_have_no_effect_and_are_counted(plant):
    for data in ([1.0, 2.0], [1.0, math.nan, 0.0], []):
        plant.commands.publish(Float64MultiArray(data=data))
        assert plant.fresh(5)[1].tolist() == list(START)
    plant.process.wait_for('commands rejected: commands: 2 entries; expected 3')
    assert plant.reported('rejected: commands', '3')


def test_a_wrench_moves_the_arm_and_one_at_another_frame_is_refused(plant):
    assert plant.adjust(after_timeout='hold').successful
    hold = Robot(model()).gravity_force(np.array(START))
    plant.commands.publish(Float64MultiArray(data=hold.tolist()))
    still = plant.fresh(10)[1]
    np.testing.assert_allclose(still, START, atol=1e-9)
    plant.push('b', (40.0, 0.0, 0.0))
    plant.process.wait_for("wrench rejected: frame_id: 'b'; expected c")
    np.testing.assert_allclose(plant.fresh(5)[1], START, atol=1e-9)
    plant.push('c', (40.0, 0.0, 0.0))  # along the sliding joint
    assert wait_until(lambda: plant.states[-1][1][2] > START[2] + 0.05)


def test_a_paused_plant_advances_by_steps(plant):
    assert plant.service('step').message == 'plant: running; expected paused by ~/pause'
    assert plant.service('pause', data=True).success
    time.sleep(0.1)
    count = len(plant.states)
    stamp = plant.clock[-1]
    time.sleep(0.3)
    assert (len(plant.states), plant.clock[-1]) == (count, stamp)
    assert plant.service('step').success
    assert wait_until(lambda: len(plant.states) == count + 1)
    assert plant.states[-1][0] - plant.states[-2][0] == 5_000_000
    assert wait_until(lambda: plant.clock[-1] == stamp + 5_000_000)
    assert plant.service('pause', data=False).success
    plant.fresh(5)


def test_simulated_time_follows_rate_factor_and_reset_clock(plant):
    for factor in (4.0, 0.2):
        assert plant.adjust(rate_factor=factor).successful
        plant.fresh(2)
        # A busy machine may make it slower, and never faster than asked for.
        begun = time.monotonic()
        t0 = plant.fresh()[0]
        end = t0 + 0.8 * factor * NANO
        assert wait_until(lambda end=end: plant.states[-1][0] > end, 30.0)
        passed = (plant.states[-1][0] - t0) / NANO
        assert passed < 1.2 * factor * (time.monotonic() - begun)
    assert plant.adjust(reset_clock=True, rate_factor=1.0).successful
    assert plant.service('reset').success
    assert wait_until(lambda: plant.clock[-1] < 2 * NANO)
    plant.client.diagnostics.clear()
    assert wait_until(lambda: any('times real time' in message
                                  for _, message, _ in plant.client.diagnostics))
    assert not any('at -' in message for _, message, _ in plant.client.diagnostics)


def test_dropouts_and_delays_are_applied_and_invalid_requests_change_nothing(plant):
    refused = plant.adjust(dropout__states=1.0, delay__states=-1.0)
    assert not refused.successful
    assert 'delay.states out of range Min: 0.0, Max: 10.0' in refused.reason
    refused = plant.adjust(dropout__states=1.0, rate=100.0)
    assert 'expected no change; restart the node' in refused.reason
    plant.fresh(5)
    assert plant.adjust(delay__states=0.2).successful
    time.sleep(0.5)
    assert plant.clock[-1] - plant.fresh()[0] == pytest.approx(0.2 * NANO,
                                                               abs=0.05 * NANO)
    assert plant.adjust(delay__states=0.0, dropout__states=1.0).successful
    time.sleep(0.3)
    count = len(plant.states)
    time.sleep(0.2)
    assert len(plant.states) == count


def test_the_shipped_configuration_starts_the_plant_and_a_missing_urdf_is_an_error(
        start):
    node = start('--params-file', str(resource_path('config', 'plant.yaml')),
                 module=PLANT, robot_description='""')
    node.wait_for('ur10e: 6 joints')
    assert 'unknown and ignored' not in node.log
    assert node.end()[0] == 0
    node = start(module=PLANT, robot_description='""')
    assert wait_until(lambda: not node.alive())
    assert node.end()[0] == 2
    assert ("plant_node: URDF: none; expected parameter 'robot_description' or 'urdf'"
            in node.log)


def test_a_tool_lands_on_a_table_and_stays_there(client, tmp_path):
    robot = Robot(model())
    height = float(robot.frame_pose('c', np.array(START))[2, 3]) - 0.1
    file = tmp_path / 'table.yaml'
    file.write_text('contacts: {tool: {frame: c, friction: 0.5, '
                    f'plane: {{point: [0, 0, {height!r}]}}}}}}')
    process = Process(module=PLANT, robot_description=f"'{URDF}'", rate=200,
                      initial__position=list(START), contacts=str(file),
                      hold_until_command='false', diagnostics_rate=20)
    watch = Watch(client)
    try:
        assert watch.reported('in contact', 'tool', timeout=60.0)
        _, q, _, _ = watch.fresh(200)
        assert robot.frame_pose('c', q)[2, 3] == pytest.approx(height, abs=1e-8)
    finally:
        watch.close()
        assert process.end()[0] == 0
