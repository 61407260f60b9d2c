"""
The Whipple bicycle of the benchmark, against its published eigenvalues and SymPy.

Meijaard, Papadopoulos, Ruina & Schwab, Linearized dynamics equations for the balance and
steer of a bicycle: a benchmark and review, Proc. R. Soc. A 463 (2007), tables 1 and 2.
"""

from pathlib import Path
from runpy import run_path

from kane_dynamics import linearized, Robot
from kane_dynamics.closed_forms import linear_form
import numpy as np
import pytest
import sympy as sp
import sympy.physics.mechanics as me
from sympy_kane import Peer

WEAVE = (  # real and imaginary part at 0 to 10 m/s; at 0 two real ones
    (3.13164324790656, 5.53094371765393), (3.52696170990070, 0.80774027519930),
    (2.68234517512745, 1.68066296590675), (1.70675605663975, 2.31582447384325),
    (0.41325331521125, 3.07910818603206), (-0.77534188219585, 4.46486771378823),
    (-1.52644486584142, 5.87673060598709), (-2.13875644258362, 7.19525913329805),
    (-2.69348683581097, 8.46037971396931), (-3.21675402252485, 9.69377351531791),
    (-3.72016840437287, 10.90681139476287))
REAL = (  # castering and capsize; at 0 the mirror images of the two above
    (-5.53094371765393, -3.13164324790656), (-7.11008014637442, -3.13423125066578),
    (-8.67387984831735, -3.07158645641514), (-10.35101467245920, -2.63366137253667),
    (-12.15861426576447, -1.42944427361326), (-14.07838969279822, -0.32286642900409),
    (-16.08537123098026, -0.00406690076970), (-18.15788466125262, 0.10268170574766),
    (-20.27940894394569, 0.14327879765713), (-22.43788559040858, 0.15790184030917),
    (-24.62459635017404, 0.16105338653172))


@pytest.fixture(scope='module')
def rolling():
    """Return the bicycle of the example on its two wheels."""
    example = run_path(
        str(Path(__file__).resolve().parents[2] / 'examples' / 'bicycle.py'))
    return Robot(example['model'], constraints=example['wheels'],
                 independent=example['free'])


@pytest.mark.parametrize('speed', range(11))
def test_eigenvalues_are_the_published_ones(rolling, speed):
    re, im = WEAVE[speed]
    pair = (re, im) if speed == 0 else (re + 1j * im, re - 1j * im)
    expected = np.array([*pair, *REAL[speed]], dtype=complex)
    u = np.array([0.0, speed / 0.3, 0.0])  # the rear wheel of radius 0.3 m rolls
    modes = linearized(rolling, np.zeros(9), u, np.zeros(3)).modes()
    # The others are those of place, heading, spin and speed, on which nothing depends.
    own = [value for value, name in modes if name in (
        'frame/rx', 'steer', 'rate of frame/rx', 'rate of steer')]
    np.testing.assert_allclose(np.sort_complex(own), np.sort_complex(expected),
                               rtol=1e-9, atol=1e-9)


def test_the_bicycle_on_paper_has_the_published_eigenvalues(rolling):
    # In numbers but for the speed: a quartic in the eigenvalue.
    form = linear_form(rolling, np.zeros(9), [0.0, 1.0, 0.0], numbers=True)
    wheel_speed, = (parameter.symbol for parameter in form.parameters)
    s = sp.Symbol('s')
    quartic = form.characteristic(
        ('frame/rx', 'steer', 'rate of frame/rx', 'rate of steer'), s)
    for speed, (re, im) in enumerate(WEAVE):
        pair = (re, im) if speed == 0 else (re + 1j * im, re - 1j * im)
        expected = np.array([*pair, *REAL[speed]], dtype=complex)
        at_speed = sp.Poly(quartic.subs(wheel_speed, sp.Rational(speed * 10, 3)), s)
        roots = np.roots(np.array(at_speed.all_coeffs(), dtype=float))
        np.testing.assert_allclose(np.sort_complex(roots), np.sort_complex(expected),
                                   rtol=1e-8, atol=1e-8)


def test_upright_bicycle_stands_on_its_wheels_with_the_benchmarks_loads(rolling):
    q = np.zeros(9)
    u = np.zeros(3)
    forces = dict(zip(rolling.constraint_names,
                      rolling.constraint_forces(q, u, np.zeros(3))))
    # Moments about the rear contact.
    front = 9.81 * (85 * 0.3 + 4 * 0.9 + 3 * 1.02) / 1.02
    assert forces['rolling of front/normal'] == pytest.approx(front, rel=1e-12)
    assert forces['rolling of rear/normal'] == pytest.approx(94 * 9.81 - front,
                                                             rel=1e-12)


@pytest.mark.slow  # SymPy's derivation takes minutes
def test_large_motions_are_those_of_kanes_method_of_sympy(rolling):
    """
    Compare accelerations and loads of the wheels at random states.

    KanesMethod derives the equations of the nine coordinates, without the wheels.
    Its own elimination of six speeds in symbols is too long: the rows of the wheels,
    velocities of SymPy's points, join in numbers by Lagrange multipliers.
    """
    peer = Peer(rolling.model)
    rows = []
    for name, radius in (('rear', 0.3), ('front', 0.35)):
        wheel, center = peer.body(name)
        axis, up = wheel.y, peer.N.z
        # The lowest point of the wheel's rim, which is on the ground.
        down = -(up - up.dot(axis) * axis)
        arm = radius / sp.sqrt(1 - up.dot(axis)**2) * down
        velocity = center.vel(peer.N) + wheel.ang_vel_in(peer.N).cross(arm)
        rows += [velocity.dot(direction) for direction in peer.N]
    rates = dict(zip((q.diff() for q in peer.q), peer.u))
    method = me.KanesMethod(peer.N, peer.q, peer.u,
                            kd_eqs=[rate - speed for rate, speed in rates.items()])
    method.kanes_equations(peer.bodies, peer.loads)
    J = sp.Matrix(rows).jacobian(peer.u)
    drift = (J.diff(me.dynamicsymbols._t) * sp.Matrix(peer.u)).subs(rates)
    function = sp.lambdify([peer.q, peer.u],
                           [method.mass_matrix, method.forcing, J, drift], cse=True)
    rng = np.random.default_rng(3)
    for _ in range(5):
        q = rolling.closed_configuration(0.3 * rng.uniform(-1.0, 1.0, 9))
        u = rng.uniform(-3.0, 3.0, 3)
        M, f, J, drift = (np.array(x, dtype=float)
                          for x in function(q, rolling.joint_rates(q, u)))
        np.testing.assert_allclose(J @ rolling.joint_rates(q, u), 0.0, atol=1e-12)
        whole = np.block([[M, -J.T], [J, np.zeros((6, 6))]])
        solution = np.linalg.solve(whole, np.concatenate([f, -drift])[:, 0])
        udot = rolling.forward_dynamics(q, u, np.zeros(3))
        expected = solution[rolling.mechanism.free]
        np.testing.assert_allclose(udot, expected, rtol=0.0,
                                   atol=1e-9 * np.abs(expected).max())
        forces = dict(zip(rolling.constraint_names,
                          rolling.constraint_forces(q, u, np.zeros(3))))
        normal = [forces[f'rolling of {wheel}/normal'] for wheel in ('rear', 'front')]
        np.testing.assert_allclose(normal, solution[[11, 14]], rtol=1e-9)
