"""Both energy formulations against Kane's equations, speeds and constraints."""

from dataclasses import replace
from functools import cache

from admissible_motion import admissible
from constrained_trees import (closure, CLOSURES, KINDS, linkage_of_four_bars,
                               rolling_disc, rolling_pair, ROLLING_TESTED, states, T,
                               tree, tree_constraints, two_bodies_on_a_base, wavy)
from kane_dynamics import ConstraintError
from kane_dynamics.mechanics.constraints import Closure, Rolling
from kane_dynamics.mechanics.constraints.independent_speeds import choose_independent
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.constraints.speeds import (body_angular_velocity, momenta,
                                                        Speeds)
from kane_dynamics.mechanics.definition import kane, nonholonomic
from kane_dynamics.mechanics.energy_form.finite_poses import poses
from kane_dynamics.mechanics.energy_form.hamilton import HamiltonByVariations
from kane_dynamics.model.model import Frame, WORLD
from lagrange_constrained import EnergyForm, PasserelloHuston
from mechanisms import random_model
import numpy as np
import pytest

FORMS = {'Passerello and Huston': PasserelloHuston(),
         'vector variations': HamiltonByVariations()}
SCLERONOMIC = ('a point in the world', 'a point seen from a body', 'a knife edge',
               'a coupling')


def mostly_slow(kinds, *always):
    """Return the kinds, all but a few marked slow: fifteen coordinates take seconds."""
    return [kind if kind in always else pytest.param(kind, marks=pytest.mark.slow)
            for kind in kinds]


def close(value, expected, size=None):
    """Assert agreement to 1e-9 of the size, by default that of the second array."""
    size = 1.0 + np.abs(expected).max() if size is None else size
    np.testing.assert_allclose(value, expected, rtol=0.0, atol=1e-9 * size)


def check_motion(mechanism, q, u, udot):
    """Compare W, X, A, B, q' and q'' with partial velocities; return the motion."""
    motion = admissible(mechanism, q, u, udot, T)
    of_kane = nonholonomic.reduction(mechanism, q, T)
    for name in 'WXAB':
        value = getattr(of_kane, name)
        close(getattr(motion, name), value, 1.0 + np.abs(value).max(initial=0.0))
    qdot, qddot = nonholonomic.joint_motion(mechanism, q, u, udot, T)
    close(motion.qdot, qdot)
    close(motion.qddot, qddot, 1.0 + np.abs(qdot).max() ** 2 + np.abs(qddot).max())
    return motion


class OfKane:
    """Forces of a state by Kane's definition, with wrenches at the last frame."""

    def __init__(self, mechanism, q, u, udot):
        """Compute tau, M, equivalent joint torques, and the force of each row."""
        model = mechanism.model
        self.wrenches = {model.frames[-1].name: (np.array([3.0, -2.0, 1.0]),
                                                 np.array([0.5, 1.0, -1.5]))}
        self.tau = nonholonomic.inverse_dynamics(mechanism, q, u, udot, T,
                                                 wrenches=self.wrenches)
        motion = mechanism.joint_motion(q, u, udot, T)
        P = motion.T.astype(float)
        self.N = motion.N.astype(float)
        self.M = P.T @ kane.mass_matrix(model, q) @ P
        held = kane.inverse_dynamics(model, q, motion.qdot.astype(float),
                                     motion.qddot.astype(float), wrenches=self.wrenches)
        self.torques = np.array(mechanism.speeds.of(q, T)[0],
                                dtype=float)[mechanism.free].T @ self.tau
        self.constraint_forces = self.N.T @ (held - self.torques)
        # Bias and tau cancel in forward dynamics: where M^-1 times their rounding
        # exceeds 1e-9.
        self.rounding = 1e-5 * np.abs(self.tau).max() * np.linalg.norm(
            np.linalg.inv(self.M), 2)
        self.size = 1.0 + np.abs(held).max() + np.abs(self.torques).max()


def check(mechanism, seed):
    """
    Hold both forms to Kane's definition at one state.

    Return the power of the constraints by each, and the size to which it is exact.
    """
    q, u, udot = states(mechanism, seed)
    motion = check_motion(mechanism, q, u, udot)
    kanes = OfKane(mechanism, q, u, udot)
    powers = []
    speed = 1.0 + np.abs(motion.qdot).max()
    for form in FORMS.values():
        road = EnergyForm(mechanism, form)
        close(road.inverse_dynamics(q, u, udot, T, wrenches=kanes.wrenches), kanes.tau)
        close(road.forward_dynamics(q, u, kanes.tau, T, wrenches=kanes.wrenches), udot,
              1.0 + np.abs(udot).max() + kanes.rounding)
        on_joints = road.joint_constraint_force(q, u, kanes.torques, T,
                                                wrenches=kanes.wrenches)
        # No work in virtual motions.
        close(motion.variations.T @ on_joints, 0.0, kanes.size)
        close(kanes.N.T @ on_joints, kanes.constraint_forces, kanes.size)
        powers.append(on_joints @ motion.qdot)
        close(powers[-1], kanes.constraint_forces @ motion.b, kanes.size * speed)
    return np.abs(powers), kanes.size * speed


@pytest.mark.parametrize('speeds', ['rates', 'wavy', *(
    pytest.param(speeds, marks=pytest.mark.slow) for speeds in ('absolute', 'momenta'))])
