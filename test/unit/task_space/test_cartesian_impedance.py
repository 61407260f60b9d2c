"""Cartesian impedance: its definition, energy, null space, limits and settings."""

from dataclasses import replace
from functools import cache

from kane_dynamics import (CartesianImpedance, InputError, load_urdf, ModelBuilder,
                           OperationalSpace, point_mass, pose_exp, Robot, rod,
                           rotation_exp, Terms)
from kane_dynamics._util.resources import resource_path
from linkages import four_bar
import numpy as np
from palletizer import joint_angles, palletizer
import pytest
from readable_impedance import arm_numbers, cartesian_impedance
from scipy.linalg import eigh
from stepping import stepped

K = np.array([2000.0, 1500.0, 1000.0, 20.0, 60.0, 100.0])
TIP = 'fr3_link8'
ORDINARY = np.array([0.2, -0.7, 0.1, -2.2, 0.1, 1.6, 0.7])


@cache
def fr3():
    """Return the FR3 without friction, and limits of effort and speed."""
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'), tip=TIP), friction=False)
    none = np.full(robot.n, np.inf)
    robot.limits = replace(robot.limits, effort=none, velocity=none)
    return robot


def law(**settings):
    """Return an impedance of the FR3 without walls by default."""
    return CartesianImpedance(fr3(), TIP,
                              **{'stiffness': K, 'limit_stiffness': 0.0, **settings})


def test_the_torque_is_that_of_the_definition():
    """By eigenvalues, inverses and differences of the energy; a moving target."""
    robot = fr3()
    rng = np.random.default_rng(0)
    u = rng.normal(size=7)
    rng.normal(size=7)  # leaves the later draws what they were
    twist = rng.normal(size=6)
    acceleration = rng.normal(size=6)
    wrench = rng.normal(size=6)
    target = robot.frame_pose(TIP, ORDINARY) @ pose_exp(
        [0.05, -0.02, 0.03, 0.3, -0.2, 0.4])
    coupled = np.diag(K) + 20.0 * np.ones((6, 6))
    resting_pose = robot.frame_pose(TIP, ORDINARY)[:3, :3]
    for axes, A in (('world', np.eye(3)), ('frame', target[:3, :3])):
        impedance = law(stiffness=coupled, axes=axes, damping_ratio=0.8,
                        null_damping=3.0)
        if axes == 'frame':
            twist = np.concatenate([twist[:3], 0.0 * resting_pose[0]])  # axes at rest
        arm = arm_numbers(robot, TIP, ORDINARY, u)
        expected = cartesian_impedance(arm, u, target, coupled, 0.8, axes=A, twist=twist,
                                       acceleration=acceleration, wrench=wrench,
                                       null_rate=3.0)
        tau = impedance.torque(ORDINARY, u, target, twist, acceleration, wrench)
        np.testing.assert_allclose(tau, expected, atol=2e-5 * np.abs(expected).max())


@pytest.mark.parametrize('angle', [0.4, 2.7, 2.9, np.pi - 1e-7, np.pi])
@pytest.mark.parametrize('axes', ['world', 'frame'])
def test_a_spring_that_couples_force_and_moment_is_the_gradient_of_its_energy(
        axes, angle):
    robot = fr3()
    root = np.random.default_rng(0).normal(size=(6, 6))
    impedance = law(stiffness=100.0 * root @ root.T, axes=axes)
    axis = np.array([1.0, -2.0, 3.0]) / np.sqrt(14.0)
    target = robot.frame_pose(TIP, ORDINARY) @ pose_exp(
        [0.05, -0.02, 0.03, *angle * axis])
    h = 1e-6
    gradient = []
    for step in np.eye(7):
        gradient.append((impedance.energy(ORDINARY + h * step, target)
                         - impedance.energy(ORDINARY - h * step, target)) / (2.0 * h))
    tau = impedance.torque(ORDINARY, np.zeros(7), target) - robot.gravity_force(ORDINARY)
    np.testing.assert_allclose(tau, -np.array(gradient),
                               atol=1e-7 * np.abs(gradient).max())


def test_a_coupled_spring_does_not_jump_at_half_a_turn():
    robot = fr3()
    root = np.random.default_rng(0).normal(size=(6, 6))
    impedance = law(stiffness=100.0 * root @ root.T)
    torques = []
    for angle in (np.pi - 1e-9, np.pi + 1e-9):
        target = robot.frame_pose(TIP, ORDINARY) @ pose_exp(
            [0.05, -0.02, 0.03, angle, 0.0, 0.0])
        torques.append(impedance.torque(ORDINARY, np.zeros(7), target))
    np.testing.assert_allclose(torques[0], torques[1], atol=1e-5)


