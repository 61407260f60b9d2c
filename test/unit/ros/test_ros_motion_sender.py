"""`kane-dynamics send` sends a motion again that the node has checked too late."""

from types import SimpleNamespace

from kane_dynamics import InputError, Motion
from kane_dynamics.ros.common.motion_sender import _Sender, LATER_LEAD, LEAD
import numpy as np
import pytest

NAMES = ('joint1', 'joint2')
LATE = 'joint_trajectory rejected: end of the motion: 0.1 s ago'


def make(q):
    """Return a motion of 2 s from q."""
    return Motion.from_points([0.0, 2.0], [q, q + 0.3], np.zeros((2, 2)),
                              np.zeros((2, 2)), joint_names=NAMES)


class Sender(_Sender):
    """A sender without ROS: `answers` are the errors of the node, and their delay, s."""

    def __init__(self, *answers):
        self.answers = list(answers)
        self.leads = []
        self.time = 0
        self._names = NAMES
        self._topic = 'joint_states'
        self._node_name = 'kane_dynamics'
        self._states = [(0, np.zeros(2))]
        self._torques = 1
        self._errors = []
        self._warnings = []
        self.node = SimpleNamespace(count_publishers=lambda topic: 0)
        self._publisher = SimpleNamespace(publish=self.receive,
                                          get_subscription_count=lambda: 1)

    def receive(self, message):
        stamp = message.header.stamp
        self.start = stamp.sec * 10**9 + stamp.nanosec
        self.leads.append((self.start - self.time) * 1e-9)

    def _now(self):
        return self.time

    def _spin(self, seconds, enough):
        if enough():
            return
        error, delay = self.answers.pop(0)
        if error.startswith('joint_trajectory: '):
            self._warnings.append(error)
        elif error:
            self._errors.append(error)
        motion = make(np.zeros(2))
        for t in np.arange(0.0, delay, 0.01):
            q = np.zeros(2) if error else motion.sample(max(t - self.leads[-1], 0.0))[0]
            self._states.append((self.time + round(1e9 * t), q))
        self.time += round(1e9 * delay)


@pytest.mark.parametrize('late', [
    LATE, 'joint_trajectory: began 1.6 s ago, by its stamp; followed from that time on'])
def test_a_motion_that_is_checked_after_its_start_is_sent_again_with_more_time(late):
    sender = Sender((late, 3.0), ('', 8.0))
    tracking = sender.run(make)
    np.testing.assert_allclose(sender.leads, [LEAD, LATER_LEAD])
    assert tracking.largest_error.max() < 1e-2


@pytest.mark.parametrize('answer', [
    (LATE, 0.2),  # in time: the reason is another one
    ('joint states: position jumped', 1.5)])  # a motion that the arm makes already
def test_other_errors_end_the_command(answer):
    sender = Sender(answer)
    with pytest.raises(InputError, match=answer[0]):
        sender.run(make)
    assert len(sender.leads) == 1
