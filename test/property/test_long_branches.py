"""Forward dynamics of trees with long branches: linear time, Kane's numbers."""

from dataclasses import replace

from definition import relative_error
from hypothesis import given, settings, strategies as st
from kane_dynamics import box, Inertial, InputError, ModelBuilder, Robot, simulate
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.mechanics.joint_lanes.branches import branches
from kane_dynamics.mechanics.joint_lanes.tree_in_lanes import TreeInLanes
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.model.model import with_payload
from kane_dynamics.native.backends.llvm_scalar import module_text
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.runtime.loops import repeat
from mechanisms import random_model, random_state
import numpy as np
import pytest
from test_joint_lanes import shuffled

EPS = np.finfo(float).eps


def by_blocks(model, q, u, tau):
    """Return the accelerations by articulated inertias, without compiling."""
    tree = TreeInLanes(TreeEquations(model))
    return tree.forward_dynamics(q, u, tau, None, np.array(model.gravity)).astype(float)


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
    assert relative_error(by_blocks(model, q, u, tau), expected) < 10.0 * EPS * condition


def test_compiled_loops_over_branches_give_the_definition_with_payload_and_wrench():
    model = shuffled(random_model(8, 45, branching=0.04), 8)
    robot = Robot(model, payload_frame='frame3', wrench_frames=['frame5'])
    assert len(branches(robot.equations.tree.geometry)) > 2
    program = robot.kernels.program('forward_dynamics', single=True)
    assert any(node.op == 'loop' for node in program.schedule())

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


def growth(name):
    """Return how arithmetic and code grow from a chain of 48 joints to one of 96."""
    counts = []
    sizes = []
    for n in (48, 96):
        robot = Robot(random_model(3, n, branching=0.0, prismatic=0.0, passive=False))
        program = robot.kernels.program(name, single=True)
        count = program.operation_count()
        counts.append(count.multiplications + count.additions)
        sizes.append(llvm.code_size(module_text(program, 'kernel')))
    return counts[1] / counts[0], sizes[1] / sizes[0]


def test_arithmetic_grows_linearly_and_code_not_at_all():
    arithmetic, code = growth('forward_dynamics')
    assert arithmetic == 2.0
    assert code < 1.05


@pytest.mark.parametrize('name', ['mass_matrix', 'inverse_mass_matrix'])
def test_arithmetic_of_matrices_grows_as_they_do_and_code_hardly(name):
    arithmetic, code = growth(name)
    assert arithmetic < 4.0
    assert code < 1.15


def limbs_on_a_trunk():
    """Return a tree of two legs, and of two arms on a trunk, with principal axes."""
    b = ModelBuilder('humanoid')

    def limb(name, parent, joints):
        """Add joints in series, and return the name of the last body."""
        for k in range(joints):
            axis = np.eye(3)[(2, 0, 1)[k % 3]]
            b.body(f'{name}{k}', parent, axis=axis, at=(0.0, 0.02 * k, -0.2),
                   inertial=box(1.0, (0.05, 0.06, 0.2), at=(0.0, 0.0, -0.1)))
            parent = f'{name}{k}'
        return parent
    limb('left_leg', 'world', 6)
    limb('right_leg', 'world', 6)
    trunk = limb('trunk', 'world', 2)
    limb('left_arm', trunk, 8)
    limb('right_arm', trunk, 8)
    return b.model()


def test_matrices_of_short_branches_are_computed_without_blocks():
    model = limbs_on_a_trunk()
    robot = Robot(model)
    assert TreeInLanes.fills_blocks(robot.equations.tree)
    for name in ('mass_matrix', 'inverse_mass_matrix'):
        program = robot.kernels.program(name, single=True)
        assert not any(node.op == 'loop' for node in program.schedule())
    q = random_state(model, 5)[0]
    expected = kane.mass_matrix(model, q)
    assert relative_error(robot.mass_matrix(q), expected) < 20.0 * EPS
    condition = np.linalg.cond(expected)
    inverse = robot.inverse_mass_matrix(q)
    assert relative_error(inverse, np.linalg.inv(expected)) < 10.0 * EPS * condition


def test_a_matrix_may_be_written_over_its_configuration():
    robot = Robot(random_model(3, 26, branching=0.0))
    q = np.random.default_rng(0).uniform(-1.0, 1.0, robot.n)
    kernel = robot.kernels.quantity('mass_matrix')
    expected = robot.mass_matrix(q)
    memory = np.empty((robot.n, robot.n))
    memory[3] = q
    pointers = [x.ctypes.data for x in (memory[3], kernel.parameters, memory)]
    repeat(kernel.address, pointers, [0, 0, 0], 1)
    assert np.array_equal(memory, expected)


@pytest.mark.parametrize('n, branching', [(26, 0.6), (9, 0.0)])
def test_short_branches_are_computed_by_the_mass_matrix(n, branching):
    robot = Robot(random_model(8, n, branching=branching))
    program = robot.kernels.program('forward_dynamics', single=True)
    assert not any(node.op == 'loop' for node in program.schedule())


