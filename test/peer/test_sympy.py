"""Our equations against SymPy's KanesMethod, derived here, and the known bicycle."""

from kane_dynamics import box, disc, ModelBuilder, point_mass, rod
from kane_dynamics.mechanics.constraints import (Closure, knife_edge, PointVelocity,
                                                 Prescribed, Rolling)
from kane_dynamics.mechanics.constraints.independent_speeds import closed_configuration
from kane_dynamics.mechanics.constraints.speeds import (absolute_rates,
                                                        body_angular_velocity)
import numpy as np
import pytest
import sympy as sp
import sympy.physics.mechanics as me
from sympy_kane import agree, Ours, Peer

X, Y, Z = np.eye(3)
RNG = np.random.default_rng(4)


def states(n_q, n, count=4):
    """Return random configurations and speeds."""
    return [(RNG.uniform(-1, 1, n_q), RNG.uniform(-2, 2, n)) for _ in range(count)]


def test_rolling_disc():
    b = ModelBuilder('disc')
    b.body('disc', 'world', 'floating', turns='zxy', inertial=disc(2, 0.5, Y))
    model = b.model()
    free = ['disc/rz', 'disc/rx', 'disc/ry']
    ours = Ours(model, [Rolling('disc', 0.5, axis=Y)], independent=free)
    peer = Peer(model)
    upright, _ = peer.body('disc/rx')
    wheel, centre = peer.body('disc')
    N = peer.N
    contact = centre.vel(N) + wheel.ang_vel_in(N).cross(-0.5 * upright.z)
    travel = upright.x  # the rows are along travel, across it, and along the normal
    axes = (travel, N.z.cross(travel), N.z)
    derived = peer.derived([contact.dot(axis) for axis in axes], [3, 4, 5])
    agree(ours, derived, states(6, 3), forces=[0, 1, 2])


@pytest.mark.parametrize('slope', [0.0, 0.4],
                         ids=['Chaplygin sleigh', 'knife edge on an incline'])
def test_knife_edge(slope):
    b = ModelBuilder('sleigh',
                     gravity=9.81 * np.array([np.sin(slope), 0.0, -np.cos(slope)]))
    b.body('sleigh', 'world', 'planar', inertial=box(3, (1, 0.4, 0.1), at=(0.3, 0.1, 0)))
    b.frame('blade', 'sleigh', at=(-0.4, 0.05, 0))
    model = b.model()
    ours = Ours(model, [knife_edge('blade', Y)], independent=['sleigh/x', 'sleigh/rz'])
    peer = Peer(model)
    frame, _ = peer.body('sleigh')
    slip = peer.point('sleigh', (-0.4, 0.05, 0)).vel(peer.N).dot(frame.y)
    agree(ours, peer.derived([slip], [0, 2]), states(3, 2), forces=[0])


def four_bar():
    """Crank, coupler and rocker; the rocker's end is to meet the ground."""
    b = ModelBuilder('four-bar')
    end = np.zeros(3)
    for name, on, length in (('crank', 'world', 0.3), ('coupler', 'crank', 0.9),
                             ('rocker', 'coupler', 0.7)):
        b.body(name, on, axis=Y, at=end, inertial=rod(2 * length, (0, 0, 0), length * X))
        end = length * X
    b.frame('end', 'rocker', at=end)
    b.frame('ground', 'world', at=X)
    return b.model()


@pytest.mark.parametrize('kind, labels', [('spherical', [0, 2]), ('revolute', [0, 2])])
def test_four_bar(kind, labels):
    model = four_bar()
    ours = Ours(model, [Closure('end', 'ground', kind, axis=Y)], independent=['crank'])
    assert ours.mechanism.kept == labels  # what happens across the plane is redundant
    peer = Peer(model)
    # minus: the row is ground's less the end's
    v = peer.point('rocker', 0.7 * X).vel(peer.N)
    derived = peer.derived([-v.dot(peer.N.x), -v.dot(peer.N.z)], [0])
    closed = [closed_configuration(ours.mechanism, (crank, 1 - crank, 1.5),
                                   fixed=['crank']) for crank in (-1.0, 0.4, 1.3)]
    agree(ours, derived, [(q, RNG.uniform(-3, 3, 1)) for q in closed], forces=labels)


@pytest.mark.parametrize('speeds', ['relative', 'absolute'])
def test_chain_of_pendulums(speeds):
    n = 4
    b = ModelBuilder('chain')
    on = 'world'
    at = (0, 0, 0)
    for k in range(n):
        link = rod(1 + k, (0, 0, 0), (0, 0, -0.5)) + point_mass(0.2, (0.1, 0, -0.3))
        b.body(f'link{k}', on, axis=Y, at=at, inertial=link)
        on = f'link{k}'
        at = (0, 0, -0.5)
    model = b.model()

    def joint_rates(u):
        """Return q' of absolute rates: the joint turns by their difference."""
        return [u[0], *(u[k] - u[k - 1] for k in range(1, n))]
    if speeds == 'absolute':
        ours = Ours(model, speeds=absolute_rates)
        peer = Peer(model, joint_rates)
    else:
        ours = Ours(model)
        peer = Peer(model, lambda u: u)
    agree(ours, peer.derived(), states(n, n))


