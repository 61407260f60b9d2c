"""Every number equals Pinocchio's, on the real robots of example-robot-data."""

from definition import Definition, relative_error
from kane_dynamics import Robot
from kane_dynamics.errors import KaneError
from kane_dynamics.native.tracing.program import evaluate
from kane_dynamics.robot.derivative_kernels import Derivative
import numpy as np
from pinocchio_robot import loaded, N_STATES, Peer, REFUSED, urdf_files
import pytest

EPS = np.finfo(float).eps
ROBOTS = [path for path in urdf_files() if path.name not in REFUSED and loaded(path).n]
STATES = {Definition: range(N_STATES)[::10], Robot: range(N_STATES)}
LARGEST = 'tiago_dual'  # its kernels take half a minute
# In slow tests: variants of another robot of the list, with other hands or none, limits,
# boxes for meshes, inertias.
VARIANTS = (
    'alex_sake_hands', 'allegro_right_hand', 'double_pendulum_simple', 'romeo',
    'romeo_laas_small', 'simple_humanoid_classical', 'so100', 'talos_full_v2_box',
    'talos_reduced_box', 'talos_reduced_corrected', 'ur3_gripper',
    'ur3_joint_limited_robot',
    'ur3_robot', 'ur5_gripper', 'ur5_joint_limited_robot', 'ur10_joint_limited_robot')


@pytest.fixture(
    scope='module',
    params=[pytest.param(path, marks=pytest.mark.slow)
            if path.stem in (LARGEST, *VARIANTS) else path for path in ROBOTS],
    ids=[f'{path.parts[-3]}-{path.stem}' for path in ROBOTS])
def peer(request):
    """Pinocchio's model of one robot."""
    return Peer(request.param)


@pytest.fixture(scope='module', params=[Definition, Robot])
def robot(request, peer):
    """Our robot on the same URDF, as defined and as compiled."""
    return request.param(peer.model, friction=False)


def test_there_are_enough_robots():
    assert len(ROBOTS) >= 60
    assert set(VARIANTS) <= {path.stem for path in ROBOTS}
    assert len(ROBOTS) - len(VARIANTS) >= 40


def test_urdfs_that_are_left_out_are_refused_with_a_reason():
    refused = [path for path in urdf_files() if path.name in REFUSED]
    assert len(refused) == len(REFUSED)
    for path in refused:
        with pytest.raises(KaneError, match=REFUSED[path.name]):
            loaded(path)


@pytest.mark.parametrize(('quantity', 'arguments'), [
    ('inverse_dynamics', ('q', 'u', 'udot')), ('mass_matrix', ('q',)),
    ('bias_force', ('q', 'u')), ('gravity_force', ('q',)),
    ('kinetic_energy', ('q', 'u'))])
def test_dynamics_are_pinocchios(peer, robot, quantity, arguments):
    for k in STATES[type(robot)]:
        state = [getattr(peer, name)[k] for name in arguments]
        value = getattr(robot, quantity)(*state)
        expected = getattr(peer, quantity)(*state)
        assert relative_error(value, expected) < 1e-12, k


def test_potential_energy_is_pinocchios(peer, robot):
    for q in peer.q[STATES[type(robot)]]:
        difference = robot.potential_energy(q) - peer.potential_energy(q)
        assert abs(difference) <= 1e-12 * peer.potential_energy_scale(q)


def test_forward_dynamics_are_pinocchios_within_the_condition_of_m(peer, robot):
    for k in STATES[type(robot)]:
        state = peer.q[k], peer.u[k], peer.tau[k]
        condition = np.linalg.cond(peer.mass_matrix(peer.q[k]))
        if condition > 1.0 / EPS:
            return expect_refusal(robot, 'forward_dynamics', state)
        value = robot.forward_dynamics(*state)
        expected = peer.forward_dynamics(*state)
        assert relative_error(value, expected) < 10.0 * EPS * condition, k


def test_inverse_mass_matrix_is_that_of_pinocchios_m(peer, robot):
    for k in STATES[type(robot)]:
        M = peer.mass_matrix(peer.q[k])
        condition = np.linalg.cond(M)
        if condition > 1.0 / EPS:
            return expect_refusal(robot, 'inverse_mass_matrix', (peer.q[k],))
        error = relative_error(robot.inverse_mass_matrix(peer.q[k]), np.linalg.inv(M))
        assert error < 10.0 * EPS * condition, k


def expect_refusal(robot, quantity, state):
    """Where M is singular, what needs its inverse is refused, and the joint named."""
    if isinstance(robot, Robot):
        with pytest.raises(KaneError, match='singular: joint'):
            getattr(robot, quantity)(*state)


@pytest.mark.parametrize(('quantity', 'arguments'), [
    ('frame_pose', ('q',)), ('jacobian', ('q',)), ('frame_velocity', ('q', 'u')),
    ('frame_acceleration', ('q', 'u', 'udot'))])
