"""Beams that hinge and bend in two planes: mass matrix, energy, rigid segments."""

from itertools import product

from kane_dynamics import (Bending, box, FlexibleLink, Inertial, ModelBuilder,
                           point_mass, Robot, rod, simulate, Torsion)
import numpy as np
import pytest

LENGTH = 1.0
DENSITY = 0.8
STIFFNESS = 40.0
TIP = 0.3
CASES = 2000


def hinged(modes, axis, twists=0, load=None, bending=None, **options):
    """Return a beam on a hinge, and optionally a load at its tip."""
    b = ModelBuilder('hinged beam')
    b.beam('beam', 'world', FlexibleLink(
        LENGTH, DENSITY, STIFFNESS, modes, bending=bending,
        torsion=Torsion(20.0, 1e-3, twists) if twists else None, **options), axis=axis)
    if load is not None:
        b.load('beam/tip', load)
    return Robot(b.model())


def deflected(beam, count, deflection, seed):
    """Return random modal coordinates, (count, m), with this largest deflection, m."""
    rng = np.random.default_rng(seed)
    m = len(beam.coordinates)
    # Modes of equal and of very different amplitudes, and shapes of a few modes.
    eta = rng.normal(size=(count, m)) * 10.0 ** rng.uniform(-2.0, 0.0, (count, m))
    few = eta * (rng.uniform(size=(count, m)) < 0.5)
    eta = np.where(few.any(axis=1, keepdims=True), few, eta)
    d = np.linalg.norm(np.einsum('gmk,cm->cgk', beam.shapes, eta), axis=2).max(axis=1)
    bends = beam.shapes.any(axis=(0, 2))
    scaled = np.where(bends, eta * (deflection / np.maximum(d, 1e-9))[:, None], eta)
    return np.where(d[:, None] > 1e-9, scaled, np.where(bends, 0.0, eta))


def least_eigenvalues(robot, q):
    """Return the least eigenvalue of M, scaled to ones on its diagonal, at every q."""
    M = robot.mass_matrix(q)
    size = np.sqrt(np.einsum('nii->ni', M))
    return np.linalg.eigvalsh(M / size[:, :, None] / size[:, None])[:, 0]


def assert_definite(robot, seed):
    """
    Require, while admissible, 0.4 of the least eigenvalue of the straight beam.

    If no mode of the straight beam moves with the hinge, its least eigenvalue is far
    larger than that of a bent beam: 0.05 is enough.
    """
    beam = robot.model.bodies[0].beam
    straight = least_eigenvalues(robot, np.zeros((1, robot.n)))[0]
    assert straight > 1e-4
    for part in (1.0, 0.3, 0.03):  # of the admissible deflection
        eta = deflected(beam, CASES, 0.1 * LENGTH * part, seed)
        q = np.concatenate([np.zeros((len(eta), 1)), eta], axis=1)
        assert least_eigenvalues(robot, q).min() > min(0.4 * straight, 0.05)


@pytest.mark.parametrize('modes, axis, twists', [
    ((3, 3), (0, 1, 0), 0), ((4, 4), (1, 2, 3), 1)])
def test_mass_matrix_is_positive_definite_at_every_admissible_deflection(
        modes, axis, twists):
    assert_definite(hinged(modes, axis, twists), 1)


@pytest.mark.slow
@pytest.mark.parametrize('first', range(5))
def test_mass_matrix_is_positive_definite_for_all_modes_and_loads(first):
    offset = Inertial(0.4, np.array([0.05, 0.1, -0.1]), np.diag([2e-3, 3e-3, 4e-3]))
    loads = (None, point_mass(TIP), offset)
    for second, twists, axis in product(range(5), (0, 2),
                                        ((0, 1, 0), (0, 0, 1), (1, 2, 3))):
        if first + second + twists:
            load = loads[(first + second + twists) % 3]
            assert_definite(hinged((first, second), axis, twists, load),
                            10 * first + second)


@pytest.mark.parametrize('twists', [0, 1])
def test_energy_of_a_beam_that_bends_in_both_planes_is_kept_to_a_billionth(twists):
    robot = hinged(
        (2, 2), (0, 1, 0.3), twists,
        load=box(0.3, (0.1, 0.06, 0.02)).moved(np.eye(3), np.array([0, 0.1, 0])))
    q = np.zeros(robot.n)
    u = np.zeros(robot.n)
    # A tip deflection of nearly a tenth of the length.
    q[1:5] = 0.033, 0.003, -0.026, 0.002
    u[0] = 3.0
    run = simulate(robot, q, u, 0.1, step=1e-5)
    energy = run.energy.sum(axis=1)
    exchanged = np.ptp(run.energy[:, 0])
    assert np.abs(energy - energy[0]).max() < 1e-9 * exchanged


