"""The momentum observer: a low-pass of the external torque; alarms are earned."""

from functools import cache
from itertools import pairwise
import math

from kane_dynamics import absolute_rates, ModelBuilder, Motion, Robot, rod, simulate
from kane_dynamics.analysis.power_balance import power_balance
from kane_dynamics.control.collision_detection import CollisionDetector, frame_wrench
from kane_dynamics.control.friction_error import FrictionError
from kane_dynamics.control.momentum_observer import MomentumObserver
from kane_dynamics.errors import InputError
from kane_dynamics.model.inertial import Inertial
from mechanisms import random_model, random_state, with_joints
import numpy as np
import pytest

GAIN = 30.0


@cache
def robot(friction=False):
    """Return a robot; friction that turns in one step would hide the order."""
    return Robot(random_model(5, 4), wrench_frames=('frame3', 'frame1'),
                 friction=friction)


@cache
def motion():
    generator = np.random.default_rng(1)
    return Motion.from_points(np.linspace(0.0, 2.0, 9),
                              generator.uniform(-1.5, 1.5, (9, 4)),
                              joint_names=robot().joint_names)


def wrench(t):
    return np.array([[3.0, -2.0, 4.0, 1.0, -0.5, 0.3],
                     [0.0, 1.0, 0.0, 0.2, 0.0, 0.0]]) * (
                         math.sin(9.0 * t))


def sample(t):
    """Return state, actuator torque and true external torque under wrenches."""
    q, u, udot = motion().sample(t)
    external = robot().external_force(q, wrench=wrench(t))
    return q, u, robot().inverse_dynamics(q, u, udot, wrench=wrench(t)), external


def filtered(times):
    """Return the external torque behind the low-pass, on a hundredfold finer grid."""
    r = np.zeros(4)
    out = [np.zeros(4)]
    for start, end in pairwise(times):
        fine = np.linspace(start, end, 101)
        for a, b in pairwise(fine):
            keep = math.exp(-GAIN * (b - a))
            r = keep * r + (1.0 - keep) * sample(0.5 * (a + b))[3]
        out.append(r)
    return np.array(out)


def estimate(observer, times):
    return np.array([observer.update(t, *sample(t)[:3]) for t in times])


def test_the_estimate_is_the_low_passed_external_torque_to_second_order_in_the_step():
    generator = np.random.default_rng(0)
    # Between two points of the spline, whose third derivative jumps there.
    coarse = 0.26 + np.concatenate(
        [[0.0], np.cumsum(generator.uniform(0.002, 0.008, 40))])
    fine = np.sort(np.concatenate([coarse, 0.5 * (coarse[1:] + coarse[:-1])]))
    expected = filtered(coarse)
    first = estimate(MomentumObserver(robot(), gain=GAIN), coarse)
    second = estimate(MomentumObserver(robot(), gain=GAIN), fine)[::2]
    errors = np.abs(first - expected).max(), np.abs(second - expected).max()
    assert errors[0] < 0.03 * np.abs(expected).max()
    assert 3.0 < errors[0] / errors[1] < 5.5


def test_a_known_external_torque_that_is_added_leaves_nothing():
    observer = MomentumObserver(robot(), gain=GAIN)
    for t in np.arange(0.0, 1.0, 0.002):
        q, u, tau, external = sample(t)
        assert np.abs(observer.update(t, q, u, tau + external)).max() < 0.02
    assert np.abs(external).max() > 1.0


def estimate_at_rest(observer, t, extra):
    """Hold the robot at rest against an external torque."""
    q = np.full(4, 0.3)
    return observer.update(t, q, np.zeros(4), robot().bias_force(q, np.zeros(4)) - extra)


@pytest.mark.parametrize('held', [False, True])
def test_a_constant_external_torque_is_found_after_the_time_constant_with_its_sign(held):
    observer = MomentumObserver(robot(), gain=GAIN, held=held)
    push = np.array([1.0, -2, 3, 4])
    generator = np.random.default_rng(2)
    t = 5.0
    estimate_at_rest(observer, t, push)
    while t < 5.0 + 1.0 / GAIN:
        t += generator.uniform(1e-4, 5e-3)
        estimate = estimate_at_rest(observer, t, push)
    np.testing.assert_allclose(estimate, push * -math.expm1(-GAIN * (t - 5.0)),
                               rtol=1e-9)


