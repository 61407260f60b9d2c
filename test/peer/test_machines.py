"""The machines in examples/ against formulations of their own."""

from functools import cache
from pathlib import Path
import runpy
from unittest.mock import patch

from ball_trees import peer_of
import numpy as np
import pinocchio as pin
import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'


@cache
def machine(name):
    """Return what an example defines, run without arguments."""
    path = str(EXAMPLES / f'{name}.py')
    with patch('sys.argv', [path]):
        return runpy.run_path(path)


def with_multipliers(M, h, J, bias, S, driven, rates):
    """
    Return the forces S^T tau of a constrained mechanism for accelerations of joints.

    M udot + h = S tau + J^T lambda, J udot = bias, udot[driven] = rates, solved for
    (udot, tau, lambda) at once.
    """
    n = len(h)
    m = S.shape[1]
    c = len(J)
    A = np.zeros((n + c + len(driven), n + m + c))
    A[:n] = np.hstack([M, -S, -J.T])
    A[n:n + c, :n] = J
    A[n + c:, :n] = np.eye(n)[driven]
    x = np.linalg.solve(A, np.concatenate([-h, bias, rates]))
    return x[n:n + m]


def full_matrix(peer, data, q):
    M = pin.crba(peer, data, q)
    return np.triu(M) + np.triu(M, 1).T


@cache
def six_rods(half_width=0.05):
    """Return Pinocchio's delta robot: a free platform, six rods, and their ends."""
    d = machine('delta_robot')
    inertial = {body.name: body.inertial for body in d['robot'].model.bodies}
    peer = pin.Model()
    ends = []
    peer.gravity.linear[:] = d['robot'].model.gravity
    free = peer.addJoint(0, pin.JointModelTranslation(), pin.SE3.Identity(), 'place')
    free = peer.addJoint(free, pin.JointModelSpherical(), pin.SE3.Identity(), 'platform')
    load = inertial['platform']
    peer.appendBodyToJoint(free, pin.Inertia(load.mass, load.com, 0.1 * np.eye(3)),
                           pin.SE3.Identity())
    rod = d['rods']
    rod = pin.Inertia(rod.mass / 2, rod.com, rod.inertia / 2)
    for k, angle in enumerate(d['turns'], 1):
        side = pin.SE3(pin.utils.rotate('z', angle), np.zeros(3))
        arm = peer.addJoint(0, pin.JointModelRY(), side * pin.SE3(
            np.eye(3), np.array([d['shoulder'], 0, 0])), f'arm {k}')
        upper = inertial[f'arm {k}']
        peer.appendBodyToJoint(arm, pin.Inertia(upper.mass, upper.com, upper.inertia),
                               pin.SE3.Identity())
        peer.armature[peer.idx_vs[arm]] = d['gear']
        for y in (-half_width, half_width):
            tilt = peer.addJoint(arm, pin.JointModelRY(), pin.SE3(
                np.eye(3), np.array([d['upper'], y, 0])), f'tilt {k} {y}')
            fore = peer.addJoint(tilt, pin.JointModelRX(), pin.SE3.Identity(),
                                 f'rod {k} {y}')
            peer.appendBodyToJoint(fore, rod, pin.SE3.Identity())
            end = peer.addFrame(pin.Frame(f'end {k} {y}', fore, pin.SE3(
                np.eye(3), np.array([0, 0, -d['fore']])), pin.FrameType.OP_FRAME))
            top = peer.addFrame(pin.Frame(f'top {k} {y}', free, pin.SE3(
                np.eye(3), side.rotation @ np.array([d['corner'], y, 0])),
                pin.FrameType.OP_FRAME))
            ends.append((end, top))
    return peer, ends


