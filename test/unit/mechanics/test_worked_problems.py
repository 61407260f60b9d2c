"""The worked problems of the theory: closed forms and derivations, reproduced."""

from definition import Definition
import energies
from kane_dynamics import Robot
from kane_dynamics.closed_forms.symbolic import symbols, unwrapped
from kane_dynamics.mechanics.definition import kane, kinematics
from kane_dynamics.model.model import Body, Frame, Inertial, Joint, Model, WORLD
import numpy as np
import pytest
import sympy as sp

X, Y, Z = np.eye(3)
ENGINES = pytest.mark.parametrize('engine', [Definition, Robot])
STATES = np.random.default_rng(8).uniform(-3.0, 3.0, (20, 2, 2))
g = 9.81


def spring_mass_pendulum(M1, M2, L, K):
    """P1: a block on a spring along x; a particle hangs on it, turning about -y."""
    block = Body('block', WORLD, Joint('slide', 'prismatic', X, stiffness=K),
                 Inertial(M1))
    particle = Body('particle', 0, Joint('swing', 'revolute', -Y, coordinate=1),
                    Inertial(M2, -L * Z))
    return Model('P1', (block, particle), ('slide', 'swing'))


def pendulum_equations(M1, M2, L, K, q, u, ops):
    """Return P1's closed form: mass matrix and right side, sines of `ops`."""
    s = ops.sin(q[1])
    c = ops.cos(q[1])
    M = [[M1 + M2, M2 * L * c], [M2 * L * c, M2 * L**2]]
    return M, [M2 * L * u[1]**2 * s - K * q[0], -M2 * g * L * s]