def test_frames_move_as_pinocchios(peer, robot, quantity, arguments):
    for frame in peer.frames:
        for k in STATES[type(robot)]:
            state = [getattr(peer, name)[k] for name in arguments]
            value = getattr(robot, quantity)(frame, *state)
            expected = getattr(peer, quantity)(frame, *state)
            assert relative_error(value, expected) < 1e-12, (frame, k)


def test_partial_velocities_change_as_pinocchios_jacobian(peer, robot):
    for frame in peer.frames:
        for k in range(N_STATES) if isinstance(robot, Robot) else (0,):
            state = frame, peer.q[k], peer.u[k]
            size = np.abs(peer.jacobian(*state[:2])).max() * np.abs(peer.u[k]).max()
            error = robot.jacobian_rate(*state) - peer.partial_velocity_rates(*state)
            assert np.abs(error).max() <= 1e-12 * size, (frame, k)


SMALL = 8  # coordinates up to which derivatives are compared as compiled, else as traced


def size_of(expected):
    """Return what errors are relative to; propellers on a fixed base are apart."""
    return np.abs(expected).max() + 1e-6


def derived(robot, name, state):
    """Return a quantity with many entries: compiled if small, else on numbers."""
    if robot.n <= SMALL:
        return getattr(robot, name)(*state)
    value = getattr(robot.equations.tree, name)(*state, robot.parameters.block)
    return value.astype(float)


@pytest.fixture(scope='module')
def compiled(peer):
    """Our robot on the same URDF, as compiled."""
    return Robot(peer.model, friction=False)


@pytest.mark.parametrize(('quantity', 'arguments'), [
    ('coriolis_matrix', ('q', 'u')), ('regressor', ('q', 'u', 'udot')),
    ('inverse_dynamics_derivatives', ('q', 'u', 'udot'))])
def test_derivatives_and_regressors_are_pinocchios(peer, compiled, quantity, arguments):
    for k in range(N_STATES) if compiled.n <= SMALL else (0,):
        state = [getattr(peer, name)[k] for name in arguments]
        value = derived(compiled, quantity, state)
        expected = getattr(peer, quantity)(*state)
        for one, reference in zip(value, expected):  # matrix by matrix, or row by row
            assert np.abs(one - reference).max() <= 1e-11 * size_of(expected), k


def test_forward_dynamics_derivatives_are_pinocchios(peer, compiled):
    if compiled.n > SMALL or peer.pin.nv > compiled.n:
        pytest.skip('compared for small robots without mimics')
    for k in range(N_STATES):
        state = peer.q[k], peer.u[k], peer.tau[k]
        condition = np.linalg.cond(peer.mass_matrix(peer.q[k]))
        if condition > 1e8:
            pytest.skip('the mass matrix is close to singular')
        expected = peer.forward_dynamics_derivatives(*state)
        tolerance = 1e-11 + 100.0 * EPS * condition
        for one, reference in zip(compiled.forward_dynamics_derivatives(*state),
                                  expected):
            # Both are products with M^-1, of the size of its entries at least.
            size = max(size_of(reference), 1e-6 * size_of(expected[2]))
            assert np.abs(one - reference).max() <= tolerance * size, k


@pytest.mark.parametrize(('quantity', 'third'), [('inverse_dynamics', 'udot'),
                                                 ('forward_dynamics', 'tau')])
def test_reverse_mode_gives_pinocchios_derivatives(peer, compiled, quantity, third):
    if compiled.n > SMALL or peer.pin.nv > compiled.n:
        pytest.skip('compared for small robots without mimics')
    condition = np.linalg.cond(peer.mass_matrix(peer.q[0]))
    if condition > 1e8:
        pytest.skip('the mass matrix is close to singular')
    state = peer.q[0], peer.u[0], getattr(peer, third)[0]
    w = np.random.default_rng(0).normal(size=compiled.n)
    program = compiled.kernels.program(quantity, '',
                                       Derivative('vjp', ('q', 'u', third)))
    gradients = evaluate(program, [w, *state, compiled.parameters.block]).reshape(3, -1)
    tolerance = 1e-11 + 100.0 * EPS * condition
    matrices = getattr(peer, f'{quantity}_derivatives')(*state)
    for gradient, matrix in zip(gradients, matrices):
        size = max(size_of(matrix), 1e-6 * size_of(matrices[2]))
        assert np.abs(gradient - w @ matrix).max() <= tolerance * size * np.abs(w).sum()


def test_joint_reactions_are_pinocchios(peer, compiled):
    for joint in {peer.model.bodies[0].joint.name, peer.model.bodies[-1].joint.name}:
        for k in range(N_STATES):
            state = peer.q[k], peer.u[k], peer.udot[k]
            value = compiled.joint_reaction(joint, *state)
            assert relative_error(value, peer.joint_reaction(joint,
                                                             *state)) < 1e-11, (joint, k)
