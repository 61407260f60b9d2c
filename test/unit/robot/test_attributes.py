"""Promises of names: assignments without effect are refused; clear reprs."""

import copy
import pickle
import pydoc
from xml.etree import ElementTree

import kane_dynamics
from kane_dynamics import (CollisionDetector, ComputedTorque, Controller, frame_wrench,
                           Inertial, InputError, ModelBuilder, ModelWarning,
                           MomentumObserver, Motion, Robot, simulate)
from kane_dynamics.robot.parameters import JointLimits
from mechanisms import random_model
import numpy as np
import pytest

MODEL = random_model(7, 4, branching=0.0)
Q = np.array([0.3, -0.2, 0.5, 0.1])


def robot(**options):
    """Return an arm of four joints."""
    return Robot(MODEL, **options)


@pytest.mark.parametrize(('name', 'words'), [
    ('payload', 'no such attribute'), ('gravity', 'expected gravity_force'),
    ('friction', r'expected Robot\(..., friction=...\)'),
    ('speeds', r'expected Robot\(..., speeds=...\)'), ('model', 'not to be replaced'),
    ('joint_names', 'not to be replaced'), ('limts', 'expected limits')])
def test_an_attribute_that_would_have_no_effect_is_refused(name, words):
    arm = robot()
    with pytest.raises(AttributeError, match=f"'{name}' cannot be assigned.*{words}"):
        setattr(arm, name, 0.0)
    for duplicate in (copy.copy(arm), pickle.loads(pickle.dumps(arm))):
        with pytest.raises(AttributeError, match=f"'{name}' cannot be assigned"):
            setattr(duplicate, name, 0.0)


def test_limits_can_be_replaced_and_parameters_refuse_misspelt_names():
    arm = robot()
    arm.limits = JointLimits(*(np.full(4, x) for x in (-1.0, 1.0, 2.0, 3.0)))
    assert np.abs(arm.random_configuration(0, 100)).max() <= 1.0
    with pytest.raises(AttributeError):
        arm.parameters.gravty = (0.0, 0.0, 0.0)
    arm.parameters.gravity = (0.0, 0.0, 0.0)
    assert not arm.gravity_force(Q).any()


@pytest.mark.parametrize('call', [
    lambda arm: arm.jacobian(Q, 'frame3'), lambda arm: arm.jacobian_rate(Q, Q, 'frame3'),
    lambda arm: arm.frame_velocity(Q, Q, 'frame3'), lambda arm: arm.frame_pose(Q, 'x'),
    lambda arm: arm.operational_space_inertia(Q, 'frame3')])
def test_frame_and_q_in_the_wrong_order_are_named(call):
    with pytest.raises(InputError,
                       match=r'frame: a ndarray; expected a name \(str\) or a '
                       r'sequence of names: the order is \(frame, q\)'):
        call(robot())
    with pytest.raises(InputError,
                       match=r'joint: a ndarray; expected a name .*\(joint, q, u'):
        robot().joint_reaction(Q, Q, Q, 'joint0')


def test_the_frames_of_a_robot_are_those_of_its_model():
    arm = robot()
    assert arm.frame_names == tuple(frame.name for frame in MODEL.frames)


def test_computed_torque_takes_robot_then_motion_and_the_former_order_still_works():
    arm = robot()
    motion = Motion.from_points([0.0, 1.0], [Q, Q + 0.1], joint_names=arm.joint_names)
    new = ComputedTorque(arm, motion, kp=4.0, kd=3.0)
    for old in (lambda: ComputedTorque(motion, 4.0, 3.0),
                lambda: ComputedTorque(motion, 4.0, kd=3.0),
                lambda: ComputedTorque(motion, kp=4.0, kd=3.0)):
        with pytest.warns(DeprecationWarning,
                          match=r'expected ComputedTorque\(robot, motion'):
            former = old()
        assert former.motion is motion
        np.testing.assert_array_equal([former.kp, former.kd], [new.kp, new.kd])
        np.testing.assert_array_equal(simulate(arm, Q, 0 * Q, 0.02, torque=former).q,
                                      simulate(arm, Q, 0 * Q, 0.02, torque=new).q)
    for wrong in ((4.0, motion), (arm, 4.0), (arm,)):
        with pytest.raises(InputError, match='the order is'):
            ComputedTorque(*wrong)


def test_computed_torque_of_another_robot_than_the_simulated_one_is_refused():
    arm = robot(payload_frame='frame3')
    twin = robot(payload_frame='frame3')
    motion = Motion.from_points([0.0, 1.0], [Q, Q + 0.1], joint_names=arm.joint_names)
    torque = ComputedTorque(twin, motion)
    # It is equal, but another object.
    simulate(arm, Q, 0 * Q, 0.01, torque=torque)
    twin.parameters.payload = Inertial(1.0)
    with pytest.raises(InputError, match='computed torque of another robot'):
        simulate(arm, Q, 0 * Q, 0.01, torque=torque)


def test_the_torque_that_followed_a_motion_does_not_jump_at_its_end():
    arm = robot()
    motion = Motion.from_points([0.0, 0.2], [Q, Q + 0.1], joint_names=arm.joint_names)
    run = simulate(arm, Q, 0 * Q, 0.2, sample=1e-3, torque=ComputedTorque(arm, motion))
    steps = np.abs(np.diff(run.tau, axis=0)).max(axis=1)
    assert steps[-1] < 2.0 * steps[-3:-1].max()
    assert np.abs(
        run.tau[-1] - arm.gravity_force(run.q[-1])).max() > 0.1, 'it still brakes'


