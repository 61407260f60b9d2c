"""Chosen speeds and constraints: compiled equations against Kane's definition."""

from dataclasses import replace

from constrained_trees import (closure, CLOSURES, KINDS, linkage_of_four_bars,
                               rolling_disc, rolling_pair, ROLLING_TESTED, states, T,
                               tree, two_bodies_on_a_base)
from kane_dynamics.mechanics.algebra.jet import moving, rates
from kane_dynamics.mechanics.constraints import (Closure, Coupling, Rolling)
from kane_dynamics.mechanics.constraints.independent_speeds import choose_independent
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.constraints.speeds import (body_angular_velocity)
from kane_dynamics.mechanics.definition import kinematics, nonholonomic
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
from kane_dynamics.model.model import Frame, WORLD
from mechanisms import random_model
import numpy as np
import pytest


def compiled_equations(mechanism):
    """Return the equations that are compiled."""
    return Equations(TreeEquations(mechanism.model), mechanism)


def check_formulations(mechanism, seed):
    """Compare inverse dynamics, motion, constraint rows and power of one state."""
    model = mechanism.model
    equations = compiled_equations(mechanism)
    q, u, udot = states(mechanism, seed)
    tau = equations.inverse_dynamics(q, u, udot, None, model.gravity, T).astype(float)
    expected = nonholonomic.inverse_dynamics(mechanism, q, u, udot, T)
    size = 1.0 + np.abs(expected).max()
    np.testing.assert_allclose(tau, expected, rtol=0.0, atol=1e-10 * size)
    forward = equations.forward_dynamics(q, u, tau, None, model.gravity, T).astype(float)
    M = equations.mass_matrix(q, model.gravity, T).astype(float)
    np.testing.assert_allclose(forward, udot, rtol=0.0,
                               atol=1e-12 * size * np.linalg.cond(M))
    motion = mechanism.joint_motion(q, u, udot, T)
    qdot = motion.qdot.astype(float)
    qddot = motion.qddot.astype(float)
    speed = 1.0 + np.abs(qdot).max() ** 2 + np.abs(qddot).max()
    for value, of_definition in zip((qdot, qddot),
                                    nonholonomic.joint_motion(mechanism, q, u, udot, T)):
        np.testing.assert_allclose(value, of_definition, rtol=0.0, atol=1e-9 * speed)
    rows = mechanism.rows(mechanism.state(moving(q, qdot), moving(T, 1.0)))
    placed = mechanism.rows(mechanism.state(q, T))
    J = np.array(placed.J, dtype=float)
    b = np.array(placed.b, dtype=float)
    np.testing.assert_allclose(J @ qdot, b, rtol=0.0, atol=1e-10 * speed)
    np.testing.assert_allclose(rates(rows.J) @ qdot + J @ qddot, rates(rows.b), rtol=0.0,
                               atol=1e-9 * speed)
    # Constraint forces do no work in any motion that the independent speeds can make.
    np.testing.assert_allclose(J @ motion.T.astype(float), 0.0,
                               atol=1e-10 * np.abs(J).max())
    return equations, (q, u, udot)


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('speeds', ['rates', 'absolute', 'momenta', 'wavy'])
@pytest.mark.parametrize('kind', KINDS)
def test_compiled_equations_match_kanes_definition_on_trees(kind, speeds, seed):
    check_formulations(tree(seed, kind, speeds), seed)


@pytest.mark.parametrize('kind', ['revolute', 'spherical'])
def test_compiled_equations_match_kanes_definition_on_a_closed_loop(kind):
    mechanism = choose_independent(linkage_of_four_bars(), None, (
        Closure('pin_coupler', 'pin_rocker', kind, axis=(0, 1, 0)),))
    assert mechanism.n == 1
    assert len(mechanism.kept) == 2  # the out-of-plane rows are dependent
    check_formulations(mechanism, 1)


def test_compiled_equations_match_kanes_definition_on_a_chain_welded_at_both_ends():
    chain = random_model(11, 8, branching=0.0, prismatic=0.0)
    tip = chain.frames[-1]
    R, p = kinematics.frame_pose(chain, tip, np.full(8, 0.2))
    model = replace(chain, frames=(*chain.frames, Frame('dock', WORLD, R, p)))
    mechanism = choose_independent(model, None, (Closure(tip.name, 'dock', 'weld'),))
    assert mechanism.n == 2
    check_formulations(mechanism, 4)


