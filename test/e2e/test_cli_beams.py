"""Promises of `feasible` and `fill` for arms with beams, which are in equilibrium."""

import json

from command_in_process import command
from kane_dynamics import load_urdf, Motion, QuasiStatic, Robot, stiffened
from kane_dynamics._util.resources import resource_path
from kane_dynamics.feasibility import demand, fastest, largest_payload
from kane_dynamics.mechanics.definition import kane
import numpy as np
from palletizer import BEAMS, bending_palletizer, DRIVEN, LOOPS, URDF as PALLETIZER
import pytest
from scipy.optimize import fsolve
import yaml

URDF = resource_path('urdf', 'two_link.urdf')
BENDING = resource_path('urdf', 'two_link.bending.yaml')
ARM = [str(URDF), '--supplement', str(BENDING)]
JOINTS = ('joint1', 'joint2')
TIMES = [0.0, 0.8, 1.5]
POINTS = np.array([[0.3, -0.4], [0.9, 0.3], [0.5, 0.6]])


def written(path, names, times, rows):
    """Write positions as a CSV file; return its path."""
    np.savetxt(path, np.column_stack([times, rows]), delimiter=',', comments='',
               header=','.join(['t', *(f'q.{name}' for name in names)]))
    return str(path)


@pytest.fixture
def motion(tmp_path):
    return written(tmp_path / 'motion.csv', JOINTS, TIMES, POINTS)


def bent_torques(model, q, u, udot):
    """Return the torques of Kane's definition with no modal force or acceleration."""
    modes = list(model.modal_coordinates)
    joints = [k for k in range(model.n) if k not in modes]
    whole = np.zeros((3, model.n))
    whole[:, joints] = q, u, udot

    def force(eta):
        whole[0, modes] = eta
        return kane.inverse_dynamics(model, *whole)
    eta = fsolve(lambda x: force(x)[modes], np.zeros(len(modes)), xtol=1e-13)
    return force(eta)[joints]


def test_filled_efforts_are_those_of_the_definition_with_bent_beams(motion):
    done = command('fill', *ARM, '--motion', motion, '--json')
    assert done.returncode == 0, done.stderr
    filled, = json.loads(done.stdout)
    model = load_urdf(URDF, supplement=BENDING)
    assert filled['joint_names'] == list(JOINTS)
    stiff = Robot(stiffened(model))
    for q, u, udot, effort in zip(*(filled[name] for name in (
            'positions', 'velocities', 'accelerations', 'efforts')), strict=True):
        assert effort == pytest.approx(bent_torques(model, q, u, udot), rel=1e-7)
        assert np.abs(effort - stiff.inverse_dynamics(q, u, udot)).max() > 1e-4


def test_feasible_is_of_the_bent_arm_with_its_speed_and_payload(motion, tmp_path):
    out = tmp_path / 'fits.csv'
    done = command(
        'feasible', *ARM, '--motion', motion, '--step', '0.02', '--payload-frame',
        'tip', '--payload-com', '0.02', '0', '0.01', '--out', str(out), '--json')
    assert done.returncode == 0, done.stderr
    data = json.loads(done.stdout)
    model = load_urdf(URDF, supplement=BENDING)
    bending = QuasiStatic(Robot(model, payload_frame='tip'))
    rigid = Robot(stiffened(model), payload_frame='tip')
    path = Motion.from_points(TIMES, POINTS, joint_names=JOINTS)
    arguments = {'step': 0.02, 'bending': bending}
    asked = demand(rigid, path, **arguments)
    assert data['joint_names'] == list(JOINTS)
    k = int(np.abs(asked.tau[:, 0]).argmax())
    assert data['torque']['peak'][0] == pytest.approx(abs(bent_torques(
        model, asked.q[k], asked.u[k], asked.udot[k])[0]), rel=1e-7)
    highest = fastest(rigid, path, **arguments)
    assert data['fastest']['speed'] == pytest.approx(highest.speed, rel=1e-9)
    assert data['payload']['mass'] == pytest.approx(largest_payload(
        rigid, path, com=(0.02, 0.0, 0.01), **arguments).mass, rel=1e-9)
    rows = np.genfromtxt(out, delimiter=',', names=True, deletechars='')
    assert rows['t'][-1] == pytest.approx(1.5 / highest.speed, rel=1e-6)
    uses = []
    for what, limit in (('tau', rigid.limits.effort), ('u', rigid.limits.velocity)):
        uses.append(max(np.abs(rows[f'{what}.{name}']).max() / limit[k]
                        for k, name in enumerate(JOINTS)))
    assert max(uses) == pytest.approx(1.0, rel=1e-3)


def test_beams_together_with_closed_loops(tmp_path):
    supplement = tmp_path / 'beams.yaml'
    rows = np.array([[0.0, 0.0, 0.0, 0.0], [0.2, 0.3, -0.2, 0.5]])
    supplement.write_text(yaml.safe_dump(BEAMS), encoding='utf-8')
    path = written(tmp_path / 'path.csv', DRIVEN, [0.0, 2.0], rows)
    arm = [str(PALLETIZER), '--supplement', str(supplement), '--constraints', str(LOOPS)]
    flexible, rigid = bending_palletizer()
    bending = QuasiStatic(flexible)
    asked = demand(rigid, Motion.from_points([0.0, 2.0], rows, joint_names=DRIVEN),
                   step=0.1, bending=bending)
    done = command('feasible', *arm, '--motion', path, '--step', '0.1', '--json')
    assert done.returncode in (0, 1), done.stderr
    np.testing.assert_allclose(json.loads(done.stdout)['torque']['peak'],
                               np.abs(asked.tau).max(axis=0), rtol=1e-9, atol=1e-9)
    done = command('fill', *arm, '--motion', path, '--json')
    assert done.returncode == 0, done.stderr
    np.testing.assert_allclose(
        json.loads(done.stdout)[0]['efforts'][0], bending.gravity_force(
            rigid.closed_configuration(rigid.configuration)), rtol=1e-9, atol=1e-9)


def test_options_that_treat_beams_as_rigid_are_refused_by_name(motion, tmp_path):
    done = command('feasible', *ARM, '--motion', motion, '--time-optimal')
    assert done.returncode == 2
    assert '--time-optimal: given for an arm with beams' in done.stderr
    file = tmp_path / 'moved.yaml'
    supplement = tmp_path / 'beams.yaml'
    supplement.write_text(yaml.safe_dump(BEAMS), encoding='utf-8')
    file.write_text(
        LOOPS.read_text().replace('actuated: [swivel, shoulder, lever_drive, turn]',
                                  'actuated: [swivel, elbow, lever_drive, turn]'))
    done = command('fill', str(PALLETIZER), '--supplement', str(supplement),
                   '--constraints', str(file), '--motion', motion)
    assert done.returncode == 2 and 'expected the independent joints' in done.stderr
