"""Plots: labels with units, exact values, and no change of global matplotlib state."""

import copy
from functools import cache
from itertools import pairwise
import subprocess
import sys
from types import SimpleNamespace

from kane_dynamics import InputError, ModelBuilder, Robot, rod, simulate
from kane_dynamics.analysis.power_balance import power_balance, unaccounted_energy
from kane_dynamics.plot import (plot_demand, plot_energy, plot_phase, plot_reactions,
                                plot_replay, plot_sweep, plot_timing,
                                plot_torque_by_source, plot_tracking, plot_trajectory)
from kane_dynamics.robot.parameters import JointLimits
from kane_dynamics.simulation.trajectory import Trajectory
import matplotlib
from mechanisms import random_model
import numpy as np
import pytest

NAMES = ('shoulder', 'elbow', 'slide')
T = np.linspace(0.0, 2.0, 81)
Q = np.sin(T[:, None] * [1.0, 2.0, 3.0])
TERMS = np.stack([Q, -0.5 * Q, 1.0 + 0.0 * Q, 0.2 * Q, 0.0 * Q], axis=1)
RUNS = {'PD only': (T, Q, Q + 0.02),
        'PD + feedforward': (T[::2], Q[::2], Q[::2] - 0.0005)}
TRAJECTORY = SimpleNamespace(t=T, q=Q, u=Q, tau=Q, energy=np.stack([T, 3.0 - T], axis=1),
                             joint_names=NAMES, speed_names=NAMES)


@cache
def arm():
    """Return a robot with springs, friction, revolute and prismatic joints."""
    return Robot(random_model(9, n=3))


@cache
def pushed_arm():
    """Return a motion of the robot under smooth torques."""
    def torque(t, q, u):
        return np.array([3.0, 5.0, -1.0]) * np.cos(4.0 * t)
    return simulate(arm(), np.array([0.3, 0.1, -0.4]), np.zeros(3), 0.4,
                    step=2e-3, torque=torque, sample=4e-3)


DEMAND = SimpleNamespace(t=T, u=Q, tau=3.0 * Q, power=3.0 * Q * Q, joint_names=NAMES,
                         limits=SimpleNamespace(effort=np.array([2.0, np.inf, 5.0]),
                                                velocity=np.full(3, 2.0)),
                         power_limit=np.full(3, np.inf))
TIMING = SimpleNamespace(
    motion=SimpleNamespace(times=T), joint_names=NAMES,
    uses={'effort': np.abs(np.sin(Q))},
    active=(SimpleNamespace(joint=NAMES[0], limit='effort', start=T[1], end=T[4]),))
DRAWINGS = {
    'timing': lambda path=None: plot_timing(TIMING, path),
    'demand': lambda path=None: plot_demand(DEMAND, path, prismatic={'slide'}),
    'trajectory': lambda path=None: plot_trajectory(TRAJECTORY, path,
                                                    prismatic={'slide'}),
    'tracking': lambda path=None: plot_tracking(RUNS, NAMES, path, prismatic={'slide'},
                                                sources=(T, TERMS)),
    'replay': lambda path=None: plot_replay(T, Q, 0.9 * Q, NAMES, path,
                                            prismatic={'slide'}),
    'sources': lambda path=None: plot_torque_by_source(arm(), pushed_arm(), path),
    'energy': lambda path=None: plot_energy(arm(), pushed_arm(), path),
    'reactions': lambda path=None: plot_reactions(arm(), pushed_arm(), path),
    'phase': lambda path=None: plot_phase(arm(), pushed_arm(), path),
}


@pytest.mark.parametrize('name', DRAWINGS)
def test_writes_a_picture_and_leaves_the_users_style_alone(name, tmp_path):
    style_before = dict(matplotlib.rcParams)
    figure = DRAWINGS[name](tmp_path / 'picture.png')
    assert (tmp_path / 'picture.png').read_bytes().startswith(b'\x89PNG')
    assert dict(matplotlib.rcParams) == style_before
    assert all('[' in axes.get_ylabel() for axes in figure.axes)
    assert figure.axes[-1].get_xlabel().startswith(
        'Position [' if name == 'phase' else 'Time [s]')


