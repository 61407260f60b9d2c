"""Promises of `kane-dynamics calibrate`."""

import json

from held_arms import held, held_arm
from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.cli.parser import main
from kane_dynamics.ros.parameters.parameter_table import BY_NAME
import numpy as np
import pytest
from recordings import exciting
import yaml

URDF = str(resource_path('urdf', 'two_link.urdf'))
CALIBRATE = ['calibrate', URDF, '--collision']
SCALE = [0.8, -1.3, 1.1]
LACKING = np.array([0.3, -0.2])  # N m, of Coulomb friction


@pytest.fixture
def recording(tmp_path):
    """Return a CSV file of a motion without contact, with unmodelled friction."""
    t, q, u, udot = exciting(2, 1, duration=12.0, rate=200.0)
    robot = Robot(load_urdf(URDF))
    tau = robot.inverse_dynamics(q, u, udot) + LACKING * np.tanh(u / 0.05)
    tau += 0.01 * np.random.default_rng(0).normal(size=tau.shape)
    header = ','.join(['t', *(f'{word}{k + 1}' for word in ('q', 'v', 'a', 'tau')
                              for k in range(2))])
    path = tmp_path / 'free.csv'
    np.savetxt(path, np.column_stack([t, q, u, udot, tau]), delimiter=',', header=header,
               comments='')
    return str(path)


def test_the_parameter_file_has_thresholds_and_friction_by_names_of_the_node(
        recording, tmp_path, capsys):
    out = tmp_path / 'thresholds.yaml'
    assert main([*CALIBRATE, recording, '--out', str(out)]) == 0
    printed = capsys.readouterr()
    assert not printed.err
    assert f'wrote {out}' in printed.out
    observer = yaml.safe_load(out.read_text())['/**']['ros__parameters']['observer']
    flat = {}
    for name, value in observer.items():
        if name != 'friction':
            flat[f'observer.{name}'] = value
    flat |= {f'observer.friction.{name}': value
             for name, value in observer['friction'].items()}
    assert set(flat) <= set(BY_NAME)
    assert flat['observer.enabled'] is True  # the file alone detects collisions
    np.testing.assert_allclose(flat['observer.friction.coulomb'], LACKING, atol=0.02)
    assert flat['observer.friction.speed'] == pytest.approx([0.05, 0.05], rel=0.4)
    # Without the fitted friction the first threshold would be above 1.4 times 0.3 N m.
    assert 0.0 < max(flat['observer.threshold']) < LACKING[0]


def test_json_has_the_same_numbers_and_a_threshold_above_the_error(recording, capsys):
    assert main([*CALIBRATE, recording, '--json', '--drift', '0']) == 0
    data = json.loads(capsys.readouterr().out)
    assert data['held_out_alarms'] == 0
    assert data['joint_names'] == ['joint1', 'joint2']
    for threshold, error in zip(data['threshold'], data['error'], strict=True):
        assert threshold > 1.3 * error
    assert data['node_parameters']['threshold'] == pytest.approx(data['threshold'],
                                                                 rel=1e-3)


# Gravity by held poses.

NAMES = 'j1', 'j2', 'j3'


@pytest.fixture
def arm(tmp_path):
    """Return the folder of a wrong URDF, and tables of poses without and with a load."""
    rng = np.random.default_rng(2)
    true = held_arm(3, rng)
    (tmp_path / 'arm.urdf').write_text(true.urdf(true.masses * [2.0, 0.5, 0.7]))
    header = ','.join(f'{word}.{name}' for word in ('q', 'tau') for name in NAMES)
    for name, load in (('empty', 0.0), ('loaded', 0.5)):
        poses = held(true, rng.uniform(-1.5, 1.5, (15, 3)), SCALE, rng, load=load)
        np.savetxt(tmp_path / f'{name}.csv', np.hstack([poses.q, poses.effort]),
                   delimiter=',', header=header, comments='')
    return tmp_path, true


def test_poses_with_a_load_give_a_supplement_and_parameters_of_the_node(arm, capsys):
    folder, true = arm
    out = folder / 'arm.yaml'
    assert main(['calibrate', str(folder / 'arm.urdf'), str(folder / 'empty.csv'),
                 '--loaded', str(folder / 'loaded.csv'), '--load', 'l3', '--load-mass',
                 '0.5', '--load-com', '0', '0', '0.1', '--out', str(out)]) == 0
    printed = capsys.readouterr()
    assert not printed.err
    assert '60 held poses' in printed.out
    node = yaml.safe_load((folder / 'arm.node.yaml').read_text())
    parameters = node['/**']['ros__parameters']
    assert parameters['supplement'] == str(out)
    np.testing.assert_allclose(parameters['efforts']['scale'], SCALE, rtol=0.02)
    robot = Robot(load_urdf(folder / 'arm.urdf', supplement=out))
    for q in np.random.default_rng(0).uniform(-1.5, 1.5, (10, 3)):
        np.testing.assert_allclose(robot.gravity_force(q), true.holding_torque(q),
                                   atol=0.1)


def test_poses_without_a_load_say_what_cannot_be_told_apart(arm, capsys):
    folder, _ = arm
    assert main(['calibrate', str(folder / 'arm.urdf'), str(folder / 'empty.csv'),
                 '--json']) == 0
    printed = capsys.readouterr()
    assert 'masses cannot be told apart at j1, j2, j3' in printed.err
    data = json.loads(printed.out)
    assert data['scale_deviation'] == [None, None, None]
    assert data['not_told_apart'] == ['j1', 'j2', 'j3']
    assert len(data['further_poses']) == 5
    assert (np.array(data['rms_held_out']) < 0.3 * np.array(data['rms_before'])).all()
