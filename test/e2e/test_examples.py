"""The examples run, and print what is known of their mechanisms."""

from pathlib import Path
import re
import subprocess
import sys

import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'
g = 9.81


def numbers(text):
    """Return the numbers in a text that stand by themselves."""
    return [float(x)
            for x in re.findall(r'(?<![\w.^])[-+]?\d+\.?\d*(?:e[-+]?\d+)?(?!\w)', text)]


def printed(name):
    """Return the lines that an example prints."""
    done = subprocess.run([sys.executable, EXAMPLES / f'{name}.py'], capture_output=True,
                          text=True, check=False, timeout=120)
    assert done.returncode == 0 and done.stderr == '', done.stderr
    return done.stdout.splitlines()


def test_every_example_is_in_the_table_of_the_readme():
    rows = re.findall(r'^\| `(\w+)\.py`', (EXAMPLES / 'README.md').read_text(),
                      re.MULTILINE)
    assert sorted(rows) == sorted(path.stem for path in EXAMPLES.glob('*.py'))


def test_spring_mass_pendulum():
    M, udot, state = printed('spring_mass_pendulum')
    c = np.cos(0.6)
    s = np.sin(0.6)
    expected = np.array([[3.0, 0.5 * c], [0.5 * c, 0.25]])
    assert numbers(M) == pytest.approx(expected.ravel(), abs=1e-6)
    right = [-50 * 0.1, -0.5 * g * s]
    assert numbers(udot) == pytest.approx(np.linalg.solve(expected, right), abs=1e-6)
    assert abs(float(re.search(r'drift (\S+) J', state)[1])) < 1e-9


def test_planar_arm():
    *_, tip, jacobian = printed('planar_arm')
    q1, q2 = (0.3, 0.7)
    u1, u2 = (1.0, -0.5)
    l1 = 0.5
    l2 = 0.4
    assert numbers(tip)[:2] == pytest.approx(
        [l1 * np.sin(q2) * u1, l1 * np.cos(q2) * u1 + l2 * (u1 + u2)], abs=1e-6)
    s = np.sin(np.array([q1, q1 + q2])) * [l1, l2]
    c = np.cos(np.array([q1, q1 + q2])) * [l1, l2]
    assert numbers(jacobian) == pytest.approx([-s.sum(), -s[1], c.sum(), c[1]], abs=1e-6)


def test_drawing():
    *corners, tool, motors, paper = printed('drawing')
    # Blends of the short line in the end have half of its length: 5/32 of that, times
    # sqrt(2).
    assert [numbers(line)[1] for line in corners] == [10.0] * 4 + [5.5] * 2
    assert numbers(motors)[0] < 0.7 * numbers(tool)[0]
    assert paper.endswith('True')


def test_push_and_release():
    deflection, released, energy, mass = printed('push_and_release')
    _, pushed, expected = numbers(deflection)
    assert abs(pushed - expected) < 1e-6 * abs(expected)
    assert numbers(released)[-1] == 0.0
    assert numbers(energy)[1:] == [0.0, 0.0]
    assert numbers(mass)[1] > 1e4  # through a singular configuration


def test_elastic_joints():
    vibration, = printed('elastic_joints')
    by_rigid, by_elastic = numbers(vibration)
    assert by_rigid > 20.0 * by_elastic


def test_free_flying_arm():
    turned, *momenta = printed('free_flying_arm')
    assert numbers(turned)[1] > 90.0
    assert [line.rpartition(' ')[2] for line in momenta] == ['True', 'True']


def test_delta_robot():
    _, *rows, angles, balance = printed('delta_robot')
    assert len(rows) == 6
    at_rest = [numbers(rows[k])[3:] for k in (0, -1)]
    assert all(torque < 0.0 for row in at_rest for torque in row)  # all arms carry
    assert numbers(angles)[-1] < 1e-9  # rad: loop closure against the closed form
    _, work, gain = numbers(balance)
    assert work == pytest.approx(gain, rel=1e-5)


def test_stewart_platform():
    lines = printed('stewart_platform')
    shift, turn = (np.array([numbers(line) for line in lines[k:k + 9]]) for k in (1, 11))
    # half a period apart the platform is at the same place in the first motion, and
    # turned to the other side in the second, where left and right legs change places
    assert shift[0, 1:] == pytest.approx(shift[4, 1:], abs=1e-4)
    assert turn[2, [1, 2, 3, 4, 5, 6]] == pytest.approx(turn[6, [4, 3, 2, 1, 6, 5]],
                                                        abs=1e-4)
    assert numbers(lines[-2])[-1] < 1e-14  # m
    work, gain = numbers(lines[-1])
    assert work == pytest.approx(gain, abs=2e-6)