def test_the_delta_robot_is_pinocchios_with_six_rods_and_a_free_platform():
    """Multipliers hold the rods: that the platform keeps its orientation is a result."""
    d = machine('delta_robot')
    peer, ends = six_rods()
    data = peer.createData()
    arms = [peer.idx_vs[peer.getJointId(name)] for name in d['arms']]
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    for k in (3, 31, 50, 77):
        q = d['qs'][k]
        rates = d['robot'].joint_rates(d['qs'][k], d['us'][k])
        spread = [0, 1, 2, *(3 + 3 * i + j for i in range(3) for j in (0, 1, 2, 1, 2))]
        full = q[spread]
        v = np.insert(rates[spread], 3, [0.0, 0.0, 0.0])
        full = np.insert(full, 3, [0.0, 0.0, 0.0, 1.0])
        pin.forwardKinematics(peer, data, full, v, np.zeros(peer.nv))
        pin.computeJointJacobians(peer, data, full)
        pin.updateFramePlacements(peer, data)
        J = []
        bias = []
        for end, top in ends:
            np.testing.assert_allclose(data.oMf[end].translation,
                                       data.oMf[top].translation, rtol=0.0, atol=1e-9)
            J.append(pin.getFrameJacobian(peer, data, end, world)[:3]
                     - pin.getFrameJacobian(peer, data, top, world)[:3])
            bias.append(
                pin.getFrameClassicalAcceleration(peer, data, top, world).linear
                - pin.getFrameClassicalAcceleration(peer, data, end, world).linear)
        np.testing.assert_allclose(np.vstack(J) @ v, 0.0, atol=1e-9)
        h = pin.nonLinearEffects(peer, data, full, v)
        expected = with_multipliers(full_matrix(peer, data, full), h, np.vstack(J),
                                    np.concatenate(bias), np.eye(peer.nv)[:, arms],
                                    [0, 1, 2], d['udots'][k])
        np.testing.assert_allclose(d['taus'][k], expected, rtol=0.0,
                                   atol=1e-10 * np.abs(expected).max())


def test_the_delta_robots_work_is_its_gain_of_energy():
    d = machine('delta_robot')
    assert d['work'] == pytest.approx(d['gain'], rel=1e-5)
    assert d['error'] < 1e-9


