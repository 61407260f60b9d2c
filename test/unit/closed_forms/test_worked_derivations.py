"""Derivations are the printed equations of the lecture's problems, symbol by symbol."""

from pathlib import Path

from kane_dynamics import load_urdf, ModelBuilder, point_mass, Robot
from kane_dynamics.closed_forms import derivation
from kane_dynamics.closed_forms.polynomials import shortened
import paper_mechanisms
import pytest
import sympy as sp

URDF = Path(__file__).resolve().parents[3] / 'urdf'


def same(got, expected):
    """Check that the difference of two matrices simplifies to zero."""
    assert sp.simplify(sp.Matrix(got) - sp.Matrix(expected)).is_zero_matrix


def renamed(form, names):
    """Return a function that replaces the derivation's parameters by the book's."""
    symbols = {str(parameter.symbol): parameter.symbol for parameter in form.parameters}
    values = {symbols[name]: value for name, value in names.items()}
    return lambda matrix: sp.Matrix(matrix).subs(values)


def test_the_block_on_a_spring_with_a_pendulum():
    b = ModelBuilder('spring_mass_pendulum')
    b.body('block', 'world', 'prismatic', axis=(1, 0, 0), inertial=point_mass(2),
           stiffness=40)
    b.body('pendulum', 'block', axis=(0, -1, 0), inertial=point_mass(3, (0, 0, -0.5)))
    form = derivation(Robot(b.model()))
    M1, M2, L, K, g = sp.symbols('M1 M2 L K g', positive=True)
    book = renamed(form, {'m1': M1, 'm2': M2, 'r2': L, 'k1': K, 'g': g})
    q1, q2 = form.q
    u2 = form.u[1]
    coupling = M2 * L * sp.cos(q2)
    same(book(form.M), [[M1 + M2, coupling], [coupling, M2 * L**2]])
    f = form.right_side - form.active['actuators']
    same(book(f), [M2 * L * u2**2 * sp.sin(q2) - K * q1, -M2 * g * L * sp.sin(q2)])


@pytest.mark.filterwarnings('ignore:links with mass')
def test_two_rods_with_the_torque_of_the_bearing():
    robot = Robot(load_urdf(URDF / 'two_rods.urdf'))
    form = derivation(robot, axes='rod_a', auxiliary=['rod_a_joint:rx'], energy=True)
    m, L, g = sp.symbols('m L g', positive=True)
    third = sp.Rational(1, 3)
    book = renamed(form, {'m1': 2 * m, 'm2': m, 'r1': 2 * L, 'r2': L, 'l2': 4 * L,
                          'I1': 8 * third * m * L**2, 'I2': third * m * L**2, 'g': g})
    q1, q2 = form.q
    u1, u2, u3 = form.u
    s1, c1, s2, c2 = sp.sin(q1), sp.cos(q1), sp.sin(q2), sp.cos(q2)

    # Velocities, in the axes of A; the partial velocities are their coefficients.
    velocities = {'rod_a': [u3, u1, 0, 2 * L * u1, -2 * L * u3, 0],
                  'rod_b': [u3, u1, u2, L * (4 * u1 + u2 * c2), L * (u2 * s2 - 4 * u3),
                            -L * (u1 * s2 + u3 * c2)]}
    partials = {}
    for body, expected in velocities.items():
        same(book(form.velocities[body]), expected)
        partials[body] = sp.Matrix(expected).jacobian([u1, u2, u3])
        same(book(form.partials[body]), partials[body])

    # Generalized active forces F_1, F_2; F_3 = T_c + m g L c1 c2 is below.
    same(book(form.active['gravity']),
         [m * g * L * (8 * s1 + c1 * s2), m * g * L * s1 * c2])

    # F* by hand: R* = -m a and T* = -(I alpha + w x I w), dotted with the partials.
    udot = sp.Matrix(form.udot)
    inertias = {'rod_a': (2 * m, 8 * third * m * L**2 * sp.diag(1, 1, 0)),
                'rod_b': (m, third * m * L**2 * sp.diag(1, 0, 1))}
    total = sp.zeros(3, 1)
    omega_A = sp.Matrix([0, u1, 0])
    for body, (mass, inertia) in inertias.items():
        w, v = sp.Matrix(velocities[body])[:3, :], sp.Matrix(velocities[body])[3:, :]
        if body == 'rod_b':  # B's axes in A's
            turn = sp.Matrix([[c2, -s2, 0], [s2, c2, 0], [0, 0, 1]])
            inertia = turn * inertia * turn.T

        def rate(vector):
            """Return the derivative in N of a vector in the axes of A."""
            vector = vector.subs(u3, 0)
            change = vector.jacobian([u1, u2]) * udot + vector.diff(q2) * u2
            return change + omega_A.cross(vector)  # noqa: B023
        w_rate, a = rate(w), rate(v)
        w = w.subs(u3, 0)
        moment = inertia * w_rate + w.cross(inertia * w)
        table = partials[body]
        total -= table[3:, :].T * (mass * a) + table[:3, :].T * moment
    same(book(form.inertia_force), total[:2, :])
    same(book(form.energy['inertia']), total[:2, :])
    T_c = -total[2] - m * g * L * c1 * c2
    same(book([form.auxiliary['rod_a_joint:rx']]), [T_c])


def test_the_planar_arm_and_its_tip():
    robot = Robot(load_urdf(URDF / 'two_link_planar.urdf'))
    tip, = (frame.name for frame in robot.model.frames if 'tip' in frame.name
            or 'tool' in frame.name)
    form = derivation(robot, points=[tip])
    world = derivation(robot, points=[tip], axes='world')
    names = {str(p.symbol): p for p in form.parameters}
    l1, l2 = sp.symbols('l1 l2', positive=True)
    place, = (name for name in names if name.startswith('p'))
    book = renamed(form, {'l2': l1, place: l2})
    q1, q2 = form.q
    u1, u2 = form.u
    v = [l1 * sp.sin(q2) * u1, l1 * sp.cos(q2) * u1 + l2 * (u1 + u2), 0]
    same(book(form.velocities[f'point {tip}']), [0, 0, u1 + u2, *v])
    s1, c1, s12, c12 = sp.sin(q1), sp.cos(q1), sp.sin(q1 + q2), sp.cos(q1 + q2)
    same(book(world.partials[f'point {tip}']), [
        [0, 0], [0, 0], [1, 1], [-l1 * s1 - l2 * s12, -l2 * s12],
        [l1 * c1 + l2 * c12, l2 * c12], [0, 0]])


@pytest.mark.parametrize('name', paper_mechanisms.WITH_ENERGY)
def test_variations_of_vectors_give_the_same_forces_symbol_by_symbol(name):
    form = paper_mechanisms.derived(name)
    active = form.energy['gravity and springs']
    for source in ('gravity', 'springs'):
        if source in form.active:
            active = active - form.active[source]
    differences = [*(form.energy['inertia'] - form.inertia_force), *active]
    assert not any(shortened(differences, form.u))
