"""Promises of the pictures: labels with units, honest numbers, and no trace left in matplotlib."""

import subprocess
import sys
from types import SimpleNamespace

from kane_dynamics.plot import (plot_demand, plot_torque_sources, plot_tracking,
                                plot_trajectory)
import matplotlib
import numpy as np
import pytest

NAMES = ('shoulder', 'elbow', 'slide')
T = np.linspace(0.0, 2.0, 81)
Q = np.sin(T[:, None] * [1.0, 2.0, 3.0])
TERMS = np.stack([Q, -0.5 * Q, 1.0 + 0.0 * Q, 0.2 * Q, 0.0 * Q], axis=1)
RUNS = {'PD only': (T, Q, Q + 0.02), 'PD + feedforward': (T[::2], Q[::2], Q[::2] - 0.0005)}
TRAJECTORY = SimpleNamespace(t=T, q=Q, u=Q, tau=Q, energy=np.stack([T, 3.0 - T], axis=1),
                             joint_names=NAMES, speed_names=NAMES)
DEMAND = SimpleNamespace(t=T, u=Q, tau=3.0 * Q, power=3.0 * Q * Q, joint_names=NAMES,
                         limits=SimpleNamespace(effort=np.array([2.0, np.inf, 5.0]),
                                                velocity=np.full(3, 2.0)),
                         power_limit=np.full(3, np.inf))
DRAWINGS = {
    'demand': lambda path: plot_demand(DEMAND, path, prismatic={'slide'}),
    'trajectory': lambda path: plot_trajectory(TRAJECTORY, path, prismatic={'slide'}),
    'tracking': lambda path: plot_tracking(RUNS, NAMES, path, prismatic={'slide'},
                                           sources=(T, TERMS)),
    'sources': lambda path: plot_torque_sources(T, TERMS, NAMES, path, prismatic={'slide'}),
    'many': lambda path: plot_torque_sources(T, np.tile(TERMS, 3), NAMES * 3, path),
}


@pytest.mark.parametrize('name', DRAWINGS)
def test_writes_a_picture_and_leaves_the_users_style_alone(name, tmp_path):
    before = dict(matplotlib.rcParams)
    figure = DRAWINGS[name](tmp_path / 'picture.png')
    assert (tmp_path / 'picture.png').read_bytes().startswith(b'\x89PNG')
    assert dict(matplotlib.rcParams) == before
    assert all('[' in axes.get_ylabel() for axes in figure.axes)
    assert figure.axes[-1].get_xlabel() == 'Time [s]'


def test_units_follow_the_kind_of_joint():
    labels = [axes.get_ylabel() for axes in DRAWINGS['tracking'](None).axes]
    assert labels == ['shoulder\n[rad]', '[mrad]', '[N m]', 'elbow\n[rad]', '[mrad]', '[N m]',
                      'slide\n[m]', '[mm]', '[N]']
    assert DRAWINGS['trajectory'](None).axes[0].get_ylabel() == 'Position\n[rad, m]'


def test_demand_shows_the_limits_that_there_are():
    figure = DRAWINGS['demand'](None)
    drawn = [[line.get_ydata()[0] for line in axes.lines[1:]] for axes in figure.axes]
    assert drawn == [[-2.0, 2.0], [-2.0, 2.0], [], [], [-2.0, 2.0], [],
                     [-5.0, 5.0], [-2.0, 2.0], []]
    assert [axes.get_ylabel() for axes in figure.axes[6:]] == ['slide\n[N]', '[m/s]', '[W]']


def test_tracking_states_the_rms_of_each_run():
    texts = [text.get_text() for text in DRAWINGS['tracking'](None).axes[1].texts]
    assert texts == ['RMS', '20 mrad', '0.5 mrad']


def test_sources_are_stacked_away_from_zero_and_their_line_is_the_sum():
    axes = DRAWINGS['sources'](None).axes[0]
    np.testing.assert_allclose(axes.lines[0].get_ydata(), TERMS[:, :, 0].sum(axis=1))
    heights = np.concatenate([c.get_paths()[0].vertices[:, 1] for c in axes.collections])
    assert heights.max() == pytest.approx(np.maximum(TERMS[:, :, 0], 0.0).sum(axis=1).max())
    assert heights.min() == pytest.approx(np.minimum(TERMS[:, :, 0], 0.0).sum(axis=1).min())


def test_sources_that_a_robot_lacks_are_not_in_the_legend():
    labels = [text.get_text() for text in DRAWINGS['sources'](None).legends[0].get_texts()]
    assert labels == ['inertia', 'Coriolis, centrifugal', 'gravity', 'friction', 'sum']


def test_pyplot_is_never_imported_so_no_backend_is_chosen():
    code = 'import sys, kane_dynamics.plot; sys.exit("matplotlib.pyplot" in sys.modules)'
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0