def test_a_top_in_the_angular_velocity_of_its_own_axes():
    b = ModelBuilder('top')
    b.body(
        'top', 'world', 'spherical', turns='zxz',
        inertial=disc(2, 0.3, Z, at=(0.02, 0, 0.4)) + rod(0.5, (0, 0, 0), (0.1, 0, 0.4)))
    ours = Ours(b.model(), speeds=body_angular_velocity('top'))

    def rates(u):
        q1, q2 = me.dynamicsymbols('q1 q2')  # nutation and spin
        s = sp.sin(q2)
        c = sp.cos(q2)
        precession = (u[0] * s + u[1] * c) / sp.sin(q1)
        return [precession, u[0] * c - u[1] * s, u[2] - precession * sp.cos(q1)]
    agree(ours, Peer(b.model(), rates).derived(),
          [(q + [0, 1.5, 0], u) for q, u in states(3, 3)])


def test_an_auxiliary_speed_gives_the_bearing_torque_of_two_rods():
    m = 1.3
    L = 0.4
    b = ModelBuilder('two rods')
    b.body('turn', axis=Y)
    b.body('A', 'turn', axis=X, inertial=rod(2 * m, (0, 0, 0), 4 * L * Z))
    b.body('B', 'A', axis=Z, at=4 * L * Z, inertial=rod(m, (0, 0, 0), -2 * L * Y))
    model = b.model()
    bearing = PointVelocity('A', X, axes='A', angular=True)
    ours = Ours(model, [bearing], independent=['turn', 'B'])
    q1, q2, u1, u2, u3 = me.dynamicsymbols('q1 q2 u1 u2 u3')
    T = sp.Symbol('T')
    N = me.ReferenceFrame('N')
    A = N.orientnew('A', 'Axis', [q1, N.y])
    B = A.orientnew('B', 'Axis', [q2, A.z])
    A.set_ang_vel(N, u3 * A.x + u1 * A.y)
    B.set_ang_vel(A, u2 * A.z)
    O = me.Point('O')  # noqa: E741
    O.set_vel(N, 0)
    P, A_com = (O.locatenew(name, k * L * A.z) for name, k in (('P', 4), ('Ac', 2)))
    for point in (P, A_com):
        point.v2pt_theory(O, N, A)
    B_com = P.locatenew('Bc', -L * B.y)
    B_com.v2pt_theory(P, N, B)
    thin = m * L**2
    rods = [
        me.RigidBody('A', A_com, A, 2 * m,
                     (me.inertia(A, 8 * thin / 3, 8 * thin / 3, 0), A_com)),
        me.RigidBody('B', B_com, B, m, (me.inertia(B, thin / 3, 0, thin / 3), B_com))]
    method = me.KanesMethod(N, [q1, q2], [u1, u2], [q1.diff() - u1, q2.diff() - u2],
                            u_auxiliary=[u3])
    method.kanes_equations(rods, [(A, T * A.x), *((r.masscenter, -9.81 * r.mass * N.z)
                                                  for r in rods)])
    torque = sp.solve(method.auxiliary_eqs[0], T)[0]
    rates = sp.symbols('a1 a2')
    torque = torque.subs({u1.diff(): rates[0], u2.diff(): rates[1]})
    function = sp.lambdify([q1, q2, u1, u2, *rates],
                           [method.mass_matrix, method.forcing, torque])
    for (p1, p2), u in states(2, 2):
        q = np.array([p1, 0.0, p2])
        udot = ours.forward_dynamics(q, u, np.zeros(2)).astype(float)
        M, forcing, expected = function(p1, p2, *u, *udot)
        np.testing.assert_allclose(ours.mass_matrix(q), M, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(udot, np.linalg.solve(M, forcing)[:, 0], rtol=1e-9)
        np.testing.assert_allclose(ours.constraint_forces(q, u), [expected], rtol=1e-9,
                                   atol=1e-11)


def test_a_shaken_pendulum_and_the_force_that_shakes_it():
    b = ModelBuilder('shaker')
    b.body('shaker', 'world', 'prismatic', axis=X, inertial=point_mass(2))
    b.body('rod', 'shaker', axis=Y, inertial=rod(1.5, (0, 0, 0), (0, 0, -0.8)))
    model = b.model()
    ours = Ours(model, [Prescribed('shaker', lambda t: 0.3 * np.sin(4.0 * t))],
                independent=['rod'])
    peer = Peer(model)
    tree = peer.derived()
    for t in (0.0, 0.7):
        q = np.array([0.3 * np.sin(4 * t), 0.6])
        u = np.array([1.1])
        theirs = tree(q, np.array([1.2 * np.cos(4 * t), u[0]]))
        M = theirs['mass_matrix']
        bias = theirs['bias']
        acceleration = -4.8 * np.sin(4 * t)
        udot = -(bias[1] + M[1, 0] * acceleration) / M[1, 1]
        np.testing.assert_allclose(
            ours.forward_dynamics(q, u, np.zeros(1), t).astype(float),
            [udot], rtol=1e-9)
        np.testing.assert_allclose(ours.constraint_forces(q, u, t),
                                   [M[0] @ [acceleration, udot] + bias[0]], rtol=1e-9)
