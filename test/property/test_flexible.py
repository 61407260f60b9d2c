"""Flexible links: recursion with modal integrals, Kane's volume integrals, energies."""

from functools import cache

import energies
from examples.flexible_four_bar import flexible_four_bar
from examples.flexible_mast import mast_on_a_sleigh
from kane_dynamics import (ball, Bending, FlexibleLink, Inertial, load_urdf,
                           ModelBuilder, ModelError, natural_vibration, point_mass,
                           Robot, rod, simulate, Torsion, UrdfError, with_beam)
from kane_dynamics._util.resources import resource_path
from kane_dynamics.analysis.vibration import stiffness_matrix
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.mechanics.energy_form import finite_poses
from kane_dynamics.model.model import with_payload
from lagrange_constrained import EnergyForm, PasserelloHuston
from mechanisms import with_inertia_in
import numpy as np
import pytest

Y = (0, 1, 0)


def arm(modes=(2, 1), twists=0, **options):
    """Return a spatial arm of two beams, with a load between and a hand."""
    b = ModelBuilder('flexible arm')
    b.body('base', 'world', inertial=ball(1.0, 0.1))
    b.beam('upper', 'base',
           FlexibleLink(0.8, 1.5, (400.0, 600.0), modes, direction=(1, 0, 0.3),
                        damping=0.01, torsion=Torsion(
                            200.0, 0.002, twists) if twists else None, **options),
           axis=Y, at=(0, 0, 0.2), rpy=(0.3, 0.2, 0.1), armature=0.01, damping=0.1)
    b.beam('fore', 'upper/tip', FlexibleLink(
        0.6, 1.0, (200.0, 300.0), modes, torsion=Torsion(
            90.0, 0.003, 2 * twists, tip_inertia=0.004) if twists else None, **options),
           axis=(0, 1, 0.2), stiffness=2.0)
    b.load('fore/tip', point_mass(0.7, (0.02, 0.01, 0)))
    b.section('middle', 'fore', 0.25)
    b.body('hand', 'fore/tip', axis=(1, 0, 0),
           inertial=rod(0.5, (0, 0, 0), (0.1, 0.05, 0)))
    return b.model()


@cache
def arm_robot(twists=0):
    return Robot(arm(twists=twists), wrench_frames=('middle', 'hand'))


def states(model, seed=0):
    """Return q, u, udot with deflections of a few centimeters."""
    rng = np.random.default_rng(seed)
    rows = []
    for name in model.coordinate_names:
        rows.append(0.02 if '_' in name else 1.0)
    modal = np.array(rows)
    return rng.uniform(-1.0, 1.0, (3, model.n)) * modal


@pytest.mark.parametrize('seed, twists', [(0, 0), (3, 1), *(
    pytest.param(*case, marks=pytest.mark.slow) for case in ((1, 0), (2, 0), (4, 1)))])
def test_three_formulations_give_one_torque(seed, twists):
    robot = arm_robot(twists)
    model = robot.model
    q, u, udot = states(model, seed)
    push = np.random.default_rng(seed).uniform(-5.0, 5.0, (2, 6))
    tau = robot.inverse_dynamics(q, u, udot, wrench=push)
    wrenches = {name: (f[:3], f[3:]) for name, f in zip(('middle', 'hand'), push)}
    expected = kane.inverse_dynamics(model, q, u, udot, wrenches=wrenches)
    near = {'rtol': 0.0, 'atol': 1e-12 * (1.0 + np.abs(expected).max())}
    np.testing.assert_allclose(tau, expected, **near)
    J = [robot.jacobian(name, q) for name in ('middle', 'hand')]
    by_energy = -(energies.generalized_inertia_force(model, q, u, udot)
                  + energies.conservative_force(model, q)
                  + energies.friction_force(model, u)
                  + sum(partials.T @ f for partials, f in zip(J, push)))
    np.testing.assert_allclose(by_energy, expected, **near)
    np.testing.assert_allclose(robot.mass_matrix(q), energies.mass_matrix(model, q),
                               atol=1e-12)
    np.testing.assert_allclose(robot.mass_matrix(q), kane.mass_matrix(model, q),
                               atol=1e-12)
    assert robot.kinetic_energy(q, u) == pytest.approx(
        energies.kinetic_energy(model, q, u))
    assert robot.potential_energy(q) == pytest.approx(
        energies.potential_energy(model, q))
    np.testing.assert_allclose(robot.forward_dynamics(q, u, tau, wrench=push), udot,
                               atol=1e-8)


