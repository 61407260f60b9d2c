"""The warning of springs that are too stiff for the rate of the joint states."""

import re
from types import SimpleNamespace

from kane_dynamics import ArmCoupling, load_urdf, PartnerState, Robot
from kane_dynamics._util.resources import resource_path
import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics.control.terms import Mode  # noqa: E402, I100
from kane_dynamics.ros.common.configuration_files import load_model  # noqa: E402
from kane_dynamics.ros.modes.task_modes import TaskModes  # noqa: E402
from kane_dynamics.ros.monitors.swing_monitor import SwingMonitor  # noqa: E402
from kane_dynamics.ros.parameters.task_settings import coupling_settings  # noqa: E402
from kane_dynamics.ros.torque_path.path_controller import path_controller  # noqa: E402
from kane_dynamics.task_space.sampled_spring import JointSpring, swing  # noqa: E402
from node_values import node_values  # noqa: E402

NANO = 10**9
Q = np.array([0.4, -0.9])
STIFF = np.array([300.0] * 3 + [30.0] * 3)
SPRINGS = (Mode.JOINT_IMPEDANCE, Mode.CARTESIAN_IMPEDANCE)
WALLED = (Mode.HAND_GUIDING, Mode.CARTESIAN_IMPEDANCE)


class Rig:
    """A monitor beside the laws of a two-link arm."""

    def __init__(self, mode, **changes):
        self.values = values = node_values({
            'mode': str(mode), 'modes': list(map(str, SPRINGS)),
            'cartesian.frame': 'tip', 'coupling.partner': '/other/coupling_state',
            **{k.replace('__', '.'): v for k, v in changes.items()}})
        model = load_model(resource_path('urdf', 'two_link.urdf'), values,
                           lambda warning: None)
        self.controller = path_controller(model, values, self._laws)
        self.log = []
        server = SimpleNamespace(create_timer=self._timer,
                                 destroy_timer=lambda timer: None)
        self.monitor = SwingMonitor(server, self.controller, self.modes.laws,
                                    SimpleNamespace(warning=self.log.append))
        self.monitor.start()
        self.stamp = 100 * NANO

    def _laws(self, robot):
        self.modes = TaskModes(robot, self.values)
        return self.modes.laws

    def _timer(self, period, callback, clock):
        self.examine = callback

    def states(self, period, count=30, pause=0.0, before=0, q=Q):
        """Let the monitor observe states at a period, s, with a pause."""
        for k in range(count):
            if k == before:
                self.stamp += round(pause * NANO)
            self.stamp += round(period * NANO)
            self.monitor.on_cycle(
                SimpleNamespace(stamp=self.stamp, state=SimpleNamespace(q=q)))
        self.examine()


@pytest.mark.parametrize('mode', SPRINGS)
def test_a_spring_too_stiff_for_the_rate_of_the_states_is_named(mode):
    """The same spring is steady at 1 kHz; the warning ends, and is logged once."""
    rig = Rig(mode, joint_impedance__stiffness=400.0, cartesian__stiffness=STIFF)
    rig.states(1e-3)
    assert rig.monitor.warning == ''
    for _ in range(3):
        rig.states(0.05)
    assert rig.monitor.warning.startswith(f"{mode}: joint 'joint")
    assert 'each 50 ms' in rig.monitor.warning and 'armature' in rig.monitor.warning
    assert rig.log == [rig.monitor.warning]
    rig.states(1e-3)
    assert rig.monitor.warning == ''


@pytest.mark.parametrize('mode', SPRINGS)
def test_the_share_that_the_warning_states_is_steady(mode):
    """Settings with the stated share of stiffness give no warning, more do."""
    rig = Rig(mode, joint_impedance__stiffness=5e3, cartesian__stiffness=25.0 * STIFF)
    rig.states(0.01)
    share = float(
        rig.monitor.warning.split('expected at most ')[1].split('%')[0]) / 100.0
    assert 0.001 <= share < 0.9
    for factor, steady in ((0.9, True), (1.2, False)):
        other_rig = Rig(mode, joint_impedance__stiffness=5e3 * factor * share,
                        cartesian__stiffness=25.0 * factor * share * STIFF)
        other_rig.states(0.01)
        assert (other_rig.monitor.warning == '') == steady


