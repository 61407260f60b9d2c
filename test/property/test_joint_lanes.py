"""The algorithms that compute joints in lanes give what single joints give."""

from dataclasses import replace

from definition import relative_error
from hyperdual import seeded
from hypothesis import given, settings, strategies as st
from kane_dynamics import box, Inertial, ModelBuilder, Robot
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.mechanics.joint_lanes.tree_in_lanes import TreeInLanes
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.model.model import with_payload
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.native.tracing.wide import WideLanes
from kane_dynamics.robot import kernel_set
from kane_dynamics.robot.kernel_set import IN_LANES, method_in_lanes
from mechanisms import random_model, random_state, with_bodies
import numpy as np
import pytest

EPS = np.finfo(float).eps
LARGER = 26  # axes: one state is computed in lanes, a batch is not
GIVEN = {'mass_matrix': 1, 'inverse_mass_matrix': 1, 'coriolis_matrix': 2,
         'inverse_dynamics_derivatives': 3, 'forward_dynamics_derivatives': 3,
         'regressor': 3}  # how many of q, u, udot (or torque)
INVERSE = ('inverse_mass_matrix', 'forward_dynamics_derivatives')  # as accurate as M^-1


def shuffled(model, seed):
    """Return a model with its coordinates in another order than its bodies."""
    order = np.random.default_rng(seed).permutation(model.n)

    def renumbered(body):
        coordinate = int(order[body.joint.coordinate])
        return replace(body, joint=replace(body.joint, coordinate=coordinate))
    names = [model.coordinate_names[k] for k in np.argsort(order)]
    return replace(with_bodies(model, renumbered), coordinate_names=tuple(names))


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 11), st.sampled_from([0.0, 0.3, 1.0]))
def test_numbers_in_lanes_are_those_of_single_joints(seed, n, prismatic):
    model = shuffled(random_model(seed, n, prismatic=prismatic), seed)
    equations = TreeEquations(model)
    assert equations.has_simple_joints
    parameters = np.array([0.3, -0.2, -9.8])
    states = random_state(model, seed)
    for name, count in GIVEN.items():
        in_lanes = getattr(TreeInLanes(equations), name)(*states[:count], parameters)
        expected = getattr(equations, name)(*states[:count], parameters)
        M = equations.mass_matrix(states[0], parameters).astype(float)
        in_lanes = in_lanes.astype(float)
        expected = expected.astype(float)
        tolerance = 1e-12 * (np.linalg.cond(M) if name in INVERSE else 1.0)
        # The Coriolis matrix of one joint is the rounding of sums that cancel.
        zero = 4.0 * EPS * np.abs(M).max() * np.abs(states[1]).max()
        assert relative_error(in_lanes, expected) < tolerance or (
            name == 'coriolis_matrix' and np.abs(in_lanes - expected).max() < zero), name


def test_a_coordinate_that_moves_several_bodies_has_no_lane():
    assert not TreeEquations(random_model(3, 4, mimics=2)).has_simple_joints


@pytest.mark.parametrize('far', [0.0, 100.0])
def test_a_small_arm_far_from_the_origin_loses_no_digits(far):
    b = ModelBuilder('arm')
    on = 'world'
    for k, axis in enumerate(np.eye(3)):
        b.body(f'slide{k}', on, 'prismatic', axis=axis, at=(0.6 * far, 0, 0))
        on = f'slide{k}'
    for k in range(9):
        b.body(f'link{k}', on, axis=[(0, 0, 1), (0, 1, 0), (1, 0.3, 0)][k % 3],
               at=(0.02, 0, 0.01),
               inertial=box(0.01, (0.02, 0.01, 0.01), at=(0.01, 0, 0)))
        on = f'link{k}'
    equations = TreeEquations(b.model())
    parameters = np.array([0.3, -0.2, -9.8])
    states = random_state(b.model(), 0)
    states[:2, :3] += far
    in_lanes = TreeInLanes(equations).inverse_dynamics_derivatives(
        *states, parameters).astype(float)
    expected = equations.inverse_dynamics_derivatives(*states, parameters).astype(float)
    error = np.abs(in_lanes - expected).max(axis=2)
    assert (error <= 2e-14 * np.abs(expected).max(axis=2)).all()