def test_compiled_equations_match_kanes_definition_on_a_rolling_disc():
    for speeds in (None, body_angular_velocity('disc')):
        mechanism = choose_independent(rolling_disc(), speeds,
                                       (Rolling('disc', 0.3, axis=(0, 1, 0)),))
        assert mechanism.n == 3
        check_formulations(mechanism, 2)


def test_constraint_forces_are_what_is_missing_from_the_joints_balance():
    mechanism = choose_independent(linkage_of_four_bars(), None, (
        Closure('pin_coupler', 'pin_rocker', 'spherical'),), ('crank',))
    equations, (q, u, udot) = check_formulations(mechanism, 3)
    g = mechanism.model.gravity
    tau = equations.inverse_dynamics(q, u, udot, None, g, T).astype(float)
    motor = np.array([tau[0], 0.0, 0.0])
    forces = equations.constraint_forces(q, u, tau, None, g, T).astype(float)
    motion = mechanism.joint_motion(q, u, udot, T)
    needed = equations.tree.inverse_dynamics(
        q, motion.qdot, motion.qddot, None, g).astype(float)
    J = np.array(mechanism.rows(mechanism.state(q, T)).J, dtype=float)
    np.testing.assert_allclose(motor + J.T @ forces, needed, rtol=0.0,
                               atol=1e-10 * np.abs(needed).max())


@pytest.mark.parametrize('kind', CLOSURES)
def test_compiled_equations_are_kanes_definition_under_every_closure(kind):
    check_formulations(
        choose_independent(two_bodies_on_a_base(), None, (closure(kind),)), 3)


@pytest.mark.parametrize('kind', ROLLING_TESTED)
def test_compiled_equations_are_kanes_definition_in_rolling_on_a_moving_surface(kind):
    check_formulations(rolling_pair(kind), 4)


@pytest.mark.parametrize('seed', range(12))
def test_loops_of_every_kind_between_any_bodies_move_as_in_the_definition(seed):
    """Frames turned and shifted, on branches, mimics, the world; loops share links."""
    rng = np.random.default_rng(seed)
    model = random_model(seed, 9, prismatic=(0.0, 0.3, 1.0)[seed % 3], branching=0.4,
                         mimics=2)
    frames = [frame.name for frame in model.frames]
    constraints = []
    for k, kind in enumerate(rng.choice(CLOSURES, 2)):
        constraints.append(
            replace(closure(kind, *rng.choice(frames, 2, replace=False).tolist()),
                    name=f'loop{k}'))
    # The laws hold in open loops too.
    q, speeds, changes = rng.uniform(-2.0, 2.0, (3, model.n))
    everything = Mechanism(model, None, constraints)
    S = np.zeros((0, model.n))
    free = []
    dependent = []
    J = everything.rows(everything.state(q)).J.astype(float)
    # Choose rows, then rates, that are well independent of those chosen already.
    candidates = [(dependent, k, J[k]) for k in range(len(J))]
    candidates += [(free, k, np.eye(model.n)[k]) for k in range(model.n)]
    for chosen, k, row in candidates:
        extended = np.vstack([S, row])
        least = np.linalg.svd(extended, compute_uv=False)[-1]
        if least > 0.01 and len(extended) <= model.n:
            S = extended
            chosen.append(k)
    mechanism = Mechanism(model, None, constraints, free, dependent)
    n = len(free)
    motion = mechanism.joint_motion(q, speeds[:n], changes[:n],
                                    links=TreeEquations(model).geometry)
    expected = nonholonomic.joint_motion(mechanism, q, speeds[:n], changes[:n])
    for value, of_definition in zip((motion.qdot, motion.qddot), expected):
        np.testing.assert_allclose(value.astype(float), of_definition, rtol=0.0,
                                   atol=1e-12 * np.abs(of_definition).max())


def test_rows_of_a_loop_are_found_by_their_place_not_by_their_name():
    model = two_bodies_on_a_base()
    names = model.joint_names
    bound = Coupling(names[1], {names[0]: 1.0}, name='pin/x')
    mechanism = choose_independent(model, None, (
        replace(closure('spherical'), name='pin'), bound))
    check_formulations(mechanism, 3)
