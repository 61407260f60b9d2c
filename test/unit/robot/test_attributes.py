"""Promises of names: misspelt ones are refused with a hint; clear reprs."""

import copy
import inspect
import pickle
import pydoc
import re
from xml.etree import ElementTree

import kane_dynamics
from kane_dynamics import (CollisionDetector, ComputedTorque, Controller, frame_wrench,
                           Inertial, InputError, inverse_kinematics, load_urdf,
                           ModelBuilder, ModelWarning, MomentumObserver, Motion, Robot,
                           simulate)
from kane_dynamics._util.attribute_hints import COUNTERPARTS, FUNCTIONS, MODEL_FUNCTIONS
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
    ('payload', 'expected robot.parameters.payload'),
    ('gravity', 'expected robot.parameters.gravity'),
    ('gravty', 'no such attribute'),
    ('friction', r'expected Robot\(..., friction=...\)'),
    ('speeds', r'expected Robot\(..., speeds=...\)'), ('model', 'not to be replaced'),
    ('joint_names', 'not to be replaced'), ('limts', 'expected robot.limits')])
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


@pytest.mark.parametrize(('name', 'ours'), [
    ('rnea', r'inverse_dynamics\(q, u, udot\)'), ('nv', 'n'), ('nq', 'n_q'),
    ('crba', 'mass_matr'),
    ('computeFrameJacobian', r'jacobian\(frame, q\)'), ('Jdot', 'jacobian_rate'),
    ('CalcMassMatrix', 'mass_matrix'), ('com', 'center_of_mass'),
    ('payload', 'parameters.payl'),
    ('jacobain', 'jacobian'), ('inverse_dynamic', 'inverse_dynamics')])
def test_a_name_of_another_library_is_answered_with_its_counterpart(name, ours):
    with pytest.raises(AttributeError,
                       match=f"has no attribute '{name}'; expected robot.{ours}"):
        getattr(robot(), name)


@pytest.mark.parametrize(('name', 'words'), [
    ('inverse_kinematics', r'kane_dynamics.inverse_kinematics\(robot, frame, target\)'),
    ('ik', r'kane_dynamics.inverse_kinematics\('),
    ('simulate', r'kane_dynamics.simulate\('),
    ('njoints', 'robot.n$'), ('jacobian_matrix', r'robot.jacobian\('),
    ('gravload', r'robot.gravity_force\(q\)'), ('rne', r'robot.inverse_dynamics\('),
    ('teach', r'kane_dynamics.view.Window\(robot\)'),
    ('plot', 'functions of kane_dynamics.plot'),
    ('fkine', r'robot.frame_pose\(frame, q\)'), ('mass', r'sum\(body.inertial.mass'),
    ('from_urdf', r'kane_dynamics.load_urdf\(path\), and Robot\(model\)')])
def test_a_method_of_another_library_is_answered_with_the_place_of_ours(name, words):
    with pytest.raises(AttributeError,
                       match=f"has no attribute '{name}'; expected .*{words}"):
        getattr(robot(), name)


@pytest.mark.parametrize(('name', 'words'), [
    ('buildModelFromUrdf', r'load_urdf\(path\)'), ('loadURDF', r'load_urdf\(path\)'),
    ('from_urdf', 'load_urdf'), ('ik', 'inverse_kinematics'),
    ('rnea', 'robot.inverse_dynamics'),
    ('simulat', 'expected simulate'), ('jacobian', r'robot.jacobian\(frame, q\)'),
    ('forward_kinematics', r'robot.frame_pose\(frame, q\)'),
    ('time_optimal', r'kane_dynamics.feasibility.time_optimal\('),
    ('load_xacro', r'load_urdf\(path\), which expands xacro')])
def test_names_of_other_libraries_in_the_package_are_answered(name, words):
    with pytest.raises(AttributeError,
                       match=f"module 'kane_dynamics' has no.*'{name}'.*{words}"):
        getattr(kane_dynamics, name)


