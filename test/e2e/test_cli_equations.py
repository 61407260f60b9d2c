"""`kane-dynamics equations`: the worked problems come out as they are printed."""

import json
from pathlib import Path
import subprocess
import sys

from command_in_process import command
import sympy as sp

URDF = Path(__file__).resolve().parents[2] / 'urdf'


def equations(name, *options):
    """Run the command on a shipped URDF."""
    return command('equations', str(URDF / f'{name}.urdf'), *options)


def derived(name, *options):
    """Return mass matrix, bias, and partial velocities by body, as SymPy has them."""
    done = equations(name, '--json', *options)
    assert done.returncode == 0, done.stderr
    steps = json.loads(done.stdout)['steps']
    last = steps["Kane's equations"]
    n = sum(name.startswith('bias') for name in last)
    M = sp.Matrix(n, n, lambda r, s: last[f'M{min(r, s) + 1}{max(r, s) + 1}'])
    bias = sp.Matrix([last[f'bias{r + 1}'] for r in range(n)])
    table = steps['Partial velocities']
    partials = {}
    for body in {name.partition(' of ')[2] for name in table}:
        columns = [table[f'omega{r + 1} of {body}'] + table[f'v{r + 1} of {body}']
                   for r in range(n)]
        partials[body] = sp.Matrix(columns).T
    return M, bias, partials


def zero(matrix):
    """Return whether a matrix is zero."""
    return sp.simplify(sp.Matrix(matrix)).is_zero_matrix


def test_the_spring_mass_pendulum_comes_out_as_the_lecture_prints_it():
    M, bias, _ = derived('spring_mass_pendulum', '--supplement',
                         str(URDF / 'spring_mass_pendulum.supplement.yaml'))
    m1, m2, r2, k1, g, q1, q2, u2 = sp.symbols('m1 m2 r2 k1 g q1 q2 u2')
    assert zero(M - sp.Matrix([[m1 + m2, m2 * r2 * sp.cos(q2)],
                               [m2 * r2 * sp.cos(q2), m2 * r2**2]]))
    assert zero(bias + sp.Matrix([m2 * r2 * u2**2 * sp.sin(q2) - k1 * q1,
                                  -m2 * g * r2 * sp.sin(q2)]))


def test_two_rods_come_out_as_the_lecture_prints_them():
    M, bias, partials = derived('two_rods')
    m, L, g, q1, q2, u1, u2 = sp.symbols('m L g q1 q2 u1 u2')
    third = sp.Rational(1, 3)
    values = dict(
        zip(sp.symbols('m1 m2 r1 r2 l2 I1 I2'),
            (2 * m, m, 2 * L, L, 4 * L, 8 * third * m * L**2, third * m * L**2)))
    s2 = sp.sin(q2)
    c2 = sp.cos(q2)
    in_A = sp.rot_axis3(-q2)  # columns: B's axes in A's
    I_A = sp.diag(1, 1, 0) * values[sp.Symbol('I1')]
    I_B = sp.diag(1, 0, 1) * third * m * L**2
    lecture = {  # omega, then v of the center of mass, in the axes of A
        'rod_a': sp.Matrix([[0, 0], [1, 0], [0, 0], [2 * L, 0], [0, 0], [0, 0]]),
        'rod_b': sp.Matrix([[0, 0], [1, 0], [0, 1],
                            [4 * L, L * c2], [0, L * s2], [-L * s2, 0]])}
    turned = sp.diag(in_A, in_A)
    assert zero(partials['rod_a'].subs(values) - lecture['rod_a'])
    assert zero(turned * partials['rod_b'].subs(values) - lecture['rod_b'])
    expected = sp.zeros(2, 2)
    for mass, inertia, table in ((2 * m, I_A, lecture['rod_a']),
                                 (m, in_A * I_B * in_A.T, lecture['rod_b'])):
        w = table[:3, :]
        v = table[3:, :]
        expected += mass * v.T * v + w.T * inertia * w
    assert zero(M.subs(values) - expected)
    weight = m * g * L * sp.Matrix([8 * sp.sin(q1) + sp.cos(q1) * s2, sp.sin(q1) * c2])
    q = (q1, q2)
    u = (u1, u2)
    christoffel = []
    for r in range(2):
        christoffel.append(
            sum((expected[r, i].diff(q[j]) - expected[i, j].diff(q[r]) / 2) * u[i] * u[j]
                for i in range(2) for j in range(2)))
    assert zero(bias.subs(values) - sp.Matrix(christoffel) + weight)


