"""Plots of flexible robots: points of beams, planes, and frequencies."""

from functools import cache

from kane_dynamics import (FlexibleLink, InputError, ModelBuilder, natural_vibration,
                           Robot, rod)
from kane_dynamics.plot import plot_bending, plot_vibrations
import matplotlib
import numpy as np
import pytest


@cache
def robot():
    b = ModelBuilder('crank and beam')
    b.body('crank', axis=(0, 1, 0), inertial=rod(1.0, (0, 0, 0), (0.5, 0, 0)))
    b.beam('beam', 'crank', FlexibleLink(1.0, 1.0, 20.0, (2, 0), up=(0, 0, 1)),
           axis=(0, 1, 0), at=(0.5, 0, 0))
    b.body('hand', 'beam/tip', axis=(0, 1, 0), inertial=rod(0.1, (0, 0, 0), (0.2, 0, 0)))
    b.frame('finger', 'hand', at=(0.2, 0, 0))
    return Robot(b.model())


CONFIGURATIONS = np.array([[0.3, 0.2, 0.05, -0.01, 0.4], [0.5, 0.1, 0.02, 0.01, -0.4]])


def curves(axes):
    """Return the lines of a panel, without the dots, as (k, 2) arrays."""
    return [np.array(line.get_data()).T
            for line in axes.lines if line.get_marker() != 'o']


def test_an_arm_is_drawn_from_joint_to_joint_along_its_bent_beams(tmp_path):
    style_before = dict(matplotlib.rcParams)
    model = robot().model
    figure = plot_bending(model, CONFIGURATIONS, [0.0, 0.5], tmp_path / 'arm.png')
    assert (tmp_path / 'arm.png').read_bytes().startswith(b'\x89PNG')
    assert dict(matplotlib.rcParams) == style_before
    axes, = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ('x [m]', 'z [m]')
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        '0 s', '0.5 s']
    beam, *bodies = curves(axes)[:3]
    places = {name: robot().frame_pose(name, CONFIGURATIONS[0])[[0, 2], 3]
              for name in ('crank', 'beam', 'beam/tip', 'hand', 'finger')}
    np.testing.assert_allclose(beam[[0, -1]], [places['beam'], places['beam/tip']],
                               atol=1e-12)
    assert len(beam) > 20
    np.testing.assert_allclose(bodies, [[places['crank'], places['beam']],
                                        [places['hand'], places['finger']]], atol=1e-12)


def test_exaggeration_multiplies_the_deflection_and_is_said():
    def off_line(exaggeration):
        figure = plot_bending(robot().model, [0, 0, 1e-4, 0, 0],
                              exaggeration=exaggeration)
        return curves(figure.axes[0])[0][-1, 1], figure.get_suptitle()
    (plain, title), (exaggerated, exaggerated_title) = off_line(1.0), off_line(100.0)
    assert exaggerated == pytest.approx(100.0 * plain)
    assert title == 'Bending arm'
    assert exaggerated_title == 'Bending arm, deflections drawn 100 times'


def test_vibrations_are_drawn_with_their_frequencies_to_both_sides():
    hang = np.array([np.pi / 2, 0.0, 0.0, 0.0, 0.0])
    figure = plot_vibrations(robot(), hang, count=3)
    hertz = natural_vibration(robot(), hang).frequencies[:3] / (2.0 * np.pi)
    assert [float(axes.get_title('left').split()[0]) for axes in figure.axes] == (
        pytest.approx(hertz, rel=1e-3))
    for axes in figure.axes:
        drawn = curves(axes)
        still = drawn[:3]
        extent = np.ptp(np.concatenate(still), axis=0).max()
        largest = 0.0
        for middle, one_end, opposite_end in zip(still, drawn[3:6], drawn[6:]):
            np.testing.assert_allclose(one_end - middle, middle - opposite_end,
                                       atol=1e-9)
            largest = max(largest, np.abs(one_end - middle).max())
        assert largest / extent == pytest.approx(0.15)


@pytest.mark.parametrize('call, words', [
    (lambda: plot_bending(robot().model, np.zeros(4)),
     r'q: .*; expected finite .* \(5,\)'),
    (lambda: plot_bending(robot().model, CONFIGURATIONS, [0.0]),
     't: 1 times; expected 2'),
    (lambda: plot_bending(robot().model, CONFIGURATIONS, plane='zx'),
     "plane: 'zx'; expected one of xy"),
    (lambda: plot_vibrations(robot(), np.zeros(5), count=0), 'no vibration to plot'),
    (lambda: plot_bending(single(), np.zeros(1)), 'no body has a length')])
def test_invalid_arguments_of_bending_plots_are_refused(call, words):
    with pytest.raises(InputError, match=words):
        call()


def single():
    b = ModelBuilder('a wheel')
    b.body('wheel')
    return b.model()
