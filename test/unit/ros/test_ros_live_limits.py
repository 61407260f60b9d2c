"""An active arm refuses parameters that it would not survive."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics import load_urdf, Robot  # noqa: E402, I100
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.errors import InputError  # noqa: E402
from kane_dynamics.ros.dynamics_node.live_limits import check_live_limits  # noqa: E402
from kane_dynamics.ros.parameters.parameter_checks import read  # noqa: E402
from kane_dynamics.ros.parameters.parameter_table import BY_NAME  # noqa: E402
from node_values import node_values  # noqa: E402

ROBOT = Robot(load_urdf(resource_path('urdf', 'fr3.urdf')))
N = ROBOT.n
Q = ROBOT.random_configuration(3, 1)[0]
HOLDING = np.abs(ROBOT.gravity_force(Q))
SPEED = 0.15
VALUES = node_values({})


def refusal(name, value, *, running=True, moving=False, arm_compensates=('none',),
            before=None):
    """Return why an active arm refuses a limit; empty if it takes it."""
    path = SimpleNamespace(
        running=running, period=0.002, measured=lambda: Q,
        measured_speeds=lambda: np.full(N, SPEED),
        active_motion=SimpleNamespace(scheduled=(object() if moving else None, None)))
    default = BY_NAME[name].default
    present = VALUES | {'arm_compensates': arm_compensates,
                        name: read(BY_NAME[name], default if before is None else before)}
    try:
        check_live_limits(path, ROBOT, present,
                          present | {name: read(BY_NAME[name], value)}, {name})
    except InputError as error:
        return str(error)
    return ''


@pytest.mark.parametrize('name', ['limits.effort', 'limits.velocity', 'limits.rate'])
def test_limits_near_zero_are_refused_while_active(name):
    assert 'expected at least' in refusal(name, 1e-300)
    assert f"parameter '{name}'" in refusal(name, 1e-300)
    assert not refusal(name, 1e-300, running=False)
    assert not refusal(name, math.inf)


def test_the_effort_limit_holds_the_arm_where_it_is():
    enough = (1.01 * HOLDING + 1.0).tolist()
    assert not refusal('limits.effort', enough)
    joint = int(HOLDING.argmax())
    weak = list(enough)
    weak[joint] = 0.99 * HOLDING[joint]
    words = refusal('limits.effort', weak)
    assert f"joint '{ROBOT.joint_names[joint]}'" in words
    assert 'the torque that holds the arm' in words
    # An arm that holds its weight itself needs no torque for it.
    assert not refusal('limits.effort', weak, arm_compensates=('gravity',))


def test_the_speed_limit_is_above_the_present_speed():
    assert 'the present speed' in refusal('limits.velocity', 0.99 * SPEED)
    assert not refusal('limits.velocity', 1.01 * SPEED)


@pytest.mark.parametrize(('name', 'limit'), [('limits.effort', 80.0),
                                             ('limits.velocity', 0.19)])
def test_no_limit_falls_while_a_motion_is_followed(name, limit):
    assert not refusal(name, limit)
    assert 'while a motion is followed' in refusal(name, limit, moving=True)
    assert not refusal(name, math.inf, moving=True)


def test_a_limit_that_is_too_small_already_may_grow():
    weak = (0.5 * HOLDING + 1.0).tolist()
    stronger = (0.6 * HOLDING + 1.0).tolist()
    assert 'the torque that holds the arm' in refusal('limits.effort', weak)
    assert not refusal('limits.effort', stronger, before=weak)
    assert refusal('limits.effort', weak, before=stronger)


@pytest.mark.parametrize(('name', 'bad', 'good', 'words'), [
    ('state_timeout', 0.0039, 0.0041, 'two periods of its states'),
    ('gravity', [0.0, 0.0, -4.8], [0.0, 0.0, -4.82], 'in one request')])
def test_neither_time_nor_weight_of_an_active_arm_jumps(name, bad, good, words):
    assert words in refusal(name, bad)
    assert not refusal(name, good)
    assert not refusal(name, bad, running=False)
