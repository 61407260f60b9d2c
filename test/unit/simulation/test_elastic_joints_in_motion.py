"""Elastic joints in motion: closed forms, energy, order, stops, motors."""

import warnings

from kane_dynamics import (Drive, Inertial, Limits, load_urdf, longest_step,
                           ModelBuilder, natural_vibration, Prescribed, Robot, simulate,
                           StiffnessCurve, with_drives)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.errors import ModelWarning
from kane_dynamics.model.editing import with_locked
import numpy as np
import pytest

# Kg m^2, kg m^2, N m/rad, N m s/rad.
J = 0.5
B = 0.2
K = 800.0
D = 1.5
TWO_LINK = resource_path('urdf', 'two_link.urdf')


def two_mass(damping=0.0, stiffness=K, friction=None, **joint):
    """Return a link on a vertical axis, without gravity, behind an elastic drive."""
    builder = ModelBuilder('two mass', gravity=(0.0, 0.0, 0.0))
    link = Inertial(1.0, np.zeros(3), J * np.eye(3))
    builder.body('link', 'world', 'revolute',
                 axis=(0, 0, 1), joint='hinge', inertial=link,
                 **joint)
    drive = Drive(stiffness, damping, rotor_inertia=B, friction=friction or {})
    return with_drives(builder.model(), {'hinge': drive})


def elastic_two_link(**options):
    """Return a planar arm of two links with an elastic drive at each joint."""
    rigid = load_urdf(TWO_LINK)
    options = {'stiffness': 300.0, 'rotor_inertia': 0.05} | options
    return with_drives(rigid, {name: Drive(**options) for name in rigid.joint_names})


def state_matrix(damping, kp=0.0, kd=0.0):
    """Return A of x' = A x, x = (q, theta, q', theta'), under motor control."""
    stiffness = np.array([[K, -K], [-K, K + kp]])
    resistance = np.array([[damping, -damping], [-damping, damping + kd]])
    M = np.diag([J, B])
    return np.block([[np.zeros((2, 2)), np.eye(2)],
                     [-np.linalg.solve(M, stiffness), -np.linalg.solve(M, resistance)]])


def exponential(A):
    """Return the matrix exponential by eigenvectors."""
    values, vectors = np.linalg.eig(A)
    return (vectors * np.exp(values) @ np.linalg.inv(vectors)).real


def test_frequencies_of_a_two_mass_joint_are_those_of_the_closed_form():
    robot = Robot(two_mass())
    free = natural_vibration(robot, [0.3, 0.3]).frequencies
    np.testing.assert_allclose(free, [0.0, np.sqrt(K * (1.0 / J + 1.0 / B))], rtol=1e-12)
    locked = natural_vibration(robot, [0.3, 0.3], held=['hinge_motor']).frequencies
    np.testing.assert_allclose(locked, np.sqrt(K / J), rtol=1e-12)
    braked = natural_vibration(robot, [0.3, 0.3], held=['hinge']).frequencies
    np.testing.assert_allclose(braked, np.sqrt(K / B), rtol=1e-12)


def test_frequencies_with_motors_locked_are_those_of_joints_with_springs():
    model = elastic_two_link()
    q = np.array([0.3, -0.8, 0.3, -0.8])
    motors = [drive.drive.motor for drive in model.drives]
    held = natural_vibration(Robot(model), q, held=motors).frequencies
    # An arm whose joints have springs to the position of the locked motors.
    springs = Robot(with_locked(model, dict(zip(motors, q[2:]))))
    np.testing.assert_allclose(held, natural_vibration(springs, q[:2]).frequencies,
                               rtol=1e-12)


@pytest.mark.parametrize('damping', [0.0, D])
def test_a_two_mass_joint_moves_as_its_closed_form(damping):
    robot = Robot(two_mass(damping))
    x0 = np.array([0.1, -0.05, 0.3, 2.0])
    motion = simulate(robot, x0[:2], x0[2:], 0.5, step=5e-5)
    expected = exponential(0.5 * state_matrix(damping)) @ x0
    np.testing.assert_allclose([*motion.q[-1], *motion.u[-1]], expected, atol=1e-9)


