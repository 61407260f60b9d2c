"""The live watch over a model: windows of samples, alarms, and what is refused."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')
pytest.importorskip('kane_dynamics_interfaces')

from diagnostic_msgs.msg import DiagnosticStatus  # noqa: E402, I100
from kane_dynamics import Inertial, InputError, load_urdf, Robot  # noqa: E402
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.identification.model_watch import SMALLEST  # noqa: E402
from kane_dynamics.ros.monitor_node.model_watch_monitor import (  # noqa: E402
    ModelWatchMonitor)
from kane_dynamics.ros.monitor_node.torque_samples import TorqueSample  # noqa: E402
from node_values import monitor_values  # noqa: E402
from recordings import exciting  # noqa: E402

NANO = 10**9
NOISE = 0.02  # N m
LINK = 'link2'


def arm(factor=1.0):
    """Return the two-link arm with joint friction, scaled at the elbow."""
    model = load_urdf(resource_path('urdf', 'two_link.urdf'))
    bodies = []
    for k, body in enumerate(model.bodies):
        scale = factor if k == 1 else 1.0
        joint = replace(body.joint, damping=0.3 * scale, friction=0.5 * scale,
                        friction_backward=None)
        bodies.append(replace(body, joint=joint))
    return replace(model, bodies=tuple(bodies))


def measured(robot, seed, duration):
    """Return times, states and torques with noise of an arm along a random motion."""
    t, q, u, udot = exciting(robot.n, seed, duration=duration)
    noise = NOISE * np.random.default_rng(seed).normal(size=q.shape)
    return t, q, u, udot, robot.inverse_dynamics(q, u, udot) + noise


@pytest.fixture(scope='module')
def reference(tmp_path_factory):
    path = tmp_path_factory.mktemp('watch') / 'sound.npz'
    t, q, u, udot, tau = measured(Robot(arm()), 0, 20.0)
    np.savez(path, t=t, q=q, u=u, udot=udot, tau=tau)
    return str(path)


def node_parameters(reference, **changes):
    """Return the parameters of a node that watches over its model."""
    return monitor_values({'watch.reference': reference, 'watch.window': 10.0} | changes)


class Rig:
    """A monitor of the model without change, and an arm whose states it observes."""

    def __init__(self, reference, robot=None, **changes):
        values = node_parameters(reference, **changes)
        self.published = []
        self.rejected = []
        self.log = []
        self.robot = robot or Robot(arm())
        log = SimpleNamespace(warning=self.log.append, info=self.log.append)
        self.monitor = ModelWatchMonitor(
            self.robot, values, self.published.append, log,
            lambda *words: self.rejected.append(words))
        self.time = 100 * NANO

    def observe(self, robot, seed=1, duration=12.0):
        """Observe an arm in motion."""
        t, q, u, _, tau = measured(robot, seed, duration)
        for k in range(len(t)):
            stamp = self.time + round(t[k] * NANO)
            self.monitor.add(TorqueSample(stamp, q[k], u[k], tau[k]))
        self.time += round((t[-1] + 1.0) * NANO)


def test_the_usual_smallest_change_of_the_node_is_that_of_the_library():
    assert monitor_values({})['watch.smallest'] == SMALLEST


def test_a_sound_arm_has_no_alarm_and_more_friction_is_named_with_its_joint(reference):
    rig = Rig(reference)
    rig.observe(rig.robot, duration=10.1)
    assert len(rig.published) == 1
    assert rig.monitor.alarm is None
    assert rig.monitor.figures()['model watch'] == 'no change'
    assert [status.level for status in rig.published[0].status] == [
        DiagnosticStatus.OK] * 2
    rig.observe(Robot(arm(1.5)))
    elbow = rig.robot.joint_names[1]
    assert rig.monitor.alarm.startswith(f"joint '{elbow}': friction up, +")
    assert rig.monitor.alarm in rig.monitor.figures()['model watch']
    assert rig.log == [f'model watch: {rig.monitor.alarm}']
    status = rig.published[-1].status[1]
    assert (status.name, status.level) == (elbow, DiagnosticStatus.WARN)
    values = {pair.key: pair.value for pair in status.values}
    assert values['cause'] == 'friction'
    assert float(values['size']) == pytest.approx(0.5,
                                                  abs=3.0 * float(values['deviation']))
    # An arm that is sound again is so after a window.
    rig.observe(rig.robot, 2, 20.0)
    assert rig.monitor.alarm is None
    assert rig.log[-1] == 'model watch: the model describes the arm again'
    assert rig.rejected == []


def test_a_payload_that_the_node_does_not_know_is_an_alarm_and_a_known_one_is_none(
        reference):
    carried = Inertial(1.0, [0.0, 0.0, 0.1], 1e-2 * np.eye(3))
    robot = Robot(arm(), payload_frame=LINK)
    rig = Rig(reference, robot)
    loaded = Robot(arm(), payload_frame=LINK)
    loaded.parameters.payload = carried
    rig.observe(loaded)
    assert f"body '{LINK}': +1" in rig.monitor.alarm
    robot.parameters.payload = carried
    rig.monitor.on_loads_changed()
    rig.observe(loaded)
    assert rig.monitor.alarm is None


def test_an_arm_at_rest_fills_no_window(reference):
    rig = Rig(reference)
    for k in range(2000):
        still = np.zeros(2)
        rig.monitor.add(TorqueSample(rig.time + 10_000_000 * k, still, still, still))
    assert rig.published == []
    assert rig.monitor.figures() == {
        'model watch': 'no window yet; it fills while the arm moves'}


def test_rests_gaps_and_a_clock_set_back_leave_a_window_of_true_accelerations(reference):
    rig = Rig(reference)
    for seed in range(3, 6):  # with a second between the motions
        rig.observe(rig.robot, seed, 4.0)
    assert len(rig.published) == 1
    assert rig.monitor.alarm is None
    rig.time -= 20 * NANO
    rig.observe(rig.robot, 6, 12.0)
    assert rig.monitor.alarm is None
    assert rig.rejected == []


def test_references_that_do_not_fit_are_refused_with_the_reason(reference, tmp_path):
    with pytest.raises(InputError,
                       match=r"'watch.reference': 'none.csv'; expected the path"):
        Rig('none.csv')
    path = tmp_path / 'short.npz'
    t, q, u, udot, tau = (part[:50] for part in measured(Robot(arm()), 0, 20.0))
    np.savez(path, t=t, q=q, u=u, udot=udot, tau=tau)
    with pytest.raises(InputError,
                       match=r"'watch.reference': recording: 50 rows; expected"):
        Rig(str(path))