def test_units_follow_the_kind_of_joint():
    def labels(name):
        return [axes.get_ylabel() for axes in DRAWINGS[name]().axes]
    assert labels('tracking') == [
        'shoulder\n[rad]', '[mrad]', '[N m]', 'elbow\n[rad]', '[mrad]', '[N m]',
        'slide\n[m]', '[mm]', '[N]']
    assert labels('trajectory')[0] == 'Position\n[rad, m]'
    assert [joint.kind for joint in arm().model.coordinate_joints] == [
        'prismatic' if label == '[N]' else 'revolute' for label in labels('sources')]
    assert {'[N]', '[N m]'} == set(labels('sources'))


def test_demand_shows_the_limits_that_there_are():
    figure = DRAWINGS['demand']()
    drawn = []
    for axes in figure.axes:
        drawn.append([line.get_ydata()[0] for line in axes.lines[1:]])
    assert drawn == [[-2.0, 2.0], [-2.0, 2.0], [], [], [-2.0, 2.0], [],
                     [-5.0, 5.0], [-2.0, 2.0], []]
    assert [axes.get_ylabel() for axes in figure.axes[6:]] == [
        'slide\n[N]', '[m/s]', '[W]']


def test_tracking_states_the_rms_of_each_run():
    texts = [text.get_text() for text in DRAWINGS['tracking']().axes[1].texts]
    assert texts == ['RMS', '20 mrad', '0.5 mrad']


def test_sources_are_stacked_away_from_zero_and_add_up_to_the_torque():
    motion = pushed_arm()
    terms = arm().torque_terms(motion.q, motion.u, motion.udot)
    for i, axes in enumerate(DRAWINGS['sources']().axes):
        total = axes.lines[0].get_ydata()
        np.testing.assert_allclose(total, motion.tau[:, i], atol=1e-10)
        heights = [c.get_paths()[0].get_extents() for c in axes.collections]
        up = np.maximum(terms[:, :, i], 0.0).sum(axis=1)
        down = np.minimum(terms[:, :, i], 0.0).sum(axis=1)
        assert max(h.y1 for h in heights) == pytest.approx(up.max())
        assert min(h.y0 for h in heights) == pytest.approx(down.min())
        np.testing.assert_allclose(up + down, total, atol=1e-10)


def test_sources_that_a_robot_lacks_are_not_in_the_legend():
    labels = [text.get_text() for text in DRAWINGS['tracking']().legends[0].get_texts()]
    assert labels[-5:] == ['inertia', 'Coriolis, centrifugal', 'gravity', 'friction',
                           'sum']


def test_energies_add_up_and_the_power_balances_to_rounding():
    motion = pushed_arm()
    energies, power, residual, _ = DRAWINGS['energy']().axes
    lines = {line.get_label(): line.get_ydata()
             for line in (*energies.lines, *power.lines)}
    np.testing.assert_allclose(lines['kinetic'] + lines['gravity'] + lines['springs'],
                               lines['total'], atol=1e-12)
    springs = sum(0.5 * joint.stiffness * (motion.q[:, i] - joint.rest) ** 2
                  for i, joint in enumerate(arm().model.coordinate_joints))
    np.testing.assert_allclose(lines['springs'], springs, rtol=1e-12)
    np.testing.assert_allclose(lines['motors'], (motion.tau * motion.u).sum(axis=1),
                               atol=1e-9)
    assert np.abs(lines['rate of energy']).max() > 0.5
    np.testing.assert_allclose(lines['motors'] + lines['friction'],
                               lines['rate of energy'], atol=1e-9)
    assert np.abs(residual.lines[0].get_ydata()).max() < 1e-9