@pytest.mark.parametrize('stiffness', [300.0, StiffnessCurve([0.01, 0.05], [0.0, 12.0])],
                         ids=['linear', 'backlash'])
def test_the_energy_of_links_springs_and_rotors_is_conserved(stiffness):
    robot = Robot(elastic_two_link(stiffness=stiffness), friction=False)
    q0 = np.array([0.4, 0.9, 0.42, 0.85])
    motion = simulate(robot, q0, [0.5, -1.0, 3.0, 2.0], 0.5, step=5e-5)
    total = motion.energy.sum(axis=1)
    assert np.ptp(motion.energy[:, 1]) > 1.0  # J: potential energy is exchanged
    assert np.abs(total - total[0]).max() < 1e-9 * np.ptp(motion.energy[:, 0])


@pytest.mark.parametrize(('integrator', 'order'), [('rk4', 4), ('implicit', 2)])
def test_the_order_of_the_integrators_holds_for_elastic_joints(integrator, order):
    robot = Robot(elastic_two_link(damping=0.2))
    q0 = [0.4, 0.9, 0.42, 0.85]
    u0 = [0.5, -1.0, 1.0, 0.0]

    def end(step):
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', ModelWarning)
            return simulate(robot, q0, u0, 0.1, step=step, integrator=integrator,
                            sample=0.1).q[-1]
    reference = end(1e-5)
    coarse = np.abs(end(1e-3) - reference).max()
    fine = np.abs(end(5e-4) - reference).max()
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.35)


def test_the_implicit_step_is_chosen_where_the_drive_is_too_stiff_for_the_explicit_one():
    robot = Robot(elastic_two_link(stiffness=3e6, damping=10.0))
    q0 = np.array([0.4, 0.9, 0.4, 0.9])
    with pytest.warns(ModelWarning, match="integrator 'implicit' is used"):
        motion = simulate(robot, q0, np.zeros(4), 0.2, step=1e-3)
    # So stiff a drive moves as a rigid joint with the rotor's inertia.
    builder = load_urdf(TWO_LINK, supplement={
        'joints': {name: {'armature': 0.05} for name in robot.model.joint_names[:2]}})
    rigid = simulate(Robot(builder), q0[:2], np.zeros(2), 0.2, step=1e-3)
    np.testing.assert_allclose(motion.q[-1, :2], rigid.q[-1], atol=1e-4)


def test_a_curve_counts_with_its_steepest_segment_for_the_step():
    stiff = 3e6
    backlash = StiffnessCurve([0.001, 0.002], [0.0, 1e-3 * stiff])
    q = [0.4, 0.9, 0.4, 0.9]
    of_curve = longest_step(Robot(elastic_two_link(stiffness=backlash)), q)
    of_line = longest_step(Robot(elastic_two_link(stiffness=stiff)), q)
    assert of_curve.step == pytest.approx(of_line.step, rel=1e-9)


@pytest.mark.slow
def test_an_implicit_step_crosses_the_dead_zone_of_a_stiff_curve():
    backlash = StiffnessCurve([0.001, 0.002], [0.0, 3e3], rounding=2e-6)
    robot = Robot(elastic_two_link(stiffness=backlash, damping=5.0))
    q0 = [0.4, 0.9, 0.4, 0.9]
    with pytest.warns(ModelWarning, match="integrator 'implicit' is used"):
        motion = simulate(robot, q0, np.zeros(4), 0.25, step=5e-4)
    reference = simulate(robot, q0, np.zeros(4), 0.25, step=2e-5)
    deflection = np.abs(motion.q[:, 2:] - motion.q[:, :2])
    assert 0.001 < deflection.max() < 0.00105
    np.testing.assert_allclose(motion.q[-1], reference.q[-1], atol=5e-4)