def test_bearing_torque():
    udot, torque = printed('bearing_torque')
    a1, a2 = numbers(udot)
    m = 1.0
    L = 0.3
    q1 = 0.4
    q2 = 0.9
    u1 = 1.0
    u2 = -2.0
    s = np.sin(q2)
    c = np.cos(q2)
    inertia = m * L**2 * np.array([[80 / 3 + 4 * s**2 / 3, 4 * c], [4 * c, 4 / 3]])
    bias = m * L**2 * np.array(
        [8 / 3 * s * c * u1 * u2 - 4 * s * u2**2, -4 / 3 * s * c * u1**2])
    weight = m * g * L * np.array([8 * np.sin(q1) + np.cos(q1) * s, np.sin(q1) * c])
    assert inertia @ [a1, a2] + bias == pytest.approx(weight, abs=1e-5)
    # of rod B: the acceleration of its center of mass along a2 and a3, its inertia
    # torque about a1
    along_2 = L * (a2 * s + u2**2 * c)
    along_3 = -L * (a1 * s + 2 * u1 * u2 * c + 4 * u1**2)
    about_1 = m * L**2 / 3 * (u1 * u2 + s * (a1 * c - u1 * u2 * s) + u1 * u2 * c**2)
    expected = about_1 - m * L * (4 * along_2 + c * along_3) - m * g * L * np.cos(q1) * c
    assert numbers(torque) == pytest.approx([expected], abs=1e-5)


def test_four_bar():
    closed, torque, pin, residual = printed('four_bar')
    angles = np.cumsum(numbers(closed))
    lengths = np.array([0.3, 0.9, 0.7])
    assert lengths @ np.cos(angles) == pytest.approx(1.0, abs=3e-6)
    assert lengths @ np.sin(angles) == pytest.approx(0.0, abs=3e-6)
    assert len(numbers(torque)) == 2 and len(numbers(pin)) == 5
    assert all(x < 1e-6 for x in numbers(residual)[1:])


def test_mobile_manipulator():
    _, followed, torques = printed('mobile_manipulator')
    assert numbers(followed)[0] < 2e-2  # what holding torques for 1 ms costs
    assert numbers(torques)[-1] < 1e-12  # m/s sideways: the wheels roll


def test_spin_up():
    lag, torque, astray = printed('spin_up')
    assert numbers(lag)[0] == pytest.approx(0.57, abs=0.01)  # m; the time, then the end
    assert abs(numbers(lag)[2]) < 0.01
    assert numbers(torque)[0] > 100.0
    assert numbers(astray)[0] > 5.0


def test_flexible_four_bar():
    torque, residual = printed('flexible_four_bar')
    assert numbers(torque)[1] < 1e-9 * (1.0 + numbers(torque)[0])
    assert numbers(residual)[-1] < 1e-9  # m


def test_flexible_mast():
    push, residual, swings = printed('flexible_mast')
    assert numbers(push)[1] < 1e-9 * (1.0 + abs(numbers(push)[0]))
    assert numbers(residual)[-1] < 1e-9  # J
    mass = 0.3 + 0.236 * 0.5  # Rayleigh: a cantilever's share that swings with its tip
    assert float(re.search(r', ([\d.]+),', swings)[1]) == pytest.approx(
        np.sqrt((3 * 30.0 - 1.2 * 0.3 * g) / mass) / (2 * np.pi), rel=0.03)


def test_payload_sweep():
    soft, stiff, known = (numbers(line) for line in printed('payload_sweep'))
    assert [soft[0], stiff[0], known[0]] == [100.0, 400.0, 100.0]
    assert 0.0 < soft[1] < stiff[1] < known[1] < 8.0  # then torque is short
    assert soft[3] > stiff[3] > 0.05 > 1e-3 > known[3]


def test_rolling_disc():
    held, circle = printed('rolling_disc')
    spin, left = numbers(held)
    assert abs(left) < 1e-9
    # The moment of momentum about the contact turns with it.
    lean = -0.4
    turn = 2.0
    r = 0.3
    s = np.sin(lean)
    c = np.cos(lean)
    assert 1.25 * turn**2 * s * c + 1.5 * turn * spin * c == pytest.approx(
        -g / r * s, abs=1e-4)
    assert numbers(circle) == pytest.approx([abs(spin) * r / turn], abs=1e-6)


def test_sleigh():
    """With d from blade to center of mass: v' = d w^2, (I + m d^2) w' = -m d v w."""
    m = 3.0
    d = 0.3
    w = 1.0
    inertia = m / 12 * (1.0 + 0.4**2)
    for line, v in zip(printed('sleigh'), (2.0, -2.0)):
        turn = -m * d * v * w / (inertia + m * d * d)
        _, speed_up, turn_up, side = numbers(line)
        assert [speed_up, turn_up, side] == pytest.approx(
            [d * w**2, turn, m * (v * w + d * turn)], abs=1e-6)


def test_bicycle():
    loads, begins, *eigenvalues = printed('bicycle')
    assert [float(line.split()[0].split('+')[0]) for line in eigenvalues[::3]] == (
        pytest.approx([-14.07838969279822, -0.32286642900409], abs=1e-6))
    front = g * (85 * 0.3 + 4 * 0.9 + 3 * 1.02) / 1.02
    assert [numbers(loads)[k] for k in (2, 5)] == pytest.approx([94 * g - front, front],
                                                                abs=1e-5)
    lean, _, steer = numbers(begins)
    # M udot = -v C1 (0.1, 0) with the benchmark's matrices; its axes point down
    M = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
    expected = -np.linalg.solve(M, 5.0 * np.array([0.0, -0.85035641456978]) * 0.1)
    assert abs(lean) == pytest.approx(abs(expected[0]), abs=1e-4)
    assert abs(steer) == pytest.approx(abs(expected[1]), abs=1e-4)


def test_palletizer():
    line, = printed('palletizer')
    alone, helped = numbers(line)
    assert helped < 1e-3 * alone