def test_a_balance_of_many_states_is_that_of_each():
    motion = pushed_arm()
    many = power_balance(arm(), motion.q, motion.u, motion.udot)
    for k in (0, 40):
        one = power_balance(arm(), motion.q[k], motion.u[k], motion.udot[k])
        np.testing.assert_allclose(one, [power[k] for power in many],
                                   rtol=1e-9, atol=1e-10)


def test_a_motion_that_was_not_simulated_has_the_torques_and_energies_of_one_that_was():
    motion = pushed_arm()
    along = Trajectory.along(arm(), motion.t, motion.q, motion.u, motion.udot)
    np.testing.assert_allclose(along.tau, motion.tau, atol=1e-10)
    np.testing.assert_allclose(along.energy, motion.energy, rtol=1e-13)
    assert along.joint_names == motion.joint_names


@pytest.mark.parametrize(('t', 'words'), [
    ([0.0, 2.0, 1.0], 'row 3, after 2.0'), ([0.0, np.nan, 1.0], 'nan in row 2'),
    ([0.0, 1.0], r'shape \(2,\); expected \(3,\)')])
def test_a_motion_without_an_order_in_time_is_refused(t, words):
    with pytest.raises(InputError, match=words):
        Trajectory.along(arm(), t, *np.zeros((3, 3, arm().n)))


def test_unaccounted_energy_is_the_error_of_integration_of_fourth_order():
    def lost(step):
        motion = simulate(arm(), np.array([0.3, 0.1, -0.4]), np.array([0.5, -0.5, 0.7]),
                          0.4, step=step, sample=step)
        power = power_balance(arm(), motion.q, motion.u, motion.udot)
        return np.abs(unaccounted_energy(motion.t, motion.energy.sum(axis=1),
                                         power.joints - power.friction)).max()
    coarse, fine = lost(4e-3), lost(2e-3)
    assert coarse < 1e-8
    assert fine == pytest.approx(coarse / 16.0, rel=0.1)


def test_a_reactions_magnitude_is_that_of_its_components():
    first = DRAWINGS['reactions']().axes[:2]
    motion = pushed_arm()
    expected = arm().joint_reactions(motion.q, motion.u, motion.udot)[:, 0]
    for axes, vector in zip(first, (expected[:, :3], expected[:, 3:]), strict=True):
        lines = {line.get_label(): line.get_ydata() for line in axes.lines}
        np.testing.assert_array_equal(np.stack([lines[x] for x in 'xyz'], axis=1),
                                      vector)
        np.testing.assert_allclose(lines['magnitude'], np.linalg.norm(vector, axis=1))


def test_phase_portraits_show_motion_and_limits():
    limits = arm().limits
    for i, axes in enumerate(DRAWINGS['phase']().axes):
        drawn = [line for line in axes.lines if line.get_label() == 'limit']
        ends = np.concatenate([np.unique(line.get_xydata()) for line in drawn])
        assert {limits.lower[i], limits.upper[i], limits.velocity[i]} <= set(ends)
        np.testing.assert_array_equal(
            axes.lines[0].get_xydata(),
            np.stack([pushed_arm().q[:, i], pushed_arm().u[:, i]], axis=1))


def test_a_motion_of_other_joints_is_refused():
    b = ModelBuilder('other')
    b.body('only', inertial=rod(1.0, (0, 0, 0), (1, 0, 0)))
    other_robot = Robot(b.model())
    for function in (plot_torque_by_source, plot_energy, plot_reactions, plot_phase):
        with pytest.raises(InputError, match=r"joint0.*; expected \['only'\]"):
            function(other_robot, pushed_arm())


def test_a_picture_of_an_unknown_format_is_refused():
    with pytest.raises(InputError, match=r"'picture\.bad'.*\.png"):
        DRAWINGS['phase']('picture.bad')


