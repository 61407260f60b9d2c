"""Drives of elastic joints, identified from recordings of an independent simulation."""

from dataclasses import replace

from elastic_arm import (large_motion, simulated, softening, Truth, URDF)
from kane_dynamics import Drive, InputError, load_urdf, ModelWarning, Robot, with_drives
from kane_dynamics.identification import (DriveRecording, identify_drives,
                                          read_drive_recording)
import numpy as np
import pytest
import yaml

NUMBERS = 'stiffness', 'damping', 'rotor_inertia'
SEEDS = 100


@pytest.fixture(scope='module')
def model():
    """Return the model with rigid joints."""
    return load_urdf(URDF)


@pytest.fixture(scope='module')
def short():
    """Return four seconds of motion."""
    return simulated(large_motion(3, (2000.0, 800.0)), 4.0)


@pytest.fixture(scope='module')
def long():
    """Return ten seconds of motion."""
    return simulated(large_motion(3, (2000.0, 800.0)), 10.0)


@pytest.fixture(scope='module')
def stiffening():
    """Return five seconds of motion with a shoulder that is stiffer beyond 12 N m."""
    truth = replace(Truth(), stiffness=(softening(1500.0, 4000.0, 12.0, 0.05), 1200.0))
    return simulated(large_motion(3, (2000.0, 800.0)), 5.0, truth=truth)


def scores(result, truth, skew):
    """Return errors over standard deviations of all determined numbers, by name."""
    errors = {}
    for name in NUMBERS:
        errors[name] = ((getattr(result, name) - getattr(truth, name))
                        / getattr(result, f'{name}_deviation'))
    errors['skew'] = (result.skew - skew) / result.skew_deviation
    return errors


def covered(model, motion, use, skew=0.003, numbers=(*NUMBERS, 'skew')):
    """Check that true values lie within two deviations as often as for normal errors."""
    errors = {name: [] for name in numbers}
    for seed in range(SEEDS):
        result = identify_drives(model, motion.measured(seed, use=use))
        of_seed = scores(result, motion.truth, skew)
        for name in numbers:  # deviations are no excuse
            determined = getattr(result, f'{name}_deviation') / np.abs(
                getattr(result, name))
            assert (determined < 0.05).all(), (name, determined)
        for name in numbers:
            errors[name].append(of_seed[name])
    for name, values in errors.items():
        within = np.mean(np.abs(values) < 2.0, axis=0)
        # 95.4 % of normal errors; fewer than 88 of 100 come once in 1000 trials.
        assert (within >= 0.88).all(), (name, within)


def test_a_sensor_and_both_encoders_determine_drives_and_skew(model, short):
    result = identify_drives(model, short.measured(1, use=('q', 'gear_torque',
                                                           'motor_torque')))
    for name, error in scores(result, short.truth, 0.003).items():
        assert (np.abs(error) < 3.5).all(), (name, error)
    assert result.source == 'torque sensor'
    assert (result.stiffness_deviation < 0.002 * result.stiffness).all()
    assert (result.skew_deviation < 1e-4).all()
    # The delay is no small part of what the encoders differ by.
    assert (result.skew_share > 0.2).all()
    drives = result.drives()
    assert set(drives) == set(model.joint_names)
    supplement = load_urdf(URDF, supplement=yaml.safe_load(result.supplement()))
    assert supplement.digest() == result.elastic(model).digest()


def test_equations_that_lack_something_state_the_delay_of_the_encoders_and_no_more(
        model, short):
    recording = short.measured(1, use=('q', 'gear_torque'))
    result = identify_drives(model, recording)
    assert np.allclose(result.stiffness, short.truth.stiffness, rtol=2e-3)
    np.testing.assert_allclose(result.skew, 0.003, atol=1e-4)
    # A wrong skew, and hysteresis of the gear that no equation has.
    with pytest.warns(ModelWarning, match='residuals'):
        wrong = identify_drives(model, recording, skew=0.0)
    assert np.isnan(wrong.stiffness).all() and np.isnan(wrong.damping).all()
    assert 'times the noise' in wrong.undetermined['elbow stiffness']
    speed = np.gradient(recording.theta, recording.t, axis=0)
    hysteresis = replace(recording, q=recording.q + 3e-4 * np.tanh(speed / 0.3))
    with pytest.warns(ModelWarning, match='residuals'):
        result = identify_drives(model, hysteresis)
    assert np.isnan(result.stiffness).all()
    np.testing.assert_allclose(result.skew, 0.003, atol=5e-4)


def test_a_stiffness_that_grows_is_refused_with_its_reason(model, stiffening):
    recording = stiffening.measured(1, use=('q', 'gear_torque', 'motor_torque'))
    with pytest.warns(ModelWarning, match='drives of shoulder: residuals.*no constant'):
        result = identify_drives(model, recording)
    assert np.isnan(result.stiffness[0])
    assert 'the equations lack something' in result.undetermined['shoulder stiffness']
    assert np.abs(result.skew[0] - 0.003) < 3e-4
    assert result.stiffness[1] == pytest.approx(1200.0,
                                                abs=3.0 * result.stiffness_deviation[1])


