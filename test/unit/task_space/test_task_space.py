"""Lambda, mu and the null space of a frame, directly and by task speeds."""

from dataclasses import replace
from functools import cache
import pickle

from kane_dynamics import (box, in_task_speeds, InputError, load_urdf, ModelBuilder,
                           Robot, rod, TaskSpace)
from kane_dynamics._util.resources import resource_path
from linkages import five_bar, five_bar_at
import numpy as np
from palletizer import joint_angles, palletizer
import pytest

TIP = 'fr3_link8'
Q = np.array([0.1, -0.7, 0.2, -2.3, 0.1, 1.5, 0.7])
STRETCHED = np.array([0.0, 0.3, 0.0, -0.467, 0.0, 1.5, 0.7])


@cache
def fr3():
    """Return the FR3."""
    return Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), tip=TIP))


def loop():
    """Return the palletizer and a closed configuration of it."""
    robot = palletizer()
    angles = joint_angles(0.2, 0.3, 0.1, 0.4)
    return robot, robot.closed_configuration([angles.get(name, 0.0)
                                              for name in robot.coordinate_names])


def test_they_are_those_of_the_definition():
    robot = fr3()
    u = np.random.default_rng(0).normal(size=7)
    J = robot.jacobian(TIP, Q)
    M_inverse = np.linalg.inv(robot.mass_matrix(Q))
    Lambda = np.linalg.inv(J @ M_inverse @ J.T)
    J_bar = M_inverse @ J.T @ Lambda
    space = TaskSpace(robot, TIP).at(Q, u)
    expected = {
        'jacobian': J, 'mobility': J @ M_inverse @ J.T, 'inertia': Lambda,
        'consistent_inverse': J_bar, 'null_projector': np.eye(7) - J_bar @ J,
        'bias': J_bar.T @ robot.bias_force(Q, u)
        - Lambda @ robot.jacobian_rate(TIP, Q, u) @ u,
        'gravity': J_bar.T @ robot.gravity_force(Q)}
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(space, name), value,
                                   atol=1e-11 * np.abs(value).max(), err_msg=name)
    assert space.regularization == 0.0
    L = robot.mechanism.length
    scales = np.array([1, 1, 1, L, L, L])
    assert space.mass == pytest.approx(np.trace(Lambda / np.outer(scales, scales)),
                                       rel=1e-7)


@pytest.mark.slow
def test_towards_a_singularity_they_are_bounded_and_do_not_jump():
    """Lambda itself grows without bound; the direction that is lost is named."""
    robot = fr3()
    space = TaskSpace(robot, TIP, singular_mass=150.0)
    scales = np.array([1, 1, 1] + 3 * [robot.mechanism.length])
    line = [STRETCHED + s * (Q - STRETCHED) for s in np.linspace(0.0, 1.0, 4001)]
    states = [space.at(q) for q in line]
    inertias = np.array([x.inertia / np.outer(scales, scales) for x in states])
    assert states[0].mass > 1e6 and states[0].regularization > 0.9 / 150.0
    assert states[-1].regularization == 0.0
    assert np.linalg.eigvalsh(inertias).max() < 4.0 / 3.0 * 150.0
    assert np.abs(np.diff(inertias, axis=0)).max() < 1.5
    jacobian = states[0].jacobian * scales[:, None]
    # Of a square root of rounding.
    assert np.abs(states[0].heaviest @ jacobian).max() < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize('axes', ['world', 'frame', 'fr3_link0'])
def test_axes_turn_the_quantities(axes):
    robot = fr3()
    u = np.random.default_rng(1).normal(size=7)
    pose = robot.frame_pose(TIP, Q)
    six = np.kron(np.eye(2), pose[:3, :3] if axes == 'frame' else np.eye(3))
    turned = TaskSpace(robot, TIP, axes=axes).at(Q, u)
    world = TaskSpace(robot, TIP).at(Q, u)
    np.testing.assert_allclose(six @ turned.inertia @ six.T, world.inertia, atol=1e-12)
    np.testing.assert_allclose(six @ turned.bias, world.bias, atol=1e-11)