def fork(twists=0):
    """Return an arm that carries two beams; one has as many modes as that of the arm."""
    b = ModelBuilder('fork')
    torsion = Torsion(150.0, 0.002, twists) if twists else None
    b.beam('arm', 'world',
           FlexibleLink(0.8, 1.5, (400.0, 600.0), (2, 1), torsion=torsion), axis=Y)
    b.beam('left', 'arm/tip',
           FlexibleLink(0.6, 1.0, 200.0, (1, 0), direction=(0, 1, 0.2),
                        up=(0, 0, 1), damping=0.01), axis=(0, 0, 1), rpy=(0.2, 0, 0.4))
    b.beam('right', 'arm/tip',
           FlexibleLink(0.7, 1.2, (300.0, 200.0), (2, 1), direction=(0, -1, 0),
                        up=(0, 0, 1), torsion=torsion), axis=(1, 0, 0))
    b.load('right/tip', point_mass(0.4))
    return b.model()


@pytest.mark.parametrize('model', [arm(), arm((3, 0)), fork(), fork(2)],
                         ids=['arm', 'in a plane', 'fork', 'fork with twists'])
def test_accelerations_of_several_beams_are_those_of_the_definition(model):
    q, u, tau = states(model, 7)
    expected = kane.forward_dynamics(model, q, u, tau)
    np.testing.assert_allclose(Robot(model).forward_dynamics(q, u, tau), expected,
                               rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_the_torque_by_body_is_that_of_the_arm_in_which_only_this_body_has_inertia():
    robot = arm_robot(1)
    q, u, udot = states(robot.model, 6)
    parts = robot.explain(q, u, udot)
    near = {'rtol': 0.0, 'atol': 1e-12 * np.abs(parts.by_body).max()}
    # Of every second body, which take a second each; the sum below counts the others
    # too.
    for k, name in list(enumerate(parts.bodies))[::2]:
        # Elasticity and damping of a beam are its own.
        alone = with_inertia_in(robot.model, [k])
        by_energy = -(energies.generalized_inertia_force(alone, q, u, udot)
                      + energies.conservative_force(alone, q)
                      + energies.friction_force(alone, u))
        np.testing.assert_allclose(parts.by_body[k], by_energy, err_msg=name, **near)
    of_joints = {'upper': 0.01 * udot[1] + 0.1 * u[1], 'fore': 2.0 * q[6]}
    total = parts.by_body.sum(axis=0)
    for joint, force in of_joints.items():
        total[robot.joint_names.index(joint)] += force
    np.testing.assert_allclose(total, parts.torque, **near)
    assert robot.verify(2) < 1e-11


def test_frames_on_a_beam_move_as_finite_differences_of_their_poses():
    robot = arm_robot(1)
    h = 1e-6
    q, u, udot = states(robot.model, 4)
    for frame in ('middle', 'fore/tip', 'hand'):
        pose_after, pose_before = (robot.frame_pose(frame, q + s * h * u)
                                   for s in (1.0, -1.0))
        velocity = robot.frame_velocity(frame, q, u)
        np.testing.assert_allclose(
            velocity[:3], (pose_after - pose_before)[:3, 3] / (2 * h), atol=1e-8)
        spin = (pose_after - pose_before)[:3, :3] / (2 * h) @ robot.frame_pose(
            frame, q)[:3, :3].T
        np.testing.assert_allclose(velocity[3:], [spin[2, 1], spin[0, 2], spin[1, 0]],
                                   atol=1e-8)
        np.testing.assert_allclose(robot.jacobian(frame, q) @ u, velocity, atol=1e-12)
        moved = []
        for s in (1.0, -1.0):
            moved.append((robot.jacobian(frame, q + s * h * u),
                          robot.frame_velocity(frame, q + s * h * u, u + s * h * udot)))
        np.testing.assert_allclose(robot.jacobian_rate(frame, q, u),
                                   (moved[0][0] - moved[1][0]) / (2 * h), atol=1e-7)
        np.testing.assert_allclose(robot.frame_acceleration(frame, q, u, udot),
                                   (moved[0][1] - moved[1][1]) / (2 * h), atol=1e-7)


def test_reaction_about_a_joint_is_the_torque_that_reaches_the_link():
    robot = Robot(arm(), friction=False)
    q, u, udot = states(robot.model, 5)
    tau = robot.inverse_dynamics(q, u, udot)
    for joint, friction in (('upper', 0.01), ('fore', 0.0), ('hand', 0.0)):
        k = robot.joint_names.index(joint)
        body = next(b for b in robot.model.bodies if b.joint.name == joint)
        axis = robot.frame_pose(joint, q)[:3, :3] @ body.joint.axis
        held = tau[k] - friction * udot[k] - body.joint.stiffness * q[k]
        assert robot.joint_reaction(joint, q, u, udot)[3:] @ axis == pytest.approx(held)


def test_no_modes_is_the_rigid_robot():
    rigid = Robot(arm((0, 0)))
    none = ModelBuilder('rods')
    end = 0.8 * np.array([1, 0, 0.3]) / np.linalg.norm([1, 0, 0.3])
    none.body('base', 'world', inertial=ball(1.0, 0.1))
    none.body('upper', 'base', axis=Y, at=(0, 0, 0.2), rpy=(0.3, 0.2, 0.1),
              armature=0.01, damping=0.1, inertial=rod(1.2, (0, 0, 0), end))
    none.body('fore', 'upper', axis=(0, 1, 0.2), at=end, stiffness=2.0,
              inertial=rod(0.6, (0, 0, 0), (0.6, 0, 0)))
    none.frame('tip', 'fore', at=(0.6, 0, 0))
    none.load('tip', point_mass(0.7, (0.02, 0.01, 0)))
    none.body('hand', 'tip', axis=(1, 0, 0),
              inertial=rod(0.5, (0, 0, 0), (0.1, 0.05, 0)))
    without_modes = Robot(none.model())
    assert not rigid.model.flexible
    assert rigid.operation_count()['inverse_dynamics'] == (
        without_modes.operation_count()['inverse_dynamics'])
    state = np.random.default_rng(0).uniform(-1, 1, (3, 4))
    np.testing.assert_allclose(rigid.inverse_dynamics(*state),
                               without_modes.inverse_dynamics(*state), rtol=1e-12)


@pytest.mark.parametrize('sense', [1, -1])
def test_a_joint_in_the_plane_of_bending_turns_with_the_section_it_is_on(sense):
    b = ModelBuilder('in plane')
    b.beam('upper', 'world', FlexibleLink(0.8, 1.5, 400.0, (1, 1)), axis=(0, -1, 0))
    b.body('fore', 'upper/tip', axis=(0, sense, 0), at=(0, 0.1, 0), rpy=(0, 0.4, 0),
           inertial=rod(0.5, (0, 0, 0), (0.4, 0.05, 0.1)), armature=0.01, damping=0.1)
    robot = Robot(b.model())
    assert robot.verify(3) < 1e-12
    # Of two turns and the roll.
    assert robot.operation_count()['mass_matrix'].functions == 6


def test_a_planar_arm_takes_no_more_arithmetic_than_its_terms_need():
    b = ModelBuilder('planar')
    for name, on in (('upper', 'world'), ('fore', 'upper/tip')):
        b.beam(name, on, FlexibleLink(1.0, 1.0, 400.0, (3, 0)), armature=0.05)
    b.load('fore/tip', point_mass(0.5))
    count = Robot(b.model()).operation_count()['forward_dynamics']
    # 123 and 102 of them for the terms that make M definite
    assert count.multiplications <= 703
    assert count.additions <= 558
    assert count.functions == 4


def test_energy_split_is_the_volume_integral():
    # 1/2 int v.v dm = KE_rigid + 1/2 int [(w x d)^2 + d'^2 + 2 (v_n.d' + v_n.w x d +
    # d'.w x d)] dm
    model = arm()
    q, u, _ = states(model, 6)
    rates = energies.pose_rates(model, q, u)
    poses = finite_poses.poses(model, q)
    for body, T, T_rate in zip(model.bodies, poses, rates):
        beam = body.beam
        if beam is None:
            continue
        eta = q[list(beam.coordinates)]
        speed = u[list(beam.coordinates)]
        R = T[:3, :3]
        turning = T_rate[:3, :3] @ T[:3, :3].T
        whole = split = rigid = 0.0
        for x, dm, phi, H in zip(beam.points, beam.weights, beam.shapes,
                                 beam.shortening):
            d = R @ (eta @ phi - 0.5 * (eta @ H @ eta) * beam.direction)
            # In the beam's axes.
            d_rate = R @ (speed @ phi - (eta @ H @ speed) * beam.direction)
            v_n = T_rate[:3, :3] @ x + T_rate[:3, 3]
            v_p = T_rate[:3, 3] + turning @ (R @ x + d) + d_rate
            across = turning @ d
            whole += 0.5 * dm * v_p @ v_p
            rigid += 0.5 * dm * v_n @ v_n
            split += 0.5 * dm * (across @ across + d_rate @ d_rate + 2.0 * (
                v_n @ d_rate + v_n @ across + d_rate @ across))
        straight = np.sum((T_rate @ body.inertial.pseudo_inertia) * T_rate)
        assert rigid == pytest.approx(0.5 * straight, rel=1e-12)
        assert rigid + split == pytest.approx(whole, rel=1e-13)


def cantilever(modes=4, tip=0.0, assumed=None, gravity=(0, 0, 0)):
    """Return a beam of unit wave speed on a turning root: L = 2 m, EI = 16 rho A."""
    b = ModelBuilder('cantilever', gravity=gravity)
    b.beam('beam', 'world', FlexibleLink(2.0, 0.5, 8.0, (modes, 0), bending=assumed))
    if tip:
        b.load('beam/tip', point_mass(tip))
    return Robot(b.model())


def wave_numbers(robot, held=('beam',)):
    """Return beta L of the vibrations: (omega / sqrt(EI / rho A L^4))^(1/2)."""
    return np.sqrt(natural_vibration(robot, np.zeros(robot.n), held).frequencies)


def test_natural_frequencies_are_those_of_the_beam():
    exact = [1.875104, 4.694091, 7.854757, 10.995541]
    np.testing.assert_allclose(wave_numbers(cantilever()), exact, rtol=1e-6)
    pinned = [3.926602, 7.068583, 10.210176]
    np.testing.assert_allclose(
        wave_numbers(cantilever(3, assumed=Bending.pinned_free()), ()),
        [0.0, *pinned], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(  # a mass of twice the beam's at the tip
        wave_numbers(cantilever(3, 2.0, Bending.clamped_free(2.0))),
        [1.076196, 3.982574, 7.102651], rtol=1e-6)


@pytest.mark.parametrize('tip, hub, held, exact', [
    (2.0, 0.0, ('beam',), [1.076196, 3.982574]), (0.0, 0.0, (), [3.926602, 7.068583])])
def test_frequencies_of_other_ends_converge_with_the_number_of_modes(
        tip, hub, held, exact):
    errors = []
    for modes in (3, 5, 8):
        wave_numbers_found = wave_numbers(cantilever(modes, tip), held)
        wave_numbers_found = wave_numbers_found[wave_numbers_found > 1e-3][:2]
        errors.append(np.abs(wave_numbers_found**2 / np.square(exact) - 1.0).max())
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-3


def test_a_hub_of_inertia_makes_the_beam_that_the_frequency_equation_says():
    inertia = 3.0  # of the hub, kg m^2, beside rho A L^3 = 4
    b = ModelBuilder('hub', gravity=(0, 0, 0))
    b.beam('beam', 'world', FlexibleLink(2.0, 0.5, 8.0, (8, 0)), armature=inertia)
    numbers = wave_numbers(Robot(b.model()), ())[1:3]
    ratio = inertia / 4.0

    def equation(x):  # ratio x^3 (1 + cos cosh) = cos sinh - sin cosh
        return ratio * x**3 * (1 + np.cos(x) * np.cosh(x)) + (
            np.sin(x) * np.cosh(x) - np.cos(x) * np.sinh(x))
    for x in numbers:
        exact = x * (1.0 + np.linspace(-2e-3, 2e-3, 4001))
        signs = np.sign(equation(exact))
        root = exact[np.argmax(signs[1:] != signs[:-1])]
        assert (signs[1:] != signs[:-1]).any()
        assert x**2 == pytest.approx(root**2, rel=1e-3)


def rotating_by_ritz(speed, hub):
    """Return nondimensional flap frequencies of a rotating beam, by Ritz's method."""
    x, w = np.polynomial.legendre.leggauss(40)
    x = 0.5 * (x + 1.0)
    w = 0.5 * w
    rows = []
    for k in range(9):
        p = np.polynomial.Legendre.basis(k, domain=[0, 1])
        square = np.polynomial.Polynomial([0, 0, 1]) * p.convert(
            kind=np.polynomial.Polynomial)
        rows.append([f(x) for f in (square, square.deriv(), square.deriv(2))])
    phi, slope, bend = (np.array([row[j] for row in rows]) for j in range(3))
    tension = speed**2 * (hub * (1 - x) + 0.5 * (1 - x**2))
    M = (phi * w) @ phi.T
    K = (bend * w) @ bend.T + (slope * (w * tension)) @ slope.T
    return np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real))