@pytest.mark.parametrize('n', [4, 7, 9, pytest.param(8, marks=pytest.mark.slow),
                               pytest.param(16, marks=pytest.mark.slow)])
@pytest.mark.parametrize('name', IN_LANES)
def test_one_state_of_an_arm_is_a_state_of_a_batch(name, n):
    robot = Robot(shuffled(random_model(8, n, branching=0.3 * (n > 8)), 8),
                  payload_frame='frame3')
    robot.parameters.payload = Inertial(2.0, np.array([0.1, 0.0, 0.2]), 0.01 * np.eye(3))
    kernels = robot.kernels
    states = random_state(robot.model, 5)[:GIVEN[name]]
    wide = trace_program(name,
                         lambda *given: method_in_lanes(kernels.equations, name)(*given),
                         kernels.program(name).inputs)
    kernel = Kernel(name, lambda: wide, None, kernels.signature(name)[0],
                    robot.parameters.block, kernels.signature(name)[1])
    chosen = kernels.kernel(name)
    expected = chosen(*(np.stack([x, x]) for x in states))[0]
    condition = np.linalg.cond(robot.mass_matrix(states[0])) if name in INVERSE else 1.0
    for result in (kernel(*states), chosen(*states)):
        assert relative_error(result, expected) < 1e-13 * condition
        if name == 'forward_dynamics_derivatives':
            assert np.array_equal(result[2], result[2].T)


@pytest.mark.parametrize('n', [6, 7, 10])
def test_derivatives_in_lanes_are_those_of_the_definition(n):
    model = random_model(21, n, prismatic=0.2)
    equations = TreeEquations(model)
    q, u, tau = random_state(model, 3)
    parameters = np.array(model.gravity)
    none = np.zeros(n)
    udot = kane.forward_dynamics(model, q, u, tau)
    torque = kane.inverse_dynamics(model, seeded(q, none, 0, 2 * n),
                                   seeded(u, none, n, 2 * n), udot)
    slopes = np.array([x.gradient for x in torque])
    wide = TreeInLanes(equations)
    inverse = wide.inverse_dynamics_derivatives(q, u, udot, parameters).astype(float)
    M = kane.mass_matrix(model, q)
    assert relative_error(np.hstack(inverse[:2]), slopes) < 1e-11
    assert relative_error(inverse[2], M) < 1e-13
    forward = wide.forward_dynamics_derivatives(q, u, tau, parameters).astype(float)
    expected = np.linalg.solve(M, np.hstack([-slopes, np.eye(n)]))
    assert relative_error(np.hstack(forward), expected) < 1e-14 * np.linalg.cond(M)


@pytest.mark.parametrize('n, branching', [
    (32, 0.0), (29, 0.6), pytest.param(45, 0.3, marks=pytest.mark.slow)])
def test_derivatives_of_large_trees_are_those_of_the_definition(n, branching):
    model = shuffled(random_model(8, n, branching=branching), 8)
    robot = Robot(model, payload_frame='frame3')
    payload = Inertial(2.0, np.array([0.1, 0.0, 0.2]), 0.01 * np.eye(3))
    robot.parameters.payload = payload
    loaded = with_payload(model, 'frame3', payload)
    q, u, udot = random_state(model, 5)
    none = np.zeros(n)
    torque = kane.inverse_dynamics(loaded, seeded(q, none, 0, 2 * n),
                                   seeded(u, none, n, 2 * n), udot)
    slopes = np.array([x.gradient for x in torque])
    derivatives = robot.inverse_dynamics_derivatives(q, u, udot)
    assert relative_error(np.hstack(derivatives[:2]), slopes) < 1e-11
    assert relative_error(derivatives[2], kane.mass_matrix(loaded, q)) < 1e-13