def test_a_link_without_inertia_about_its_joint_needs_the_mass_matrix():
    model = random_model(3, 30, branching=0.0, prismatic=0.0, passive=False)
    last = model.bodies[-1]
    rod = Inertial(1.0, np.zeros(3),
                   np.eye(3) - np.outer(last.joint.axis, last.joint.axis))
    thin = replace(model, bodies=(*model.bodies[:-1], replace(last, inertial=rod)))
    assert TreeInLanes.has_long_branches(TreeEquations(model), 2400)
    assert not TreeInLanes.has_long_branches(TreeEquations(thin), 2400)


@pytest.fixture(scope='module')
def long_chain():
    """Return a chain whose batches are computed one state after the other."""
    robot = Robot(random_model(4, 44, branching=0.0))
    assert robot.kernels.by_states('forward_dynamics')
    return robot


@pytest.mark.parametrize('count', [1, 8, 11])
def test_a_batch_of_a_long_chain_has_the_numbers_of_its_states(long_chain, count):
    states = np.random.default_rng(count).uniform(-1.0, 1.0, (3, count, long_chain.n))
    expected = np.array([long_chain.forward_dynamics(*state)
                         for state in states.transpose(1, 0, 2)])
    assert np.array_equal(long_chain.forward_dynamics(*states), expected)
    # In place: no state is computed again from its own result.
    q, u, tau = states
    long_chain.forward_dynamics(q, u, tau, out=tau)
    assert np.array_equal(tau, expected)


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
    np.testing.assert_array_equal(trajectory.udot, expected)
    # The motion has these accelerations: differences over a step, of second order.
    slope = np.gradient(trajectory.u, trajectory.t, axis=0)[1:-1]
    middle = trajectory.udot[1:-1]
    assert np.abs(slope - middle).max() < 0.02 * np.abs(middle).max()


def matrices_by_blocks(model, q):
    """Return the mass matrix and its inverse by blocks of joints, without compiling."""
    tree = TreeInLanes(TreeEquations(model))
    parameters = np.array(model.gravity)
    return [function(q, parameters).astype(float) for function in (
        tree.mass_matrix_by_blocks, tree.inverse_mass_matrix_by_blocks)]


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 19), st.sampled_from([0.0, 0.3, 1.0]),
       st.sampled_from([0.0, 0.15, 0.6]))
def test_matrices_by_blocks_are_those_of_the_definition(seed, n, prismatic, branching):
    model = shuffled(random_model(seed, n, prismatic=prismatic, branching=branching),
                     seed)
    q = random_state(model, seed)[0]
    expected = kane.mass_matrix(model, q)
    M, W = matrices_by_blocks(model, q)
    assert relative_error(M, expected) < 20.0 * EPS
    condition = np.linalg.cond(expected)
    assert relative_error(W, np.linalg.inv(expected)) < 10.0 * EPS * condition
    assert np.array_equal(M, M.T)
    assert np.array_equal(W, W.T)


@pytest.mark.parametrize('branching', [0.0, 0.04])
def test_compiled_matrices_by_blocks_are_those_of_the_definition(branching):
    n = 45
    model = random_model(8, n, branching=branching)
    if not branching:  # rows of the matrices are then not those of the blocks
        model = shuffled(model, 8)
    assert (len(branches(Robot(model).equations.tree.geometry)) > 1) == (branching > 0.0)
    robot = Robot(model, payload_frame='frame3')
    payload = Inertial(2.0, np.array([0.1, 0.0, 0.2]), 0.01 * np.eye(3))
    robot.parameters.payload = payload
    q = random_state(model, 5)[0]
    expected = kane.mass_matrix(with_payload(model, 'frame3', payload), q)
    M = robot.mass_matrix(q)
    W = robot.inverse_mass_matrix(q)
    assert relative_error(M, expected) < 20.0 * EPS
    condition = np.linalg.cond(expected)
    assert relative_error(W, np.linalg.inv(expected)) < 10.0 * EPS * condition
    assert np.array_equal(M, M.T)
    assert np.array_equal(W, W.T)
    for name in ('mass_matrix', 'inverse_mass_matrix'):
        program = robot.kernels.program(name, single=True)
        assert any(node.op == 'loop' for node in program.schedule())


@pytest.mark.parametrize('n', [32, 40])
def test_compiled_matrices_of_whole_blocks_are_those_of_the_definition(n):
    # Without joints that fill blocks, loops write the tiles of the matrices in place.
    model = random_model(8, n, branching=0.0)
    q = random_state(model, 5)[0]
    robot = Robot(model)
    expected = kane.mass_matrix(model, q)
    assert relative_error(robot.mass_matrix(q), expected) < 20.0 * EPS
    condition = np.linalg.cond(expected)
    inverse = robot.inverse_mass_matrix(q)
    assert relative_error(inverse, np.linalg.inv(expected)) < 10.0 * EPS * condition
