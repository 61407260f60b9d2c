"""Wrenches and payloads without declared frames, several a call, body Jacobians."""

from functools import cache
import pickle

from kane_dynamics import (Inertial, InputError, load_urdf, ModelError, ModelWarning,
                           point_mass, pose_from, power_balance, Robot)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.model.model import with_payload
from kinds_of_mechanism import case
from linkages import four_bar
import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
import pytest

LOAD = Inertial(2.0, (0.02, 0.0, 0.1), np.diag([0.02, 0.03, 0.02]))


@cache
def arm(**options):
    """Return the shipped six-axis arm."""
    return Robot(load_urdf(resource_path('urdf', 'ur10e.urdf')), **options)


def states(count=None):
    """Return q, u, udot and wrenches on the tool."""
    rng = np.random.default_rng(4)
    shape = () if count is None else (count,)
    return (*rng.uniform(-1.0, 1.0, (3, *shape, 6)), rng.normal(size=(*shape, 6)))


@pytest.mark.parametrize('count', [None, 3])
def test_a_wrench_by_name_acts_as_the_jacobian_says(count):
    q, u, udot, wrench = states(count)
    robot = arm()
    force = (np.swapaxes(robot.jacobian('tool0', q), -1, -2) @ wrench[..., None])[..., 0]
    tau = robot.inverse_dynamics(q, u, udot)
    assert_allclose(robot.inverse_dynamics(q, u, udot, wrench={'tool0': wrench}),
                    tau - force, atol=1e-12)
    assert_allclose(robot.external_force(q, wrench={'tool0': wrench}), force, atol=1e-12)
    assert_allclose(robot.forward_dynamics(q, u, tau - force, wrench={'tool0': wrench}),
                    udot, atol=1e-9)
    both = {'tool0': wrench, 'forearm_link': wrench}
    forearm = (np.swapaxes(robot.jacobian('forearm_link',
                                          q), -1, -2) @ wrench[..., None])[..., 0]
    assert_allclose(robot.external_force(q, wrench=both), force + forearm, atol=1e-12)


@pytest.mark.parametrize('kind', ['tree', 'chosen speeds', 'closed loop', 'nonholonomic',
                                  'time-dependent'])
@pytest.mark.parametrize('count', [None, 1, 3])
def test_the_power_of_a_wrench_is_the_same_in_every_form(kind, count):
    one = case(kind)
    robot = one.robot
    batch = () if count is None else (count,)
    state = [np.broadcast_to(x, (*batch, len(x))) for x in (one.q, one.u, one.udot)]
    wrench = np.random.default_rng(4).normal(size=(*batch, 6))
    velocity = robot.frame_velocity('tool', *state[:2], **one.t)
    expected = (wrench * velocity).sum(axis=-1)
    for form in (wrench, wrench[..., None, :], {'tool': wrench}):
        balance = power_balance(robot, *state, wrench=form, **one.t)
        assert_allclose(balance.external, expected, rtol=1e-12)
        assert_allclose(balance.residual, 0.0, atol=1e-7)


@pytest.mark.parametrize('count', [None, 3])
def test_derivatives_accept_a_wrench_of_a_single_frame(count):
    robot = arm(wrench_frames=('tool0',))
    q, u, udot, wrench = states(count)
    for form in (wrench, {'tool0': wrench}):
        slope = robot.derivative('inverse_dynamics', q, u, udot, by='q', wrench=form)
        by_rows = robot.derivative('inverse_dynamics', q, u, udot, by='q',
                                   wrench=wrench[..., None, :])
        assert_allclose(slope, by_rows, atol=1e-12)
        analytic = robot.inverse_dynamics_derivatives(q, u, udot, wrench=form)[0]
        assert_allclose(slope, analytic, atol=1e-9)


