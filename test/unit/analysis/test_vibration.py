"""Vibrations of constrained mechanisms, and what has none."""

from functools import cache

from kane_dynamics import absolute_rates, InputError, natural_vibration, Robot, simulate
from linkages import at_angle, four_bar, four_bar_model, PIN, sleigh
import numpy as np
import pytest


@cache
def hanging():
    """Return the configuration at which the potential energy of the four-bar is least."""
    linkage, q = four_bar('crank'), [at_angle(0.8)]
    for angle in np.linspace(0.8, 0.8 - 2.0 * np.pi, 200)[1:]:
        q.append(linkage.closed_posture([angle, *q[-1][1:]], fixed=['crank']))
    best = min(q, key=linkage.potential_energy)
    for _ in range(20):  # Newton's method
        step = linkage.gravity_force(best)[0] / natural_stiffness(linkage, best)
        best = linkage.closed_posture(best - [step, 0.0, 0.0], fixed=['crank'])
    return best


def natural_stiffness(linkage, q):
    """Return the stiffness in the crank angle."""
    return natural_vibration(linkage, q).frequencies[0]**2 * linkage.mass_matrix(q)[0, 0]


def test_a_linkage_released_beside_its_equilibrium_swings_at_its_natural_frequency():
    linkage, rest = four_bar('crank'), hanging()
    found = natural_vibration(linkage, rest)
    assert found.frequencies.shape == (1,) and found.shapes.shape == (3, 1)
    beside = linkage.closed_posture(rest + [1e-4, 0.0, 0.0], fixed=['crank'])
    run = simulate(linkage, beside, [0.0], 4.0, step=1e-3, sample=1e-3)
    around = run.q[:, 0] - rest[0]
    crossings = np.flatnonzero(np.diff(np.sign(around)))
    times = run.t[crossings] - around[crossings] * 1e-3 / np.diff(around)[crossings]
    period = 2.0 * (times[-1] - times[0]) / (len(times) - 1)
    assert len(times) >= 3
    assert 2.0 * np.pi / period == pytest.approx(found.frequencies[0], rel=1e-5)


def test_frequencies_are_those_of_every_choice_of_speeds():
    q = hanging()
    expected = natural_vibration(four_bar('crank'), q).frequencies
    for robot in (four_bar('rocker'), Robot(four_bar_model(), constraints=[PIN],
                                            speeds=absolute_rates)):
        np.testing.assert_allclose(natural_vibration(robot, q).frequencies, expected, rtol=1e-9)


def test_a_brake_on_a_dependent_joint_holds_the_linkage():
    assert natural_vibration(four_bar('crank'), at_angle(0.8), ['rocker']).frequencies.size == 0


def test_loaded_velocity_constraints_are_refused():
    with pytest.raises(InputError, match='constraints of velocities that carry a load; expected'):
        natural_vibration(sleigh(), np.zeros(3))
