"""Drives of closed loops, identified from a simulated parallelogram."""

from dataclasses import replace

from elastic_arm import large_motion, Noise, Parallelogram, simulated
from kane_dynamics import InputError, Prescribed, Robot
from kane_dynamics.errors import ConstraintError
from kane_dynamics.identification import DriveRecording, identify_drives
from kane_dynamics.loop_tracking.driven_mechanism import mechanism_motion
import numpy as np
import pytest

NUMBERS = 'stiffness', 'damping', 'rotor_inertia'
LINKS = Parallelogram()
SEEDS = 40


@pytest.fixture(scope='module')
def robot():
    """Return the parallelogram with rigid joints."""
    return LINKS.robot()


@pytest.fixture(scope='module')
def large():
    """Return four seconds of a large motion."""
    return simulated(large_motion(3, (2000.0, 800.0)), 4.0, links=LINKS)


def scores(result, motion, numbers=NUMBERS):
    """Return errors over standard deviations by name."""
    errors = {}
    for name in numbers:
        error = getattr(result, name) - getattr(motion.truth, name)
        errors[name] = error / getattr(result, f'{name}_deviation')
    return errors


def test_the_parallelogram_is_that_of_its_lagrangian(robot):
    q, u, tau = np.random.default_rng(1).uniform(-0.5, 0.5, (3, 5, 2))
    motion = mechanism_motion(robot, LINKS.joint_names, 1e-3 * np.arange(5), q, u,
                              0.0 * u)
    expected = [LINKS.accelerations(*state) for state in zip(q, u, tau, strict=True)]
    np.testing.assert_allclose(robot.forward_dynamics(motion.q, u, tau), expected,
                               rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize(('use', 'source'), [
    (('q', 'gear_torque', 'motor_torque'), 'torque sensor'),
    (('q', 'motor_torque'), 'both encoders')])
def test_both_encoders_determine_the_drives_of_a_loop(robot, large, use, source):
    result = identify_drives(robot, large.measured(2, use=use))
    assert result.source == source
    assert result.joint_names == LINKS.joint_names
    for errors in scores(result, large).values():
        assert (np.abs(errors) < 3.5).all()
    assert (result.stiffness_deviation < 0.001 * result.stiffness).all()
    np.testing.assert_allclose(result.skew, 0.003, atol=2e-4)
    assert (result.misfit < 1.5).all()


def test_drives_of_a_loop_are_identified_with_the_gravity_of_the_robot(large):
    whole = LINKS.robot()
    lighter = LINKS.robot()
    lighter.parameters.gravity = [0.0, 0.0, -5.0]
    recording = large.measured(1, use=('q', 'motor_torque'))
    right = identify_drives(whole, recording)
    with pytest.warns(match='residuals'):
        wrong = identify_drives(lighter, recording)
    assert np.abs(right.stiffness / large.truth.stiffness - 1.0).max() < 0.01
    # What the residuals contradict is no number.
    assert np.isnan(wrong.stiffness).all()


def test_the_order_is_that_of_the_speeds_or_the_actuators(large):
    recording = large.measured(1, use=('q', 'motor_torque'))
    turned = DriveRecording(recording.t, *(getattr(recording, name)[:, ::-1]
                                           for name in ('theta', 'q', 'motor_torque')))
    straight = identify_drives(LINKS.robot(), recording)
    result = identify_drives(LINKS.robot(independent=('lever', 'arm')), turned)
    assert result.joint_names == ('lever', 'arm')
    np.testing.assert_allclose(result.stiffness[::-1], straight.stiffness, rtol=1e-6)

    # Independent speeds of other joints than those with drives.
    robot = LINKS.robot(independent=('lever', 'rod'), actuated=('lever', 'arm'))
    result = identify_drives(robot, recording)
    assert result.joint_names == robot.actuated_names == ('arm', 'lever')
    np.testing.assert_allclose(result.stiffness, straight.stiffness, rtol=1e-6)


def with_a_third_drive(motion, stiffness):
    """Return a recording in which the joint of the rod has a drive as well."""
    recording = motion.measured(1, Noise(skew=0.0), use=('q', 'gear_torque'))
    rod = motion.q[:, 0] - motion.q[:, 1]
    torque = 8.0 * np.sin(9.0 * motion.t) + 20.0 * rod
    rng = np.random.default_rng(3)
    added = {'theta': rod + torque / stiffness, 'q': rod, 'gear_torque': torque}
    sizes = {'theta': 2e-5, 'q': 2e-5, 'gear_torque': 0.1}
    columns = {}
    for name, signal in added.items():
        disturbed = signal + sizes[name] * rng.normal(size=len(signal))
        columns[name] = np.column_stack([getattr(recording, name), disturbed])
    return DriveRecording(recording.t, **columns)


def test_more_drives_than_degrees_of_freedom_need_torque_sensors(large):
    robot = LINKS.robot(actuated=('arm', 'lever', 'rod'))
    recording = with_a_third_drive(large, 900.0)
    result = identify_drives(robot, recording)
    np.testing.assert_allclose(result.stiffness, [3000.0, 1200.0, 900.0], rtol=0.01)
    without = replace(recording, gear_torque=None)
    with pytest.raises(InputError,
                       match='3 drives of a mechanism with 2 degrees of freedom'):
        identify_drives(robot, without)


def test_recordings_that_do_not_determine_a_loop_are_refused(robot, large):
    good = large.measured(0)
    with pytest.raises(InputError, match='2 joints; expected 4'):
        identify_drives(robot.model, good)  # the open tree has four
    beyond = replace(good, q=good.q + np.array([0.0, 1.55]),
                     theta=good.theta + np.array([0.0, 1.55]))
    # The parallelogram passes its flat configuration.
    with pytest.raises(ConstraintError):
        identify_drives(robot, beyond)
    moved = Robot(robot.model, constraints=[*robot.options['constraints'],
                                            Prescribed('lever', np.sin)],
                  independent=('arm',))
    column = DriveRecording(good.t, good.theta[:, :1], good.q[:, :1])
    with pytest.raises(InputError, match='constraints that are functions of time'):
        identify_drives(moved, column)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize('use',
                         [('q', 'gear_torque', 'motor_torque'), ('q', 'motor_torque')])
def test_true_drives_of_a_loop_lie_within_two_deviations(robot, large, use):
    motion = large
    errors = {name: [] for name in NUMBERS}
    for seed in range(SEEDS):
        result = identify_drives(robot, motion.measured(seed, use=use))
        for name, error in scores(result, motion).items():
            errors[name].append(error)
    for name, values in errors.items():
        # 95.4 % of normal errors; fewer than 33 of 40 come once in 1000 trials.
        within = np.mean(np.abs(values) < 2.0, axis=0)
        assert (within >= 0.825).all(), (name, within)