@pytest.mark.parametrize(('name', 'words'), [
    ('with_payload', r'robot.with_payload\(frame, payload\)'),
    ('add_tool', r'kane_dynamics.with_tool\(model, on, name, inertial\)'),
    ('append', r'kane_dynamics.with_model\(model, other, on\)'),
    ('lock', r'kane_dynamics.with_locked\(model, positions\)'),
    ('rename', r'kane_dynamics.with_names\(model, names\)'),
    ('mass', r'sum\(body.inertial.mass'), ('nq', 'n$'), ('bodys', 'bodies$')])
def test_a_method_that_a_model_lacks_is_answered_with_the_function(name, words):
    with pytest.raises(AttributeError,
                       match=f"'Model' .* no attribute '{name}'; .*{words}"):
        getattr(MODEL, name)


@pytest.mark.parametrize('names', [FUNCTIONS, MODEL_FUNCTIONS])
def test_functions_that_hints_name_exist(names):
    for ours in names:
        call = re.match(r'(kane_dynamics|robot)\.([\w.]+)\(', ours)
        value = robot() if call and call[1] == 'robot' else kane_dynamics
        for part in call[2].split('.') if call else ():
            value = getattr(value, part)
        assert callable(value) or not call


@pytest.mark.parametrize(('call', 'words'), [
    (lambda: simulate(robot(), Q, Q, 1.0, dt=0.01),
     r"simulate\(\) .*'dt'; expected step="),
    (lambda: Robot(MODEL, payload_link='x'),
     r"Robot\(\) .*'payload_link'; expected payload_fr"),
    (lambda: load_urdf('x', end_effector='y'),
     r"load_urdf\(\) .*'end_effector'; expected tip="),
    (lambda: load_urdf('x', floating_base=True), 'expected root_joint='),
    (lambda: inverse_kinematics(robot(), 'x', Q, tol=1.0), 'expected tolerance='),
    (lambda: Robot(MODEL, frictoin=False), 'expected friction='),
    (lambda: simulate(robot(), Q, Q, 1.0, xyzzy=1), 'expected some of robot, q0, u0')])
def test_keywords_of_other_libraries_are_answered_with_ours(call, words):
    with pytest.raises(TypeError, match=words):
        call()


def test_errors_of_python_name_the_class_that_users_know():
    with pytest.raises(TypeError, match=r'Robot\.jacobian\(\) takes 3 positional'):
        robot().jacobian('frame3', Q, Q)
    with pytest.raises(AttributeError,
                       match=r"'Robot' has no attribute 'from_urdf'; expected"):
        _ = Robot.from_urdf


def test_every_counterpart_exists_and_a_strange_name_gets_no_wrong_hint():
    arm = robot()
    for ours in COUNTERPARTS:
        value = arm
        for part in ours.partition('(')[0].split('.'):
            value = getattr(value, part)
    names = [name for names in COUNTERPARTS.values() for name in names.split()]
    assert len(set(names)) == len(names)
    with pytest.raises(AttributeError, match=r"has no attribute 'xyzzy'\Z"):
        getattr(arm, 'xyzzy' + '')
    assert not hasattr(arm, '__array__')


@pytest.mark.parametrize('call', [
    lambda arm: arm.jacobian(Q, 'frame3'), lambda arm: arm.jacobian_rate(Q, Q, 'frame3'),
    lambda arm: arm.frame_velocity(Q, Q, 'frame3'), lambda arm: arm.frame_pose(Q, 'x'),
    lambda arm: arm.operational_space_inertia(Q, 'frame3')])
def test_frame_and_q_in_the_wrong_order_are_named(call):
    with pytest.raises(InputError,
                       match=r'frame: a ndarray; expected a name \(str\): the order '
                       r'is \(frame, q\)'):
        call(robot())
    with pytest.raises(InputError,
                       match=r'joint: a ndarray; expected a name .*\(joint, q, u'):
        robot().joint_reaction(Q, Q, Q, 'joint0')


def test_the_frames_of_a_robot_are_those_of_its_model():
    arm = robot()
    assert arm.frame_names == tuple(frame.name for frame in MODEL.frames)


