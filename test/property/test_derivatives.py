"""Derivatives, regressor, reactions: against autodiff and balance laws."""

from hyperdual import seeded
from hypothesis import given
from kane_dynamics import Robot
from kane_dynamics.mechanics.definition import kane, kinematics
from mechanisms import random_model
import numpy as np
from strategies import robots_and_states

EPS = np.finfo(float).eps
PUSH = np.array([[1.0, -2.0, 0.5, 0.3, 0.1, -0.7]])


def gradients(vector, count):
    """Return the (n, count) gradients of a vector of hyper-dual numbers."""
    return np.array([getattr(x, 'gradient', np.zeros(count)) for x in vector])


def size_of(*matrices):
    """Return the size to which rounding is relative."""
    return 1e-2 + max(np.abs(matrix).max() for matrix in matrices)


@given(robots_and_states(3))
def test_inverse_dynamics_derivatives_are_the_definitions(drawn):
    robot, q, u, udot = drawn
    n = robot.n
    none = np.zeros(robot.n)
    torque = kane.inverse_dynamics(robot.model, seeded(q, none, 0, 2 * n),
                                   seeded(u, none, n, 2 * n), udot)
    expected = gradients(torque, 2 * n)
    by_q, by_u, M = robot.inverse_dynamics_derivatives(q, u, udot)
    size = size_of(expected, robot.torque_terms(q, u, udot))
    np.testing.assert_allclose(np.hstack([by_q, by_u]), expected,
                               rtol=0.0, atol=1e-11 * size)
    np.testing.assert_allclose(M, robot.mass_matrix(q),
                               rtol=0.0, atol=1e-13 * np.abs(M).max())


@given(robots_and_states(3, most=4))
def test_forward_dynamics_derivatives_undo_those_of_inverse_dynamics(drawn):
    robot, q, u, tau = drawn
    udot = robot.forward_dynamics(q, u, tau)
    by_q, by_u, M = robot.inverse_dynamics_derivatives(q, u, udot)
    forward_q, forward_u, W = robot.forward_dynamics_derivatives(q, u, tau)
    tolerance = 100.0 * EPS * np.linalg.cond(M) ** 2
    for product, expected in ((M @ forward_q, -by_q), (M @ forward_u, -by_u),
                              (M @ W, np.eye(robot.n))):
        size = size_of(by_q, by_u, robot.torque_terms(q, u, udot))
        np.testing.assert_allclose(product, expected, rtol=0.0, atol=tolerance * size)


@given(robots_and_states(3))
def test_coriolis_matrix_gives_the_force_and_holds_christoffels_symbols(drawn):
    robot, q, u, x = drawn
    at_rest = np.zeros(robot.n)
    C = robot.coriolis_matrix(q, u)
    force = robot.torque_terms(q, u, at_rest)[1]
    size = size_of(force, C) * (1.0 + np.abs(u).max() + np.abs(x).max())
    np.testing.assert_allclose(C @ u, force, rtol=0.0, atol=1e-12 * size)
    # The force is quadratic in u, so Christoffel's C(u) x is symmetric in u and x.
    np.testing.assert_allclose(C @ x, robot.coriolis_matrix(q, x) @ u, rtol=0.0,
                               atol=1e-11 * size)


@given(robots_and_states(3))
def test_regressor_times_parameters_is_the_rigid_bodies_torque(drawn):
    robot, q, u, udot = drawn
    parts = robot.explain(q, u, udot)
    value = robot.regressor(q, u, udot) @ robot.inertial_parameters
    size = size_of(parts.by_source, parts.by_body)
    np.testing.assert_allclose(value, parts.by_body.sum(axis=0),
                               rtol=0.0, atol=1e-12 * size)


@given(robots_and_states(3))
def test_an_explanation_adds_up_by_source_and_by_body(drawn):
    robot, q, u, udot = drawn
    parts = robot.explain(q, u, udot, wrench=PUSH)
    size = size_of(parts.by_source, parts.by_body)
    torque = robot.inverse_dynamics(q, u, udot, wrench=PUSH)
    np.testing.assert_allclose(parts.torque, torque, rtol=0.0, atol=1e-12 * size)
    rigid = sum(parts.source(name) for name in ('inertia', 'coriolis', 'gravity'))
    rigid = rigid - robot.equations.tree.rotor_inertia * udot
    np.testing.assert_allclose(parts.by_body.sum(axis=0), rigid,
                               rtol=0.0, atol=1e-12 * size)


@given(robots_and_states(3))
def test_reactions_balance_newtons_and_eulers_equations_of_each_body(drawn):
    robot, q, u, udot = drawn
    model = robot.model
    bodies = kinematics.configurations(model, q)
    motions = kinematics.motions(model, bodies, q, u, udot)
    reactions = [robot.joint_reaction(body.joint.name, q, u, udot, wrench=PUSH)
                 for body in model.bodies]
    pushed = robot.equations.wrench_frames[0]
    at = kinematics.frame_pose(model, pushed, q)[1]
    size = size_of(*reactions)
    for k, (body, placed, motion) in enumerate(zip(model.bodies, bodies, motions)):
        # Forces and moments on the body, and where they act: its joint, those of the
        # bodies that it carries, the external wrench.
        loads = [(reactions[k], placed.p_wb)]
        for c, child in enumerate(model.bodies):
            if child.parent == k:
                loads.append((-reactions[c], bodies[c].p_wb))
        if pushed.body == k:
            loads.append((PUSH[0], at))
        force = sum(load[:3] for load, _ in loads) + body.inertial.mass * model.gravity
        moment = sum(load[3:] + np.cross(p - placed.p_com, load[:3])
                     for load, p in loads)
        inertia = placed.R_wb @ body.inertial.inertia @ placed.R_wb.T
        spin = inertia @ motion.alpha + np.cross(motion.omega, inertia @ motion.omega)
        np.testing.assert_allclose(force, body.inertial.mass * motion.a_com, rtol=0.0,
                                   atol=1e-11 * size)
        np.testing.assert_allclose(moment, spin, rtol=0.0, atol=1e-11 * size)


@given(robots_and_states(3))
def test_a_reaction_about_the_joints_axis_is_the_torque_that_reaches_the_link(drawn):
    robot, q, u, udot = drawn
    parts = robot.explain(q, u, udot)
    reaching = (parts.torque - parts.source('friction') - parts.source('spring')
                - robot.equations.tree.rotor_inertia * udot)
    bodies = kinematics.configurations(robot.model, q)
    total = np.zeros(robot.n)
    for body, placed in zip(robot.model.bodies, bodies):
        reaction = robot.joint_reaction(body.joint.name, q, u, udot)
        along = reaction[3:] if body.joint.kind == 'revolute' else reaction[:3]
        total[body.joint.coordinate] += body.joint.multiplier * (along @ placed.axis)
    np.testing.assert_allclose(total, reaching,
                               rtol=0.0, atol=1e-11 * size_of(parts.by_source))


def test_reactions_and_regressors_use_the_full_inertial_parameters():
    # Base-parameter regrouping moves inertia between bodies, which must not affect
    # reactions.
    model = random_model(4, 5)
    robot = Robot(model)
    at_rest = np.zeros(5)
    for k, body in enumerate(model.bodies):
        beyond = [i for i in range(5) if k in model.path(i)]
        weight = -sum(model.bodies[i].inertial.mass for i in beyond) * model.gravity
        reaction = robot.joint_reaction(body.joint.name, at_rest, at_rest, at_rest)
        np.testing.assert_allclose(reaction[:3], weight, rtol=1e-12)
