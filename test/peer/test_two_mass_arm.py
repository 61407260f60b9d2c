"""An FR3 with elastic joints moves as MuJoCo's with a rotor and a spring each."""

from kane_dynamics import (Drive, load_urdf, ModelError, Motion, MotorSideControl,
                           natural_vibration, Robot, simulate, StiffnessCurve,
                           with_drives)
from kane_dynamics._util.resources import resource_path
import numpy as np
import pytest

pytest.importorskip('mujoco')

URDF = resource_path('urdf', 'fr3.urdf')
JOINTS = [f'fr3_joint{k}' for k in range(1, 8)]
HOME = np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8])


def arm(**drive):
    """Return the FR3 with drives of one kind at all seven joints."""
    options = {'stiffness': 9000.0, 'damping': 1.0, 'rotor_inertia': 0.3} | drive
    rigid = load_urdf(URDF, joints=JOINTS)
    return with_drives(rigid, {name: Drive(**options) for name in JOINTS})


def in_mujoco(model, **options):
    """Return the same arm in MuJoCo."""
    from two_mass_arm import TwoMassArm
    return TwoMassArm(URDF.read_text(encoding='utf-8'), model, **options)


def test_accelerations_of_links_and_motors_are_those_of_mujoco():
    model = arm()
    robot = Robot(model, friction=False)
    peer = in_mujoco(model, friction=False)
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = np.tile(HOME, 2) + 0.1 * rng.normal(size=14)
        u, tau = rng.normal(size=(2, 14))
        peer.put(q, u)
        expected = peer.accelerations(tau)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(robot.forward_dynamics(q, u, tau), expected,
                                   atol=1e-12 * scale)


def test_a_vibrating_arm_moves_as_in_mujoco():
    model = arm(damping=0.0)
    robot = Robot(model, friction=False)
    peer = in_mujoco(model, step=1e-4, integrator='RK4', friction=False)
    q0 = np.tile(HOME, 2)
    tau = np.concatenate([np.zeros(7), robot.gravity_force(q0)[:7]])
    motion = simulate(robot, q0, np.zeros(14), 0.2, step=1e-4, torque=tau)
    peer.put(q0, np.zeros(14))
    peer.step(tau, 2000)
    q, u = peer.state
    assert np.abs(q[7:] - q[:7]).max() > 1e-3  # rad: the links sag and vibrate
    np.testing.assert_allclose(motion.q[-1], q, atol=1e-9)
    np.testing.assert_allclose(motion.u[-1], u, atol=1e-7)


def test_the_arm_in_mujoco_refuses_what_mujoco_lacks():
    with pytest.raises(ModelError, match="fr3_joint1': a curve of stiffness"):
        in_mujoco(arm(stiffness=StiffnessCurve([0.01, 0.02], [0.0, 10.0])))
    with pytest.raises(ModelError, match=r"motor friction \['stribeck_speed'\]"):
        in_mujoco(arm(friction={'stribeck_speed': 0.1}))


@pytest.mark.slow
def test_the_elastic_feedforward_leaves_a_twentieth_of_the_vibration_of_the_rigid_one():
    model = arm(stiffness=5000.0, damping=0.2)
    robot = Robot(model)
    peer = in_mujoco(model, step=2.5e-4, integrator='RK4')
    armature = {name: {'armature': 0.3} for name in JOINTS}
    rigid = Robot(load_urdf(URDF, joints=JOINTS, supplement={'joints': armature}))
    first = natural_vibration(robot, np.tile(HOME, 2),
                              held=[f'{name}_motor' for name in JOINTS])
    assert 5.0 < first.frequencies[0] / (2.0 * np.pi) < 12.0  # Hz

    # A fast move with four continuous derivatives, torques held for cycles of 1 ms.
    shape = np.polynomial.Polynomial([0, 0, 0, 0, 0, 126, -420, 540, -315, 70])
    duration = 0.5
    cycle = 1e-3
    t = np.linspace(0.0, duration, 101)
    move = np.array([0.7, 0.4, -0.4, 0.5, 0.4, -0.4, 0.5])
    rows = [np.outer(shape.deriv(k)(t / duration) / duration**k, move) for k in (1, 2)]
    motion = Motion.from_points(t, HOME + np.outer(shape(t / duration), move), *rows,
                                joint_names=JOINTS)
    kp = 300.0
    kd = 20.0
    control = MotorSideControl(robot, motion, kp=kp, kd=kd)
    times = np.arange(0.0, duration + 0.4, cycle)
    elastic = control.command(times)
    q, u, _ = motion.sample(times)
    sag = elastic.positions[0] - HOME
    middles = times + 0.5 * cycle
    commands = {
        'elastic': (elastic.positions, elastic.velocities,
                    control.command(middles).torques),
        'rigid': (q + sag, u, rigid.inverse_dynamics(*motion.sample(middles)))}
    vibration = {}
    for name, command in commands.items():
        peer.put(np.concatenate([HOME, elastic.positions[0]]), np.zeros(14))
        places = []
        for theta, rate, torque in zip(*command):
            q, u = peer.state
            feedback = kp * (theta - q[7:]) + kd * (rate - u[7:])
            peer.step(np.concatenate([np.zeros(7), torque + feedback]), 4)
            places.append(peer.position('fr3_link8'))
        afterwards = np.array(places)[times >= duration]
        vibration[name] = np.ptp(afterwards, axis=0).max()
    assert vibration['rigid'] > 1e-3  # m
    assert vibration['elastic'] < vibration['rigid'] / 20.0
