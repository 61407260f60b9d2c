"""Promises of kinematics: logarithms, inverse, center of mass, task space."""

from functools import cache
from pathlib import Path

from kane_dynamics import (box, Inertial, InputError, inverse_kinematics, load_urdf,
                           ModelBuilder, pose_error, pose_exp, pose_from, pose_log,
                           Robot, rod, rotation_exp, rotation_log, rotation_quaternion,
                           rotation_rpy)
from kane_dynamics.mechanics.constraints.speeds import absolute_rates
from kane_dynamics.mechanics.definition import kinematics
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from linkages import four_bar
from mechanisms import random_model
import numpy as np
import pytest
from scipy.linalg import expm

URDF = Path(__file__).parents[3] / 'urdf'
ANGLES = (0.0, 1e-300, 1e-9, 1e-4, 0.0099, 0.0101, 1.0, 3.0, np.pi - 1e-7, np.pi)
LOOP = four_bar('crank')


@cache
def arm(name='ur10e'):
    """Return a shipped arm."""
    return Robot(load_urdf(URDF / f'{name}.urdf',
                           supplement=URDF / f'{name}.supplement.yaml'))


def skew(w):
    """Return the matrix of w x."""
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


@pytest.mark.parametrize('angle', ANGLES)
def test_exponentials_are_those_of_the_matrices(angle):
    rng = np.random.default_rng(1)
    for _ in range(5):
        w = rng.normal(size=3)
        w *= angle / np.linalg.norm(w)
        v = rng.normal(size=3)
        np.testing.assert_allclose(rotation_exp(w), expm(skew(w)), atol=5e-15)
        twist = np.zeros((4, 4))
        twist[:3, :3] = skew(w)
        twist[:3, 3] = v
        np.testing.assert_allclose(pose_exp([*v, *w]), expm(twist), atol=2e-14)


@pytest.mark.parametrize('angle', ANGLES)
def test_logarithms_are_inverse_to_the_exponentials_at_every_angle(angle):
    rng = np.random.default_rng(2)
    for _ in range(20):
        w = rng.normal(size=3)
        w *= angle / np.linalg.norm(w)
        twist = np.array([*rng.normal(size=3), *w])
        back = rotation_log(rotation_exp(w))
        if angle == np.pi:  # both vectors turn as far
            back = back * np.sign(back @ w)
        np.testing.assert_allclose(back, w, atol=1e-15 + 2e-15 * angle)
        if angle < np.pi - 1e-6:
            np.testing.assert_allclose(pose_log(pose_exp(twist)), twist, atol=2e-14)


def test_logarithms_and_exponentials_are_those_of_pinocchio():
    pin = pytest.importorskip('pinocchio')
    rng = np.random.default_rng(3)
    for twist in rng.normal(size=(50, 6)):
        peer = pin.exp6(twist)
        np.testing.assert_allclose(pose_exp(twist), peer.homogeneous, atol=1e-14)
        np.testing.assert_allclose(rotation_log(peer.rotation), pin.log3(peer.rotation),
                                   atol=1e-14)
        np.testing.assert_allclose(pose_log(peer.homogeneous), pin.log6(peer).vector,
                                   atol=1e-13)


def test_batches_of_poses_are_computed_as_single_poses():
    twists = np.random.default_rng(4).normal(size=(2, 3, 6))
    poses = pose_exp(twists)
    assert poses.shape == (2, 3, 4, 4)
    np.testing.assert_allclose(pose_log(poses)[1, 2], pose_log(poses[1, 2]), atol=1e-15)
    np.testing.assert_allclose(pose_error(poses[0], poses[1])[2],
                               pose_error(poses[0, 2], poses[1, 2]), atol=1e-15)


def test_a_small_pose_error_is_what_the_jacobian_makes_of_a_small_step():
    robot = arm()
    h = 1e-5
    q = robot.random_configuration(0)
    dq = np.random.default_rng(5).normal(size=6)
    pose_before, pose_after = (robot.frame_pose('tool0', q + s * h * dq)
                               for s in (-0.5, 0.5))
    np.testing.assert_allclose(pose_error(pose_before, pose_after) / h,
                               robot.jacobian('tool0', q) @ dq, atol=1e-8)