def shaft(twists, tip=0.0, assumed=0.0, **options):
    """Return a clamped shaft, GJ = 5, rho I_p = 0.2, L = 2, an inertia at its tip."""
    b = ModelBuilder('shaft', gravity=(0, 0, 0))
    b.beam('shaft', 'world', FlexibleLink(2.0, 0.5, 8.0, 0, torsion=Torsion(
        5.0, 0.2, twists, assumed)), armature=1e9, **options)
    if tip:
        b.load('shaft/tip', Inertial(0.0, np.zeros(3), np.diag([tip, tip, tip])))
    return Robot(b.model())


def test_a_shaft_twists_at_its_natural_frequencies():
    # Clamped-free: (2k - 1) / (4 L) sqrt(GJ / rho I_p) Hz; with an inertia at the tip:
    # cot b = b J / (rho I_p L), omega = b / L sqrt(GJ / rho I_p).
    robot = shaft(3)
    assert robot.coordinate_names == ('shaft', 'shaft/twist_1', 'shaft/twist_2',
                                      'shaft/twist_3')
    hertz = natural_vibration(robot, np.zeros(4), ['shaft']).frequencies / (2.0 * np.pi)
    np.testing.assert_allclose(hertz, [k / 8.0 * 5.0 for k in (1, 3, 5)], rtol=1e-9)
    tip = 0.3
    speed = 5.0
    for assumed, near in ((tip, 2e-6), (0.29, 1e-3)):
        frequencies = natural_vibration(
            shaft(3, tip, assumed), np.zeros(4), ['shaft']).frequencies
        b = frequencies * 2.0 / speed
        exact = [first_root(lambda b: np.cos(b) - b * tip / 0.4 * np.sin(b), k)
                 for k in range(3)]
        np.testing.assert_allclose(b, exact, rtol=near)
    errors = [natural_vibration(shaft(k, tip), np.zeros(k + 1), ['shaft']).frequencies[0]
              * 2.0 / speed / exact[0] - 1.0 for k in (2, 4, 8)]
    assert errors[0] > errors[1] > errors[2] > 0.0


