"""The warning of an arm that leaves its motion, or its place without one."""

from types import SimpleNamespace

from kane_dynamics import Motion
import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics.control.terms import Mode  # noqa: E402, I100
from kane_dynamics.ros.monitors.drift_watch import DriftWatch  # noqa: E402
from kane_dynamics.ros.torque_path.active_motion import ActiveMotion  # noqa: E402

NANO = 10**9
FOLLOWING = (Mode.INVERSE_DYNAMICS, Mode.COMPUTED_TORQUE)
NAMES = ('cart/x', 'lift', 'elbow')  # the base has no motor, the second joint slides


class Rig:
    """A watch beside a torque path of three joints, whose positions a test sets."""

    def __init__(self, mode=Mode.INVERSE_DYNAMICS, continuous=False):
        self.q = np.array([0.0, 0.1, -0.4])
        self.now = 100 * NANO
        self.listeners = True
        self.log = []
        self.motions = ActiveMotion()
        limits = SimpleNamespace(lower=np.full(3, -3.0), upper=np.full(3, 3.0))
        if continuous:
            limits.lower[2] = -np.inf
            limits.upper[2] = np.inf
        robot = SimpleNamespace(model=SimpleNamespace(sliding=frozenset(NAMES[:2])),
                                coordinate_names=NAMES, limits=limits)
        self.controller = SimpleNamespace(mode=mode, robot=robot)
        path = SimpleNamespace(
            controller=self.controller, active_motion=self.motions,
            measured=lambda: None if self.q is None else self.q.copy())
        server = SimpleNamespace(create_timer=self._timer,
                                 destroy_timer=lambda timer: None)
        self.watch = DriftWatch(server, path, NAMES[1:], lambda: self.now,
                                lambda: self.listeners,
                                SimpleNamespace(warning=self.log.append))

    def _timer(self, period, callback, clock):
        self.examine = callback

    def after(self, seconds, *change):
        """Return the warning after a time in which the joints moved."""
        self.now += round(seconds * NANO)
        if change:
            self.q = self.q + change
        self.examine()
        return self.watch.warning


@pytest.mark.parametrize('mode', FOLLOWING)
def test_an_arm_that_sinks_without_a_motion_is_named_once_and_until_it_is_back(mode):
    rig = Rig(mode)
    assert rig.after(1.0) == ''
    assert rig.after(1.0, 0.0, 0.04, 0.15) == ''
    warning = rig.after(1.0, 0.0, 0.0, 0.1)
    assert warning.startswith(f"{mode}: joint 'elbow' is 0.25 rad from where it was")
    assert 'payload' in warning
    rig.after(1.0, 0.0, 0.03, 0.0)
    assert rig.watch.warning.startswith(
        f"{mode}: joint 'lift' is 0.07 m from where it was")
    assert rig.log == [warning]
    assert rig.after(1.0, 0.0, -0.03, -0.1) == ''


@pytest.mark.parametrize('mode', FOLLOWING)
def test_an_arm_is_compared_with_its_motion_and_with_its_end(mode):
    """The joints of a motion may have another order."""
    rig = Rig(mode)
    rig.after(1.0)
    motion = Motion.from_points([0.0, 2.0], [[-0.4, 0.1], [1.6, 0.1]],
                                joint_names=['elbow', 'lift'])
    assert rig.motions.follow(motion, rig.now, rig.now, rig.motions.generation)
    assert rig.after(1.0, 0.0, 0.0, 1.0) == ''
    assert rig.after(1.0, 0.0, 0.0, 1.0) == ''
    assert rig.after(9.0) == ''
    assert "joint 'elbow' is -0.5 rad from its motion" in rig.after(1.0, 0.0, 0.0, -0.5)
    rig.motions.clear('states timed out')
    assert rig.after(1.0) == ''


def test_a_base_without_motors_other_modes_and_arms_that_nothing_commands_may_move():
    rig = Rig()
    rig.after(1.0)
    assert rig.after(1.0, 3.0, 0.0, 0.0) == ''
    rig.listeners = False
    assert rig.after(1.0, 0.0, 0.0, 1.0) == ''
    rig.listeners = True
    assert rig.after(1.0) == ''
    rig.controller.mode = Mode.GRAVITY_COMPENSATION
    assert rig.after(1.0, 0.0, 0.0, 1.0) == ''
    rig.controller.mode = Mode.INVERSE_DYNAMICS
    assert rig.after(1.0) == '' and rig.after(1.0, 0.0, 0.0, 1.0) != ''
    # A mode that began since the last look has a place of its own.
    rig.controller.mode = Mode.COMPUTED_TORQUE
    assert rig.after(1.0, 0.0, 0.0, 1.0) == ''


def test_without_valid_states_and_after_an_activation_the_place_is_a_new_one():
    rig = Rig()
    rig.after(1.0)
    place = rig.q
    rig.q = None
    assert rig.after(1.0) == ''
    rig.q = place + 1.0
    assert rig.after(1.0) == ''
    rig.motions.clear('the node was activated')
    assert rig.after(1.0, 0.0, 1.0, 1.0) == ''
    assert rig.log == []


def test_whole_turns_of_a_continuous_joint_are_no_distance():
    """Drivers publish angles between -pi and pi; a motion goes on beyond pi."""
    turn = 2.0 * np.pi
    rig = Rig(continuous=True)
    rig.after(1.0)
    assert rig.after(1.0, 0.0, 0.0, -turn) == ''
    motion = Motion.from_points([0.0, 2.0], [[-0.4, 0.1], [3.6, 0.1]],
                                joint_names=['elbow', 'lift'])
    assert rig.motions.follow(motion, rig.now, rig.now, rig.motions.generation)
    rig.q = np.array([0.0, 0.1, 3.6 - turn])
    assert rig.after(2.0) == ''
    assert "joint 'elbow' is 0.3 rad from its motion" in rig.after(1.0, 0.0, 0.0, 0.3)
    assert rig.log == [rig.watch.warning]