@pytest.mark.parametrize(('call', 'words'), [
    (lambda: rotation_log(2.0 * np.eye(3)), 'rotation: .*expected a rotation matrix'),
    (lambda: rotation_log(np.diag([1.0, 1.0, -1.0])), 'expected a rotation matrix'),
    (lambda: rotation_log(np.full((3, 3), 1e200)), 'expected a rotation matrix'),
    (lambda: rotation_exp([1e300, 0.0, 0.0]),
     r'vector: rotation of 1e\+300 rad; expected at'),
    (lambda: pose_exp([0.0] * 5 + [1e300]),
     r'twist: rotation of 1e\+300 rad; expected at most'),
    (lambda: arm().random_configuration('a'), "seed: 'a'; expected an integer"),
    (lambda: arm().random_configuration(0, 1.5), 'count: 1.5; expected an integer >= 0'),
    (lambda: rotation_exp([1.0, 2.0]), r'vector: shape \(2,\); expected \(3,\)'),
    (lambda: pose_log(np.zeros((3, 4))), r'pose: shape \(3, 4\); expected \(4, 4\)'),
    (lambda: pose_error(np.eye(4), np.eye(4) * np.nan), 'desired: not finite'),
    (lambda: pose_error(np.eye(4), np.eye(4)[[0, 1, 2, 2]]), 'last row')])
def test_an_invalid_pose_is_refused_by_name(call, words):
    with pytest.raises(InputError, match=words):
        call()


@pytest.mark.parametrize('name', ['ur10e', 'fr3'])
def test_inverse_kinematics_finds_every_pose_that_the_arm_reaches(name):
    robot = arm(name)
    frame = 'tool0' if name == 'ur10e' else 'fr3_link8'
    for seed in range(20):
        pose = robot.frame_pose(frame, robot.random_configuration(seed))
        solution = inverse_kinematics(robot, frame, pose)
        assert solution.converged, (seed, solution)
        np.testing.assert_allclose(robot.frame_pose(frame, solution.q), pose, atol=3e-8)
        assert (solution.q >= robot.limits.lower).all()
        assert (solution.q <= robot.limits.upper).all()


def test_inverse_kinematics_stays_near_its_start():
    robot = arm()
    for seed in range(10):
        q = robot.random_configuration(seed)
        step = 0.02 * np.random.default_rng(seed).normal(size=6)
        near = np.clip(q + step, robot.limits.lower, robot.limits.upper)
        solution = inverse_kinematics(robot, 'tool0', robot.frame_pose('tool0', q), near)
        assert solution.converged and solution.iterations < 15
        singular = np.linalg.svd(robot.jacobian('tool0', q), compute_uv=False)[-1]
        if singular > 0.05:
            np.testing.assert_allclose(solution.q, q, atol=1e-6)


def test_inverse_kinematics_of_a_position_needs_only_three_joints():
    robot = Robot(load_urdf(URDF / 'ur10e.urdf', tip='forearm_link'))
    assert robot.n == 3
    place = robot.frame_pose('forearm_link', [0.4, -1.0, 0.5])[:3, 3]
    solution = inverse_kinematics(robot, 'forearm_link', place)
    assert solution.converged and solution.error.shape == (3,)
    np.testing.assert_allclose(robot.frame_pose('forearm_link', solution.q)[:3, 3],
                               place, atol=1e-8)


def test_a_pose_out_of_reach_is_not_converged_and_the_nearest_is_returned():
    far = np.eye(4)
    far[:3, 3] = 3.0, 0.0, 0.2
    solution = inverse_kinematics(arm(), 'tool0', far[:3, 3], starts=3)
    assert not solution.converged
    shoulder = arm().frame_pose('upper_arm_link', np.zeros(6))[:3, 3]
    reach = max(np.linalg.norm(arm().frame_pose('tool0', q)[:3, 3] - shoulder)
                for q in arm().random_configuration(0, 2000))
    distance = np.linalg.norm(far[:3, 3] - shoulder)
    assert distance - reach - 0.05 < np.linalg.norm(
        solution.error) < distance - reach + 0.01


def test_inverse_kinematics_closes_the_loop_too():
    robot = LOOP
    q = robot.closed_configuration((2.2, -1.0, -1.5), fixed=['crank'])
    place = robot.frame_pose('middle', q)[:3, 3]
    solution = inverse_kinematics(robot, 'middle', place)
    assert solution.converged
    assert np.abs(robot.constraint_residual(solution.q)).max() < 1e-9
    np.testing.assert_allclose(robot.frame_pose('middle', solution.q)[:3, 3], place,
                               atol=1e-8)


