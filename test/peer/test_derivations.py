"""Derivations on paper against SymPy's KanesMethod."""

from kane_dynamics import (box, Closure, disc, knife_edge, ModelBuilder, point_mass,
                           Robot, rod, Rolling)
from kane_dynamics.closed_forms import derivation
from kane_dynamics.closed_forms.derivation_code import as_code
import numpy as np
import pytest
from sympy_kane import Peer

X, Y, Z = np.eye(3)
RNG = np.random.default_rng(4)


def rolling_disc():
    """Return a disc on a plane, its rows of SymPy, and a state."""
    b = ModelBuilder('disc')
    b.body('disc', 'world', 'floating', turns='zxy', inertial=disc(2, 0.5, Y))
    robot = Robot(b.model(), constraints=[Rolling('disc', 0.5, axis=Y)],
                  independent=['disc/rz', 'disc/rx', 'disc/ry'])
    peer = Peer(robot.model)
    upright, _ = peer.body('disc/rx')
    wheel, center = peer.body('disc')
    contact = center.vel(peer.N) + wheel.ang_vel_in(peer.N).cross(-0.5 * upright.z)
    rows = [contact.dot(axis) for axis in peer.N]
    return robot, peer, rows, [0.1, 0.2, 0.45, 0.3, 0.4, 0.2]


def sleigh():
    """Return Chaplygin's sleigh."""
    b = ModelBuilder('sleigh')
    b.body('sleigh', 'world', 'planar', inertial=box(3, (1, 0.4, 0.1), at=(0.3, 0.1, 0)))
    b.frame('blade', 'sleigh', at=(-0.4, 0.05, 0))
    robot = Robot(b.model(), constraints=[knife_edge('blade', Y)],
                  independent=['sleigh/x', 'sleigh/rz'])
    peer = Peer(robot.model)
    frame, _ = peer.body('sleigh')
    slip = peer.point('sleigh', (-0.4, 0.05, 0)).vel(peer.N).dot(frame.y)
    return robot, peer, [slip], [0.1, 0.2, 0.3]


def four_bar():
    """Return a four-bar with the velocity constraints of its cut pin."""
    b = ModelBuilder('four_bar')
    at = np.zeros(3)
    on = 'world'
    for name, length in (('crank', 0.3), ('coupler', 0.9), ('rocker', 0.7)):
        b.body(name, on, axis=Y, at=at, inertial=rod(2 * length, (0, 0, 0), length * X))
        on = name
        at = length * X
    b.frame('end', 'rocker', at=at)
    b.frame('ground', 'world', at=X)
    robot = Robot(b.model(), constraints=[Closure('end', 'ground', 'revolute', axis=Y)],
                  independent=['crank'])
    peer = Peer(robot.model)
    v = peer.point('rocker', 0.7 * X).vel(peer.N)
    return robot, peer, [v.dot(peer.N.x), v.dot(peer.N.z)], [0.4, 0.6, 1.5]


def cart():
    """Return an inverted pendulum on a moving cart."""
    b = ModelBuilder('cart')
    b.body('cart', 'world', 'prismatic', axis=X, inertial=point_mass(2))
    b.body('pole', 'cart', axis=Y, inertial=rod(1.5, (0, 0, 0), (0, 0, 0.8)))
    robot = Robot(b.model())
    return robot, Peer(robot.model), [], [0.2, 0.4]


@pytest.mark.parametrize('mechanism', [rolling_disc, sleigh, four_bar, cart])
def test_the_derivation_is_that_of_sympy(mechanism):
    robot, peer, rows, q = mechanism()
    q = np.array(q)
    if robot.constraint_names:
        fixed = [name for name in robot.speed_names if name in robot.coordinate_names]
        q = robot.closed_configuration(q, fixed=fixed)
    form = derivation(robot)
    names = {}
    exec(as_code(form, 'python'), names)
    function = next(f for name, f in names.items() if name.startswith('dynamics_of'))
    theirs = peer.derived(rows, form.free)
    for _ in range(3):
        u = RNG.uniform(-2.0, 2.0, robot.n)
        expected = theirs(q, u)
        qdot, M, f = function(q, u, np.zeros(len(form.torques)))
        for got, value in ((M, expected['mass_matrix']), (f, -expected['bias']),
                           (qdot, expected['qdot'])):
            np.testing.assert_allclose(got, value, rtol=1e-10,
                                       atol=1e-10 * np.abs(value).max())