def test_a_wrench_by_name_equals_a_wrench_by_row():
    robot = arm(wrench_frames=('tool0',))
    q, u, udot, wrench = states()
    expected = robot.inverse_dynamics(q, u, udot, wrench=wrench[None])
    for form in (wrench, {'tool0': wrench}, list(wrench)):
        assert_array_equal(robot.inverse_dynamics(q, u, udot, wrench=form), expected)
    assert_array_equal(robot.inverse_dynamics(q, u, udot, wrench={}),
                       robot.inverse_dynamics(q, u, udot))
    q, u, udot, wrench = states(3)
    assert_array_equal(robot.inverse_dynamics(q, u, udot, wrench={}),
                       robot.inverse_dynamics(q, u, udot))
    assert_array_equal(robot.inverse_dynamics(q, u, udot, wrench=wrench),
                       robot.inverse_dynamics(q, u, udot, wrench=wrench[:, None]))
    base = robot.joint_reaction('shoulder_pan_joint', q[0], u[0], udot[0],
                                wrench={'tool0': wrench[0]})
    free = robot.joint_reaction('shoulder_pan_joint', q[0], u[0], udot[0])
    assert_allclose((base - free)[:3], -wrench[0, :3], atol=1e-10)


def test_kernels_of_other_frames_use_the_present_gravity_and_payload():
    robot = Robot(arm().model, payload_frame='tool0')
    q, u, udot, wrench = states()
    for gravity, payload in (((0, 0, -9.81), None), ((1, 2, 3), LOAD)):
        robot.parameters.gravity = gravity
        robot.parameters.payload = payload
        assert_allclose(
            robot.inverse_dynamics(q, u, udot, wrench={'forearm_link': wrench}),
            robot.inverse_dynamics(q, u, udot)
            - robot.jacobian('forearm_link', q).T @ wrench, atol=1e-12)


def test_wrenches_by_name_act_on_closed_loops():
    robot = four_bar('crank')
    q = robot.random_configuration(1)
    u = np.array([0.7])
    wrench = np.array([1.0, 0.0, 2.0, 0.0, 0.3, 0.0])
    frame = robot.frame_names[-1]
    assert_allclose(robot.external_force(q, wrench={frame: wrench}),
                    robot.jacobian(frame, q).T @ wrench, atol=1e-12)
    assert np.isfinite(robot.constraint_forces(q, u, u, wrench={frame: wrench})).all()


@pytest.mark.parametrize(('wrench', 'words'), [
    ({'tol0': np.zeros(6)}, "no frame 'tol0'"),
    ({'tool0': np.zeros(5)}, r"wrench of 'tool0': shape \(5,\); expected \(6,\)"),
    ({'tool0': np.zeros(6), 'forearm_link': np.zeros((2, 6))}, 'expected one shape'),
    (np.zeros((1, 6)), 'expected a mapping')])
def test_a_wrong_wrench_is_refused_by_name(wrench, words):
    q, u, udot, _ = states()
    with pytest.raises(InputError, match=words):
        arm().inverse_dynamics(q, u, udot, wrench=wrench)


def test_a_payload_at_any_frame_is_the_model_with_it():
    robot = arm()
    q, u, udot, _ = states()
    carrying = robot.with_payload('tool0', LOAD)
    model = with_payload(robot.model, 'tool0', LOAD)
    expected = Robot(model).inverse_dynamics(q, u, udot)
    assert_allclose(carrying.inverse_dynamics(q, u, udot), expected, rtol=1e-12)
    with_more = carrying.with_payload('forearm_link', point_mass(1.0))
    model = with_payload(model, 'forearm_link', point_mass(1.0))
    assert_allclose(with_more.inverse_dynamics(q, u, udot),
                    Robot(model).inverse_dynamics(q, u, udot), rtol=1e-12)
    empty = carrying.with_payload('tool0', None)
    assert_allclose(empty.inverse_dynamics(q, u, udot),
                    robot.inverse_dynamics(q, u, udot), rtol=1e-12)
    assert carrying.parameters.payload is LOAD