def first_root(f, k):
    """Return the root of f in (k pi, (k + 1/2) pi)."""
    x = np.linspace(k * np.pi, (k + 0.5) * np.pi, 2_000_001)
    signs = np.sign(f(x))
    return x[np.argmax(signs[1:] != signs[:-1])]


def test_eccentric_load_twists_a_shaft_by_its_weight():
    # theta = m g d / (GJ / L) as far as the first modes go; the load sinks by d theta.
    m = 0.01
    d = 0.1
    b = ModelBuilder('crank')
    b.beam('shaft', 'world',
           FlexibleLink(2.0, 0.5, 8.0, 0, torsion=Torsion(5.0, 0.2, 6, 1e3)),
           axis=(0, 1, 0))
    b.frame('hook', 'shaft/tip', at=(0, d, 0))
    b.load('hook', point_mass(m))
    robot = Robot(b.model())
    q = np.zeros(7)
    K = stiffness_matrix(robot, np.zeros(7))[1:, 1:]
    for _ in range(4):
        q[1:] -= np.linalg.solve(K, robot.bias_force(q, np.zeros(7))[1:])
    angle = m * 9.81 * d / (5.0 / 2.0)
    assert robot.frame_pose('hook', q)[2, 3] == pytest.approx(-d * angle, rel=1e-4)