def test_modes_of_axes_with_different_ratios_have_ratios_between_them():
    robot = fr3()
    rng = np.random.default_rng(6)
    stiffness = np.array([2000.0, 500.0, 20.0, 50.0, 5.0, 1.0])
    ratios = np.array([0.1, 1.0, 0.1, 1.0, 0.1, 1.0])
    target = robot.frame_pose(TIP, ORDINARY)
    J = robot.jacobian(TIP, ORDINARY)
    Lambda = robot.operational_space_inertia(TIP, ORDINARY)
    squares, modes = eigh(np.diag(stiffness), Lambda)
    for _ in range(6):
        impedance = law(stiffness=stiffness, damping_ratio=rng.permutation(ratios),
                        null_damping=0.0)
        at_rest = impedance.torque(ORDINARY, np.zeros(7), target)
        dampers = [at_rest - impedance.torque(ORDINARY, unit, target)
                   for unit in np.eye(7)]
        # The damper of the joints is J^T D J.
        inverse = np.linalg.pinv(J)
        D = inverse.T @ np.column_stack(dampers) @ inverse
        of_modes = np.diag(modes.T @ D @ modes) / (2.0 * np.sqrt(squares))
        assert of_modes.min() >= 0.1 - 1e-5 and of_modes.max() <= 1.0 + 1e-5