@pytest.mark.parametrize('axes, directions', [
    ('world', None), pytest.param('world', ('x', 'z', 'ry'), marks=pytest.mark.slow),
    pytest.param('frame', ('x', 'y', 'z'), marks=pytest.mark.slow)])
def test_in_task_speeds_the_mass_matrix_is_lambda(axes, directions):
    """Two formulations: Kane's generalized speeds, products of matrices."""
    robot = Robot(load_urdf(resource_path('urdf', 'ur10e.urdf')))
    q = np.array([0.3, -1.2, 1.5, -1.0, 1.2, 0.4])
    u = np.random.default_rng(2).normal(size=6)
    space = TaskSpace(robot, 'tool0', axes=axes, directions=directions)
    direct = space.at(q, u)
    chosen = in_task_speeds(robot, 'tool0', axes=axes, directions=directions)
    k = len(space.directions)
    Y, _ = chosen.mechanism.speeds.of(q, 0.0)
    v = np.asarray(Y, dtype=float) @ u
    np.testing.assert_allclose(v[:k], direct.jacobian @ u, atol=1e-14)

    M = chosen.mass_matrix(q)
    np.testing.assert_allclose(M[:k, :k], direct.inertia, atol=1e-12 * M.max())
    np.testing.assert_allclose(M[:k, k:], 0.0, atol=1e-12)
    np.testing.assert_allclose(chosen.gravity_force(q)[:k], direct.gravity, atol=1e-11)

    # The rates of components in turning axes are not the acceleration in them.
    bias = direct.bias
    if axes == 'frame':
        R = robot.frame_pose('tool0', q)[:3, :3]
        velocity = robot.frame_velocity('tool0', q, u)
        turning = R.T @ np.cross(velocity[3:], velocity[:3])
        bias = bias + direct.inertia @ turning
    np.testing.assert_allclose(chosen.bias_force(q, v)[:k], bias, atol=1e-10)
    assert chosen.verify() < 1e-9


def test_a_robot_in_task_speeds_has_the_parameters_of_the_robot():
    robot = Robot(load_urdf(resource_path('urdf', 'ur10e.urdf')), payload_frame='tool0')
    robot.parameters.payload = box(3.0, (0.1, 0.2, 0.3), at=(0.0, 0.1, 0.2))
    robot.parameters.gravity = (1.0, -2.0, -7.0)
    robot.limits = replace(robot.limits, velocity=np.full(6, 0.5))
    chosen = in_task_speeds(robot, 'tool0')
    q = np.array([0.3, -1.2, 1.5, -1.0, 1.2, 0.4])
    u = np.random.default_rng(2).normal(size=6)
    Y, _ = chosen.mechanism.speeds.of(q, 0.0)
    v = np.asarray(Y, dtype=float) @ u
    assert chosen.kinetic_energy(q, v) == pytest.approx(robot.kinetic_energy(q, u),
                                                        rel=1e-12)
    assert chosen.potential_energy(q) == pytest.approx(robot.potential_energy(q),
                                                       rel=1e-12)
    for name, values in vars(robot.limits).items():
        np.testing.assert_array_equal(getattr(chosen.limits, name), values)