def test_a_tube_is_a_beam_of_its_section():
    tube = FlexibleLink.tube(1.5, 0.05, 0.04, 70e9, 26e9, 2700.0, (2, 1), 1,
                             damping=1e-3)
    area = np.pi * (0.05**2 - 0.04**2)
    polar = 0.5 * np.pi * (0.05**4 - 0.04**4)
    assert tube.density == pytest.approx(2700.0 * area)
    assert tube.stiffness == pytest.approx(70e9 * polar / 2)
    assert tube.torsion.stiffness == pytest.approx(26e9 * polar)
    inertial = tube.assumed_modes('tube').inertial
    assert inertial.inertia[0, 0] == pytest.approx(
        2700.0 * area * 1.5 * (0.05**2 + 0.04**2) / 2)
    assert inertial.inertia[1, 1] == pytest.approx(2700.0 * area * 1.5 * (
        (0.05**2 + 0.04**2) / 4 + 1.5**2 / 12))
    with pytest.raises(ModelError, match=r'tube: bore 0\.06 m, radius'):
        FlexibleLink.tube(1.5, 0.05, 0.06, 70e9, 26e9, 2700.0)


@pytest.mark.parametrize('hub', [0.0, 1.0, 3.0])
def test_rotating_beam_stiffens(hub):
    # In units of sqrt(EI / rho A L^4): flap as Ritz has it, lag^2 = flap^2 - speed^2.
    b = ModelBuilder('rotor', gravity=(0, 0, 0))
    b.body('hub', 'world', inertial=ball(1.0, 0.1))
    b.frame('rim', 'hub', at=(hub, 0, 0))
    b.beam('blade', 'rim', FlexibleLink(1.0, 1.0, 1.0, (6, 6)), stiffness=1e9)
    robot = Robot(b.model())
    names = list(robot.coordinate_names)
    lag, flap = (slice(names.index(f'blade/mode_{k}'),
                       names.index(f'blade/mode_{k}') + 6) for k in (1, 7))
    for speed in (0.0, 1.0, 3.0, 6.0, 12.0):
        u = np.zeros(robot.n)
        u[0] = speed

        def bias(k, step, u=u):
            q = np.zeros(robot.n)
            q[k] = step
            return robot.bias_force(q, u)
        h = 1e-5
        K = np.array([(bias(k, h) - bias(k, -h)) / (2 * h) for k in range(robot.n)]).T
        exact = rotating_by_ritz(speed, hub)[:2]
        for part, expected in ((flap, exact), (lag, np.sqrt(exact**2 - speed**2))):
            frequencies = np.sqrt(np.sort(np.linalg.eigvalsh(K[part, part]))[:2])
            np.testing.assert_allclose(frequencies, expected, rtol=5e-3)
    published = {0.0: 3.5160, 3.0: 4.7973, 12.0: 13.1702}  # first flap, no hub
    if hub == 0.0:
        for speed, value in published.items():
            assert rotating_by_ritz(speed, 0.0)[0] == pytest.approx(value, abs=1e-4)