@pytest.mark.slow
def test_a_moving_target_is_followed_exactly_on_the_exact_model():
    """Without errors the frame has the target's acceleration in turning axes."""
    robot = fr3()
    rng = np.random.default_rng(1)
    u = rng.normal(size=7)
    acceleration = rng.normal(size=6)
    pose = robot.frame_pose(TIP, ORDINARY)
    twist = robot.frame_velocity(TIP, ORDINARY, u)
    for axes in ('world', 'frame'):
        tau = law(axes=axes).torque(ORDINARY, u, pose, twist, acceleration)
        udot = robot.forward_dynamics(ORDINARY, u, tau)
        result = robot.frame_acceleration(TIP, ORDINARY, u, udot)
        # The null space moves: C s accelerates the frame, as it must for passivity.
        s = u - robot.inverse_mass_matrix(ORDINARY) @ robot.jacobian(TIP, ORDINARY).T @ (
            robot.operational_space_inertia(TIP, ORDINARY) @ twist)
        drift = -robot.jacobian(TIP, ORDINARY) @ robot.inverse_mass_matrix(ORDINARY) @ (
            robot.coriolis_matrix(ORDINARY, u) @ s) + robot.jacobian_rate(
                TIP, ORDINARY, u) @ s
        np.testing.assert_allclose(result, acceleration + drift, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize('settings', [{'limit_stiffness': 500.0},
                                      {'force_limit': 500.0, 'moment_limit': 50.0}])
def test_energy_does_not_rise_at_any_step_through_singular_configurations(settings):
    """Pulled out of its workspace: the arm stretches, and keeps moving."""
    robot = fr3()
    target = robot.frame_pose(TIP, ORDINARY)
    target[:3, 3] += [0.6, 0.2, 0.5]
    target[:3, :3] = target[:3, :3] @ rotation_exp([1.5, 2.0, 0.3])
    impedance = law(**settings)
    q = ORDINARY
    u = np.zeros(7)
    energies = []
    heaviest = 0.0
    for _ in range(500):
        energies.append(robot.kinetic_energy(q, u) + impedance.energy(q, target))
        heaviest = max(heaviest, impedance.state(q, u, target).mass)
        q, u = stepped(robot, lambda q, u: impedance.torque(q, u, target), q, u, 2e-3)
    assert np.diff(energies).max() < 0.0
    assert heaviest > 1e3  # singular on the way


def test_static_deflection_is_the_wrench_over_the_stiffness():
    robot = fr3()
    impedance = law(null_damping=20.0)
    pose = robot.frame_pose(TIP, ORDINARY)
    wrench = np.array([5.0, -3.0, 4.0, 0.0, 0.0, 0.0])

    # The configuration at rest under the wrench, by Newton's method on the law itself.
    q = ORDINARY.copy()
    for _ in range(30):
        J = robot.jacobian(TIP, q)
        residual = impedance.torque(q, 0.0 * q, pose) - robot.gravity_force(
            q) + J.T @ wrench
        M_inverse = robot.inverse_mass_matrix(q)
        force = robot.operational_space_inertia(TIP, q) @ J @ M_inverse @ residual
        q = q + M_inverse @ J.T @ (robot.operational_space_inertia(TIP, q)
                                   @ np.linalg.solve(np.diag(K), force))
    error = impedance.state(q, 0.0 * q, pose).error
    np.testing.assert_allclose(error[:3], wrench[:3] / K[:3], atol=1e-9)


def test_the_null_space_does_not_accelerate_the_frame():
    robot = fr3()
    rng = np.random.default_rng(2)
    u = rng.normal(size=7)
    pose = robot.frame_pose(TIP, ORDINARY) @ pose_exp([0.05, 0.0, 0.03, 0.3, 0.0, 0.4])
    results = []
    torques = []
    for settings in ({'null_damping': 0.0},
                     {'null_damping': 50.0, 'posture': ORDINARY + 1.0,
                      'posture_stiffness': 80.0}):
        tau = law(**settings).torque(ORDINARY, u, pose)
        udot = robot.forward_dynamics(ORDINARY, u, tau)
        results.append(robot.frame_acceleration(TIP, ORDINARY, u, udot))
        torques.append(tau)
    np.testing.assert_allclose(results[0], results[1],
                               atol=1e-9 * np.abs(results[0]).max())
    assert np.abs(torques[0] - torques[1]).max() > 1.0


@pytest.mark.slow
def test_through_a_singularity_torques_are_bounded_and_do_not_jump():
    """The elbow stretches; the damping by ratio of the lost direction stays finite."""
    robot = fr3()
    impedance = law(singular_mass=150.0)
    line = [np.array([0.0, 0.0, 0.0, -x, 0.0, np.pi / 2, 0.8])
            for x in np.linspace(0, 0.5, 2001)]
    twist = np.array([0.3, 0.1, 0.3, 0, 0, 0])
    acceleration = np.array([1.0, 0, 1.0, 0, 0, 0])
    pose = robot.frame_pose(TIP, line[0])
    torques = [impedance.torque(q, 0.3 * np.ones(7), pose, twist, acceleration)
               for q in line]
    assert np.isfinite(torques).all()
    steps = np.abs(np.diff(torques, axis=0)).max(axis=1)
    assert steps.max() < 1.5


def test_torques_of_the_task_keep_their_direction_at_the_effort_limits():
    robot = fr3()
    free = law(damping_ratio=0.0, null_damping=0.0)
    bounded = law(damping_ratio=0.0, null_damping=0.0, effort_limit=30.0)
    pose = robot.frame_pose(TIP, ORDINARY)
    pose[0, 3] += 0.1
    at_rest = np.zeros(7)
    gravity = robot.gravity_force(ORDINARY)
    task = free.torque(ORDINARY, at_rest, pose) - gravity
    scaled = bounded.torque(ORDINARY, at_rest, pose) - gravity
    scale = bounded.state(ORDINARY, at_rest, pose).effort_scale
    np.testing.assert_allclose(scaled, scale * task, atol=1e-9)
    assert 0.0 < scale < 1.0
    assert np.abs(gravity + scaled).max() == pytest.approx(30.0)


def test_force_and_moment_stay_within_their_limits_and_keep_their_directions():
    robot = fr3()
    impedance = law(force_limit=40.0, moment_limit=3.0)
    free = law()
    at_rest = np.zeros(7)
    for distance in (0.001, 0.1, 0.8):
        pose = robot.frame_pose(TIP, ORDINARY) @ pose_exp(
            [distance, -distance, 0.0, distance, 2.0 * distance, 0.0])
        wrench = impedance.state(ORDINARY, at_rest, pose).wrench
        unlimited = free.state(ORDINARY, at_rest, pose).wrench
        assert np.linalg.norm(wrench[:3]) <= 40.0 + 1e-9
        assert np.linalg.norm(wrench[3:]) <= 3.0 + 1e-9
        for part in (slice(0, 3), slice(3, 6)):
            a = wrench[part]
            b = unlimited[part]
            assert a @ b == pytest.approx(np.linalg.norm(a) * np.linalg.norm(b))


def test_walls_push_back_inside_the_margin_alone():
    robot = fr3()
    impedance = law(limit_stiffness=100.0, limit_margin=0.1)
    q = ORDINARY.copy()
    q[3] = robot.limits.upper[3] - 0.04
    pose = robot.frame_pose(TIP, q)
    at_rest = np.zeros(7)
    push = impedance.torque(q, at_rest, pose) - law().torque(q, at_rest, pose)
    np.testing.assert_allclose(push, [0, 0, 0, -100.0 * 0.06, 0, 0, 0], atol=1e-9)


def test_settings_change_without_compiling():
    robot = fr3()
    impedance = law()
    kernels = len(robot.kernels._made)
    pose = robot.frame_pose(TIP, ORDINARY)
    at_rest = np.zeros(7)
    pose[2, 3] += 0.01
    for settings in ({'stiffness': 2.0 * K}, {'damping': 5.0 * np.ones(6)},
                     {'damping': None, 'damping_ratio': 1.0},
                     {'compensate': Terms(gravity=False)},
                     {'posture': ORDINARY, 'posture_stiffness': 1.0},
                     {'force_limit': 5.0}):
        impedance.update(**settings)
        impedance.torque(ORDINARY, at_rest, pose)
    assert len(robot.kernels._made) == kernels


@pytest.mark.parametrize('wrong, message', [
    ({'stiffness': [1.0, 2.0]}, 'expected (6,) or (6, 6)'),
    ({'stiffness': -K}, 'eigenvalue'),
    ({'stiffness': np.arange(36.0).reshape(6, 6)}, 'symmetric'),
    ({'stiffness': 'x'}, 'stiffness'),
    ({'stiffness': 1e308 * np.eye(6)}, 'up to 1e+100'),
    ({'damping_ratio': -1.0}, "damping_ratio of direction 'x'"),
    ({'null_damping': np.inf}, 'null_damping'),
    ({'damping': np.ones(6), 'damping_ratio': 0.5}, 'both given'),
    ({'force_limit': 0.0}, 'force_limit'), ({'posture': [0.0]}, 'posture'),
    ({'limit_margin': 9.0}, 'half of the range'),
    ({'effort_limit': -1.0}, 'effort_limit'),
    ({'singular_mass': 0.0}, 'singular_mass'),
    ({'gain': 1.0}, 'expected some of stiffness'),
    ({'stiffness': np.diag(K) + np.ones((6, 6)), 'force_limit': 1.0}, 'couples')])
def test_wrong_settings_change_nothing(wrong, message):
    impedance = law()
    state_before = impedance._block.copy()
    with pytest.raises(InputError) as error:
        impedance.update(**wrong)
    assert message in str(error.value)
    np.testing.assert_array_equal(impedance._block, state_before)


@pytest.mark.parametrize('arguments, message', [
    ({'frame': 'nowhere'}, "no frame 'nowhere'"),
    ({'frame': 'fr3_link0'}, 'does not move'),
    ({'axes': 'fr3_link3'}, 'moves relative to'), ({'directions': 'xyz'}, 'directions'),
    ({'directions': ['x', 'x']}, 'each once'),
    ({'directions': 3}, 'directions: 3; expected'),
    ({'posture_stiffness': 1.0}, 'without a posture')])
def test_wrong_tasks_are_refused(arguments, message):
    with pytest.raises(InputError) as error:
        CartesianImpedance(fr3(), **{'frame': TIP, 'stiffness': K, **arguments})
    assert message in str(error.value)


@pytest.mark.parametrize('pose, message', [
    (np.eye(3), 'expected (4, 4)'), (np.eye(4).reshape(2, 8), 'expected (4, 4)'),
    (2.0 * np.eye(4), 'rotation matrix'),
    (np.full((4, 4), np.nan), 'pose'), (np.diag([-1.0, 1, 1, 1]), 'rotation matrix'),
    (np.eye(4) + np.eye(4, k=-3), 'last row'), ('pose', 'pose')])
def test_a_target_that_is_no_pose_is_refused(pose, message):
    with pytest.raises(InputError) as error:
        law().torque(ORDINARY, np.zeros(7), pose)
    assert message in str(error.value)


@pytest.mark.slow
def test_a_palletizer_stands_still_on_its_target_and_falls_toward_it():
    """Three loops, four degrees of freedom, five actuators or less."""
    robot = palletizer()
    frame = robot.frame_names[-1]
    q = robot.closed_configuration([joint_angles(0.2, 0.3, 0.1, 0.4).get(name, 0.0)
                                    for name in robot.coordinate_names])
    impedance = CartesianImpedance(robot, frame,
                                   stiffness=K, compensate=Terms(friction=False))
    pose = robot.frame_pose(frame, q)
    tau = impedance.torque(q, np.zeros(robot.n), pose)
    held = robot.joint_torques(robot.gravity_force(q), q)
    np.testing.assert_allclose(tau, held, atol=1e-6 * np.abs(held).max())
    assert impedance.torque(q, 0.1 * np.ones(robot.n), pose).shape == (robot.n_q,)


@pytest.mark.slow
def test_the_energy_of_a_four_bar_falls_while_its_target_rests():
    robot = Robot(four_bar().model, constraints=four_bar().options['constraints'],
                  friction=False)
    q = robot.closed_configuration((1.2, 0.0, -1.5), fixed=['crank'])
    target = robot.frame_pose('middle', robot.closed_configuration((1.6, 0.0, -1.5),
                                                                   fixed=['crank']))
    impedance = CartesianImpedance(robot, 'middle', stiffness=[300.0, 300, 300, 0, 0, 0])
    u = np.array([0.5])
    energies = []
    for _ in range(300):
        energies.append(robot.kinetic_energy(q, u) + impedance.energy(q, target))
        q, u = stepped(robot, lambda q, u: impedance.torque(q, u, target), q, u, 1e-3)
    assert np.diff(energies).max() < 0.0 and energies[-1] < 0.5 * energies[0]


def test_arrays_of_the_caller_may_change_without_effect():
    """As a posture that is the array of the measured positions."""
    stiffness = K.copy()
    posture = ORDINARY + 0.1
    impedance = law(stiffness=stiffness, posture=posture, posture_stiffness=20.0)
    target = fr3().frame_pose(TIP, ORDINARY)
    target[0, 3] += 0.01
    torque_before = impedance.torque(ORDINARY, np.zeros(7), target)
    stiffness *= 2.0
    posture += 1.0
    impedance.update(null_damping=3.0)
    np.testing.assert_array_equal(impedance.torque(ORDINARY, np.zeros(7), target),
                                  torque_before)


def test_a_posture_is_needed_for_its_stiffness_and_may_be_taken_back():
    impedance = law()
    with pytest.raises(InputError,
                       match=r'posture_stiffness: 5\.0, without a posture; expected'):
        impedance.update(posture_stiffness=5.0)
    impedance.update(posture=ORDINARY, posture_stiffness=5.0)
    impedance.update(posture=None, posture_stiffness=0.0)


@pytest.mark.parametrize(('q', 'pose', 'message'), [
    (np.zeros((2, 7)), np.eye(4), r'q: shape \(2, 7\); expected \(7,\)'),
    (ORDINARY, np.zeros((2, 4, 4)), r'pose: shape \(2, 4, 4\); expected \(4, 4\)')])
def test_the_energy_is_that_of_one_state(q, pose, message):
    with pytest.raises(InputError, match=message):
        law().energy(q, pose)


@pytest.mark.parametrize('weight', [5.0, -5.0])
@pytest.mark.parametrize('kind', [CartesianImpedance, OperationalSpace])
def test_an_overloaded_joint_that_the_frame_does_not_use_leaves_the_task_alone(
        kind, weight):
    b = ModelBuilder('arm beside a heavy flap')
    on = 'world'
    at = (0.0, 0.0, 0.0)
    for name in ('upper', 'fore', 'wrist'):
        b.body(name, on, axis=(0, 1, 0), at=at,
               inertial=rod(1.0, (0, 0, 0), (0.4, 0, 0)))
        on = name
        at = (0.4, 0.0, 0.0)
    b.body('flap', axis=(0, 1, 0), inertial=point_mass(1.0, at=(weight / 9.81, 0, 0)))
    robot = Robot(b.model())
    q = np.array([0.3, 0.4, 0.5, 0.0])
    pose = robot.frame_pose('wrist', q)
    pose[2, 3] += 0.05
    settings = {'stiffness': K} if kind is CartesianImpedance else {}
    torques = [kind(robot, 'wrist', effort_limit=[200.0, 200.0, 200.0, flap],
                    **settings).torque(q, np.zeros(4), pose) for flap in (10.0, 1.0)]
    np.testing.assert_allclose(torques[1], torques[0], rtol=1e-12, atol=1e-12)
    assert np.abs(torques[0] - robot.gravity_force(q))[:3].max() > 1.0
