"""The algorithms that compute several joints in lanes give what those of one joint give."""

from dataclasses import replace

from definition import relative_error
from hypothesis import given, settings, strategies as st
from kane_dynamics import Inertial, Robot
from kane_dynamics.mechanics.joint_lanes.tree_in_lanes import TreeInLanes
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from mechanisms import random_model, random_state
import numpy as np
import pytest

LARGER = 26  # axes: one state is computed in lanes, a batch is not
GIVEN = {'inverse_mass_matrix': 1, 'coriolis_matrix': 2, 'inverse_dynamics_derivatives': 3,
         'regressor': 3}  # how many of q, u, udot


def shuffled(model, seed):
    """Return a model with its coordinates in another order than its bodies."""
    order = np.random.default_rng(seed).permutation(model.n)
    bodies = tuple(replace(body, joint=replace(body.joint, coordinate=int(
        order[body.joint.coordinate]))) for body in model.bodies)
    names = [model.coordinate_names[k] for k in np.argsort(order)]
    return replace(model, bodies=bodies, coordinate_names=tuple(names))


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 11), st.sampled_from([0.0, 0.3, 1.0]))
def test_numbers_in_lanes_are_those_of_single_joints(seed, n, prismatic):
    model = shuffled(random_model(seed, n, prismatic=prismatic), seed)
    equations = TreeEquations(model)
    assert TreeInLanes.suits(equations)
    parameters, states = np.array([0.3, -0.2, -9.8]), random_state(model, seed)
    for name, count in GIVEN.items():
        found = getattr(TreeInLanes(equations), name)(*states[:count], parameters)
        expected = getattr(equations, name)(*states[:count], parameters)
        tolerance = 1e-12 * (np.linalg.cond(equations.mass_matrix(
            states[0], parameters).astype(float)) if name == 'inverse_mass_matrix' else 1.0)
        assert relative_error(found.astype(float), expected.astype(float)) < tolerance, name


def test_a_coordinate_that_moves_several_bodies_has_no_lane():
    assert not TreeInLanes.suits(TreeEquations(random_model(3, 4, mimics=2)))


@pytest.mark.parametrize('name', GIVEN)
def test_one_state_in_lanes_is_a_state_of_a_batch(name):
    model = shuffled(random_model(8, LARGER, branching=0.6), 8)
    robot = Robot(model, payload_frame='frame3')
    robot.parameters.payload = Inertial(2.0, np.array([0.1, 0.0, 0.2]), 0.01 * np.eye(3))
    equations = robot.kernels.equations
    states = random_state(model, 5)
    found = getattr(robot, name)(*states[:GIVEN[name]])
    expected = getattr(equations, name)(*states[:GIVEN[name]], robot.parameters.block)
    condition = np.linalg.cond(robot.mass_matrix(states[0]))
    assert relative_error(found, expected.astype(float)) < (
        1e-14 * condition if name == 'inverse_mass_matrix' else 1e-11)
    if name == 'inverse_mass_matrix':
        assert np.array_equal(found, found.T)
    if name == 'inverse_dynamics_derivatives':
        assert np.array_equal(found[2], found[2].T)