@ENGINES
def test_spring_mass_pendulum_equals_its_closed_form(engine):
    values = 2.0, 3.0, 0.7, 40.0
    robot = engine(spring_mass_pendulum(*values))
    for q, u in STATES:
        M, right = map(np.array, pendulum_equations(*values, q, u, np))
        udot = np.linalg.solve(M, right)
        np.testing.assert_allclose(robot.mass_matrix(q), M, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(robot.bias_force(q, u), -right, rtol=1e-13,
                                   atol=1e-13 * np.abs(right).max())
        np.testing.assert_allclose(robot.forward_dynamics(q, u, np.zeros(2)), udot,
                                   rtol=1e-13, atol=1e-13 * np.abs(udot).max())


def test_spring_mass_pendulum_equals_its_closed_form_in_symbols():
    values = 2.0, 3.0, 0.5, 40.0
    (q1, q2), q = symbols(['q1', 'q2'])
    (u1, u2), u = symbols(['u1', 'u2'])
    model = spring_mass_pendulum(*values)
    exact = [sp.nsimplify(value) for value in values]
    M, right = pendulum_equations(*exact, (q1, q2), (u1, u2), sp)
    M_kane = kane.mass_matrix(model, q)
    bias = kane.bias_force(model, q, u, friction=False)
    for r in range(2):
        assert sp.simplify(unwrapped(bias[r]) + sp.nsimplify(right[r],
                                                             rational=True)) == 0
        for s in range(2):
            assert sp.simplify(unwrapped(M_kane[r, s]) - M[r][s]) == 0


m = 1.3
L = 0.4


def two_rods(auxiliary=False):
    """
    P2: rod A turns about n2 at O, rod B about a3 at A's end.

    With `auxiliary`, a third coordinate turns A about a1: held at zero, its torque is
    what the bearing exerts.
    """
    rod_a = Inertial(2.0 * m, 2.0 * L * Z,
                     8.0 / 3.0 * m * L**2 * np.diag([1.0, 1.0, 0.0]))
    rod_b = Inertial(m, -L * Y, m * L**2 / 3.0 * np.diag([1.0, 0.0, 1.0]))
    first = Joint('q1', 'revolute', Y)
    second = Joint('q2', 'revolute', Z, translation=4.0 * L * Z, coordinate=1)
    names = ('q1', 'q2')
    if auxiliary:
        bodies = (Body('bearing', WORLD, first),
                  Body('A', 0, Joint('q3', 'revolute', X, coordinate=2), rod_a),
                  Body('B', 1, second, rod_b))
        return Model('P2', bodies, (*names, 'q3'))
    return Model('P2', (Body('A', WORLD, first, rod_a), Body('B', 0, second, rod_b)),
                 names)


@pytest.fixture(scope='module')
def rods_by_sympy():
    """P2 by Lagrange's equations; its bearing by the moment of momentum about O."""
    t = sp.Symbol('t')
    q1 = sp.Function('q1')(t)
    q2 = sp.Function('q2')(t)
    R_A = sp.rot_axis2(-q1)
    R_B = R_A * sp.rot_axis3(-q2)
    I_A = sp.diag(1, 1, 0) * sp.Rational(8, 3) * m * L**2
    I_B = sp.diag(1, 0, 1) * m * L**2 / 3
    rods = []
    for R, inertia, mass, r in (
            (R_A, I_A, 2 * m, R_A * sp.Matrix([0, 0, 2 * L])),
            (R_B, I_B, m, R_A * sp.Matrix([0, 0, 4 * L]) + R_B * sp.Matrix([0, -L, 0]))):
        spin = R.diff(t) * R.T
        omega = sp.Matrix([spin[2, 1], spin[0, 2], spin[1, 0]])
        rods.append((mass, r, r.diff(t), R * inertia * R.T, omega))
    down = sp.Matrix([0, 0, -g])
    kinetic = 0
    potential = 0
    # About O: the moment of momentum, and the moment of the weights.
    momentum = sp.zeros(3, 1)
    weight = sp.zeros(3, 1)
    for mass, r, v, inertia, omega in rods:
        kinetic += (mass * v.dot(v) + omega.dot(inertia * omega)) / 2
        potential += mass * g * r[2]
        momentum += mass * r.cross(v) + inertia * omega
        weight += r.cross(mass * down)
    equations = [(kinetic - potential).diff(x.diff(t)).diff(t)
                 - (kinetic - potential).diff(x) for x in (q1, q2)]
    equations.append((momentum.diff(t) - weight).dot(R_A[:, 0]))
    plain = sp.symbols('a1 a2 u1 u2 q1 q2')
    order = []
    for k in (2, 1, 0):
        for x in (q1, q2):
            order.append(x.diff(t, k))
    function = sp.lambdify(plain, [e.subs(list(zip(order, plain))) for e in equations])
    return lambda q, u, udot: np.array(function(*udot, *u, *q), dtype=float)


@ENGINES
def test_two_rods_accelerate_as_lagrange_has_it(engine, rods_by_sympy):
    robot = engine(two_rods())
    for q, u in STATES:
        udot = robot.forward_dynamics(q, u, np.zeros(2))
        bias = rods_by_sympy(q, u, np.zeros(2))[:2]
        M = np.stack([rods_by_sympy(q, u, e)[:2] - bias for e in np.eye(2)], axis=1)
        np.testing.assert_allclose(udot, np.linalg.solve(M, -bias),
                                   rtol=1e-11, atol=1e-11)


@ENGINES
def test_an_auxiliary_speed_brings_the_bearing_torque_into_evidence(
        engine, rods_by_sympy):
    robot = engine(two_rods())
    bearing = engine(two_rods(auxiliary=True))
    for q, u in STATES:
        udot = robot.forward_dynamics(q, u, np.zeros(2))
        tau = bearing.inverse_dynamics(*[np.array([*x, 0.0]) for x in (q, u, udot)])
        np.testing.assert_allclose(tau, [0.0, 0.0, rods_by_sympy(q, u, udot)[2]],
                                   atol=1e-11)


def test_two_rods_have_the_velocities_and_active_forces_of_the_lecture():
    model = two_rods(auxiliary=True)
    for (q1, q2), (u1, u2) in STATES:
        q = np.array([q1, q2, 0.0])
        u = np.array([u1, u2, 1.7])
        u3 = 1.7
        s1, s2 = np.sin((q1, q2))
        c1, c2 = np.cos((q1, q2))
        bodies = kinematics.configurations(model, q)
        _, A, B = kinematics.motions(model, bodies, q, u, np.zeros(3))
        a = bodies[1].R_wb  # columns a1, a2, a3 in world axes
        for value, expected in (
                (A.omega, [u3, u1, 0.0]), (B.omega, [u3, u1, u2]),
                (A.v_com, [2 * L * u1, -2 * L * u3, 0.0]),
                (B.v, [4 * L * u1, -4 * L * u3, 0.0]),
                (B.v_com, [L * (4 * u1 + u2 * c2), L * (u2 * s2 - 4 * u3),
                           -L * (u1 * s2 + u3 * c2)])):
            np.testing.assert_allclose(a.T @ value, expected, atol=1e-13)
        np.testing.assert_allclose(
            kane.generalized_active_force(model, q, u),
            m * g * L * np.array([8 * s1 + c1 * s2, s1 * c2, c1 * c2]), atol=1e-13)


def planar_arm(l1, l2):
    """P3: two links in the plane, turning about z; a frame at the tip."""
    return Model('P3', (
        Body('link1', WORLD, Joint('q1', 'revolute', Z), Inertial(1.0, 0.5 * l1 * X)),
        Body('link2', 0, Joint('q2', 'revolute', Z, translation=l1 * X, coordinate=1),
             Inertial(1.0, 0.5 * l2 * X))), ('q1', 'q2'),
        (Frame('tip', 1, translation=l2 * X),))


@ENGINES
def test_velocity_propagates_to_the_tip_of_the_planar_arm(engine):
    l1 = 0.5
    l2 = 0.3
    robot = engine(planar_arm(l1, l2))
    for q, u in STATES:
        s2 = np.sin(q[1])
        c2 = np.cos(q[1])
        twist = robot.frame_velocity('tip', q, u)
        in_link = robot.frame_pose('tip', q)[:3, :3].T @ twist.reshape(2, 3).T
        expected = [[l1 * s2 * u[0], l1 * c2 * u[0] + l2 * (u[0] + u[1]), 0.0],
                    [0.0, 0.0, u[0] + u[1]]]
        np.testing.assert_allclose(in_link.T, expected, atol=1e-14)


@ENGINES
def test_jacobian_of_the_planar_arm_in_base_axes(engine):
    l1 = 0.5
    l2 = 0.3
    robot = engine(planar_arm(l1, l2))
    for q, _ in STATES:
        s1, s12 = np.sin((q[0], q.sum()))
        c1, c12 = np.cos((q[0], q.sum()))
        expected = [[-l1 * s1 - l2 * s12, -l2 * s12], [l1 * c1 + l2 * c12, l2 * c12],
                    [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [1.0, 1.0]]
        np.testing.assert_allclose(robot.jacobian('tip', q), expected, atol=1e-14)


@pytest.mark.parametrize('model', [spring_mass_pendulum(2.0, 3.0, 0.7, 40.0), two_rods(),
                                   planar_arm(0.5, 0.3)], ids=lambda model: model.name)
def test_the_energy_formulation_gives_the_same_equations(model):
    for q, u in STATES:
        udot = np.array([0.3, -1.1])
        np.testing.assert_allclose(
            energies.generalized_inertia_force(model, q, u, udot),
            kane.generalized_inertia_force(model, q, u, udot), atol=1e-12)
        np.testing.assert_allclose(
            energies.conservative_force(model, q),
            kane.generalized_active_force(model, q, u), atol=1e-12)