@pytest.mark.parametrize('mode', SPRINGS)
def test_spring_and_damper_are_those_of_the_law(mode):
    """Differences of the torques of the law itself, about a target at the state."""
    rig = Rig(mode)
    robot = rig.controller.robot
    mode_law = rig.modes.laws[mode]
    spring = mode_law.springs(Q)['stiffness']
    law = mode_law.law
    at_rest = np.zeros(2)
    target = Q
    if mode is Mode.CARTESIAN_IMPEDANCE:
        target = robot.frame_pose('tip', Q)
        law.update(null_damping=0.0)
    else:
        mode_law.torque(Q, at_rest, None, 0.0, 0.0)  # the mode begins
    h = 1e-6
    for k, e in enumerate(np.eye(2)):
        gravity = robot.gravity_force(Q + h * e) - robot.gravity_force(Q - h * e)
        stretched = law.torque(Q - h * e, at_rest, target) - law.torque(
            Q + h * e, at_rest, target)
        np.testing.assert_allclose((stretched + gravity) / (2 * h),
                                   spring.stiffness[:, k], rtol=1e-5, atol=1e-4)
        damped = law.torque(Q, -h * e, target) - law.torque(Q, h * e, target)
        np.testing.assert_allclose(damped / (2 * h), spring.damping[:, k],
                                   rtol=1e-5, atol=1e-4)


def test_a_pause_or_a_jump_of_the_clock_is_no_slower_rate_of_states():
    rig = Rig(Mode.JOINT_IMPEDANCE, joint_impedance__stiffness=400.0)
    rig.states(1e-3)
    for pause in (0.5, -20.0, 3600.0):
        for pauses_before in range(1, 11):
            rig.states(1e-3, pause=pause, before=pauses_before)
            assert rig.monitor.warning == ''
    assert rig.log == []


def test_few_states_and_modes_without_a_spring_give_no_warning():
    rig = Rig(Mode.JOINT_IMPEDANCE, joint_impedance__stiffness=400.0)
    rig.states(0.05, count=5)
    assert rig.monitor.warning == ''
    rig.controller.update(mode=Mode.GRAVITY_COMPENSATION)
    rig.states(0.05)
    assert rig.monitor.warning == '' and rig.log == []


def at_a_wall(rig):
    """Return a position at which the wall of the second joint acts, and no other one."""
    limits = rig.controller.robot.limits
    return np.array([Q[0], limits.lower[1] + 0.03])


@pytest.mark.parametrize('mode', WALLED)
def test_a_wall_too_stiff_for_the_rate_of_the_states_is_named_while_it_acts(mode):
    weak = {'cartesian__stiffness': 1e-3 * STIFF, 'walls__margin': 0.1}
    rig = Rig(mode, walls__stiffness=2000.0, **weak)
    rig.states(4e-3)
    assert rig.monitor.warning == ''  # no wall acts
    q = at_a_wall(rig)
    rig.states(5e-4, q=q)
    assert rig.monitor.warning == ''
    rig.states(4e-3, q=q)
    assert rig.monitor.warning.startswith(f"{mode}: joint 'joint2' swings up")
    share = float(re.search(r'at most (\S+)% of the stiffness of its wall',
                            rig.monitor.warning)[1]) / 100.0
    assert 0.001 <= share < 0.9
    for factor, steady in ((0.9, True), (1.2, False)):
        other_rig = Rig(mode, walls__stiffness=2000.0 * factor * share, **weak)
        other_rig.states(4e-3, q=q)
        assert (other_rig.monitor.warning == '') == steady


@pytest.mark.parametrize('mode', WALLED)
def test_stiffness_and_damping_of_walls_are_those_of_the_law(mode):
    """Differences of torques with walls and without, beyond the joint limit."""
    rig = Rig(mode, walls__margin=0.1, walls__stiffness=50.0,
              hand_guiding__max_speed=1e3)
    robot = rig.controller.robot
    mode_law = rig.modes.laws[mode]
    law = mode_law.law
    q = Q.copy()
    q[1] = robot.limits.lower[1] - 0.02
    pose = [robot.frame_pose('tip', q)] if mode is Mode.CARTESIAN_IMPEDANCE else []
    walls = mode_law.springs(q)['stiffness of its wall']
    law.update(speed_limit=np.inf)
    h = 1e-6
    up = np.array([0.0, h])
    at_rest = np.zeros(2)

    def differences():
        stretched = law.torque(q - up, at_rest, *pose) - law.torque(
            q + up, at_rest, *pose)
        damped = law.torque(q, -up, *pose) - law.torque(q, up, *pose)
        return np.array([stretched, damped]) / (2 * h)
    with_walls = differences()
    law.update(limit_stiffness=0.0)
    of_walls = with_walls - differences()
    np.testing.assert_allclose(of_walls, [walls.stiffness[1], walls.damping[1]],
                               rtol=1e-5, atol=1e-5)
    assert walls.stiffness[1, 1] == pytest.approx(50.0)


