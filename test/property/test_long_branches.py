"""Forward dynamics of trees with long branches: linear time, Kane's numbers."""

from dataclasses import replace

from definition import relative_error
from hypothesis import given, settings, strategies as st
from kane_dynamics import Inertial, InputError, ModelError, Robot, simulate
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.model.model import with_payload
from kane_dynamics.native.tracing.program import trace_program
from mechanisms import random_model, random_state
import numpy as np
import pytest
from test_joint_lanes import shuffled

EPS = np.finfo(float).eps


def arithmetic(robot, name):
    """Return the number of multiplications and additions of a quantity of one state."""
    count = robot.kernels.program(name, single=True).operation_count()
    return count.multiplications + count.additions


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 19), st.sampled_from([0.0, 0.3, 1.0]),
       st.sampled_from([0.0, 0.15, 0.6]))
def test_articulated_inertias_give_the_accelerations_of_the_definition(
        seed, n, prismatic, branching):
    model = shuffled(random_model(seed, n, prismatic=prismatic, branching=branching),
                     seed)
    q, u, tau = random_state(model, seed)
    expected = kane.forward_dynamics(model, q, u, tau)
    condition = np.linalg.cond(kane.mass_matrix(model, q))
    udot = TreeEquations(model).accelerations_by_articulated_inertias(
        q, u, tau, None, np.array(model.gravity))
    assert relative_error(udot.astype(float), expected) < 10.0 * EPS * condition


def test_a_long_tree_has_the_accelerations_of_the_definition_with_payload_and_wrench():
    model = shuffled(random_model(8, 45, branching=0.04), 8)
    robot = Robot(model, payload_frame='frame3', wrench_frames=['frame5'])
    payload = Inertial(2.0, np.array([0.1, 0.0, 0.2]), 0.01 * np.eye(3))
    robot.parameters.payload = payload
    q, u, tau = random_state(model, 5)
    wrench = np.array([[1.0, -2.0, 3.0, -4.0, 5.0, -6.0]])
    loaded = with_payload(model, 'frame3', payload)
    expected = kane.forward_dynamics(loaded, q, u, tau,
                                     wrenches={'frame5': (wrench[0, :3], wrench[0, 3:])})
    condition = np.linalg.cond(kane.mass_matrix(loaded, q))
    accelerations = robot.forward_dynamics(q, u, tau, wrench=wrench)
    assert relative_error(accelerations, expected) < 10.0 * EPS * condition


def test_arithmetic_of_accelerations_grows_linearly_and_that_of_matrices_as_they_do():
    short, long = (Robot(random_model(3, n, branching=0.0, prismatic=0.0, passive=False))
                   for n in (48, 96))
    growth = arithmetic(long, 'forward_dynamics') / arithmetic(short, 'forward_dynamics')
    assert growth < 2.05
    assert arithmetic(long, 'mass_matrix') < 4.0 * arithmetic(short, 'mass_matrix')


@pytest.mark.parametrize('n, branching, by_inertias', [
    (26, 0.6, False), (9, 0.0, False), (26, 0.0, True)])
def test_long_branches_alone_are_computed_by_articulated_inertias(
        n, branching, by_inertias):
    robot = Robot(random_model(8, n, branching=branching, passive=False))
    tree = robot.equations.tree
    program = robot.kernels.program('forward_dynamics')
    counts = []
    for method in (tree.accelerations_by_articulated_inertias, tree.forward_dynamics):
        def udot(q, u, tau, parameters, method=method):
            return method(q, u, tau, None, parameters)
        other = trace_program('udot', udot, program.inputs)
        counts.append(other.operation_count().multiplications)
    assert program.operation_count().multiplications == min(counts)
    assert (counts[0] < counts[1]) == by_inertias


def test_a_link_of_a_long_chain_without_inertia_about_its_joint_is_named():
    model = random_model(3, 30, branching=0.0, prismatic=0.0, passive=False)
    last = model.bodies[-1]
    rod = Inertial(1.0, np.zeros(3),
                   np.eye(3) - np.outer(last.joint.axis, last.joint.axis))
    thin = replace(model, bodies=(*model.bodies[:-1], replace(last, inertial=rod)))
    q, u, tau = random_state(model, 1)
    with pytest.raises(ModelError, match="joint 'joint29' moves no mass"):
        Robot(thin).forward_dynamics(q, u, tau)


@pytest.fixture(scope='module')
def long_chain():
    """Return a chain of more joints than quantities without subroutines have."""
    return Robot(random_model(4, 44, branching=0.0))


@pytest.mark.parametrize('count', [1, 8, 11])
def test_a_batch_of_a_long_chain_has_the_numbers_of_its_states(long_chain, count):
    states = np.random.default_rng(count).uniform(-1.0, 1.0, (3, count, long_chain.n))
    expected = np.array([long_chain.forward_dynamics(*state)
                         for state in states.transpose(1, 0, 2)])
    batch = long_chain.forward_dynamics(*states)
    assert relative_error(batch, expected) < 1e-10
    # In place: no state is computed again from its own result.
    q, u, tau = states
    long_chain.forward_dynamics(q, u, tau, out=tau)
    assert np.array_equal(tau, batch)


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_a_batch_of_a_long_chain_names_a_number_that_is_not_finite(long_chain, value):
    states = np.zeros((3, 9, long_chain.n))
    states[1, 8, 5] = value
    with pytest.raises(InputError,
                       match=r"u\[8, 5\] \(joint 'joint5'\): (nan|inf); expected"):
        long_chain.forward_dynamics(*states)


@pytest.mark.slow
def test_a_simulation_of_a_long_chain_has_the_accelerations_of_its_states(long_chain):
    q, u = np.random.default_rng(2).uniform(-0.3, 0.3, (2, long_chain.n))
    trajectory = simulate(long_chain, q, u, 0.02, step=1e-3)
    expected = long_chain.forward_dynamics(trajectory.q, trajectory.u,
                                           0.0 * trajectory.u)
    assert relative_error(trajectory.udot, expected) < 1e-10
    # The motion has these accelerations: differences over a step, of second order.
    slope = np.gradient(trajectory.u, trajectory.t, axis=0)[1:-1]
    middle = trajectory.udot[1:-1]
    assert np.abs(slope - middle).max() < 0.02 * np.abs(middle).max()