def test_pyplot_is_never_imported_so_no_backend_is_chosen():
    code = 'import sys, kane_dynamics.plot; sys.exit("matplotlib.pyplot" in sys.modules)'
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0


def test_titles_name_the_robot_unless_another_is_given():
    name = arm().model.name
    for what in ('sources', 'energy', 'reactions', 'phase'):
        assert DRAWINGS[what]().get_suptitle().startswith(f'{name}: ')
    assert plot_torque_by_source(arm(), pushed_arm(), title='x').get_suptitle() == 'x'


@pytest.mark.parametrize('plot', ['timing', 'demand', 'tracking', 'replay'])
def test_joint_names_beside_the_rows_do_not_touch(plot):
    """Those of Universal Robots' arms are long."""
    names = ('shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint', 'wrist_1_joint',
             'wrist_2_joint', 'wrist_3_joint')
    rows = np.tile(Q, 2)
    limits = SimpleNamespace(effort=np.full(6, 5.0), velocity=np.full(6, 2.0))
    named = {
        'timing': lambda: plot_timing(SimpleNamespace(
            motion=TIMING.motion, joint_names=names, active=(),
            uses={'effort': np.abs(rows), 'velocity': np.abs(rows)})),
        'demand': lambda: plot_demand(SimpleNamespace(
            t=T, u=rows, tau=rows, power=rows, joint_names=names, limits=limits,
            power_limit=np.full(6, np.inf))),
        'tracking': lambda: plot_tracking({'PD': (T, rows, 0.9 * rows)}, names),
        'replay': lambda: plot_replay(T, rows, 0.9 * rows, names)}
    figure = named[plot]()
    figure.draw_without_rendering()
    places = []
    for axes in figure.axes:
        if axes.get_ylabel().startswith(names):
            places.append(axes.yaxis.label.get_window_extent())
    assert len(places) == len(names)
    for above, below in pairwise(places):
        assert above.y0 > below.y1 + 5.0  # pixels


def test_limits_of_torque_and_speed_are_drawn_where_a_joint_comes_near():
    limits = JointLimits(np.full(3, -3.0), np.full(3, 3.0), np.array([1.2, 5.0, np.inf]),
                         np.array([0.9, np.inf, 40.0]))
    figure = plot_trajectory(TRAJECTORY, limits=limits)
    for axes, drawn, words in ((figure.axes[1], [1.2], '83.3 % of a limit (shoulder)'),
                               (figure.axes[2], [0.9], '111 % of a limit (shoulder)')):
        lines = [line for line in axes.lines if line.get_label() == 'limit']
        assert [line.get_ydata()[0] for line in lines] == drawn
        low, high = axes.get_ylim()
        assert low <= drawn[0] <= high and words in axes.get_title(loc='right')
    robot = copy.copy(arm())
    largest = np.abs(pushed_arm().tau).max(axis=0)
    unlimited = np.full(3, np.inf)
    robot.limits = JointLimits(unlimited, unlimited, unlimited,
                               largest * [1.5, 30.0, np.inf])
    panels = plot_torque_by_source(robot, pushed_arm()).axes
    near = []
    for line in panels[0].lines:
        if line.get_label() == 'limit':
            near.append(line.get_ydata()[0])
    assert np.abs(near).tolist() == pytest.approx([1.5 * largest[0]] * len(near))
    assert near
    assert panels[1].get_title(loc='right') == f'limit ±{30.0 * largest[1]:g}'
    assert not panels[1].texts and not panels[2].get_title(loc='right')