def test_a_held_command_acts_until_the_next_sample_and_no_longer():
    observer = MomentumObserver(robot(), gain=GAIN, held=True)
    none = np.zeros(4)
    push = np.full(4, 2.0)
    estimate_at_rest(observer, 0.0, push)
    estimate = estimate_at_rest(observer, 0.01, none)
    np.testing.assert_allclose(estimate, push * -math.expm1(-GAIN * 0.01), rtol=1e-9)
    np.testing.assert_allclose(estimate_at_rest(observer, 0.02, none),
                               estimate * math.exp(-GAIN * 0.01), rtol=1e-9)


@pytest.mark.parametrize('jump', [0.2, -0.01])
def test_the_observer_restarts_after_a_gap_or_a_jump_back_in_time(jump):
    observer = MomentumObserver(robot(), gain=GAIN, max_gap=0.1)
    push = np.ones(4)
    for t in (0.0, 0.05, 0.1):
        estimate = estimate_at_rest(observer, t, push)
    assert (estimate_at_rest(observer, 0.1, 9.0 * push) == estimate).all()
    assert estimate.all()
    assert not estimate_at_rest(observer, 0.1 + jump, push).any()
    np.testing.assert_allclose(estimate_at_rest(observer, 0.15 + jump, push),
                               push * -math.expm1(-GAIN * 0.05), rtol=1e-9)


def test_an_announced_payload_is_no_external_torque():
    carrier = Robot(robot().model, payload_frame='frame3', friction=False)
    observer = MomentumObserver(carrier, gain=GAIN)
    for k in range(400):
        t = 0.1 + 0.002 * k
        q, u, udot = motion().sample(t)
        if k == 200:
            carrier.parameters.payload = Inertial(2.0, np.array([0.1, 0.0, 0.2]),
                                                  np.eye(3) * 0.1)
            observer.refresh()
        estimate = observer.update(t, q, u, carrier.inverse_dynamics(q, u, udot))
        # One interval in which the torque of before meets the payload of after.
        assert np.abs(estimate).max() < (0.02 if k < 200 else 4.0), k
    assert np.abs(estimate).max() < 0.02


@pytest.mark.parametrize(('words', 'values'), [
    ('t: nan', {'t': math.nan}), ('q', {'q': [0.0, math.nan, 0, 0]}),
    ('u: shape', {'u': [0.0]}), ('tau: .*inf', {'tau': [0.0, 0, 0, math.inf]})])
def test_an_invalid_sample_is_refused_and_the_observer_restarts(words, values):
    observer = MomentumObserver(robot(), gain=GAIN)
    estimate_at_rest(observer, 0.0, np.ones(4))
    assert estimate_at_rest(observer, 0.05, np.ones(4)).all()
    with pytest.raises(InputError, match=words):
        observer.update(
            **{'t': 0.06, 'q': np.zeros(4), 'u': np.zeros(4), 'tau': np.zeros(4),
               **values})
    assert not observer.torque.any()
    assert not estimate_at_rest(observer, 0.06, np.ones(4)).any()


def test_invalid_arguments_of_the_observer_are_refused():
    with pytest.raises(InputError, match="gain of joint 'joint2': 0"):
        MomentumObserver(robot(), gain=[1.0, 1.0, 0.0, 1.0])
    with pytest.raises(InputError, match='max_gap: 0'):
        MomentumObserver(robot(), max_gap=0.0)


def detector(**settings):
    return CollisionDetector(('a', 'b', 'c'), [1.0, 2.0, math.inf], **{
        'confirm': 0.01, 'release': 0.5, 'clear': 0.1, **settings})


def flag_changes(flag, times, torque):
    return [flag.update(t, np.array(torque, dtype=float)) for t in times]


