"""True drives of random robots lie in the deviations as often as normal errors."""

from dataclasses import dataclass

from kane_dynamics import Drive, Robot, with_drives
from kane_dynamics.identification import DriveRecording, identify_drives
from mechanisms import random_model
import numpy as np
import pytest

CYCLE = 1e-3  # s, of the recording and of the motors' torques
DURATION = 8.0  # s
SUBSTEPS = 2  # of the simulation, in a cycle
NOISE = 2e-5  # of positions, rad, or of a meter in the units of the robot
TORQUE_NOISE = 1e-3  # of the largest torque
SKEW = 3  # cycles by which the encoders of the links are late
CASES = 6
RECORDINGS = 3
NUMBERS = 'stiffness', 'damping', 'rotor_inertia', 'torque_delay'


@dataclass(frozen=True)
class Motion:
    """A motion of links and motors, (N, n) each, with motor and gear torques."""

    model: object
    units: np.ndarray
    q: np.ndarray
    theta: np.ndarray
    motor_torque: np.ndarray
    gear_torque: np.ndarray
    truth: dict


def moving_arm(seed, sweep):
    """
    Return the motion of a random arm whose motor torques are held for each cycle.

    It follows sums of sines, or with `sweep` vibrates through its resonances.
    """
    rng = np.random.default_rng(seed)
    model = random_model(int(rng.integers(2**31)), int(rng.integers(1, 4)),
                         prismatic=0.2)
    rigid = Robot(model)
    units = rigid.mechanism.units
    n = rigid.n
    center = rng.uniform(-0.5, 0.5, n) * units
    M = np.diag(rigid.mass_matrix(center))
    weight = rigid.gravity_force(center)
    drives = random_drives(rng, model, M, units)
    robot = Robot(with_drives(model, drives))
    names = robot.coordinate_names
    links = [names.index(name) for name in model.joint_names]
    motors = [names.index(f'{name}_motor') for name in model.joint_names]
    K, D, B = (np.array([getattr(drive, name) for drive in drives.values()])
               for name in ('stiffness', 'damping', 'rotor_inertia'))
    count = 40 if sweep else 7
    omega = 2.0 * np.pi * (np.geomspace(2.0, 30.0, count) if sweep
                           else np.geomspace(0.2, 4.0, count))
    phase = rng.uniform(0.0, 2.0 * np.pi, (n, count))
    size = rng.uniform(0.4, 1.0, (n, count)) * 0.4 / (1.0 + omega) * units[:, None]

    def torque(t, theta, speed):
        wave = np.sin(omega * t + phase)
        if sweep:
            return weight + 2.0 * M * units * wave.sum(
                axis=1) + 60.0 * M * (center - theta)
        ramp = min(t, 1.0)
        desired = center + ramp * (size * wave).sum(axis=1)
        rate = ramp * (size * omega * np.cos(omega * t + phase)).sum(axis=1)
        return weight + M * (80.0 * (desired - theta) + 12.0 * (rate - speed))

    state = np.zeros((2, robot.n))
    state[0, links] = center
    state[0, motors] = center + weight / K
    states = []
    torques = []
    for k in range(round(DURATION / CYCLE)):
        tau = np.zeros(robot.n)
        tau[motors] = torque(k * CYCLE, *state[:, motors])
        states.append(state)
        torques.append(tau[motors])
        for _ in range(SUBSTEPS):
            state = stepped(robot, state, tau, CYCLE / SUBSTEPS)
    q, u = np.moveaxis(np.array(states), 1, 0)
    gear = K * (q[:, motors] - q[:, links]) + D * (u[:, motors] - u[:, links])
    truth = {'stiffness': K, 'damping': D, 'rotor_inertia': B,
             'torque_delay': np.full(n, 0.5 * CYCLE)}
    return Motion(model, units, q[:, links], q[:, motors], np.array(torques), gear,
                  truth)


def random_drives(rng, model, M, units):
    """Return drives whose springs vibrate at 4 to 11 Hz with the links' inertias."""
    drives = {}
    for name, inertia, unit in zip(model.joint_names, M, units, strict=True):
        omega = rng.uniform(25.0, 70.0)
        B = inertia * rng.uniform(0.3, 1.5)
        friction = {'damping': B * rng.uniform(0.0, 2.0),
                    'friction': B * unit * rng.uniform(0.0, 1.0)}
        drives[name] = Drive(inertia * omega**2, rotor_inertia=B, friction=friction,
                             damping=2.0 * rng.uniform(0.01, 0.05) * inertia * omega)
    return drives


def stepped(robot, state, tau, h):
    """Return positions and rates after a step of Runge-Kutta."""
    def rates(x):
        return np.stack([x[1], robot.forward_dynamics(x[0], x[1], tau)])
    k1 = rates(state)
    k2 = rates(state + 0.5 * h * k1)
    k3 = rates(state + 0.5 * h * k2)
    k4 = rates(state + h * k3)
    return state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def recording_of(motion, rng, use):
    """Return what sensors measure, those of `use` beside the motors' encoders."""
    def noisy(values, size):
        return values + size * rng.normal(size=values.shape)
    late = SKEW if 'q' in use else 0
    count = len(motion.q) - late
    sensors = {}
    if 'q' in use:
        sensors['q'] = noisy(motion.q[:count], NOISE * motion.units)
    for name in ('motor_torque', 'gear_torque'):
        if name in use:
            values = getattr(motion, name)[late:]
            sensors[name] = noisy(values, TORQUE_NOISE * np.abs(values).max(axis=0))
    theta = noisy(motion.theta[late:], NOISE * motion.units)
    return DriveRecording(CYCLE * np.arange(count), theta, **sensors)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize('use', [
    ('q', 'gear_torque'), ('q', 'motor_torque'), ('q', 'gear_torque', 'motor_torque')],
    ids='+'.join)
def test_true_drives_of_random_robots_lie_within_two_deviations(use):
    errors = {}
    for case in range(CASES):
        motion = moving_arm((30, case), sweep=False)
        truth = motion.truth | {'skew': np.full(len(motion.units), SKEW * CYCLE)}
        for seed in range(RECORDINGS):
            rng = np.random.default_rng((case, seed))
            result = identify_drives(motion.model, recording_of(motion, rng, use))
            assert (result.misfit < 1.5).all(), (case, result.misfit)
            for name, values in truth.items():
                error = getattr(result, name) - values
                deviation = getattr(result, f'{name}_deviation')
                errors.setdefault(name, []).extend(error / deviation)
    for name in ('stiffness', 'damping'):
        print(name, 'RMS', np.sqrt(np.nanmean(np.square(errors[name]))))
    if 'motor_torque' in use:
        assert np.isfinite(errors['rotor_inertia']).all()
    everything = np.concatenate(list(errors.values()))
    everything = everything[np.isfinite(everything)]
    assert len(everything) > 50
    # 95.4 % of normal errors, whose mean square is 1. Numbers of one fit are correlated,
    # so that they count as half as many: three standard deviations of the mean square.
    assert np.mean(np.abs(everything) < 2.0) > 0.9
    spread = np.sqrt(2.0 / (0.5 * len(everything)))
    assert abs(np.mean(everything**2) - 1.0) < 3.0 * spread
