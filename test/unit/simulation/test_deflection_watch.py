"""Simulations say when a beam bends beyond the admissible deflection."""

from functools import cache
import re
import warnings

from kane_dynamics import (FlexibleLink, InputError, ModelBuilder, point_mass, Robot,
                           simulate)
import numpy as np
import pytest

FIRST = re.compile(
    r"beam 'arm'(?: of simulation (\d))?: a deflection of (\S+) m at (\S+) s"
    r'.*; expected at most 0.1 m, a tenth of its length')


@cache
def hinged_beam():
    """Return a beam of 1 m with a load at its tip, without gravity."""
    b = ModelBuilder('hinged beam', gravity=(0, 0, 0))
    b.beam('arm', 'world', FlexibleLink(1.0, 0.8, 40.0, (2, 2)), axis=(0, 0, 1))
    b.load('arm/tip', point_mass(0.3))
    return Robot(b.model())


def deflection(robot, q):
    """Return the deflection of the tip from its pose in the beam's root, m."""
    root = robot.frame_pose('arm', q)
    tip = robot.frame_pose('arm/tip', q)
    return np.linalg.norm((root[:3, :3].T @ (tip - root)[:3, 3])[1:])


def warning_of(q, u, tau):
    """Return the only warning of a simulation, and the trajectory."""
    robot = hinged_beam()
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        run = simulate(robot, q, u, 0.02, step=1e-4, sample=1e-4, torque=tau)
    text, = run.warnings
    return FIRST.match(text), run


@pytest.mark.parametrize('held', [True, False])
def test_the_warning_names_the_first_time_beyond_a_tenth_of_the_length(held):
    robot = hinged_beam()
    tau = np.append(40.0, np.zeros(robot.n - 1))
    texts, run = warning_of(np.zeros(robot.n), np.zeros(robot.n),
                            tau if held else lambda t, q, u: tau)
    tips = np.array([deflection(robot, q) for q in run.q])
    # The last point of the quadrature is near the tip.
    k = int(np.argmax(tips > 0.1 * 1.003))
    assert float(texts[3]) == pytest.approx(run.t[k], abs=2e-4)
    assert float(texts[2]) == pytest.approx(tips[k], rel=0.03)


def test_the_warning_names_the_simulation_and_the_initial_state():
    robot = hinged_beam()
    q, u = np.zeros((2, 3, robot.n))
    q[1, 2] = 0.06
    texts, _ = warning_of(q, u, None)
    assert texts[1] == '1' and float(texts[3]) == 0.0


def test_an_admissible_motion_is_without_remark():
    robot = hinged_beam()
    at_rest = np.zeros(robot.n)
    run = simulate(robot, at_rest, at_rest, 0.02,
                   step=1e-4, torque=np.append(1.0, at_rest[1:]))
    assert run.warnings == ()


@pytest.mark.parametrize('held', [True, False])
def test_the_error_of_a_diverged_motion_names_the_beam(held):
    robot = hinged_beam()
    at_rest = np.zeros(robot.n)
    tau = np.append(1.0, np.zeros(robot.n - 1))
    words = r"diverged .* Earlier, beam 'arm': a deflection of"
    with (pytest.raises(InputError, match=words),
          pytest.warns(UserWarning, match='a step of 0.02 s is too long')):
        simulate(robot, at_rest, at_rest, 10.0, step=0.02, integrator='rk4',
                 torque=tau if held else lambda t, q, u: tau)