def test_inverse_kinematics_in_chosen_speeds_is_that_in_joint_rates():
    model = random_model(4, 6, prismatic=0.0, branching=0.0)
    q = Robot(model).random_configuration(1)
    for robot in (Robot(model), Robot(model, speeds=absolute_rates)):
        pose = robot.frame_pose('frame5', q)
        solution = inverse_kinematics(robot, 'frame5', pose, q + 0.01)
        assert solution.converged
        np.testing.assert_allclose(robot.frame_pose('frame5', solution.q), pose,
                                   atol=3e-8)


@pytest.mark.parametrize(('target', 'options', 'words'), [
    (np.eye(3), {}, r'target: shape \(3, 3\)'), (np.full(3, np.nan), {}, 'target'),
    (np.stack([np.eye(4)] * 2), {}, 'one pose'), (np.eye(4), {'starts': 0}, 'starts: 0'),
    (np.eye(4), {'tolerance': 0.0}, 'tolerance: 0'),
    (['a', 'b', 'c'], {}, r"target: \['a', 'b', 'c'\]; expected numbers"),
    ([1e300, 0.0, 0.0], {},
     r'target: position \[1e\+300, .*; expected finite numbers of at most'),
    (np.eye(4), {'tolerance': 'a'}, "tolerance: 'a'; expected a positive number"),
    (np.eye(4), {'starts': 2.5}, 'starts: 2.5; expected an integer >= 1'),
    (np.eye(4), {'iterations': np.nan}, 'iterations: nan; expected an integer >= 1'),
    (np.eye(4), {'seed': -1}, 'seed: -1; expected an integer >= 0'),
    (np.eye(4), {'q0': 'a'}, "q0: 'a'; expected 6 numbers"),
    (np.eye(4), {'q0': np.zeros((1, 6))}, r'q0: shape \(1, 6\); expected \(6,\)')])
def test_a_bad_target_is_refused_by_name(target, options, words):
    with pytest.raises(InputError, match=words):
        inverse_kinematics(arm(), 'tool0', target, **options)


def test_the_order_of_other_libraries_is_answered_with_ours():
    with pytest.raises(InputError,
                       match=r'frame: a ndarray; .* \(robot, frame, target\)'):
        inverse_kinematics(arm(), np.zeros(6), 'tool0')


@pytest.mark.parametrize('seed', range(4))
def test_the_center_of_mass_is_the_mean_place_of_mass_and_its_jacobian_the_slope(seed):
    model = random_model(seed, 5, mimics=1)
    robot = Robot(model, payload_frame='frame2')
    load = Inertial(2.0, np.array([0.1, 0.2, -0.1]), 0.01 * np.eye(3))
    robot.parameters.payload = load
    q = robot.random_configuration(seed)
    placed = kinematics.configurations(model, q)
    masses = [body.inertial.mass for body in model.bodies]
    places = [b.p_wb + b.R_wb @ body.inertial.com
              for b, body in zip(placed, model.bodies)]
    T = robot.frame_pose('frame2', q)
    masses.append(load.mass)
    places.append(T[:3, :3] @ load.com + T[:3, 3])
    np.testing.assert_allclose(robot.center_of_mass(q),
                               np.average(places, axis=0, weights=masses), atol=1e-13)
    h = 1e-6
    slope = np.stack(
        [(robot.center_of_mass(q + h * e) - robot.center_of_mass(q - h * e)) / (2 * h)
         for e in np.eye(robot.n)], axis=1)
    np.testing.assert_allclose(robot.center_of_mass_jacobian(q), slope, atol=1e-9)
    weight = -sum(masses) * robot.center_of_mass_jacobian(q).T @ robot.parameters.gravity
    np.testing.assert_allclose(robot.gravity_force(q), weight, atol=1e-11)
    momentum = sum(masses) * robot.center_of_mass_jacobian(q)
    np.testing.assert_allclose(robot.centroidal_momentum_matrix(q)[:3], momentum,
                               atol=1e-11)


def test_the_jacobian_of_the_center_of_mass_follows_the_independent_speeds():
    robot = LOOP
    h = 1e-6
    q = robot.closed_configuration((0.8, 0.0, -1.5), fixed=['crank'])
    u = np.ones(1)
    rate = robot.joint_rates(q, u)
    moved = [robot.center_of_mass(q + s * h * rate) for s in (-0.5, 0.5)]
    np.testing.assert_allclose(robot.center_of_mass_jacobian(q) @ u,
                               (moved[1] - moved[0]) / h, atol=1e-9)