def test_objects_print_on_one_short_line_with_their_name_and_joints():
    arm = robot()
    motion = Motion.from_points([0.0, 1.0], [Q, Q + 0.1], joint_names=arm.joint_names)
    run = simulate(arm, Q, 0 * Q, 0.01)
    many = simulate(arm, np.stack([Q, Q]), np.zeros((2, 4)), 0.01)
    joints = 'joint0, joint1, joint2, joint3>'
    assert repr(arm) == f"<Robot 'random7': 4 degrees of freedom, q of {joints}"
    assert repr(MODEL) == f"<Model 'random7': 4 moving bodies on 'world', q of {joints}"
    assert repr(motion) == f'<Motion through 2 points in 1 s of {joints}'
    assert repr(run) == f'<Trajectory: 11 samples, 0 to 0.01 s, of {joints}'
    assert repr(many) == f'<Trajectory: 2 motions, 11 samples, 0 to 0.01 s, of {joints}'
    assert len(repr(Robot(random_model(1, 40)))) < 200


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


@pytest.mark.parametrize(('owner', 'name', 'ours'), [
    ('robot', 'paramters', 'robot.parameters'),
    ('robot', 'gravty', 'robot.parameters.gravity'),
    ('parameters', 'gravty', 'gravity'), ('parameters', 'paylod', 'payload'),
    ('trajectory', 'tourque', 'tau'), ('trajectory', 'velocities', 'u'),
    ('motion', 'time', 'times'), ('motion', 'joint_name', 'joint_names'),
    ('controller', 'compensat', 'compensate'), ('observer', 'tourque', 'torque'),
    ('detector', 'colision', 'collision'), ('joint', 'dampng', 'damping'),
    ('inertial', 'mas', 'mass'), ('body', 'inertia', 'inertial'),
    ('model', 'frams', 'frames'),
    ('limits', 'velocty', 'velocity'), ('builder', 'gravty', 'gravity')])
def test_misspelt_attribute_is_refused_with_the_right_one(owner, name, ours):
    with pytest.raises(AttributeError,
                       match=f"has no attribute '{name}'; expected {ours}$"):
        getattr(OWNERS[owner], name)
    with pytest.raises(AttributeError,
                       match=f"'{name}' cannot be assigned.*; expected {ours}$"):
        setattr(OWNERS[owner], name, 1.0)


@pytest.mark.parametrize(('owner', 'name', 'words'), [
    ('controller', 'kp', r'expected update\(kp=...\)'),
    ('controller', 'mode', r'expected update\(mode=...\)'),
    ('observer', 'gain', r'expected tune\(gain=...\)'),
    ('motion', 'positions', 'replaced'),
    ('inertial', 'mass', r'expected dataclasses.replace\(..., mass=...\)')])
def test_assignment_without_effect_is_refused_with_the_way_to_change_it(
        owner, name, words):
    for instance in (OWNERS[owner], copy.copy(OWNERS[owner])):
        with pytest.raises(AttributeError,
                           match=f"'{name}' cannot be assigned: .*{words}"):
            setattr(instance, name, 1.0)


def test_entry_of_the_gravity_cannot_be_assigned_without_effect():
    with pytest.raises(ValueError, match='read-only'):
        robot().parameters.gravity[2] = 0.0


def test_parameters_print_on_one_line_with_gravity_and_payload():
    arm = robot(payload_frame='frame3')
    assert repr(robot().parameters) == (
        f'<Parameters: gravity {MODEL.gravity.tolist()} m/s^2>')
    assert repr(arm.parameters).endswith(', no payload>')
    arm.parameters.payload = Inertial(2.0, (0.0, 0.0, 0.1))
    assert repr(arm.parameters).endswith(
        ", payload 2 kg at [0.0, 0.0, 0.1] m of 'frame3'>")


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


def test_help_and_editors_show_the_arguments_of_the_constructor():
    names = tuple(inspect.signature(Robot).parameters)
    assert names[:4] == ('model', 'speeds', 'constraints', 'independent')
    assert 'payload_frame' in names
    text = pydoc.plain(pydoc.render_doc(Robot))
    # One argument a line from 3.14 on.
    assert re.search(r'\|  Robot\((\n \| +)?model: ', text)
