"""Springs that are too stiff for the rate of the joint states are named."""

import re
from types import SimpleNamespace

from kane_dynamics._util.resources import resource_path
import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics.control.terms import Mode  # noqa: E402, I100
from kane_dynamics.ros.common.configuration_files import load_model  # noqa: E402
from kane_dynamics.ros.modes.live_law import SprungArm  # noqa: E402
from kane_dynamics.ros.modes.stability import instability  # noqa: E402
from kane_dynamics.ros.modes.task_modes import TaskModes  # noqa: E402
from kane_dynamics.ros.torque_path.path_controller import path_controller  # noqa: E402
from kane_dynamics.task_space.sampled_spring import JointSpring  # noqa: E402
from node_values import node_values  # noqa: E402

Q = np.array([0.4, -0.9])
STIFF = np.array([300.0] * 3 + [30.0] * 3)
SPRINGS = (Mode.JOINT_IMPEDANCE, Mode.CARTESIAN_IMPEDANCE)
WALLED = (Mode.HAND_GUIDING, Mode.CARTESIAN_IMPEDANCE)


class Rig:
    """The laws of a two-link arm."""

    def __init__(self, mode, **changes):
        self.values = values = node_values({
            'mode': str(mode), 'modes': list(map(str, SPRINGS)),
            'cartesian.frame': 'tip',
            **{k.replace('__', '.'): v for k, v in changes.items()}})
        model = load_model(resource_path('urdf', 'two_link.urdf'), values,
                           lambda warning: None)
        self.controller = path_controller(model, values, self._laws)
        self.mode = mode

    def _laws(self, robot):
        self.modes = TaskModes(robot, self.values)
        return self.modes.laws

    def words(self, period, q=Q):
        """Return why the mode is unstable with states of a period, s."""
        return instability(self.controller, self.modes.laws, self.mode, q, period)


@pytest.mark.parametrize('mode', SPRINGS)
def test_a_spring_too_stiff_for_the_rate_of_the_states_is_named(mode):
    """The same spring is steady at 1 kHz."""
    rig = Rig(mode, joint_impedance__stiffness=400.0, cartesian__stiffness=STIFF)
    assert rig.words(1e-3) == ''
    words = rig.words(0.05)
    assert words.startswith(f"{mode}: joint 'joint")
    assert 'each 50 ms' in words and 'armature' in words


@pytest.mark.parametrize('mode', SPRINGS)
def test_the_share_that_the_warning_states_is_steady(mode):
    """Settings with the stated share of stiffness give no warning, more do."""
    rig = Rig(mode, joint_impedance__stiffness=5e3, cartesian__stiffness=25.0 * STIFF)
    share = float(rig.words(0.01).split('expected at most ')[1].split('%')[0]) / 100.0
    assert 0.001 <= share < 0.9
    for factor, steady in ((0.9, True), (1.2, False)):
        other_rig = Rig(mode, joint_impedance__stiffness=5e3 * factor * share,
                        cartesian__stiffness=25.0 * factor * share * STIFF)
        assert (other_rig.words(0.01) == '') == steady


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


def at_a_wall(rig):
    """Return a position at which the wall of the second joint acts, and no other one."""
    limits = rig.controller.robot.limits
    return np.array([Q[0], limits.lower[1] + 0.03])


@pytest.mark.parametrize('mode', WALLED)
def test_a_wall_too_stiff_for_the_rate_of_the_states_is_named_while_it_acts(mode):
    weak = {'cartesian__stiffness': 1e-3 * STIFF, 'walls__margin': 0.1}
    rig = Rig(mode, walls__stiffness=2000.0, **weak)
    assert rig.words(4e-3) == ''  # no wall acts
    q = at_a_wall(rig)
    assert rig.words(5e-4, q) == ''
    words = rig.words(4e-3, q)
    assert words.startswith(f"{mode}: joint 'joint2' swings up")
    share = float(re.search(r'at most (\S+)% of the stiffness of its wall',
                            words)[1]) / 100.0
    assert 0.001 <= share < 0.9
    for factor, steady in ((0.9, True), (1.2, False)):
        other_rig = Rig(mode, walls__stiffness=2000.0 * factor * share, **weak)
        assert (other_rig.words(4e-3, q) == '') == steady


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


def test_each_spring_is_judged_beside_all_before_it():
    """Dampers are stable up to inertia over period: three of 0.4 are too many."""
    rig = Rig(Mode.JOINT_IMPEDANCE)
    period = 0.01
    damping = 0.4 * rig.controller.robot.mass_matrix(Q) / period
    damper = JointSpring(0.0 * damping, damping, False)
    for names, stable in ((('first', 'second'), True), (('a', 'b', 'third'), False)):
        springs = dict.fromkeys(names, damper)
        law = SimpleNamespace(springs=lambda q, springs=springs: springs,
                              sprung_arm=lambda robot, q: SprungArm(
                                  robot.mass_matrix(q), robot.speed_names),
                              longest_period=np.inf)
        words = instability(rig.controller, {rig.mode: law}, rig.mode, Q, period)
        assert (words == '') == stable
    assert 'at most 50% of the third' in words