def test_an_alarm_needs_a_joint_beyond_its_threshold_for_long_enough():
    flag = detector()
    assert not any(flag_changes(flag, (0.0, 0.004, 0.008), (1.5, -5.0, 1e9)))
    assert flag.beyond == ('a', 'b')
    assert flag_changes(flag, (0.012,), (1.5, -5.0, 1e9)) == [True]
    assert (flag.collision, flag.joint) == (True, 'b')
    assert not any(flag_changes(flag, (0.013, 0.02), (1.5, -5.0, 0.0))), 'it rises once'


def test_single_bad_samples_raise_no_alarm():
    flag = detector()
    for k in range(100):
        assert not flag.update(0.004 * k, np.array([0.5, 9.0 * (k % 2), 0.0]))
        assert not flag.collision


def test_an_alarm_ends_when_all_torques_are_below_their_release_for_long_enough():
    flag = detector(confirm=0.0)
    assert flag_changes(flag, (0.0,), (0.0, 3.0, 0.0)) == [True]
    above_release = flag_changes(flag, np.arange(0.01, 1.0, 0.01), (0.6, 0.0, 0.0))
    assert not any(above_release)
    assert not any(flag_changes(flag, (1.0, 1.05, 1.09), (0.4, 0.9, 0.0)))
    assert not any(flag_changes(flag, (1.095,), (0.6, 0.0, 0.0))), 'not calm in between'
    assert flag_changes(flag, (1.1, 1.15, 1.21), (0.4, 0.9, 0.0)) == [False, False, True]
    assert (flag.collision, flag.joint) == (False, None)


def test_a_backward_jump_of_the_clock_restarts_the_timers_of_an_alarm():
    flag = detector()
    assert not any(flag_changes(flag, (100.0,), (1.5, 0.0, 0.0)))
    assert flag_changes(flag, (50.0, 50.02), (1.5, 0.0, 0.0)) == [False, True]
    assert not any(flag_changes(flag, (100.0,), (0.0, 0.0, 0.0)))
    assert flag_changes(flag, (50.0, 50.2), (0.0, 0.0, 0.0)) == [False, True]


@pytest.mark.parametrize(('words', 'settings'), [
    ('confirm: -1', {'confirm': -1.0}), ('clear: nan', {'clear': math.nan}),
    ('release: 0', {'release': 0.0}), ('release: 2', {'release': 2.0})])
def test_bad_settings_are_refused(words, settings):
    with pytest.raises(InputError, match=words):
        detector(**settings)
    with pytest.raises(InputError, match="threshold of joint 'a': 0"):
        CollisionDetector(('a', 'b'), [0.0, 1.0])


def test_a_wrench_at_the_frame_is_recovered_where_the_arm_feels_all_of_it():
    J = np.random.default_rng(4).normal(size=(6, 7))
    wrench = np.array([5.0, -3.0, 2.0, 0.4, 0.1, -0.7])
    estimated_wrench = frame_wrench(J, J.T @ wrench)
    np.testing.assert_allclose(estimated_wrench.wrench, wrench, rtol=1e-9)
    assert estimated_wrench.seen == 6
    np.testing.assert_allclose(estimated_wrench.rest, 0.0, atol=1e-9)
    elsewhere = np.linalg.svd(J)[2][6] * 2.0  # a torque that no wrench there can cause
    estimated_wrench = frame_wrench(J, J.T @ wrench + elsewhere)
    np.testing.assert_allclose(estimated_wrench.wrench, wrench, rtol=1e-9)
    np.testing.assert_allclose(estimated_wrench.rest, elsewhere, atol=1e-9)


def test_near_a_singular_configuration_the_unseen_direction_is_small_and_smooth():
    left, _, right = np.linalg.svd(np.random.default_rng(4).normal(size=(7, 6)),
                                   full_matrices=False)
    sizes = []
    for smallest in (0.0, 1e-6, 0.049999, 0.050001):
        J = (left * np.array([2.0, 1.5, 1.0, 0.9, 0.8, smallest]) @ right).T
        estimated_wrench = frame_wrench(J, np.ones(7), length=1.0, damping=0.05)
        assert estimated_wrench.seen == (6 if smallest > 0.05 else 5)
        sizes.append(np.abs(right[5] @ estimated_wrench.wrench))
    assert sizes[0] == pytest.approx(0.0, abs=1e-12)
    assert sizes[1] < 1e-3
    assert sizes[2] == pytest.approx(sizes[3], rel=1e-3)


