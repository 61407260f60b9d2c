"""Promises of the calibration of gravity by poses in which an arm is held."""

from held_arms import held, held_arm
from kane_dynamics import load_urdf, Robot
from kane_dynamics.errors import InputError
from kane_dynamics.identification import (calibrate_poses, diagnose, held_poses,
                                          HeldPoses, read_poses, Recording)
from kane_dynamics.identification.poses.calibrate_poses import proposed_poses
from kane_dynamics.identification.poses.held_poses import is_held, last_hold
from kane_dynamics.identification.result_files import written_links
from kane_dynamics.model.model import Inertial
import numpy as np
import pytest
import yaml

COM = np.array([0.0, 0.0, 0.1])
LOAD = 0.5  # kg
ARMS = [(2, 1), (3, 2), (5, 3), (6, 4), (7, 5)]  # joints, seed


def poses(holding, *, told=True):
    """Return held poses, with or without the directions of the approaches."""
    return HeldPoses(holding.q, holding.effort, told * holding.approach)


class Case:
    """An arm, its wrong URDF and scales, and its 30 poses, half with a load."""

    def __init__(self, n, seed, factor=None):
        rng = np.random.default_rng(seed)
        self.arm = held_arm(n, rng)
        factors = rng.uniform(0.4, 2.5, n) if factor is None else factor
        shift = rng.uniform(-0.02, 0.02, self.arm.coms.shape)
        self.urdf = self.arm.urdf(self.arm.masses * factors, self.arm.coms + shift)
        self.model = load_urdf(self.urdf)
        self.scale = rng.uniform(0.6, 1.5, n) * np.where(
            rng.uniform(size=n) < 0.3, -1.0, 1.0)
        q = rng.uniform(-1.5, 1.5, (30, n))
        self.empty = held(self.arm, q[:15], self.scale, rng)
        self.loaded = held(self.arm, q[15:], self.scale, rng, load=LOAD)
        self.load = f'l{n}', Inertial(LOAD, COM, np.zeros((3, 3)))
        self.test_q = rng.uniform(-1.5, 1.5, (100, n))
        self.truth = np.array([self.arm.holding_torque(row) for row in self.test_q])

    def calibrated(self, *, told=True):
        """Return the calibration with the load."""
        return calibrate_poses(self.model, poses(self.empty, told=told),
                               loaded=poses(self.loaded, told=told), load=self.load)

    def effort_error(self, model, scale):
        """Return the RMS error of efforts that hold new poses, over all joints."""
        effort = Robot(model, friction=False).gravity_force(self.test_q) / scale
        return np.sqrt(np.mean((effort - self.truth / self.scale)**2))


@pytest.mark.parametrize(('n', 'seed'), ARMS)
@pytest.mark.parametrize('told', [True, False])
def test_thirty_poses_with_a_load_give_scales_to_2_percent_and_a_tenth_of_the_error(
        n, seed, told):
    case = Case(n, seed)
    result = case.calibrated(told=told)
    before = case.effort_error(case.model, 1.0)
    assert case.effort_error(result.model, result.scale) < 0.1 * before
    sees = result.sees_gravity
    assert sees.sum() >= n - 1
    np.testing.assert_allclose(result.scale[sees], case.scale[sees], rtol=0.02)
    assert not result.not_told_apart
    # Deviations are those of the errors.
    error = np.abs(result.scale / case.scale - 1.0)[sees]
    assert (error < 4.0 * result.scale_deviation[sees]).all()


@pytest.mark.parametrize('factor', [1e-3, 6.0])
def test_masses_may_be_wrong_by_any_common_factor(factor):
    case = Case(5, 3, factor)
    result = case.calibrated()
    assert case.effort_error(result.model, result.scale) < 0.02 * np.sqrt(
        np.mean((case.truth / case.scale)**2))
    sees = result.sees_gravity
    np.testing.assert_allclose(result.scale[sees], case.scale[sees], rtol=0.02)


def test_a_combination_of_masses_is_within_its_deviation_of_the_true_one():
    outside = count = 0
    for n, seed in ARMS:
        case = Case(n, seed)
        result = case.calibrated()
        true = load_urdf(case.arm.urdf())
        exact = HeldPoses(case.test_q, case.truth, 0.0 * case.truth)
        reference = calibrate_poses(true, exact)
        assert reference.parameters == result.parameters
        error = np.abs(result.values - reference.values)
        outside += np.sum(error > 3.0 * result.deviations + 1e-4)
        count += len(error)
    assert count > 30
    assert outside <= 0.1 * count