def test_energy_of_a_falling_arm_is_kept_at_the_integrators_order():
    b = ModelBuilder('two beams')
    for name, on in (('upper', 'world'), ('fore', 'upper/tip')):
        b.beam(name, on, FlexibleLink(1.0, 1.0, 300.0, (2, 0), direction=(1, 0, 0),
                                      up=(0, 0, 1)), axis=(0, -1, 0), armature=0.05)
    robot = Robot(b.model())
    errors = []
    for step in (4e-4, 2e-4, 1e-4):
        run = simulate(robot, np.zeros(robot.n), np.zeros(robot.n), 0.4, step=step)
        total = run.energy.sum(axis=1)
        errors.append(np.abs(total - total[0]).max())
    assert errors[0] / errors[1] > 12.0
    assert errors[1] / errors[2] > 12.0


@pytest.mark.parametrize('make', [flexible_four_bar, mast_on_a_sleigh])
def test_constraints_on_flexible_links_match_the_energy_formulation(make):
    robot = make()
    start = np.array([0.8, 0.0, 0.0, 0.0, -1.5]) if robot.n_q == 5 else np.zeros(
        robot.n_q)
    q = start
    if make is flexible_four_bar:
        q = robot.closed_configuration(
            start, fixed=['crank', 'coupler/mode_1', 'coupler/mode_2'])
    rng = np.random.default_rng(1)
    rows = []
    for name in robot.speed_names:
        rows.append(0.02 if 'mode' in name else 1.0)
    modal = np.array(rows)
    u, udot = rng.uniform(-1.0, 1.0, (2, robot.n)) * modal
    road = EnergyForm(robot.mechanism, PasserelloHuston())
    tau = robot.inverse_dynamics(q, u, udot)
    np.testing.assert_allclose(tau, road.inverse_dynamics(q, u, udot), rtol=1e-9,
                               atol=1e-9 * (1.0 + np.abs(tau).max()))
    np.testing.assert_allclose(robot.forward_dynamics(q, u, tau), udot, atol=1e-8)
    run = simulate(robot, q, u, 0.2, step=1e-4)
    assert run.drift < 1e-9