def test_rounding_errors_are_a_line_at_zero_not_data():
    noise = 1e-17 * np.sin(50.0 * T)[:, None] * np.ones(3)
    still = SimpleNamespace(**{**vars(TRAJECTORY), 'q': noise, 'u': noise, 'tau': noise})
    figures = [plot_trajectory(still),
               plot_tracking({'run': (T, 0.0 * Q, noise)}, NAMES),
               plot_replay(T, 5.0 * Q, 5.0 * Q + noise, NAMES)]
    for axes in (*figures[0].axes[:3], *figures[1].axes, *figures[2].axes[1::2]):
        low, high = axes.get_ylim()
        assert low < -1e-4 and high > 1e-4
    assert [text.get_text() for text in figures[1].axes[1].texts] == ['RMS', '0 mrad']
    small = plot_tracking({'run': (T, 0.0 * Q, 1e-7 * Q)}, NAMES)
    assert (small.axes[1].get_ylim()[1]
            < 2e-4), 'but what is small and no rounding is shown'


def test_joints_that_move_alike_are_all_seen():
    same = SimpleNamespace(**{**vars(TRAJECTORY), 'q': Q[:, :1] * np.ones(3)})
    widths = [line.get_linewidth() for line in plot_trajectory(same).axes[0].lines]
    assert len(set(widths)) == 3 and widths == sorted(widths, reverse=True)


def lines_by_label(axes, labels):
    """Return the lines of a panel that have one of some labels."""
    return {line.get_label(): line for line in axes.lines if line.get_label() in labels}


def test_many_joints_have_panels_side_by_side_each_line_in_one_of_them():
    n = 17
    t = np.linspace(0.0, 1.0, 50)
    names = tuple(f'joint_{k}' for k in range(n))
    rows = np.sin(t[:, None] * np.arange(1.0, n + 1.0))
    run = SimpleNamespace(t=t, q=rows, u=2.0 * rows, tau=3.0 * rows, joint_names=names,
                          speed_names=names, coordinate_names=names, energy=rows[:, :2])
    limits = JointLimits(*[np.full(n, np.inf)] * 2, np.full(n, 1.9), np.full(n, 0.1))
    figure = plot_trajectory(run, limits=limits)
    panels = figure.axes
    assert len(panels) == 10  # three quantities in three columns, and the energy
    for scale, row in zip((1.0, 2.0, 3.0), (panels[:3], panels[3:6], panels[6:9])):
        drawn = {}
        for axes in row:
            lines = lines_by_label(axes, names)
            colors = {line.get_color() for line in lines.values()}
            assert len(colors) == len(lines) <= 7
            drawn |= lines
        assert len(lines_by_label(row[0], names)) == 7
        assert tuple(drawn) == names
        values = [line.get_ydata() for line in drawn.values()]
        np.testing.assert_allclose(values, scale * rows.T)
        assert len({axes.get_ylim() for axes in row}) == 1
    legends = []
    for axes in panels[:3]:
        legends += [text.get_text() for text in axes.get_legend().get_texts()]
    assert legends == list(names)
    assert panels[6].get_title(loc='right').startswith('at most 30 times a limit')


def test_a_sweep_is_drawn_over_what_varies_with_the_failed_trials_on_the_axis():
    table = {'index': [0, 1, 2], 'seed': [1, 1, 1], 'q0.a': [0.0, 0.0, 0.0],
             'payload.mass': [1.0, 2.0, 3.0], 'ok': [True, True, False],
             'error': [None, None, 'x'], 'peak_torque.a': [4.0, 5.0, None],
             'peak_torque.b': [-6.0, 1.0, None], 'rms_error.a': [0.1, 0.2, None]}
    figure = plot_sweep(table)
    torque, error = figure.axes
    lines = {line.get_label(): line for line in torque.lines}
    np.testing.assert_array_equal(lines['completed'].get_xydata(), [[1, 6], [2, 5]])
    np.testing.assert_array_equal(lines['failed'].get_xdata(), [3.0])
    np.testing.assert_array_equal(error.lines[0].get_ydata(), [0.1, 0.2])
    assert error.get_xlabel() == 'payload.mass'
    with pytest.raises(InputError, match='expected one that varies'):
        plot_sweep({**table, 'payload.mass': [1.0] * 3})