@pytest.mark.parametrize('name', ['ur10e', 'fr3'])
def test_center_of_mass_and_operational_space_are_those_of_pinocchio(name):
    pin = pytest.importorskip('pinocchio')
    tip = 'tool0' if name == 'ur10e' else 'fr3_link8'
    robot = Robot(load_urdf(URDF / f'{name}.urdf', tip=tip), friction=False)
    peer = pin.buildModelFromUrdf(str(URDF / f'{name}.urdf'))
    names = [n for n in peer.names[1:] if n not in robot.joint_names]
    if names:
        peer = pin.buildReducedModel(peer, [peer.getJointId(n) for n in names],
                                     pin.neutral(peer))
    assert tuple(peer.names[1:]) == robot.joint_names
    data = peer.createData()
    frame = tip
    rng = np.random.default_rng(6)
    for _ in range(5):
        q = robot.random_configuration(rng)
        u = rng.normal(size=robot.n)
        np.testing.assert_allclose(robot.center_of_mass(q),
                                   pin.centerOfMass(peer, data, q), atol=1e-12)
        np.testing.assert_allclose(robot.center_of_mass_jacobian(q),
                                   pin.jacobianCenterOfMass(peer, data, q), atol=1e-12)
        udot = rng.normal(size=robot.n)
        np.testing.assert_allclose(robot.centroidal_momentum_matrix(q),
                                   pin.ccrba(peer, data, q, u), atol=1e-12)
        np.testing.assert_allclose(robot.centroidal_momentum(q, u), data.hg.vector,
                                   atol=1e-12)
        rate = pin.computeCentroidalMomentumTimeVariation(peer, data, q, u, udot).vector
        np.testing.assert_allclose(robot.centroidal_momentum_rate(q, u, udot), rate,
                                   atol=1e-11)
        M = pin.crba(peer, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        at = peer.getFrameId(frame)
        J = pin.computeFrameJacobian(peer, data, q, at, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(robot.jacobian(frame, q), J, atol=1e-12)
        inertia = np.linalg.inv(J @ np.linalg.solve(M, J.T))
        scale = np.abs(inertia).max()
        np.testing.assert_allclose(robot.operational_space_inertia(frame, q) / scale,
                                   inertia / scale, atol=1e-9)
        pin.forwardKinematics(peer, data, q, u, np.zeros(robot.n))
        drift = pin.getFrameClassicalAcceleration(
            peer, data, at, pin.LOCAL_WORLD_ALIGNED).vector
        h = pin.nonLinearEffects(peer, data, q, u)
        bias = inertia @ (J @ np.linalg.solve(M, h) - drift)
        size = np.abs(bias).max()
        np.testing.assert_allclose(robot.operational_space_bias(frame, q, u) / size,
                                   bias / size, atol=1e-9)


def test_the_operational_space_force_gives_the_frame_the_acceleration_asked_for():
    for robot, frame, q, directions in (
            (arm(), 'tool0', arm().random_configuration(3),
             ('x', 'y', 'z', 'rx', 'ry', 'rz')),
            (arm(), 'tool0', arm().random_configuration(4), ('z', 'rx')),
            (LOOP, 'middle', LOOP.closed_configuration((0.8, 0.0, -1.5)), ('x',))):
        rows = [('x', 'y', 'z', 'rx', 'ry', 'rz').index(name) for name in directions]
        u = np.full(robot.n, 0.7)
        desired = np.arange(1.0, 1.0 + len(rows))
        arguments = {'directions': directions}
        force = (robot.operational_space_inertia(frame, q, **arguments) @ desired
                 + robot.operational_space_bias(frame, q, u, **arguments))
        tau = robot.jacobian(frame, q)[rows].T @ force
        udot = robot.forward_dynamics(q, u, tau)
        np.testing.assert_allclose(robot.frame_acceleration(frame, q, u, udot)[rows],
                                   desired, rtol=1e-8, atol=1e-8)


def test_operational_space_takes_batches():
    robot = arm()
    q = robot.random_configuration(7, 4)
    u = np.random.default_rng(8).normal(size=(4, 6))
    whole = robot.operational_space_inertia('tool0', q), robot.operational_space_bias(
        'tool0', q, u)
    for k in range(4):
        np.testing.assert_allclose(whole[0][k],
                                   robot.operational_space_inertia('tool0', q[k]),
                                   rtol=1e-9)
        np.testing.assert_allclose(whole[1][k],
                                   robot.operational_space_bias('tool0', q[k], u[k]),
                                   rtol=1e-9)


@pytest.mark.parametrize('robot, frame, q', [
    (arm(), 'tool0', arm().random_configuration(3) * [1, 1, 1, 1, share, 1])
    for share in (1.0, 1e-2, 1e-4)] + [
    (LOOP, 'middle', LOOP.closed_configuration((0.8, 0.0, -1.5)))])
def test_operational_space_inertia_of_all_directions_is_that_of_all_by_name(
        robot, frame, q):
    # The wrist of the arm nears its singularity; the loop lacks directions.
    def result(*directions):
        try:
            robot.operational_space_inertia(frame, q)
            return robot.operational_space_inertia(frame, q, **dict(directions))
        except InputError as error:
            return str(error)
    native, named = result(), result(('directions', ('x', 'y', 'z', 'rx', 'ry', 'rz')))
    if isinstance(named, str):
        assert native == named
    else:
        size = abs(named).max()
        np.testing.assert_allclose(native / size, named / size, atol=1e-7)


def test_directions_in_which_a_frame_cannot_accelerate_are_refused():
    with pytest.raises(InputError, match='in only 1 of these 2 at this q'):
        LOOP.operational_space_inertia('middle',
                                       LOOP.closed_configuration((0.8, 0, -1.5)),
                                       directions=('x', 'z'))
    with pytest.raises(InputError,
                       match="frame 'tool0' accelerates independently in only 5"):
        arm().operational_space_inertia('tool0', np.zeros(6))
    robot = arm()
    for seed in range(2):  # the second call is native
        robot.operational_space_inertia('tool0', robot.random_configuration(seed))
    with pytest.raises(InputError, match="'tool0' accelerates independently in only 5"):
        robot.operational_space_inertia('tool0', np.zeros(6))
    with pytest.raises(InputError,
                       match=r"directions: \['yaw'\]; expected some of x, y, z"):
        arm().operational_space_inertia('tool0', np.zeros(6), directions=['yaw'])


def test_the_rate_of_the_jacobian_is_its_slope_along_the_motion():
    h = 1e-6
    for robot, frame, q in ((arm(), 'tool0', arm().random_configuration(1)),
                            (LOOP, 'middle',
                             LOOP.closed_configuration((0.8, 0.0, -1.5)))):
        u = np.full(robot.n, 0.9)
        rate = robot.joint_rates(q, u)
        slope = (robot.jacobian(frame, q + h * rate)
                 - robot.jacobian(frame, q - h * rate)) / (2*h)
        np.testing.assert_allclose(robot.jacobian_rate(frame, q, u), slope, atol=1e-8)


def test_frames_of_a_chain_of_any_length_move_by_their_jacobian():
    builder = ModelBuilder('chain')
    n = 700
    for k in range(n):
        builder.body(f'link{k}', f'link{k - 1}' if k else 'world',
                     axis=(0, k % 2, 1 - k % 2),
                     at=(0.01, 0, 0), inertial=rod(1.0, (0, 0, 0), (0.01, 0, 0)))
    model = builder.model()
    rng = np.random.default_rng(0)
    equations = TreeEquations(model)
    frame = model.frame(f'link{n - 1}')
    q, u, udot = rng.uniform(-1.0, 1.0, (3, n))
    J = equations.partial_velocities(frame, q)
    np.testing.assert_allclose(equations.frame_velocity(frame, q, u), J @ u, atol=1e-10)
    rate = equations.partial_velocity_rates(frame, q, u)
    np.testing.assert_allclose(equations.frame_acceleration(frame, q, u, udot),
                               J @ udot + rate @ u, rtol=1e-9, atol=1e-9)
    T = equations.frame_pose(frame, q)
    np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12)


def test_random_configurations_are_within_the_limits_and_repeatable():
    robot = arm('fr3')
    q = robot.random_configuration(0, 500)
    assert q.shape == (500, robot.n)
    assert (q >= robot.limits.lower).all() and (q <= robot.limits.upper).all()
    span = robot.limits.upper - robot.limits.lower
    assert (np.ptp(q, axis=0) > 0.95 * span).all(), 'and they fill them'
    np.testing.assert_array_equal(q, robot.random_configuration(0, 500))
    assert (robot.random_configuration(1) != q[0]).all()
    assert (robot.neutral() == 0.0).all()
    with pytest.raises(InputError, match='count: -1'):
        robot.random_configuration(0, -1)


def test_random_and_neutral_configurations_of_a_loop_close_it():
    robot = LOOP
    for q in (*robot.random_configuration(0, 10), robot.neutral()):
        assert np.abs(robot.constraint_residual(q)).max() < 1e-9
    assert robot.random_configuration(0).shape == (3,)


def test_orientations_as_quaternions_and_roll_pitch_yaw_are_those_of_scipy():
    rotation = pytest.importorskip('scipy.spatial.transform').Rotation
    turns = rotation.random(40, random_state=5)
    angles = turns.as_euler('xyz')
    quaternions = turns.as_quat()
    for pose in (pose_from(rpy=angles),
                 pose_from(np.zeros((40, 3)), quaternion=quaternions)):
        np.testing.assert_allclose(pose[:, :3, :3], turns.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(rotation_rpy(turns.as_matrix()), angles, atol=1e-12)
    signs = np.where(quaternions[:, 3:] < 0.0, -1.0, 1.0)
    np.testing.assert_allclose(rotation_quaternion(turns.as_matrix()),
                               signs * quaternions, atol=1e-14)


@pytest.mark.parametrize('pitch', [np.pi / 2, -np.pi / 2])
def test_roll_and_yaw_of_an_upright_rotation_are_one(pitch):
    R = pose_from(rpy=(0.3, pitch, 0.5))[:3, :3]
    roll, angle_about_y, yaw = rotation_rpy(R)
    assert yaw == 0.0 and angle_about_y == pytest.approx(pitch)
    np.testing.assert_allclose(pose_from(rpy=(roll, angle_about_y, yaw))[:3, :3], R,
                               atol=1e-14)


def test_roll_pitch_and_yaw_near_a_quarter_turn_are_of_the_same_rotation():
    rng = np.random.default_rng(0)
    away = 10.0 ** rng.uniform(-17.0, -1.0, 400)
    pitch = rng.choice([-1.0, 1.0], 400) * (0.5 * np.pi - away)
    roll, yaw = rng.uniform(-3.0, 3.0, (2, 400))
    R = pose_from(rpy=np.column_stack([roll, pitch, yaw]))[:, :3, :3]
    np.testing.assert_allclose(pose_from(rpy=rotation_rpy(R))[:, :3, :3], R,
                               rtol=0.0, atol=2e-12)


@pytest.mark.parametrize(('axes', 'angles'), [
    ((1.0, 1.0, 1.0), (0.0, 0.0, 0.0)), ((-1.0, -1.0, 1.0), (0.0, 0.0, np.pi)),
    ((1.0, -1.0, -1.0), (np.pi, 0.0, 0.0))])
def test_half_a_turn_is_positive_and_zero_has_no_sign(axes, angles):
    rpy = rotation_rpy(np.diag(axes))
    assert np.array_equal(rpy, angles)
    assert not np.signbit(rpy[[0, 2]]).any()


@pytest.mark.parametrize(('options', 'words'), [
    ({'rpy': (0, 0, 0), 'quaternion': (0, 0, 0, 1)}, 'rpy: given with quaternion'),
    ({'quaternion': (0, 0, 0, 2)},
     'quaternion: length 2; expected 1, in the order x, y, z, w'),
    ({'position': np.zeros((4, 3)), 'rpy': np.zeros((3, 3))},
     r'position: \(4,\) positions'),
    ({'rpy': (0, 0)}, r'rpy: shape \(2,\)'),
    ({'quaternion': (0, 0, np.nan, 1)}, 'not finite')])
def test_an_invalid_orientation_is_refused(options, words):
    with pytest.raises(InputError, match=words):
        pose_from(**options)


def test_a_slide_of_a_crane_takes_steps_of_its_size():
    """The way is 140 m, in a mechanism of 12 m; from the first start alone."""
    b = ModelBuilder('gantry')
    b.body('bridge', 'world', 'prismatic', axis=(1, 0, 0),
           inertial=box(5000.0, (1, 20, 1)))
    b.body('trolley', 'bridge', 'prismatic', axis=(0, 1, 0), at=(0, 0, 12),
           inertial=box(500.0, (1, 1, 1)))
    b.body('slewing', 'trolley', axis=(0, 0, 1), inertial=box(500.0, (1, 1, 1)))
    b.frame('hook', 'slewing', at=(4, 0, 0))
    robot = Robot(b.model())
    solution = inverse_kinematics(robot, 'hook', [140.0, 5.0, 12.0], starts=1)
    assert solution.converged and solution.iterations < 40