def test_without_a_load_scales_and_masses_are_not_told_apart_and_gravity_is_right():
    for n, seed in ARMS:
        case = Case(n, seed)
        result = calibrate_poses(case.model, poses(case.empty))
        sees = np.array(case.model.joint_names)[result.sees_gravity]
        assert result.not_told_apart == tuple(sees)
        before = case.effort_error(case.model, 1.0)
        assert case.effort_error(result.model, result.scale) < 0.1 * before


def test_held_out_errors_are_those_of_new_poses():
    case = Case(6, 4)
    result = case.calibrated(told=False)
    sees = result.sees_gravity
    new = held(case.arm, case.test_q, case.scale, np.random.default_rng(8))
    computed = Robot(result.model, friction=False).gravity_force(new.q)
    error = np.sqrt(np.mean((new.effort * result.scale - computed)**2, axis=0))
    # Half of the poses carry the load, with several times the friction.
    np.testing.assert_array_less(result.held_out[sees], 4.0 * error[sees])
    np.testing.assert_array_less(0.4 * error[sees], result.held_out[sees])
    assert (result.before > result.held_out)[sees].all()
    assert np.linalg.norm(result.before) > 3.0 * np.linalg.norm(result.held_out)


def test_friction_is_the_interval_that_the_approaches_show():
    case = Case(3, 2)
    result = case.calibrated()
    size = np.sqrt(np.mean((np.concatenate([case.empty.effort, case.loaded.effort])
                            * case.scale)**2, axis=0))
    low, high = result.friction.T
    assert (low < high).all()
    assert (0.05 * size < low).all()
    assert (high < 0.14 * size).all()


def test_every_body_is_physical():
    for body in Case(7, 5).calibrated().model.bodies:
        assert np.linalg.eigvalsh(body.inertial.pseudo_inertia).min() > 0.0


def test_further_poses_reduce_the_deviations_more_than_random_ones():
    case = Case(5, 3)
    rng = np.random.default_rng(9)
    first = case.calibrated()
    lower, upper = np.full(5, -2.5), np.full(5, 2.5)
    assert ((first.further_poses >= lower) & (first.further_poses <= upper)).all()
    deviations = []
    for q in (first.further_poses, rng.uniform(-2.5, 2.5, (5, 5))):
        more = held(case.arm, q, case.scale, rng, stick=0.0)
        both = [np.concatenate(pair) for pair in zip(case.empty, more)]
        result = calibrate_poses(case.model, HeldPoses(*both),
                                 loaded=poses(case.loaded), load=case.load)
        deviations.append(np.log(result.deviations).sum())
    assert deviations[0] < deviations[1]


def test_further_poses_are_distinct():
    further = Case(2, 1).calibrated().further_poses
    assert len(np.unique(further, axis=0)) == len(further) == 5


def test_proposed_poses_determine_gravity_better_than_random_ones():
    case = Case(5, 3)
    rng = np.random.default_rng(9)

    def free(q):
        return q[:, 1] < 1.0
    proposed = proposed_poses(case.model, 8, 0.2, free)
    assert (np.abs(proposed) <= 2.3).all() and free(proposed).all()
    robot = Robot(case.model, friction=False)
    size = 0.1 * np.sqrt(np.mean(robot.gravity_force(case.test_q)**2, axis=0))[1:]
    masses = [body.inertial.mass for body in case.model.bodies]
    prior = np.concatenate([mass * np.array([1.0, 0.1, 0.1, 0.1] + 6 * [0.0])
                            for mass in masses])
    information = []
    random = rng.uniform(-2.3, [2.3, 1.0, 2.3, 2.3, 2.3], (20, 8, 5))
    for q in (proposed, *random):
        Y = [robot.regressor(row, np.zeros(5), np.zeros(5))[1:] for row in q]
        A = np.concatenate(Y / size[:, None]) * prior
        information.append(np.linalg.slogdet(np.eye(len(A)) + A @ A.T)[1])
    assert information[0] > np.quantile(information[1:], 0.9)


def test_the_last_hold_is_what_rests_until_now():
    holding = Case(3, 2).empty
    recording = recording_of(holding)
    now = last_hold(recording, 0.8)
    np.testing.assert_allclose(now.q[0], holding.q[-1], atol=1e-4)
    np.testing.assert_allclose(now.effort[0], holding.effort[-1], atol=1e-9)
    np.testing.assert_array_equal(now.approach[0],
                                  np.sign(holding.q[-1] - holding.q[-2]))
    moving = recording.rows(slice(0, len(recording) - 120))
    assert last_hold(moving, 0.8) is None  # it moves
    assert last_hold(recording, 5.0) is None  # it has not rested for so long