def test_payloads_at_two_frames_are_taken_off_one_by_one():
    robot = arm()
    q, u, udot, _ = states()
    part = point_mass(1.0)
    both = robot.with_payload('tool0', LOAD).with_payload('forearm_link', part)
    for two in (both, both.copy(), pickle.loads(pickle.dumps(both))):
        one = two.with_payload('tool0', None)
        expected = robot.with_payload('forearm_link', part)
        assert_allclose(one.inverse_dynamics(q, u, udot),
                        expected.inverse_dynamics(q, u, udot), rtol=1e-12)
        none = one.with_payload('forearm_link', None)
        assert_allclose(none.inverse_dynamics(q, u, udot),
                        robot.inverse_dynamics(q, u, udot), rtol=1e-12)


@pytest.mark.parametrize('moment', range(3))
def test_ten_parameters_with_a_first_moment_and_no_mass_are_refused(moment):
    parameters = np.zeros(10)
    parameters[1 + moment] = 0.1
    with pytest.raises(ModelError, match='without mass; expected a mass'):
        Inertial.from_parameters(parameters)


def test_impossible_payloads_are_refused_and_far_ones_warned_of():
    with pytest.raises(InputError, match='principal moments of inertia are'):
        arm().with_payload('tool0', Inertial(1.0, (0, 0, 0), np.diag([1.0, 0.1, 0.1])))
    with pytest.warns(ModelWarning,
                      match='center of mass 80 m from its frame.*expected m'):
        arm().with_payload('tool0', point_mass(1.0, at=(80.0, 0.0, 0.0)))


def test_the_body_jacobian_is_pinocchios_local_one():
    pin = pytest.importorskip('pinocchio')
    peer = pin.buildModelFromUrdf(str(resource_path('urdf', 'ur10e.urdf')))
    data = peer.createData()
    q, *_ = states()
    local = pin.computeFrameJacobian(peer, data, q, peer.getFrameId('tool0'),
                                     pin.ReferenceFrame.LOCAL)
    assert_allclose(arm().jacobian('tool0', q, axes='frame'), local, atol=1e-12)
    batch = arm().jacobian('tool0', np.stack([q, q]), axes='frame')
    assert_allclose(batch[1], local, atol=1e-12)
    with pytest.raises(InputError, match="axes: 'body'; expected 'world' or 'frame'"):
        arm().jacobian('tool0', q, axes='body')


def test_the_velocity_in_the_frames_axes_is_its_jacobian_times_the_speeds():
    rng = np.random.default_rng(2)
    q, u = rng.uniform(-1.0, 1.0, (2, 3, arm().n))
    J = arm().jacobian('tool0', q, axes='frame')
    expected = np.einsum('bij,bj->bi', J, u)
    got = arm().frame_velocity('tool0', q, u, axes='frame')
    assert_allclose(got, expected, atol=1e-12)
    out = np.empty(6)
    assert_allclose(arm().frame_velocity('tool0', q[0], u[0], axes='frame', out=out),
                    expected[0], atol=1e-12)
    assert_allclose(out, expected[0], atol=1e-12)
    with pytest.raises(InputError, match="axes: 'tool'; expected 'world' or 'frame'"):
        arm().frame_velocity('tool0', q, u, axes='tool')


def test_a_pose_of_roll_pitch_yaw_reaches_inverse_kinematics():
    assert pose_from((1, 2, 3), rpy=(0, 0, np.pi / 2))[:3] == pytest.approx(np.array(
        [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3]]))


def test_masked_entries_are_refused():
    with pytest.raises(InputError, match='q: a masked array with 1 masked entries'):
        arm().gravity_force(np.ma.masked_array(np.zeros(6), [0, 1, 0, 0, 0, 0]))


def test_limits_that_are_no_limits_are_refused():
    with pytest.raises(InputError, match=r'limits: \(-1, 1\); expected JointLimits'):
        Robot(arm().model).limits = (-1, 1)
