"""Elastic joints: all formulations agree; derivatives are the torque's."""

from dataclasses import replace

import energies
from kane_dynamics import box, Drive, ModelBuilder, Robot, StiffnessCurve, with_drives
from kane_dynamics.mechanics.algebra.jet import moving, rates
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.mechanics.elastic_joints import spring_torque
from kane_dynamics.mechanics.joint_lanes.tree_in_lanes import TreeInLanes
from mechanisms import random_model
import numpy as np
from numpy.testing import assert_allclose
import pytest

LAW = {'damping': 0.4, 'friction': 1.5, 'friction_offset': 0.2}
LOADED = {**LAW, 'load_friction': 0.2, 'load_friction_backdriven': 0.35}


def elastic_model(seed, law=LAW):
    """Return a random tree with drives of all kinds and a slightly bent state."""
    rng = np.random.default_rng(seed)
    model = random_model(seed, 5)
    kinds = (Drive(900.0, damping=20.0, rotor_inertia=0.3, friction=law),
             Drive(StiffnessCurve([0.01, 0.03], [5.0, 30.0]),
                   damping=1.0, rotor_inertia=0.2, friction=law),
             Drive(StiffnessCurve([0.01, 0.03], [0.0, 30.0]), rotor_inertia=0.1),
             Drive(700.0, ratio=-50.0, damping=1.5, rotor_inertia=1e-3, friction=LAW,
                   full_coupling=True))
    drives = {}
    for k, joint in enumerate(model.coordinate_joints):
        drive = kinds[(seed + k) % 4]
        if drive.full_coupling and joint.kind == 'prismatic':
            drive = replace(drive, full_coupling=False)
        drives[joint.name] = drive
    model = with_drives(model, drives)
    q, u, udot, tau = rng.normal(size=(4, model.n))
    for _, _, link, motor in model.drives:
        q[motor] = q[link] + 0.02 * q[motor]
    return model, q, u, udot, tau


def transmitted_torques(model, q, u, udot):
    """Return B theta'' + k(delta) + D delta' of each motor, (n,), 0 of other joints."""
    loads = np.zeros(model.n)
    for _, drive, link, motor in model.drives:
        spring = spring_torque(drive, q[motor] - q[link])
        damping = drive.damping * (u[motor] - u[link])
        loads[motor] = drive.rotor_inertia * udot[motor] + spring + damping
    return loads


@pytest.mark.parametrize('law', [LAW, LOADED], ids=['plain', 'load friction'])
@pytest.mark.parametrize('seed', range(2))
def test_formulations_of_elastic_joints_agree(seed, law):
    model, q, u, udot, tau = elastic_model(seed, law)
    robot = Robot(model)
    expected = kane.inverse_dynamics(model, q, u, udot)
    size = 1e-11 * np.abs(robot.torque_terms(q, u, udot)).max()
    assert_allclose(robot.inverse_dynamics(q, u, udot), expected, rtol=0, atol=size)
    assert_allclose(robot.torque_terms(q, u, udot).sum(axis=0), expected,
                    rtol=0, atol=size)
    by_energy = (energies.generalized_inertia_force(model, q, u, udot)
                 + energies.conservative_force(model, q)
                 + energies.friction_force(model, u,
                                           transmitted_torques(model, q, u, udot)))
    assert_allclose(-by_energy, expected, rtol=0, atol=size)
    assert_allclose(robot.potential_energy(q), energies.potential_energy(model, q),
                    rtol=1e-12, atol=1e-12)
    acceleration = robot.forward_dynamics(q, u, tau)
    assert_allclose(robot.inverse_dynamics(q, u, acceleration), tau, rtol=0,
                    atol=1e-9 * (1.0 + np.abs(acceleration).max()))


@pytest.mark.parametrize('law', [LAW, LOADED], ids=['plain', 'load friction'])
@pytest.mark.parametrize('seed', range(2))
def test_derivatives_of_elastic_joints_are_exact(seed, law):
    model, q, u, udot, tau = elastic_model(seed, law)
    robot = Robot(model)
    equations = robot.equations.tree
    parameters = robot.parameters.block

    def columns(k):
        """Return the derivative of the torque by argument k, by dual numbers."""
        arguments = [q, u, udot]
        result = []
        for unit in np.eye(model.n):
            seeded = list(arguments)
            seeded[k] = moving(arguments[k], unit)
            result.append(rates(equations.inverse_dynamics(*seeded, None, parameters)))
        return np.stack(result, axis=1)

    expected = np.stack([columns(k) for k in range(3)]).astype(float)
    size = 1e-11 * np.abs(expected).max()
    analytic = robot.inverse_dynamics_derivatives(q, u, udot)
    assert_allclose(analytic, expected, rtol=0, atol=size)
    if equations.has_simple_joints:
        in_lanes = TreeInLanes(equations).inverse_dynamics_derivatives(
            q, u, udot, parameters)
        assert_allclose(in_lanes.astype(float), expected, rtol=0, atol=size)

    # Those of the acceleration invert those of the torque.
    udot = robot.forward_dynamics(q, u, tau)
    by_q, by_u, M = robot.inverse_dynamics_derivatives(q, u, udot)
    solved = robot.forward_dynamics_derivatives(q, u, tau)
    assert_allclose(M @ solved[0], -by_q, rtol=0, atol=1e-9 * np.abs(by_q).max())
    assert_allclose(M @ solved[1], -by_u, rtol=0, atol=1e-9 * np.abs(by_u).max())


def test_a_free_body_with_a_drive_at_a_slide_accelerates_by_the_definition():
    b = ModelBuilder('craft')
    b.body('craft', kind='free',
           inertial=box(8.0, (0.6, 0.4, 0.3), at=(0.05, 0.02, 0.01)))
    model = with_drives(b.model(),
                        {'craft/z': Drive(200.0, damping=0.5, rotor_inertia=0.3)})
    robot = Robot(model)
    q = robot.neutral()
    places = [robot.coordinate_names.index(name)
              for name in ('craft/z', 'craft/z_motor')]
    q[places] = 0.3, 0.32
    u, udot = np.random.default_rng(2).normal(size=(2, robot.n))
    tau = kane.inverse_dynamics(model, q, u, udot)
    assert_allclose(robot.forward_dynamics(q, u, tau), udot, rtol=0, atol=1e-11)