def test_a_wrench_is_exact_in_well_conditioned_arms_and_damping_is_reported():
    left, _, right = np.linalg.svd(np.random.default_rng(4).normal(size=(6, 6)))
    wrench = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])

    def jacobian(smallest):
        return (left * np.array([1.2, 1.0, 0.5, 0.3, 0.2, smallest]) @ right).T
    estimated_wrench = frame_wrench(jacobian(0.03), jacobian(0.03).T @ wrench,
                                    length=1.0)
    np.testing.assert_allclose(estimated_wrench.wrench, wrench, atol=1e-12)
    assert estimated_wrench.damped == 0
    assert estimated_wrench.residual is estimated_wrench.rest
    J = jacobian(0.004)
    with pytest.warns(ModelWarning,
                      match='1 of 6 directions damped.*0.004 m, damping 0.005 m'):
        estimated_wrench = frame_wrench(J, J.T @ wrench, length=1.0)
    assert estimated_wrench.damped == 1
    assert frame_wrench(
        J, J.T @ wrench, length=1.0, damping=0.01).damped == 1, 'without a word'
    with pytest.raises(InputError, match='damping: 0'):
        frame_wrench(J, J.T @ wrench, damping=0.0)


def owners():
    """Return an object of each public class that users read and assign to, by name."""
    arm = robot(payload_frame='frame3')
    motion = Motion.from_points([0.0, 1.0], [Q, Q + 0.1], joint_names=arm.joint_names)
    body = MODEL.bodies[0]
    return {'robot': arm, 'parameters': arm.parameters, 'motion': motion, 'model': MODEL,
            'controller': Controller(arm), 'observer': MomentumObserver(arm),
            'body': body,
            'detector': CollisionDetector(arm.joint_names, 5.0), 'joint': body.joint,
            'inertial': body.inertial, 'limits': arm.limits, 'builder': ModelBuilder(),
            'trajectory': simulate(arm, Q, 0 * Q, 0.01)}


OWNERS = owners()


@pytest.mark.parametrize('owner', OWNERS)
def test_assignment_of_a_misspelt_attribute_is_refused(owner):
    with pytest.raises(AttributeError, match='gravty'):
        OWNERS[owner].gravty = 1.0


@pytest.mark.parametrize(('owner', 'name', 'words'), [
    ('controller', 'kp', r'expected update\(kp=...\)'),
    ('controller', 'mode', r'expected update\(mode=...\)'),
    ('observer', 'gain', r'expected tune\(gain=...\)'),
    ('motion', 'positions', 'replaced')])
def test_assignment_without_effect_is_refused_with_the_way_to_change_it(
        owner, name, words):
    for instance in (OWNERS[owner], copy.copy(OWNERS[owner])):
        with pytest.raises(AttributeError,
                           match=f"'{name}' cannot be assigned: .*{words}"):
            setattr(instance, name, 1.0)


def test_entry_of_the_gravity_cannot_be_assigned_without_effect():
    with pytest.raises(ValueError, match='read-only'):
        robot().parameters.gravity[2] = 0.0


def test_objects_are_one_readable_line():
    arm = robot()
    motion = Motion.from_points([0.0, 1.0], [Q, Q + 1.0], joint_names=arm.joint_names)
    things = (*MODEL.bodies, *(body.joint for body in MODEL.bodies), *MODEL.frames,
              MODEL, arm,
              MODEL.bodies[0].inertial, arm.explain(Q, Q, Q), arm.explain([Q], [Q], [Q]),
              motion, simulate(arm, Q, Q, 0.01))
    for thing in things:
        text = repr(thing)
        assert text.startswith(f'<{type(thing).__name__}') and len(text) < 250
        assert '\n' not in text and 'array(' not in text
    assert repr(Inertial(2.0, (0, 0, 0.5), np.eye(3))) == (
        '<Inertial: 2 kg at [0.0, 0.0, 0.5] m, moments 1, 1, 1 kg m^2>')


def test_notebooks_show_tables_with_every_joint():
    arm = robot()
    motion = Motion.from_points([0.0, 1.0], [Q, Q + 1.0], joint_names=arm.joint_names)
    for thing in (MODEL, arm, motion, simulate(arm, Q, Q, 0.01), arm.explain(Q, Q, Q),
                  arm.explain([Q], [Q], [Q])):
        root = ElementTree.fromstring(f'<div>{thing._repr_html_()}</div>')  # well-formed
        rows = root.find('table').find('tbody').findall('tr')
        assert [row[0].text for row in rows] == list(MODEL.joint_names)
        assert len({len(row) for row in rows}) == 1
    fastest = float(motion._repr_html_().rpartition('<td>')[2].partition('<')[0])
    assert fastest == pytest.approx(1.5, rel=1e-3)  # of a cubic from rest to rest


@pytest.mark.parametrize('name', kane_dynamics.__all__)
def test_help_names_types_as_the_code_does(name):
    text = pydoc.plain(pydoc.render_doc(getattr(kane_dynamics, name)))
    assert 'numpy._typing' not in text and 'ndarray[tuple' not in text


def test_the_package_lists_its_names_and_version():
    extra = set(dir(kane_dynamics)) - set(kane_dynamics.__all__)
    assert not {'import_module', 'TYPE_CHECKING'} & extra
    assert all(hasattr(kane_dynamics, name) for name in dir(kane_dynamics))
    assert kane_dynamics.__version__.count('.') == 2