@pytest.mark.parametrize('kind', KINDS)
def test_energy_formulation_matches_kanes_on_trees(kind, speeds):
    powers, size = check(tree(1, kind, speeds), 1)
    if kind in SCLERONOMIC:  # constraints at rest do no work
        assert powers.max() < 1e-9 * size
    if kind == 'a prescribed joint':  # one that moves does
        assert powers.min() > 1e-6 * size


@pytest.mark.parametrize('joined', ['revolute', 'spherical'])
def test_energy_formulation_matches_kanes_on_a_closed_loop(joined):
    mechanism = choose_independent(linkage_of_four_bars(), wavy(3, 2), (
        Closure('pin_coupler', 'pin_rocker', joined, axis=(0, 1, 0)),))
    powers, size = check(mechanism, 1)
    assert powers.max() < 1e-9 * size


def test_energy_formulation_matches_kanes_on_a_welded_spatial_loop():
    model = random_model(4, 7, branching=0.0, prismatic=0.0)
    T_tip = poses(model, np.linspace(0.2, 0.8, 7))[-1]
    model = replace(model, frames=(*model.frames, Frame('tip', 6),
                                   Frame('socket', WORLD, T_tip[:3, :3], T_tip[:3, 3])))
    mechanism = choose_independent(model, momenta, (Closure('tip', 'socket'),))
    assert mechanism.n == 1  # six rows, all of them independent
    powers, size = check(mechanism, 1)
    assert powers.max() < 1e-9 * size


@pytest.mark.parametrize('speeds', [None, body_angular_velocity('disc')])
def test_energy_formulation_matches_kanes_on_a_rolling_disc(speeds):
    mechanism = choose_independent(rolling_disc(), speeds,
                                   (Rolling('disc', 0.3, axis=(0, 1, 0)),))
    powers, size = check(mechanism, 2)
    assert powers.max() < 1e-9 * size


@cache
def branched():
    """Return a branched tree with mimic joints, wavy speeds and two constraints."""
    model = random_model(8, 6, branching=0.5, mimics=2)
    kinds = tree_constraints(model.frames[-1].name, model.frames[2].name)
    return choose_independent(model, wavy(6, 3), (kinds['a point seen from a body'],
                                                  kinds['a prescribed joint']))


def test_energy_formulation_is_kanes_on_a_branched_tree_with_mimics_and_constraints():
    assert branched().n == 4
    check(branched(), 5)


def test_mass_matrix_and_constraint_forces_are_kanes():
    mechanism = branched()
    q, u, udot = states(branched(), 5)
    kanes = OfKane(mechanism, q, u, udot)
    for form in FORMS.values():
        road = EnergyForm(mechanism, form)
        close(road.mass_matrix(q, T), kanes.M)
        close(road.constraint_forces(q, u, kanes.torques, T, wrenches=kanes.wrenches)[
            mechanism.kept], kanes.constraint_forces, kanes.size)


def test_friction_is_left_out_on_request():
    mechanism = branched()
    state = states(branched(), 6)
    expected = nonholonomic.inverse_dynamics(mechanism, *state, T, friction=False)
    for form in FORMS.values():
        close(EnergyForm(mechanism, form, friction=False).inverse_dynamics(*state, T),
              expected)


@pytest.mark.parametrize('seed', range(4))
def test_each_term_may_be_varied_in_any_frame(seed):
    mechanism = branched()
    state = states(branched(), seed)
    count = len(mechanism.model.bodies)
    frames = np.random.default_rng(seed).integers(WORLD, count, (2, count))
    expected = EnergyForm(mechanism, HamiltonByVariations()).inverse_dynamics(*state, T)
    form = EnergyForm(mechanism, HamiltonByVariations(*frames))
    close(form.inverse_dynamics(*state, T), expected)


def test_singular_speeds_and_constraints_are_named():
    model = random_model(3, 2, branching=0.0)
    flat = Speeds(lambda q, t: np.array([[q[0], 0.0], [0.0, 1.0]]),
                  names=('slow', 'fast'))
    with pytest.raises(ConstraintError, match='speeds slow, fast are singular at q'):
        admissible(Mechanism(model, flat), np.array([0.0, 0.5]), np.ones(2), np.ones(2))
    coupling = tree_constraints('', '')['a prescribed joint']
    rates = Mechanism(model, None, (coupling,), free=[1], kept=[0])
    with pytest.raises(ConstraintError,
                       match='prescribed joint1 on the speeds joint0 are'):
        admissible(rates, np.zeros(2), np.ones(1), np.ones(1))


@pytest.mark.parametrize('kind', mostly_slow(CLOSURES, 'universal', 'distance'))
def test_energy_formulation_is_kanes_under_every_closure(kind):
    mechanism = choose_independent(two_bodies_on_a_base(), None, (closure(kind),))
    powers, size = check(mechanism, 3)
    assert powers.max() < 1e-9 * size


@pytest.mark.parametrize('kind',
                         mostly_slow(ROLLING_TESTED, 'ball on plane', 'wheel on sphere'))
def test_energy_formulation_is_kanes_in_rolling_on_a_moving_surface(kind):
    powers, size = check(rolling_pair(kind), 4)
    assert powers.max() < 1e-9 * size