def cross(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def virtual_work(d, pose, u, udot):
    """
    Return the forces of the legs, (6,), by the principle of virtual work (Tsai 2000).

    Of each body the applied minus the inertia force and moment, projected by the body's
    own Jacobian to the twist of the platform. A leg has the direction s and does not
    turn about it.
    """
    g = np.array([0, 0, -9.80665])
    mass = d['mass']
    e = d['center']
    R = pin.Quaternion(np.array(pose[3:], dtype=float)).toRotationMatrix()
    # Ours are on the body's axes.
    w = R @ u[3:]
    alpha = R @ udot[3:]
    load = d['robot'].model.bodies[5].inertial
    inertia = R @ load.inertia @ R.T
    total = np.concatenate(
        [load.mass * (g - udot[:3]), -inertia @ alpha - np.cross(w, inertia @ w)])
    legs = []
    for foot, top in zip(d['feet'], d['tops']):
        r = R @ top
        # Of the ball joint, to velocity and rotation.
        J = np.hstack([np.eye(3), -cross(r)])
        v = u[:3] + np.cross(w, r)
        a = udot[:3] + np.cross(alpha, r) + np.cross(w, np.cross(w, r))
        length = np.linalg.norm(pose[:3] + r - foot)
        s = (pose[:3] + r - foot) / length
        turn = np.cross(s, v) / length
        turn_rate = np.cross(s, a) / length - 2.0 * (s @ v) / length * turn
        stretch = s @ a + length * turn @ turn
        s_rate = np.cross(turn, s)
        s_second = np.cross(turn_rate, s) + np.cross(turn, s_rate)
        across = (np.eye(3) - np.outer(s, s)) / length
        moment = 2.0 * d['inertia'][0, 0] * turn_rate  # of cylinder and piston
        total += J.T @ (e * across @ (mass * (g - e * s_second)))
        away = length - e
        at = stretch * s + 2.0 * (s @ v) * s_rate + away * s_second
        total += J.T @ ((away * across + np.outer(s, s)) @ (mass * (g - at)))
        total -= (cross(s) @ J / length).T @ moment
        legs.append(s @ J)
    return np.linalg.solve(np.transpose(legs), -total)


@pytest.mark.parametrize('motion', ['shift', 'turn'])
def test_the_forces_of_the_stewart_platforms_legs_are_those_of_virtual_work(motion):
    d = machine('stewart_platform')
    for t in (0.1, 0.7, 1.3):
        _, u, udot, forces = d['leg_forces'](d[motion], t)
        expected = virtual_work(d, d[motion](t)[0], u, udot)
        np.testing.assert_allclose(forces, expected, rtol=0.0,
                                   atol=1e-11 * np.abs(expected).max())


def test_the_stewart_platform_in_any_state_is_that_of_virtual_work():
    """Rotated about all axes and turning, as the published motions are not."""
    d = machine('stewart_platform')
    rng = np.random.default_rng(0)
    for _ in range(3):
        p = np.array([*rng.uniform(-0.2, 0.2, 3), 1.0])
        pose = np.concatenate(
            [rng.uniform(-0.1, 0.1, 3) + (-1.5, 0, 1), p / np.linalg.norm(p)])
        u, udot = rng.uniform(-2.0, 2.0, (2, 6))
        q = d['closed'](pose)
        assert np.abs(d['robot'].constraint_residual(q)).max() < 1e-14
        forces = d['robot'].joint_torques(
            d['robot'].inverse_dynamics(q, u, udot), q)[d['forces']]
        expected = virtual_work(d, pose, u, udot)
        np.testing.assert_allclose(forces, expected, rtol=0.0,
                                   atol=1e-11 * np.abs(expected).max())


def test_the_mobile_manipulator_is_pinocchios_with_lagrange_multipliers_at_the_wheels():
    """Rows of rolling without slip, by hand: forward speed of wheels, sideways."""
    d = machine('mobile_manipulator')
    robot = d['robot']
    run = d['run']
    radius = d['radius']
    half = 0.5 * d['track']
    peer = peer_of(robot.model)
    data = peer.createData()
    driven = [robot.coordinate_names.index(name) for name in robot.speed_names]
    damping = np.array([body.joint.damping for body in robot.model.bodies])
    for k in (100, 333, 590):
        q = run.q[k]
        v = robot.joint_rates(run.q[k], run.u[k])
        heading = q[2]
        turning = v[2]
        s = np.sin(heading)
        c = np.cos(heading)
        J = np.zeros((3, len(q)))
        rate = np.zeros((3, len(q)))
        J[:2, :2], rate[:2, :2] = (c, s), turning * np.array([-s, c])
        J[2, :2], rate[2, :2] = (-s, c), turning * np.array([-c, -s])
        J[:2, 2] = -half, half
        J[[0, 1], [3, 4]] = -radius
        np.testing.assert_allclose(J @ v, 0.0, atol=1e-12)
        udot = d['wanted'](run.t[k])[1]
        expected = with_multipliers(full_matrix(peer, data, q),
                                    pin.nonLinearEffects(peer, data, q, v) + damping * v,
                                    J, -rate @ v, np.eye(len(q))[:, driven], driven,
                                    udot)
        tau = robot.inverse_dynamics(q, run.u[k], udot)
        np.testing.assert_allclose(tau, expected,
                                   rtol=0.0, atol=1e-11 * np.abs(expected).max())


def test_the_free_flying_arm_is_pinocchios():
    d = machine('free_flying_arm')
    robot = d['robot']
    run = d['run']
    peer = peer_of(robot.model)
    data = peer.createData()
    rng = np.random.default_rng(0)
    for k in (0, 20, 55):
        udot = rng.uniform(-1.0, 1.0, robot.n)
        expected = pin.rnea(peer, data, run.q[k], run.u[k], udot)
        tau = robot.inverse_dynamics(run.q[k], run.u[k], udot)
        np.testing.assert_allclose(tau, expected,
                                   rtol=0.0, atol=1e-11 * np.abs(expected).max())
        pin.ccrba(peer, data, run.q[k], run.u[k])
        linear = data.hg.linear
        angular = data.hg.angular
        com = pin.centerOfMass(peer, data, run.q[k])
        momentum = np.concatenate([linear, angular + np.cross(com, linear)])
        np.testing.assert_allclose(momentum, d['both'][0], rtol=0.0,
                                   atol=1e-11 * np.abs(momentum).max())