@pytest.mark.parametrize('of_loop', [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_robot_in_task_speeds_can_be_pickled(of_loop):
    robot, q = loop() if of_loop else (fr3(), Q)
    chosen = in_task_speeds(robot, 'flange' if of_loop else TIP, configuration=q)
    twin = pickle.loads(pickle.dumps(chosen))
    assert twin.speed_names == chosen.speed_names
    np.testing.assert_array_equal(twin.mass_matrix(q), chosen.mass_matrix(q))


@pytest.mark.slow
def test_closed_loops_have_task_speeds():
    robot, q = loop()
    u = np.array([0.3, -0.2, 0.1, 0.4])
    frame = 'flange'
    direct = TaskSpace(robot, frame).at(q, u)
    chosen = in_task_speeds(robot, frame, configuration=q)
    assert chosen.speed_names == tuple(f'flange/{x}' for x in ('x', 'y', 'z', 'rz'))
    M = chosen.mass_matrix(q)
    np.testing.assert_allclose(M, direct.inertia, atol=1e-10 * M.max())
    v = direct.jacobian @ u
    np.testing.assert_allclose(chosen.bias_force(q, v), direct.bias,
                               atol=1e-10 * np.abs(direct.bias).max())


@pytest.mark.slow
def test_a_five_bar_with_one_direction_has_a_complement():
    robot = five_bar('left_crank', 'right_crank')
    q = five_bar_at(2.1, 1.05)
    u = np.array([0.4, -0.3])
    frame = robot.frame_names[-1]
    pose = robot.jacobian(frame, q)
    direction = ('x', 'y', 'z')[int(np.argmax(np.abs(pose[:3]).max(axis=1)))]
    direct = TaskSpace(robot, frame, directions=[direction]).at(q, u)
    chosen = in_task_speeds(robot, frame, directions=[direction], configuration=q)
    M = chosen.mass_matrix(q)
    np.testing.assert_allclose(M[0, 0], direct.inertia[0, 0], rtol=1e-10)
    assert abs(M[0, 1]) < 1e-10 * np.abs(M).max()


def test_by_default_the_directions_are_those_that_the_frame_can_follow():
    assert TaskSpace(fr3(), TIP).directions == ('x', 'y', 'z', 'rx', 'ry', 'rz')
    robot, _ = loop()
    assert TaskSpace(robot, 'flange').directions == ('x', 'y', 'z', 'rz')
    two_link = Robot(load_urdf(resource_path('urdf', 'two_link_planar.urdf')))
    assert len(TaskSpace(two_link, two_link.frame_names[-1]).directions) == 2


def test_an_elbow_follows_as_many_directions_as_joints_move_it():
    space = TaskSpace(fr3(), 'fr3_link4')
    assert len(space.directions) == 4
    assert space.at(Q).regularization == 0.0
    assert in_task_speeds(fr3(), 'fr3_link4').speed_names[4] == 'fr3_link4/null_1'


def test_frames_of_names_that_differ_in_a_sign_have_kernels_of_their_own():
    builder = ModelBuilder('arm')
    builder.body('arm', inertial=rod(1.0, (0, 0, 0), (1, 0, 0)))
    builder.frame('tool-a', 'arm', at=(1.0, 0.0, 0.0))
    builder.frame('tool_a', 'arm', at=(2.0, 0.0, 0.0))
    robot = Robot(builder.model())
    for frame in ('tool-a', 'tool_a'):
        dynamics = TaskSpace(robot, frame, directions=['y']).at([0.0])
        np.testing.assert_allclose(dynamics.jacobian, robot.jacobian(frame, [0.0])[1:2])


@pytest.mark.parametrize('arguments, message', [
    ({'frame': 'nowhere'}, 'nowhere'), ({'frame': 'fr3_link0'}, 'does not move'),
    ({'axes': 'fr3_link2'}, 'moves relative to'), ({'directions': ['w']}, 'directions'),
    ({'directions': []}, 'directions')])
def test_wrong_tasks_are_refused(arguments, message):
    for function in (TaskSpace, in_task_speeds):
        with pytest.raises(InputError) as error:
            function(fr3(), **{'frame': TIP, **arguments})
        assert message in str(error.value)


def test_task_speeds_at_a_singular_configuration_are_refused():
    with pytest.raises(InputError, match='does not move independently'):
        in_task_speeds(fr3(), TIP, configuration=np.zeros(7))
    with pytest.raises(InputError, match='configuration'):
        in_task_speeds(fr3(), TIP, configuration=np.zeros(3))
    for function in (TaskSpace, in_task_speeds):
        with pytest.raises(InputError, match='expected a Robot'):
            function('fr3', TIP)
    with pytest.raises(InputError, match='singular_mass'):
        TaskSpace(fr3(), TIP, singular_mass=-1.0)