def test_velocity_propagates_along_the_planar_arm_as_the_lecture_prints_it():
    M, bias, partials = derived('two_link_planar')
    l2, r2, q2, u1, u2 = sp.symbols('l2 r2 q2 u1 u2')
    u = sp.Matrix([u1, u2])
    assert zero(partials['link2'][3:, :] * u - sp.Matrix([
        l2 * sp.sin(q2) * u1, l2 * sp.cos(q2) * u1 + r2 * (u1 + u2), 0]))
    assert zero(partials['link2'][:3, :] * u - sp.Matrix([0, 0, u1 + u2]))
    m2 = sp.Symbol('m2')
    push = m2 * l2 * r2 * sp.sin(q2)  # the textbook's h
    assert zero(bias - sp.Matrix([-push * (2 * u1 * u2 + u2**2), push * u1**2]))
    assert M[1, 1] == sp.sympify('I2zz + m2*r2**2')


def test_a_process_names_every_symbol_and_counts_operations():
    done = subprocess.run([sys.executable, '-m', 'kane_dynamics.cli', 'equations',
                           str(URDF / 'two_link_planar.urdf')],
                          capture_output=True, text=True, check=True, timeout=120)
    assert 'M12 = I2zz + l2*m2*r2*cos(q2) + m2*r2**2' in done.stdout
    assert 'q2                joint2 [rad]' in done.stdout
    assert 'm2    2.4         mass of link2 [kg]' in done.stdout
    assert 'mass_matrix, closed form: ' in done.stdout


def test_numbers_stand_in_for_symbols_on_request():
    done = equations('two_link_planar', '--numbers')
    assert 'M22 = 0.12854' in done.stdout and 'm2' not in done.stdout


def test_latex_goes_to_a_file(tmp_path):
    path = tmp_path / 'arm.tex'
    done = equations('two_link_planar', '--latex', '-o', str(path))
    assert done.stdout == f'wrote {path}\n'
    assert r'\cos{(q_{2} )}' in path.read_text()


def test_markdown_has_the_table_of_partial_velocities():
    rows = equations('two_link_planar', '--markdown').stdout.splitlines()
    header = '| r | omega of link1 | v of link1 | omega of link2 | v of link2 |'
    assert rows[rows.index(header) + 3].startswith('| 2 | ')


def test_equations_of_many_joints_are_refused():
    done = equations('ur10e')
    assert done.returncode == 2 and 'more than 5000 terms' in done.stderr


def test_a_python_file_that_builds_a_robot_is_derived_with_a_reaction(tmp_path):
    path = tmp_path / 'rods.py'
    path.write_text('from kane_dynamics import load_urdf, Robot\n'
                    f'robot = Robot(load_urdf({str(URDF / "two_rods.urdf")!r}))\n')
    done = command('equations', str(path), '--auxiliary', 'rod_a_joint:rx', '--axes',
                   'rod_a', '--energy')
    assert done.returncode == 0, done.stderr
    assert 'omega of rod_b = (u3, u1, u2)' in done.stdout
    assert 'F of rod_a_joint:rx = -g*m2*r2*cos(q1)*cos(q2)' in done.stdout


def test_a_python_file_without_a_robot_is_refused(tmp_path):
    path = tmp_path / 'empty.py'
    path.write_text('x = 1\n')
    done = command('equations', str(path))
    assert done.returncode == 2 and '0 variables with a Robot' in done.stderr
