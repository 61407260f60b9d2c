"""The fastest motion under limits of speed, acceleration, jerk: closed forms."""

from itertools import pairwise

from hypothesis import given, settings, strategies as st
from kane_dynamics.motion.speed_profile import fastest_profile, SectionLimits
import numpy as np
from numpy.testing import assert_allclose
import pytest


def test_the_duration_is_that_of_the_closed_forms():
    # All seven phases: L / V + V / A + A / J.
    V = 0.5
    A = 2.0
    J = 20.0
    long = fastest_profile([SectionLimits(1.0, V, A, J)], [])
    assert long.duration == pytest.approx(1.0 / V + V / A + A / J, rel=1e-12)
    # The jerk alone: four ramps of (L / (2 J))^(1/3).
    short = fastest_profile([SectionLimits(1e-4, V, A, J)], [])
    assert short.duration == pytest.approx(4.0 * np.cbrt(1e-4 / (2.0 * J)), rel=1e-9)
    # Two sections of one kind without a stop are one.
    half = SectionLimits(0.5, V, A, J)
    assert fastest_profile([half, half], [False]).duration == pytest.approx(
        long.duration)
    assert fastest_profile([half, half], [True]).duration == pytest.approx(
        2.0 * (0.5 / V + V / A + A / J))


positive = st.floats(0.01, 10.0)


@st.composite
def lines(draw):
    """Return sections, the inner ones of which may be steady, and stops between them."""
    count = draw(st.integers(1, 6))
    sections = []
    stops = []
    for k in range(count):
        inner = 0 < k < count - 1
        steady = inner and draw(st.booleans())
        sections.append(SectionLimits(draw(positive), draw(positive), draw(positive),
                                      draw(positive), steady))
    for earlier, later in pairwise(sections):
        stops.append(not earlier.steady and not later.steady and draw(st.booleans()))
    return sections, stops


@settings(max_examples=60, deadline=None)
@given(lines())
def test_every_limit_holds_in_every_section_and_stops_are_stops(line):
    sections, stops = line
    profile = fastest_profile(sections, stops)
    t = np.linspace(0.0, profile.duration, 4001)
    place, speed, acceleration = profile.sample(t)
    ends = np.cumsum([section.length for section in sections])
    assert_allclose([place[0], place[-1]], [0.0, ends[-1]], rtol=1e-9, atol=1e-12)
    assert abs(speed[-1]) < 1e-6 and speed[0] == 0.0
    assert (np.diff(place) > -1e-12).all()
    number = np.minimum(np.searchsorted(ends, place), len(sections) - 1)
    edge = np.abs(place[:, None] - ends).min(axis=1) < 1e-9 * ends[-1]
    for k, section in enumerate(sections):
        rows = (number == k) & ~edge
        assert (speed[rows] <= section.speed * (1 + 1e-9)).all()
        if section.steady:
            assert (np.abs(acceleration[rows]) < 1e-9).all()
        else:
            assert (np.abs(acceleration[rows]) <= section.acceleration * (1
                                                                          + 1e-9)).all()
        both = rows[1:] & rows[:-1]
        jerk = np.diff(acceleration)[both] / t[1]
        assert (np.abs(jerk) <= section.jerk * (1 + 1e-6) + 1e-6).all()
    for end, stop in zip(ends, stops):
        if stop:
            nearest = int(np.abs(place - end).argmin())
            # Next to a stop the speed is at most that of the acceleration over a sample.
            assert speed[nearest] <= 20.0 * t[1]


def test_a_scaled_profile_is_the_same_line_in_another_time():
    profile = fastest_profile([SectionLimits(1.0, 0.5, 2.0, 20.0)], [])
    slow = profile.scaled(3.0 * profile.duration)
    t = np.linspace(0.0, profile.duration, 50)
    fast = profile.sample(t)
    scaled = slow.sample(3.0 * t)
    assert_allclose(scaled.place, fast.place, atol=1e-12)
    assert_allclose(3.0 * scaled.speed, fast.speed, atol=1e-12)
    assert_allclose(9.0 * scaled.acceleration, fast.acceleration, atol=1e-11)