def test_a_stiff_coupling_of_two_arms_is_named():
    rig = Rig(Mode.ARM_COUPLING, coupling__stiffness=400.0)
    rig.states(1e-3)
    assert rig.monitor.warning == ''
    rig.states(0.05)
    assert rig.monitor.warning.startswith("arm_coupling: joint 'joint")
    # Each arm pulls the other: two have twice the spring of one that holds its position.
    mode = rig.modes.laws[Mode.ARM_COUPLING]
    alone = mode.springs(Q)['stiffness']
    mode.law.engage(Q, PartnerState(0.0, Q, 0.0 * Q, 0.0 * Q))
    coupled = mode.springs(Q)['stiffness']
    np.testing.assert_allclose(coupled.stiffness, 2.0 * alone.stiffness)
    np.testing.assert_allclose(coupled.damping, 2.0 * alone.damping)
    mode.law.disengage()
    law = rig.modes.laws[Mode.ARM_COUPLING].law
    spring = rig.modes.laws[Mode.ARM_COUPLING].springs(Q)['stiffness']
    at_rest = np.zeros(2)
    law.torque(0.0, Q, at_rest)  # it holds this position
    held = law.torque(0.0, Q, at_rest)
    h = 1e-6
    for k, e in enumerate(np.eye(2)):
        gravity = rig.controller.robot.gravity_force(Q + h * e) - held
        stretched = held + gravity - law.torque(0.0, Q + h * e, at_rest)
        np.testing.assert_allclose(stretched / h, spring.stiffness[:, k],
                                   rtol=1e-5, atol=1e-3)
        damped = held - law.torque(0.0, Q, h * e)
        np.testing.assert_allclose(damped / h, spring.damping[:, k],
                                   rtol=1e-5, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize('period, stiffness, steady', [
    (2e-3, 2.0, True), (2e-3, 5.0, False), (1e-3, 5.0, True)])
def test_two_coupled_arms_swing_up_where_the_warning_says_so(period, stiffness, steady):
    """FR3 with the default damping; torques and partner a period late."""
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), tip='fr3_link8'))
    home = np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.6, 0.8])
    values = node_values(
        {'coupling.stiffness': (stiffness * robot.limits.effort).tolist()})
    settings = coupling_settings(values, robot, robot.joint_names)
    # What the node watches: the spring of the motion against each other.
    spring = JointSpring(2.0 * np.diag(settings['stiffness']),
                         2.0 * np.diag(settings['damping']), False)
    assert swing(robot.mass_matrix(home), spring, period).swings_up != steady

    sides = [ArmCoupling(robot, **{**settings, 'reflection': 0.0}) for _ in range(2)]
    q = [home, home + 1e-3 * np.arange(7)]
    u = [np.zeros(7), np.zeros(7)]
    torques_before = None
    torques = None
    for k in range(round(1.0 / period)):
        states = [PartnerState(k * period, q[i], u[i], np.zeros(7)) for i in range(2)]
        torques_before = torques_before or states
        if k == 0:
            for i in range(2):
                sides[i].engage(q[i], states[1 - i])
        commanded = [sides[i].torque(k * period, q[i], u[i], torques_before[1 - i])
                     for i in range(2)]
        acting = torques or commanded
        torques = commanded
        torques_before = states
        for i in range(2):
            for _ in range(4):
                step = 0.25 * period
                u[i] = u[i] + step * robot.forward_dynamics(q[i], u[i], acting[i])
                q[i] = q[i] + step * u[i]
    fastest = np.abs(u).max()
    assert (fastest < 0.01) if steady else (fastest > 0.5)


@pytest.mark.slow
@pytest.mark.parametrize('name', ['fr3', 'ur10e'])
def test_the_default_coupling_of_two_arms_is_steady_while_states_come_late(name):
    """At 500 Hz, torques a period late, states of the partner five."""
    robot = Robot(load_urdf(resource_path('urdf', f'{name}.urdf')))
    settings = coupling_settings(node_values({}), robot, robot.joint_names)
    n = robot.n
    period = 2e-3
    home = 0.5 * (robot.limits.lower + robot.limits.upper)
    q = [home, home + 1e-3 * np.arange(n)]
    u = [np.zeros(n), np.zeros(n)]
    sides = [ArmCoupling(robot, **settings) for _ in range(2)]
    states = []
    torques = []
    for k in range(500):
        t = k * period
        states.append([PartnerState(t, q[i], u[i], np.zeros(n)) for i in range(2)])
        late = states[max(0, k - 5)]
        if k == 0:
            for i in range(2):
                sides[i].engage(q[i], late[1 - i])
        torques.append([sides[i].torque(t, q[i], u[i], late[1 - i]) for i in range(2)])
        for i in range(2):
            for _ in range(4):
                step = 0.25 * period
                u[i] = u[i] + step * robot.forward_dynamics(q[i], u[i],
                                                            torques[max(0, k - 1)][i])
                q[i] = q[i] + step * u[i]
    assert np.abs(u[0] - u[1]).max() < 0.02
