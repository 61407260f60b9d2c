"""Promises of `Robot.copy`: one machine code, parameters of its own."""

from copy import copy
from dataclasses import replace
import pickle

from kane_dynamics import Coupling, Inertial, InputError, Robot
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.robot import kernel_set
from kane_dynamics.simulation.simulate import compile_simulation
from kane_dynamics.simulation.step_kernels import step_kernel
from mechanisms import random_model, random_state
import numpy as np
import pytest
from same_numbers import assert_same_numbers

MODEL = random_model(8, 3)
Q, U, UDOT = random_state(MODEL, 0)
PAYLOAD = Inertial(2.0, (0.1, 0.0, 0.2), 0.01 * np.eye(3))


@pytest.mark.parametrize('choices', [
    {}, {'payload_frame': 'frame1', 'wrench_frames': ['frame2']},
    {'constraints': [Coupling('joint2', {'joint0': 1.0})]}])
def test_a_copy_compiles_nothing_and_answers_the_same(monkeypatch, choices):
    robot = Robot(MODEL, **choices)
    names = ('inverse_dynamics', 'mass_matrix', 'forward_dynamics')
    robot.compile(*names, batches=True)
    q = robot.closed_configuration(Q) if robot.constraint_names else Q
    u = U[:robot.n]
    expected = [robot.inverse_dynamics(q, u, u), robot.mass_matrix(q),
                robot.forward_dynamics(q, u, u), robot.mass_matrix(np.array([q] * 9))]

    def refuse(*arguments, **options):
        raise AssertionError('compiled or loaded again')
    monkeypatch.setattr(kernel_set, 'trace_program', refuse)
    monkeypatch.setattr(llvm, 'Code', refuse)
    copied = robot.copy()
    answers = [copied.inverse_dynamics(q, u, u), copied.mass_matrix(q),
               copied.forward_dynamics(q, u, u), copied.mass_matrix(np.array([q] * 9))]
    assert all(np.array_equal(a, b) for a, b in zip(expected, answers))


def test_gravity_and_payload_of_a_copy_are_its_own():
    robot = Robot(MODEL, payload_frame='frame2')
    robot.gravity_force(Q)
    robot.parameters.payload = PAYLOAD
    torque_before = robot.gravity_force(Q).copy()
    copied = robot.copy()
    assert np.array_equal(copied.gravity_force(Q), torque_before)
    assert copied.parameters.payload is PAYLOAD
    copied.parameters.gravity = (0.0, 0.0, -1.62)
    copied.parameters.payload = None
    assert np.array_equal(robot.gravity_force(Q), torque_before)
    assert_same_numbers(robot.gravity_force(np.array([Q] * 5))[4], torque_before)
    alone = Robot(MODEL, payload_frame='frame2')
    alone.parameters.gravity = (0.0, 0.0, -1.62)
    assert np.array_equal(copied.gravity_force(Q), alone.gravity_force(Q))
    assert_same_numbers(copied.gravity_force(np.array([Q] * 5))[4],
                        alone.gravity_force(Q))
    robot.parameters.gravity = (0.0, 0.0, -3.7)
    assert np.array_equal(copied.gravity_force(Q), alone.gravity_force(Q))


def test_a_workspace_and_a_frame_of_a_copy_read_its_parameters():
    robot = Robot(MODEL)
    robot.bind().gravity_force()
    copied = robot.copy()
    copied.parameters.gravity = (1.0, 2.0, 3.0)
    expected = copied.gravity_force(Q).copy()
    work = copied.bind()
    work.q[:] = Q
    assert np.array_equal(work.gravity_force(), expected)
    assert np.array_equal(copied.frame_pose('frame1', Q), robot.frame_pose('frame1', Q))
    assert copied.limits.lower.shape == (3,)


def test_the_constants_of_steps_are_not_shared():
    robot = Robot(MODEL)
    compile_simulation(robot)
    kernel = step_kernel(robot, False)
    copied = step_kernel(robot.copy(), False)
    assert copied.address == kernel.address
    assert not np.shares_memory(copied.parameters, kernel.parameters)


def test_copies_and_pickles_keep_assigned_limits():
    robot = Robot(random_model(3, 3))
    robot.limits = replace(robot.limits, effort=np.array([1.0, 2.0, 3.0]))
    for duplicate in (robot.copy(), copy(robot), pickle.loads(pickle.dumps(robot))):
        np.testing.assert_array_equal(duplicate.limits.effort, [1.0, 2.0, 3.0])


@pytest.mark.parametrize('duplicated', [
    Robot.copy, copy, lambda robot: pickle.loads(pickle.dumps(robot)),
    lambda robot: robot.with_payload('frame2', None),
    lambda robot: robot.with_payload('frame1', None)])
def test_limits_of_a_copy_are_its_own(duplicated):
    robot = Robot(MODEL, payload_frame='frame2')
    robot.limits.effort[:] = 3.0
    other = duplicated(robot)
    other.limits.effort[:] = 5.0
    assert (robot.limits.effort == 3.0).all()
    robot.limits.effort[:] = 7.0
    assert (other.limits.effort == 5.0).all()


@pytest.mark.parametrize(('change', 'words'), [
    ({'effort': [1.0, np.nan, 1.0]}, r"limits.effort of joint 'joint1': nan; expected"),
    ({'velocity': [1.0, 1.0, -2.0]}, r"limits.velocity of joint 'joint2': -2.0; expec"),
    ({'lower': np.zeros(2)}, r'limits.lower: shape \(2,\); expected \(3,\), of joint0'),
    ({'upper': 'abc'}, "limits.upper: 'abc'; expected 3 numbers"),
    ({'lower': [0.0, 2.0, 0.0], 'upper': np.ones(3)},
     "limits of joint 'joint1': lower 2, upper 1; expected lower <= upper")])
def test_assigned_limits_are_checked(change, words):
    robot = Robot(random_model(3, 3))
    with pytest.raises(InputError, match=words):
        robot.limits = replace(robot.limits, **change)