@pytest.mark.parametrize('cycles', [-1, 1])
def test_motor_torques_that_act_late_move_neither_damping_nor_skew(model, short, cycles):
    recording = short.measured(1, use=('q', 'motor_torque'))
    # Each row has the torque that acts some cycles later.
    rows = np.arange(2, len(recording) - 2)
    late = {name: getattr(recording, name)[rows] for name in ('t', *recording.signals)}
    late['motor_torque'] = recording.motor_torque[rows + cycles]
    result = identify_drives(model, DriveRecording(**late))
    for name, error in scores(result, short.truth, 0.003).items():
        assert (np.abs(error) < 3.5).all(), (name, error)
    error = (result.torque_delay - 1e-3 * cycles) / result.torque_delay_deviation
    assert (np.abs(error) < 3.5).all(), error
    assert (result.torque_delay_deviation < 1e-4).all()


def test_gravity_and_payload_of_a_robot_count(model, short):
    recording = short.measured(1, use=('q', 'motor_torque'))
    # The same arm, with a part of its second link as a payload, and gravity changed
    # later.
    whole = model.bodies[1].inertial
    half = replace(whole, mass=0.5 * whole.mass, inertia=0.5 * whole.inertia)
    bodies = model.bodies[0], replace(model.bodies[1], inertial=half)
    weightless = replace(model, bodies=bodies, gravity=np.zeros(3))
    robot = Robot(weightless, payload_frame='link1')
    robot.parameters.gravity = model.gravity
    robot.parameters.payload = half
    expected = identify_drives(model, recording)
    result = identify_drives(robot, recording)
    np.testing.assert_allclose(result.stiffness, expected.stiffness, rtol=1e-9)


def test_a_recording_is_checked(model, short):
    good = short.measured(0, use=('q', 'gear_torque'))
    with pytest.raises(InputError, match='50 rows; expected at least 200'):
        DriveRecording(good.t[:50], good.theta[:50], good.q[:50])
    with pytest.raises(InputError, match='alone'):
        DriveRecording(good.t, good.theta)
    with pytest.raises(InputError, match=r'q: shape'):
        DriveRecording(good.t, good.theta, good.q[:, :1])
    with pytest.raises(InputError, match='not finite in row 4'):
        theta = good.theta.copy()
        theta[3, 1] = np.nan
        DriveRecording(good.t, theta, good.q)
    with pytest.raises(InputError, match=r'the motor moves 9\S* times'):
        identify_drives(model, replace(good, theta=100.0 * good.theta))
    with pytest.raises(InputError, match='the motor moves -'):
        identify_drives(model, replace(good, q=-good.q))
    for options in ({'skew': 0.003}, {}):
        with pytest.raises(InputError, match='the gear deflects against its torque'):
            identify_drives(model, replace(good, gear_torque=-good.gear_torque),
                            **options)
    with pytest.raises(InputError, match='no motor moves'):
        identify_drives(model, replace(good, theta=0.0 * good.theta, q=0.0 * good.q))
    with pytest.raises(InputError, match='no positions of the links'):
        identify_drives(model, replace(good, q=None))
    with pytest.raises(InputError, match='1 joints; expected 2'):
        identify_drives(model, DriveRecording(good.t, good.theta[:, :1], good.q[:, :1]))
    with pytest.raises(InputError, match='skew'):
        identify_drives(model, good, skew=np.nan)
    elastic = with_drives(model, {'elbow': Drive(1000.0, rotor_inertia=0.1)})
    with pytest.raises(InputError, match='elastic joints already'):
        identify_drives(elastic, good)


def test_motor_side_values_with_a_ratio_are_the_same_recording(tmp_path, short):
    joint_side = short.measured(0)
    ratio = np.array([100.0, -50.0])
    columns = {'t': joint_side.t, 'theta': joint_side.theta * ratio, 'q': joint_side.q,
               'motor_torque': joint_side.motor_torque / ratio}
    np.savez(tmp_path / 'motors.npz', **columns)
    recording = read_drive_recording(tmp_path / 'motors.npz', ('shoulder', 'elbow'),
                                     ratio)
    for name in joint_side.signals:
        assert np.allclose(getattr(recording, name), getattr(joint_side, name),
                           rtol=1e-12)
    np.savez(tmp_path / 'links.npz', t=joint_side.t, q=joint_side.q)
    with pytest.raises(InputError, match="no 'theta' of the motors"):
        read_drive_recording(tmp_path / 'links.npz', ('shoulder', 'elbow'))


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_true_drives_lie_within_two_deviations_by_a_torque_sensor(model, long):
    covered(model, long, ('q', 'gear_torque', 'motor_torque'))


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_true_drives_lie_within_two_deviations_by_the_torque_of_the_links(model, long):
    covered(model, long, ('q', 'motor_torque'))