@pytest.mark.parametrize('seed', range(5))
def test_power_balances_on_any_motion(seed):
    rough = robot(friction=True)
    q, u, udot = random_state(rough.model, seed)
    loads = np.random.default_rng(seed).normal(size=(2, 6))
    power = power_balance(rough, q, u, udot, wrench=loads)
    whole = max(map(abs, power))
    assert abs(power.residual) < 1e-9 * whole
    assert power.friction > 0.0
    still = power_balance(rough, q, 0.0 * u, udot)
    assert still.joints == 0.0
    assert abs(still.residual) < 1e-9 * whole


BRISTLES = {'friction': 2.0, 'presliding_stiffness': 200.0}
LUGRE = {**BRISTLES, 'breakaway_friction': 3.0, 'stribeck_speed': 0.05, 'damping': 0.3,
         'presliding_damping': 1.0}


def hinges(law):
    """Return two hinges in a vertical plane, whose friction has bristles."""
    builder = ModelBuilder('hinges')
    builder.body('upper', axis=(0, -1, 0), inertial=rod(2.0, (0, 0, 0), (0.5, 0, 0)),
                 **law)
    builder.body('fore', 'upper', axis=(0, -1, 0), at=(0.5, 0, 0),
                 inertial=rod(1.0, (0, 0, 0), (0.4, 0, 0)), **law)
    return builder.model()


@pytest.mark.parametrize('law', [BRISTLES, LUGRE, {**BRISTLES, 'load_friction': 0.1}])
@pytest.mark.parametrize('coupled', [False, True])
def test_presliding_friction_is_no_external_torque(law, coupled):
    options = {'speeds': absolute_rates(hinges(law))} if coupled else {}
    arm = Robot(hinges(law), **options)

    def torque(t, q, u):
        pull = 4.0 * np.array([math.sin(3.0 * t), 0.6 * math.sin(5.0 * t)])
        if coupled:
            pull = arm.generalized_force(pull, q)
        return arm.gravity_force(q) + pull
    run = simulate(arm, np.array([0.3, -0.5]), np.zeros(2), 3.0,
                   torque=torque, step=1e-3)
    observer = MomentumObserver(arm, gain=50.0)
    rows = list(zip(run.t, run.q, run.u, run.tau))
    estimates = np.array([observer.update(*row) for row in rows])
    # Bristles begin without a deflection, as in the simulation.
    stiff = with_joints(arm.model, presliding_stiffness=0.0, presliding_damping=0.0)
    memoryless = MomentumObserver(Robot(stiff, **options), gain=50.0)
    wrong = np.array([memoryless.update(*row) for row in rows])
    assert np.abs(wrong).max() > 1.0
    assert np.abs(estimates).max() < 0.03 * np.abs(wrong).max()


@pytest.mark.parametrize('held', [False, True])
def test_load_friction_and_friction_beyond_the_model_are_no_part_of_a_held_command(held):
    builder = ModelBuilder('lift')
    builder.body('lift', kind='prismatic', axis=(0, 0, 1),
                 inertial=rod(2.0, (0, 0, 0), (0, 0, 1)),
                 friction=3.0, load_friction=0.1)
    lift = Robot(builder.model())
    beyond = FrictionError(['lift'], coulomb=1.5)
    observer = MomentumObserver(lift, held=held, friction_error=beyond)
    u = np.array([0.5])
    for k in range(50):
        t = 0.01 * k
        tau = lift.inverse_dynamics(u * t, u, np.zeros(1)) + beyond.torque(u)
        np.testing.assert_allclose(observer.update(t, u * t, u, tau), 0.0, atol=1e-9)
        if held:
            observer.hold(tau)