@pytest.mark.parametrize('n, branching', [(32, 0.0), (45, 0.3)])
def test_coriolis_forces_of_large_trees_are_those_of_the_definition(n, branching):
    model = shuffled(random_model(8, n, branching=branching, passive=False), 8)
    q, u, _ = random_state(model, 5)
    without_gravity = replace(model, gravity=np.zeros(3))
    expected = kane.inverse_dynamics(without_gravity, q, u, np.zeros(n))
    # The matrix is not unique: its product with the rates is.
    assert relative_error(Robot(model).coriolis_matrix(q, u) @ u, expected) < 1e-11


def test_arms_compute_one_state_by_the_shorter_program(monkeypatch):
    robot = Robot(random_model(4, 7))
    name = 'inverse_dynamics_derivatives'
    plain = robot.kernels.program(name)
    counts = []
    for doubles in (8, 2):
        monkeypatch.setattr(kernel_set, 'width', lambda doubles=doubles: doubles)
        chosen = robot.kernels.program(name, single=True)
        assert chosen.instruction_count(doubles) <= plain.instruction_count(doubles)
        counts.append(any(node.op == 'pack' for node in chosen.schedule()))
    assert counts == [True, False]


@pytest.mark.parametrize('name', [name for name in GIVEN if name != IN_LANES[2]])
def test_one_state_in_lanes_is_a_state_of_a_batch(name):
    model = shuffled(random_model(8, LARGER, branching=0.6), 8)
    robot = Robot(model, payload_frame='frame3')
    robot.parameters.payload = Inertial(2.0, np.array([0.1, 0.0, 0.2]), 0.01 * np.eye(3))
    equations = robot.equations.tree
    states = random_state(model, 5)
    single = getattr(robot, name)(*states[:GIVEN[name]])
    expected = getattr(equations, name)(*states[:GIVEN[name]], robot.parameters.block)
    condition = np.linalg.cond(robot.mass_matrix(states[0]))
    assert relative_error(single, expected.astype(float)) < (
        1e-14 * condition if name == 'inverse_mass_matrix' else 1e-11)
    if name == 'inverse_mass_matrix':
        assert np.array_equal(single, single.T)
    if name == 'inverse_dynamics_derivatives':
        assert np.array_equal(single[2], single[2].T)


def chain_with_a_thin_rod():
    """Return a chain whose inverse needs the mass matrix: a pivot might vanish."""
    model = random_model(8, LARGER, branching=0.0)
    bodies = list(model.bodies)
    joint = replace(bodies[10].joint, kind='revolute', armature=0.0)
    across = np.eye(3) - np.outer(joint.axis, joint.axis)
    rod = Inertial(1.0, np.zeros(3), 0.01 * across)
    bodies[10] = replace(bodies[10], joint=joint, inertial=rod)
    return replace(model, bodies=tuple(bodies))


@pytest.mark.parametrize('order', ['of the bodies', 'shuffled'])
def test_inverse_mass_matrix_of_a_serial_chain_in_rows_is_that_of_the_definition(order):
    model = chain_with_a_thin_rod()
    model = shuffled(model, 8) if order == 'shuffled' else model
    robot = Robot(model, payload_frame='frame3')
    q = random_state(model, 5)[0]
    payload = Inertial(2.0, np.array([0.1, 0.0, 0.2]), 0.01 * np.eye(3))
    robot.parameters.payload = payload
    inverse = robot.inverse_mass_matrix(q)
    M = kane.mass_matrix(with_payload(model, 'frame3', payload), q)
    assert relative_error(inverse, np.linalg.inv(M)) < 1e-15 * np.linalg.cond(M)
    assert np.array_equal(inverse, inverse.T)


def test_inverse_mass_matrix_in_rows_takes_a_third_of_the_instructions():
    equations = Robot(random_model(8, LARGER, branching=0.0)).equations
    in_rows = TreeInLanes(
        equations.tree, lambda q: WideLanes(q.trace)).inverse_mass_matrix
    plain, rows = (trace_program('inverse', function, [('q', (LARGER,)), ('g', (3,))]
                                 ).instruction_count(8)
                   for function in (equations.inverse_mass_matrix, in_rows))
    assert 3 * rows < plain