@pytest.mark.parametrize('values, words', [
    ({'length': 0.0}, "beam 'b': length 0; expected a positive number"),
    ({'density': -1.0}, "beam 'b': density -1; expected a positive number"),
    ({'stiffness': -5.0}, "beam 'b': stiffness -5.0; expected positive EI"),
    ({'damping': -0.1}, "beam 'b': damping -0.1; expected a nonnegative number"),
    ({'modes': 1.5}, "beam 'b': modes 1.5; expected one or two numbers of modes"),
    ({'modes': [1, 2, 3]}, r"'b': modes \[1, 2, 3\]; expected one or two numbers"),
    ({'modes': [[1], 2]}, r"'b': modes \[\[1\], 2\]; expected one or two numbers"),
    ({'modes': []}, r"'b': modes \[\]; expected one or two numbers of modes, 0 to 32"),
    ({'modes': (33, 0)}, r"'b': modes \(33, 0\); expected .* 0 to 32"),
    ({'stiffness': [1.0, 2.0, 3.0]}, r"'b': stiffness \[1.0, .*; expected positive EI"),
    ({'stiffness': 'stiff'}, "'b': stiffness 'stiff'; expected positive EI"),
    ({'torsion': Torsion(1.0, 1.0, 33)}, "'b': torsion: modes 33; expected an integer"),
    ({'torsion': Torsion(-1.0, 0.1)},
     "beam 'b': torsion: stiffness -1; expected a positive"),
    ({'torsion': Torsion(1.0, 0.0)},
     "beam 'b': torsion: inertia 0; expected a positive"),
    ({'torsion': Torsion(1.0, 1.0, -1)},
     "beam 'b': torsion: modes -1; expected an integer"),
    ({'torsion': Torsion(1.0, 1.0, 1, -2.0)},
     'torsion: tip_inertia -2; expected a nonneg'),
    ({'up': (2, 0, 0)}, "beam 'b': direction .* and up .*; expected two different"),
    ({'bending': Bending.shapes(lambda x: (np.stack([x**2, 2 * x**2]), np.stack(
        [2 * x, 4 * x]), np.full((2, len(x)), 2.0))), 'modes': (2, 0)},
     "beam 'b': 2 linearly dependent shapes of bending"),
    ({'bending': Bending.shapes(lambda x: (x, x, x)), 'modes': (2, 0)},
     r'bending shapes: .*; expected three finite arrays of shape \(2, ')])
def test_invalid_beam_is_rejected_by_name_and_value(values, words):
    arguments = {'length': 1.0, 'density': 1.0, 'stiffness': 5.0, **values}
    with pytest.raises(ModelError, match=words):
        ModelBuilder().beam('b', 'world', FlexibleLink(**arguments))


def test_user_defined_shapes_are_supported():
    shapes = Bending.shapes(lambda x: (
        np.stack([x**2, x**3, x**4]), np.stack([2 * x, 3 * x**2, 4 * x**3]),
        np.stack([2 + 0 * x, 6 * x, 12 * x**2])))
    numbers = wave_numbers(cantilever(3, assumed=shapes))
    assert numbers[0]**2 == pytest.approx(1.875104**2, rel=1e-3)
    with pytest.raises(ModelError, match=r"3.0 m on beam 'beam'; expected 0 to 2 m"):
        b = ModelBuilder()
        b.beam('beam', 'world', FlexibleLink(2.0, 0.5, 8.0))
        b.section('beyond', 'beam', 3.0)


UPPER_ARM = {'length': 0.6127, 'density': 12.0, 'stiffness': [5e3, 6e3], 'modes': [2, 1],
             'direction': [-1, 0, 0], 'up': [0, 0, 1], 'damping': 1e-3}


def ur10e(**beams):
    return load_urdf(resource_path('urdf', 'ur10e.urdf'), supplement={'beams': beams})