def chain(count, axis, load):
    """
    Return a chain of rigid segments with elastic universal joints.

    The joints are in the middles of `count` equal parts, where the chain has the bending
    stiffness of the part.
    """
    h = LENGTH / count
    b = ModelBuilder('chain')
    b.body('segment 0', 'world', axis=axis,
           inertial=rod(DENSITY * h / 2, (0, 0, 0), (h / 2, 0, 0)))
    place = h / 2
    for k in range(count):
        long = h if k + 1 < count else h / 2
        b.body(f'cross {k}', f'segment {k}', axis=(0, 0, 1), at=(place, 0, 0),
               stiffness=STIFFNESS / h)
        b.body(f'segment {k + 1}', f'cross {k}', axis=(0, 1, 0), stiffness=STIFFNESS / h,
               inertial=rod(DENSITY * long, (0, 0, 0), (long, 0, 0)))
        place = h
    b.frame('tip', f'segment {count}', at=(h / 2, 0, 0))
    b.load('tip', load)
    return Robot(b.model())


def tip_after(robot, frame, torque, duration=0.08):
    """Return the pose of the tip after a constant torque on the hinge."""
    tau = np.zeros(robot.n)
    tau[0] = torque
    at_rest = np.zeros(robot.n)
    run = simulate(robot, at_rest, at_rest, duration,
                   step=2e-5, torque=tau, sample=duration)
    return robot.frame_pose(frame, run.q[-1])


# Tip y by torque, mm, of plane chains of 40 segments, which differ from those of 20 by
# 2e-5; tip z of chains in space of 10 and 20 segments, extrapolated.
TIP_Y = {0.5: 2.83664, 2.0: 11.34788, 4.0: 22.70428}
TIP_Z = -33.371


@pytest.mark.parametrize('modes, bending, near', [
    ((3, 3), None, 4e-3), ((6, 2), Bending.clamped_free(TIP), 1e-3)])
def test_a_swinging_beam_moves_as_chains_of_rigid_segments(modes, bending, near):
    robot = hinged(modes, (0, 0, 1), load=point_mass(TIP), bending=bending)
    for torque, expected in TIP_Y.items():
        _, y, z = 1e3 * tip_after(robot, 'beam/tip', torque)[:3, 3]
        assert y == pytest.approx(expected, rel=near)
        assert z == pytest.approx(TIP_Z, rel=2e-3)


@pytest.mark.slow
def test_chains_of_rigid_segments_converge_to_the_recorded_motion():
    load = point_mass(TIP)
    coarse = chain(5, (0, 0, 1), load)
    fine = chain(10, (0, 0, 1), load)
    for torque, expected in TIP_Y.items():
        few = 1e3 * tip_after(coarse, 'tip', torque)[1, 3]
        many = 1e3 * tip_after(fine, 'tip', torque)[1, 3]
        assert abs(many - expected) < 0.6 * abs(few - expected)
        assert many == pytest.approx(expected, rel=2e-3)


def transported(modes, eta, axes):
    """Return the axes of a beam's end by integrating the curvature, without torsion."""
    R = np.eye(3)
    steps = 2000
    middles = (np.arange(steps) + 0.5) * LENGTH / steps
    curvature = np.einsum('gmk,m->gk', modes.at(middles)[2], eta)
    slope = np.einsum('gmk,m->gk', modes.at(middles)[1], eta)
    for bend, turn in zip(curvature, slope):
        omega = np.cross(axes[0] + turn, bend) * LENGTH / steps  # to second order
        K = np.cross(omega, np.eye(3)).T
        R = (np.eye(3) + K + 0.5 * K @ K) @ R
    return R


def test_a_section_rolls_as_an_untwisted_beam_does_to_second_order():
    link = FlexibleLink(LENGTH, DENSITY, STIFFNESS, (2, 2))
    modes = link.assumed_modes('beam')
    robot = hinged((2, 2), (0, 1, 0))
    eta = np.array([0.9, 0.3, -0.7, 0.2])
    errors = []
    rolls = []
    for size in (0.04, 0.02):
        turned = robot.frame_pose('beam/tip', np.append(0.0, size * eta))[:3, :3]
        expected = transported(modes, size * eta, modes.axes)
        errors.append(np.abs(turned - expected)[2, 1])
        rolls.append(abs(expected[2, 1]))
    assert rolls[0] > 0.01
    assert errors[0] < 0.01 * rolls[0]
    assert errors[1] < 0.1 * errors[0]