@pytest.mark.slow
def test_motors_that_are_held_leave_an_arm_on_springs():
    model = elastic_two_link(damping=0.1)
    motors = [drive.drive.motor for drive in model.drives]
    held = Robot(model, constraints=[Prescribed(motors[0], lambda t: 0.4 + 0.0 * t),
                                     Prescribed(motors[1], lambda t: 0.9 + 0.0 * t)])
    motion = simulate(held, [0.4, 0.9, 0.4, 0.9], np.zeros(2), 0.3, step=1e-3)
    springs = Robot(with_locked(model, {motors[0]: 0.4, motors[1]: 0.9}))
    reference = simulate(springs, [0.4, 0.9], np.zeros(2), 0.3, step=1e-3)
    np.testing.assert_allclose(motion.q[:, :2], reference.q, atol=1e-9)
    np.testing.assert_allclose(motion.q[:, 2:], np.tile([0.4, 0.9], (len(motion.t), 1)),
                               atol=1e-12)


def test_motors_that_move_as_functions_of_time_drive_the_links():
    # Link on a spring whose other end moves: J q'' = K (theta(t) - q).
    amplitude = 0.1
    rate = 5.0
    robot = Robot(two_mass(), constraints=[
        Prescribed('hinge_motor', lambda t: amplitude * np.sin(rate * t))])
    motion = simulate(robot, [0.0, 0.0], [0.0], 1.0, step=1e-3)
    w = np.sqrt(K / J)
    gain = amplitude * w * w / (w * w - rate * rate)
    expected = gain * (np.sin(rate * motion.t) - rate / w * np.sin(w * motion.t))
    np.testing.assert_allclose(motion.q[:, 0], expected, atol=1e-6)


def test_a_controller_of_the_motor_moves_the_link_as_the_linear_system_does():
    kp = 60.0
    kd = 8.0
    target = 0.5
    step = 1e-3
    robot = Robot(two_mass(D))

    def control(t, q, u):
        return [0.0, kp * (target - q[1]) - kd * u[1]]
    motion = simulate(robot, [0.0, 0.0], [0.0, 0.0], 1.0, step=step, torque=control)

    # The torque is held during a step: x+ = P x + G tau.
    A = state_matrix(D)
    augmented = np.zeros((5, 5))
    augmented[:4, :4] = A
    augmented[3, 4] = 1.0 / B
    # The matrix is defective, so that its exponential is computed by its series.
    power = np.eye(5)
    step_matrix = np.eye(5)
    for k in range(1, 25):
        power = power @ augmented * (step / k)
        step_matrix = step_matrix + power
    x = np.zeros(4)
    for _ in range(1000):
        tau = kp * (target - x[1]) - kd * x[3]
        x = (step_matrix @ [*x, tau])[:4]
    np.testing.assert_allclose([*motion.q[-1], *motion.u[-1]], x, atol=1e-8)


def test_stops_end_the_motion_of_the_link_and_not_of_the_motor():
    robot = Robot(two_mass(limits=Limits(-0.5, 0.5)))
    motion = simulate(robot, [0.0, 0.0], [2.0, 2.0], 0.4, step=1e-3, stops=True)
    assert [event.joint for event in motion.stop_events][:1] == ['hinge']
    assert motion.q[:, 0].max() <= 0.5 + 1e-6
    assert motion.q[:, 1].max() > 0.52
    # Against the stop the motor swings on the spring: 1/2 B theta'^2 = 1/2 K delta^2.
    first = motion.stop_events[0].t
    assert first == pytest.approx(0.25, abs=2e-3)
    assert motion.q[:, 1].max() - 0.5 == pytest.approx(2.0 * np.sqrt(B / K), rel=1e-3)


def test_friction_of_the_motor_and_of_the_link_act_on_their_sides():
    robot = Robot(two_mass(friction={'damping': 0.7}))
    udot = robot.forward_dynamics([0.2, 0.2], [1.0, 3.0], [0.0, 0.0])
    np.testing.assert_allclose(udot, [0.0, -0.7 * 3.0 / B], atol=1e-12)


def test_a_stuck_motor_holds_the_link_on_the_spring():
    robot = Robot(two_mass(friction={'friction': 50.0}))
    motion = simulate(robot, [0.02, 0.0], [0.0, 0.0], 0.3, step=1e-3, sticking=True)
    np.testing.assert_allclose(motion.q[:, 1], 0.0, atol=1e-12)
    expected = 0.02 * np.cos(np.sqrt(K / J) * motion.t)
    np.testing.assert_allclose(motion.q[:, 0], expected, atol=1e-5)