def test_a_link_of_a_urdf_bends_by_its_supplement():
    model = ur10e(
        upper_arm_link={**UPPER_ARM, 'torsion': {'stiffness': 4e3, 'inertia': 0.05}})
    robot = Robot(model)
    rigid = Robot(ur10e())
    assert robot.joint_names[6:] == tuple(
        f'upper_arm_link/{name}' for name in ('mode_1', 'mode_2', 'mode_3', 'twist_1'))
    assert robot.verify(2) < 1e-9
    configuration = np.array([0.3, -1.0, 1.0, 0.2, 0.1, 0.5])
    q = np.append(configuration, np.zeros(4))
    for frame in ('tool0', 'forearm_link'):
        np.testing.assert_allclose(robot.frame_pose(frame, q),
                                   rigid.frame_pose(frame, configuration), atol=1e-12)
    # A stiff beam matches the rigid arm except for its own mass.
    moved = robot.model.bodies[1].inertial
    assert moved.mass == pytest.approx(12.0 * 0.6127)
    frequencies = natural_vibration(
        robot, q, held=robot.joint_names[:6]).frequencies / (2 * np.pi)
    assert 5.0 < frequencies[0] < 15.0  # Hz, with some 20 kg at its end


def test_inertia_attached_to_a_bending_link_is_kept():
    source = resource_path('urdf', 'two_link.urdf')
    com = [0.1, 0.05, 0.02]
    beams = {
        'link2': {'length': 0.4, 'density': 3.0, 'stiffness': 100.0, 'modes': [1, 1]}}
    bare, *held = (load_urdf(source, supplement={'beams': beams, **payload})
                   for payload in (
                       {}, *({'payload': {'link': link, 'mass': 1.5, 'com': com}}
                             for link in ('tip', 'link2'))))
    q = states(bare, 1)[0]
    expected = energies.conservative_force(
        with_payload(bare, 'tip', point_mass(1.5, com)), q)
    np.testing.assert_allclose(energies.conservative_force(held[0], q), expected)
    beside, = (body for body in held[1].bodies if body.inertial.mass == 1.5)
    # The section nearest to its center of mass.
    assert beside.name.startswith('link2/at_0.1/')
    locked = load_urdf(resource_path('urdf', 'ur10e.urdf'), supplement={
        'beams': {'upper_arm_link': UPPER_ARM}}, joints=['shoulder_pan_joint',
                                                         'shoulder_lift_joint'])
    assert locked.bodies[-1].name.startswith('upper_arm_link/at_0.6127/')
    assert locked.bodies[-1].inertial.mass == pytest.approx(3.989 + 2.1 + 1.98 + 0.615)


def test_second_beam_is_attached_to_the_first():
    arm = with_beam(ur10e(upper_arm_link=UPPER_ARM), 'forearm_link', FlexibleLink(
        0.57155, 8.0, 4e3, (1, 1), direction=(-1, 0, 0), up=(0, 0, 1)))
    assert Robot(arm).verify(1) < 1e-9
    with pytest.raises(ModelError,
                       match="link 'forearm_link': is a beam already; expected"):
        with_beam(arm, 'forearm_link', FlexibleLink(1.0, 1.0, 1.0))


@pytest.mark.parametrize('beams, error, words', [
    ({'lower_arm': UPPER_ARM}, ModelError,
     "no moving link 'lower_arm' to bend; expected one of shoulder"),
    ({'upper_arm_link': {'length': 1.0}}, UrdfError,
     "supplement: beam 'upper_arm_link': density is missing"),
    ({'upper_arm_link': {**UPPER_ARM, 'length': -1}}, UrdfError,
     'length: -1; expected a fin'),
    ({'upper_arm_link': {**UPPER_ARM, 'torsion': {'stiffness': 1}}}, UrdfError,
     "beam 'upper_arm_link': torsion: inertia is missing"),
    ({'upper_arm_link': {**UPPER_ARM, 'width': 1}}, UrdfError, "unknown key 'width'")])
def test_invalid_beam_in_a_supplement_is_rejected(beams, error, words):
    with pytest.raises(error, match=words):
        ur10e(**beams)


def test_payload_moves_with_the_beam_that_carries_it():
    b = ModelBuilder('pendulum')  # hanging: weight alone pulls back
    b.beam('beam', 'world', FlexibleLink(1.0, 0.5, 200.0, (2, 0), direction=(0, 0, -1),
                                         up=(1, 0, 0)), axis=Y)
    bare = b.model()
    b.load('beam/tip', point_mass(2.0))
    robot = Robot(bare, payload_frame='beam/tip')
    loaded = Robot(b.model())
    robot.parameters.payload = point_mass(2.0)
    at_rest = np.zeros(robot.n)
    np.testing.assert_allclose(natural_vibration(robot, at_rest).frequencies,
                               natural_vibration(loaded, at_rest).frequencies, rtol=1e-9)
    assert (natural_vibration(Robot(bare), at_rest).frequencies[0]
            > 1.05 * natural_vibration(loaded, at_rest).frequencies[0])