def test_the_written_supplement_has_the_gravity_of_the_calibrated_model(tmp_path):
    case = Case(3, 2)
    result = case.calibrated()
    path = tmp_path / 'arm.yaml'
    path.write_text(written_links(case.urdf, result.model))
    assert set(yaml.safe_load(path.read_text())) == {'links'}
    again = load_urdf(case.urdf, supplement=path)
    expected = Robot(result.model).gravity_force(case.test_q)
    np.testing.assert_allclose(Robot(again).gravity_force(case.test_q), expected,
                               rtol=1e-12, atol=1e-12)


# Recordings of held poses.

def recording_of(holding, *, paused=False, noise=1e-4):
    """Return the recording of an arm that moves to poses and is held there for 1 s."""
    rng = np.random.default_rng(0)
    rows = []
    t = 0.0
    previous = holding.q[0]
    for q, effort in zip(holding.q, holding.effort):
        if paused:
            t += 3.0
        else:
            for share in 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 60)):
                t += 0.02
                rows.append([t, *(previous + share * (q - previous)), *effort])
        for _ in range(100):
            t += 0.01
            rows.append([t, *q, *effort])
        previous = q
    table = np.array(rows)
    n = holding.q.shape[1]
    q = table[:, 1:n + 1] + noise * rng.normal(size=(len(table), n))
    rest = np.zeros_like(q)
    return Recording(table[:, 0], q, rest, rest, table[:, n + 1:])


@pytest.mark.parametrize('paused', [False, True])
def test_poses_of_a_recording_are_its_holds(paused):
    holding = Case(3, 2).empty
    found = held_poses(recording_of(holding, paused=paused))
    assert len(found) == len(holding.q)
    np.testing.assert_allclose(found.q, holding.q, atol=1e-4)
    np.testing.assert_allclose(found.effort, holding.effort, atol=1e-9)
    travel = np.diff(holding.q, axis=0)
    expected = np.zeros_like(travel) if paused else np.sign(travel)
    np.testing.assert_array_equal(found.approach[1:], expected)
    assert is_held(recording_of(holding, paused=paused))


@pytest.mark.parametrize('speeds', ['zero', 'derived'])
def test_recordings_of_held_poses_are_recognized_where_a_motion_is_expected(speeds):
    case = Case(3, 2)
    recording = recording_of(case.empty, paused=speeds == 'zero')
    level = 'impossible'
    if speeds == 'derived':
        recording = recording.with_derived_speeds()
        level = 'remark'
    held_faults = [fault for fault in diagnose(case.model, recording)
                   if 'held in' in fault.words]
    assert [fault.level for fault in held_faults] == [level]
    assert 'kane-dynamics calibrate' in held_faults[0].words


def test_a_motion_has_no_held_poses():
    t = np.linspace(0.0, 20.0, 2001)
    q = np.column_stack([np.sin(t), np.cos(t)])
    moving = Recording(t, q, 0 * q, 0 * q, q)
    assert not is_held(moving)
    with pytest.raises(InputError, match=r'no stretch of 0\.4 s'):
        held_poses(moving)


def test_a_table_without_times_has_one_pose_a_row(tmp_path):
    path = tmp_path / 'poses.csv'
    path.write_text('q.b,q.a,tau.a,tau.b\n1,2,3,4\n5,6,7,8\n')
    table = read_poses(path, ('a', 'b'))
    np.testing.assert_array_equal(table.q, [[2, 1], [6, 5]])
    np.testing.assert_array_equal(table.effort, [[3, 4], [7, 8]])
    assert not table.approach.any()
    path.write_text('q.a,q.b,tau.a,tau.b,approach.b,approach.a\n1,2,3,4,-1,1\n')
    np.testing.assert_array_equal(read_poses(path, ('a', 'b')).approach, [[1, -1]])


@pytest.mark.parametrize(('change', 'words'), [
    ({'loaded': None}, 'expected together with load'),
    ({'load': None}, 'expected together with load'),
])
def test_a_load_without_poses_is_refused(change, words):
    case = Case(2, 1)
    arguments = {'loaded': poses(case.loaded), 'load': case.load} | change
    with pytest.raises(InputError, match=words):
        calibrate_poses(case.model, poses(case.empty), **arguments)


def test_too_few_poses_and_other_joints_are_refused():
    case = Case(3, 2)
    few = HeldPoses(case.empty.q[:3], case.empty.effort[:3], case.empty.approach[:3])
    with pytest.raises(InputError, match='3 different ones; expected at least 4'):
        calibrate_poses(case.model, few)
    other = HeldPoses(np.zeros((9, 2)), np.zeros((9, 2)), np.zeros((9, 2)))
    with pytest.raises(InputError, match='2 joints; expected 3: j1, j2, j3'):
        calibrate_poses(case.model, other)
    with pytest.raises(InputError, match='not finite in row 2'):
        HeldPoses(np.array([[0.0], [np.nan]]), np.zeros((2, 1)), np.zeros((2, 1)))
